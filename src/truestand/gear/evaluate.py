"""From cells to gear quantities: tooth positions, traces, slopes, forms, run-out, thickness; and their noise.

All of it is linear in the cells once it stands how the flanks are read, extremes aside.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import sqrt

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.gear.column_reading import Reading
from truestand.gear.geometry import SIGMA, Involute, pitch_span
from truestand.gear.grid import Grid, step_on_flank
from truestand.gear.noise import CellNoise, borne_out, noise_of_cells
from truestand.gear.smooth_flanks import SmoothFlanks, areal_positions, shared_shape, smooth_flanks
from truestand.gear.trace_line import Line, line_of, unseen_ends
from truestand.gear.traces import (
    SHARED_BY,
    WIDE_STEPS,
    Traces,
    circle_points,
    helix_bend,
    helix_of,
    helix_points,
    position_bend,
    position_of,
    profile_bend,
    profile_of,
    profile_points,
    profile_unsampled,
    traces_of,
)

Figures = dict[str, Array]
"""Reported quantities by name, mm: () of the gear, (2,) of left and right flanks, (2, teeth) of each flank."""

PER_TOOTH = ("F_alpha", "f_falpha", "f_Halpha", "F_beta", "f_fbeta", "f_Hbeta")
MEANS = (*PER_TOOTH, "C_alpha", "C_beta")
PITCH = ("f_p", "F_p", "F_pk", "f_u")
NEVER_NEGATIVE = frozenset((*PITCH, "f_p_areal", "F_p_areal", "F_r", "F_alpha", "f_falpha", "F_beta", "f_fbeta"))
DRAWS, FEW_DRAWS, STEEP_DRAWS, ALONE_DRAWS = 64, 24, 24, 12
"""Of noise on the cells: for U; for the mean of what it adds; for cells on steep places; and of noise alone."""
FIGURES_OF_LINE = ("slope", "form", "total", "crowning")
"""Of a ``Line``."""
BEND_DRAWS, STRETCHES = 24, 5
"""Of what lies between the profiles beside the measuring circle, and in how many stretches of the face."""
NOISE_U = 0.1
"""How well (k = 2) the size of the noise is known, as a share of it."""
VIBRATION = "vibration, or form of single flanks"
"""Line of what single flanks have along their profiles and others don't."""
ROUGHNESS = "roughness of the flanks, or noise that goes on over some readings"
"""Line of what cells share with their neighbours: it may be the flanks' own."""
PROFILE_NAMES = frozenset({"F_alpha", "f_falpha", "f_Halpha", "C_alpha"})
"""Figures that a line along the roll length makes; the others are read along the height."""
AREAL, AREAL_NAMES = "_areal", ("f_p", "F_p")
"""Behind the name of a pitch figure from whole flanks, which a measuring circle doesn't have: reported, not judged."""
MEAN = " mean"
"""Behind the name of a figure that is the mean over the teeth of a side."""


@dataclass(frozen=True, slots=True)
class Evaluator:
    """What stays the same when the cells' values change: how flanks are read from them."""

    grid: Grid
    noise: CellNoise
    smooth: SmoothFlanks
    traces: Traces


@dataclass(frozen=True, slots=True)
class Measures:
    """What the flanks say. mm; (2, teeth) left and right, NaN where not seen."""

    position: Array
    """delta at the measuring circle, middle of the face."""
    area: Array
    """delta of the smooth flank, mean over its evaluation area."""
    at_ball: Array
    """delta where the ball touches."""
    profile: Array
    """(2, teeth, points) traces after the low-pass, over ``traces.profile_points``."""
    helix: Array
    """(2, teeth, points) traces after the low-pass, over ``traces.helix_points``."""
    of_flank: Figures
    """Slope, form, total and crowning (height of the mean parabola) of profile and helix: ``MEANS``."""
    index: Array
    """F_i: tooth position along the measuring circle, ccw positive."""
    pitch: Array
    """f_pi: of each tooth against the one before it."""
    runout: Array
    """(teeth,) radial place of the ball in the space after each tooth."""


