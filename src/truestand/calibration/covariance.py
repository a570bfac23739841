"""How well the estimate is known: the covariance of the data's score, and of the unknowns by source.

The score (weighted residuals times Jacobian) is summed over sectors of the surface, because repeated turns see the
same form and the same speckle: a sector, not a cell, is the independent piece of evidence, as long as neighbours err
independently. Where they don't (vibration, air, electronics), the noise of a cell is taken as one part of its own and
one that all cells of a profile share, each with its spectrum over waves a turn. What a cell has of its own is seen at
every wave; what all share is hidden at few waves, where the fit takes it for form, and is carried down from above as
first-order autoregressive noise on a white floor (Whittle 1953).
"""

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np

from truestand.calibration.cells import Cells
from truestand.calibration.estimate import Quadratic, Solution, solve
from truestand.calibration.model import COAXIALITY, MOUNTING, Model, Prior, precision_of
from truestand.core.arrays import Array, Ints
from truestand.core.robust import m_estimator_correction, tukey_slopes

CORRELATIONS = np.concatenate([[0.0], 1.0 - np.geomspace(0.9, 0.005, 40)])
"""AR(1) coefficients between neighbouring sectors that are tried."""
FLOORS = np.array([0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.98])
"""Shares of white noise that are tried."""
LEAST_GAIN = 9.0
"""Twice the log-likelihood that correlation must gain: less comes up in white noise."""
LEAST_SECTORS = 60
FITTED_PER_WAVE = 2
"""Unknowns of each of the slowest waves that the fit takes out: offset and slope over height."""
MOUNTING_LEFT = 1e-2
"""Share of the mounting prior's precision that stays on, so that a plane that nobody sees has a number at all."""
SHARP = 0.2
"""Share of the mounting's variance at which a reading of the plane has taken half of the mounting's say. A sharper one
would gain next to nothing from it, and be drawn towards zero; no variance grows by more than 4.3 % by that."""
MOST_WEIGHINGS = 4
WEIGHED = 1e-6
"""mm or rad: unknowns that move by less are weighed where they are."""


def score_covariance(model: Model, cells: Cells, solution: Solution, priors: tuple[Prior, ...]) -> Array:
    """Covariance (p, p) of the data's score at a solution.

    What the steps' own axes would explain of the residuals is no noise: it stands in U as their coaxiality, and the
    next scan of the shaft has it as well.
    """
    residuals, jacobian = model.linearised(solution.parameters, cells.readings)
    residuals = residuals + jacobian @ _to_own_axes(solution, priors)
    sector = cells.group % cells.groups_per_turn
    means, slopes = _sector_series(residuals, jacobian, solution.weights, sector, cells.bin)
    scores = _correlated(means, slopes, model.orders)
    if scores is None:
        surface = sector * len(model.radii) + cells.readings.cylinder
        scores = clustered(jacobian * (solution.weights * residuals)[:, None], surface)
    return scores * robust_correction(cells, solution) ** 2


def _to_own_axes(data: Quadratic, priors: tuple[Prior, ...]) -> Array:
    """How far the unknowns (p,) would go if nothing held the steps coaxial."""
    precision = precision_of(tuple(q for q in priors if q.name != COAXIALITY), data.parameters.size)
    return -solve(data.information + np.diag(precision), data.gradient + precision * data.parameters)


def robust_correction(cells: Cells, solution: Solution) -> float:
    """How much more the unknowns move with the residuals than the weights of readings and cells say
    (``m_estimator_correction``): where dirt covers much of a surface, those near its limit pull less the farther off
    they are.
    """
    robust = solution.noise.trust(solution.residuals, cells.weight)
    of_cells = m_estimator_correction(float(cells.weight @ robust), float(cells.weight @ tukey_slopes(robust)))
    return of_cells * cells.correction


def clustered(scores: Array, sectors: Ints) -> Array:
    """Sum over sectors of the outer product of each sector's whole score (n, p) (Liang and Zeger 1986): (p, p)."""
    sums = np.stack([np.bincount(sectors, column) for column in scores.T], axis=1)[np.bincount(sectors) > 0]
    n, p = sums.shape
    return np.asarray(sums.T @ sums) * (n / max(n - p, 1) if n > 2 * p else 2.0)


