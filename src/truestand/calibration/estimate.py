"""Gauss-Newton on surface cells, held by what is known beforehand."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from truestand.calibration.cells import Cells
from truestand.calibration.model import PLANE, Model, Prior, precision_of
from truestand.core.arrays import Array
from truestand.core.frames import UNKNOWNS
from truestand.core.robust import TUKEY, robust_sd, tukey_cost, tukey_weights

MOST_STEPS = 60
"""Where form and coaxiality are hardly told from the laser plane, the last steps shrink by a tenth each."""
MOST_ROUNDS = 12
"""Fits with the outliers that the one before leaves."""
SAME_TRUST = 0.02
"""By which the trust in any cell may change from one round to the next."""
TOLD_AGAIN = 3
"""Linear fits by which the data alone tell their outliers."""
MOST_HALVINGS_A_STEP, MOST_HALVINGS = 10, 30
"""Of one step and of all: a fit that must halve its steps that often is on its way to nowhere."""
SLACK = 1e-5
"""Cost, absolute and relative, that a step may add: near the end the linear model is as true as the cost."""
SETTLED = 1e-7
"""mm or rad: a tenth of a nanometre is still."""
NEGLIGIBLE_STEP = 1e-4
"""A step this small against the unknown's own standard uncertainty changes nothing that anyone could see."""
TOO_SHORT = 0.75
"""Share of what the slope promises that a step may lower the cost: at a parabola's lowest place it is a half, and where
it is more, the step ends far before (Goldstein's condition). Weights say how many cells hold the surface, not that some
hold it less the farther it is: where dirt covers a third, steps were a tenth of what they should be.
"""
MODEL_U = 1e-4
"""mm: the model is no truer than this, however many readings there are.

Seven million readings average to 3 nm. At that scale directions that the scan hardly sees (the laser plane's offset
under a centred shaft) would be read from what nobody modelled: the edges of a keyway, half a micrometre of dirt. With
this floor the priors decide there. What the scan does see is read with weights a thousand times the priors' own.
"""
ROUGH_MODEL_U = 5e-3
"""mm: the same from a start that is far off, with the waves of form not yet known. Read with a tenth of a micrometre of
noise, all of a surface but a sixth of a turn can be fitted by wrong waves to that tenth, and the sixth, 26 um off,
would count as not the shaft's.
"""


@dataclass(frozen=True, slots=True)
class Quadratic:
    """The data's half cost about some parameters (p,), to second order."""

    parameters: Array
    gradient: Array
    """(p,): zero at an estimate but for what the priors hold against."""
    information: Array
    """(p, p): normal matrix of the data alone."""

    def moved(self, p: Array) -> Self:
        """The same cost about other parameters (p,)."""
        return replace(self, parameters=p, gradient=self.gradient + self.information @ (p - self.parameters))


@dataclass(frozen=True, slots=True)
class Solution(Quadratic):
    """An estimate with all that later steps need of the cells."""

    residuals: Array
    """(n,) mm, one a cell."""
    weights: Array
    """(n,) 1/mm2: how much each cell counts."""
    noise: "Noise"
    steps: int = 0
    converged: bool = False
    stuck: bool = False
    """Given up, because steps had to be halved again and again."""


def gauss_newton(
    model: Model,
    cells: Cells,
    start: Array,
    priors: tuple[Prior, ...],
    settled: float = SETTLED,
    alike: bool = False,
) -> Solution:
    """Fit the model to the cells from ``start`` until no unknown of the geometry moves by more than ``settled``.

    The data's weight follows from its own residuals (robustly), so that priors and data are on one scale. Which cells
    are outliers the data alone say, and it is held while the fit goes on (``_told_by_data``). From a start that is far
    off nothing is told yet: there outliers are told anew at each step, and all cylinders are taken to be as noisy as
    the one that fits worst (``alike``).
    """
    precision = precision_of(priors, model.size)
    if alike:
        return _settled(model, cells, start, precision, settled)
    noise = _told_by_data(model, cells, start, precision)
    found = _settled(model, cells, start, precision, settled, noise)
    for _ in range(MOST_ROUNDS):
        told = _told_by_data(model, cells, found.parameters, precision)
        changed = told.trust(found.residuals, cells.weight) - noise.trust(found.residuals, cells.weight)
        if found.stuck or np.abs(changed).max() < SAME_TRUST:
            break
        noise, before = told, found
        found = _settled(model, cells, before.parameters, precision, settled, noise)
        found = replace(found, steps=max(before.steps, found.steps))
    return found


