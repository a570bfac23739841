"""From cells to the quantities of gear people: tooth positions, traces, slopes, forms, run-out, thickness.

Each flank is a smooth surface of its own, a quadratic in roll length and height, on top of a shape that all teeth share
(so that different sampling of that shape does not look like pitch). Cells that depart from both have less weight, or
none: a dent is a defect and no pitch. All of it is linear in the cells once the weights stand, extremes aside.
"""

from dataclasses import dataclass, replace
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from truestand.core.robust import TUKEY, robust_sd, tukey_weights
from truestand.gear.geometry import SIGMA, Involute
from truestand.gear.grid import Grid

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

TERMS = 6
"""1, l, h, l^2, l h, h^2."""
HUBER = 1.345
ROUNDS = (False, False, False, True, True, True, True)
"""Which rounds of weighing leave far cells out altogether (Tukey), after some that only hold them back (Huber)."""
LEAST_TEETH = 4
"""Teeth whose median says what all of them share."""
LEAST_CELLS = 40
"""Cells that a flank's quadratic needs."""
LEAST_SPREAD = 2e-4
"""mm: the scatter of cells about their surface is not taken for less."""
LEAST_ROWS = 6
"""Points of a trace that a line and a form need."""
LEAST_REACH = 0.4
"""Share of an evaluation range over which a trace must reach."""


@dataclass(frozen=True, slots=True)
class Weighed:
    """What stays the same when the cells' values change: which cells count, and how flanks are read from them."""

    weight: Array
    """(2 teeth, cells) 0..1; 0 outside the evaluation ranges or where nothing was seen."""
    basis: Array
    """(2 teeth, cells, TERMS)."""
    solver: Array
    """(2 teeth, TERMS, cells): coefficients from cells; NaN for a flank that can't carry them."""
    rolls: Array
    """(2 teeth, roll lengths) mm: where the points of each trace lie on average."""
    shape: tuple[int, int, int, int]


@dataclass(frozen=True, slots=True)
class Measures:
    """What the flanks say. mm; (2, teeth) left and right, NaN where not seen."""

    position: Array
    """delta at the measuring circle, middle of the face."""
    area: Array
    """delta, mean over the flank's evaluation area."""
    at_ball: Array
    """delta where the ball touches."""
    profile: Array
    """(2, teeth, roll lengths) traces."""
    helix: Array
    """(2, teeth, heights) traces."""
    f_Halpha: Array
    f_falpha: Array
    F_alpha: Array
    C_alpha: Array
    """Crowning: height of the mean parabola over the control length."""
    f_Hbeta: Array
    f_fbeta: Array
    F_beta: Array
    C_beta: Array
    index: Array
    """F_i: tooth position along the measuring circle, ccw positive."""
    pitch: Array
    """f_pi: of each tooth against the one before it."""
    runout: Array
    """(teeth,) radial place of the ball in the space after each tooth."""
    runout_per_delta: float
    """By how much the ball moves outward when one flank of its space grows by 1."""
    residual: Array
    """(2 teeth, cells): what the smooth flanks and the shared shape leave."""


def weigh(grid: Grid, nominal: Involute, everywhere: bool = False) -> Weighed:
    """Which cells count, by Tukey's biweight about flank and shared shape; ``everywhere``: not in the ranges only."""
    flanks, cells = grid.delta.shape[0] * grid.delta.shape[1], grid.delta.shape[2] * grid.delta.shape[3]
    wanted = np.isfinite(grid.delta) if everywhere else np.isfinite(grid.delta) & in_ranges(grid, nominal)
    values, inside = grid.delta.reshape(flanks, cells), wanted.reshape(flanks, cells)
    basis = _basis(grid, nominal).reshape(flanks, cells, TERMS)
    weight = inside.astype(np.float64)
    for last in ROUNDS:
        solver = _solver(basis, weight)
        residual = _residual(values, basis, solver, weight, grid.delta.shape)
        spread = max(robust_sd(residual[inside]) if inside.any() else 0.0, LEAST_SPREAD)
        ratio = np.where(inside, np.abs(residual), 0.0) / spread
        far = tukey_weights(ratio / TUKEY) if last else HUBER / np.maximum(ratio, HUBER)
        weight = np.where(inside, far, 0.0)
    solver = _solver(basis, weight)
    by_row = weight.reshape(*grid.delta.shape)
    with np.errstate(invalid="ignore"):
        rolls = (by_row * grid.roll).sum(axis=3) / by_row.sum(axis=3)
    rolls = np.where(np.isnan(rolls), grid.rolls, rolls).reshape(flanks, -1)
    a, b, c, d = grid.delta.shape
    return Weighed(weight, basis, solver, rolls, (a, b, c, d))


