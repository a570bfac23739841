"""Where each of several sensors stands, as texts for tables."""

from collections.abc import Iterator, Sequence

from truestand.core.calibration import Calibration
from truestand.core.units import degrees
from truestand.report.notation import with_u

COLUMNS = ("azimuth, °", "height, mm", "phi, °", "plane offset, mm", "plane tilt, °")


def view_rows(views: Sequence[Calibration]) -> Iterator[tuple[str, ...]]:
    """Each view's name and, in the frame of the first, its ``COLUMNS`` with U (k = 2)."""
    for c in views:
        tilt = None if c.plane_tilt is None else degrees(c.plane_tilt)
        first = c is views[0]
        yield (
            c.name,
            "0" if first else _with_u(c, "azimuth_deg", degrees(c.azimuth)),
            "0" if first else _with_u(c, "height_mm", c.height),
            _with_u(c, "phi_deg", degrees(c.phi)),
            _with_u(c, "laser_plane_offset_mm", c.plane_offset),
            _with_u(c, "laser_plane_tilt_deg", tilt),
        )


def _with_u(c: Calibration, key: str, value: float | None) -> str:
    if value is None or key in c.not_identifiable:
        return "not identifiable"
    return with_u(value, c.uncertainty[key].U)
