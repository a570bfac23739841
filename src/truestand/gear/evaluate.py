"""From cells to gear quantities: tooth positions, traces, slopes, forms, run-out, thickness; and their noise.

Each flank is a smooth surface of its own, a quadratic in roll length and height, on top of a shape that all teeth share
(so that different sampling of that shape does not look like pitch). Cells that depart from both have less weight, or
none: a dent is a defect and no pitch. All of it is linear in the cells once the weights stand, extremes aside.
"""

from dataclasses import dataclass, replace
from math import cos, sin

import numpy as np

from truestand.core.arrays import Array
from truestand.core.robust import TUKEY, nan_median, robust_sd, tukey_weights
from truestand.gear.geometry import SIGMA, Involute, pitch_span
from truestand.gear.grid import Grid

Figures = dict[str, Array]
"""Reported quantities by name, mm: () of the gear, (2,) of left and right flanks, (2, teeth) of each flank."""

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
PER_TOOTH = ("F_alpha", "f_falpha", "f_Halpha", "F_beta", "f_fbeta", "f_Hbeta")
MEANS = (*PER_TOOTH, "C_alpha", "C_beta")
PITCH = ("f_p", "F_p", "F_pk", "f_u")
NEVER_NEGATIVE = frozenset((*PITCH, "f_p_areal", "F_p_areal", "F_r", "F_alpha", "f_falpha", "F_beta", "f_fbeta"))
DRAWS = 64
AREAL, AREAL_NAMES = "_areal", ("f_p", "F_p")
"""Behind the name of a pitch figure from whole flanks, which a measuring circle doesn't have: reported, not judged."""
MEAN = " mean"
"""Behind the name of a figure that is the mean over the teeth of a side."""


@dataclass(frozen=True, slots=True)
class Weights:
    """What stays the same when the cells' values change: which cells count, and how flanks are read from them."""

    grid: Grid
    weight: Array
    """(2 teeth, cells) 0..1; 0 outside the evaluation ranges or where nothing was seen."""
    basis: Array
    """(2 teeth, cells, TERMS)."""
    solver: Array
    """(2 teeth, TERMS, cells): coefficients from cells; NaN for a flank that can't carry them."""
    rolls: Array
    """(2 teeth, roll lengths) mm: where the points of each trace lie on average."""

    @property
    def by_cell(self) -> Array:
        """The weights, (2 teeth, roll lengths, heights)."""
        return self.weight.reshape(-1, *self.grid.delta.shape[2:])


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
    of_flank: Figures
    """Slope, form, total and crowning (height of the mean parabola) of profile and helix: ``MEANS``."""
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


def weights_of(grid: Grid, whole_flank: bool = False) -> Weights:
    """Which cells count, by Tukey's biweight about flank and shared shape, inside the evaluation ranges.

    ``whole_flank``: outside them, too.
    """
    flanks, cells = 2 * grid.delta.shape[1], grid.rolls.size * grid.heights.size
    wanted = np.isfinite(grid.delta) if whole_flank else np.isfinite(grid.delta) & grid.in_ranges
    values, inside = grid.delta.reshape(flanks, cells), wanted.reshape(flanks, cells)
    basis = _basis(grid).reshape(flanks, cells, TERMS)
    weight = inside.astype(np.float64)
    for last in ROUNDS:
        residual = _residual(values, basis, _solver(basis, weight), weight, grid.delta.shape)
        spread = max(robust_sd(residual[inside]) if inside.any() else 0.0, LEAST_SPREAD)
        ratio = np.where(inside, np.abs(residual), 0.0) / spread
        far = tukey_weights(ratio / TUKEY) if last else HUBER / np.maximum(ratio, HUBER)
        weight = np.where(inside, far, 0.0)
    by_cell = weight.reshape(grid.delta.shape)
    total = by_cell.sum(axis=3)
    rolls = np.where(total > 0, (by_cell * grid.roll).sum(axis=3) / np.maximum(total, 1e-300), grid.rolls)
    return Weights(grid, weight, basis, _solver(basis, weight), rolls.reshape(flanks, -1))


