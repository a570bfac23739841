"""What the calibration and the stand leave open: by how much each input of the budget moves what all views together say
of the flanks, and what each figure makes of it.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import hypot, isfinite

import numpy as np

from truestand.apply.datum import Datum
from truestand.core.arrays import Array
from truestand.core.assumptions import K
from truestand.core.calibration import AZIMUTH, HEIGHT, VIEW_UNKNOWNS, Calibration, Contribution
from truestand.core.frames import UNKNOWNS
from truestand.gear.evaluate import PITCH, Evaluator, Figures, evaluate, figures_of, pitch_extremes
from truestand.gear.flanks import Flanks, Toothing
from truestand.gear.geometry import pitch_span
from truestand.gear.grid import Grid, cell_of
from truestand.gear.levels import levelling
from truestand.gear.seen_flanks import FLANK_ONLY, Influence, SeenCells, SeenFlanks, seen_flanks
from truestand.gear.views import GearView, view_of
from truestand.uncertainty.influence import joint_covariance

UNKNOWN_ORDER = (2, 3, 0, 1, 4, 5, 6, 7, AZIMUTH, HEIGHT)
"""The calibration's unknowns in the order of the budget, the last two of several views; each with what moves along with
it.
"""
BETWEEN_READINGS = "between readings"
"""Line of what lies between the readings and beyond them (``evaluate.sampling_of``)."""
UNFELT = 1e-5
"""mm: an input that moves no cell by so much is taken to move no figure."""
UNKNOWN_NAMES = (
    "lateral offset of the laser plane", "skew of the laser line",
    "angle and radial zero of the sensor", "angle and radial zero of the sensor",
    *("axis of the shaft",) * 4, "azimuth between views", "height between views",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Weighed:
    """The flanks as a view sees them, and what it has of each cell."""

    seen: SeenFlanks
    calibration: Calibration
    """With what is known of it together with the other views."""
    share: Array | None = None
    """Of each cell's points that are the view's, (2, teeth, roll lengths, heights); None: all."""


def weighed(views: Sequence[GearView], flanks: Flanks, grid: Grid) -> tuple[Weighed, ...]:
    """Each view with its share of the points of every cell; of a cell that none shows, all have the same."""
    if len(views) == 1:
        return (_of_view(views[0], flanks.toothing, grid),)
    of_view = view_of(flanks, views)
    cell = cell_of(flanks, grid.nominal, grid.rolls.size, grid.edges)
    counts = [np.bincount(cell[of_view == k], minlength=grid.delta.size) for k in range(len(views))]
    total = np.sum(counts, axis=0)
    shares = [np.where(total > 0, n / np.maximum(total, 1), 1 / len(views)).reshape(grid.delta.shape) for n in counts]
    return tuple(_of_view(view, flanks.toothing, grid, share) for view, share in zip(views, shares, strict=True))


def _of_view(view: GearView, toothing: Toothing, grid: Grid, share: Array | None = None) -> Weighed:
    seen = seen_flanks(view.scan, view.calibration, toothing, grid.roll, grid.height, view.before_rms)
    return Weighed(seen, view.calibration, share)


def influences_of(views: tuple[Weighed, ...], grid: Grid, toothing: Toothing) -> tuple[Influence, ...]:
    """Every input of the budget but noise."""
    joined, cells, temperature = _joining(views, grid), views[0].seen.cells, toothing.nominal.gear.temperature
    grown = cells.point * np.array([1.0, 1.0, 0.0]) * temperature.expanded_growth
    return (
        *joined([_of_calibration(views, k) for k in range(len(views))]),
        *_of_sensors(views, joined),
        *joined([view.seen.of_shaft for view in views]),
        *joined([view.seen.of_table for view in views]),
        *_of_datum(toothing.datum, cells),
        cells.influence(temperature.line, cells.shift(grown), temperature.expanded / 2, "rectangular"),
    )


Joining = Callable[[Sequence[Sequence[Influence]]], list[Influence]]
"""Makes inputs of all views of those of each one, which move the readings of all of them at once."""


def _of_sensors(views: tuple[Weighed, ...], joined: Joining) -> list[Influence]:
    """What is each sensor's own: the same in all scans that it took, of a part that was clamped again."""
    found = []
    for name in dict.fromkeys(view.calibration.name for view in views):
        found += joined([view.seen.of_sensor if view.calibration.name == name else () for view in views])
    return found


def _joining(views: tuple[Weighed, ...], grid: Grid) -> Joining:
    """Inputs of one name of several views are one, which moves readings as far as these count in each cell and are not
    laid onto each other. A view may lack some: what wobbles in one scan need not do so in another.
    """
    if len(views) == 1:
        return lambda of_views: list(of_views[0])
    shares = np.stack([np.ones(grid.delta.shape) if view.share is None else view.share for view in views])
    left = levelling(shares, [view.calibration.reader for view in views], grid)
    mean = shares.mean(axis=(1, 2, 3, 4))

    def one(of_views: Sequence[Influence | None]) -> Influence:
        fields = np.stack([np.zeros(grid.delta.shape) if i is None else i.field for i in of_views])
        field = (left(np.where(shares > 0, fields, 0.0)) * shares).sum(axis=0)
        outward = float(sum(i.outward * share for i, share in zip(of_views, mean, strict=True) if i is not None))
        return replace(next(i for i in of_views if i is not None), field=field, outward=outward)

    return lambda of_views: [one(influences) for influences in _by_input(of_views)]


