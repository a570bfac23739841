"""Each flank as a smooth surface: what damage and defects stand out of, and where a flank stands as a whole.

A quadratic in roll length and height for each flank, on top of a shape that all teeth share (so that different sampling
of that shape does not look like pitch). Cells that depart from both have less weight, or none. Figures of the standards
are read from the cells themselves (``traces``); from here come areal pitch, and what is worth naming.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.robust import TUKEY, nan_median, robust_sd, tukey_weights
from truestand.gear.geometry import Involute
from truestand.gear.grid import Grid

TERMS = 6
"""1, l, h, l^2, l h, h^2."""
HUBER = 1.345
ROUNDS = ((0, False), (3, False), (3, True), (3, True), (TERMS, True), (TERMS, True), (TERMS, True))
"""Of weighing: terms that are free (0: the flank's median), and whether far cells are left out (Tukey) or only held
back (Huber). A flank that is free to lean and bend from the start leans and bends towards a step in it.
"""
PASSES = 2
"""In which the shared shape and the flanks' own are told apart."""
LEAST_TEETH = 4
"""Teeth whose median says what all of them share."""
LEAST_CELLS = 40
"""Cells that a flank's quadratic needs."""
LEAST_SPREAD = 2e-4
"""mm: the scatter of cells about their surface is not taken for less."""


@dataclass(frozen=True)
class SmoothFlanks:
    """Which cells bear the smooth flanks out, and how the flanks follow from them."""

    grid: Grid
    weight: Array
    """(2 teeth, cells) 0..1; 0 where nothing was seen, or outside the evaluation ranges."""
    basis: Array
    """(2 teeth, cells, TERMS)."""
    solver: Array
    """(2 teeth, TERMS, cells): coefficients from cells; NaN for a flank that can't carry them."""
    share: Array
    """(2, teeth, cells) 0..1 of each flank in the mean tooth of its side; 0 for a flank without coefficients,"""
    shared_basis: Array
    """and the same of its basis: (2, teeth TERMS, cells)."""
    shared_terms: Array
    """(2, teeth TERMS, teeth TERMS): what the terms of the flanks of a side, as far as they share them, add to each,"""
    shared_levels: Array
    """(2, teeth TERMS, teeth): and what their levels do."""

    @cached_property
    def near_circle(self) -> tuple[Mask, Array, Array]:
        """The cells (cells,) near the measuring circle; weights (2, teeth, those cells) of the mean over those of each
        flank that count; and what the terms of all flanks of a side, as far as they share them, are in it: (2, teeth,
        teeth TERMS).
        """
        grid = self.grid
        near = np.repeat(np.abs(grid.rolls - grid.nominal.measuring_roll) < 3 * grid.size[0], grid.heights.size)
        on = (self.weight > 0).reshape(self.share.shape)[:, :, near]
        mean = on / np.maximum(on.sum(axis=2, keepdims=True), 1)
        return near, mean, mean @ self.shared_basis[:, :, near].swapaxes(1, 2)


def smooth_flanks(grid: Grid, whole_flank: bool = False) -> SmoothFlanks:
    """The smooth flanks by Tukey's biweight, from the cells inside the evaluation ranges.

    ``whole_flank``: from those outside, too.
    """
    flanks, cells = 2 * grid.delta.shape[1], grid.rolls.size * grid.heights.size
    wanted = np.isfinite(grid.delta) if whole_flank else np.isfinite(grid.delta) & grid.in_ranges
    values, inside = grid.delta.reshape(flanks, cells), wanted.reshape(flanks, cells)
    basis = _basis(grid).reshape(flanks, cells, TERMS)
    weight, shared = inside.astype(np.float64), np.zeros(values.shape)
    for terms, leaves_out in ROUNDS:
        rest = _own_rest(values - shared, basis[:, :, :terms], weight)
        of_all = _median_tooth(np.where(weight > 0, rest, np.nan), grid.delta.shape)
        shared, residual = shared + of_all, np.nan_to_num(rest - of_all)
        spread = max(robust_sd(residual[inside]) if inside.any() else 0.0, LEAST_SPREAD)
        ratio = np.where(inside, np.abs(residual), 0.0) / spread
        far = tukey_weights(ratio / TUKEY) if leaves_out else HUBER / np.maximum(ratio, HUBER)
        weight = np.where(inside, far, 0.0)
    solver = _solver(basis, weight)
    share = _share(np.where(np.isfinite(solver[:, 0]), weight, 0.0).reshape(*grid.delta.shape[:2], cells))
    of_sides = share.shape[0], -1, cells
    shared_basis = (share.reshape(flanks, 1, cells) * basis.swapaxes(1, 2)).reshape(of_sides)
    by_side = np.nan_to_num(solver).reshape(of_sides)
    shared_terms, shared_levels = by_side @ shared_basis.swapaxes(1, 2), by_side @ share.swapaxes(1, 2)
    return SmoothFlanks(grid, weight, basis, solver, share, shared_basis, shared_terms, shared_levels)


def _share(weight: Array) -> Array:
    """Of weights (sides, teeth, cells), in their sum over the teeth; 0 where that is 0."""
    total = weight.sum(axis=1, keepdims=True)
    return np.asarray(weight / np.where(total > 0, total, 1.0))


def residuals(delta: Array, smooth: SmoothFlanks) -> Array:
    """What flanks and shared shape leave of the cells (2, teeth, roll lengths, heights), with weight or without."""
    return delta - smooth_surface(delta, smooth)


def smooth_surface(delta: Array, smooth: SmoothFlanks) -> Array:
    """Flanks and shared shape as cells (2, teeth, roll lengths, heights) mm say, seen or not; NaN for no such flank."""
    mean, c = _fit(delta, smooth)
    own = _times(smooth.basis, c).reshape(smooth.share.shape)
    return np.asarray((_shared(mean, c, smooth)[:, None] + own).reshape(delta.shape))


def shared_shape(delta: Array, smooth: SmoothFlanks, least: int = 1) -> Array:
    """What all teeth of a side share (2, roll lengths, heights) mm; NaN where fewer than ``least`` were seen."""
    counts = (smooth.weight > 0).reshape(delta.shape).sum(axis=1) >= least
    return np.where(counts, _shared(*_fit(delta, smooth), smooth).reshape(counts.shape), np.nan)


def areal_positions(delta: Array, smooth: SmoothFlanks) -> Array:
    """delta (2, teeth) mm of each smooth flank, mean over its evaluation area, NaN where not seen."""
    mean, c = _fit(delta, smooth)
    near, weights, terms = smooth.near_circle
    shared = _times(weights, mean[:, near]) - _times(terms, np.nan_to_num(c).reshape(len(mean), -1))
    return np.asarray((c @ _area_means(smooth.grid.nominal)).reshape(delta.shape[:2]) + shared)


def _fit(delta: Array, smooth: SmoothFlanks) -> tuple[Array, Array]:
    """The mean tooth (2, cells) of each side, and coefficients (flanks, TERMS).

    What all teeth share must not depend on where each of them was met, so it is told from their own terms in turns.
    """
    values = np.where(smooth.weight > 0, delta.reshape(smooth.weight.shape), 0.0)
    by_tooth = values.reshape(smooth.share.shape)
    mean = np.einsum("stc,stc->sc", smooth.share, by_tooth)
    level = np.einsum("fc,fc->f", smooth.weight, values) / np.maximum(smooth.weight.sum(axis=1), 1e-9)
    alone = _times(smooth.solver, (by_tooth - mean[:, None]).reshape(values.shape)).reshape(len(mean), -1)
    own = alone + _times(smooth.shared_levels, level.reshape(len(mean), -1))
    for _ in range(PASSES):
        own = alone + _times(smooth.shared_terms, np.nan_to_num(own))
    return mean, own.reshape(-1, TERMS)


def _shared(mean: Array, c: Array, smooth: SmoothFlanks) -> Array:
    """The shape that all teeth of a side share (2, cells): the mean tooth less the terms of each."""
    own = np.nan_to_num(c).reshape(len(mean), -1)
    return np.asarray(mean - _times(smooth.shared_basis.swapaxes(1, 2), own))


def _reduced_roll(roll: Array | float, nominal: Involute) -> Array:
    return np.asarray((roll - nominal.measuring_roll) / (nominal.control_length / 2))


def _reduced_height(height: Array | float, nominal: Involute) -> Array:
    return np.asarray((height - nominal.middle) / (nominal.gear.face_width / 2))


def _basis(grid: Grid) -> Array:
    """1, l, h, l^2, lh, h^2 about the measuring circle and the middle of the face."""
    el, h = _reduced_roll(grid.roll, grid.nominal), _reduced_height(grid.height, grid.nominal)
    return np.stack([np.ones(el.shape), el, h, el * el, el * h, h * h], axis=-1)


def _solver(basis: Array, weight: Array) -> Array:
    """(flanks, terms, cells) of a basis (flanks, cells, terms); NaN for a flank of too few cells, or all on a line."""
    weighted = (basis * weight[:, :, None]).swapaxes(1, 2)
    normal = weighted @ basis
    low, *_, high = np.moveaxis(np.linalg.eigvalsh(np.nan_to_num(normal)), -1, 0)
    able = (np.count_nonzero(weight, axis=1) >= LEAST_CELLS) & (high < 1e9 * low)
    normal[~able] = np.eye(basis.shape[2])
    solver = np.linalg.inv(normal) @ weighted
    solver[~able] = np.nan
    return np.asarray(solver)


def _times(matrices: Array, vectors: Array) -> Array:
    """Each flank's matrix (flanks, n, m) times its vector (flanks, m): (flanks, n)."""
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])


def _own_rest(values: Array, basis: Array, weight: Array) -> Array:
    """What the terms of a ``basis`` (flanks, cells, terms) leave of each flank's values; without terms, its median."""
    filled = np.where(np.isfinite(values), values, 0.0)
    if basis.shape[2]:
        return filled - _times(basis, _times(_solver(basis, weight), filled))
    return np.asarray(filled - nan_median(np.where(weight > 0, values, np.nan), axis=1)[:, None])


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
