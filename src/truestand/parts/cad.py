"""A part compared with its CAD model: how far each reading lies off it, along the ray that saw it.

The calibrated sensor's own rays are cast onto the model, so that what the sensor can't see is not on_model, and a
reading belongs to the surface that its ray should have hit and not to the nearest one. Several views are one cloud: the
model is fitted to all of their readings, and each of its patches has the mean of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import degrees, hypot, sqrt, tau

import numpy as np

from truestand.apply.datum import Datum, datum_of
from truestand.core.arrays import Array, Ints
from truestand.core.assumptions import ASSUMED, HEIGHT_ZERO, SLOPE_INCIDENCE_U
from truestand.core.calibration import Contribution
from truestand.core.frames import Pose
from truestand.core.inspection import (
    EDITION,
    GUARD_FACTOR,
    Characteristic,
    Inspection,
    Seam,
    contradictions,
    decided,
    status_of,
)
from truestand.core.message import Message
from truestand.core.surface import Surface
from truestand.parts.drawings import Cad
from truestand.parts.patches import Grid, Patches, Readings, farthest, patches_of
from truestand.parts.rays import Rays, Solid, hits_near, solid_of
from truestand.parts.registration import Registration, motions, register, registration_remarks
from truestand.parts.views import PartView, PartViews, largest, views_of
from truestand.parts.visibility import coverage_of, unconfirmed_regions
from truestand.statistics.noise import cleared
from truestand.uncertainty import lines as budget_lines

BLOCK = 256
"""Profiles cast at once."""
REGISTRATION_READINGS = 40_000
"""Readings that place the model."""
COVERAGE_READINGS = 120_000
"""Readings that show what was seen."""
PATCH = 0.5
"""mm: edge of a patch, in height, radius, and around at the model's outside."""
READINGS_PER_PATCH = 16
"""On average; where there are fewer, patches are larger."""
GRID_MARGIN = 0.01
"""mm beyond the model that the grid covers: readings are sorted by where they belong on it."""
MOST_PATCHES = 3_000_000
"""Cells of the grid, most of them empty; larger parts have larger patches."""
STATISTICS = ("deviation_p95", "deviation_rms", "deviation_max", "deviation_min", "profile")
EXTREMES = np.array([False, False, True, True, True])
"""Of them, those that are maxima, or twice one."""
WITHIN = "shape within a patch"
LEAST_SEAM = 30
"""Patches that two views must both show to be held against each other."""
NOTICEABLE_HEIGHT = 0.05
"""mm (U, k = 2) of the height between views below which nothing is said."""
MOST_REGIONS = 12
"""Regions that the remarks name."""
INCIDENCE = f"incidence on steep surfaces{ASSUMED}"
"""Of range: the laser's spot grows and shifts with the tangent of the incidence."""
STEEP_TANGENT = 3.0**0.5
"""Tangent of these 60 degrees."""


@dataclass(frozen=True, slots=True)
class CadEvidence:
    """What the report draws: a map of deviations over polar angle (A,) rad and height (H,) mm about the datum axis."""

    angle: Array
    height: Array
    deviation: Array
    """(H, A) mm, normal, positive outwards: of the patches at that angle and height, whatever their radius, the one
    that deviates most; NaN = nothing of the model seen there."""
    shaft_from_model: Array
    """(4, 4): where the model was found to stand in C."""
    rotation: float
    """rad: against the recipe's pose, ccw from above."""
    visible: float
    """Share of the model's surface that the sensor could see."""


@dataclass(frozen=True, slots=True)
class _Comparison:
    """What all views saw and the model that it is compared with."""

    part: Cad
    views: PartViews
    datum: Datum
    solid: Solid


