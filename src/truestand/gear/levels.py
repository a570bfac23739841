"""Views that read the same flanks a little differently, laid onto each other.

What a sensor makes of steep flanks, of its range and of a laser plane that stands beside where the calibration has it
is alike on every tooth of a side: a shift, a slope along the profile and one along the face. What the table's angle and
its axis make of flanks goes once round the gear, and views beside each other meet it at other angles. All of it is in
the budget of each view; left between them it would be a step on every flank where one of them ceases to see it, which
looks like damage. The same view reads as another one where the part was turned over: what it makes of left flanks it
then makes of right ones, so that their mean is free of much of it (reversal).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations, product
from math import hypot, inf

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.assumptions import INCIDENCE_U, K
from truestand.core.frames import PHI, PLANE_OFFSET, PLANE_TILT, UNKNOWNS
from truestand.core.inspection import CONTRADICTS
from truestand.core.message import Message
from truestand.core.robust import robust_sd
from truestand.gear.fillet import surely_on_flanks
from truestand.gear.flanks import Flanks
from truestand.gear.geometry import FLANKS, Involute
from truestand.gear.grid import Grid, grid_of, means_of
from truestand.gear.seen_flanks import seen_flanks
from truestand.gear.views import GearView, joined, part_of

LEAST_SPAN = 0.5
"""Of the profile, the face or the teeth over which two views must see the same cells for what goes along them to count.
"""
LEAST_CELLS = 30
"""Of a side that two views must both show."""
ROUNDS, MOST_SD, LEAST_SPREAD = 2, 4.0, 1e-6
"""In which differences of cells are left out that lie so many robust standard deviations off, or mm at least."""
SLOPES = {1: "profile", 2: "face"}
PLACES = 5
"""Along the profile and along the face at which it is worked out what goes once round the gear."""
SMOOTH, TERMS = 3, 5
"""A shift, a slope along the profile and one along the face; and what goes once round the gear, cosine and sine."""


def levelled(views: tuple[GearView, ...]) -> tuple[tuple[GearView, ...], tuple[Message, ...]]:
    """The views with their flanks at the mean of what all of them read, and why nothing may be decided: slopes that
    differ by more than sensors do. One view alone as it is.
    """
    readers = list(dict.fromkeys(view.calibration.reader for view in views))
    if len(readers) < 2:
        return views, ()
    flanks = joined([view.borne_out() for view in views], views)
    grid = grid_of(flanks)
    means = _by_reader(views, flanks, grid)
    off = _levels(means, grid)
    of_view = [off[readers.index(view.calibration.reader)] for view in views]
    sure = surely_on_flanks(views, [_of_readings(v.flanks, own) for v, own in zip(views, of_view, strict=True)])
    level = (replace(v, flanks=_without(v.flanks, own), level=own) for v, own in zip(sure, of_view, strict=True))
    return tuple(level), _contradictions(views, readers, off, means, grid)


def left_between(views: Sequence[GearView], flanks: Flanks, grid: Grid) -> float:
    """Standard deviation (mm) of what views that are laid onto each other still read otherwise in the cells that they
    both show, noise included; 0 for one view. Readings of the one between those of the other seem to depart by it.
    """
    if len({view.calibration.reader for view in views}) < 2:
        return 0.0
    means = _by_reader(views, flanks, grid)
    apart = [np.where(grid.in_ranges, a - b, np.nan) for a, b in combinations(means, 2)]
    told = np.concatenate([of[np.isfinite(of)] for of in apart])
    return robust_sd(told) if told.size >= LEAST_CELLS else 0.0


def level_of(view: GearView, grid: Grid) -> Array:
    """By how much (2, teeth, roll lengths, heights) mm a view reads flanks more than the mean of all."""
    return _in_cells(np.zeros((2, TERMS)) if view.level is None else view.level, grid)


def levelling(shares: Array, readers: Sequence[str], grid: Grid) -> Callable[[Array], Array]:
    """What is left of fields (views, 2, teeth, roll lengths, heights) mm, by which each view may read delta otherwise,
    when views are laid onto each other: ``shares`` of each view in the cells, who ``readers`` are (views,).

    Inputs move all cells of a view smoothly: none of them stands out as a stray.
    """
    names = list(dict.fromkeys(readers))
    if len(names) < 2:
        return lambda fields: fields
    of = np.array([names.index(reader) for reader in readers])
    whole = np.stack([shares[of == n].sum(axis=0) for n in range(len(names))])
    seen, weights = (whole > 0) & grid.seen, shares / np.where(whole > 0, whole, 1.0)[of]
    solved = [_solved(seen[:, side], grid) for side in (0, 1)]

    def left(fields: Array) -> Array:
        read = weights * fields
        means = np.stack([read[of == n].sum(axis=0) for n in range(len(names))])
        off = np.stack([solve(means[:, side]) for side, solve in enumerate(solved)], axis=1)
        return np.asarray(fields - _in_cells(off, grid)[of])

    return left


def _by_reader(views: Sequence[GearView], flanks: Flanks, grid: Grid) -> list[Array]:
    """What each reader's views show of the cells (2, teeth, roll lengths, heights) mm; ``flanks``: of all views."""
    readers = [view.calibration.reader for view in views]
    return [
        means_of([part_of(flanks, views, k) for k, of in enumerate(readers) if of == reader], grid)
        for reader in dict.fromkeys(readers)
    ]


