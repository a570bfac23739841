"""The reported quantities, by name, from what the flanks say; and what noise alone makes of each.

Shapes: () for the gear, (2,) for left and right flanks, (2, teeth) for each flank. mm.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truestand.gear.evaluate import Measures, Weighed, largest, pitch_extremes, smallest, trace_figures
from truestand.gear.geometry import SIGMA, Involute, pitch_span
from truestand.gear.grid import Grid

Array = NDArray[np.float64]
Figures = dict[str, Array]

PER_TOOTH = ("F_alpha", "f_falpha", "f_Halpha", "F_beta", "f_fbeta", "f_Hbeta")
MEANS = (*PER_TOOTH, "C_alpha", "C_beta")
PITCH = ("f_p", "F_p", "F_pk", "f_u")
NEVER_NEGATIVE = frozenset((*PITCH, "f_p_areal", "F_p_areal", "F_r", "F_alpha", "f_falpha", "F_beta", "f_fbeta"))
DRAWS = 64
AREAL, AREAL_NAMES = "_areal", ("f_p", "F_p")
"""Behind the name of a pitch figure from whole flanks, which a measuring circle doesn't have: told, not judged."""
MEAN = " mean"
"""Behind the name of a figure that is the mean over the teeth of a side."""


def figures_of(m: Measures, nominal: Involute) -> Figures:
    """Every reported quantity; a mean over the teeth has ``MEAN`` behind its name."""
    found: Figures = dict(pitch_extremes(m.index, pitch_span(nominal.gear)))
    areal = pitch_extremes(SIGMA[:, None] * m.area * nominal.arc_per_delta, pitch_span(nominal.gear))
    found |= {name + AREAL: areal[name] for name in AREAL_NAMES}
    for name in PER_TOOTH:
        found[name] = getattr(m, name)
    for name in MEANS:
        found[name + MEAN] = _mean(getattr(m, name))
    both = _mean(m.position).sum()
    ball = nominal.ball_diameter
    found["F_r"] = np.asarray(largest(m.runout) - smallest(m.runout))
    found["s"] = np.asarray(nominal.thickness + both * nominal.arc_per_delta)
    found["W_k"] = np.asarray(nominal.span + both * nominal.normal_per_delta)
    across = nominal.over_balls(ball) - ball
    centre = nominal.base_radius / np.cos(nominal.ball_angle(ball))
    found["M_d"] = np.asarray(ball + across * (1 + _mean(m.runout) / centre))
    return found


def _mean(values: Array) -> Array:
    """Mean over the last axis, NaN aside; NaN where there is nothing else."""
    number = np.isfinite(values).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(np.isfinite(values), values, 0.0).sum(axis=-1) / number)


def noise_of(m: Measures, weighed: Weighed, grid: Grid, nominal: Involute) -> tuple[Figures, Figures]:
    """What each figure reads with the noise once more on it, and its expanded uncertainty from noise (k = 2)."""
    drawn = [figures_of(d, nominal) for d in _draws(m, weighed, grid, nominal)]
    base = figures_of(m, nominal)
    more, U = {}, {}
    for name, value in base.items():
        stack = np.stack([d[name] for d in drawn])
        more[name] = np.maximum(stack.mean(axis=0), value)
        U[name] = 2 * stack.std(axis=0)
    return more, U


def corrected(base: Figures, noisier: Figures) -> Figures:
    """The figures without what noise lifts them by: the largest of many values reads too much even where all are zero.

    The square of a figure is extrapolated to no noise (as ``core.denoise`` does, Cook and Stefanski 1994).
    """
    return {
        n: np.sqrt(np.maximum(2 * v * v - noisier[n] ** 2, 0.0)) if n.removesuffix(MEAN) in NEVER_NEGATIVE else v
        for n, v in base.items()
    }


def position_u(m: Measures, weighed: Weighed) -> Array:
    """Standard uncertainty (2, teeth) of the tooth positions' delta from the scatter of the cells, mm.

    Cells of one height, and cells of one roll length, may share an error (speckle, one profile's angle): the larger of
    the two ways to bundle them counts (cluster-robust).
    """
    flanks = weighed.weight.shape[0]
    part = weighed.solver[:, 0, :] * np.nan_to_num(m.residual)
    part = part.reshape(flanks, *weighed.shape[2:])
    by_height, by_roll = (part.sum(axis=a) for a in (1, 2))
    u = np.sqrt(np.maximum((by_height**2).sum(axis=1), (by_roll**2).sum(axis=1)))
    return np.asarray(u.reshape(weighed.shape[:2]))


def _row_u(m: Measures, weighed: Weighed, axis: int) -> Array:
    """Standard uncertainty (flanks, n) of the points of a trace, mm."""
    flanks = weighed.weight.shape[0]
    on = (weighed.weight > 0).reshape(flanks, *weighed.shape[2:])
    rest = np.where(on, np.nan_to_num(m.residual).reshape(on.shape), 0.0)
    number = on.sum(axis=axis)
    spread = np.sqrt((rest**2).sum() / max(int(on.sum()), 1))
    return np.asarray(spread / np.sqrt(np.maximum(number, 1)))


def _draws(m: Measures, weighed: Weighed, grid: Grid, nominal: Involute) -> list[Measures]:
    rng = np.random.default_rng(1)
    u, across, along = position_u(m, weighed), _row_u(m, weighed, 2), _row_u(m, weighed, 1)
    touching = m.runout_per_delta
    shape = weighed.shape[:2]
    drawn = []
    for _ in range(DRAWS):
        off = u * rng.standard_normal(shape)
        ball = m.at_ball + off
        profile = m.profile + (across * rng.standard_normal(across.shape)).reshape(m.profile.shape)
        helix = m.helix + (along * rng.standard_normal(along.shape)).reshape(m.helix.shape)
        moved = replace(
            m,
            position=m.position + off,
            area=m.area + off,
            index=SIGMA[:, None] * (m.position + off) * nominal.arc_per_delta,
            at_ball=ball,
            runout=(ball[0] + np.roll(ball[1], -1)) * touching,
        )
        drawn.append(trace_figures(moved, profile, helix, weighed, grid, nominal))
    return drawn