def linearised(model: Model, cells: Cells, p: Array, noise: "Noise | None" = None) -> Solution:
    """The data's cost about the parameters ``p``; the noise as it shows there if it is not given."""
    residuals, jacobian = model.linearised(p, cells.readings)
    noise = noise or _floored(_noise_of(residuals, cells, alike=True), residuals, cells.weight)
    weights = noise.weights(residuals, cells.weight)
    root = np.sqrt(weights)
    scaled = jacobian * root[:, None]  # times itself: BLAS works out one half only
    return Solution(p, scaled.T @ (root * residuals), scaled.T @ scaled, residuals, weights, noise)


def _settled(
    model: Model, cells: Cells, start: Array, precision: Array, settled: float, noise: "Noise | None" = None
) -> Solution:
    """Gauss-Newton until it settles, gives up or has taken its steps; by noise as each step shows it if not given."""
    at = linearised(model, cells, start, noise)
    converged = False
    steps = halvings = 0
    while not converged and steps < MOST_STEPS and halvings < MOST_HALVINGS:
        steps += 1
        normal = at.information + np.diag(precision)
        change = -solve(normal, at.gradient + precision * at.parameters)
        still = np.maximum(settled, NEGLIGIBLE_STEP * _standard_uncertainty(normal)[:UNKNOWNS])
        converged = bool(np.all(np.abs(change[:UNKNOWNS]) < still))
        if not converged:  # a step too small to matter is not worth another pass over all cells
            p, more = _improved(model, cells, at, change, precision)
            at = linearised(model, cells, p, noise)
            halvings += more
    return replace(at, steps=steps, converged=converged, stuck=halvings >= MOST_HALVINGS)


def _told_by_data(model: Model, cells: Cells, p: Array, precision: Array) -> "Noise":
    """The noise near the parameters ``p``, and how much each cell is to be trusted, as the data alone show it.

    All data together weigh no more than the model is true, and Tukey's cost of an outlier is bounded: on that scale a
    plane nearer to where its mounting has it is worth all cells of a surface, sound ones. So the outliers are those of
    a linear fit in which every reading has its full weight.
    """
    residuals, jacobian = model.linearised(p, cells.readings)
    left = residuals
    for _ in range(TOLD_AGAIN):
        weighted = jacobian * _noise_of(left, cells, alike=False).weights(left, cells.weight)[:, None]
        right = weighted.T @ residuals + precision * p
        left = residuals - jacobian @ solve(weighted.T @ jacobian + np.diag(precision), right)
    noise = _noise_of(left, cells, alike=False)
    return _floored(replace(noise, held=noise.trust(left, cells.weight)), left, cells.weight)


def _improved(model: Model, cells: Cells, at: Solution, change: Array, precision: Array) -> tuple[Array, int]:
    """The parameters after a step that lowers the robust cost, and how often it was halved for that.

    Under a nearly centred shaft the scan hardly sees the laser plane, and far along that direction the other unknowns
    follow in a curve (sag is quadratic). Where the straight step fails they are solved again for the new plane; where
    that fails too, the step is halved.
    """
    p, noise = at.parameters, at.noise
    start = noise.cost(at.residuals, cells.weight, p, precision)
    before = SLACK + (1.0 + SLACK) * start
    turned = model.turns(p, cells.readings)

    def cost(tried: Array) -> float:
        return noise.cost(model.residuals(tried, cells.readings, turned), cells.weight, tried, precision)

    for halvings in range(MOST_HALVINGS_A_STEP):
        tried = p + change
        if (reached := cost(tried)) <= before:
            promised = -2.0 * float(change @ (at.gradient + precision * p))
            farther = not halvings and start - reached > TOO_SHORT * promised
            return _farther(p, change, cost, reached) if farther else tried, halvings
        tried = _others_solved(model, cells, tried, noise, precision)
        if cost(tried) <= before:
            return tried, halvings
        change = change / 2
    return p + change, MOST_HALVINGS_A_STEP


def _farther(p: Array, change: Array, cost: Callable[[Array], float], reached: float) -> Array:
    """The parameters after a ``change`` from ``p`` doubled as long as that lowers the cost that it ``reached``."""
    while (twice := cost(p + 2 * change)) < reached:
        change, reached = 2 * change, twice
    return p + change


