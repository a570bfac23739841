"""What the gear says about the stand: slopes that all teeth share, alike or opposite on both sides.

A lateral offset h of the laser plane reads +-h cos(alpha_y) on the flanks, a radial zero off by dr reads
dr sin(alpha_y), a skew eps of the laser line tilts the helices by +-eps b cos(alpha). A gear can have such slopes of
its own, so these are remarks: they tell which number of the calibration to look at first.
"""

from math import cos

import numpy as np
from numpy.typing import NDArray

from truestand.gear.evaluate import Measures, slope_length
from truestand.gear.geometry import Involute

Array = NDArray[np.float64]

NOTICEABLE = 0.003
"""mm of mean slope below which nothing is said."""


def diagnosis(m: Measures, nominal: Involute) -> tuple[str, ...]:
    """Remarks on mean slopes; none where a side was not seen."""
    means = {n: [_mean(side) for side in getattr(m, n)] for n in ("f_Halpha", "f_Hbeta")}
    if not all(np.isfinite(v).all() for v in means.values()):
        return ()
    (left, right), (lower, upper) = means["f_Halpha"], means["f_Hbeta"]
    found = []
    opposite, alike, skew = (left - right) / 2, (left + right) / 2, (lower - upper) / 2
    if abs(opposite) > NOTICEABLE:
        h = abs(opposite / _profile_slope(nominal, np.cos))
        found.append(
            f"profile slopes are opposite on both sides by {1000 * abs(opposite):.1f} um, as with a laser plane "
            f"{1000 * h:.0f} um beside where the calibration has it"
        )
    if abs(alike) > NOTICEABLE:
        dr = alike / _profile_slope(nominal, np.sin)
        found.append(
            f"profile slopes are alike on both sides by {1000 * alike:.1f} um, as with a radial zero "
            f"{1000 * dr:.0f} um off"
        )
    if abs(skew) > NOTICEABLE:
        eps = abs(skew) / (slope_length(nominal, along_profile=False) * cos(nominal.transverse_pressure))
        found.append(
            f"helix slopes are opposite on both sides by {1000 * abs(skew):.1f} um, as with a laser line skew by "
            f"{1000 * eps:.2f} mrad"
        )
    return tuple(f"{f}; or the gear is made so" for f in found)


def _mean(values: Array) -> float:
    seen = values[np.isfinite(values)]
    return float(seen.mean()) if seen.size else float("nan")


def _profile_slope(nominal: Involute, wave: np.ufunc) -> float:
    """Slope deviation that 1 mm of wave(alpha_y) reads."""
    roll = np.linspace(*nominal.profile_range, 100)
    line = np.polyfit(roll, wave(np.arctan(roll / nominal.base_radius)), 1)
    return float(line[0]) * slope_length(nominal, along_profile=True)