def inspect_cad(surface: Surface | Sequence[Surface], part: Cad) -> Inspection:
    """Deviations of the part from its model, after the fit that the recipe allows, with U (k = 2) and verdict.

    The pose of the recipe places the model about the datum axis. Statistics are taken on patches of the surface, less
    noise's share (``statistics.noise``); coverage is the share of the visible surface that has readings. Several views
    in one frame (``roll_views``) are one cloud; where they overlap they are held against each other.

    Raises:
        NotEnoughData: a model without surface.
        BadRecipe: a surface without its scan and calibration, or a datum that the shaft doesn't have.
    """
    views = views_of(surface)
    datum = datum_of(views.first.calibration, part.datum, part.bore_clearance)
    solid = solid_of(part.mesh, part.pose)
    comparison = _Comparison(part, views, datum, solid)
    registration = register(solid, _thinned(comparison, REGISTRATION_READINGS, datum.pose), part.fit, part.reach)
    model_from_shaft = registration.pose @ datum.pose
    grid = _grid(comparison)
    deviation, on_model = _compare(comparison, model_from_shaft, grid)
    patches = patches_of(grid, on_model, part.reach)
    marked = _points_on_model(comparison, model_from_shaft)
    coverage, visible = coverage_of(solid, model_from_shaft, views.each, marked)
    found = _characteristics(comparison, registration, model_from_shaft, patches, on_model, coverage)
    unconfirmed = unconfirmed_regions(solid, model_from_shaft, views.each, part.reach) if marked.size else ()
    seams = _seams(comparison, model_from_shaft, grid, on_model)
    shaft_from_model = (model_from_shaft.inverse @ Pose.from_matrix(part.pose)).matrix
    evidence = CadEvidence(grid.angle, grid.height, _most(patches), shaft_from_model, registration.angle, visible)
    return Inspection(
        "cad", part.name, _confirmed(found, unconfirmed), reasons=(*views.reasons, *contradictions(seams)),
        remarks=(*_remarks(comparison, registration, patches, visible), *_region_remarks(unconfirmed)),
        settings=_settings(comparison, registration, grid), deviation=deviation, evidence=evidence,
        seams=seams,
    )  # fmt: skip


def _confirmed(lines: tuple[Characteristic, ...], unconfirmed: tuple[str, ...]) -> tuple[Characteristic, ...]:
    """The lines, undecided at least where model surface was not confirmed: what the part does there isn't known."""
    if not unconfirmed:
        return lines
    return tuple(
        replace(c, verdict="undecided" if c.verdict == "conforms" else c.verdict, reason=unconfirmed[0]) for c in lines
    )


def _region_remarks(unconfirmed: tuple[str, ...]) -> tuple[Message, ...]:
    named = tuple(Message("not_confirmed", text) for text in unconfirmed[:MOST_REGIONS])
    more = len(unconfirmed) - MOST_REGIONS
    return (*named, Message("more_not_confirmed", f"{more} more regions are not confirmed")) if more > 0 else named


def _settings(comparison: _Comparison, registration: Registration, grid: Grid) -> dict[str, str]:
    return {
        "datum": f"{comparison.datum.name}: {comparison.datum.remark}",
        "fit": f"{comparison.part.fit}; turned by {degrees(registration.angle):.4f} deg against the recipe's pose",
        "deviation": "along the sensor's ray, turned into the normal of the model's triangle; positive outwards",
        "patches": f"robust means over cells of {_edge(grid):.2g} mm in height, radius and around",
        "reach": f"readings farther than {comparison.part.reach:g} mm from the model along their ray are no part of it",
        "profile": "twice the largest deviation to either side, of patches",
        "noise": "its share is taken off by extrapolation to none (SIMEX)",
        "decision rule": f"{EDITION}, guard band {GUARD_FACTOR:g} u",
    }


