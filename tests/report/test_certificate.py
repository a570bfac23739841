"""The certificate: valid by the published schema, every number that of the record, nothing made up."""

import base64
import json
import os
import re
import shutil
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path

import pytest
from lxml import etree

from truestand.calibration.calibrate import calibrate
from truestand.core.artefact import Certificate
from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.files.recipes.laboratory import read_laboratory
from truestand.files.records.calibration_record import calibration_record
from truestand.files.records.xml_schema import read_schema, violations
from truestand.report.certificate import certificate_xml, missing_statements, refusals
from truestand.report.certificate_administration import CertificateInput
from truth import scan_of, shaft

SCHEMAS = Path(os.environ.get("TRUESTAND_DCC_SCHEMAS", Path(__file__).parents[2] / "../shared/schemas/dcc"))
ABSENT = f"the schemas of the DCC are not in {SCHEMAS.name} of the folder shared beside the project"
needs_schemas = pytest.mark.skipif(not SCHEMAS.is_dir(), reason=ABSENT)
SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
UNITS = {"deg": r"\degree", "um": r"\micro\metre", "mm": r"\milli\metre", "mrad": r"\milli\radian"}
LABORATORY = """
[laboratory]
name = "Messlabor & Söhne"
street = "Gasse"
street_no = "1 <b>"
post_code = "01234"
city = "Dresden"
country = "DE"
e_mail = "lab@example.org"
code = "D-K-00000-01-00"
[[responsible]]
name = "A. Person"
role = "head"
signs = true
[customer]
name = "Own works"
city = "Dresden"
[stand]
name = "stand 3"
serial = "S-3"
[performance]
place = "laboratory"
begin = 2026-03-02
end = 2026-03-03
temperature_C = 20.4
temperature_U_C = 0.5
"""
TRACED = Certificate("2026-0815", "Labor M", "2026-01-15", "2027-01-15", 20.0)


@cache
def found(name="from above", method="stand"):
    return calibrate(scan_of(name), shaft(), method)


def traced(calibration):
    return replace(calibration, artefact=replace(calibration.artefact, certificate=TRACED, serial="M 7"))


def issue(calibration, laboratory=None, number=None):
    record = calibration_record(calibration, "2026-03-03T10:00:00Z")
    source = (json.dumps(record, indent=2) + "\n").encode()
    return CertificateInput(json.loads(source), calibration, source, "calibration.json", laboratory, number)


@pytest.fixture
def laboratory(tmp_path):
    (tmp_path / "laboratory.toml").write_text(LABORATORY, encoding="utf-8")
    return read_laboratory(tmp_path / "laboratory.toml")


def tree(text):
    return etree.fromstring(text)


def one(root, path):
    (element,) = root.xpath(path, namespaces=SPACES)
    return element


def told(root, path):
    return [e.text for e in root.xpath(path, namespaces=SPACES)]


@cache
def schema():
    return read_schema(SCHEMAS)


@needs_schemas
@pytest.mark.parametrize("name", ["from above", "centred"])
def test_a_draft_is_valid(name):
    assert violations(certificate_xml(issue(found(name))), schema()) == []


@needs_schemas
def test_a_laboratory_s_certificate_is_valid(laboratory):
    assert violations(certificate_xml(issue(traced(found()), laboratory, "2026/17")), schema()) == []


@needs_schemas
@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        (r"<si:value>-?\d", "<si:value>about 4"),
        (r"<si:unit>[^<]*</si:unit>", ""),
        (r"<si:valueExpandedMU>", "<si:valueExpandedMU>-"),
        (r"<si:coverageFactor>2.0", "<si:coverageFactor>0.5"),
        (r"<si:coverageProbability>0.9545", "<si:coverageProbability>95.45"),
        (r"<dcc:beginPerformanceDate>2026-03", "<dcc:beginPerformanceDate>2026-13"),
        (r"<dcc:mimeType>[^<]*</dcc:mimeType>", ""),
        (r"<dcc:respPersons>.*</dcc:respPersons>", ""),
        (r'schemaVersion="3.3.0"', 'schemaVersion="2.4.0"'),
    ],
)
def test_a_corrupted_one_is_not(right, wrong):
    text = certificate_xml(issue(found())).decode()
    corrupted, changed = re.subn(right, wrong, text, count=1, flags=re.DOTALL)
    assert changed == 1
    assert violations(corrupted.encode(), schema())