def _sector_series(residuals: Array, jacobian: Array, weights: Array, sector: Ints, bins: Ints) -> tuple[Array, Array]:
    """Residuals (S, B) and Jacobian (S, B, p) by sector and bin of height, all turns together, scaled to unit noise.

    Of cells (n,): residuals mm, jacobian (n, p), weights 1/mm2, their stretch of table angle and bin of height.
    """
    shape = (int(sector.max()) + 1, int(bins.max()) + 1)
    cell, size = sector * shape[1] + bins, shape[0] * shape[1]
    mass = np.bincount(cell, weights, size)
    unit: Array = np.where(mass > 0, 1.0 / np.sqrt(np.maximum(mass, 1e-300)), 0.0)
    flat, *slopes = (np.bincount(cell, weights * column, size) * unit for column in (residuals, *jacobian.T))
    return flat.reshape(shape), np.stack(slopes, axis=1).reshape(*shape, -1)


def _correlated(residuals: Array, jacobian: Array, orders: int) -> Array | None:
    """Covariance (p, p) of the score from noise that is correlated along the sectors; None where it is not.

    ``orders``: highest wave a turn that the fit takes for form.
    """
    count, bins = residuals.shape
    if count < LEAST_SECTORS or 2 * orders + 2 > count // 2 or bins < 2 * FITTED_PER_WAVE:
        return None
    waves = np.fft.rfft(residuals, axis=0)
    seen = np.count_nonzero(residuals) / residuals.size
    own = np.square(np.abs(waves)).mean(axis=1) / (count * seen)
    shared = np.square(np.abs(waves.sum(axis=1))) / (count * bins * seen)
    above = slice(orders + 1, -1)
    red_own, red_shared = _red(own[1:-1], count, 1, bins), _red(shared[above], count, orders + 1, 1)
    if red_own is None and red_shared is None:
        return None
    own[: orders + 1] *= bins / (bins - FITTED_PER_WAVE)
    own = _smoothed(own)
    common = np.zeros(own.size)
    if red_shared is not None:
        common = np.maximum(red_shared - own, 0.0) / bins
        if common[above].mean() * bins < 0.2 * own[above].mean():  # what chance makes of independent series
            common[:] = 0.0
    both = np.full(own.size, 2.0)
    both[0] = both[-1] = 1.0
    slopes = np.fft.rfft(jacobian, axis=0)
    each = (slopes * np.sqrt(both * own / count)[:, None, None]).reshape(-1, slopes.shape[2])
    alike = slopes.sum(axis=1) * np.sqrt(both * common / count)[:, None]
    return np.asarray((each.conj().T @ each).real + (alike.conj().T @ alike).real)