def _levels(means: Sequence[Array], grid: Grid) -> Array:
    """By how much (readers, 2, ``TERMS``) mm each one reads more than the mean of all; ``means``: of each one, (2,
    teeth, roll lengths, heights) mm; NaN: not seen.
    """
    return np.stack([_off([m[side] for m in means], grid) for side in (0, 1)], axis=1)


def _contradictions(
    views: Sequence[GearView], readers: list[str], off: Array, means: Sequence[Array], grid: Grid
) -> tuple[Message, ...]:
    """Why nothing may be decided where two views read a slope, or what goes once round the gear, otherwise than their U
    allow: by ``off`` (readers, 2, ``TERMS``) mm, and by ``means`` of what each shows of the cells.
    """
    of_readers = {view.calibration.reader: view for view in views}
    known = {reader: _rounds_known(view) for reader, view in of_readers.items()}
    found: list[Message] = []
    for (a, b), side in product(combinations(range(len(readers)), 2), (0, 1)):
        pair = (of_readers[readers[a]], of_readers[readers[b]])
        round_U, lean_U = np.hypot(known[readers[a]], known[readers[b]])[:, side]
        apart = off[a, side] - off[b, side]
        found += (*_slopes_contradict(pair, side, apart), *_rounds_contradict(pair, side, apart, round_U))
        found += _leans_contradict(pair, side, _lean(means[a][side] - means[b][side], grid), lean_U)
    return tuple(found)


def _slopes_contradict(pair: tuple[GearView, GearView], side: int, apart: Array) -> list[Message]:
    """Slopes of one side's flanks that two views read too far ``apart`` (``TERMS``,) mm."""
    known, found = [slopes_known(view) for view in pair], []
    for term, along in SLOPES.items():
        difference, U = 2 * float(abs(apart[term])), hypot(*(of[along] for of in known))
        what = f"the slope of {FLANKS[side]} flanks along the {along}", ""
        why = "one of them has moved since the calibration; verify each (truestand verify), or inspect by one view"
        found += _contradiction(pair, what, difference, U, why)
    return found


def _rounds_contradict(pair: tuple[GearView, GearView], side: int, apart: Array, U: float) -> list[Message]:
    """What two views read too far ``apart`` (``TERMS``,) mm once round the gear, for its ``U`` (k = 2), mm."""
    difference = float(np.hypot(*apart[SMOOTH:]))
    what = f"the {FLANKS[side]} flanks up to", " once round the gear"
    why = "the angle slipped in one of the scans, or the part moved between them; scan again"
    return _contradiction(pair, what, difference, U, why)


def _leans_contradict(pair: tuple[GearView, GearView], side: int, lean: float, U: float) -> list[Message]:
    """A ``lean`` (mm) of the gear in one of two scans over the other that is too large for its ``U`` (k = 2), mm."""
    what = f"the {FLANKS[side]} flanks up to", " at the ends of the face, once round the gear"
    why = "the part leaned otherwise in one of the scans; scan again"
    return _contradiction(pair, what, lean, U, why)


def _contradiction(
    pair: tuple[GearView, GearView], what: tuple[str, str], difference: float, U: float, why: str
) -> list[Message]:
    """That two views read ``what``, and where, too far apart for its U (k = 2), both mm; nothing where they don't."""
    if difference <= CONTRADICTS * U:
        return []
    names, (of, where) = " and ".join(repr(view.calibration.reader) for view in pair), what
    text = f"views {names} read {of} {1000 * difference:.1f} um otherwise{where}, U is {1000 * U:.1f} um: {why}"
    return [Message("views_contradict", text)]