def evaluate(delta: Array, weighed: Weighed, grid: Grid, nominal: Involute) -> Measures:
    """Everything that the cells' ``delta`` (2, teeth, roll lengths, heights) mm says, with weights as they stand."""
    flanks, cells = weighed.weight.shape
    values = np.where(weighed.weight > 0, delta.reshape(flanks, cells), 0.0)
    shared = _shared(values, weighed)
    c = _times(weighed.solver, values - shared)
    residual = values - shared - _times(weighed.basis, c)
    smooth = weighed.shape[:2]
    profile, helix = _traces(values, c, weighed, grid, nominal)
    alpha, beta = _trace_lines(profile, helix, weighed, grid, nominal)
    middle = _shared_at(shared, weighed, grid, nominal.measuring_roll)
    position = (c[:, 0] + middle).reshape(smooth)
    ball = _ball_roll(nominal)
    where = _reduced_roll(ball, nominal)
    at_ball = (c[:, 0] + c[:, 1] * where + c[:, 3] * where**2 + _shared_at(shared, weighed, grid, ball)).reshape(smooth)
    index = SIGMA[:, None] * position * nominal.arc_per_delta
    touching = 1 / (2 * sin(nominal.ball_angle(nominal.ball_diameter)))
    sides = {
        "position": c[:, 0] + middle, "area": c @ _area_means(nominal) + middle,
        "at_ball": at_ball.reshape(-1), "f_Halpha": alpha[0], "f_falpha": alpha[1],
        "F_alpha": alpha[2], "C_alpha": -c[:, 3] ,
        "f_Hbeta": beta[0], "f_fbeta": beta[1], "F_beta": beta[2], "C_beta": -c[:, 5],
    }  # fmt: skip
    return Measures(
        **{name: values.reshape(smooth) for name, values in sides.items()},
        profile=profile.reshape(*smooth, -1),
        helix=helix.reshape(*smooth, -1),
        index=index,
        pitch=index - np.roll(index, 1, axis=1),
        runout=(at_ball[0] + np.roll(at_ball[1], -1)) * touching,
        runout_per_delta=touching,
        residual=np.where(weighed.weight > 0, residual, np.nan),
    )


def trace_figures(
    m: Measures, profile: Array, helix: Array, weighed: Weighed, grid: Grid, nominal: Involute
) -> Measures:
    """The same measures with other traces (2, teeth, n)."""
    profiles, helices = profile.reshape(-1, profile.shape[-1]), helix.reshape(-1, helix.shape[-1])
    alpha, beta = _trace_lines(profiles, helices, weighed, grid, nominal)
    smooth = weighed.shape[:2]
    (a, b, c), (d, e, f) = ([v.reshape(smooth) for v in lines] for lines in (alpha, beta))
    return replace(m, profile=profile, helix=helix, f_Halpha=a, f_falpha=b, F_alpha=c, f_Hbeta=d, f_fbeta=e, F_beta=f)


Lines = tuple[Array, Array, Array]


def _trace_lines(profile: Array, helix: Array, weighed: Weighed, grid: Grid, nominal: Involute) -> tuple[Lines, Lines]:
    """Slope, form and total (flanks,) of profile and helix traces (flanks, n)."""
    heights = np.broadcast_to(grid.heights, helix.shape)
    return (
        _lines(profile, weighed.rolls, nominal.profile_range, slope_length(nominal, along_profile=True)),
        _lines(helix, heights, nominal.helix_range, slope_length(nominal, along_profile=False)),
    )


def residuals(delta: Array, weighed: Weighed) -> Array:
    """What flanks and shared shape leave of the cells (2, teeth, roll lengths, heights), without weight or not."""
    flanks, cells = weighed.weight.shape
    values = np.where(weighed.weight > 0, delta.reshape(flanks, cells), 0.0)
    shared = _shared(values, weighed)
    c = _times(weighed.solver, values - shared)
    rest = delta.reshape(flanks, cells) - shared - _times(weighed.basis, c)
    return np.asarray(rest.reshape(delta.shape))


def pitch_extremes(index: Array, k: int) -> dict[str, Array]:
    """f_p, F_p, F_pk, f_u (2,) of tooth positions (..., 2, teeth); NaN where no two neighbours were seen."""
    single = index - np.roll(index, 1, axis=-1)
    spans = index - np.roll(index, k, axis=-1)
    return {
        "f_p": largest(np.abs(single)),
        "F_p": largest(index) - smallest(index),
        "F_pk": largest(np.abs(spans)),
        "f_u": largest(np.abs(single - np.roll(single, 1, axis=-1))),
    }


