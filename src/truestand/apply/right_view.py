"""A scan that is called that of one view, and was taken by another: found by where the shaft stands in it."""

from math import hypot

from truestand.apply.witness import Witness, witness
from truestand.core.calibration import Calibration
from truestand.core.errors import BadRecipe
from truestand.core.scan import Scan

MOST_OFF_MM = 0.01
"""By which sensor and shaft may stand otherwise for a scan to be of a view."""


def demand_own_view(scan: Scan, calibration: Calibration, own: Witness | None) -> None:
    """Refuse a scan whose shaft does not stand where its own view has it, but where another view has it.

    ``own``: what the shaft in view says by the scan's own view; nothing is told where no view shows the shaft.

    Raises:
        BadRecipe: the scan was taken by another view; the message names it.
    """
    if len(calibration.views) < 2 or _as_calibrated(own, scan, calibration.for_scan(scan)):
        return
    others = [view for view in calibration.views if view.name != scan.view]
    right = [view.name for view in others if _as_calibrated(witness(scan, view), scan, view)]
    if right:
        raise taken_by_another(scan.view, right)


def taken_by_another(said: str, right: list[str]) -> BadRecipe:
    """The error for a scan that is ``said`` to be of one view and can be of the ``right`` ones only."""
    names = " or ".join(map(repr, right))
    return BadRecipe(
        f"found a scan of view {said!r} that fits where {names} stands, need each scan given to the view that took it; "
        "check the order of the scans, --view, and which sensor is wired to which name"
    )


def _as_calibrated(band: Witness | None, scan: Scan, view: Calibration) -> bool:
    """Whether sensor and shaft stand in the scan as a view's calibration has them."""
    if band is None:
        return False
    if scan.angle_zero == view.angle_zero != "unknown":
        shaft = hypot(*band.eccentricity_change) - band.change_U
    else:
        shaft = abs(band.eccentricity_size) - band.eccentricity_U
    return max(abs(band.radial) - band.radial_U, shaft) <= MOST_OFF_MM
