"""The quantities of a calibration in the order and the wording of the report, with the record's units."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees
from typing import Any

from truestand.core.calibration import Calibration, Contribution
from truestand.core.units import mrad, um


@dataclass(frozen=True, slots=True)
class Quantity:
    """One row: what the published method, the exact model and the truth say."""

    key: str
    name: str
    unit: str
    meaning: str
    value: float | None
    U: float | None
    paper: float | None
    truth: float | None

    def minus_truth(self, value: float | None) -> float | None:
        """A value less the true one, directions the short way round; None where either is not known."""
        if value is None or self.truth is None:
            return None
        difference = value - self.truth
        return (difference + 180.0) % 360.0 - 180.0 if self.unit == "°" else difference


QUANTITIES = (
    ("phi_deg", "Angle φ", "°", "sensor", "between the rotation axis and the sensor's z"),
    ("eccentricity_um", "Eccentricity", "µm", "shaft", "offset of shaft axis from rotation axis, at the shoulder"),
    ("eccentricity_direction_deg", "Eccentricity, direction", "°", "shaft", "its azimuth on the table at angle 0"),
    ("tilt_mrad", "Shaft tilt", "mrad", "shaft", "angle between shaft axis and rotation axis"),
    ("tilt_direction_deg", "Shaft tilt, direction", "°", "shaft", "azimuth towards which the shaft leans going up"),
    ("laser_plane_offset_mm", "Laser plane, offset", "mm", "sensor", "how far the laser plane misses the axis"),
    ("laser_plane_tilt_deg", "Laser plane, tilt", "°", "sensor", "how far it is from parallel to the axis"),
)
"""Key, name, unit, the record's table, what it means."""


def quantities(
    calibration: Calibration, paper: Calibration | None = None, truth: Mapping[str, Any] | None = None
) -> list[Quantity]:
    """All rows of the comparison table."""
    exact = _values(calibration) if calibration.method == "stand" else {}
    published = _values(paper or calibration) if paper is not None or calibration.method == "paper" else {}
    rows = []
    for key, name, unit, group, meaning in QUANTITIES:
        uncertainty = calibration.uncertainty.get(key)
        known = None if truth is None else dict(truth.get(group) or {}).get(key)
        rows.append(
            Quantity(
                key,
                name,
                unit,
                meaning,
                exact.get(key),
                None if uncertainty is None else uncertainty.U,
                published.get(key),
                known if isinstance(known, int | float) else None,
            )
        )
    return rows


def main_budgets(calibration: Calibration) -> dict[str, tuple[Contribution, ...]]:
    """The budgets of a calibration's main quantities by their names, but of directions that the scan did not tell."""
    known = _values(calibration)
    return {
        name: calibration.uncertainty[key].contributions
        for key, name, *_ in QUANTITIES
        if key in calibration.uncertainty and known[key] is not None
    }


def _values(c: Calibration) -> dict[str, float | None]:
    return {
        "phi_deg": degrees(c.phi),
        "eccentricity_um": um(c.eccentricity),
        "eccentricity_direction_deg": None if c.eccentricity_direction is None else degrees(c.eccentricity_direction),
        "tilt_mrad": None if c.tilt is None else mrad(c.tilt),
        "tilt_direction_deg": None if c.tilt_direction is None else degrees(c.tilt_direction),
        "laser_plane_offset_mm": c.plane_offset,
        "laser_plane_tilt_deg": None if c.plane_tilt is None else degrees(c.plane_tilt),
    }