def evaluator_of(grid: Grid, step: float) -> Evaluator:
    """How the flanks of a grid are read; ``step``: table angle from one profile to the next, rad."""
    cells, smooth = noise_of_cells(grid), smooth_flanks(grid)
    traces = traces_of(grid, cells, shared_shape(grid.delta, smooth, SHARED_BY), step)
    return Evaluator(grid, _borne_out_by_helices(cells, grid, traces, step), smooth, traces)


def with_noise_beside(damaged: Mask, evaluator: Evaluator, step: float) -> Evaluator:
    """The same, its noise told by cells that are not ``damaged`` (2, teeth, roll lengths, heights).

    Damage of most flanks, each elsewhere, is alike from flank to flank as noise is: a ridge on every flank of a side
    was taken off their mean.
    """
    grid, traces = evaluator.grid, evaluator.traces
    noise = _borne_out_by_helices(noise_of_cells(grid, damaged), grid, traces, step, damaged)
    return replace(evaluator, noise=noise)


def _borne_out_by_helices(
    noise: CellNoise, grid: Grid, traces: Traces, step: float, damaged: Mask | None = None
) -> CellNoise:
    """The noise of cells with those near the measuring circle as helices show it."""
    circle = grid.nominal.measuring_roll
    near = np.abs(grid.rolls - circle) < WIDE_STEPS[0] * step_on_flank(grid.nominal, circle, step)
    off = np.zeros(grid.delta.shape, dtype=bool) if damaged is None else damaged
    beside = ~off[:, :, near].any(axis=2).reshape(traces.heights.shape)
    return borne_out(noise, grid, near, lambda delta: np.where(beside, circle_points(delta, traces), np.nan))


def evaluate(delta: Array, evaluator: Evaluator) -> Measures:
    """Everything that the cells' ``delta`` (2, teeth, roll lengths, heights) mm says."""
    nominal, traces, by_flank = evaluator.grid.nominal, evaluator.traces, delta.shape[:2]
    circle, ball = (at(delta) for at in (traces.circle, traces.ball))
    position = position_of(circle, traces.circle, traces).reshape(by_flank)
    at_ball = position_of(ball, traces.ball, traces).reshape(by_flank)
    alpha, beta = profile_line(profile_of(delta, traces), evaluator), helix_line(traces.helix(circle), evaluator)
    index = SIGMA[:, None] * position * nominal.arc_per_delta
    return Measures(
        position=position,
        area=areal_positions(delta, evaluator.smooth),
        at_ball=at_ball,
        profile=alpha.filtered.reshape(*by_flank, -1),
        helix=beta.filtered.reshape(*by_flank, -1),
        of_flank=figures_of_lines(alpha, beta, by_flank),
        index=index,
        pitch=index - np.roll(index, 1, axis=1),
        runout=_runout(at_ball, nominal),
    )


def figures_of_lines(alpha: Line, beta: Line, by_flank: tuple[int, ...]) -> Figures:
    """``MEANS`` of each flank, from the lines of its profile and its helix."""
    values = (alpha.total, alpha.form, alpha.slope, beta.total, beta.form, beta.slope, alpha.crowning, beta.crowning)
    return {name: value.reshape(by_flank) for name, value in zip(MEANS, values, strict=True)}


def profile_line(trace: Array, evaluator: Evaluator, shorter: float = 0.0) -> Line:
    """The figures of profile traces (flanks, points), over a range that is so many mm ``shorter`` at either end."""
    nominal, traces = evaluator.grid.nominal, evaluator.traces
    low, high = nominal.profile_range
    cells = np.isfinite(traces.rolls[:, traces.band]).any(axis=1).sum(axis=1)
    return line_of(
        trace, profile_points(nominal, shorter), cells, slope_length(nominal, along_profile=True),
        nominal.control_length, high - low,
    )  # fmt: skip


def helix_line(trace: Array, evaluator: Evaluator, longer: float = 0.0) -> Line:
    """The figures of helix traces (flanks, points), over a range that is so many mm ``longer`` at either end."""
    nominal, width = evaluator.grid.nominal, evaluator.grid.nominal.gear.face_width
    cells = evaluator.traces.circle.seen.sum(axis=1)
    return line_of(
        trace, helix_points(nominal, longer), cells, slope_length(nominal, along_profile=False), width, width,
        evaluator.grid.size[1],
    )  # fmt: skip


