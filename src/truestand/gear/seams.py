"""Where views overlap on the same flanks: by how much they differ, and what that tells of where they stand.

What a view says of a flank follows the unknowns of the joint calibration. A difference between two views of the same
flank measures them, as a reading of the artefact does: it corrects them and their covariance (Kalman's update), as far
as it does not contradict what was known of them. Their errors that a flank does not tell apart stay in U.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from math import sqrt

import numpy as np

from truestand.apply.datum import Datum
from truestand.core.arrays import Array, Ints, Mask
from truestand.core.calibration import VIEW_UNKNOWNS, Calibration, JointCovariance
from truestand.core.frames import (
    UNKNOWNS,
)
from truestand.core.inspection import Seam
from truestand.core.robust import robust_sd
from truestand.core.surface import Surface, apply_calibration
from truestand.gear.flanks import find_toothing, flank_offsets
from truestand.gear.geometry import FLANKS, Involute
from truestand.gear.grid import grid_of, means_of
from truestand.gear.seen_flanks import SeenFlanks, seen_flanks
from truestand.gear.views import GearView, joined, part_of
from truestand.uncertainty.influence import joint_covariance, without

LEAST_TEETH, LEAST_SHARE = 3, 0.5
"""Flanks of a side that two views must both show to be compared, and their share of those that the one shows that shows
fewer: a few may all be met at one corner, which says nothing of the rest,"""
LEAST_CELLS = 30
"""and cells of them."""
ROUGH_U = 0.02
"""mm (standard): of a difference between flanks of which two views may show other parts."""
FAR_APART = 0.1
"""mm of delta: so far apart, flanks of two views are laid onto each other before points are told to be on flanks."""
PLACES = 5
"""Along the face at which flanks are compared roughly."""
BLOCKS = 8
"""Of cells along the profile, and along the face: what differences follow is worked out in the middle of each."""


@dataclass(frozen=True, slots=True)
class Difference:
    """What two views differ by on one side's flanks, and what it follows."""

    of: tuple[int, int]
    side: int
    value: float
    """mm of delta, the first less the second."""
    u: float
    """mm, standard: of noise."""
    by_unknown: Array
    """(unknowns of all views,) mm per mm or rad."""
    by_sensor: Array
    """(errors of all sensors,) mm, standard."""
    by_table: Array
    """(errors of the table,) mm, standard: once round the gear, they don't cancel on some of its teeth."""


def tied_roughly(
    surfaces: tuple[Surface, ...], nominal: Involute, datum: Datum
) -> tuple[tuple[Surface, ...], tuple[Seam, ...]]:
    """The surfaces of several views, those whose flanks lie farther apart than a gate allows moved onto each other; and
    their seams, where they contradict each other.

    Heights between views may be known to a millimetre only: so far apart are the flanks of a helical gear.
    """
    covariance = joint_covariance([s.origin[1] for s in surfaces]) if len(surfaces) > 1 else None
    if covariance is None:
        return surfaces, ()
    toothing = find_toothing(surfaces, nominal, datum)
    shape = (2, nominal.gear.teeth, PLACES)
    roll, height = np.full(shape, nominal.measuring_roll), np.linspace(*nominal.helix_range, PLACES)
    seen = [seen_flanks(*s.origin, toothing, roll, np.broadcast_to(height, shape)) for s in surfaces]
    offsets = [flank_offsets(s, toothing).reshape(2, -1) for s in surfaces]
    differences = []
    for (a, b), side in product(_pairs([s.origin[1] for s in surfaces]), (0, 1)):
        apart = offsets[a][side] - offsets[b][side]
        both = np.zeros(shape, dtype=bool)
        both[side] = np.isfinite(apart)[:, None]
        if np.count_nonzero(np.isfinite(apart)) >= LEAST_TEETH:
            differences.append(difference_of(seen, (a, b), side, float(np.nanmedian(apart)), ROUGH_U, both))
    if all(abs(d.value) < FAR_APART for d in differences):
        return surfaces, ()
    seams = _seams(differences, surfaces, covariance)
    return (_rolled_up(surfaces, differences), ()) if all(seam.ok for seam in seams) else (surfaces, seams)


def tied(views: tuple[GearView, ...]) -> tuple[tuple[GearView, ...], tuple[Seam, ...]]:
    """The views where their flanks lie on each other, and the seams between them; a view alone as it is.

    Where views contradict each other they are left where they are.
    """
    surfaces = tuple(view.surface for view in views)
    covariance = joint_covariance([view.calibration for view in views]) if len(views) > 1 else None
    if covariance is None:
        return views, ()
    differences = _differences(views)
    seams = _seams(differences, surfaces, covariance)
    if not all(seam.ok for seam in seams):
        return views, seams
    old = views[0].flanks.toothing
    surfaces = _rolled_up(surfaces, differences)
    toothing = find_toothing(surfaces, old.nominal, old.datum)
    return tuple(view.rolled_up(s, toothing) for view, s in zip(views, surfaces, strict=True)), seams


