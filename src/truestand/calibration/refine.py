"""The exact fit: robust means over cells, Gauss-Newton, again with the noise now known."""

from dataclasses import dataclass, field, replace
from math import hypot

import numpy as np

from truestand.calibration.cells import Cells, robust_cells
from truestand.calibration.covariance import covariance, score_covariance
from truestand.calibration.estimate import SETTLED, Solution, gauss_newton, linearised, solve
from truestand.calibration.model import (
    DRIFT,
    SPEED,
    STRETCH,
    Model,
    Prior,
    carried,
    model_for,
    precision_of,
    priors_for,
    start_values,
)
from truestand.calibration.segment import Segments
from truestand.calibration.start import WHOLE_TURN, RoughStand, repeats_within
from truestand.core.arrays import Array, Mask
from truestand.core.artefact import Artefact
from truestand.core.assumptions import BEARING_U, K
from truestand.core.errors import NotEnoughData
from truestand.core.frames import PHI, RADIAL, LaserPlane
from truestand.core.harmonics import shared_waves
from truestand.core.robust import TUKEY, robust_sd
from truestand.core.scan import Scan

FIRST_LIMIT_MM = 0.3
"""What the traces don't tell (plane, harmonics of single heights) and noise mostly stay below this."""
STILL = 0.2
"""Share of the limit by which the surface may lie off the place about which its cells were collected."""
MOST_COLLECTIONS = 5
REACH_MM = 1.0
"""Readings within it of the predicted surface are the surface's, good or bad."""
LEAST_LIMIT_MM = 0.012
"""Never reject what quantisation alone can do (three steps of 4 um)."""
FIRST_READINGS = 750_000
"""The first fit takes about as many: it finds where the surface is and how noisy."""
FIRST_SETTLED = 1e-5
"""mm or rad: still enough to collect the cells once more."""
MOST_ORDERS = 30
SIGNIFICANT = 4.0
"""A harmonic counts from this many times the median amplitude (noise alone passes that once in 65,000: 2^-16)."""
LEAST_HARMONIC_MM = 5e-5
"""Smaller ones change no result that is reported."""
MOST_CHI_SQUARE = 25.0
"""Chi-square of unknowns up to which they are as stated. Not the 11.8 of three standard deviations: over one turn u
comes out 1.4 times too small (12 scans), and 11.8 frees them in one scan of twelve that has neither."""


@dataclass(frozen=True, slots=True)
class Refined:
    """The exact model's answer with everything it rests on."""

    model: Model
    segments: Segments
    cells: Cells
    solution: Solution
    priors: tuple[Prior, ...]
    limit: Array
    """(cylinders,) mm from the surface beyond which a reading had no weight."""
    outliers: Mask
    """(bands, SECTORS) stretches of each surface that are not the shaft's and were not used."""
    score_covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(p, p): of the data's score, for the solution's covariance by source."""
    common_outliers: float = 0.0
    """Share of the profiles in which all surfaces left their waves at once."""
    overlap: float | None = None
    """mm rms by which repeated turns differ; None without a second turn."""
    height_u: float | None = None
    """mm, standard: how well another scan repeats height 0; None where no face or edge tells it."""

    @property
    def plane(self) -> LaserPlane:
        """u across the rotation axis, counted from it; v above height 0."""
        p = self.solution.parameters
        return LaserPlane(float(p[PHI]), float(p[RADIAL]), self.model.height)

    @property
    def covariance(self) -> dict[str, Array]:
        """Of the unknowns (p, p), by source."""
        return covariance(self.solution.information, self.score_covariance, self.priors)

    def about(self, p: Array) -> "Refined":
        """The fit with the parameters ``p`` and the data's cost about them; noise and outliers stay as they are."""
        s = self.solution
        there = linearised(self.model, self.cells, p, s.noise)
        there = replace(there, steps=s.steps, converged=s.converged, stuck=s.stuck)
        # Of a plane that is hardly seen, the score of elsewhere would not vanish where the data say nothing.
        scores = score_covariance(self.model, self.cells, there, self.priors)
        return replace(self, solution=there, score_covariance=scores)

    def following(self, patterns: Array, held: tuple[int, ...] = ()) -> Array:
        """How far the unknowns (p, k) move for patterns (n, k) mm in the residuals, those ``held`` not at all.

        Several scans fitted together have more unknowns than the model of this one.
        """
        s, own = self.solution, self.model.size
        _, jacobian = self.model.linearised(s.parameters[:own], self.cells.readings)
        size = s.information.shape[0]
        gradient, moves = np.zeros((2, size, patterns.shape[1]))
        gradient[:own] = jacobian.T @ (s.weights[:, None] * patterns)
        free = np.setdiff1d(np.arange(size), held)
        normal = s.information + np.diag(precision_of(self.priors, size))
        moves[free] = solve(normal[np.ix_(free, free)], gradient[free])
        return np.asarray(moves)

    def held_by(self, priors: tuple[Prior, ...]) -> "Refined":
        """The fit under other priors: one linear step from the data's own cost."""
        s = self.solution
        normal = s.information + np.diag(precision_of(priors, self.model.size))
        p = solve(normal, s.information @ s.parameters - s.gradient)
        return replace(self, priors=priors, solution=s.moved(p))