def _remarks(
    comparison: _Comparison, registration: Registration, patches: Patches, visible: float
) -> tuple[Message, ...]:
    whom = "the sensor" if len(comparison.views.each) == 1 else "the sensors"
    remarks = [
        Message("datum", f"datum: {comparison.datum.remark}"),
        Message("visible", f"{visible:.0%} of the model's surface is visible to {whom}; coverage counts that part"),
        Message("noise", f"noise {1000 * patches.scatter:.2g} um a reading"),
        *registration_remarks(registration),
    ]
    if (U := comparison.views.heights_known) > NOTICEABLE_HEIGHT:
        text = (
            f"heights between the views are known to {1000 * U:.0f} um only, and so is where the surfaces of one lie "
            "against those of another: let both see the shoulder, or draw what one of them sees"
        )
        remarks.append(Message("heights_between_views", text))
    if any(view.calibration.covariance.size == 0 for view in comparison.views.each):
        text = "the calibration carries no covariance: no U can be told, nothing is decided"
        remarks.append(Message("no_covariance", text))
    return tuple(remarks)


def _rays(comparison: _Comparison, rows: slice | Ints, pose: Pose, columns: slice | Ints) -> tuple[Rays, Ints]:
    """The readings of some profiles through ``pose``, their directions, and where they stand among these profiles'."""
    surface = comparison.views.surface
    x, y, z = (a[rows][:, columns] for a in (surface.x, surface.y, surface.z))
    seen = np.flatnonzero(np.isfinite(z))
    points = pose(np.stack([x.ravel()[seen], y.ravel()[seen], z.ravel()[seen]], axis=-1))
    origins = pose(comparison.views.origins[rows])
    directions = points - np.repeat(origins, np.isfinite(z).sum(axis=1), axis=0)
    directions /= np.sqrt(np.einsum("ij,ij->i", directions, directions))[:, None]
    return Rays(points, directions), seen


def _thinned(comparison: _Comparison, count: int, pose: Pose) -> Rays:
    """About ``count`` readings, spread over profiles and points alike."""
    n, m = comparison.views.surface.x.shape
    share = min(1.0, (count / max(n * m * comparison.views.seen, 1.0)) ** 0.5)
    rows, columns = (np.unique(np.linspace(0, k - 1, max(int(k * share), 2)).astype(np.intp)) for k in (n, m))
    rays, _ = _rays(comparison, rows, pose, columns)
    return rays


def _points_on_model(comparison: _Comparison, model_from_shaft: Pose) -> Array:
    """Readings (n, 3) mm that belong to the model, thinned."""
    rays = _thinned(comparison, COVERAGE_READINGS, model_from_shaft)
    hits = hits_near(comparison.solid, rays, comparison.part.reach)
    return np.asarray(rays.points[hits.triangle >= 0])


def _grid(comparison: _Comparison) -> Grid:
    """Patches about the datum axis over the model and what lies within its reach."""
    solid = comparison.solid
    low, high, outer = float(solid.low[2]) - GRID_MARGIN, float(solid.high[2]) + GRID_MARGIN, solid.outer + GRID_MARGIN
    area = float(solid.area.sum()) / 2  # some half of it is seen
    readings = max(comparison.views.surface.x.size * comparison.views.seen, 1.0)
    edge = max(
        PATCH,
        sqrt(READINGS_PER_PATCH * area / readings),
        (tau * outer * outer * (high - low) / MOST_PATCHES) ** (1 / 3),
    )
    heights, angles, radii = (max(1, round(extent / edge)) for extent in (high - low, tau * outer, outer))
    return Grid(low, high, heights, angles, radii, outer)


def _edge(grid: Grid) -> float:
    return (grid.high - grid.low) / grid.heights


def _most(patches: Patches) -> Array:
    """(H, A) mm: along the radius, the patch that deviates most."""
    size = np.where(patches.seen, np.abs(patches.mean), -1.0)
    return np.asarray(np.take_along_axis(patches.mean, size.argmax(axis=2)[:, :, None], axis=2)[:, :, 0])