def _by_input(of_views: Sequence[Sequence[Influence]]) -> list[list[Influence | None]]:
    """The influences of each input, by view; None: the view lacks it. Of some that have one name, each is one."""
    found: dict[tuple[str, int], list[Influence | None]] = {}
    for k, influences in enumerate(of_views):
        number: dict[str, int] = {}
        for influence in influences:
            key = influence.name, number.get(influence.name, 0)
            number[influence.name] = key[1] + 1
            found.setdefault(key, [None] * len(of_views))[k] = influence
    return list(found.values())


def radial_lines(influences: tuple[Influence, ...]) -> tuple[Contribution, ...]:
    """The budget (U, k = 2, mm) of a diameter of the part: twice what each input moves its surface out by."""
    lines: dict[str, Contribution] = {}
    for i in influences:
        before = lines[i.name].U if i.name in lines else 0.0
        lines[i.name] = Contribution(i.name, hypot(before, 2 * i.outward), i.u, i.distribution)
    return tuple(c for c in lines.values() if c.U > 1e-6 and not c.name.startswith(FLANK_ONLY))


def expanded(
    influences: tuple[Influence, ...], evaluator: Evaluator, otherwise: Array | None = None
) -> dict[str, Figures]:
    """U (k = 2, mm) of each figure by the name of the input; inputs of one name are joined.

    The input may be off either way, and a range that grows by it one way shrinks the other, less and less the smaller
    it is: the root mean square of both. ``otherwise`` (n, 2, teeth): mm by which the teeth of n gears stand otherwise
    than these; U of the pitch is then the root mean square of all, for it hangs on which teeth are the extreme ones.
    """
    nominal, delta = evaluator.grid.nominal, np.nan_to_num(evaluator.grid.delta)
    gears = np.zeros((1, *delta.shape[:2])) if otherwise is None else otherwise

    def read(field: Array | float) -> Figures:
        measures = evaluate(delta + field, evaluator)
        pitch = pitch_extremes(measures.index + gears, pitch_span(nominal.gear))
        return figures_of(measures, nominal) | pitch

    base = read(0.0)
    by_input: dict[str, Figures] = {}
    for i in influences:
        joined = by_input.setdefault(i.name, {n: np.zeros_like(v) for n, v in base.items()})
        if np.abs(i.field).max() < UNFELT:
            continue
        ways = [read(s * i.field) for s in (1.0, -1.0)]
        for n, value in base.items():
            joined[n] = np.hypot(joined[n], _root_mean_square([way[n] - value for way in ways]))
    return {name: U | {n: _root_mean_square(U[n]) for n in PITCH} for name, U in by_input.items()}


def _root_mean_square(off: Iterable[Array]) -> Array:
    """Of what is known of some arrays; NaN: not known."""
    values = np.stack(list(off))
    known = np.isfinite(values)
    total, number = np.square(np.where(known, values, 0.0)).sum(axis=0), known.sum(axis=0)
    return np.sqrt(np.where(number > 0, total / np.maximum(number, 1), np.nan))


def lines_of(
    by_input: dict[str, Figures], influences: tuple[Influence, ...], name: str, at: tuple[int, ...]
) -> tuple[Contribution, ...]:
    """The budget of one figure, largest line first; lines below a thousandth of the largest are left out.

    Empty where what an input does is not known.
    """
    inputs = {i.name: i for i in influences}
    lines = []
    for source, figures in by_input.items():
        if name not in figures:
            continue
        U = float(figures[name][at])
        known = inputs.get(source)
        lines.append(Contribution(source, U, None if known is None else known.u,
                                  "rectangular" if source == BETWEEN_READINGS else "normal" if known is None
                                  else known.distribution))  # fmt: skip
    if not all(isfinite(c.U) for c in lines):
        return ()
    lines = sorted(lines, key=lambda c: -c.U)
    return tuple(c for c in lines if c.U > 1e-3 * lines[0].U)


def _of_calibration(views: tuple[Weighed, ...], k: int) -> list[Influence]:
    """What the covariance of the calibration's unknowns does to view ``k``, in Cholesky's order: each line with what
    moves along. Of several views, all their unknowns together, so that what they share is counted once; scans by one
    view have the same.
    """
    calibrations, seen = [view.calibration for view in views], views[k].seen
    several = len({calibration.name for calibration in calibrations}) > 1
    covariance = joint_covariance(calibrations) if several else calibrations[k].covariance
    width, number = (VIEW_UNKNOWNS, len(views)) if several else (UNKNOWNS, 1)
    if covariance is None or covariance.shape[0] < width:
        return []
    own = slice(width * k, width * (k + 1)) if several else slice(width)
    order = (np.array(UNKNOWN_ORDER[:width])[:, None] + width * np.arange(number)).reshape(-1)
    found = []
    for name, column in zip(
        np.repeat(UNKNOWN_NAMES[:width], number), _cholesky(covariance[np.ix_(order, order)]).T, strict=True
    ):
        steps = np.zeros(order.size)
        steps[order] = K * column
        shift = np.tensordot(steps[own], seen.by_unknown[:width], 1)
        found.append(seen.cells.influence(str(name), shift, float(np.abs(column).max())))
    return found


def _cholesky(covariance: Array) -> Array:
    """Lower factor of a covariance whose unknowns have very different units."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
    return np.asarray(scale[:, None] * np.linalg.cholesky(correlation))


def _of_datum(datum: Datum, cells: SeenCells) -> list[Influence]:
    """Where the part's own axis may stand, sideways and leaning."""
    across = np.eye(3)[:2]
    found = [
        cells.influence(line.name, cells.shift(axis * line.U), line.U / 2)
        for line in datum.contributions
        for axis in across
    ]
    if datum.U_slope:
        lever = (cells.point[:, 2:] - datum.height) * datum.U_slope
        found += [
            cells.influence("slope of the datum axis", cells.shift(axis * lever), datum.U_slope / 2) for axis in across
        ]
    return found