def _red(power: Array, count: int, first: int, averaged: int) -> Array | None:
    """The autoregressive spectrum (count // 2 + 1,) that fits the power from wave ``first`` on; None if white does."""
    wave = np.arange(count // 2 + 1)
    rho, floor = CORRELATIONS[:, None, None], FLOORS[None, :, None]
    red = (1.0 - rho**2) / (1.0 + rho**2 - 2.0 * rho * np.cos(2.0 * np.pi * wave / count))
    models = ((1.0 - floor) * red + floor).reshape(-1, wave.size)
    inside = models[:, first : first + power.size]
    scale = (power / inside).mean(axis=1)
    cost = 2.0 * averaged * (np.log(inside).sum(axis=1) + power.size * np.log(scale))
    best = int(np.argmin(cost))
    return None if cost[0] - cost[best] < LEAST_GAIN else np.asarray(models[best] * scale[best])


def _smoothed(power: Array) -> Array:
    """Means over bands of waves that double in width; the mean radius is taken to err as the slowest wave does."""
    smooth = power.copy()
    low = 1
    while low < power.size:
        high = min(max(low + 1, 2 * low - (low > 2)), power.size)
        smooth[low:high] = power[low:high].mean()
        low = high
    smooth[0] = smooth[1]
    return smooth


def covariance(information: Array, scores: Array, priors: tuple[Prior, ...]) -> dict[str, Array]:
    """Covariance (p, p) of the unknowns by source: ``noise`` from the data's score, each prior under its name.

    Their sum is the whole: H^-1 (S + P u^2 P) H^-1, with H the data's information (p, p) and the priors' precision P,
    S the score's covariance, and u each prior's standard uncertainty.
    """
    size = information.shape[0]
    inverse = solve(information + np.diag(precision_of(priors, size)), np.eye(size))
    parts = {"noise": inverse @ scores @ inverse.T}
    for prior in priors:
        rows = inverse[:, prior.index]
        part = rows @ rows.T * (prior.precision * prior.u) ** 2
        parts[prior.name] = parts[prior.name] + part if prior.name in parts else part
    return parts


class Fit(Protocol):
    """Of one view or of all: the data's cost, the covariance of its score, and what is known beforehand."""

    @property
    def solution(self) -> Quadratic:
        """(p,) unknowns."""

    @property
    def score_covariance(self) -> Array:
        """(p, p)."""

    @property
    def priors(self) -> tuple[Prior, ...]:
        """Of the unknowns."""


AnyFit = TypeVar("AnyFit", bound=Fit)


def weighed(fit: AnyFit, about: Callable[[Array], AnyFit], plane_identifiable: bool) -> tuple[AnyFit, dict[str, Array]]:
    """A fit about where the mountings leave it (``_weigh``), and the covariance (p, p) of its unknowns by source.

    ``about``: the same fit with the data's cost about other parameters. Where the scan hardly sees a laser plane that
    goes far, and the others follow in a curve (sag is quadratic): so it is weighed again from there.
    """
    for _ in range(MOST_WEIGHINGS):
        before = fit.solution.parameters
        p, parts = _weigh(fit.solution, fit.score_covariance, fit.priors, plane_identifiable)
        fit = about(p)
        if np.abs(p - before).max() < WEIGHED:
            break
    return fit, parts


def _weigh(
    data: Quadratic, scores: Array, priors: tuple[Prior, ...], plane_identifiable: bool
) -> tuple[Array, dict[str, Array]]:
    """Combine what the data read of the laser plane with its mounting prior: Kalman's update of two numbers a view.

    The parameters (p,) and their covariance (p, p) by source; the sum of the parts is the whole. ``scores`` (p, p): of
    the data.

    The fit reads offset d and tilt alpha from how the two steps' first harmonics differ, as if the steps were coaxial.
    What the certificate leaves open on coaxiality makes that reading uncertain, the more so the smaller the
    eccentricity. So the reading (d, alpha) is combined with the mounting prior, each with its covariance, and the other
    unknowns follow. Where the plane is not identifiable, only the mounting counts.

    The fit was held by that prior at the model's floor, to keep it from running away under a centred shaft; that hold
    is taken off first, so that the prior counts once, against what the reading is really worth.
    """
    p, size = data.parameters, data.parameters.size
    mountings = [q for q in priors if q.name == MOUNTING]
    planes = [i for q in mountings for i in q.index]
    others = tuple(q for q in priors if q.name != MOUNTING)
    left, stated = MOUNTING_LEFT * precision_of(mountings, size), precision_of(others, size)
    information = data.information + np.diag(left)
    normal = information + np.diag(stated)
    released = p - solve(normal, data.gradient + (left + stated) * p)
    parts = covariance(information, scores, others)
    reading = np.asarray(sum(parts.values()))[np.ix_(planes, planes)]
    mounting = np.diag([q.u**2 for q in mountings for _ in q.index])
    gain = np.zeros_like(mounting)
    if plane_identifiable:
        blunt = mounting + SHARP * mounting @ np.linalg.solve(reading, mounting)
        gain = blunt @ np.linalg.inv(blunt + reading)
    move = _followers(normal, planes) @ (gain - np.eye(len(planes)))
    transfer = np.eye(size)
    transfer[:, planes] += move
    weighed = {name: transfer @ part @ transfer.T for name, part in parts.items()}
    return transfer @ released, weighed | {MOUNTING: move @ mounting @ move.T}


def _followers(normal: Array, planes: list[int]) -> Array:
    """How every unknown follows the laser planes' (p, planes), from the normal matrix (p, p)."""
    size = normal.shape[0]
    others = [i for i in range(size) if i not in planes]
    follow = np.zeros((size, len(planes)))
    follow[others] = -solve(normal[np.ix_(others, others)], normal[np.ix_(others, planes)])
    follow[planes] = np.eye(len(planes))
    return follow
