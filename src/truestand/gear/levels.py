"""Views that read the same flanks a little differently, laid onto each other.

What a sensor makes of steep flanks, of its range and of a laser plane that stands beside where the calibration has it
is alike on every tooth of a side: a shift, a slope along the profile and one along the face. It is in the budget of
each view; left between them it would be a step on every flank where one of them ceases to see it, which looks like
damage. The same view reads as another one where the part was turned over: what it makes of left flanks it then makes of
right ones, so that their mean is free of much of it (reversal).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product
from math import hypot

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.assumptions import INCIDENCE_U, K
from truestand.core.frames import PHI, PLANE_OFFSET, PLANE_TILT, UNKNOWNS
from truestand.core.inspection import CONTRADICTS
from truestand.core.message import Message
from truestand.core.robust import nan_median
from truestand.gear.flanks import Flanks
from truestand.gear.geometry import FLANKS, Involute
from truestand.gear.grid import Grid, grid_of, means_of
from truestand.gear.views import GearView, joined, part_of

LEAST_SPAN = 0.5
"""Of the profile, or of the face, over which two views must see the same cells for a slope between them to count."""
LEAST_CELLS = 30
"""Of a side that two views must both show."""
SLOPES = {1: "profile", 2: "face"}
TERMS = 3
"""A shift, a slope along the profile and one along the face."""


def levelled(views: tuple[GearView, ...]) -> tuple[tuple[GearView, ...], tuple[Message, ...]]:
    """The views with their flanks at the mean of what all of them read, and why nothing may be decided: slopes that
    differ by more than sensors do. One view alone as it is.
    """
    readers = list(dict.fromkeys(view.calibration.reader for view in views))
    if len(readers) < 2:
        return views, ()
    flanks = joined([view.borne_out() for view in views], views)
    grid = grid_of(flanks)
    by_reader = [
        [part_of(flanks, views, k) for k, view in enumerate(views) if view.calibration.reader == reader]
        for reader in readers
    ]
    off = _levels([means_of(of_reader, grid) for of_reader in by_reader], grid)
    of_view = [off[readers.index(view.calibration.reader)] for view in views]
    level = (replace(v, flanks=_without(v.flanks, own), level=own) for v, own in zip(views, of_view, strict=True))
    return tuple(level), _contradictions(views, readers, off)


def level_of(view: GearView, grid: Grid) -> Array:
    """By how much (2, 1, roll lengths, heights) mm a view reads flanks more than the mean of all."""
    terms = _terms(grid.nominal, grid.rolls[:, None], grid.heights)
    level = np.zeros((2, TERMS)) if view.level is None else view.level
    return np.asarray(np.tensordot(level, terms, 1)[:, None])


def levelled_fields(fields: Array, shares: Array, readers: Sequence[str], grid: Grid) -> Array:
    """What is left of fields (views, 2, teeth, roll lengths, heights) mm, by which each view may read delta otherwise,
    when views are laid onto each other: ``shares`` of each view in the cells, who ``readers`` are (views,).
    """
    names = list(dict.fromkeys(readers))
    if len(names) < 2:
        return fields
    of = np.array([names.index(reader) for reader in readers])
    means = []
    for n in range(len(names)):
        share = shares[of == n].sum(axis=0)
        mean = (shares[of == n] * fields[of == n]).sum(axis=0) / np.where(share > 0, share, 1.0)
        means.append(np.where((share > 0) & grid.seen, mean, np.nan))
    terms = _terms(grid.nominal, grid.rolls[:, None], grid.heights)
    level = np.tensordot(_levels(means, grid), terms, 1)
    return np.asarray(fields - level[of][:, :, None])


def _levels(means: Sequence[Array], grid: Grid) -> Array:
    """By how much (readers, 2, ``TERMS``) mm each one reads more than the mean of all; ``means``: of each one, (2,
    teeth, roll lengths, heights) mm; NaN: not seen.
    """
    return np.stack([_off([m[side] for m in means], grid) for side in (0, 1)], axis=1)


def _contradictions(views: Sequence[GearView], readers: list[str], off: Array) -> tuple[Message, ...]:
    """Why nothing may be decided where two views read a slope otherwise than their U allow."""
    known = {view.calibration.reader: slopes_known(view) for view in views}
    found = []
    for (a, b), side, (term, along) in product(combinations(range(len(readers)), 2), (0, 1), SLOPES.items()):
        apart = 2 * float(abs(off[a, side, term] - off[b, side, term]))
        U = hypot(*(known[readers[k]][along] for k in (a, b)))
        if apart > CONTRADICTS * U:
            text = (
                f"views {readers[a]!r} and {readers[b]!r} read the slope of {FLANKS[side]} flanks along the {along} "
                f"{1000 * apart:.1f} um otherwise, U is {1000 * U:.1f} um: one of them has moved since the "
                "calibration; verify each (truestand verify), or inspect by one view"
            )
            found.append(Message("views_contradict", text))
    return tuple(found)


def slopes_known(view: GearView) -> dict[str, float]:
    """U (mm, k = 2) of a slope over the whole profile and over the whole face as a view reads them, roughly."""
    sensor, covariance = view.scan.stand.sensor, view.calibration.covariance
    nominal = view.flanks.toothing.nominal
    read = hypot(INCIDENCE_U if sensor.incidence_U is None else sensor.incidence_U, sensor.linearity)
    if covariance.shape[0] < UNKNOWNS:
        return {"profile": read, "face": read}
    known = K * np.sqrt(np.diag(covariance))
    low, high = nominal.radius(np.array(nominal.profile_range))
    beside = float(known[PLANE_OFFSET]) * nominal.base_radius * float(1 / low - 1 / high)
    turned = float(known[[PHI, PLANE_TILT]].max()) * nominal.gear.face_width
    return {"profile": hypot(read, beside, turned), "face": hypot(read, turned)}


def _off(means: Sequence[Array], grid: Grid) -> Array:
    """By how much (views, ``TERMS``) mm each view reads more than the mean of all, on one side's flanks.

    ``means``: of each view, (teeth, roll lengths, heights) mm; NaN: not seen.
    """
    terms = _terms(grid.nominal, grid.rolls[:, None], grid.heights)
    (low, high), (bottom, top) = grid.nominal.profile_range, grid.nominal.helix_range
    inside = ((grid.rolls >= low) & (grid.rolls <= high))[:, None] & ((grid.heights >= bottom) & (grid.heights <= top))
    rows, values = [np.tile(np.eye(TERMS), len(means))], [np.zeros(TERMS)]  # the mean stays
    for a, b in combinations(range(len(means)), 2):
        apart = np.where(inside, nan_median(means[a] - means[b], axis=0), np.nan)
        seen = np.isfinite(apart)
        if np.count_nonzero(seen) < LEAST_CELLS:
            continue
        known = np.asarray(terms[:, seen].T * _told(seen, inside))
        row = np.zeros((known.shape[0], len(means), TERMS))
        row[:, a], row[:, b] = known, -known
        rows.append(row.reshape(known.shape[0], -1))
        values.append(apart[seen])
    solution, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)
    return np.asarray(solution.reshape(len(means), TERMS))


def _told(seen: Mask, inside: Mask) -> Array:
    """(``TERMS``,) 1 for what cells that two views both show tell of their difference, 0 for what they don't."""
    spans = [seen.any(axis=axis).sum() / max(inside.any(axis=axis).sum(), 1) for axis in (1, 0)]
    return np.array([1.0, *(float(span >= LEAST_SPAN) for span in spans)])


def _terms(nominal: Involute, roll: Array, height: Array) -> Array:
    """(``TERMS``, ...): 1, and from -1 to 1 along the profile and along the face."""
    (low, high), (bottom, top) = nominal.profile_range, nominal.helix_range
    along_profile = (2 * roll - low - high) / (high - low) + 0.0 * height
    along_face = (2 * height - bottom - top) / (top - bottom) + 0.0 * roll
    return np.stack([np.ones_like(along_profile), along_profile, along_face])


def _without(flanks: Flanks, off: Array) -> Flanks:
    """The flanks without what their view reads more than the others, (2, ``TERMS``) mm."""
    nominal = flanks.toothing.nominal
    terms = _terms(nominal, flanks.roll, flanks.height)
    side = (flanks.flank >= nominal.gear.teeth).astype(np.intp)
    return replace(flanks, delta=flanks.delta - (off[side].T * terms).sum(axis=0))
