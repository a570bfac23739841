"""Records: what is written is read back, what is foreign is refused, old ones are understood."""

import copy
import json
import pickle
import re
from functools import cache

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from truestand.calibration.calibrate import calibrate
from truestand.core.errors import UnreadableFile
from truestand.core.message import UNTIED, Message
from truestand.core.surface import apply_calibration
from truestand.files.records.calibration_record import calibration_record, read_calibration, write_calibration
from truestand.files.records.schemas import schema_text
from truth import scan_of, shaft

WHEN = "2026-11-21T12:00:00Z"


def rounded(record):
    """Degrees come back through radians: the last bit may differ, the twelfth digit may not."""
    return json.loads(json.dumps(record), parse_float=lambda text: float(f"{float(text):.12g}"))


@cache
def calibration(method="stand"):
    return calibrate(scan_of("encoder"), shaft(), method)


@pytest.mark.parametrize("method", ["stand", "paper"])
def test_what_is_written_is_read_back(tmp_path, method):
    record = write_calibration(tmp_path / "c.json", calibration(method), WHEN)
    Draft202012Validator(json.loads(schema_text("calibration"))).validate(record)
    back = read_calibration(tmp_path / "c.json")
    assert rounded(calibration_record(back, WHEN)) == rounded(record)
    assert (back.created, back.method) == (WHEN, method)


def test_a_record_read_back_rolls_to_the_same_points(tmp_path):
    write_calibration(tmp_path / "c.json", calibration(), WHEN)
    back = read_calibration(tmp_path / "c.json")
    assert np.array_equal(
        apply_calibration(scan_of("encoder"), back).x,
        apply_calibration(scan_of("encoder"), calibration()).x,
        equal_nan=True,
    )


@pytest.mark.parametrize("method", ["stand", "paper"])
def test_the_least_record_is_enough(tmp_path, method):
    record = write_calibration(tmp_path / "c.json", calibration(method), WHEN)
    least = {k: record[k] for k in ("format", "version", "table", "sensor", "shaft")}
    (tmp_path / "least.json").write_text(json.dumps(least))
    back = read_calibration(tmp_path / "least.json")
    assert back.eccentricity == pytest.approx(calibration(method).eccentricity, abs=1e-12)
    assert back.angle_zero == "index"
    assert back.status == "valid"


def test_status_untrusted_stays_untrusted_even_without_a_reason(tmp_path):
    record = calibration_record(calibration(), WHEN) | {"status": "untrusted", "reasons": []}
    (tmp_path / "c.json").write_text(json.dumps(record))
    assert read_calibration(tmp_path / "c.json").status == "untrusted"


def without(key):
    def change(record):
        del record[key]

    return change


def scaled(record):
    record["sensor"]["table_from_sensor"][0][0] *= 1.01


def mirrored(record):
    for row in record["shaft"]["shaft_from_rotor"][:3]:
        row[0] = -row[0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (without("sensor"), "sensor"),
        (without("version"), "version None"),
        (lambda r: r.update(version=99), "99"),
        (lambda r: r.update(format="something"), "something"),
        (scaled, "rotation"),
        (mirrored, "rotation"),
        (lambda r: r["sensor"].update(table_from_sensor=[[1, 2], [3, 4]]), "4x4"),
        (lambda r: r["shaft"].update(shaft_from_rotor=[[float("nan")] * 4] * 4), "finite"),
        (lambda r: r["sensor"].update(table_from_sensor="x"), "malformed"),
        (lambda r: r["residuals"].update(points=None), "malformed"),
        (lambda r: r.update(status="good"), "need valid or untrusted"),
        (lambda r: r["table"].update(direction="cw"), "found direction 'cw' beside a stand that turns 'ccw'"),
        (lambda r: r["uncertainty"]["phi_deg"].update(U=-0.1), "found U -0.1"),
        (lambda r: r["covariance"]["matrix"][0].__setitem__(0, -1e-9), "negative variance"),
        (lambda r: r["stand"]["table"].update(sped=1), "sped"),
    ],
)
def test_what_is_no_calibration_is_refused(tmp_path, change, words):
    record = json.loads(json.dumps(calibration_record(calibration(), WHEN)))
    change(record)
    path = tmp_path / "c.json"
    path.write_text(json.dumps(record))
    with pytest.raises(Exception, match=words) as caught:
        read_calibration(path)
    assert type(caught.value).__name__ in ("UnreadableFile", "BadRecipe")


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", '"x"', "[" * 100_000])
def test_what_is_no_json_object_is_refused(tmp_path, text):
    (tmp_path / "c.json").write_text(text)
    with pytest.raises(UnreadableFile, match=r"c\.json"):
        read_calibration(tmp_path / "c.json")


def test_every_number_in_a_record_is_finite():
    text = json.dumps(calibration_record(calibration(), WHEN), allow_nan=False)
    assert "NaN" not in text


def test_reasons_and_checks_have_codes_and_records_of_version_1_are_read(tmp_path):
    """A reason of version 1 is a sentence; the one that a tie of the angle takes back keeps its code."""
    record = calibration_record(calibration(), WHEN)
    assert all(re.fullmatch("[a-z_]+", c["code"]) and c["text"].startswith(c["name"]) for c in record["checks"])
    old = record | {"version": 1, "status": "untrusted", "reasons": [str(UNTIED), "the shaft was dropped"]}
    old["checks"] = [{k: v for k, v in c.items() if k not in ("code", "text")} for c in record["checks"]]
    (tmp_path / "old.json").write_text(json.dumps(old))
    back = read_calibration(tmp_path / "old.json")
    assert [(r.code, str(r)) for r in back.reasons] == [
        ("angle_zero_unknown", str(UNTIED)),
        ("uncoded", "the shaft was dropped"),
    ]
    assert calibration_record(back, WHEN)["reasons"][0] == {"code": "angle_zero_unknown", "text": str(UNTIED)}


def test_a_message_is_its_sentence_wherever_it_goes():
    message = Message("dropped", "the shaft was dropped")
    for same in (message, copy.deepcopy(message), pickle.loads(pickle.dumps(message))):
        assert same == "the shaft was dropped" and same.code == "dropped"
    assert message.prefixed("scan 2: ") == "scan 2: the shaft was dropped"
    assert message.prefixed("scan 2: ").code == "dropped"
