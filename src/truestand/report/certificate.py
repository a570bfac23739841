"""The calibration as a Digital Calibration Certificate (DCC 3.3, D-SI 2.2). It prints the record, it computes nothing.

What the standard requires and nobody stated is never made up. With a laboratory it is asked for by name; without one
the certificate is a draft, says so, and has ``not stated`` in its place.
"""

from datetime import date
from typing import Any

from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.files.records.record import Record, texts_of
from truestand.report.certificate_administration import CertificateInput, administrative_data
from truestand.report.certificate_results import measurement_results
from truestand.report.dcc_xml import ROOT, SCHEMA, VERSION, XSI, node, printed
from truestand.report.quantities import quantities

AGREEMENT = 1e-9
"""How far, of 1 or of the value, a reported number may lie from what the record's transforms say: its last digits."""


def refusals(record: Record) -> list[str]:
    """Why there can be no certificate of this calibration; empty where there can."""
    if record.get("status") == "untrusted" or record.get("reasons"):
        return texts_of(record) or ["the record says untrusted and gives no reason"]
    if record.get("method") == "paper":
        return [
            "the published method states no uncertainty, and no certificate may leave it out "
            "(ISO/IEC 17025:2017, 7.8.4.1); calibrate with --method stand"
        ]
    if not record.get("uncertainty"):
        return ["the record has no uncertainties, and no certificate may leave them out; calibrate again"]
    return []


def missing_statements(given: CertificateInput) -> list[str]:
    """What the standard requires and neither recipe nor record states, by the name of its key."""
    s = given.stated
    needed: dict[str, dict[str, Any]] = {
        "[laboratory]": {"name": s.laboratory.name, "city": s.laboratory.city, "country": s.laboratory.country},
        "[[responsible]]": {"name": s.responsible or None},
        "[customer]": {"name": s.customer.name, "city": s.customer.city},
        "[stand]": {"serial": s.stand.serial},
        "[performance]": {"place": s.performance.place},
    }
    found = [
        f"{table} {', '.join(keys)} (laboratory.toml)"
        for table, stated in needed.items()
        if (keys := [key for key, value in stated.items() if value is None])
    ]
    return found + missing_traceability(given)


def missing_traceability(given: CertificateInput) -> list[str]:
    """What of the artefact's certificate is not stated, or no longer holds."""
    known = (given.record.get("artefact") or {}).get("certificate") or {}
    keys = [key for key in ("id", "laboratory") if not known.get(key)]
    found = [f"[certificate] {', '.join(keys)} (shaft.toml)"] if keys else []
    until = known.get("valid_until")
    if until and not _holds(str(until), given.performance_dates[1]):
        found.append(f"[certificate] valid on {given.performance_dates[1]} (shaft.toml has valid_until {until})")
    return found


def _holds(until: str, day: date) -> bool:
    """Whether that date is not past; a text that is no date says nothing."""
    try:
        return date.fromisoformat(until[:10]) >= day
    except ValueError:
        return False


def certificate_xml(given: CertificateInput) -> bytes:
    """The XML, the same for the same input; a calibration that ``refusals`` lets pass.

    Raises:
        BadRecipe: a laboratory issues it, and something that the standard requires is not stated.
        UnreadableFile: the record contradicts itself, or has no date.
    """
    _refuse_contradictions(given)
    missing = missing_statements(given)
    if missing and not given.draft:
        raise BadRecipe(f"the certificate lacks {'; '.join(missing)}: state them, see docs/certificate.md")
    root = node(
        ROOT, administrative_data(given, missing, missing_traceability(given)),
        measurement_results(given),
        schemaVersion=VERSION,
    )  # fmt: skip
    root.set(f"{{{XSI}}}schemaLocation", SCHEMA)
    return printed(root)


def _refuse_contradictions(given: CertificateInput) -> None:
    """A number of the record that is not that of its transforms was never measured."""
    groups = {**(given.record.get("sensor") or {}), **(given.record.get("shaft") or {})}
    for q in quantities(given.calibration):
        stated = groups.get(q.key)
        if stated is None or q.value is None:
            continue
        if not isinstance(stated, int | float) or not abs(stated - q.value) <= AGREEMENT * max(1.0, abs(q.value)):
            raise UnreadableFile(
                f"{given.file_name}: found {q.key} {str(stated)[:40]}, but its transforms say {q.value:g}; "
                "the record was changed by hand, calibrate again"
            )