def test_every_number_is_that_of_the_record_to_the_last_digit():
    given = issue(found())
    root, record = tree(certificate_xml(given)), given.record
    told_keys = set()
    for key, u in record["uncertainty"].items():
        group = record["sensor"] if key in record["sensor"] else record["shaft"]
        value = record["sensor"]["table_from_sensor"][0][3] if key == "radial_position_mm" else group[key]
        real = one(root, f"//dcc:quantity[@id='{key}']/si:real")
        assert one(real, "si:value").text == json.dumps(value)
        assert one(real, "si:unit").text == UNITS[key.rsplit("_", 1)[-1]]
        assert one(real, ".//si:valueExpandedMU").text == json.dumps(u["U"])
        assert float(one(real, ".//si:coverageFactor").text) == u["k"] == 2.0
        assert one(real, ".//si:coverageProbability").text == "0.9545"
        digit = 10.0 ** int(one(real, "si:significantDigit").text)
        assert 10 * digit <= u["U"] < 100 * digit
        told_keys.add(key)
    assert len(told_keys) == 8
    for name, group in (("table_from_sensor", "sensor"), ("shaft_from_rotor", "shaft")):
        matrix = record[group][name]
        rotation = one(root, f"//dcc:quantity[@id='{name}_rotation']//si:valueXMLList").text.split()
        assert rotation == [json.dumps(v) for row in matrix[:3] for v in row[:3]]
        moved = one(root, f"//dcc:quantity[@id='{name}_translation']//si:valueXMLList").text.split()
        assert moved == [json.dumps(row[3]) for row in matrix[:3]]


def test_the_record_is_inside_byte_for_byte():
    given = issue(found())
    root = tree(certificate_xml(given))
    assert base64.b64decode(one(root, "//dcc:dataBase64").text) == given.source
    digest = sha256(given.source).hexdigest()
    assert digest in one(root, "//dcc:byteData/dcc:description/dcc:content").text
    assert digest in told(root, "//dcc:coreData//dcc:value")


def test_what_is_not_identifiable_is_stated_and_has_no_value():
    given = issue(found("centred"))
    root = tree(certificate_xml(given))
    unseen = given.record["not_identifiable"]
    assert {"eccentricity_direction_deg", "laser_plane_offset_mm"} <= set(unseen)
    statements = told(root, "//dcc:statement/dcc:name/dcc:content")
    assert all(f"not identifiable: {u}" in statements for u in unseen)
    assert not root.xpath("//dcc:quantity[@id='eccentricity_direction_deg']", namespaces=SPACES)


def test_a_distribution_is_named_only_where_the_trials_bear_it_out():
    calibration = found("centred")
    root = tree(certificate_xml(issue(calibration)))
    for key, u in calibration.uncertainty.items():
        for real in root.xpath(f"//dcc:quantity[@id='{key}']", namespaces=SPACES):
            assert bool(real.xpath(".//si:distribution", namespaces=SPACES)) == (u.monte_carlo != u.U)
    assert "Not normally distributed" in etree.tostring(root, encoding="unicode")


def test_an_untrusted_calibration_gets_none():
    given = issue(replace(found(), reasons=("too few turns",)))
    assert refusals(given.record) == ["too few turns"]
    assert refusals({"status": "untrusted"})
    assert refusals(issue(found()).record) == []


def test_the_published_method_gets_none_because_it_states_no_uncertainty():
    (reason,) = refusals(issue(found(method="paper")).record)
    assert "no uncertainty" in reason
    assert "--method stand" in reason
    bare = issue(found()).record | {"uncertainty": {}}
    assert "no uncertainties" in refusals(bare)[0]


def test_a_draft_says_what_nobody_stated():
    given = issue(found())
    text = " ".join(tree(certificate_xml(given)).itertext())
    assert "No laboratory issues this" in text
    for missing in missing_statements(given):
        assert missing in text
    assert one(tree(certificate_xml(given)), "//dcc:calibrationLaboratory//dcc:name/dcc:content").text == "not stated"
    assert told(tree(certificate_xml(given)), "//dcc:traceable") == ["false"]


def test_a_laboratory_is_asked_by_name(laboratory, tmp_path):
    with pytest.raises(BadRecipe, match=r"\[certificate\] id, laboratory \(shaft.toml\)"):
        certificate_xml(issue(found(), laboratory))
    (tmp_path / "laboratory.toml").write_text(LABORATORY.replace('serial = "S-3"', ""))
    with pytest.raises(BadRecipe, match=r"lacks \[stand\] serial \(laboratory.toml\): state them"):
        certificate_xml(issue(traced(found()), read_laboratory(tmp_path / "laboratory.toml")))


def test_a_lapsed_certificate_of_the_artefact_is_named(laboratory):
    calibration = traced(found())
    for until in ("2026-03-02", "next spring"):
        old = replace(calibration.artefact.certificate, valid_until=until)
        lapsed = replace(calibration, artefact=replace(calibration.artefact, certificate=old))
        with pytest.raises(BadRecipe, match=f"valid_until {until}"):
            certificate_xml(issue(lapsed, laboratory))


def test_a_number_of_blanks_is_none():
    assert issue(found(), None, "  ").identifier.startswith("truestand-2026-03-03-")
    assert issue(found(), None, " 2026 / 17 ").identifier == "2026 / 17"