def slope_length(nominal: Involute, along_profile: bool) -> float:
    """Length (mm) over which a slope deviation counts: the whole control length or face (2013), or the evaluation's."""
    if nominal.full_slopes:
        return nominal.control_length if along_profile else nominal.gear.face_width
    low, high = nominal.profile_range if along_profile else nominal.helix_range
    return high - low


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


def figures_of(m: Measures, nominal: Involute) -> Figures:
    """Every reported quantity; a mean over the teeth has ``MEAN`` behind its name."""
    found: Figures = dict(pitch_extremes(m.index, pitch_span(nominal.gear)))
    areal = _pitch_of(m.area, nominal)
    found |= {name + AREAL: areal[name] for name in AREAL_NAMES}
    found |= {name: m.of_flank[name] for name in PER_TOOTH}
    found |= {name + MEAN: mean_seen(m.of_flank[name]) for name in MEANS}
    both = mean_seen(m.position).sum()
    ball = nominal.ball_diameter
    found["F_r"] = _range(m.runout)
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


def sampling_of(evaluator: Evaluator) -> Figures:
    """U (k = 2, mm) of each figure from what lies between the readings and beyond them.

    A trace may bend there, its ends may not have been seen, and a flank may bend where its position is read.
    """
    widths = _trace_sampling(evaluator)
    widths |= {name + MEAN: mean_seen(width) for name, width in widths.items()}
    widths |= _position_sampling(evaluator)
    return {name: np.asarray(2 / sqrt(3.0) * width) for name, width in widths.items()}


def _trace_sampling(evaluator: Evaluator) -> Figures:
    """By how much (2, teeth), mm, the figures of traces may be off."""
    nominal, traces, delta = evaluator.grid.nominal, evaluator.traces, evaluator.grid.delta
    profile = unseen_ends(profile_of(delta, traces), profile_points(nominal), lambda t: profile_line(t, evaluator))
    helix = unseen_ends(helix_of(delta, traces), helix_points(nominal), lambda t: helix_line(t, evaluator))
    shared = shared_shape(delta, evaluator.smooth)
    unsampled = profile_unsampled(shared, evaluator.grid, traces)
    by_many = shared_shape(delta, evaluator.smooth, SHARED_BY)
    bend = profile_bend(delta, by_many, evaluator.grid, traces)
    profile_between = bend + np.nan_to_num(np.abs(unsampled)).max(axis=1)
    apart, helix_between = _between_profiles(evaluator), helix_bend(delta, traces)
    tips, ends = _profile_ends(evaluator), _helix_ends(evaluator)
    widths: Figures = {
        "f_Halpha": np.hypot(profile.slope + np.abs(profile_line(unsampled, evaluator).slope), tips["slope"]),
        "f_falpha": np.hypot(profile.form + profile_between, tips["form"]),
        "F_alpha": np.hypot(profile.total + profile_between, tips["total"]),
        "f_Hbeta": np.hypot(helix.slope + apart["slope"], ends["slope"]),
        "f_fbeta": np.hypot(helix.form + np.fmax(helix_between, apart["form"]), ends["form"]),
        "F_beta": np.hypot(helix.total + np.fmax(helix_between, apart["total"]), ends["total"]),
        "C_alpha": np.hypot(profile.crowning, tips["crowning"]),
        "C_beta": np.hypot(helix.crowning + apart["crowning"], ends["crowning"]),
    }
    return {name: width.reshape(delta.shape[:2]) for name, width in widths.items()}


def _profile_ends(evaluator: Evaluator) -> Figures:
    """By how much (flanks,), mm, the figures of profiles change where their range ends a cell farther in: between the
    last cell on the flank and the first one on a chamfer nothing says where it begins.
    """
    traces, delta = evaluator.traces, evaluator.grid.delta
    shorter, read = traces.shorter_profile
    full = profile_line(profile_of(delta, traces), evaluator)
    return _apart(full, [profile_line(profile_of(delta, traces, read), evaluator, shorter)])


