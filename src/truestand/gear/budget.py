"""What the calibration and the stand leave open, as fields over the flanks: by how much each input of the budget shifts
delta.

A field is found by moving the input by its U (k = 2) and sending the points of the nominal flanks through the chain

    p_C = shaft_from_rotor . Rz(-theta) . table_from_sensor . (x, 0, z)

once more. What each figure makes of it is found by evaluating the cells with the field added: no formula of
sensitivities to get wrong (those of the theory page are tests).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, isfinite

import numpy as np

from truestand.apply.datum import Datum
from truestand.core.arrays import Array
from truestand.core.assumptions import (
    ANGLE_ZERO_U,
    ASSUMED,
    BEARING_U,
    EXPANSION,
    INCIDENCE_U,
    SIDEWAYS_SHARE,
    SIDEWAYS_U,
    SPEED,
    TEMPERATURE_U,
    K,
)
from truestand.core.calibration import HEIGHT, VIEW_UNKNOWNS, Calibration, Contribution
from truestand.core.frames import PLANE_OFFSET, RADIAL, UNKNOWNS
from truestand.core.scan import Scan
from truestand.core.surface import readings_of, seen_at, sensor_origins
from truestand.gear.evaluate import Evaluator, Figures, evaluate, figures_of
from truestand.gear.flanks import Flanks, Toothing
from truestand.gear.geometry import SIGMA, Involute
from truestand.gear.grid import Grid, cell_of
from truestand.gear.levels import levelled_fields
from truestand.gear.views import GearView, view_of
from truestand.uncertainty.influence import (
    influence_of_view,
    joint_covariance,
    moved_points,
    part_from_shaft,
    retaken,
)
from truestand.uncertainty.lines import (
    diameter_name,
    expanded_diameter,
    once_per_turn,
    stability_name,
    stability_of,
)
from truestand.uncertainty.range_errors import RangeError, range_errors

UNKNOWN_ORDER = (2, 3, 0, 1, 4, 5, 6, 7)
"""The calibration's unknowns in the order of the budget; each with what moves along with it."""
BETWEEN_READINGS = "between readings"
"""Line of what lies between the readings and beyond them (``evaluate.sampling_of``)."""
FLANK_ONLY = "incidence"
"""Of steep flanks only: tip and root face the sensor."""
UNKNOWN_NAMES = (
    "lateral offset of the laser plane", "skew of the laser line",
    "angle and radial zero of the sensor", "angle and radial zero of the sensor",
    *("axis of the shaft",) * 4,
)  # fmt: skip
POSITIONER = "place taken by the positioner"
AZIMUTH_NAME, HEIGHT_NAME = "azimuth between views", "height between views"


@dataclass(frozen=True, slots=True)
class Influence:
    """One input of the budget, moved by its U (k = 2)."""

    name: str
    field: Array
    """delta (2, teeth, roll lengths, heights) mm."""
    outward: float
    """By how much the part's surface moves away from its axis, mean all round, mm."""
    u: float
    """Standard uncertainty of the input itself (mm, rad, K or relative)."""
    distribution: str = "normal"


@dataclass(frozen=True, slots=True)
class SeenCells:
    """The cells of the nominal flanks as the stand sees them; (n, 3) or (n,)."""

    point: Array
    """In C."""
    x: Array
    z: Array
    """The sensor's readings of them, mm."""
    theta: Array
    """Table angle at which the laser plane meets it."""
    gradient: Array
    """Of delta over the point's position in C."""
    shape: tuple[int, ...]
    """Of the cells: (2, teeth, roll lengths, heights)."""

    def moved(self, calibration: Calibration, step: Array, turned: Array | float = 0.0) -> Array:
        """How they move (n, 3) mm when the calibration's unknowns are off by ``step`` (8,), or the table's angle by
        ``turned`` rad.
        """
        return moved_points(calibration, step, self.x, self.z, self.theta + turned) - self.point

    def moves(self, calibration: Calibration) -> Array:
        """How they move with each unknown of a view, its azimuth and its height: (``VIEW_UNKNOWNS``, n, 3) mm per mm or
        rad.
        """
        return influence_of_view(calibration, self.point, self.x, self.z, self.theta)

    def influence(self, name: str, moved: Array, u: float, distribution: str = "normal") -> Influence:
        """The effect of moving the points by ``moved`` (n, 3) mm, or all alike by (3,) mm, in C."""
        delta = (self.gradient * moved).sum(axis=1).reshape(self.shape)
        x, y = self.point[:, 0], self.point[:, 1]
        outward = (x * moved[..., 0] + y * moved[..., 1]) / np.hypot(x, y)
        return Influence(name, delta, float(np.mean(outward)), u, distribution)