def largest(values: Array) -> Array:
    """Largest along the last axis, NaN aside; NaN where there is nothing else."""
    found = np.fmax.reduce(values, axis=-1)
    return np.asarray(found)


def smallest(values: Array) -> Array:
    """Smallest along the last axis, NaN aside."""
    return np.asarray(np.fmin.reduce(values, axis=-1))


def in_ranges(grid: Grid, nominal: Involute) -> Bools:
    """Cells (2, teeth, roll lengths, heights) inside both evaluation ranges."""
    (low, high), (bottom, top) = nominal.profile_range, nominal.helix_range
    return np.asarray((grid.roll >= low) & (grid.roll <= high) & (grid.height >= bottom) & (grid.height <= top))


def _half_roll(nominal: Involute) -> float:
    return nominal.control_length / 2


def _reduced_roll(roll: Array | float, nominal: Involute) -> Array:
    return np.asarray((roll - nominal.measuring_roll) / _half_roll(nominal))


def _reduced_height(height: Array, nominal: Involute) -> Array:
    return np.asarray((height - nominal.middle) / (nominal.gear.face_width / 2))


def _basis(grid: Grid, nominal: Involute) -> Array:
    """1, l, h, l^2, lh, h^2 about the measuring circle and the middle of the face."""
    el, h = _reduced_roll(grid.roll, nominal), _reduced_height(grid.height, nominal)
    return np.stack([np.ones(el.shape), el, h, el * el, el * h, h * h], axis=-1)


def _solver(basis: Array, weight: Array) -> Array:
    """(flanks, TERMS, cells); NaN for a flank with too few cells, or all of them on a line."""
    weighted = (basis * weight[:, :, None]).swapaxes(1, 2)
    normal = weighted @ basis
    able = (np.count_nonzero(weight, axis=1) >= LEAST_CELLS) & (np.linalg.cond(normal) < 1e9)
    normal[~able] = np.eye(TERMS)
    solver = np.linalg.inv(normal) @ weighted
    solver[~able] = np.nan
    return np.asarray(solver)


def _times(matrices: Array, vectors: Array) -> Array:
    """Each flank's matrix (flanks, n, m) times its vector (flanks, m): (flanks, n)."""
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])


def _shared(values: Array, weighed: Weighed) -> Array:
    """The shape (flanks, cells) that all teeth of a side share beyond a quadratic; the same for each tooth."""
    own = _times(weighed.basis, _times(weighed.solver, values))
    return _mean_tooth(values - own, weighed.weight, weighed.shape)


def _mean_tooth(residual: Array, weight: Array, shape: tuple[int, ...]) -> Array:
    sides, teeth = shape[0], shape[1]
    able = np.isfinite(residual)
    w = np.where(able, weight, 0.0).reshape(sides, teeth, -1)
    total = w.sum(axis=1)
    mean = (w * np.where(able, residual, 0.0).reshape(sides, teeth, -1)).sum(axis=1) / np.maximum(total, 1e-9)
    shared = np.where(total > 0, mean, 0.0)
    return np.asarray(np.repeat(shared, teeth, axis=0).reshape(residual.shape))


def _residual(values: Array, basis: Array, solver: Array, weight: Array, shape: tuple[int, ...]) -> Array:
    filled = np.where(np.isfinite(values), values, 0.0)
    rest = filled - _times(basis, _times(solver, filled))
    rest = rest - _median_tooth(np.where(weight > 0, rest, np.nan), shape)
    return np.asarray(np.nan_to_num(rest))


