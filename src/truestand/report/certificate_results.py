"""The measuring part of a certificate: method, artefact, conditions, and every quantity with its U."""

from truestand.files.records.record import Record
from truestand.report.certificate_administration import CertificateInput, software
from truestand.report.dcc_xml import (
    Node,
    digits,
    embedded,
    identification,
    name,
    node,
    quantity,
    real,
    real_list,
    text,
)
from truestand.report.quantities import quantities

RADIAL = "radial_position_mm"
GROUPS = (
    ("sensor", "Pose of the sensor", (RADIAL, "phi_deg", "laser_plane_offset_mm", "laser_plane_tilt_deg")),
    ("shaft", "Shaft on the table",
     ("eccentricity_um", "eccentricity_direction_deg", "tilt_mrad", "tilt_direction_deg")),
)  # fmt: skip
TEMPERATURE = "temperature of the artefact"
GUM = "JCGM 100:2008", "JCGM 101:2008"
METHOD = (
    "Exact model: a scan of the artefact turning on the table is fitted with rigid transforms between sensor, table "
    "and shaft, all readings at once, with form, table speed and range errors. p = shaft_from_rotor Rz(-theta) "
    "table_from_sensor (x, 0, z). It replaces the published method (Klarák et al., Sensors 2022, 22, 5306), which "
    "subtracts a sinusoid."
)
SEVERAL = " Several scans with the shaft clamped again at known angles were put together."
NOT_NORMAL = (
    "Not normally distributed: U is the half-width that holds 95.45 % of the trials of a Monte Carlo (JCGM 101)."
)


def measurement_results(given: CertificateInput) -> Node:
    """``dcc:measurementResults``."""
    r = given.record
    product, _, release = str(r.get("software") or "").partition(" ")
    result = node(
        "dcc:measurementResult",
        name("Calibration of the stand"),
        _methods(r),
        node("dcc:usedSoftware", software(product or "truestand", release)),
        node("dcc:measuringEquipments", _artefact(r)),
        _conditions(given),
        node("dcc:results", *_results(given)),
    )
    return node("dcc:measurementResults", result)


def _methods(r: Record) -> Node:
    method = METHOD + (SEVERAL if r.get("positions") else "")
    return node(
        "dcc:usedMethods",
        node("dcc:usedMethod", name("calibration from a scan of a reference shaft"), text("dcc:description", method),
             node("dcc:reference", "truestand, docs/theory.md"), refType="basic_calibrationMethod"),
        node("dcc:usedMethod", name("expanded measurement uncertainty"),
             text("dcc:description", "U = k u with k = 2 by propagation, confirmed by Monte Carlo. Every contribution "
                  "stands in the embedded record."),
             *[node("dcc:norm", n) for n in GUM], refType="basic_uncertainty"),
    )  # fmt: skip


def _artefact(r: Record) -> Node:
    """The reference shaft with its certificate and certified diameters."""
    a: Record = r.get("artefact") or {}
    known: Record = a.get("certificate") or {}
    about = [f"{word} {known[key]}" for key, word in _CERTIFICATE.items() if known.get(key) is not None]
    numbers = []
    if a.get("serial"):
        numbers.append(identification("manufacturer", str(a["serial"]), "serial number", "basic_serialNumber"))
    if known.get("id"):
        numbers.append(identification("calibrationLaboratory", str(known["id"]), "calibration certificate"))
    diameters = [
        node("dcc:measuringEquipmentQuantity", name(f"diameter of {c['name']}"),
             real(c["diameter_mm"], "mm", c.get("diameter_U_mm")))
        for c in a.get("cylinder") or ()
    ]  # fmt: skip
    return node(
        "dcc:measuringEquipment",
        name(str(a.get("name") or "reference shaft")),
        text("dcc:description", "Reference shaft. " + (f"Its certificate: {', '.join(about)}." if about else
             "Its certificate is not stated.")),
        node("dcc:identifications", *numbers) if numbers else None,
        node("dcc:measuringEquipmentQuantities", *diameters) if diameters else None,
        refType="basic_normalUsed",
    )  # fmt: skip


