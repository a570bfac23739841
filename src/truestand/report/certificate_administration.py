"""The administrative part of a certificate: software, number and dates, what was calibrated, by whom, for whom."""

from truestand._version import __version__
from truestand.files.recipes.laboratory import ContactRecipe
from truestand.report.certificate_issue import Issue
from truestand.report.dcc_xml import LANGUAGE, NOT_STATED, Node, identification, name, node, plain, text

NO_COUNTRY = "ZZ"
"""ISO 3166-1 leaves it to users; CLDR reads it as unknown."""
MEANT = {
    "height": "height zero rests on the edge of the larger step, whose face is hidden from this side",
    "eccentricity_direction_deg": "a shaft that is nearly centred has no direction of eccentricity",
    "tilt_direction_deg": "a shaft that stands nearly straight has no direction of tilt",
    "laser_plane_offset_mm": "this scan does not show the laser plane; its doubt is carried on",
    "laser_plane_tilt_deg": "this scan does not show the laser plane; its doubt is carried on",
}


def administrative_data(issue: Issue, missing: list[str], untraced: list[str]) -> Node:
    """``dcc:administrativeData``; ``missing``: what nobody stated, ``untraced``: what of it breaks traceability."""
    s = issue.stated
    return node(
        "dcc:administrativeData",
        node("dcc:dccSoftware", software("truestand", __version__)),
        _core_data(issue),
        _items(issue),
        node("dcc:calibrationLaboratory", plain("dcc:calibrationLaboratoryCode", s.laboratory.code),
             _contact("dcc:contact", s.laboratory)),
        _responsible(issue),
        _contact("dcc:customer", s.customer),
        _statements(issue, missing, untraced),
    )  # fmt: skip


def software(product: str, release: str) -> Node:
    """``dcc:software``."""
    return node(
        "dcc:software", name(product), node("dcc:release", release or NOT_STATED), node("dcc:type", "application")
    )


def _core_data(issue: Issue) -> Node:
    s, (begin, end) = issue.stated, issue.performed
    scan = (issue.record.get("scan") or {}).get("sha256")
    known = [identification("other", issue.sha256, f"SHA-256 of {issue.file_name}")]
    known += [identification("other", scan, "SHA-256 of the scan")] if scan else []
    return node(
        "dcc:coreData",
        node("dcc:countryCodeISO3166_1", s.laboratory.country or NO_COUNTRY),
        node("dcc:usedLangCodeISO639_1", LANGUAGE),
        node("dcc:mandatoryLangCodeISO639_1", LANGUAGE),
        plain("dcc:uniqueIdentifier", issue.identifier),
        node("dcc:identifications", *known),
        node("dcc:beginPerformanceDate", begin.isoformat()),
        node("dcc:endPerformanceDate", end.isoformat()),
        node("dcc:performanceLocation", s.performance.place or "other"),
    )


def _items(issue: Issue) -> Node:
    s = issue.stated.stand
    sensors = (issue.record.get("stand") or {}).get("sensor") or [issue.record.get("sensor") or {}]
    parts = [_sensor(sensor) for sensor in sensors]
    stand = node(
        "dcc:item",
        name(s.name or "rotary laser inspection stand"),
        None if s.manufacturer is None else node("dcc:manufacturer", name(s.manufacturer)),
        plain("dcc:model", s.model),
        node("dcc:identifications", identification("owner", s.serial, "serial number", "basic_serialNumber")),
        node("dcc:subItems", *parts),
        id="stand",
    )
    return node("dcc:items", stand)


def _sensor(sensor: dict[str, object]) -> Node:
    """A sensor by its serial number, and by its name on the stand."""
    serial, called = sensor.get("serial"), str(sensor.get("name") or "sensor")
    known = [identification("manufacturer", str(serial), "serial number", "basic_serialNumber")] if serial else []
    known.append(identification("owner", called, "name on the stand"))
    return node("dcc:item", name("laser line sensor"), node("dcc:identifications", *known))


def _contact(tag: str, c: ContactRecipe) -> Node:
    parts = {
        "city": c.city, "countryCode": c.country, "postCode": c.post_code, "street": c.street, "streetNo": c.street_no,
    }  # fmt: skip
    told = [plain(f"dcc:{part}", value) for part, value in parts.items() if value]
    return node(
        tag, name(c.name or NOT_STATED), plain("dcc:eMail", c.e_mail), plain("dcc:phone", c.phone),
        node("dcc:location", *(told or [node("dcc:city", NOT_STATED)])),
    )  # fmt: skip


def _responsible(issue: Issue) -> Node:
    people = [
        node(
            "dcc:respPerson", node("dcc:person", name(p.name)), plain("dcc:role", p.role),
            node("dcc:mainSigner", "true") if p.signs else None,
        )
        for p in issue.stated.responsible
    ]  # fmt: skip
    nobody = node("dcc:respPerson", node("dcc:person", name(NOT_STATED)))
    return node("dcc:respPersons", *(people or [nobody]))


def _statements(issue: Issue, missing: list[str], untraced: list[str]) -> Node:
    """What holds for the whole certificate, what is most limiting first."""
    found = []
    if issue.draft:
        found.append(_statement("draft", f"No laboratory issues this. Nobody stated: {'; '.join(missing)}."))
    for unseen in issue.record.get("not_identifiable") or ():
        found.append(_statement(f"not identifiable: {unseen}", _why(str(unseen))))
    found.append(_traceability(issue, untraced))
    until = issue.record.get("valid_until")
    if until:
        found.append(_statement("validity", f"The artefact's certificate carries the calibration until {until}."))
    found.append(_statement(
        "signature", "truestand gives the content. It stands for nobody until a laboratory has checked and signed it.",
    ))  # fmt: skip
    return node("dcc:statements", *found)


def _why(unseen: str) -> str:
    meaning = MEANT.get(unseen, "this scan says too little about it")
    return f"{meaning[0].upper()}{meaning[1:]}. No value is stated rather than a guessed one."


def _statement(title: str, words: str) -> Node:
    return node("dcc:statement", name(title), text("dcc:declaration", words))


def _traceability(issue: Issue, untraced: list[str]) -> Node:
    known = (issue.record.get("artefact") or {}).get("certificate") or {}
    words = f"Lengths are traced to the artefact's certificate {known.get('id')} of {known.get('laboratory')}."
    words = f"Not shown; nobody stated: {'; '.join(untraced)}." if untraced else words
    return node(
        "dcc:statement", name("metrological traceability"), node("dcc:traceable", "false" if untraced else "true"),
        text("dcc:declaration", words),
    )  # fmt: skip