def test_a_laboratory_s_certificate_says_who_what_and_where(laboratory):
    root = tree(certificate_xml(issue(traced(found()), laboratory, "2026/17")))
    assert told(root, "//dcc:uniqueIdentifier") == ["2026/17"]
    assert told(root, "//dcc:beginPerformanceDate | //dcc:endPerformanceDate") == ["2026-03-02", "2026-03-03"]
    assert told(root, "//dcc:countryCodeISO3166_1") == ["DE"]
    assert told(root, "//dcc:streetNo") == ["1 <b>"]
    assert told(root, "//dcc:calibrationLaboratory/dcc:contact/dcc:name/dcc:content") == ["Messlabor & Söhne"]
    assert told(root, "//dcc:mainSigner") == ["true"]
    assert told(root, "//dcc:traceable") == ["true"]
    assert {"2026-0815", "M 7", "S-3"} <= set(told(root, "//dcc:identification/dcc:value"))
    air, reference = root.xpath("//dcc:influenceCondition[@refType='basic_temperature']//si:real", namespaces=SPACES)
    assert one(air, "si:value").text == "20.4"
    assert one(air, ".//si:valueExpandedMU").text == "0.5"
    assert one(reference, "si:value").text == "20.0"
    assert "not stated" not in " ".join(root.itertext())


def test_the_same_input_gives_the_same_bytes():
    assert certificate_xml(issue(found())) == certificate_xml(issue(found()))


def test_a_record_changed_by_hand_is_refused():
    given = issue(found())
    for key, value in (("phi_deg", -41.9), ("phi_deg", "4x")):
        sensor = given.record["sensor"] | {key: value}
        with pytest.raises(UnreadableFile, match="phi_deg"):
            certificate_xml(replace(given, record=given.record | {"sensor": sensor}))
    u = given.record["uncertainty"]
    odd = {**u, "tilt_mrad": {**u["tilt_mrad"], "U": "1"}}
    with pytest.raises(UnreadableFile, match="a number"):
        certificate_xml(replace(given, record=given.record | {"uncertainty": odd}))


def test_a_record_without_a_date_is_refused():
    given = issue(found())
    with pytest.raises(UnreadableFile, match="created None"):
        certificate_xml(replace(given, record=given.record | {"created": None}))


@needs_schemas
def test_names_with_anything_in_them_stay_valid():
    calibration = found()
    evil = replace(calibration.artefact, name="a\x00<b>&\ud800 \n ]]>", serial=" 7 ")
    text = certificate_xml(issue(replace(calibration, artefact=evil)))
    assert violations(text, schema()) == []
    assert b"<b>" not in text


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ('country = "DE"', 'country = "Germany"', "country"),
        ('place = "laboratory"', 'place = "cellar"', "place"),
        ("end = 2026-03-03", "end = 2026-03-01", "isn't before"),
        ("temperature_C = 20.4", "", "need both"),
        ('city = "Dresden"\ncountry', 'town = "Dresden"\ncountry', "did you mean|known keys"),
        ('name = "A. Person"', 'name = " "', "name"),
    ],
)
def test_a_wrong_key_of_the_laboratory_is_refused(tmp_path, right, wrong, message):
    assert right in LABORATORY
    (tmp_path / "laboratory.toml").write_text(LABORATORY.replace(right, wrong), encoding="utf-8")
    with pytest.raises(BadRecipe, match=message):
        read_laboratory(tmp_path / "laboratory.toml")


@needs_schemas
def test_schemas_with_their_web_addresses_are_read_from_the_folder(tmp_path):
    for file in SCHEMAS.iterdir():
        shutil.copyfile(file, tmp_path / file.name)
    text = (tmp_path / "dcc.xsd").read_text(encoding="utf-8")
    text = text.replace('schemaLocation="SI_Format.xsd"', 'schemaLocation="https://ptb.de/si/v2.2.1/SI_Format.xsd"')
    address = "http://www.w3.org/TR/2002/REC-xmldsig-core-20020212/xmldsig-core-schema.xsd"
    text = text.replace('schemaLocation="xmldsig-core-schema.xsd"', f'schemaLocation="{address}"')
    (tmp_path / "dcc.xsd").write_text(text, encoding="utf-8")
    assert violations(certificate_xml(issue(found())), read_schema(tmp_path)) == []
    (tmp_path / "SI_Format.xsd").unlink()
    with pytest.raises(BadRecipe, match=r"found no SI_Format.xsd"):
        read_schema(tmp_path)


def test_a_folder_without_schemas_is_named(tmp_path):
    with pytest.raises(BadRecipe, match=r"dcc\.xsd"):
        read_schema(tmp_path)
    (tmp_path / "dcc.xsd").write_text("<no schema")
    with pytest.raises(BadRecipe, match="no usable schema"):
        read_schema(tmp_path)
