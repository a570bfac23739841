"""Points of a sensor that are stuck: they report one range, whatever is there.

A bright spot of the sensor's image is taken for the laser's line where that is faint. A surface that stands still shows
its range to one point, too, but goes on at the points beside it. On a gear, a stuck point is a hole in every flank.
"""

import numpy as np

from truestand.core.arrays import Array, Ints
from truestand.core.message import Message

STEP = 0.02
"""mm of range in which a stuck point stays."""
SAMPLE = 1000
"""Profiles, spread over the scan, that tell,"""
LEAST_SHARE = 0.02
"""and share of them at one range from which a point may be stuck there,"""
OFTEN = 5.0
"""where it has no range beside that one so often, nor have the points beside it on any line through it: an edge that
moves to and fro, on an eccentric shaft, stays longest where it turns back."""
GROUP = 3
"""Points beside each other that may be stuck on one line: what more of them see is a surface."""
STEEPEST, STEEP = 100, 40
"""Steps from point to point of such a line at most, and beyond which it is steep."""
BENDS = 1, 4
"""Steps by which a gentle and a steep line may bend from point to point: the steeper rays meet a face, the more their
ranges bend.
"""
MOST_POINTS = 0.1
"""Share of the points that may be stuck: where more look like that, the sensor counts in coarse steps."""
MOSTLY, SELDOM = 0.5, 0.02
"""Share of the profiles at a point's most frequent range in which those beside it must see one nearer and one farther;
and, as a share of them, profiles that may lie on the other side of it where a cylinder ends at a face.
"""
CLOSE, LEAST_CLOSE = 0.1, 3
"""mm to which its other ranges come up there, and number of them that do."""
FARTHEST = 100.0
"""mm from the middle of all ranges that are looked at."""


def without_stuck(z: Array) -> tuple[Array, tuple[Message, ...]]:
    """Ranges ``z`` (N, M) mm with those at which points are stuck marked as not seen, and a remark on each of these
    points; the same array where there are none.
    """
    found = _stuck(z[:: max(1, z.shape[0] // SAMPLE)])
    if not found:
        return z, ()
    out, stuck = z.copy(), []
    for point, at in found:
        there = np.abs(out[:, point] - at) < STEP
        if there.mean() < LEAST_SHARE / 2:
            continue  # left out already, as the step next to it
        out[there, point] = np.nan
        stuck.append(f"point {point + 1} of the sensor is stuck at {at:.2f} mm in {there.mean():.0%} of the profiles")
    more = f", and so are {len(stuck) - 1} more points" if len(stuck) > 1 else ""
    return out, (Message("point_stuck", f"{stuck[0]}{more}: left out there"),) if stuck else ()


def _stuck(z: Array) -> list[tuple[int, float]]:
    """Points and the range (mm) at which each is stuck, of profiles (N, M); fewer than ``GROUP`` blind points beside
    each other break no line.
    """
    from scipy.ndimage import binary_opening

    seen = z[np.isfinite(z)]
    if not seen.size:
        return []
    middle = float(np.median(seen))
    half = 3 + round(min(FARTHEST, float(np.abs(seen - middle).max())) / STEP)
    number = _numbers(np.rint((z - middle) / STEP), half)
    point, step = np.nonzero(number[:, 3:-3] > LEAST_SHARE * z.shape[0])
    step += 3
    own = number[point, step]
    blind = ~np.isfinite(z).any(axis=0)
    number[blind & ~binary_opening(blind, np.ones(GROUP))] = z.shape[0]
    go_on = np.maximum(_through(number, point, step), np.max([number[point, step + k] for k in (-3, -2, 2, 3)], axis=0))
    alone = own > OFTEN * go_on
    if len(set(point[alone])) > MOST_POINTS * z.shape[1]:
        return []
    stuck = [(int(p), middle + STEP * (int(s) - half)) for p, s in zip(point[alone], step[alone], strict=True)]
    return [(p, at) for p, at in stuck if not _on_a_face(z, p, at)]


def _on_a_face(z: Array, point: int, at: float) -> bool:
    """Whether a point that often has the range ``at`` (mm) may see a face across the rays, which stays where it is as
    the part turns, and which few rays meet: it lies between what the points beside it see; or a cylinder that meets the
    face comes nearer from one side, up to it and no farther.
    """
    there = np.abs(z[:, point] - at) < STEP
    if 0 < point < z.shape[1] - 1:
        beside = z[there][:, [point - 1, point + 1]]
        between = (beside.min(axis=1) < at - STEP) & (beside.max(axis=1) > at + STEP)
        if between.mean() > MOSTLY:
            return True
    off = z[~there, point] - at
    on_other_side = min(np.count_nonzero(off < 0), np.count_nonzero(off > 0))
    close = np.count_nonzero(np.abs(off) < CLOSE)
    return bool(on_other_side <= SELDOM * np.count_nonzero(there) and close >= LEAST_CLOSE)


def _numbers(steps: Array, half: int) -> Ints:
    """How often (M, 2 half + 1) each point has each of the ``steps`` (N, M) from -half to half."""
    seen, span = np.abs(steps) <= half, 2 * half + 1
    cells = np.nonzero(seen)[1] * span + steps[seen].astype(np.int64) + half
    return np.bincount(cells, minlength=steps.shape[1] * span).reshape(-1, span)


def _through(number: Ints, point: Ints, step: Ints) -> Ints:
    """How often (n,) a line through a ``step`` of a ``point`` is seen, at least, at ``GROUP`` points beside it, on one
    side or on both.
    """
    every = np.arange(-STEEPEST, STEEPEST + 1)
    gentle, steep = (every[(np.abs(every) > STEEP) == is_steep] for is_steep in (False, True))
    lines = (_on_lines(number, point, step, of, bend) for of, bend in zip((gentle, steep), BENDS, strict=True))
    return np.asarray(np.maximum(*lines))


def _on_lines(number: Ints, point: Ints, step: Ints, rises: Ints, bend: int) -> Ints:
    """How often (n,) one of the lines is seen that rise by so many steps from point to point, and ``bend`` by some."""
    from scipy.ndimage import maximum_filter1d

    wide = GROUP * STEEPEST
    near = np.pad(number, ((GROUP, GROUP), (wide, wide)))
    beside = {0: number[point, step] + 0 * rises[:, None]}
    for apart in range(1, GROUP + 1):
        near = maximum_filter1d(near, 2 * bend + 1, axis=1, mode="constant")
        for k in (-apart, apart):
            beside[k] = near[point + GROUP + k, step + wide + k * rises[:, None]]
    lines = [np.min([beside[k] for k in range(first, first + GROUP + 1)], axis=0) for first in range(-GROUP, 1)]
    return np.asarray(np.max(lines, axis=(0, 1), initial=0))