def _compare(comparison: _Comparison, model_from_shaft: Pose, grid: Grid) -> tuple[Array, Readings]:
    """Deviation (N, M) mm of every reading, NaN off the model, and the readings on it."""
    n, m = comparison.views.surface.x.shape
    deviation = np.full((n, m), np.nan)
    flats, cells = [], []
    for first in range(0, n, BLOCK):
        rows = slice(first, min(first + BLOCK, n))
        rays, seen = _rays(comparison, rows, model_from_shaft, slice(None))
        hits = hits_near(comparison.solid, rays, comparison.part.reach)
        deviation[rows].ravel()[seen] = hits.deviation
        on = np.flatnonzero(hits.triangle >= 0)
        # By where they belong on the model: by their own place, noise would sort them with the deviation's sign.
        points = rays.points[on] - hits.deviation[on, None] * comparison.solid.normal[hits.triangle[on]]
        flats.append(seen[on] + first * m)
        psi, radius = np.arctan2(points[:, 1], points[:, 0]), np.hypot(points[:, 0], points[:, 1])
        cells.append(grid.cells(psi, points[:, 2], radius))
    deviation.flags.writeable = False
    flat = np.concatenate(flats)
    return deviation, Readings(flat, deviation.ravel()[flat], np.concatenate(cells))


def _statistics(maps: Array) -> Array:
    """p95, rms, largest and smallest from the median, largest absolute: (..., 5) mm of maps (..., n)."""
    middle = np.median(maps, axis=-1)
    size = np.abs(maps)
    return np.stack(
        [
            np.quantile(size, 0.95, axis=-1), np.sqrt(np.mean(np.square(maps), axis=-1)),
            maps.max(axis=-1) - middle, middle - maps.min(axis=-1), size.max(axis=-1),
        ],
        axis=-1,
    )  # fmt: skip


def _values(statistics: Array, middle: float) -> Array:
    """The reported characteristics from the statistics, each of which grows with noise from zero."""
    p95, rms, above, below, largest = statistics
    return np.array([p95, rms, middle + above, middle - below, 2 * largest])


def _characteristics(
    comparison: _Comparison,
    registration: Registration,
    model_from_shaft: Pose,
    patches: Patches,
    on_model: Readings,
    coverage: float,
) -> tuple[Characteristic, ...]:
    at = np.flatnonzero(patches.pick.ravel() >= 0)
    status = status_of(coverage)
    if not at.size or status == "not_measurable":
        return tuple(_line(comparison, name, None, None, coverage) for name in STATISTICS)
    maps = patches.mean.ravel()[at]
    clear = cleared(_statistics, maps, patches.noise.ravel()[at], EXTREMES)
    value = _values(clear.value, float(np.median(maps)))
    beyond = _beyond_means(patches, on_model, value)
    U = _budgets(
        comparison, registration, model_from_shaft, on_model.flat[patches.pick.ravel()[at]], maps, clear.u, beyond
    )
    return tuple(
        _line(comparison, name, float(value[i]), None if U is None else U[i], coverage)
        for i, name in enumerate(STATISTICS)
    )


def _beyond_means(patches: Patches, on_model: Readings, value: Array) -> Array:
    """By how much (5,) mm the characteristics may grow where single places lie farther out than the patches' means."""
    low, high = farthest(patches, on_model)
    missed = [0.0, 0.0, high - value[2], value[3] - low, 2 * max(-low, high) - value[4]]
    return np.maximum(missed, 0.0)


def _line(
    comparison: _Comparison,
    name: str,
    value: float | None,
    budget: tuple[tuple[Contribution, ...], float] | None,
    coverage: float,
) -> Characteristic:
    lines, U = budget if budget is not None else ((), None)
    whole = Characteristic(
        name, value, U, limits=_limits(comparison.part, name), coverage=coverage, status=status_of(coverage),
        standard="ISO 1101 profile of a surface" if name == "profile" else None, budget=lines,
        views=comparison.views.names,
    )  # fmt: skip
    if budget is None:
        return decided(whole)
    # What lies within patches can only be farther out: where the means fail already, it takes nothing back.
    means = decided(replace(whole, U=budget_lines.together([c for c in lines if c.name != WITHIN])[1]))
    found = decided(whole)
    if means.verdict != "does_not_conform" or found.verdict == means.verdict:
        return found
    reason = "the means of patches are beyond the limit; what may lie farther out within them makes U wider"
    return replace(means, U=U, reason=reason)


