"""Gauss-Newton on surface cells, with what is known beforehand, and a covariance that knows repeated surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truestand.calibration.autocorrelation import shared_scatter, strands_of
from truestand.calibration.cells import Cells
from truestand.calibration.model import GEOMETRY, Model

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

MOST_STEPS = 30
MOST_HALVINGS = 10
SLACK = 1e-5
"""Cost, absolute and relative, that a step may add: near the end the linear model is as true as the cost."""
SETTLED = 1e-7
"""mm or rad: a tenth of a nanometre is still."""
STILL = 1e-4
"""A step this small against the unknown's own standard uncertainty changes nothing that anyone could see."""
TUKEY = 4.685
"""Tukey's constant: 95 % efficient for normal noise."""
MODEL_U = 1e-4
"""mm: the model is no truer than this, however many readings there are.

Seven million readings average to 3 nm. At that scale directions that the scan hardly sees (the laser plane's offset
under a centred shaft) would be read from what nobody modelled: the edges of a keyway, half a micrometre of dirt. With
this floor the priors decide there. What the scan does see is read with weights a thousand times the priors' own.
"""
PLANE = (GEOMETRY.index("plane_offset"), GEOMETRY.index("plane_tilt"))
PIN = 1e-7
"""mm or rad: an unknown held this tightly stays where it is and still tells how the others would follow it."""


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of some unknowns before the scan: index, standard uncertainty, under one name in the budget.

    Where ``considered``, the unknowns are held at zero in the fit and only their doubt is carried on (consider
    analysis): for what seven million readings seem to tell about them comes from effects that nobody modelled.
    """

    name: str
    index: tuple[int, ...]
    u: float
    considered: bool = False

    @property
    def tightness(self) -> float:
        """Precision with which the fit holds the unknowns, 1/unit2."""
        return 1.0 / (PIN if self.considered else self.u) ** 2


@dataclass(frozen=True, slots=True)
class Solution:
    """An estimate with its evidence."""

    parameters: Array
    residuals: Array
    """(n,) mm, one a cell."""
    weights: Array
    """(n,) 1/mm2: how much each cell counts."""
    information: Array
    """(p, p): normal matrix, priors included."""
    pull: Array
    """(p,): gradient of the data's cost; zero but for what the priors hold against."""
    scatter: Array
    """(p, p): spread of the data's pull, clustered by sector of the surface, with the sectors' common noise."""
    sd: float
    """mm: residual standard deviation of a reading of full weight, as far as cells tell."""
    steps: int
    converged: bool


