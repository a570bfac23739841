"""What the calibration and the stand leave open, as fields over the flanks: by how much each input of the budget shifts
delta.

A field is found by moving the input by its U (k = 2) and sending the points of the nominal flanks through the chain

    p_C = shaft_from_rotor . Rz(-theta) . table_from_sensor . (x, 0, z)

once more. What each figure makes of it is found by evaluating the cells with the field added: no formula of
sensitivities to get wrong (those of the theory page are tests).
"""

from dataclasses import dataclass
from math import hypot, isfinite, tau

import numpy as np

from truestand.apply.datum import Datum
from truestand.core.arrays import Array
from truestand.core.assumptions import (
    ANGLE_ZERO_U,
    ASSUMED,
    BEARING_U,
    EXPANSION,
    INCIDENCE_U,
    SCALE_U,
    SPEED,
    TEMPERATURE_U,
)
from truestand.core.calibration import Calibration, Contribution
from truestand.core.frames import RADIAL
from truestand.core.scan import Scan
from truestand.core.surface import readings_of, seen_at, sensor_origins
from truestand.gear.evaluate import Evaluator, Figures, evaluate, figures_of
from truestand.gear.flanks import Toothing
from truestand.gear.geometry import SIGMA, Involute
from truestand.gear.grid import Grid
from truestand.uncertainty.influence import points_of, unknowns_of
from truestand.uncertainty.lines import (
    diameter_name,
    expanded_diameter,
    linearity_name,
    linearity_of,
    once_per_turn,
    scale_name,
    stability_name,
    stability_of,
)

LINEARITY_PERIOD = 50.0
"""mm of range over which a sensor's range error swings once, where its range isn't known."""
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

    def influence(self, name: str, moved: Array, u: float, distribution: str = "normal") -> Influence:
        """The effect of moving the points by ``moved`` (n, 3) mm, or all alike by (3,) mm, in C."""
        delta = (self.gradient * moved).sum(axis=1).reshape(self.shape)
        x, y = self.point[:, 0], self.point[:, 1]
        outward = (x * moved[..., 0] + y * moved[..., 1]) / np.hypot(x, y)
        return Influence(name, delta, float(np.mean(outward)), u, distribution)


def influences_of(
    scan: Scan, calibration: Calibration, grid: Grid, toothing: Toothing, uneven: float
) -> tuple[Influence, ...]:
    """Every input of the budget but noise.

    ``uneven``: by how much (mm, rms, along the base circle) turns disagreed; what repeats is taken for no less.
    """
    cells = _seen_cells(calibration, grid, toothing)
    nominal = toothing.nominal
    temperature = nominal.gear.temperature
    grown = cells.point * np.array([1.0, 1.0, 0.0]) * temperature.expanded_growth
    return (
        *_of_calibration(calibration, cells),
        *_of_sensor(scan, calibration, cells),
        *_of_radial_zero(scan, calibration, cells),
        *_of_table(scan, calibration, cells, nominal.gear.teeth, 2 * uneven / nominal.base_radius),
        *_of_datum(toothing.datum, cells),
        cells.influence(temperature.line, grown, temperature.expanded / 2, "rectangular"),
    )  # fmt: skip


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


def _seen_cells(calibration: Calibration, grid: Grid, toothing: Toothing) -> SeenCells:
    nominal, pose = toothing.nominal, toothing.datum.pose
    side, tooth, _, _ = np.indices(grid.delta.shape).reshape(4, -1)
    point = toothing.points((side, tooth), grid.roll.reshape(-1), grid.height.reshape(-1), np.zeros(side.size))
    gradient = _gradient(nominal, pose(point), SIGMA[side]) @ pose.rotation
    theta = seen_at(calibration, point)
    x, z = readings_of(calibration, point, theta)
    return SeenCells(point, x, z, theta, gradient, grid.delta.shape)


def _gradient(nominal: Involute, points: Array, side: Array) -> Array:
    """Of delta over ``points`` (n, 3) in the datum's frame: sigma rb dtheta + sin alpha dr - sigma rb twist dz."""
    rb, radius = nominal.base_radius, np.hypot(points[:, 0], points[:, 1])
    c, s = points[:, 0] / radius, points[:, 1] / radius
    sine = np.sqrt(np.maximum(1.0 - (rb / radius) ** 2, 0.0))
    around = side * rb / radius
    return np.stack([sine * c - around * s, sine * s + around * c, -side * rb * nominal.twist], axis=1)


def _of_calibration(calibration: Calibration, cells: SeenCells) -> list[Influence]:
    """The covariance of its unknowns, in Cholesky's order: each line with what moves along."""
    covariance = calibration.covariance
    if covariance.shape[0] < len(UNKNOWN_ORDER):
        return []
    order = np.array(UNKNOWN_ORDER)
    factor = _cholesky(covariance[np.ix_(order, order)])
    parameters, height = unknowns_of(calibration)
    found = []
    for name, column in zip(UNKNOWN_NAMES, factor.T, strict=True):
        step = np.zeros(len(UNKNOWN_ORDER))
        step[order] = 2 * column
        moved = points_of(parameters + step, height, cells.x, cells.z, cells.theta) - cells.point
        found.append(cells.influence(name, moved, float(np.abs(column).max())))
    return found