@dataclass(frozen=True, slots=True)
class _View:
    """What is fitted to, and which stretches of it are not used."""

    scan: Scan
    segments: Segments
    artefact: Artefact
    outliers: Mask


def refine(scan: Scan, segments: Segments, artefact: Artefact, start: RoughStand) -> Refined:
    """Fit the exact model to all trusted readings of all the artefact's cylinders.

    Where the fit to a part of the readings gives up, all of them are not tried: the solution says so.

    Raises:
        NotEnoughData: the surfaces show in too few cells.
    """
    view = _View(scan, segments, artefact, start.outliers)
    model = model_for(scan, segments, artefact, start)
    few = replace(view, scan=scan.taken(slice(None, None, max(1, scan.x.size // FIRST_READINGS))))
    rough = start_values(model, segments, start)
    # Free from the start, stretch lets one surface explain all of a plane that is far off, the other being noise.
    in_step = tuple(
        replace(q, considered=True) if q.name == STRETCH else q for q in priors_for(model, scan, segments, artefact)
    )
    limit = np.full(len(model.radii), FIRST_LIMIT_MM)
    first = _fit(few, model, rough, limit, FIRST_SETTLED, in_step, alike=True)
    first = _with_orders(few, first, _orders(first, few.scan))
    fit = _steady(_with_covariance(first if first.solution.stuck else _narrowed(view, first)))
    speed = float(fit.solution.parameters[SPEED])
    return replace(fit, common_outliers=start.common_outliers, overlap=repeats_within(start, speed))


def refine_again(scan: Scan, artefact: Artefact, fit: Refined) -> Refined:
    """The fit once more from where it is, with all readings reduced anew: for a model of which more is known now.

    What was held as stated stays so.
    """
    view = _View(scan, fit.segments, artefact, fit.outliers)
    again = _with_covariance(_fit(view, fit.model, fit.solution.parameters, fit.limit, priors=fit.priors))
    return replace(again, common_outliers=fit.common_outliers, overlap=fit.overlap)


def _narrowed(view: _View, first: Refined) -> Refined:
    """The fit to all readings, trusted as far as the noise goes that the fit before has shown."""
    limit = _noise_limit(first)
    second = _fit(view, first.model, first.solution.parameters, limit)
    tighter = _noise_limit(second)
    if (tighter > 0.8 * limit).all() or second.solution.stuck:
        return second
    return _fit(view, second.model, second.solution.parameters, tighter)


def _with_covariance(fit: Refined) -> Refined:
    return replace(fit, score_covariance=score_covariance(fit.model, fit.cells, fit.solution, fit.priors))


def _steady(fit: Refined) -> Refined:
    """The fit with drift and table speed held as stated, and with a bearing as good as most, where the scan shows no
    others.

    Over a single turn drift and speed take up each other's noise: free, they scatter the eccentricity by 0.05 um; held,
    by 0.004, if the table does run as stated. From 5e-5 off its speed the scan shows it and they stay free. Slow waves
    of the bearing, free, take up the noise of the laser plane's offset.
    """
    steady = (DRIFT, SPEED)
    if not _shown(fit, steady):
        covariance = np.diag(np.asarray(sum(fit.covariance.values())))
        fit = _with_u(fit, {at: float(np.sqrt(covariance[at])) for at in steady}, considered=True)
    bearing = fit.model.bearing_slice
    waves = tuple(range(bearing.start, bearing.stop))
    if waves and not _shown(fit, waves):
        # What all surfaces share may be the bearing's nevertheless.
        u = np.tile(np.maximum(_shared(fit), BEARING_U) / K, 2)
        fit = _with_u(fit, dict(zip(waves, u.tolist(), strict=True)))
    return fit


def _shown(fit: Refined, unknowns: tuple[int, ...]) -> bool:
    """Whether the scan shows that these are not zero."""
    covariance = np.asarray(sum(fit.covariance.values()))[np.ix_(unknowns, unknowns)]
    estimate = fit.solution.parameters[list(unknowns)]
    return bool(estimate @ np.linalg.solve(covariance, estimate) > MOST_CHI_SQUARE)


def _with_u(fit: Refined, u: dict[int, float], considered: bool = False) -> Refined:
    """The fit with other standard uncertainties ``u`` of some unknowns beforehand."""
    priors: list[Prior] = []
    for prior in fit.priors:
        others = tuple(at for at in prior.index if at not in u)
        priors += [replace(prior, index=others)] if others else []
        priors += [replace(prior, index=(at,), u=u[at], considered=considered) for at in prior.index if at in u]
    return fit.held_by(tuple(priors))


def _shared(fit: Refined) -> Array:
    """Amplitude (orders - 1,) mm of each wave of form that all surfaces have alike."""
    forms = [fit.solution.parameters[fit.model.form_slice(k)].reshape(2, -1) for k in range(len(fit.model.radii))]
    waves = np.array([cosines + 1j * sines for cosines, sines in forms])
    return shared_waves(waves) if len(waves) > 1 else np.zeros(waves.shape[1])


def _fit(
    view: _View,
    model: Model,
    parameters: Array,
    limit: Array,
    settled: float = SETTLED,
    priors: tuple[Prior, ...] | None = None,
    alike: bool = False,
) -> Refined:
    """The model fitted to cells about the surface that the parameters predict, collected again where it moves away.

    Readings beyond the limit have no weight: about a surface that is far off, sound ones are left out, and the fit
    bends itself to the rest.
    """
    priors = priors or priors_for(model, view.scan, view.segments, view.artefact)
    for _ in range(MOST_COLLECTIONS):
        cells = _cells(view, model, parameters, limit)
        solution = gauss_newton(model, cells, parameters, priors, settled, alike)
        moved = model.residuals(parameters, cells.readings) - solution.residuals
        parameters = solution.parameters
        if solution.stuck or (np.abs(moved) < STILL * limit[cells.readings.cylinder]).all():
            break
    return Refined(model, view.segments, cells, solution, priors, limit, view.outliers)


def _cells(view: _View, model: Model, parameters: Array, limit: Array) -> Cells:
    """The cells about the surface that the parameters predict.

    Raises:
        NotEnoughData: too few of them.
    """
    reach = max(REACH_MM, float(limit.max()))
    cells = robust_cells(view.scan, view.segments.bands, model, parameters, limit, reach, view.outliers)
    if cells.weight.size < 2 * model.size:
        raise NotEnoughData(
            f"found the artefact's surfaces in {cells.weight.size} cells of the scan, need {2 * model.size}; check the "
            "drawing, exposure and that nothing else turns in view"
        )
    return cells


def _with_orders(view: _View, fit: Refined, orders: int) -> Refined:
    """The model with form harmonics up to ``orders``, fitted to the same cells."""
    if orders == fit.model.orders:
        return fit
    model = replace(fit.model, orders=orders)
    priors = priors_for(model, view.scan, view.segments, view.artefact)
    start = carried(fit.model, model, fit.solution.parameters)
    return replace(
        fit,
        model=model,
        priors=priors,
        solution=gauss_newton(model, fit.cells, start, priors, FIRST_SETTLED, alike=True),
    )


def _orders(fit: Refined, scan: Scan) -> int:
    """Highest form harmonic that stands out of the residuals, if it is more than the majority of the traces needed."""
    if scan.revolutions < WHOLE_TURN:
        return fit.model.orders
    residuals, readings = fit.solution.residuals, fit.cells.readings
    psi = fit.model.angle(fit.solution.parameters, readings.angle)
    highest = fit.model.orders
    candidates = np.arange(highest + 1, MOST_ORDERS + 1)
    for k in range(len(fit.model.radii)):
        on = (readings.cylinder == k) & (fit.solution.weights > 0)
        waves = np.exp(1j * np.multiply.outer(candidates, psi[on]))
        weights = fit.solution.weights[on]
        amplitude = 2 * np.abs(waves @ (weights * residuals[on])) / max(weights.sum(), 1e-300)
        strong = candidates[(amplitude > SIGNIFICANT * np.median(amplitude)) & (amplitude > LEAST_HARMONIC_MM)]
        highest = max(highest, int(strong.max(initial=0)))
    return highest


def _noise_limit(fit: Refined) -> Array:
    """Where Tukey's weight ends on each cylinder (cylinders,) for the noise seen in its cells and between them.

    One limit for all would cut a noisy one off about the surface that is predicted, and draw it there.
    """
    limits = np.full(len(fit.model.radii), LEAST_LIMIT_MM)
    for k in range(limits.size):
        on = fit.cells.readings.cylinder == k
        used = on & (fit.solution.weights > 0)
        within = float(np.median(fit.cells.spread[on])) if on.any() else 0.0
        between = robust_sd(fit.solution.residuals[used]) if used.any() else 0.0
        limits[k] = max(TUKEY * hypot(within, between), LEAST_LIMIT_MM)
    return limits
