"""The administrative part of a certificate: software, number and dates, what was calibrated, by whom, for whom."""

from dataclasses import dataclass
from datetime import date
from hashlib import sha256

from truestand._version import __version__
from truestand.core.calibration import Calibration
from truestand.core.errors import UnreadableFile
from truestand.files.recipes.laboratory import ContactRecipe, LaboratoryRecipe
from truestand.files.records.record import Record
from truestand.report.dcc_xml import LANGUAGE, NOT_STATED, Node, identification, name, node, plain, text

NO_COUNTRY = "ZZ"
"""ISO 3166-1 leaves it to users; CLDR reads it as unknown."""
WHY_NOT_IDENTIFIABLE = {
    "height": "height zero rests on the edge of the larger step, whose face is hidden from this side",
    "eccentricity_direction_deg": "a shaft that is nearly centred has no direction of eccentricity",
    "tilt_direction_deg": "a shaft that stands nearly straight has no direction of tilt",
    "laser_plane_offset_mm": "this scan does not show the laser plane; its doubt is carried on",
    "laser_plane_tilt_deg": "this scan does not show the laser plane; its doubt is carried on",
}


@dataclass(frozen=True, slots=True)
class CertificateInput:
    """What a certificate is made of: a record, its meaning and what the laboratory stated."""

    record: Record
    calibration: Calibration
    """What the record means: held against what it says."""
    source: bytes
    """The record's file, which the certificate carries."""
    file_name: str
    laboratory: LaboratoryRecipe | None = None
    number: str | None = None
    """The certificate's; None: one out of date and content."""

    @property
    def stated(self) -> LaboratoryRecipe:
        """What the laboratory stated, be it nothing."""
        return self.laboratory or LaboratoryRecipe()

    @property
    def draft(self) -> bool:
        """Whether no laboratory issues it."""
        return self.laboratory is None

    @property
    def sha256(self) -> str:
        """Of the record's file."""
        return sha256(self.source).hexdigest()

    @property
    def performance_dates(self) -> tuple[date, date]:
        """First and last day: as the laboratory stated them, otherwise the day of the record.

        Raises:
            UnreadableFile: neither is there.
        """
        p, created = self.stated.performance, self.record.get("created")
        begin, end = p.begin or p.end, p.end or p.begin
        if begin is not None and end is not None:
            return begin, end
        try:
            day = date.fromisoformat(str(created)[:10])
        except ValueError:
            raise UnreadableFile(
                f"{self.file_name}: found created {created!r}, need the day of the calibration; calibrate again"
            ) from None
        return day, day

    @property
    def identifier(self) -> str:
        """The certificate's number."""
        given = " ".join((self.number or "").split())
        return given or f"truestand-{self.performance_dates[1]}-{self.sha256[:16]}"


def administrative_data(given: CertificateInput, missing: list[str], untraced: list[str]) -> Node:
    """``dcc:administrativeData``; ``missing``: what nobody stated, ``untraced``: what of it breaks traceability."""
    s = given.stated
    return node(
        "dcc:administrativeData",
        node("dcc:dccSoftware", software("truestand", __version__)),
        _core_data(given),
        _items(given),
        node("dcc:calibrationLaboratory", plain("dcc:calibrationLaboratoryCode", s.laboratory.code),
             _contact("dcc:contact", s.laboratory)),
        _responsible(given),
        _contact("dcc:customer", s.customer),
        _statements(given, missing, untraced),
    )  # fmt: skip


def software(product: str, release: str) -> Node:
    """``dcc:software``."""
    return node(
        "dcc:software", name(product), node("dcc:release", release or NOT_STATED), node("dcc:type", "application")
    )


def _core_data(given: CertificateInput) -> Node:
    s, (begin, end) = given.stated, given.performance_dates
    scan = (given.record.get("scan") or {}).get("sha256")
    known = [identification("other", given.sha256, f"SHA-256 of {given.file_name}")]
    known += [identification("other", scan, "SHA-256 of the scan")] if scan else []
    return node(
        "dcc:coreData",
        node("dcc:countryCodeISO3166_1", s.laboratory.country or NO_COUNTRY),
        node("dcc:usedLangCodeISO639_1", LANGUAGE),
        node("dcc:mandatoryLangCodeISO639_1", LANGUAGE),
        plain("dcc:uniqueIdentifier", given.identifier),
        node("dcc:identifications", *known),
        node("dcc:beginPerformanceDate", begin.isoformat()),
        node("dcc:endPerformanceDate", end.isoformat()),
        node("dcc:performanceLocation", s.performance.place or "other"),
    )


def _items(given: CertificateInput) -> Node:
    s = given.stated.stand
    sensors = (given.record.get("stand") or {}).get("sensor") or [given.record.get("sensor") or {}]
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
    location = [plain(f"dcc:{part}", value) for part, value in parts.items() if value]
    return node(
        tag, name(c.name or NOT_STATED), plain("dcc:eMail", c.e_mail), plain("dcc:phone", c.phone),
        node("dcc:location", *(location or [node("dcc:city", NOT_STATED)])),
    )  # fmt: skip


def _responsible(given: CertificateInput) -> Node:
    people = [
        node(
            "dcc:respPerson", node("dcc:person", name(p.name)), plain("dcc:role", p.role),
            node("dcc:mainSigner", "true") if p.signs else None,
        )
        for p in given.stated.responsible
    ]  # fmt: skip
    nobody = node("dcc:respPerson", node("dcc:person", name(NOT_STATED)))
    return node("dcc:respPersons", *(people or [nobody]))


def _statements(given: CertificateInput, missing: list[str], untraced: list[str]) -> Node:
    """What holds for the whole certificate, what is most limiting first."""
    found = []
    if given.draft:
        found.append(_statement("draft", f"No laboratory issues this. Nobody stated: {'; '.join(missing)}."))
    for quantity in given.record.get("not_identifiable") or ():
        found.append(_statement(f"not identifiable: {quantity}", _why(str(quantity))))
    found.append(_traceability(given, untraced))
    until = given.record.get("valid_until")
    if until:
        found.append(_statement("validity", f"The artefact's certificate carries the calibration until {until}."))
    found.append(_statement(
        "signature", "truestand gives the content. It stands for nobody until a laboratory has checked and signed it.",
    ))  # fmt: skip
    return node("dcc:statements", *found)


def _why(quantity: str) -> str:
    meaning = WHY_NOT_IDENTIFIABLE.get(quantity, "this scan says too little about it")
    return f"{meaning[0].upper()}{meaning[1:]}. No value is stated rather than a guessed one."


def _statement(title: str, words: str) -> Node:
    return node("dcc:statement", name(title), text("dcc:declaration", words))


def _traceability(given: CertificateInput, untraced: list[str]) -> Node:
    known = (given.record.get("artefact") or {}).get("certificate") or {}
    words = f"Lengths are traced to the artefact's certificate {known.get('id')} of {known.get('laboratory')}."
    words = f"Not shown; nobody stated: {'; '.join(untraced)}." if untraced else words
    return node(
        "dcc:statement", name("metrological traceability"), node("dcc:traceable", "false" if untraced else "true"),
        text("dcc:declaration", words),
    )  # fmt: skip
