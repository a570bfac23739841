"""The exact fit: robust means over cells, Gauss-Newton, again with the noise now known."""

from dataclasses import dataclass, replace
from math import cos, hypot, sin

import numpy as np
from numpy.typing import NDArray

from truestand.calibration.cells import GROUPS_PER_TURN, Cells, Grid, make_grid, reduce
from truestand.calibration.estimate import SETTLED, TUKEY, Prior, Solution, covariance, gauss_newton
from truestand.calibration.model import GEOMETRY, Model
from truestand.calibration.priors import priors_for
from truestand.calibration.segment import Segments
from truestand.calibration.start import WHOLE, Mask, RoughStand, repeats_within
from truestand.core.artefact import Artefact
from truestand.core.errors import NotEnoughData
from truestand.core.frames import facing
from truestand.core.scan import Scan

Array = NDArray[np.float64]

FIRST_LIMIT = 0.3
"""mm: what the traces don't tell (plane, harmonics of single heights) and noise stay below this."""
REACH = 1.0
"""mm: readings within it of the predicted surface are the surface's, good or bad."""
LEAST_LIMIT = 0.012
"""mm: never reject what quantisation alone can do (three steps of 4 um)."""
FIRST_READINGS = 1_500_000
"""The first look takes about as many: it finds where the surface is and how noisy."""
FIRST_GROUPS_PER_TURN = 250
FIRST_SETTLED = 1e-5
"""mm or rad: still enough to collect the cells once more."""
CLEAN_ORDERS = 6
"""Harmonics of form that are looked at in any case where the whole circumference is the shaft's."""
MOST_ORDERS = 30
SIGNIFICANT = 4.0
"""A harmonic counts from this many times the median amplitude (noise alone passes that once in 65,000: 2^-16)."""
LEAST_HARMONIC = 5e-5
"""mm: smaller ones matter to nobody."""
NOTHING_SHOWN = 25.0
"""Chi-square of two unknowns up to which they are as stated. Not the 11.8 of three standard deviations: over one turn u
comes out 1.4 times too small (12 scans), and 11.8 frees them in one scan of twelve that has neither."""
STEEP_ENOUGH = 0.3
"""cos(phi) from which range resolves the position along the shaft, so that the static profile may run over range."""


@dataclass(frozen=True, slots=True)
class Refined:
    """The exact model's answer with everything it rests on."""

    model: Model
    segments: Segments
    grid: Grid
    cells: Cells
    solution: Solution
    priors: tuple[Prior, ...]
    limit: float
    """mm from the surface beyond which a reading had no weight."""
    foreign: Mask
    """(bands, SECTORS) stretches of each surface that are not the shaft's and were not looked at."""
    together: float = 0.0
    """Share of the profiles in which all surfaces left their waves at once."""
    overlap: float | None = None
    """mm rms by which repeated turns differ; None without a second turn."""


def refine(scan: Scan, segments: Segments, artefact: Artefact, start: RoughStand) -> Refined:
    """Fit the exact model to all trusted readings of all the artefact's cylinders."""
    model = _layout(scan, segments, artefact, start)
    few = _thinned(scan)
    begun = _Begun(model, segments, artefact, _start(model, segments, start), start.foreign)
    first = _solve(few, begun, FIRST_LIMIT, FIRST_SETTLED, FIRST_GROUPS_PER_TURN)
    first = _with_orders(few, artefact, first, _orders(first, few))
    limit = _noise_limit(first)
    second = _solve(scan, begun.going_on(first), limit)
    tighter = _noise_limit(second)
    if tighter <= 0.8 * limit:
        second = _solve(scan, begun.going_on(second), tighter)
    steady = _steady(scan, second)
    speed = float(steady.solution.parameters[GEOMETRY.index("speed")])
    return replace(steady, together=start.together, overlap=repeats_within(start, speed))


