"""What a result rests on that nobody stated, told from its budgets and its stand."""

from collections.abc import Iterable

from truestand.core.assumptions import ASSUMED, Assumption, assumptions_behind
from truestand.core.calibration import Calibration, Contribution


def assumptions_of(calibration: Calibration, budgets: Iterable[tuple[Contribution, ...]]) -> tuple[Assumption, ...]:
    """The assumptions behind a calibration and the ``budgets`` of what was measured with it."""
    lines = {line.name for budget in budgets for line in budget}
    if calibration.method == "stand":
        lines |= {line.name for u in calibration.uncertainty.values() for line in u.contributions}
        lines |= _in_the_fit(calibration)
    return assumptions_behind(lines, calibration.stand.sensor.linearity)


def _in_the_fit(calibration: Calibration) -> set[str]:
    """What the fit itself assumes, as lines of a budget would be named; its own lines don't say so."""
    sensor, artefact = calibration.stand.sensor, calibration.artefact
    names = set()
    if sensor.plane_offset_U is None:
        names.add(f"offset of the laser plane{ASSUMED}")
    if sensor.plane_tilt_U is None:
        names.add(f"tilt of the laser plane{ASSUMED}")
    if artefact is not None and any(c.coaxiality_U is None for c in artefact.cylinders[1:]):
        names.add(f"coaxiality of the steps{ASSUMED}")
    return names