def _cholesky(covariance: Array) -> Array:
    """Lower factor of a covariance whose unknowns have very different units."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
    return np.asarray(scale[:, None] * np.linalg.cholesky(correlation))


def _of_sensor(scan: Scan, calibration: Calibration, cells: SeenCells) -> list[Influence]:
    """Range errors along the ray, and what steep incidence does."""
    sensor = scan.stand.sensor
    direction = (cells.point - sensor_origins(calibration, cells.theta)) / cells.z[:, None]  # of one unit of range
    z = cells.z
    linearity, name = linearity_of(sensor, calibration.static_profiles), linearity_name(sensor)
    period = LINEARITY_PERIOD if sensor.range is None else sensor.range[1] - sensor.range[0]
    wave = linearity * tau / period * (z - z.mean())
    scale = SCALE_U if sensor.scale_U is None else sensor.scale_U
    stated = "" if sensor.incidence_U is not None else ASSUMED
    incidence = INCIDENCE_U if sensor.incidence_U is None else sensor.incidence_U
    steep = _steepness(cells, direction)
    normal = cells.gradient / np.square(np.linalg.norm(cells.gradient, axis=1, keepdims=True))  # delta of 1
    stretched = scale * (z - _shaft_range(calibration, z))
    return [
        cells.influence(name, direction * linearity, linearity / 2),
        cells.influence(name, direction * wave[:, None], linearity / 2),
        cells.influence(scale_name(sensor), direction * stretched[:, None], scale / 2),
        cells.influence(f"incidence on the flanks{stated}", normal * incidence, incidence / 2),
        cells.influence(f"incidence on the flanks{stated}", normal * (incidence * steep)[:, None], incidence / 2),
    ]


def _of_radial_zero(scan: Scan, calibration: Calibration, cells: SeenCells) -> list[Influence]:
    """The radial zero of the sensor, by its stability, the diameter of the shaft and its temperature."""
    parameters, height = unknowns_of(calibration)

    def moved_out(by: float) -> Array:
        moved = parameters.copy()
        moved[RADIAL] += by
        return points_of(moved, height, cells.x, cells.z, cells.theta) - cells.point

    since, name = stability_of(calibration, scan), stability_name(calibration.stand.sensor)
    stability = [cells.influence(name, moved_out(since), since / 2)] if since else []
    if calibration.artefact is None:
        return stability
    base = calibration.artefact.base
    diameter, warm = expanded_diameter(base), base.radius * EXPANSION * TEMPERATURE_U
    return [
        *stability,
        cells.influence(diameter_name(base), moved_out(diameter / 2), diameter / 2),
        cells.influence(f"temperature of the artefact{ASSUMED}", moved_out(warm), TEMPERATURE_U / 2, "rectangular"),
    ]


def _steepness(cells: SeenCells, direction: Array) -> Array:
    """-0.5..0.5 over the flank: how steeply it is seen, in the middle 0."""
    normal = cells.gradient / np.linalg.norm(cells.gradient, axis=1, keepdims=True)
    incidence = np.arccos(
        np.clip(np.abs((normal * direction).sum(axis=1)) / np.linalg.norm(direction, axis=1), 0.0, 1.0)
    )
    low, high = np.quantile(incidence, [0.02, 0.98])
    return np.asarray(np.clip((incidence - low) / max(high - low, 1e-6), 0.0, 1.0) - 0.5)


def _shaft_range(calibration: Calibration, z: Array) -> float:
    """Range at which the base of the shaft was seen: there the sensor's zero is tied to a diameter."""
    if calibration.artefact is None:
        return float(z.mean())
    across = calibration.table_from_sensor.rotation[0]
    gap = calibration.table_from_sensor.translation[0] - calibration.artefact.base.radius
    return float(gap / max(-across[2], 1e-3))


def _of_table(scan: Scan, calibration: Calibration, cells: SeenCells, teeth: int, uneven: float) -> list[Influence]:
    """The table's bearing and its angle: zero, and errors that repeat every turn; ``uneven``: rad, k = 2."""
    parameters, height = unknowns_of(calibration)

    def rotated(angle: Array | float) -> Array:
        return points_of(parameters, height, cells.x, cells.z, cells.theta + angle) - cells.point

    name, U = once_per_turn(scan)
    if SPEED in name and name.endswith(ASSUMED):
        U = max(U, uneven)
    faster = max(2, teeth // 4)  # the same unevenness of speed, where neighbouring teeth feel it most
    waves = ((1, name), (faster, name.replace("once", f"{faster} times")))
    zero = ANGLE_ZERO_U if calibration.angle_U is None else calibration.angle_U
    zero_name = "zero of the table angle" + (ASSUMED if calibration.angle_U is None else "")
    return [
        *(cells.influence(f"table bearing{ASSUMED}", axis * BEARING_U, BEARING_U / 2) for axis in np.eye(3)[:2]),
        cells.influence(zero_name, rotated(zero), zero / 2, "rectangular"),
        *(
            cells.influence(name, rotated(U / n * wave(n * cells.theta)), U / n / 2)
            for n, name in waves
            for wave in (np.cos, np.sin)
        ),
    ]


def _of_datum(datum: Datum, cells: SeenCells) -> list[Influence]:
    """Where the part's own axis may stand, sideways and leaning."""
    across = np.eye(3)[:2]
    found = [cells.influence(line.name, axis * line.U, line.U / 2) for line in datum.contributions for axis in across]
    if datum.U_slope:
        lever = (cells.point[:, 2:] - datum.height) * datum.U_slope
        found += [cells.influence("slope of the datum axis", axis * lever, datum.U_slope / 2) for axis in across]
    return found