@dataclass(frozen=True, slots=True)
class Weighed:
    """A scan by a calibration, and what it has of each cell."""

    scan: Scan
    calibration: Calibration
    before_rms: float | None = None
    """mm: by how much the passes of a flank disagreed, as ``GearView`` has it."""
    share: Array | None = None
    """Of each cell's points that are the view's, (2, teeth, roll lengths, heights); None: all."""


def weighed(views: Sequence[GearView], flanks: Flanks, grid: Grid) -> tuple[Weighed, ...]:
    """Each view with its share of the points of every cell; of a cell that none shows, all have the same."""
    if len(views) == 1:
        return (_of_view(views[0]),)
    of_view = view_of(flanks, views)
    cell = cell_of(flanks, grid.nominal, grid.rolls.size, grid.edges)
    counts = [np.bincount(cell[of_view == k], minlength=grid.delta.size) for k in range(len(views))]
    total = np.sum(counts, axis=0)
    shares = [np.where(total > 0, n / np.maximum(total, 1), 1 / len(views)).reshape(grid.delta.shape) for n in counts]
    return tuple(_of_view(view, share) for view, share in zip(views, shares, strict=True))


def _of_view(view: GearView, share: Array | None = None) -> Weighed:
    return Weighed(view.scan, view.calibration, view.before_rms, share)


def influences_of(views: tuple[Weighed, ...], grid: Grid, toothing: Toothing) -> tuple[Influence, ...]:
    """Every input of the budget but noise."""
    seen = tuple((w, seen_cells(w.calibration, toothing, grid.roll, grid.height)) for w in views)
    cells, temperature = seen[0][1], toothing.nominal.gear.temperature
    grown = cells.point * np.array([1.0, 1.0, 0.0]) * temperature.expanded_growth
    return (
        *_together([_of_calibration(views, k, cells) for k, (_, cells) in enumerate(seen)], views, grid),
        *_of_sensors(seen, grid),
        *_together([_of_shaft(w.calibration, cells) for w, cells in seen], views, grid),
        *_together([_of_table(w, cells, toothing.nominal) for w, cells in seen], views, grid),
        *_of_datum(toothing.datum, cells),
        cells.influence(temperature.line, grown, temperature.expanded / 2, "rectangular"),
    )  # fmt: skip


def _of_sensors(seen: tuple[tuple[Weighed, SeenCells], ...], grid: Grid) -> list[Influence]:
    """What is each sensor's own: the same in all scans that it took, of a part that was clamped again."""
    views = tuple(view for view, _ in seen)
    found = []
    for name in dict.fromkeys(view.calibration.name for view in views):
        own = [of_sensor(w.scan, w.calibration, cells) if w.calibration.name == name else [] for w, cells in seen]
        found += _together(own, views, grid)
    return found


def _together(of_views: list[list[Influence]], views: tuple[Weighed, ...], grid: Grid) -> list[Influence]:
    """Inputs that all views share: each moves the readings of all of them at once. A view may lack some: what wobbles
    in one scan need not do so in another.
    """
    if len(views) == 1:
        return of_views[0]
    by_input: dict[tuple[str, int], list[Influence | None]] = {}
    for k, influences in enumerate(of_views):
        number: dict[str, int] = {}
        for influence in influences:
            key = influence.name, number.get(influence.name, 0)
            number[influence.name] = key[1] + 1
            by_input.setdefault(key, [None] * len(views))[k] = influence
    return [_joined(found, views, grid) for found in by_input.values()]