def _lean(apart: Array, grid: Grid) -> float:
    """mm at the ends of the face by which one of two views, whose cells (teeth, roll lengths, heights) are ``apart``
    mm, reads the gear leaning more; 0 where their cells don't tell.
    """
    seen, known = _compared(np.isfinite(apart), grid)
    if not known[:, 2:].any(axis=0).all():
        return 0.0
    leaning = known[:, [2]] * known[:, SMOOTH:]
    known, values = _without_strays(np.concatenate([known, leaning], axis=1), apart[seen])
    coefficients, *_ = np.linalg.lstsq(known.T @ known, known.T @ values, rcond=None)
    return float(np.hypot(*coefficients[TERMS:]))


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


def _rounds_known(view: GearView) -> Array:
    """U (2, 2) (mm, k = 2) of what a view reads once round the gear, and of that at the ends of the face, where the
    gear leans; each on left and on right flanks. Of all inputs that are its own and of the table, in whatever
    direction, and of steep flanks that read otherwise, in proportion to their incidence or not. Infinite for a part
    that was turned over, which may sit otherwise.
    """
    calibration, toothing = view.calibration, view.flanks.toothing
    if calibration.sense < 0 or calibration.covariance.shape[0] < UNKNOWNS:
        return np.full((2, 2), inf)
    nominal, shape = toothing.nominal, (2, view.teeth, PLACES, PLACES)
    roll = np.broadcast_to(np.linspace(*nominal.profile_range, PLACES)[:, None], shape)
    height, along = np.broadcast_to(np.linspace(*nominal.helix_range, PLACES), shape), np.linspace(-1.0, 1.0, PLACES)
    seen = seen_flanks(view.scan, calibration, toothing, roll, height, view.before_rms)
    on_face = np.stack([np.full(PLACES, 1 / PLACES), along / (along @ along)])

    def once_round(fields: Array) -> Array:
        """(..., 2 round and leaning, 2 sides, cosine and sine)."""
        of_teeth = fields.reshape(-1, *shape).mean(axis=3)
        return np.asarray(2 / view.teeth * np.einsum("isth,kh,ct->iksc", of_teeth, on_face, _around(nominal)))

    of_inputs = once_round(np.stack([line.field for line in (*seen.of_sensor, *seen.of_table, seen.of_bent_incidence)]))
    of_unknowns, covariance = once_round(seen.by_delta[:UNKNOWNS]), calibration.covariance[:UNKNOWNS, :UNKNOWNS]
    by_calibration = K**2 * np.einsum("iksc,ij,jksc->ks", of_unknowns, covariance, of_unknowns)
    return np.asarray(np.sqrt(np.square(of_inputs).sum(axis=(0, 3)) + by_calibration))


def _off(means: Sequence[Array], grid: Grid) -> Array:
    """By how much (views, ``TERMS``) mm each view reads more than the mean of all, on one side's flanks.

    ``means``: of each view, (teeth, roll lengths, heights) mm; NaN: not seen.
    """
    compared = []
    for a, b in combinations(range(len(means)), 2):
        apart = means[a] - means[b]
        seen, known = _compared(np.isfinite(apart), grid)
        compared.append((a, b, *_without_strays(known, apart[seen])))
    normal = _normal(len(means), [(a, b, known) for a, b, known, _ in compared])
    right = _right(len(means), compared)
    return np.asarray(np.linalg.lstsq(normal, right.reshape(-1), rcond=None)[0].reshape(right.shape))


def _solved(seen: Mask, grid: Grid) -> Callable[[Array], Array]:
    """The same for any means of views that show these cells, (views, teeth, roll lengths, heights); all count."""
    pairs = list(combinations(range(len(seen)), 2))
    compared = [_compared(seen[a] & seen[b], grid) for a, b in pairs]
    normal = _normal(len(seen), [(*pair, known) for pair, (_, known) in zip(pairs, compared, strict=True)])
    inverse = np.linalg.pinv(normal)

    def solve(means: Array) -> Array:
        apart = [
            (a, b, known, (means[a] - means[b])[both]) for (a, b), (both, known) in zip(pairs, compared, strict=True)
        ]
        right = _right(len(means), apart)
        return np.asarray((inverse @ right.reshape(-1)).reshape(right.shape))

    return solve


def _normal(views: int, compared: Sequence[tuple[int, int, Array]]) -> Array:
    """The normal equations (views ``TERMS``, views ``TERMS``) of what pairs of views differ by in cells of ``known``
    terms (n, ``TERMS``); the mean of all views stays.
    """
    normal = np.zeros((views, TERMS, views, TERMS)) + np.eye(TERMS)[None, :, None, :]
    for a, b, known in compared:
        for i, j in product((a, b), repeat=2):
            normal[i, :, j] += (known.T @ known) * (1.0 if i == j else -1.0)
    return np.asarray(normal.reshape(views * TERMS, -1))


