"""The flanks as one view sees them, and by how much each of its own inputs moves what it reads of them.

A field over the flanks is found by moving an input by its U (k = 2) and sending the points of the nominal flanks
through the chain

    p_C = shaft_from_rotor . Rz(-theta) . table_from_sensor . (x, 0, z)

once more. What each figure makes of it is found by evaluating the cells with the field added: no formula of
sensitivities to get wrong (those of the theory page are tests).
"""

from dataclasses import dataclass
from functools import cached_property
from math import acos, pi

import numpy as np

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
from truestand.core.calibration import Calibration
from truestand.core.frames import PLANE_OFFSET, RADIAL, UNKNOWNS
from truestand.core.scan import Scan
from truestand.core.surface import readings_of, seen_at, sensor_origins
from truestand.gear.flanks import LEAST_FACING, Toothing
from truestand.gear.geometry import SIGMA
from truestand.uncertainty.influence import influence_of_view, moved_points, part_from_shaft, retaken
from truestand.uncertainty.lines import diameter_name, expanded_diameter, once_per_turn, stability_name, stability_of
from truestand.uncertainty.range_errors import range_errors

FLANK_ONLY = "incidence"
"""Of steep flanks only: tip and root face the sensor."""
POSITIONER = "place taken by the positioner"


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
    """Places of the nominal flanks as a view sees them; (n, 3) or (n,)."""

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
    """Of the places: (2, teeth, ...)."""

    def shift(self, moved: Array) -> Array:
        """By how much (..., 2, n) mm delta grows, and how far points move away from the axis, that are ``moved``
        (..., n, 3) mm, or all alike by (3,) mm, in C.
        """
        radial = self.point[:, :2] / np.linalg.norm(self.point[:, :2], axis=1, keepdims=True)
        delta = (self.gradient * moved).sum(axis=-1)
        return np.stack([delta, (radial * moved[..., :2]).sum(axis=-1)], axis=-2)

    def influence(self, name: str, shift: Array, u: float, distribution: str = "normal") -> Influence:
        """An input that does a ``shift`` (2, n) mm."""
        delta, outward = shift
        return Influence(name, delta.reshape(self.shape), float(outward.mean()), u, distribution)