def _joined(of_views: list[Influence | None], views: tuple[Weighed, ...], grid: Grid) -> Influence:
    """One input that moves the readings of several views, as far as these count in each cell and are not laid onto each
    other.
    """
    first = next(influence for influence in of_views if influence is not None)
    shares = np.stack([np.ones(grid.delta.shape) if w.share is None else w.share for w in views])
    fields = np.stack([np.zeros(grid.delta.shape) if i is None else i.field for i in of_views])
    fields = np.where(shares > 0, fields, 0.0)
    left = levelled_fields(fields, shares, [w.calibration.reader for w in views], grid)
    outward = sum(i.outward * float(share.mean()) for i, share in zip(of_views, shares, strict=True) if i is not None)
    return replace(first, field=(left * shares).sum(axis=0), outward=float(outward))


def radial_lines(influences: tuple[Influence, ...]) -> tuple[Contribution, ...]:
    """The budget (U, k = 2, mm) of a diameter of the part: twice what each input moves its surface out by."""
    lines: dict[str, Contribution] = {}
    for i in influences:
        before = lines[i.name].U if i.name in lines else 0.0
        lines[i.name] = Contribution(i.name, hypot(before, 2 * i.outward), i.u, i.distribution)
    return tuple(c for c in lines.values() if c.U > 1e-6 and not c.name.startswith(FLANK_ONLY))


def expanded(influences: tuple[Influence, ...], evaluator: Evaluator) -> dict[str, Figures]:
    """U (k = 2, mm) of each figure by the name of the input; inputs of one name are joined."""
    nominal, delta = evaluator.grid.nominal, np.nan_to_num(evaluator.grid.delta)
    base = figures_of(evaluate(delta, evaluator), nominal)
    by_input: dict[str, Figures] = {}
    for i in influences:
        up, down = (figures_of(evaluate(delta + s * i.field, evaluator), nominal) for s in (1.0, -1.0))
        joined = by_input.setdefault(i.name, {n: np.zeros_like(v) for n, v in base.items()})
        for n, value in base.items():
            joined[n] = np.hypot(joined[n], np.fmax(np.abs(up[n] - value), np.abs(down[n] - value)))
    return by_input


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


def seen_cells(calibration: Calibration, toothing: Toothing, roll: Array, height: Array) -> SeenCells:
    """Places of the nominal flanks, at roll lengths and heights (2, teeth, ...) mm, as a view sees them."""
    side, tooth = np.indices(roll.shape).reshape(roll.ndim, -1)[:2]
    point = toothing.points((side, tooth), roll.reshape(-1), height.reshape(-1), np.zeros(side.size))
    gradient = toothing.gradient(point, SIGMA[side])
    theta = seen_at(calibration, point)
    x, z = readings_of(calibration, point, theta)
    return SeenCells(point, x, z, theta, gradient, roll.shape)


def _of_calibration(views: tuple[Weighed, ...], k: int, cells: SeenCells) -> list[Influence]:
    """What the covariance of the calibration's unknowns does to view ``k``, in Cholesky's order: each line with what
    moves along. Of several views, all their unknowns together; scans by one view have the same.
    """
    calibration = views[k].calibration
    if len({view.calibration.name for view in views}) > 1:
        return _of_joint_calibration(views, k, cells)
    covariance = calibration.covariance
    if covariance.shape[0] < UNKNOWNS:
        return []
    order = np.array(UNKNOWN_ORDER)
    factor = _cholesky(covariance[np.ix_(order, order)])
    found = []
    for name, column in zip(UNKNOWN_NAMES, factor.T, strict=True):
        step = np.zeros(UNKNOWNS)
        step[order] = 2 * column
        found.append(cells.influence(name, cells.moved(calibration, step), float(np.abs(column).max())))
    return found


def _of_joint_calibration(views: tuple[Weighed, ...], k: int, cells: SeenCells) -> list[Influence]:
    """The same of the covariance of all views together, what they share counted once."""
    covariance = joint_covariance([w.calibration for w in views])
    if covariance is None:
        return []
    block = VIEW_UNKNOWNS * np.arange(len(views))
    order = np.concatenate([block + u for u in (*UNKNOWN_ORDER, UNKNOWNS, UNKNOWNS + 1)])
    names = [name for name in (*UNKNOWN_NAMES, AZIMUTH_NAME, HEIGHT_NAME) for _ in views]
    factor, moves = _cholesky(covariance[np.ix_(order, order)]), cells.moves(views[k].calibration)
    found = []
    for name, column in zip(names, factor.T, strict=True):
        steps = np.zeros(covariance.shape[0])
        steps[order] = 2 * column
        moved = np.tensordot(steps[block[k] : block[k] + VIEW_UNKNOWNS], moves, 1)
        found.append(cells.influence(name, moved, float(np.abs(column).max())))
    return found