def refine_again(scan: Scan, artefact: Artefact, fit: Refined) -> Refined:
    """The fit once more from where it is, all readings looked at anew: for a model of which more is known now."""
    begun = _Begun(fit.model, fit.segments, artefact, fit.solution.parameters, fit.foreign)
    again = _steady(scan, _solve(scan, begun, fit.limit))
    return replace(again, together=fit.together, overlap=fit.overlap)


def _steady(scan: Scan, fit: Refined) -> Refined:
    """The fit with drift and table speed held as stated, their doubt considered, where the scan shows no others.

    Over a single turn the two take up each other's noise: free, they scatter the eccentricity by 0.05 um; held, by
    0.004, if the table does run as stated. From 5e-5 off its speed the scan shows it and they stay free.
    """
    both = [GEOMETRY.index("drift"), GEOMETRY.index("speed")]
    whole = np.asarray(sum(covariance(fit.solution, fit.priors).values()))[np.ix_(both, both)]
    found = fit.solution.parameters[both]
    if found @ np.linalg.solve(whole, found) > NOTHING_SHOWN:
        return fit
    doubt = dict(zip(both, np.sqrt(np.diag(whole)), strict=True))
    priors = tuple(
        replace(q, u=float(doubt[q.index[0]]), considered=True) if q.index[0] in doubt else q for q in fit.priors
    )
    start = fit.solution.parameters.copy()
    start[both] = 0.0
    solution = gauss_newton(fit.model, fit.cells, start, priors, sectors(scan, fit.grid, fit.cells))
    return replace(fit, solution=solution, priors=priors)


