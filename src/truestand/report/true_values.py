"""True values of a virtual part, from its truth record, for the lines of an inspection and in their units."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from truestand.core.inspection import Characteristic, Flank, Inspection

if TYPE_CHECKING:
    from truestand.gear.inspect import GearEvidence

Key = tuple[str, str | None]
"""Name, and flank or section."""
FLANKS: tuple[Flank, Flank] = ("left", "right")


def true_values(inspection: Inspection, truth: Mapping[str, Any] | None) -> dict[Key, float]:
    """True values of whole-part lines: um for deviations, mm for sizes. Empty without a truth of this kind of part."""
    part = dict((truth or {}).get("part") or {})
    if part.get("kind") != inspection.kind:
        return {}
    found = _turned(part) if inspection.kind == "turned" else _gear(part, inspection.evidence)
    return {key: float(value) for key, value in found.items() if isinstance(value, int | float)}


def true_value(values: Mapping[Key, float], c: Characteristic) -> float | None:
    """The true value of one line; None where it is not known."""
    return values.get((c.name, c.section or c.flank))


def _gear(part: dict[str, Any], evidence: "GearEvidence | None") -> dict[Key, Any]:
    profile, helix = dict(part.get("profile") or {}), dict(part.get("helix") or {})
    found: dict[Key, Any] = {("F_r", None): part.get("F_r_um")}
    for flank in FLANKS:
        for name in ("f_p", "F_p"):
            found[name, flank] = part.get(f"{name}_{flank}_um")
        found["f_Halpha", flank] = profile.get(f"f_Halpha_{flank}_um")
        found["f_Hbeta", flank] = helix.get(f"f_Hbeta_{flank}_um")
    thickness = part.get("thickness_um")
    if thickness is not None and evidence is not None:
        found["s", None] = evidence.nominal.thickness + thickness / 1000.0
    return found


def _turned(part: dict[str, Any]) -> dict[Key, Any]:
    found: dict[Key, Any] = {}
    for section in part.get("sections") or ():
        found["d", section["name"]] = section.get("diameter_mm")
        found["roundness", section["name"]] = section.get("roundness_um")
    return found