def _cholesky(covariance: Array) -> Array:
    """Lower factor of a covariance whose unknowns have very different units."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
    return np.asarray(scale[:, None] * np.linalg.cholesky(correlation))


def _of_positioner(calibration: Calibration, cells: SeenCells) -> list[Influence]:
    """What a positioner leaves open that has taken the place of a view again."""
    columns = retaken(calibration)
    if not columns.size:
        return []
    moves = cells.moves(calibration)
    return [
        cells.influence(POSITIONER, np.tensordot(K * column, moves, 1), float(np.abs(column).max()))
        for column in columns.T
        if column.any()
    ]


def of_sensor(scan: Scan, calibration: Calibration, cells: SeenCells) -> list[Influence]:
    """What is one sensor's own: range errors along the ray, what steep incidence does, its radial zero since it was
    calibrated.
    """
    sensor = scan.stand.sensor
    direction = (cells.point - sensor_origins(calibration, cells.theta)) / cells.z[:, None]  # of one unit of range
    stated = "" if sensor.incidence_U is not None else ASSUMED
    incidence = INCIDENCE_U if sensor.incidence_U is None else sensor.incidence_U
    steep = _steepness(cells, direction)
    normal = cells.gradient / np.square(np.linalg.norm(cells.gradient, axis=1, keepdims=True))  # delta of 1
    return [
        *_of_range(calibration, cells, direction),
        cells.influence(f"incidence on the flanks{stated}", normal * incidence, incidence / 2),
        cells.influence(f"incidence on the flanks{stated}", normal * (incidence * steep)[:, None], incidence / 2),
        *_of_stability(scan, calibration, cells),
        *_of_positioner(calibration, cells),
        *_of_wobble(calibration, cells),
    ]


def _of_range(calibration: Calibration, cells: SeenCells, direction: Array) -> list[Influence]:
    """Errors of range, which move a reading by its ``direction`` (n, 3), and what the calibration took up of them."""
    up = part_from_shaft(calibration).rotation[:, 2]

    def moved(error: RangeError) -> Array:
        by_sensor = cells.moved(calibration, error.taken_up[:UNKNOWNS]) + error.taken_up[HEIGHT] * up
        return np.asarray(direction * error.of_range(cells.z)[:, None] + by_sensor)

    return [cells.influence(error.name, moved(error), error.u) for error in range_errors(calibration)]


def _of_stability(scan: Scan, calibration: Calibration, cells: SeenCells) -> list[Influence]:
    """The radial zero of the sensor since it was calibrated."""
    since, name = stability_of(calibration, scan), stability_name(calibration.stand.sensor)
    return [cells.influence(name, _moved(calibration, cells, RADIAL, since), since / 2)] if since else []


def _of_wobble(calibration: Calibration, cells: SeenCells) -> list[Influence]:
    """Waves that the shaft in view of the part's scan shows, or may hide, in and out of step with them.

    The shaft shows what moves it towards the sensor. A bearing that moves it so moves it sideways as well, or more,
    which no round surface shows and pitch does.
    """
    waves = [] if calibration.wobble is None else [("wobble", calibration.wobble)]
    waves += [("bearing, or form of the shaft", wave) for wave in calibration.shared_waves]
    return [
        influence
        for name, wobble in waves
        for unknown, share in ((RADIAL, 1.0), (PLANE_OFFSET, SIDEWAYS_SHARE))
        for influence in _of_wave(
            f"{name}, {wobble.waves} times per turn",
            calibration,
            cells,
            unknown,
            wobble.waves,
            share * wobble.amplitude,
        )
    ]


def _of_wave(
    name: str, calibration: Calibration, cells: SeenCells, unknown: int, waves: int, amplitude: float
) -> list[Influence]:
    """One of the calibration's unknowns that moves by an ``amplitude`` so many times a turn, in any phase."""
    moved = _moved(calibration, cells, unknown, amplitude)
    phases = [wave(waves * cells.theta)[:, None] for wave in (np.cos, np.sin)]
    return [cells.influence(name, moved * phase, amplitude / 2) for phase in phases]