def _limits(part: Cad, name: str) -> tuple[float | None, float | None] | None:
    """Limits of the largest and smallest deviation; of the profile, where the drawing's zone lies evenly."""
    if part.limits is None:
        return None
    lower, upper = part.limits
    even = abs(lower + upper) < 1e-9
    if name == "deviation_max":
        return None, upper
    if name == "deviation_min":
        return lower, None
    return (None, 2 * upper) if name == "profile" and even else None


def _budgets(
    comparison: _Comparison,
    registration: Registration,
    model_from_shaft: Pose,
    flat: Ints,
    maps: Array,
    noise: Array,
    beyond: Array,
) -> list[tuple[tuple[Contribution, ...], float]] | None:
    """Lines and U of each characteristic; None where the calibration's own uncertainty is not known."""
    rays, normal = _normals(comparison, model_from_shaft, flat)
    points, directions, facing = rays.points, rays.directions, normal @ model_from_shaft.rotation
    views = comparison.views
    moves = views.moves(flat, facing)
    if moves is None:
        return None
    jacobian, names = motions(comparison.part.fit, points, normal, np.median(points, axis=0))
    fitted = [i for i, name in enumerate(names) if name not in registration.free_motions]
    heights = views.first.calibration.height_known / budget_lines.K * facing[None, :, 2]

    def known(lifts: Array) -> Array:
        return budget_lines.spread_of(_changes(maps, lifts - _taken_up(jacobian[:, fitted], lifts)))

    of_height, of_view = known(heights), {name: known(lifts) for name, lifts in moves.items()}
    steep = float(np.sqrt(np.quantile(1.0 - np.square(np.einsum("ij,ij->i", normal, directions)), 0.95)))
    in_shaft = model_from_shaft.inverse(points)
    radius, height = np.hypot(in_shaft[:, 0], in_shaft[:, 1]), float(np.median(in_shaft[:, 2]))
    arm = float(np.quantile(np.abs(in_shaft[:, 0] * facing[:, 1] - in_shaft[:, 1] * facing[:, 0]), 0.95))
    budgets = []
    for i, name in enumerate(STATISTICS):
        factor = 2.0 if name == "profile" else 1.0
        lines = [
            *(budget_lines.line(line, float(U[i])) for line, U in of_view.items()),
            budget_lines.line(HEIGHT_ZERO, float(of_height[i]), "rectangular"),
            budget_lines.line(budget_lines.NOISE, factor * budget_lines.K * float(noise[i])),
            budget_lines.line(INCIDENCE, factor * SLOPE_INCIDENCE_U / STEEP_TANGENT * steep),
            budget_lines.line(WITHIN, 2 / sqrt(3.0) * float(beyond[i]), "rectangular"),
            *largest(_of_view(view, comparison, factor, float(radius.max()), arm) for view in comparison.views.each),
            *_of_datum(comparison, factor, height),
        ]
        budgets.append(budget_lines.together(lines))
    return budgets


def _normals(comparison: _Comparison, model_from_shaft: Pose, flat: Ints) -> tuple[Rays, Array]:
    """Readings (n,) on the model, in its frame, and the normals (n, 3) of the triangles that their rays hit."""
    surface = comparison.views.surface
    row, column = np.divmod(flat, surface.x.shape[1])
    points = model_from_shaft(np.stack([a[row, column] for a in (surface.x, surface.y, surface.z)], axis=-1))
    directions = points - model_from_shaft(comparison.views.origins[row])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    rays = Rays(points, directions)
    hits = hits_near(comparison.solid, rays, comparison.part.reach)
    return rays, np.where((hits.triangle >= 0)[:, None], comparison.solid.normal[hits.triangle], 0.0)