def evaluate(delta: Array, weights: Weights) -> Measures:
    """Everything that the cells' ``delta`` (2, teeth, roll lengths, heights) mm says, with weights as they stand."""
    nominal, by_flank = weights.grid.nominal, delta.shape[:2]
    values, shared, c = _fit(delta, weights)
    residual = values - shared - _times(weights.basis, c)
    profile, helix = _traces(values, c, weights)
    crowning = {"C_alpha": -c[:, 3], "C_beta": -c[:, 5]}
    middle = _shared_at(shared, weights, nominal.measuring_roll)
    position = (c[:, 0] + middle).reshape(by_flank)
    ball = _ball_roll(nominal)
    x = _reduced_roll(ball, nominal)
    at_ball = (c[:, 0] + c[:, 1] * x + c[:, 3] * x**2 + _shared_at(shared, weights, ball)).reshape(by_flank)
    index = SIGMA[:, None] * position * nominal.arc_per_delta
    per_delta = 1 / (2 * sin(nominal.ball_angle(nominal.ball_diameter)))
    of_flank = _trace_lines(profile, helix, weights) | crowning
    return Measures(
        position=position,
        area=(c @ _area_means(nominal) + middle).reshape(by_flank),
        at_ball=at_ball,
        profile=profile.reshape(*by_flank, -1),
        helix=helix.reshape(*by_flank, -1),
        of_flank={name: values.reshape(by_flank) for name, values in of_flank.items()},
        index=index,
        pitch=index - np.roll(index, 1, axis=1),
        runout=_runout(at_ball, per_delta),
        runout_per_delta=per_delta,
        residual=np.where(weights.weight > 0, residual, np.nan),
    )


def residuals(delta: Array, weights: Weights) -> Array:
    """What flanks and shared shape leave of the cells (2, teeth, roll lengths, heights), with weight or without."""
    _, shared, c = _fit(delta, weights)
    rest = delta.reshape(shared.shape) - shared - _times(weights.basis, c)
    return np.asarray(rest.reshape(delta.shape))


def _fit(delta: Array, weights: Weights) -> tuple[Array, Array, Array]:
    """Cells (flanks, cells), 0 where they don't count; the shape shared by all teeth; coefficients (flanks, TERMS)."""
    values = np.where(weights.weight > 0, delta.reshape(weights.weight.shape), 0.0)
    own = _times(weights.basis, _times(weights.solver, values))
    shared = _mean_tooth(values - own, weights.weight, delta.shape)
    return values, shared, _times(weights.solver, values - shared)


def _runout(at_ball: Array, per_delta: float) -> Array:
    """Radial place (teeth,) of the ball in the space after each tooth, from delta (2, teeth) where it touches."""
    return np.asarray((at_ball[0] + np.roll(at_ball[1], -1)) * per_delta)


def _trace_lines(profile: Array, helix: Array, weights: Weights) -> Figures:
    """Slope, form and total (flanks,) of profile and helix traces (flanks, n), by name."""
    nominal, heights = weights.grid.nominal, np.broadcast_to(weights.grid.heights, helix.shape)
    alpha = _lines(profile, weights.rolls, nominal.profile_range, slope_length(nominal, along_profile=True))
    beta = _lines(helix, heights, nominal.helix_range, slope_length(nominal, along_profile=False))
    names = ("f_Halpha", "f_falpha", "F_alpha", "f_Hbeta", "f_fbeta", "F_beta")
    return dict(zip(names, (*alpha, *beta), strict=True))


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
    return np.asarray(np.fmax.reduce(values, axis=-1))


def smallest(values: Array) -> Array:
    """Smallest along the last axis, NaN aside."""
    return np.asarray(np.fmin.reduce(values, axis=-1))


def _reduced_roll(roll: Array | float, nominal: Involute) -> Array:
    return np.asarray((roll - nominal.measuring_roll) / (nominal.control_length / 2))


def _reduced_height(height: Array | float, nominal: Involute) -> Array:
    return np.asarray((height - nominal.middle) / (nominal.gear.face_width / 2))


def _basis(grid: Grid) -> Array:
    """1, l, h, l^2, lh, h^2 about the measuring circle and the middle of the face."""
    el, h = _reduced_roll(grid.roll, grid.nominal), _reduced_height(grid.height, grid.nominal)
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


def _mean_tooth(residual: Array, weight: Array, shape: tuple[int, ...]) -> Array:
    """Weighted mean over the teeth of each side (flanks, cells), the same for each tooth; 0 where no cell counts."""
    sides, teeth = shape[:2]
    seen = np.isfinite(residual)
    w = np.where(seen, weight, 0.0).reshape(sides, teeth, -1)
    total = w.sum(axis=1)
    mean = (w * np.where(seen, residual, 0.0).reshape(sides, teeth, -1)).sum(axis=1) / np.maximum(total, 1e-9)
    return np.asarray(np.repeat(np.where(total > 0, mean, 0.0), teeth, axis=0).reshape(residual.shape))


def _residual(values: Array, basis: Array, solver: Array, weight: Array, shape: tuple[int, ...]) -> Array:
    filled = np.where(np.isfinite(values), values, 0.0)
    rest = filled - _times(basis, _times(solver, filled))
    rest = rest - _median_tooth(np.where(weight > 0, rest, np.nan), shape)
    return np.asarray(np.nan_to_num(rest))