def _others_solved(model: Model, cells: Cells, p: Array, noise: "Noise", precision: Array) -> Array:
    """One Gauss-Newton step of all unknowns but the laser plane's."""
    residuals, jacobian = model.linearised(p, cells.readings)
    weighted = jacobian * noise.weights(residuals, cells.weight)[:, None]
    normal = weighted.T @ jacobian + np.diag(precision)
    others = np.setdiff1d(np.arange(p.size), PLANE)
    out = p.copy()
    out[others] -= solve(normal[np.ix_(others, others)], (weighted.T @ residuals + precision * p)[others])
    return out


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of the cells' readings, and the share of the data's weight that the model's floor leaves."""

    sd: Array
    """(n,) mm: of one reading of full weight, as the residuals on the cell's cylinder show it, and so much at least
    that the cell's own is MODEL_U."""
    share: float = 1.0
    held: Array | None = None
    """(n,) 0 to 1, the trust in each cell whatever its residual; None: Tukey's weight of that."""

    def ratio(self, residuals: Array, counts: Array) -> Array:
        """Residuals (n,) of cells of so many readings over the limit at which they have no weight."""
        return np.asarray(residuals * np.sqrt(counts) / (TUKEY * self.sd))

    def trust(self, residuals: Array, counts: Array) -> Array:
        """In each cell (n,), 0 to 1."""
        return tukey_weights(self.ratio(residuals, counts)) if self.held is None else self.held

    def weights(self, residuals: Array, counts: Array) -> Array:
        """Of each cell (n,) in 1/mm2."""
        return np.asarray(self.trust(residuals, counts) * counts * (self.share / self.sd**2))

    def cost(self, residuals: Array, counts: Array, p: Array, precision: Array) -> float:
        """What Gauss-Newton makes small: the cells' squares, or Tukey's cost of them, and the priors' squares."""
        if self.held is None:
            of_cells = self.share * tukey_cost(self.ratio(residuals, counts))
        else:
            of_cells = float(self.weights(residuals, counts) @ np.square(residuals))
        return of_cells + float(precision @ (p * p))


def _noise_of(residuals: Array, cells: Cells, alike: bool) -> Noise:
    """The noise from the residuals (n,) themselves, each reading with its full weight.

    Each cylinder by itself: one that has a wave of form of which the model doesn't know yet would show as outliers
    beside a smooth one, and the wave would never be found. No cell is truer than the model: without noise the least
    that a prior pulls would make outliers of cells, and what is left of them would be pulled the farther.

    From a start that is far off, each cylinder by itself goes astray: the one that happens to be fitted first seems
    true, all misfit of the others counts as their noise, and they have no say any more in where the shaft is. So there
    they are taken ``alike``: no cell is truer than those of the cylinder that fits worst, or than ROUGH_MODEL_U.
    """
    cylinder = cells.readings.cylinder
    surfaces = [cylinder == k for k in np.unique(cylinder)]
    truest = max(ROUGH_MODEL_U, *(robust_sd(residuals[on]) for on in surfaces)) if alike else MODEL_U
    sd = np.empty(residuals.size)
    for on in surfaces:
        root = np.sqrt(cells.weight[on])
        sd[on] = np.maximum(robust_sd(residuals[on] * root), truest * root)
    return Noise(sd)


def _floored(noise: Noise, residuals: Array, counts: Array) -> Noise:
    """The noise with a share by which all data together weigh no more than the model is true."""
    total = float(noise.weights(residuals, counts).sum())
    return replace(noise, share=min(1.0, 1.0 / MODEL_U**2 / max(total, 1e-300)))


def solve(matrix: Array, right: Array) -> Array:
    """Solve a normal system whose unknowns have very different units: scaled to a unit diagonal first."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix * scale[:, None] * scale[None, :]
    by_row = scale if right.ndim == 1 else scale[:, None]
    return np.asarray(np.linalg.lstsq(scaled, right * by_row, rcond=1e-13)[0] * by_row)


def _standard_uncertainty(normal: Array) -> Array:
    """Of each unknown (p,) if the normal matrix were the whole truth."""
    return np.asarray(np.sqrt(np.maximum(np.diag(solve(normal, np.eye(normal.shape[0]))), 0.0)))