def _helix_ends(evaluator: Evaluator) -> Figures:
    """By how much (flanks,), mm, the figures of helices change where their range ends a cell farther out or in: the
    cells there don't say on which side of the end a step of the flank lies.
    """
    traces = evaluator.traces
    points = traces.circle(evaluator.grid.delta)
    read = helix_line(traces.helix(points), evaluator)
    return _apart(read, [helix_line(helix(points), evaluator, longer) for longer, helix in traces.other_ends])


def _apart(read: Line, others: Sequence[Line]) -> Figures:
    """By how much the figures of lines differ from those ``read`` at most; 0 where they are not known."""
    return {
        name: np.nan_to_num(
            np.fmax.reduce([np.abs(getattr(other, name) - getattr(read, name)) for other in others], axis=0)
        )
        for name in FIGURES_OF_LINE
    }


def _between_profiles(evaluator: Evaluator) -> Figures:
    """By how much (flanks,) the figures of helices may be off because flanks bend between the profiles on either side
    of the measuring circle: half-widths, mm, with the standard deviation of figures whose points are drawn.

    Where an edge lies between two profiles, a point is like one of them or like the other. Along a stretch of the face,
    about ``STRETCHES`` of them, all edges lie at the same share of the way: a groove that crosses the circle at a small
    angle has its edge there for millimetres.
    """
    traces, rng = evaluator.traces, np.random.default_rng(1)
    points, low, high = traces.circle(evaluator.grid.delta), traces.circle.below, traces.circle.above
    nearer_high = low / np.maximum(low + high, 1e-300)
    read = helix_line(traces.helix(points), evaluator)
    square = {name: np.zeros(points.shape[0]) for name in FIGURES_OF_LINE}
    for _ in range(BEND_DRAWS):
        begins = rng.random(points.shape) < STRETCHES / points.shape[1]
        begins[:, 0] = False
        share = np.take_along_axis(rng.random(points.shape), np.cumsum(begins, axis=1), axis=1)
        drawn = helix_line(traces.helix(np.where(share < nearer_high, points + high, points - low)), evaluator)
        for name in square:
            square[name] += np.square(getattr(drawn, name) - getattr(read, name)) / BEND_DRAWS
    return {name: np.sqrt(3.0 * total) for name, total in square.items()}


def _position_sampling(evaluator: Evaluator) -> Figures:
    """By how much, mm, the figures that are read from positions may be off: half-widths with the standard deviation of
    figures whose positions are drawn from where flanks may lie, or of the mean of all flanks at most.
    """
    nominal, traces, delta = evaluator.grid.nominal, evaluator.traces, evaluator.grid.delta
    widths = _spread_of(traces.circle, evaluator, lambda position: _pitch_of(position, nominal))
    widths |= _spread_of(traces.ball, evaluator, lambda at_ball: {"F_r": _range(_runout(at_ball, nominal))})
    position, ball = (position_bend(at, traces).reshape(delta.shape[:2]) for at in (traces.circle, traces.ball))
    mean = mean_seen(position).sum()
    return widths | {
        "s": mean * nominal.arc_per_delta, "W_k": mean * nominal.normal_per_delta,
        "M_d": 2 * mean_seen(ball).sum() * nominal.runout_per_delta,
    }  # fmt: skip


def _spread_of(reading: Reading, evaluator: Evaluator, figures: Callable[[Array], Figures]) -> Figures:
    """Half-widths, mm, of ``figures`` that follow from positions (2, teeth) mm: each flank lies anywhere between where
    a ``reading`` puts it at most.
    """
    traces, delta, rng = evaluator.traces, evaluator.grid.delta, np.random.default_rng(1)
    position, below, above = (
        position_of(points, reading, traces).reshape(delta.shape[:2])
        for points in (reading(delta), reading.below, reading.above)
    )
    read = figures(position)
    square = {name: np.zeros_like(value) for name, value in read.items()}
    for _ in range(BEND_DRAWS):
        drawn = figures(position - below + rng.random(position.shape) * (below + above))
        for name, value in drawn.items():
            square[name] += np.square(value - read[name]) / BEND_DRAWS
    return {name: np.sqrt(3.0 * total) for name, total in square.items()}