def _median_tooth(residual: Array, shape: tuple[int, ...]) -> Array:
    """Median over the teeth (flanks, cells), the same for each tooth.

    A cell that few teeth have takes the value between those beside it on the profile: its own tooth must not be what it
    is compared with, or a flank would be free to drift there. 0 where no tooth shows it.
    """
    by_tooth = residual.reshape(shape)
    known = np.isfinite(by_tooth).sum(axis=1) >= min(LEAST_TEETH, shape[1])
    shared = np.where(known, nan_median(by_tooth, axis=1), 0.0)
    rows = np.arange(shape[2])
    for side, height in np.argwhere(known.any(axis=1) & ~known.all(axis=1)):
        support = known[side, :, height]
        shared[side, :, height] = np.interp(rows, rows[support], shared[side, support, height])
    return np.asarray(np.repeat(shared.reshape(shape[0], -1), shape[1], axis=0).reshape(residual.shape))


def _area_means(nominal: Involute) -> Array:
    """Means (TERMS,) of the quadratic's terms over the evaluation area, whichever cells of it were seen."""
    (a, b), (p, q) = (
        [float(_reduced_roll(v, nominal)) for v in nominal.profile_range],
        [float(_reduced_height(v, nominal)) for v in nominal.helix_range],
    )
    el, h = (a + b) / 2, (p + q) / 2
    return np.array([1.0, el, h, (a * a + a * b + b * b) / 3, el * h, (p * p + p * q + q * q) / 3])


def _traces(values: Array, c: Array, weights: Weights) -> tuple[Array, Array]:
    """Profile traces (flanks, roll lengths) at the middle of the face, helix traces (flanks, heights) on the measuring
    circle: means across, each freed of how the flank runs the other way.
    """
    w = weights.by_cell
    el, h = weights.basis[:, :, 1].reshape(w.shape), weights.basis[:, :, 2].reshape(w.shape)
    delta = values.reshape(w.shape)
    one, two, three, four, five = (c[:, i, None, None] for i in range(1, TERMS))
    across = two * h + four * el * h + five * h * h
    along = one * el + three * el * el + four * el * h
    with np.errstate(invalid="ignore", divide="ignore"):
        profile = (w * (delta - across)).sum(axis=2) / w.sum(axis=2)
        helix = (w * (delta - along)).sum(axis=1) / w.sum(axis=1)
    return profile, helix


def _lines(trace: Array, at: Array, limits: tuple[float, float], length: float) -> tuple[Array, Array, Array]:
    """Slope over ``length``, form and total deviation (flanks,) of traces inside the limits; NaN where too short."""
    low, high = limits
    inside = np.isfinite(trace) & (at >= low) & (at <= high)
    n = inside.sum(axis=1)
    seen_at = np.where(inside, at, np.nan)
    reach = largest(seen_at) - smallest(seen_at)
    able = (n >= LEAST_ROWS) & (reach > LEAST_REACH * (high - low))
    w, y = inside.astype(np.float64), np.where(inside, trace, 0.0)
    number = np.maximum(n, 1)
    x = np.where(inside, at - (w * at).sum(axis=1, keepdims=True) / number[:, None], 0.0)
    mean = y.sum(axis=1) / number
    slope = (x * y).sum(axis=1) / np.maximum((x * x).sum(axis=1), 1e-300)
    rest = np.where(inside, y - mean[:, None] - slope[:, None] * x, np.nan)
    form, total = (largest(v) - smallest(v) for v in (rest, np.where(inside, trace, np.nan)))
    return np.where(able, slope * length, np.nan), np.where(able, form, np.nan), np.where(able, total, np.nan)


def slope_length(nominal: Involute, along_profile: bool) -> float:
    """Length (mm) over which a slope deviation counts: the whole control length or face (2013), or the evaluation's."""
    if nominal.full_slopes:
        return nominal.control_length if along_profile else nominal.gear.face_width
    low, high = nominal.profile_range if along_profile else nominal.helix_range
    return high - low


def _ball_roll(nominal: Involute) -> float:
    """Roll length at which the ball touches the flanks."""
    ball = nominal.ball_diameter
    alpha = nominal.ball_angle(ball)
    return float(nominal.base_radius * np.tan(alpha) - ball / 2 * cos(nominal.base_helix))


def _shared_at(shared: Array, weights: Weights, roll: float) -> Array:
    """The shared shape (flanks,) about a roll length: the mean over a few cells of all heights."""
    near = np.abs(weights.grid.rolls - roll) < 3 * weights.grid.size[0]
    on = (weights.by_cell > 0) & near[:, None]
    sums = (shared.reshape(on.shape) * on).sum(axis=(1, 2))
    return np.asarray(sums / np.maximum(on.sum(axis=(1, 2)), 1))