def _median_tooth(residual: Array, shape: tuple[int, ...]) -> Array:
    """Median over the teeth (flanks, cells), the same for each tooth.

    A cell that few teeth have takes the value between those beside it on the profile: its own tooth must not be what it
    is compared with, or a flank would be free to drift there. 0 where no cells tell.
    """
    stacked = np.sort(residual.reshape(shape[0], shape[1], -1), axis=1)  # NaN last
    number = np.isfinite(stacked).sum(axis=1)
    at = np.maximum(number - 1, 0)
    low, high = (np.take_along_axis(stacked, i[:, None], 1)[:, 0] for i in (at // 2, (at + 1) // 2))
    told = (number >= min(LEAST_TEETH, shape[1])).reshape(shape[0], shape[2], shape[3])
    shared = np.where(told, ((low + high) / 2).reshape(told.shape), 0.0)
    rows = np.arange(shape[2])
    for side, height in np.argwhere(told.any(axis=1) & ~told.all(axis=1)):
        known = told[side, :, height]
        shared[side, :, height] = np.interp(rows, rows[known], shared[side, known, height])
    return np.asarray(np.repeat(shared.reshape(shape[0], -1), shape[1], axis=0).reshape(residual.shape))


def _area_means(nominal: Involute) -> Array:
    """Means (TERMS,) of the quadratic's terms over the evaluation area, whichever cells of it were seen."""
    (a, b), (p, q) = (
        [float(_reduced_roll(v, nominal)) for v in nominal.profile_range],
        [float(_reduced_height(np.asarray(v), nominal)) for v in nominal.helix_range],
    )
    el, h = (a + b) / 2, (p + q) / 2
    return np.array([1.0, el, h, (a * a + a * b + b * b) / 3, el * h, (p * p + p * q + q * q) / 3])


def _traces(values: Array, c: Array, weighed: Weighed, grid: Grid, nominal: Involute) -> tuple[Array, Array]:
    """Profile traces (flanks, roll lengths) at the middle of the face, helix traces (flanks, heights) on the measuring
    circle: means across, each freed of how the flank runs the other way.
    """
    shape = (weighed.weight.shape[0], *weighed.shape[2:])
    w = weighed.weight.reshape(shape)
    el, h = weighed.basis[:, :, 1].reshape(shape), weighed.basis[:, :, 2].reshape(shape)
    flat = values.reshape(shape)
    one, two, three, four, five = (c[:, i, None, None] for i in range(1, TERMS))
    across = two * h + four * el * h + five * h * h
    along = one * el + three * el * el + four * el * h
    with np.errstate(invalid="ignore", divide="ignore"):
        profile = (w * (flat - across)).sum(axis=2) / w.sum(axis=2)
        helix = (w * (flat - along)).sum(axis=1) / w.sum(axis=1)
    return profile, helix


def _lines(trace: Array, at: Array, limits: tuple[float, float], length: float) -> Lines:
    """Slope over ``length``, form and total deviation (flanks,) of traces inside the limits; NaN where too short."""
    low, high = limits
    inside = np.isfinite(trace) & (at >= low) & (at <= high)
    n = inside.sum(axis=1)
    where = np.where(inside, at, np.nan)
    reach = np.fmax.reduce(where, axis=1) - np.fmin.reduce(where, axis=1)
    able = (n >= LEAST_ROWS) & (reach > LEAST_REACH * (high - low))
    w, y = inside.astype(np.float64), np.where(inside, trace, 0.0)
    number = np.maximum(n, 1)
    x = np.where(inside, at - (w * at).sum(axis=1, keepdims=True) / number[:, None], 0.0)
    mean = y.sum(axis=1) / number
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (x * y).sum(axis=1) / (x * x).sum(axis=1)
    rest = np.where(inside, y - mean[:, None] - slope[:, None] * x, np.nan)
    total = np.where(inside, trace, np.nan)
    values = slope * length, largest(rest) - smallest(rest), largest(total) - smallest(total)
    first, second, third = (np.where(able, v, np.nan) for v in values)
    return first, second, third


def slope_length(nominal: Involute, along_profile: bool) -> float:
    """Over which length a slope deviation is told: the whole control length (2013), or the evaluation's (1995)."""
    g = nominal.gear
    ends = g.evaluation.slope_ends or ("full" if g.standard.endswith("2013") else "evaluation")
    if ends == "full":
        return nominal.control_length if along_profile else g.face_width
    low, high = nominal.profile_range if along_profile else nominal.helix_range
    return high - low


def _ball_roll(nominal: Involute) -> float:
    """Roll length at which the ball touches the flanks."""
    ball = nominal.ball_diameter
    alpha = nominal.ball_angle(ball)
    return float(nominal.base_radius * np.tan(alpha) - ball / 2 * cos(nominal.base_helix))


def _shared_at(shared: Array, weighed: Weighed, grid: Grid, roll: float) -> Array:
    """The shared shape (flanks,) about a roll length: the mean over a few cells of all heights."""
    near = np.abs(grid.rolls - roll) < 3 * (grid.rolls[1] - grid.rolls[0] if grid.rolls.size > 1 else 1.0)
    on = (weighed.weight.reshape(-1, *weighed.shape[2:]) > 0) & near[:, None]
    sums = (shared.reshape(on.shape) * on).sum(axis=(1, 2))
    return np.asarray(sums / np.maximum(on.sum(axis=(1, 2)), 1))