def _pitch_of(position: Array, nominal: Involute) -> Figures:
    """``PITCH`` by the positions (2, teeth) mm of flanks."""
    return pitch_extremes(SIGMA[:, None] * position * nominal.arc_per_delta, pitch_span(nominal.gear))


def _runout(at_ball: Array, nominal: Involute) -> Array:
    """Radial places (teeth,) mm of the ball by where flanks (2, teeth) mm lie where it touches."""
    return np.asarray((at_ball[0] + np.roll(at_ball[1], -1)) * nominal.runout_per_delta)


def _range(values: Array) -> Array:
    """From the smallest to the largest of values (n,), NaN aside."""
    return np.asarray(largest(values) - smallest(values))


@dataclass(frozen=True, slots=True)
class Bias:
    """What noise does to each figure: mm, by the figure's name."""

    lifted: Figures
    """Square (mm^2) by which noise lifts the square of a figure that is the largest of many values."""
    sd: Figures
    """Standard deviation of the figure as it is read, from noise,"""
    added: Figures
    """and by how much noise of the same size, once more, lifts it: mm."""

    def corrected(self, base: Figures) -> Figures:
        """The figures as they are without noise: the largest of many values reads too much even where all are zero."""
        return {n: np.sqrt(np.maximum(v * v - self.lifted[n], 0.0)) if n in self.lifted else v for n, v in base.items()}

    def expanded(self, base: Figures, steep: Figures) -> Figures:
        """U (k = 2, mm) of the corrected figures: as far as they move when the figures as read do by their own U, or
        when the noise is another by ``NOISE_U``, which single teeth hardly feel, but their mean does; and as far as it
        matters whether the squares of figures add or they themselves. No less than what was taken off: it may be
        roughness, which is the flank's own, and a mean over the teeth has as much of it.

        ``steep``: standard deviation of the figures from cells that aren't known better than a flank rises in them.
        """
        U, as_figures = {n: 2 * np.hypot(self.sd[n], steep[n]) for n in base}, self._corrected_as_figures(base)
        highest = {n: np.maximum(v, np.sqrt(self.lifted.get(n, 0.0))) + U[n] for n, v in base.items()}
        lowest = {n: np.maximum(v - U[n], 0.0) for n, v in base.items()}
        ends = self.corrected(highest), self.corrected(lowest)
        others = [
            replace(self, lifted={n: v * (1.0 + sign * NOISE_U) ** 2 for n, v in self.lifted.items()}).corrected(base)
            for sign in (-1.0, 1.0)
        ]

        def farthest(n: str, from_: Array, figures: Iterable[Figures]) -> Array:
            return np.asarray(np.fmax(*(np.abs(f[n] - from_) for f in figures)))

        for n, c in self.corrected(base).items():
            if n in self.lifted:
                own = np.fmax(farthest(n, c, ends), 2 / sqrt(3.0) * (base[n] - c))
                U[n] = np.sqrt(own**2 + farthest(n, c, others) ** 2 + 4 / 3 * (as_figures[n] - c) ** 2)
        return U

    def _corrected_as_figures(self, base: Figures) -> Figures:
        """The corrected figures if they, not their squares, add: where noise lies on one peak and a flat rest, it lifts
        a figure in proportion to its standard deviation, which is sqrt 2 times as large with noise once more.
        """
        return {n: np.maximum(v - self.added[n] / (sqrt(2.0) - 1.0), 0.0) for n, v in base.items() if n in self.added}


def bias_of(base: Figures, evaluator: Evaluator, draws: int) -> Bias:
    """What the noise of the cells does to the figures: it is drawn once more on them, and what that adds to the square
    of a figure is what it has added already (as ``statistics.noise`` does, Cook and Stefanski 1994).

    It has added no less than the figure of noise alone: where a cell or two stick out by chance, noise once more seldom
    adds to that.
    """
    noise, cells = evaluator.noise.draw, evaluator.grid.delta
    return _bias(
        base, _drawn(evaluator, draws, noise, cells), _drawn(evaluator, ALONE_DRAWS, noise, np.zeros_like(cells))
    )