@dataclass(frozen=True)
class SeenFlanks:
    """What of a view's inputs is its own, and what each of them does to places of the nominal flanks."""

    scan: Scan
    calibration: Calibration
    toothing: Toothing
    cells: SeenCells
    before_rms: float | None = None
    """mm: by how much the passes of a flank disagreed, as ``GearView`` has it."""

    @cached_property
    def by_unknown(self) -> Array:
        """(``VIEW_UNKNOWNS``, 2, n): ``SeenCells.shift`` by each unknown, azimuth and height; mm per mm or rad."""
        cells = self.cells
        return cells.shift(influence_of_view(self.calibration, cells.point, cells.x, cells.z, cells.theta))

    @cached_property
    def by_delta(self) -> Array:
        """(``VIEW_UNKNOWNS``, n): what of it delta does."""
        return self.by_unknown[:, 0]

    @cached_property
    def of_sensor(self) -> tuple[Influence, ...]:
        """What is one sensor's own: range errors along the ray, what steep incidence does, its radial zero since it was
        calibrated, the place it was brought to, and what wobbles.
        """
        return (
            *self._of_range(), *self._of_incidence(), *self._of_stability(), *self._of_positioner(), *self._of_wobble(),
        )  # fmt: skip

    @cached_property
    def by_sensor(self) -> Array:
        """(errors, n) mm of delta, standard: what these do."""
        return np.stack([influence.field.reshape(-1) / K for influence in self.of_sensor])

    @cached_property
    def by_table(self) -> Array:
        """(errors, n) mm of delta, standard: what ``of_table`` does."""
        return np.stack([influence.field.reshape(-1) / K for influence in self.of_table])

    @cached_property
    def of_shaft(self) -> tuple[Influence, ...]:
        """The radial zero of the sensor by the diameter of the shaft and its temperature."""
        if self.calibration.artefact is None:
            return ()
        base = self.calibration.artefact.base
        diameter, warm = expanded_diameter(base), base.radius * EXPANSION * TEMPERATURE_U
        out, by_heat = (self._by(RADIAL, by) for by in (diameter / 2, warm))
        return (
            self.cells.influence(diameter_name(base), out, diameter / 2),
            self.cells.influence(f"temperature of the artefact{ASSUMED}", by_heat, TEMPERATURE_U / 2, "rectangular"),
        )

    @cached_property
    def of_table(self) -> tuple[Influence, ...]:
        """The table's bearing and its angle: zero, and errors that repeat every turn, which are taken for no less than
        by what turns disagreed; and how the axis moves across the laser plane.
        """
        nominal, cells = self.toothing.nominal, self.cells
        teeth = nominal.gear.teeth
        faster = max(2, teeth // 4)  # the same unevenness of speed, where neighbouring teeth feel it most
        name, U = once_per_turn(self.scan)
        if SPEED in name and name.endswith(ASSUMED):
            U = max(U, 2 * (self.before_rms or 0.0) / nominal.base_radius)
        waves = ((1, name), (faster, name.replace("once", f"{faster} times")))
        stated = self.scan.stand.table.sideways_U
        sideways = SIDEWAYS_U if stated is None else stated
        sideways_name = "sideways motion of the table" + (ASSUMED if stated is None else "")
        bearing, across = f"table bearing{ASSUMED}", np.eye(3)[:2] @ part_from_shaft(self.calibration).rotation.T
        return (
            *(cells.influence(bearing, cells.shift(axis * BEARING_U), BEARING_U / 2) for axis in across),
            self._of_angle_zero(),
            *(
                cells.influence(of, self._turned(U / n * wave(n * cells.theta)), U / n / 2)
                for n, of in waves
                for wave in (np.cos, np.sin)
            ),
            *(i for n in (2, faster) for i in self._of_wave(sideways_name, PLANE_OFFSET, n, sideways)),
        )  # fmt: skip

    def _by(self, unknown: int, by: float) -> Array:
        """The shift (2, n) when one of the unknowns is larger ``by`` so much."""
        return np.asarray(by * self.by_unknown[unknown])

    def _turned(self, angle: Array | float) -> Array:
        """The shift (2, n) when the table's angle is larger by so many rad."""
        cells = self.cells
        moved = moved_points(self.calibration, np.zeros(UNKNOWNS), cells.x, cells.z, cells.theta + angle)
        return cells.shift(moved - cells.point)

    def _of_angle_zero(self) -> Influence:
        known = self.calibration.angle_U
        zero, name = (ANGLE_ZERO_U, ASSUMED) if known is None else (known, "")
        return self.cells.influence(f"zero of the table angle{name}", self._turned(zero), zero / 2, "rectangular")

    def _of_range(self) -> list[Influence]:
        """Errors of range, along the rays, and what the calibration took up of them."""
        z, along = self.cells.z, self.cells.shift(_rays(self.calibration, self.cells))
        return [
            self.cells.influence(e.name, along * e.of_range(z) + np.tensordot(e.taken_up, self.by_unknown, 1), e.u)
            for e in range_errors(self.calibration)
        ]

    def _of_incidence(self) -> list[Influence]:
        """What steep flanks do to their readings: alike everywhere, the more the steeper, and out of proportion: bent,
        and by one wave of half the size.
        """
        steep = self._steepness()
        return [
            self._of_steep(by) for by in (1.0, steep, 4.0 * np.square(steep) - 0.5, np.sin(2 * pi * steep) / 4)
        ]  # fmt: skip

    def _of_steep(self, by: Array | float) -> Influence:
        """Flanks that read farther out by U and a factor (n,)."""
        stated = self.scan.stand.sensor.incidence_U
        U, name = (INCIDENCE_U, ASSUMED) if stated is None else (stated, "")
        gradient = self.cells.gradient
        out = self.cells.shift(U * gradient / np.square(np.linalg.norm(gradient, axis=1, keepdims=True)))
        return self.cells.influence(f"{FLANK_ONLY} on the flanks{name}", out * by, U / 2)

    def _steepness(self) -> Array:
        """How steeply (n,) it is seen: -0.5..0.5 from the least to the most incidence at which the view sees flanks."""
        least, most = self._incidences
        steep = (_incidence(self.calibration, self.cells) - least) / max(most - least, 1e-6)
        return np.asarray(np.clip(steep, 0.0, 1.0) - 0.5)

    @cached_property
    def _incidences(self) -> tuple[float, float]:
        """rad: the least and the most at which the view sees the ends of any profile, at the ends of the face.

        Of the whole gear, not of the places looked at: an input is the same wherever it is asked for.
        """
        nominal, limit = self.toothing.nominal, self.scan.stand.sensor.incidence_limit
        shape = (2, nominal.gear.teeth, 2, 2)
        roll, height = np.broadcast_arrays(np.array(nominal.profile_range)[:, None], nominal.helix_range)
        ends = (np.broadcast_to(of, shape) for of in (roll, height))
        incidence = _incidence(self.calibration, _seen_cells(self.calibration, self.toothing, *ends))
        seen = incidence[incidence < (acos(LEAST_FACING) if limit is None else limit)]
        return (float(seen.min()), float(seen.max())) if seen.size else (0.0, pi / 2)

    def _of_stability(self) -> list[Influence]:
        """The radial zero of the sensor since it was calibrated."""
        since, name = stability_of(self.calibration, self.scan), stability_name(self.calibration.stand.sensor)
        return [self.cells.influence(name, self._by(RADIAL, since), since / 2)] if since else []

    def _of_positioner(self) -> list[Influence]:
        """What a positioner leaves open that has taken the place of the view again."""
        return [
            self.cells.influence(POSITIONER, np.tensordot(K * column, self.by_unknown, 1), float(np.abs(column).max()))
            for column in retaken(self.calibration).T
            if column.any()
        ]

    def _of_wobble(self) -> list[Influence]:
        """Waves that the shaft in view of the part's scan shows, or may hide, in and out of step with them.

        The shaft shows what moves it towards the sensor. A bearing that moves it so moves it sideways as well, or more,
        which no round surface shows and pitch does.
        """
        wobble = self.calibration.wobble
        waves = [] if wobble is None else [("wobble", wobble)]
        waves += [("bearing, or form of the shaft", wave) for wave in self.calibration.shared_waves]
        return [
            influence
            for name, wave in waves
            for unknown, share in ((RADIAL, 1.0), (PLANE_OFFSET, SIDEWAYS_SHARE))
            for influence in self._of_wave(
                f"{name}, {wave.waves} times per turn", unknown, wave.waves, share * wave.amplitude
            )
        ]

    def _of_wave(self, name: str, unknown: int, waves: int, amplitude: float) -> list[Influence]:
        """One of the calibration's unknowns that moves by an ``amplitude`` so many times a turn, in any phase."""
        shift, angle = self._by(unknown, amplitude), waves * self.cells.theta
        return [self.cells.influence(name, shift * wave(angle), amplitude / 2) for wave in (np.cos, np.sin)]


def seen_flanks(
    scan: Scan, calibration: Calibration, toothing: Toothing, roll: Array, height: Array,
    before_rms: float | None = None,
) -> SeenFlanks:  # fmt: skip
    """Places of the flanks, at roll lengths and heights (2, teeth, ...) mm, as a view sees them."""
    return SeenFlanks(scan, calibration, toothing, _seen_cells(calibration, toothing, roll, height), before_rms)


def _seen_cells(calibration: Calibration, toothing: Toothing, roll: Array, height: Array) -> SeenCells:
    side, tooth = np.indices(roll.shape).reshape(roll.ndim, -1)[:2]
    point = toothing.points((side, tooth), roll.reshape(-1), height.reshape(-1), np.zeros(side.size))
    theta = seen_at(calibration, point)
    x, z = readings_of(calibration, point, theta)
    return SeenCells(point, x, z, theta, toothing.gradient(point, SIGMA[side]), roll.shape)


def _rays(calibration: Calibration, cells: SeenCells) -> Array:
    """Away from the sensor (n, 3): from one mm of range to the next."""
    return np.asarray((cells.point - sensor_origins(calibration, cells.theta)) / cells.z[:, None])


def _incidence(calibration: Calibration, cells: SeenCells) -> Array:
    """rad (n,), between a ray and the normal of the flank; over 90 degrees where the flank faces away."""
    rays, normal = _rays(calibration, cells), cells.gradient
    lengths = np.linalg.norm(rays, axis=1) * np.linalg.norm(normal, axis=1)
    return np.asarray(np.arccos(np.clip(-(normal * rays).sum(axis=1) / lengths, -1.0, 1.0)))