def figures_of(m: Measures, nominal: Involute) -> Figures:
    """Every reported quantity; a mean over the teeth has ``MEAN`` behind its name."""
    found: Figures = dict(pitch_extremes(m.index, pitch_span(nominal.gear)))
    areal = pitch_extremes(SIGMA[:, None] * m.area * nominal.arc_per_delta, pitch_span(nominal.gear))
    found |= {name + AREAL: areal[name] for name in AREAL_NAMES}
    found |= {name: m.of_flank[name] for name in PER_TOOTH}
    found |= {name + MEAN: mean_seen(m.of_flank[name]) for name in MEANS}
    both = mean_seen(m.position).sum()
    ball = nominal.ball_diameter
    found["F_r"] = np.asarray(largest(m.runout) - smallest(m.runout))
    found["s"] = np.asarray(nominal.thickness + both * nominal.arc_per_delta)
    found["W_k"] = np.asarray(nominal.span + both * nominal.normal_per_delta)
    across = nominal.over_balls(ball) - ball
    centre = nominal.base_radius / np.cos(nominal.ball_angle(ball))
    found["M_d"] = np.asarray(ball + across * (1 + mean_seen(m.runout) / centre))
    return found


def mean_seen(values: Array) -> Array:
    """Mean over the last axis, NaN aside; NaN where there is nothing else."""
    number = np.isfinite(values).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(np.isfinite(values), values, 0.0).sum(axis=-1) / number)


def noise_of(m: Measures, weights: Weights) -> tuple[Figures, Figures]:
    """What each figure reads with the noise once more on it, and its expanded uncertainty from noise (k = 2)."""
    nominal = weights.grid.nominal
    drawn = [figures_of(d, nominal) for d in _noisier(m, weights)]
    base = figures_of(m, nominal)
    more, U = {}, {}
    for name, value in base.items():
        stack = np.stack([d[name] for d in drawn])
        more[name] = np.maximum(stack.mean(axis=0), value)
        U[name] = 2 * stack.std(axis=0)
    return more, U


def corrected(base: Figures, noisier: Figures) -> Figures:
    """The figures without the bias of noise: the largest of many values reads too much even where all are zero.

    The square of a figure is extrapolated to no noise (as ``statistics.noise`` does, Cook and Stefanski 1994).
    """
    return {
        n: np.sqrt(np.maximum(2 * v * v - noisier[n] ** 2, 0.0)) if n.removesuffix(MEAN) in NEVER_NEGATIVE else v
        for n, v in base.items()
    }


def position_u(m: Measures, weights: Weights) -> Array:
    """Standard uncertainty (2, teeth) of the tooth positions' delta from the scatter of the cells, mm.

    Cells of one height, and cells of one roll length, may share an error (speckle, one profile's angle): the larger of
    the two ways to bundle them counts (cluster-robust).
    """
    part = (weights.solver[:, 0, :] * np.nan_to_num(m.residual)).reshape(weights.by_cell.shape)
    by_height, by_roll = (part.sum(axis=a) for a in (1, 2))
    u = np.sqrt(np.maximum((by_height**2).sum(axis=1), (by_roll**2).sum(axis=1)))
    return np.asarray(u.reshape(m.position.shape))


def _row_u(m: Measures, weights: Weights, axis: int) -> Array:
    """Standard uncertainty (flanks, n) of the points of a trace, mm."""
    on = weights.by_cell > 0
    rest = np.where(on, np.nan_to_num(m.residual).reshape(on.shape), 0.0)
    number = on.sum(axis=axis)
    spread = np.sqrt((rest**2).sum() / max(int(on.sum()), 1))
    return np.asarray(spread / np.sqrt(np.maximum(number, 1)))


def _noisier(m: Measures, weights: Weights) -> list[Measures]:
    """The measures with noise drawn once more on them, ``DRAWS`` times."""
    rng = np.random.default_rng(1)
    u, across, along = position_u(m, weights), _row_u(m, weights, 2), _row_u(m, weights, 1)
    return [
        _moved(
            m, weights, u * rng.standard_normal(u.shape), across * rng.standard_normal(across.shape),
            along * rng.standard_normal(along.shape),
        )
        for _ in range(DRAWS)
    ]  # fmt: skip


def _moved(m: Measures, weights: Weights, off: Array, across: Array, along: Array) -> Measures:
    """The measures, positions moved by ``off`` (2, teeth), traces by ``across`` and ``along`` (flanks, n) mm."""
    profile, helix = (t + d.reshape(t.shape) for t, d in ((m.profile, across), (m.helix, along)))
    lines = _trace_lines(profile.reshape(across.shape), helix.reshape(along.shape), weights)
    at_ball = m.at_ball + off
    return replace(
        m, position=m.position + off, area=m.area + off, at_ball=at_ball,
        index=SIGMA[:, None] * (m.position + off) * weights.grid.nominal.arc_per_delta,
        runout=_runout(at_ball, m.runout_per_delta), profile=profile, helix=helix,
        of_flank=m.of_flank | {name: v.reshape(off.shape) for name, v in lines.items()},
    )  # fmt: skip