def _of_view(view: PartView, comparison: _Comparison, factor: float, radius: float, arm: float) -> list[Contribution]:
    """What sensor and table add; ``radius`` of the part's outside, and the arm with which it turns, mm."""
    calibration, fit = view.calibration, comparison.part.fit
    turning = calibration.eccentricity + (radius if fit == "none" else 0.0)
    return [
        budget_lines.artefact_line(calibration, factor / 2),
        budget_lines.stability_line(calibration, view.scan, factor),
        budget_lines.temperature_line(factor * radius, comparison.part.temperature),
        budget_lines.bearing_line(calibration, factor),
        budget_lines.zero_line(turning, factor),
        budget_lines.angle_line(view.scan, factor * arm),
    ]


def _of_datum(comparison: _Comparison, factor: float, height: float) -> list[Contribution]:
    """What the datum leaves open; a free fit takes up where the axis stands."""
    lines = [] if comparison.part.fit == "all" else comparison.datum.lines(height)
    return [budget_lines.line(c.name, factor * c.U, c.distribution) for c in lines]


def _seams(comparison: _Comparison, model_from_shaft: Pose, grid: Grid, on_model: Readings) -> tuple[Seam, ...]:
    """By how much views differ on the patches that both show: the median, along the normal."""
    views = comparison.views
    of, shown = views.view_of(on_model.flat // views.surface.x.shape[1]), []
    for k in range(len(views.each) if len(views.each) > 1 else 0):
        own = of == k
        readings = Readings(on_model.flat[own], on_model.deviation[own], on_model.cell[own])
        shown.append((readings, patches_of(grid, readings, comparison.part.reach)))
    found = []
    for a, b in combinations(range(len(shown)), 2):
        apart = shown[a][1].mean - shown[b][1].mean
        both = np.isfinite(apart)
        picked = [readings.flat[patches.pick[both]] for readings, patches in (shown[a], shown[b])]
        U = _seam_known(comparison, model_from_shaft, (a, b), picked) if both.sum() >= LEAST_SEAM else None
        if U is not None:
            difference = float(np.median(apart[both]))
            found.append(Seam.between((views.each[a].name, views.each[b].name), difference, U))
    return tuple(found)


def _seam_known(
    comparison: _Comparison, model_from_shaft: Pose, of: tuple[int, int], flats: Sequence[Ints]
) -> float | None:
    """U (mm, k = 2) of the mean difference of two views on readings (n,) of each; None where it is not known."""
    means, stability = [], []
    for k, flat in zip(of, flats, strict=True):
        view = comparison.views.each[k]
        _, normal = _normals(comparison, model_from_shaft, flat)
        moves = comparison.views.moves(flat, normal @ model_from_shaft.rotation)
        if moves is None:
            return None
        means.append({name: lifts.mean(axis=1) for name, lifts in moves.items()})
        stability.append(budget_lines.stability_line(view.calibration, view.scan, 1.0))
    apart = [budget_lines.K * float(np.linalg.norm(mean - means[1][name])) for name, mean in means[0].items()]
    return hypot(*apart, *(line.U for line in stability))


def _taken_up(jacobian: Array, lifts: Array) -> Array:
    """The share of lifts (k, n) that the fit takes up, by least squares of its motions (n, m)."""
    return np.asarray((jacobian @ np.linalg.lstsq(jacobian, lifts.T, rcond=1e-9)[0]).T)


def _changes(maps: Array, lifts: Array) -> Array:
    """How the characteristics change (2, k, 5) with each lift (k, n), either way."""
    still = _values(_statistics(maps), float(np.median(maps)))
    moved = [
        [_values(_statistics(maps + sign * lift), float(np.median(maps + sign * lift))) - still for lift in lifts]
        for sign in (1.0, -1.0)
    ]
    return np.array(moved).reshape(2, len(lifts), len(STATISTICS))