def _of_shaft(calibration: Calibration, cells: SeenCells) -> list[Influence]:
    """The radial zero of the sensor by the diameter of the shaft and its temperature."""
    if calibration.artefact is None:
        return []
    base = calibration.artefact.base
    diameter, warm = expanded_diameter(base), base.radius * EXPANSION * TEMPERATURE_U
    out, by_heat = (_moved(calibration, cells, RADIAL, by) for by in (diameter / 2, warm))
    return [
        cells.influence(diameter_name(base), out, diameter / 2),
        cells.influence(f"temperature of the artefact{ASSUMED}", by_heat, TEMPERATURE_U / 2, "rectangular"),
    ]


def _moved(calibration: Calibration, cells: SeenCells, unknown: int, by: float) -> Array:
    """How the points move (n, 3) mm when one of the calibration's unknowns is larger ``by`` so much."""
    step = np.zeros(UNKNOWNS)
    step[unknown] = by
    return cells.moved(calibration, step)


def _steepness(cells: SeenCells, direction: Array) -> Array:
    """-0.5..0.5 over the flank: how steeply it is seen, in the middle 0."""
    normal = cells.gradient / np.linalg.norm(cells.gradient, axis=1, keepdims=True)
    incidence = np.arccos(
        np.clip(np.abs((normal * direction).sum(axis=1)) / np.linalg.norm(direction, axis=1), 0.0, 1.0)
    )
    low, high = np.quantile(incidence, [0.02, 0.98])
    return np.asarray(np.clip((incidence - low) / max(high - low, 1e-6), 0.0, 1.0) - 0.5)


def _of_table(view: Weighed, cells: SeenCells, nominal: Involute) -> list[Influence]:
    """The table's bearing and its angle: zero, and errors that repeat every turn, which are taken for no less than by
    what turns disagreed; and how the axis moves across the laser plane.
    """
    calibration, teeth = view.calibration, nominal.gear.teeth
    uneven = 2 * (view.before_rms or 0.0) / nominal.base_radius

    def rotated(angle: Array | float) -> Array:
        return cells.moved(calibration, np.zeros(UNKNOWNS), angle)

    name, U = once_per_turn(view.scan)
    if SPEED in name and name.endswith(ASSUMED):
        U = max(U, uneven)
    faster = max(2, teeth // 4)  # the same unevenness of speed, where neighbouring teeth feel it most
    waves = ((1, name), (faster, name.replace("once", f"{faster} times")))
    stated = view.scan.stand.table.sideways_U
    sideways = SIDEWAYS_U if stated is None else stated
    sideways_name = "sideways motion of the table" + (ASSUMED if stated is None else "")
    across = np.eye(3)[:2] @ part_from_shaft(calibration).rotation.T
    zero = ANGLE_ZERO_U if calibration.angle_U is None else calibration.angle_U
    zero_name = "zero of the table angle" + (ASSUMED if calibration.angle_U is None else "")
    return [
        *(cells.influence(f"table bearing{ASSUMED}", axis * BEARING_U, BEARING_U / 2) for axis in across),
        cells.influence(zero_name, rotated(zero), zero / 2, "rectangular"),
        *(
            cells.influence(name, rotated(U / n * wave(n * cells.theta)), U / n / 2)
            for n, name in waves
            for wave in (np.cos, np.sin)
        ),
        *(wave for n in (2, faster) for wave in _of_wave(sideways_name, calibration, cells, PLANE_OFFSET, n, sideways)),
    ]


def _of_datum(datum: Datum, cells: SeenCells) -> list[Influence]:
    """Where the part's own axis may stand, sideways and leaning."""
    across = np.eye(3)[:2]
    found = [cells.influence(line.name, axis * line.U, line.U / 2) for line in datum.contributions for axis in across]
    if datum.U_slope:
        lever = (cells.point[:, 2:] - datum.height) * datum.U_slope
        found += [cells.influence("slope of the datum axis", axis * lever, datum.U_slope / 2) for axis in across]
    return found