def gauss_newton(
    model: Model, cells: Cells, start: Array, priors: tuple[Prior, ...], sectors: Ints, settled: float = SETTLED
) -> Solution:
    """Fit the model to the cells from ``start`` until no unknown of the geometry moves by more than ``settled``.

    The data's weight follows from its own residuals (robustly), so that priors and data are on one scale.
    ``sectors`` (n,) says which stretch of surface each cell belongs to: repeated turns see the same form and the same
    speckle, so a sector, not a cell, is the independent piece of evidence.
    """
    p = start.copy()
    precision = precision_of(priors, model.size)
    converged = False
    steps = 0
    while not converged and steps < MOST_STEPS:
        steps += 1
        residuals, jacobian = model.linearised(p, cells.readings)
        scale = _scale_of(residuals, cells.weight)
        weights = scale.weights(residuals, cells.weight)
        weighted = jacobian * weights[:, None]
        information = weighted.T @ jacobian + np.diag(precision)
        change = -solve(information, weighted.T @ residuals + precision * p)
        converged = bool(np.all(np.abs(change[:8]) < np.maximum(settled, STILL * _doubt(information)[:8])))
        if not converged:  # a step too small to matter is not worth another look at all cells
            p = _bettering(model, cells, p, change, residuals, scale, precision)
    scatter = scatter_of(weighted * residuals[:, None], sectors)
    count = len(model.radii)
    shared = None
    if settled == SETTLED:  # a first look needs no more than a rough scatter
        strands = strands_of(residuals, jacobian, weights, sectors // count, cells.bin)
        shared = shared_scatter(strands, model.orders)
    scatter = (scatter if shared is None else shared) * _bend(scale, residuals, cells.weight) ** 2 * cells.bend**2
    pull = weighted.T @ residuals
    return Solution(p, residuals, weights, information, pull, scatter, scale.sd, steps, converged)


def _bettering(
    model: Model, cells: Cells, p: Array, change: Array, residuals: Array, scale: "_Scale", precision: Array
) -> Array:
    """The parameters after a step that betters the robust cost.

    Under a nearly centred shaft the scan hardly sees the laser plane, and far along that direction the other unknowns
    follow in a curve (sag is quadratic). Where the straight step fails they are solved again for the new plane; where
    that fails too, the step is halved.
    """
    before = SLACK + (1.0 + SLACK) * scale.cost(residuals, cells.weight, p, precision)
    for _ in range(MOST_HALVINGS):
        tried = p + change
        if scale.cost(model.residuals(tried, cells.readings), cells.weight, tried, precision) <= before:
            return tried
        tried = _following(model, cells, tried, scale, precision)
        if scale.cost(model.residuals(tried, cells.readings), cells.weight, tried, precision) <= before:
            return tried
        change = change / 2
    return p + change


def _following(model: Model, cells: Cells, p: Array, scale: "_Scale", precision: Array) -> Array:
    """One Gauss-Newton step of all unknowns but the laser plane's."""
    residuals, jacobian = model.linearised(p, cells.readings)
    others = np.setdiff1d(np.arange(p.size), PLANE)
    weighted = jacobian[:, others] * scale.weights(residuals, cells.weight)[:, None]
    information = weighted.T @ jacobian[:, others] + np.diag(precision[others])
    out = p.copy()
    out[others] -= solve(information, weighted.T @ residuals + precision[others] * p[others])
    return out


@dataclass(frozen=True, slots=True)
class _Scale:
    """Noise of one reading of full weight (mm), and the share of the data's weight that the model's floor leaves."""

    sd: float
    share: float

    def weights(self, residuals: Array, counts: Array) -> Array:
        """Tukey's weights (n,) in 1/mm2."""
        ratio = residuals * np.sqrt(counts) / (TUKEY * self.sd)
        return np.asarray(np.square(np.maximum(1.0 - ratio * ratio, 0.0)) * counts * (self.share / self.sd**2))

    def cost(self, residuals: Array, counts: Array, p: Array, precision: Array) -> float:
        """What Gauss-Newton makes small: Tukey's cost of the cells and the priors' squares."""
        ratio = residuals * np.sqrt(counts) / (TUKEY * self.sd)
        left = np.maximum(1.0 - ratio * ratio, 0.0)
        return self.share * TUKEY**2 / 3.0 * float(np.sum(1.0 - left * left * left)) + float(precision @ (p * p))


def _bend(scale: "_Scale", residuals: Array, counts: Array) -> float:
    """How much more the estimate scatters than its weights say, as Tukey's pull bends back: mean weight over slope."""
    left = np.maximum(1.0 - np.square(residuals * np.sqrt(counts) / (TUKEY * scale.sd)), 0.0)
    weight, slope = float(counts @ (left * left)), float(counts @ (5.0 * left * left - 4.0 * left))
    return weight / max(slope, 0.5 * weight)


def covariance(solution: Solution, priors: tuple[Prior, ...]) -> dict[str, Array]:
    """Covariance (p, p) by its sources: ``noise`` from the data's scatter, and each prior under its name.

    Their sum is the whole: H^-1 (S + P u^2 P) H^-1, with H the normal matrix, S the scatter of the data's pull, P the
    tightness with which each prior holds its unknowns and u its standard uncertainty.
    """
    size = solution.parameters.size
    inverse = solve(solution.information, np.eye(size))
    parts = {"noise": inverse @ solution.scatter @ inverse.T}
    for prior in priors:
        rows = inverse[:, prior.index]
        part = rows @ rows.T * (prior.tightness * prior.u) ** 2
        parts[prior.name] = parts[prior.name] + part if prior.name in parts else part
    return parts


def precision_of(priors: tuple[Prior, ...], size: int) -> Array:
    """How tightly the priors hold each unknown (size,), 1/unit2."""
    precision = np.zeros(size)
    for prior in priors:
        precision[list(prior.index)] = prior.tightness
    return precision


def solve(matrix: Array, right: Array) -> Array:
    """Solve a normal system whose unknowns have very different units: scaled to a unit diagonal first."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix * scale[:, None] * scale[None, :]
    right_scaled = right * (scale if right.ndim == 1 else scale[:, None])
    solved = np.linalg.lstsq(scaled, right_scaled, rcond=1e-13)[0]
    return np.asarray(solved * (scale if right.ndim == 1 else scale[:, None]))


def _doubt(information: Array) -> Array:
    """Standard uncertainty (p,) of each unknown if the normal matrix were the whole truth."""
    return np.asarray(np.sqrt(np.maximum(np.diag(solve(information, np.eye(information.shape[0]))), 0.0)))


def _scale_of(residuals: Array, counts: Array) -> _Scale:
    """The noise from the residuals themselves; all data together weigh no more than the model is true."""
    sd = max(1.4826 * float(np.median(np.abs(residuals * np.sqrt(counts)))), 1e-7)
    total = float(_Scale(sd, 1.0).weights(residuals, counts).sum())
    return _Scale(sd, min(1.0, 1.0 / MODEL_U**2 / max(total, 1e-300)))


def scatter_of(pulls: Array, sectors: Ints) -> Array:
    """Sum over sectors of the outer product of each sector's whole pull (cluster-robust, Liang and Zeger 1986)."""
    count = int(sectors.max()) + 1
    order = np.argsort(sectors, kind="stable")
    starts = np.searchsorted(sectors[order], np.arange(count))
    starts = starts[np.diff(np.append(starts, sectors.size)) > 0]
    sums = np.add.reduceat(pulls[order], starts, axis=0)
    n, p = sums.shape
    return np.asarray(sums.T @ sums) * (n / max(n - p, 1) if n > 2 * p else 2.0)