_CERTIFICATE = {"id": "number", "laboratory": "of", "date": "date", "valid_until": "valid until"}


def _conditions(given: CertificateInput) -> Node:
    """The temperatures that are known, and what the budget assumes where none is."""
    p, r = given.stated.performance, given.record
    found = []
    if p.temperature_C is not None:
        value = real(p.temperature_C, "C", p.temperature_U_C)
        found.append(_condition("air temperature", "as the laboratory stated it", value))
    reference = ((r.get("artefact") or {}).get("certificate") or {}).get("temperature_C")
    if reference is not None:
        found.append(_condition("reference temperature of the artefact", "of its certificate", real(reference, "C")))
    lines = [c for u in r["uncertainty"].values() for c in u.get("contributions") or () if _thermal(c)]
    if lines:
        assumed = (
            f"Not measured: {lines[0]['name']}, standard uncertainty {digits(lines[0]['value'])} K, in the budget."
        )
        found.append(node(
            "dcc:influenceCondition", name(TEMPERATURE),
            node("dcc:data", text("dcc:text", assumed)),
        ))  # fmt: skip
    return node("dcc:influenceConditions", *found) if found else None


def _thermal(c: Record) -> bool:
    return str(c.get("name", "")).startswith(TEMPERATURE) and c.get("value") is not None


def _condition(what: str, whose: str, value: Node) -> Node:
    data = node("dcc:data", quantity(what, value))
    return node("dcc:influenceCondition", name(what), text("dcc:description", whose), data, refType="basic_temperature")


def _results(given: CertificateInput) -> list[Node]:
    r = given.record
    found = []
    for group, title, keys in GROUPS:
        known = [made for key in keys if (made := _quantity(r, group, key, given)) is not None]
        found += [node("dcc:result", name(title), node("dcc:data", *known))] if known else []
    application = (
        "The whole application of the calibration; uncertainties: the quantities above, and the embedded covariance."
    )
    poses = [
        made for group, key in (("sensor", "table_from_sensor"), ("shaft", "shaft_from_rotor"))
        for made in _pose(key, r[group][key])
    ]  # fmt: skip
    found.append(node("dcc:result", name("Transforms"), text("dcc:description", application), node("dcc:data", *poses)))
    whole = f"The calibration as truestand wrote it, byte for byte. SHA-256: {given.sha256}"
    file = embedded(given.file_name, "application/json", given.source, whole)
    found.append(node("dcc:result", name("Record"), node("dcc:data", file)))
    return found


def _quantity(r: Record, group: str, key: str, given: CertificateInput) -> Node | None:
    """One quantity with its U; None where the scan did not tell it."""
    value = r["sensor"]["table_from_sensor"][0][3] if key == RADIAL else r[group].get(key)
    u = r["uncertainty"].get(key)
    if value is None or u is None or key in (r.get("not_identifiable") or ()):
        return None
    words = {q.key: (q.name, q.meaning) for q in quantities(given.calibration)}
    title, meaning = words.get(key, ("Radial position", "of the sensor's origin, from the rotation axis"))
    normal = u["U"] != u.get("U_monte_carlo")
    meaning = meaning if normal else f"{meaning}. {NOT_NORMAL}"
    known = real(value, key.rsplit("_", 1)[-1], u["U"], u["k"], normal)
    return quantity(title, known, meaning, id=key, refType="basic_measuredValue")


def _pose(key: str, matrix: list[list[float]]) -> list[Node]:
    rotation = [v for row in matrix[:3] for v in row[:3]]
    return [
        quantity(f"{key}, rotation", real_list(rotation, "1"), "3 x 3, row by row", id=f"{key}_rotation"),
        quantity(f"{key}, translation", real_list([row[3] for row in matrix[:3]], "mm"), id=f"{key}_translation"),
    ]