def _right(views: int, compared: Sequence[tuple[int, int, Array, Array]]) -> Array:
    """The right side (views, ``TERMS``) of these equations, of cells that are so many mm (n,) apart."""
    right = np.zeros((views, TERMS))
    for a, b, known, apart in compared:
        told = known.T @ apart
        right[a] += told
        right[b] -= told
    return right


def _compared(both: Mask, grid: Grid) -> tuple[Mask, Array]:
    """Of the cells (teeth, roll lengths, heights) that ``both`` of two views show, those in the evaluation ranges, and
    their terms (n, ``TERMS``), 0 for what they don't tell. None where they are too few.
    """
    (low, high), (bottom, top) = grid.nominal.profile_range, grid.nominal.helix_range
    inside = ((grid.rolls >= low) & (grid.rolls <= high))[:, None] & ((grid.heights >= bottom) & (grid.heights <= top))
    seen = both & inside
    if np.count_nonzero(seen.any(axis=0)) < LEAST_CELLS:
        return np.zeros_like(seen), np.zeros((0, TERMS))
    tooth, row, column = np.nonzero(seen)
    smooth = _smooth_terms(grid.nominal, grid.rolls[row], grid.heights[column])
    return seen, np.concatenate([smooth, _around(grid.nominal)[:, tooth]]).T * _told(seen, inside)


def _without_strays(known: Array, apart: Array) -> tuple[Array, Array]:
    """Terms (n, ``TERMS``) and differences (n,) mm of cells but those that stick out of what the others tell."""
    for _ in range(ROUNDS if apart.size else 0):
        coefficients, *_ = np.linalg.lstsq(known.T @ known, known.T @ apart, rcond=None)
        rest = np.abs(apart - known @ coefficients)
        near = rest <= max(MOST_SD * robust_sd(rest), LEAST_SPREAD)
        known, apart = known[near], apart[near]
    return known, apart


def _told(seen: Mask, inside: Mask) -> Array:
    """(``TERMS``,) 1 for what cells (teeth, roll lengths, heights) that two views both show tell of their difference, 0
    for what they don't.
    """
    cells, teeth = np.asarray(seen.any(axis=0)), np.asarray(seen.any(axis=(1, 2)))
    along = [cells.any(axis=axis).sum() / max(inside.any(axis=axis).sum(), 1) for axis in (1, 0)]
    around = teeth.mean()
    return np.array([1.0, *(float(span >= LEAST_SPAN) for span in (*along, around, around))])


def _smooth_terms(nominal: Involute, roll: Array, height: Array) -> Array:
    """(``SMOOTH``, ...): 1, and from -1 to 1 along the profile and along the face."""
    (low, high), (bottom, top) = nominal.profile_range, nominal.helix_range
    along_profile = (2 * roll - low - high) / (high - low) + 0.0 * height
    along_face = (2 * height - bottom - top) / (top - bottom) + 0.0 * roll
    return np.stack([np.ones_like(along_profile), along_profile, along_face])


def _around(nominal: Involute) -> Array:
    """Cosine and sine (2, teeth) of where teeth stand round the gear."""
    angle = nominal.gear.pitch * np.arange(nominal.gear.teeth)
    return np.stack([np.cos(angle), np.sin(angle)])


def _in_cells(level: Array, grid: Grid) -> Array:
    """A level (..., ``TERMS``) mm in the cells (..., teeth, roll lengths, heights)."""
    smooth = np.tensordot(level[..., :SMOOTH], _smooth_terms(grid.nominal, grid.rolls[:, None], grid.heights), 1)
    turning = np.tensordot(level[..., SMOOTH:], _around(grid.nominal), 1)
    return np.asarray(smooth[..., None, :, :] + turning[..., None, None])


def _without(flanks: Flanks, off: Array) -> Flanks:
    """The flanks without what their view reads more than the others, (2, ``TERMS``) mm."""
    return replace(flanks, delta=flanks.delta - _of_readings(flanks, off))


def _of_readings(flanks: Flanks, off: Array) -> Array:
    """A level (2, ``TERMS``) mm at the readings (n,) of flanks."""
    nominal = flanks.toothing.nominal
    side, tooth = np.divmod(flanks.flank, nominal.gear.teeth)
    smooth = (off[side, :SMOOTH].T * _smooth_terms(nominal, flanks.roll, flanks.height)).sum(axis=0)
    turning = off[:, SMOOTH:] @ _around(nominal)
    return np.asarray(smooth + turning[side, tooth])
