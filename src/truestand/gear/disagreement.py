"""What two views of the same flanks read otherwise than their U allow: slopes, what goes once round the gear, and how
it leans. One of them has moved, or the part has between two scans.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from math import hypot, inf

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.assumptions import INCIDENCE_U, K
from truestand.core.frames import PHI, PLANE_OFFSET, PLANE_TILT, UNKNOWNS
from truestand.core.inspection import CONTRADICTS
from truestand.core.message import Message
from truestand.gear.geometry import FLANKS
from truestand.gear.grid import Grid
from truestand.gear.level_terms import SMOOTH, TERMS, Cells, compared, solved, without_strays
from truestand.gear.seen_flanks import seen_flanks
from truestand.gear.views import GearView

SLOPES = {1: "profile", 2: "face"}
ROUND, LEAN = slice(SMOOTH, TERMS), slice(TERMS, TERMS + 2)
"""Of the terms: what goes once round the gear, and that times -1 to 1 along the face, where the gear leans."""
ROWS, COLUMNS = 12, 20
"""Cells along the profile and the face in which it is worked out what inputs of the budget do to these."""


@dataclass(frozen=True, slots=True)
class Apart:
    """By what two views differ on one side's flanks."""

    by: Array
    """(terms,) mm; 0 of what their cells don't tell."""
    noise: Array
    """(terms, terms) mm^2: its covariance, by how teeth differ."""


def disagreements(
    views: Sequence[GearView], readers: Sequence[str], means: Sequence[Array], grid: Grid
) -> tuple[Message, ...]:
    """Why nothing may be decided where two ``readers`` read a slope, or what goes once round the gear, otherwise than
    their U allow; ``means`` (2, teeth, roll lengths, heights) mm: what each of them shows of the cells.
    """
    of_readers = {view.calibration.reader: view for view in views}
    rows, columns = _every(grid.rolls.size, ROWS), _every(grid.heights.size, COLUMNS)
    some = Cells.of(grid, rows, columns)
    fields = [_fields(of_readers[reader], some) for reader in readers]
    found: list[Message] = []
    for (a, b), side in product(combinations(range(len(readers)), 2), (0, 1)):
        pair, off = (of_readers[readers[a]], of_readers[readers[b]]), means[a][side] - means[b][side]
        apart, both = _apart(off, Cells.of(grid)), np.isfinite(off[:, rows, columns])
        known = _known((fields[a], fields[b]), side, both, some)
        found += (*_slopes_contradict(pair, side, apart), *_rounds_contradict(pair, side, apart, known))
    return tuple(found)


def _every(size: int, most: int) -> slice:
    """So many of some cells at most, evenly."""
    return slice(None, None, -(-size // most))


def _apart(off: Array, cells: Cells) -> Apart:
    """By what two views differ that are so many mm ``off`` each other in cells (teeth, roll lengths, heights); NaN: not
    seen by both.
    """
    seen, known = _terms(np.isfinite(off), cells)
    on = without_strays(known, off[seen])
    tooth, known, values = np.nonzero(seen)[0][on], known[on], off[seen][on]
    by = solved(known, values)
    of_teeth = np.zeros((len(off), by.size))
    np.add.at(of_teeth, tooth, known * (values - known @ by)[:, None])
    spread = solved(known.T @ known, of_teeth.T)
    return Apart(by, spread @ spread.T)


def _terms(both: Mask, cells: Cells) -> tuple[Mask, Array]:
    """``compared``, and in terms how the gear leans."""
    seen, known = compared(both, cells)
    return seen, np.concatenate([known, known[:, [2]] * known[:, ROUND]], axis=1)


def _fields(view: GearView, cells: Cells) -> Array | None:
    """What (inputs, 2, teeth, roll lengths, heights) mm every input of a view and of the table does to what it reads
    (k = 2). None where anything may be: of a part that was turned over, which may sit otherwise.
    """
    calibration = view.calibration
    if calibration.sense < 0 or calibration.covariance.shape[0] < UNKNOWNS:
        return None
    shape = (2, view.teeth, cells.rolls.size, cells.heights.size)
    roll, height = (np.broadcast_to(of, shape) for of in (cells.rolls[:, None], cells.heights))
    seen = seen_flanks(view.scan, calibration, view.flanks.toothing, roll, height, view.before_rms)
    variances, axes = np.linalg.eigh(calibration.covariance[:UNKNOWNS, :UNKNOWNS])
    of_unknowns = K * (axes * np.sqrt(np.maximum(variances, 0.0))).T @ seen.by_delta[:UNKNOWNS]
    inputs = [line.field for line in (*seen.of_sensor, *seen.of_table)]
    return np.concatenate([np.stack(inputs), of_unknowns.reshape(-1, *shape)])


def _known(fields: tuple[Array | None, Array | None], side: int, both: Mask, cells: Cells) -> Array:
    """U^2 (terms,) mm^2 (k = 2) of what two views differ by on one side in the cells (teeth, roll lengths, heights)
    that ``both`` show, by the ``fields`` of each. Infinite where nothing tells it.
    """
    seen, known = _terms(both, cells)
    square = np.where(known.any(axis=0), 0.0, inf)
    for field in fields:
        square += inf if field is None else np.square(solved(known, field[:, side, seen].T)).sum(axis=1)
    return square


def _slopes_contradict(pair: tuple[GearView, GearView], side: int, apart: Apart) -> list[Message]:
    """Slopes of one side's flanks that two views read too far ``apart``."""
    known, found = [slopes_known(view) for view in pair], []
    for term, along in SLOPES.items():
        difference, U = 2 * float(abs(apart.by[term])), hypot(*(of[along] for of in known))
        what = f"the slope of {FLANKS[side]} flanks along the {along}", ""
        why = "one of them has moved since the calibration; verify each (truestand verify), or inspect by one view"
        found += _contradiction(pair, what, difference, U, why)
    return found


def _rounds_contradict(pair: tuple[GearView, GearView], side: int, apart: Apart, known: Array) -> list[Message]:
    """What two views read too far ``apart`` once round the gear, for U^2 of it that is ``known``, mm^2."""
    square, flanks, found = known + K**2 * np.diag(apart.noise), f"the {FLANKS[side]} flanks up to", []
    for terms, where, why in (
        (ROUND, "", "the angle slipped in one of the scans, or the part moved between them; scan again"),
        (LEAN, " at the ends of the face,", "the part leaned otherwise in one of the scans; scan again"),
    ):
        difference, U = float(np.hypot(*apart.by[terms])), float(np.sqrt(square[terms].sum()))
        found += _contradiction(pair, (flanks, f"{where} once round the gear"), difference, U, why)
    return found


def _contradiction(
    pair: tuple[GearView, GearView], what: tuple[str, str], difference: float, U: float, why: str
) -> list[Message]:
    """That two views read ``what``, and where, too far apart for its U (k = 2), both mm; nothing where they don't."""
    if difference <= CONTRADICTS * U:
        return []
    names, (of, where) = " and ".join(repr(view.calibration.reader) for view in pair), what
    text = f"views {names} read {of} {1000 * difference:.1f} um otherwise{where}, U is {1000 * U:.1f} um: {why}"
    return [Message("views_contradict", text)]


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