def _bias(base: Figures, drawn: Figures, alone: Figures) -> Bias:
    """What noise does to figures (by name, mm), of which it makes these when it is ``drawn`` on the cells, or stands
    ``alone``.
    """
    grows = [name for name in base if name.removesuffix(MEAN) in NEVER_NEGATIVE]
    lifted = {n: np.fmax(drawn[n].mean(axis=0) ** 2 - base[n] ** 2, alone[n].mean(axis=0) ** 2) for n in grows}
    added = {n: drawn[n].mean(axis=0) - base[n] for n in grows}
    return Bias(lifted, {n: stack.std(axis=0) for n, stack in drawn.items()}, added)


def steepness_of(evaluator: Evaluator) -> Figures:
    """Standard deviation (mm) of the figures from cells that are not known better than a flank rises in them."""
    unevenness = np.sqrt(evaluator.noise.unevenness)
    cells = evaluator.grid.delta
    drawn = _drawn(evaluator, STEEP_DRAWS, lambda rng: unevenness * rng.standard_normal(unevenness.shape), cells)
    return {name: stack.std(axis=0) for name, stack in drawn.items()}


def vibration_of(figures: Figures, corrected: Figures, evaluator: Evaluator) -> Figures:
    """U (k = 2, mm) of the ``corrected`` figures: what single flanks have along their profiles and others don't may be
    form of theirs, or none of the part's. ``figures``: as they are read.
    """
    if not evaluator.noise.of_profile:
        return {n: np.zeros_like(v) for n, v in figures.items()}
    noise, cells = evaluator.noise.draw_profiles, evaluator.grid.delta
    drawn = _drawn(evaluator, STEEP_DRAWS, noise, cells)
    bias = _bias(figures, drawn, _drawn(evaluator, ALONE_DRAWS, noise, np.zeros_like(cells)))
    U = {n: 2 * sd for n, sd in bias.sd.items()}
    lowest = bias.corrected({n: np.maximum(v - U[n], 0.0) if n in bias.lifted else v for n, v in corrected.items()})
    return {n: np.fmax(U[n], v - lowest[n]) for n, v in corrected.items()}


def roughness_of(corrected: Figures, evaluator: Evaluator) -> Figures:
    """U (k = 2, mm) of the ``corrected`` figures: what cells share with their neighbours may be the flanks', and a line
    over a flank has more of it than the cells do, which are means of places and stand aside of it. The largest of many
    values may be as large as both make it, and any other figure may be another by as much as the line is.
    """
    noise, cells = evaluator.noise, np.zeros_like(evaluator.grid.delta)
    if not noise.correlation.share:
        return {n: np.zeros_like(v) for n, v in corrected.items()}
    along_roll, along_height = (
        _drawn(evaluator, STEEP_DRAWS, partial(noise.draw_surface, along=axis), cells) for axis in (2, 3)
    )
    U = {}
    for name, value in corrected.items():
        plain = name.removesuffix(MEAN)
        drawn = (along_roll if plain in PROFILE_NAMES else along_height)[name]
        of_many = np.hypot(value, drawn.mean(axis=0)) - value
        U[name] = of_many if plain in NEVER_NEGATIVE else 2 * drawn.std(axis=0)
    return {name: np.zeros_like(U[name]) if name.endswith(AREAL) else U[name] for name in U}


def _drawn(evaluator: Evaluator, draws: int, noise: Callable[[np.random.Generator], Array], cells: Array) -> Figures:
    """The figures (draws, ...) with noise drawn on cells (2, teeth, roll lengths, heights)."""
    rng, delta = np.random.default_rng(1), np.nan_to_num(cells)
    drawn = [figures_of(evaluate(delta + noise(rng), evaluator), evaluator.grid.nominal) for _ in range(draws)]
    return {name: np.stack([figures[name] for figures in drawn]) for name in drawn[0]}