def _thinned(scan: Scan) -> Scan:
    """Every so many profiles of a long scan: enough for the first look."""
    every = slice(None, None, max(1, scan.x.size // FIRST_READINGS))
    return replace(scan, x=scan.x[every], z=scan.z[every], angle=scan.angle[every], time=None, counter=None)


@dataclass(frozen=True, slots=True)
class _Begun:
    """Where a fit starts from, and what it may look at."""

    model: Model
    segments: Segments
    artefact: Artefact
    parameters: Array
    foreign: Mask

    def going_on(self, fit: Refined) -> "_Begun":
        """The same from what a fit has found."""
        return replace(self, model=fit.model, parameters=fit.solution.parameters)


def _solve(
    scan: Scan, begun: _Begun, limit: float, settled: float = SETTLED, groups_per_turn: int = GROUPS_PER_TURN
) -> Refined:
    """Cells about the surface that the start predicts, and the model fitted to them."""
    model, segments = begun.model, begun.segments
    grid = make_grid(scan, segments.bands, groups_per_turn)
    cells = reduce(scan, model, begun.parameters, grid, limit, max(REACH, limit), begun.foreign)
    if cells.weight.size < 2 * model.size:
        raise NotEnoughData(
            f"found the artefact's surfaces in {cells.weight.size} cells of the scan, need {2 * model.size}; check the "
            "drawing, exposure and that nothing else turns in view"
        )
    priors = priors_for(model, scan, segments, begun.artefact)
    solution = gauss_newton(model, cells, begun.parameters, priors, sectors(scan, grid, cells), settled)
    return Refined(model, segments, grid, cells, solution, priors, limit, begun.foreign)


def _with_orders(scan: Scan, artefact: Artefact, fit: Refined, orders: int) -> Refined:
    """The model with form harmonics up to ``orders``, fitted to the same cells."""
    if orders == fit.model.orders:
        return fit
    model = replace(fit.model, orders=orders)
    start = _carry(fit.model, model, fit.solution.parameters)
    priors = priors_for(model, scan, fit.segments, artefact)
    solution = gauss_newton(model, fit.cells, start, priors, sectors(scan, fit.grid, fit.cells), FIRST_SETTLED)
    return replace(fit, model=model, solution=solution, priors=priors)


def sectors(scan: Scan, grid: Grid, cells: Cells) -> NDArray[np.intp]:
    """Which stretch of which cylinder each cell lies on, the same on every turn (n,)."""
    per_turn = max(1, round(scan.profiles / max(scan.revolutions, 1e-9) / grid.group))
    return (cells.group % per_turn) * len(grid.edges) + cells.readings.cylinder


def _layout(scan: Scan, segments: Segments, artefact: Artefact, start: RoughStand) -> Model:
    """The unknowns for what is seen of the artefact."""
    cylinders = [artefact.cylinders[b.cylinder] for b in segments.bands]
    phi, side = segments.phi, facing(segments.phi)
    over_range = abs(cos(phi)) > STEEP_ENOUGH
    axis = (0.0, 1.0) if over_range else (sin(phi), cos(phi))
    eccentricity = hypot(*start.eccentricity)
    spans = []
    for band, cylinder in zip(segments.bands, cylinders, strict=True):
        ends = np.array([band.low, band.high]) - segments.height
        if over_range:
            ends = cos(phi) * ends - side * sin(phi) * (cylinder.radius - start.radial)
            slack = eccentricity * abs(sin(phi)) + 0.1
        else:
            slack = 0.1
        spans.append((float(ends.min() - slack), float(ends.max() + slack)))
    return Model(
        radii=tuple(c.radius for c in cylinders),
        middles=tuple((b.low + b.high) / 2 for b in segments.bands),
        height=segments.height,
        start_angle=float(scan.angle[0]),
        orders=start.orders if start.foreign.any() else max(start.orders, CLEAN_ORDERS),
        static_axis=axis,
        static_spans=tuple(spans),
        level=int(np.argmax([b.high - b.low for b in segments.bands])),
    )


def _start(model: Model, segments: Segments, start: RoughStand) -> Array:
    p = np.zeros(model.size)
    at = GEOMETRY.index
    p[at("phi")], p[at("radial")], p[at("speed")] = segments.phi, start.radial, start.speed
    p[at("eccentricity_x")], p[at("eccentricity_y")] = start.eccentricity
    p[at("tilt_x")], p[at("tilt_y")] = start.tilt
    for k, wave in enumerate(start.waves):
        form = p[model.form_slice(k)].reshape(2, -1)
        # At table angle theta the sensor sees the surface at psi = -theta: sines change sign.
        form[0, : wave.cos.size - 1], form[1, : wave.sin.size - 1] = wave.cos[1:], -wave.sin[1:]
        p[model.form_slice(k)] = form.reshape(-1)
    return p


def _carry(before: Model, after: Model, parameters: Array) -> Array:
    """The parameters in a layout with other form harmonics."""
    p = np.zeros(after.size)
    common = before.form_slice(0).start
    p[:common] = parameters[:common]
    for k in range(len(before.radii)):
        old, new = parameters[before.form_slice(k)].reshape(2, -1), p[after.form_slice(k)].reshape(2, -1)
        n = min(old.shape[1], new.shape[1])
        new[:, :n] = old[:, :n]
        p[after.form_slice(k)] = new.reshape(-1)
    return p


def _orders(fit: Refined, scan: Scan) -> int:
    """Highest form harmonic that stands out of the residuals, if it is more than the majority of the traces needed."""
    if scan.revolutions < WHOLE:
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
        strong = candidates[(amplitude > SIGNIFICANT * np.median(amplitude)) & (amplitude > LEAST_HARMONIC)]
        highest = max(highest, int(strong.max(initial=0)))
    return highest


def _noise_limit(fit: Refined) -> float:
    """Where Tukey's weight ends for the noise seen in the cells and between them."""
    within = float(np.median(fit.cells.spread))
    on = fit.solution.weights > 0
    between = 1.4826 * float(np.median(np.abs(fit.solution.residuals[on]))) if on.any() else 0.0
    return max(TUKEY * hypot(within, between), LEAST_LIMIT)
