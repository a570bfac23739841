"""The table's angle without an encoder: what several turns say about it.

Each flank comes by once a turn. If the table turns unevenly, it comes by at another angle each time; these differences
tell the error of the angle over time, all of it that doesn't repeat every turn. What does repeat looks exactly like
pitch deviations: it needs an encoder, a table of its errors, or the part clamped again, and stays in the budget.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truestand.core.calibration import Calibration
from truestand.core.scan import Scan
from truestand.core.surface import table_angle
from truestand.gear.flanks import Flanks
from truestand.gear.geometry import SIGMA, Involute
from truestand.gear.grid import CLIP, medians

Array = NDArray[np.float64]

LEAST_TURNS = 1.2
WHOLE = 0.7
"""Share of the usual number of points that a flank's pass must have: at the scan's ends some are cut off."""
KNOTS_PER_TOOTH = 1.0
SMOOTHING = 1e-3
"""Weight of the bend from knot to knot against the passes: it decides only what they leave open."""
ROLLS = 40
"""Stretches of roll length in which passes are compared."""
NOTICEABLE = 1e-3
"""mm: passes that agree this well need no correction."""


def steadied(
    flanks: Flanks, scan: Scan, calibration: Calibration, nominal: Involute
) -> tuple[Scan, Calibration, float] | None:
    """Scan and calibration with a table angle freed of what does not repeat every turn, and how much (mm, rms).

    None where the angle was measured, where no flank came by twice, or where there is nothing to be freed of.
    """
    if scan.angle_source not in ("index", "time") or scan.revolutions < LEAST_TURNS:
        return None
    angle = table_angle(scan, calibration)
    passes = _passes(_agreeing(flanks, nominal), angle, nominal)
    if passes is None:
        return None
    which, time, place = passes
    spread = _disagreement(which, place)
    if spread < NOTICEABLE:
        return None
    error = _error(which, time, place, scan.profiles, nominal, scan.revolutions)
    corrected = angle + error - error.mean()
    return replace(scan, angle=corrected), replace(calibration, speed_factor=1.0), spread


def _agreeing(flanks: Flanks, nominal: Involute) -> Flanks:
    """Without the points that lie off their flank's own shape: strays, which are few in the gate but far off."""
    place = flanks.which.astype(np.int64) * ROLLS + _roll_bin(flanks, nominal)
    median, _ = medians(place, flanks.delta, 2 * nominal.gear.teeth * ROLLS)
    off = flanks.delta - median[place]
    kept = np.abs(off) < CLIP * 1.4826 * float(np.median(np.abs(off)))
    return Flanks(
        flanks.delta[kept], flanks.roll[kept], flanks.height[kept], flanks.which[kept], flanks.profile[kept],
        flanks.index[kept], flanks.turned,
    )  # fmt: skip


def _roll_bin(flanks: Flanks, nominal: Involute) -> NDArray[np.int64]:
    share = (flanks.roll - nominal.control_roll) / nominal.control_length
    return np.clip((share * ROLLS).astype(np.int64), 0, ROLLS - 1)


def _passes(flanks: Flanks, angle: Array, nominal: Involute) -> tuple[NDArray[np.int64], Array, Array] | None:
    """For each pass of each flank: which flank, when (profile), and its place sigma delta along the base circle, mm."""
    teeth = nominal.gear.teeth
    side = np.where(flanks.which < teeth, 0, 1)
    around = flanks.turned + (flanks.which % teeth) * nominal.gear.pitch
    turn = np.rint((angle[flanks.profile] + around) / (2 * np.pi)).astype(np.int64)
    turn -= turn.min()
    turns = int(turn.max()) + 1
    key = flanks.which.astype(np.int64) * turns + turn
    size = 2 * teeth * turns
    value = SIGMA[side] * _freed(flanks, nominal)
    count = np.bincount(key, minlength=size)
    with np.errstate(invalid="ignore", divide="ignore"):
        place, time = (np.bincount(key, v, minlength=size) / count for v in (value, flanks.profile))
    usual = np.median(count[count > 0]) if (count > 0).any() else 0.0
    kept = np.flatnonzero(count > WHOLE * usual)
    which = kept // turns
    if np.unique(which).size == which.size:
        return None  # nothing came by twice
    return which, time[kept], place[kept]


def _freed(flanks: Flanks, nominal: Involute) -> Array:
    """delta without the mean shape over the roll length: passes that see other parts of a flank compare as well."""
    at = flanks.which.astype(np.int64) * ROLLS + _roll_bin(flanks, nominal)
    size = 2 * nominal.gear.teeth * ROLLS
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(at, flanks.delta, minlength=size) / np.bincount(at, minlength=size)
    shape = mean.reshape(-1, ROLLS)
    own = np.nan_to_num(shape).sum(axis=1) / np.maximum(np.isfinite(shape).sum(axis=1), 1)
    return np.asarray(flanks.delta - mean[at] + own[flanks.which])


def _disagreement(which: NDArray[np.int64], place: Array) -> float:
    """rms (mm) of the passes about the mean of their flank, degrees of freedom counted."""
    number = np.bincount(which)
    mean = np.bincount(which, place) / np.maximum(number, 1)
    free = max(which.size - int((number > 0).sum()), 1)
    return float(np.sqrt(np.square(place - mean[which]).sum() / free))


def _error(
    which: NDArray[np.int64], time: Array, place: Array, profiles: int, nominal: Involute, turns: float
) -> Array:
    """By how much (rad, (profiles,)) the part stood farther round, ccw, than its table angle said: a smooth curve over
    time and one place a flank, by least squares.
    """
    knots = max(8, round(KNOTS_PER_TOOTH * nominal.gear.teeth * turns))
    at = time / (profiles - 1) * (knots - 1)
    left = np.clip(at.astype(np.intp), 0, knots - 2)
    share = at - left
    rows = np.arange(which.size)
    flanks, flank = np.unique(which, return_inverse=True)
    design = np.zeros((which.size, knots + flanks.size))
    design[rows, left], design[rows, left + 1] = 1 - share, share
    design[rows, knots + flank] = 1.0
    bend = np.zeros((knots - 2, knots + flanks.size))
    for i in range(knots - 2):
        bend[i, i : i + 3] = 1.0, -2.0, 1.0
    matrix = np.concatenate([design, SMOOTHING * bend])
    found = np.linalg.lstsq(matrix, np.concatenate([place, np.zeros(knots - 2)]), rcond=None)[0][:knots]
    curve = np.interp(np.arange(profiles) / (profiles - 1) * (knots - 1), np.arange(knots), found)
    return np.asarray(curve / nominal.base_radius)