def _differences(views: tuple[GearView, ...]) -> list[Difference]:
    """What views differ by in the cells of flanks that both show."""
    flanks = joined([view.borne_out() for view in views], views)
    grid, toothing = grid_of(flanks), flanks.toothing
    (rows, row), (columns, column) = (_blocks(cells) for cells in grid.delta.shape[2:])
    roll, height = (of[:, :, row][..., column] for of in (grid.roll, grid.height))
    seen = [seen_flanks(view.scan, view.calibration, toothing, roll, height) for view in views]
    means = [means_of([part_of(flanks, views, k)], grid) for k in range(len(views))]
    found = []
    for (a, b), side in product(_pairs([view.calibration for view in views]), (0, 1)):
        apart = means[a] - means[b]
        both = np.zeros(apart.shape, dtype=bool)
        both[side] = np.isfinite(apart[side]) & grid.in_ranges[side]
        teeth, least = _teeth_of(both[side]), min(_teeth_of(np.isfinite(means[k][side])) for k in (a, b))
        if teeth >= max(LEAST_TEETH, LEAST_SHARE * least) and np.count_nonzero(both) >= LEAST_CELLS:
            u = robust_sd(apart[both] - np.median(apart[both])) / sqrt(teeth)
            weights = np.add.reduceat(np.add.reduceat(both.astype(float), rows, axis=2), columns, axis=3)
            found.append(difference_of(seen, (a, b), side, float(np.median(apart[both])), u, weights))
    return found


def _blocks(cells: int) -> tuple[Ints, Ints]:
    """First and middle one of each of about ``BLOCKS`` blocks of so many cells."""
    step = max(1, cells // BLOCKS)
    first = np.arange(0, cells, step)
    return first, np.minimum(first + step // 2, cells - 1)


def _teeth_of(seen: Mask) -> int:
    """How many teeth have any cell that is ``seen`` (teeth, roll lengths, heights)."""
    return int(np.count_nonzero(seen.any(axis=(1, 2))))


def _pairs(calibrations: Sequence[Calibration]) -> list[tuple[int, int]]:
    """Pairs of scans by different views: those of a part clamped again by one view tell nothing of where it stands. And
    those of a part turned over were turned onto what their own view saw before, azimuth and height included.
    """
    upright = [k for k, calibration in enumerate(calibrations) if calibration.sense > 0]
    return [(a, b) for a, b in combinations(upright, 2) if calibrations[a].name != calibrations[b].name]


def difference_of(
    seen: Sequence[SeenFlanks], of: tuple[int, int], side: int, value: float, u: float, weights: Array | Mask
) -> Difference:
    """What the views ``of`` a pair differ by, mm with its standard uncertainty, and what that follows in ``seen``
    places, by the ``weights`` (2, teeth, ...) with which both show them.
    """
    signs, mean = {of[0]: 1.0, of[1]: -1.0}, weights.reshape(-1) / weights.sum()

    def row(of_views: Iterable[Array]) -> Array:
        return np.concatenate([signs.get(k, 0.0) * (by @ mean) for k, by in enumerate(of_views)])

    by_table = (seen[of[0]].by_table - seen[of[1]].by_table) @ mean
    return Difference(of, side, value, u, row(s.by_delta for s in seen), row(s.by_sensor for s in seen), by_table)


def _seams(differences: list[Difference], surfaces: tuple[Surface, ...], covariance: Array) -> tuple[Seam, ...]:
    """The differences against what was known of them: what is left of each when all others have told where the views
    stand. A height between views that nobody knows lets both sides differ, but in opposite ways.
    """
    if not differences:
        return ()
    rows, noise = _told(differences)
    weight = np.linalg.inv(rows @ covariance @ rows.T + noise)
    left = weight @ np.array([d.value for d in differences]) / np.diag(weight)
    found = []
    for d, value, U in zip(differences, left, 2 / np.sqrt(np.diag(weight)), strict=True):
        first, second = (surfaces[k].origin[1].name for k in d.of)
        found.append(Seam.between((first, second), float(value), float(U), FLANKS[d.side]))
    return tuple(found)


def _told(differences: list[Difference]) -> tuple[Array, Array]:
    """How the differences (n,) follow the unknowns (n, unknowns), and the covariance (n, n) of what else they hold."""
    rows, sensors, table = (
        np.stack([getattr(d, name) for d in differences]) for name in ("by_unknown", "by_sensor", "by_table")
    )
    return rows, sensors @ sensors.T + table @ table.T + np.diag([d.u**2 for d in differences])


def _rolled_up(surfaces: tuple[Surface, ...], differences: list[Difference]) -> tuple[Surface, ...]:
    """The surfaces by calibrations that the differences have corrected."""
    if not differences:
        return surfaces
    calibrations = corrected([s.origin[1] for s in surfaces], differences)
    return tuple(apply_calibration(s.origin[0], c) for s, c in zip(surfaces, calibrations, strict=True))


def corrected(calibrations: list[Calibration], differences: list[Difference]) -> list[Calibration]:
    """The calibrations of all views with what the differences tell of their unknowns."""
    before = joint_covariance(calibrations)
    assert before is not None
    rows, noise = _told(differences)
    gain = before @ rows.T @ np.linalg.inv(rows @ before @ rows.T + noise)
    off = gain @ np.array([d.value for d in differences])
    after = before - gain @ rows @ before
    joint = JointCovariance(tuple(c.name for c in calibrations), (after + after.T) / 2)
    blocks = [slice(VIEW_UNKNOWNS * k, VIEW_UNKNOWNS * (k + 1)) for k in range(len(calibrations))]
    return [
        replace(without(c, off[block]), joint=joint, covariance=joint.matrix[block, block][:UNKNOWNS, :UNKNOWNS])
        for c, block in zip(calibrations, blocks, strict=True)
    ]
