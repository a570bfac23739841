"""What the virtual stand simulates: mm, rad, s. The defaults are the stand of the paper without its disturbances.

The paper: Klarák et al., Sensors 2022, 22, 5306; stand, shaft and scan as far as it states them.
"""

from dataclasses import dataclass, field, replace
from math import cos, pi, radians, sin

from truestand.core.artefact import Artefact, Cylinder
from truestand.core.errors import BadRecipe
from truestand.core.stand import Sensor, Stand, Table

DEFAULT_COUNTS_PER_TURN = 36000
"""Of an encoder, where the stand states none."""


@dataclass(frozen=True, slots=True)
class Mounting:
    """The sensor's pose, all six degrees of freedom."""

    phi: float = radians(-41.802)
    """Angle between rotation axis and sensor z."""
    standoff: float = 95.0
    """Range at which the middle of the fan meets the round, centred base cylinder."""
    height: float = -1.0
    """Height at which it meets it."""
    plane_tilt: float = 0.0
    plane_offset: float = 0.0
    azimuth: float = 0.0
    """Azimuth of the sensor around the table, in the laboratory; directions of eccentricity and tilt count from it."""


@dataclass(frozen=True, slots=True)
class Running:
    """Offset and tilt of the shaft axis against the rotation axis; azimuths in the laboratory at table angle 0."""

    eccentricity: float = 0.8789
    eccentricity_direction: float = 0.0
    tilt: float = 0.0
    tilt_direction: float = 0.0


@dataclass(frozen=True, slots=True)
class FormWave:
    """amplitude cos(upr psi - phase) on one surface, positive outwards."""

    surface: str
    upr: int
    amplitude: float
    phase: float = 0.0


@dataclass(frozen=True, slots=True)
class Keyway:
    """A slot: material missing to ``depth`` over ``width`` at ``azimuth``, between two heights."""

    surface: str
    azimuth: float
    width: float
    depth: float
    bottom: float = -1e9
    top: float = 1e9


@dataclass(frozen=True, slots=True)
class Patch:
    """A sector of one surface, over its whole length: ``share`` 0..1 of a turn, its middle at ``azimuth``."""

    surface: str
    azimuth: float
    share: float
    height: float | None = None
    """mm of dirt on it; None: a milled flat."""
    soft: float = 0.0
    """rad over which the edges of dirt rise."""


@dataclass(frozen=True, slots=True)
class Misalignment:
    """A step whose axis deviates from that of the base: lateral offset at its middle, and slopes."""

    surface: str
    offset_x: float = 0.0
    offset_y: float = 0.0
    slope_x: float = 0.0
    slope_y: float = 0.0


@dataclass(frozen=True, slots=True)
class Workpiece:
    """Deviations of the real shaft from its drawing."""

    form: tuple[FormWave, ...] = ()
    keyways: tuple[Keyway, ...] = ()
    misalignments: tuple[Misalignment, ...] = ()
    diameter_errors: tuple[tuple[str, float], ...] = ()
    patches: tuple[Patch, ...] = ()
    """Flats and dirt."""
    fillet: float = 0.0
    """Radius in every inner corner at a shoulder."""
    chamfer: float = 0.0
    """Leg of the 45 degree chamfer on every outer edge at a shoulder."""
    table_disc: float | None = None
    """Height of the table's face; None: out of view."""
    clamped: float = 0.0
    """Angle of the shaft in its clamping (rad), ccw from above; it turns form, slots, dirt and the axes of steps."""

    def misalignment_of(self, surface: str) -> Misalignment:
        """The misalignment of a step; zero where none is stated."""
        return next((m for m in self.misalignments if m.surface == surface), Misalignment(surface))

    def in_shaft_frame(self) -> "Workpiece":
        """The same with the angle of the clamping applied: azimuths in C, which has no twist against the table."""
        c, s = cos(self.clamped), sin(self.clamped)
        return replace(
            self,
            form=tuple(replace(f, phase=f.phase + f.upr * self.clamped) for f in self.form),
            keyways=tuple(replace(k, azimuth=k.azimuth + self.clamped) for k in self.keyways),
            patches=tuple(replace(p, azimuth=p.azimuth + self.clamped) for p in self.patches),
            misalignments=tuple(
                Misalignment(
                    m.surface, c * m.offset_x - s * m.offset_y, s * m.offset_x + c * m.offset_y,
                    c * m.slope_x - s * m.slope_y, s * m.slope_x + c * m.slope_y,
                )
                for m in self.misalignments
            ),
            clamped=0.0,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Optics:
    """Optics of the sensor, and the errors that it adds to the geometry."""

    fan: float = 0.28
    """Full opening of the laser fan."""
    noise: float = 0.004
    """White, along the range."""
    correlated_noise: float = 0.0
    correlation: int = 8
    """Points over which the correlated noise is averaged."""
    speckle: float = 0.0
    """Standard deviation of an error fixed to the surface: it repeats every turn."""
    speckle_cell: float = 0.1
    nonlinearity: float = 0.0
    """Amplitude of a smooth range error: one sine over the range."""
    nonlinearity_phase: float = 1.0
    faster_nonlinearity: tuple[tuple[int, float, float], ...] = ()
    """More of it: sines so many times over the range, each with its amplitude (mm) and phase."""
    scale_error: float = 0.0
    """Relative, of the range about its middle."""
    step_z: float = 0.004
    step_x: float = 0.001
    """Resolution; 0 = none."""
    triangulation: float = 0.0
    """Angle between laser and camera, sideways; 0 = no occlusion: the camera sees all that the laser meets."""
    incidence_noise: bool = False
    """White noise grows with 1 / cos of the incidence (between ray and surface normal), up to twentyfold."""
    incidence_bias: float = 0.0
    """mm: the range reads this times (1 / cos(incidence) - 1) more, up to nineteen times."""
    flank_bias: tuple[tuple[float, float], ...] = ()
    """(incidence, mm): by how much a surface so inclined reads as if it lay farther out along its normal; linear
    between them, constant beyond.
    """
    most_incidence: float = radians(88.0)
    """Beyond this angle of incidence no reading comes back; applied where a part is on the shaft."""
    mixed_pixels: float = 0.0
    """Share of readings next to an edge that come back from between both surfaces."""
    outliers: float = 0.0
    """Share of readings that lie anywhere in the range."""
    ghosts: float = 0.0
    """Share of readings near the shoulder with a double reflection from the other step."""
    reflection: float = 0.0
    """Share of readings, at random, that come back from one place that does not turn."""
    dropouts: float = 0.0
    """Share of readings lost at random."""
    patches: int = 0
    """Whole patches lost (40 profiles by 30 points)."""


@dataclass(frozen=True, slots=True)
class Acquisition:
    """Acquisition of the scan."""

    profiles: int = 11000
    start_angle: float = 0.0
    columns: tuple[str, ...] = ()
    """Columns of the scan: angle, time, encoder, counter."""
    speed_factor: float = 1.0
    """True over stated table speed."""
    ripple: float = 0.0
    """Relative speed ripple."""
    ripple_per_turn: int = 1
    ramp: float = 0.0
    """s: start-up at constant acceleration."""
    dropped: int = 0
    """Number of profiles lost, in up to five gaps."""


@dataclass(frozen=True, slots=True)
class Simulation:
    """One virtual scan."""

    mounting: Mounting = field(default_factory=Mounting)
    running: Running = field(default_factory=Running)
    workpiece: Workpiece = field(default_factory=Workpiece)
    optics: Optics = field(default_factory=Optics)
    acquisition: Acquisition = field(default_factory=Acquisition)
    views: tuple[tuple[str, Mounting], ...] = ()
    """Where each sensor stands, by its name; empty: one sensor, at ``mounting``."""

    def seen_from(self, view: str) -> "Simulation":
        """The same as the sensor of that name sees it: in C of its own frames the workpiece is turned back by as much
        as it stands farther round the table than ``mounting``.

        Raises:
            BadRecipe: several sensors, none of that name.
        """
        if not self.views:
            return self
        mounting = dict(self.views).get(view)
        if mounting is None:
            names = ", ".join(repr(name) for name, _ in self.views)
            raise BadRecipe(f"found view {view!r}, need one of the [[simulation.view]]s: {names}")
        return replace(self.mounted(mounting), views=())

    def mounted(self, mounting: Mounting) -> "Simulation":
        """The same with the sensor elsewhere."""
        turned = mounting.azimuth - self.mounting.azimuth
        workpiece = replace(self.workpiece, clamped=self.workpiece.clamped - turned)
        return replace(self, mounting=mounting, workpiece=workpiece)


def speed_and_rate(stand: Stand) -> tuple[float, float]:
    """Speed of the table (rad/s) and profiles per second; those of the paper where the stand states none."""
    return stand.table.speed or pi / 10, stand.sensor.profile_rate or 200.0


def paper_stand() -> Stand:
    """The stand of the paper: 200 profiles/s of 640 points, 70..120 mm, pi/10 rad/s."""
    sensor = Sensor("front", 200.0, 640, (70.0, 120.0), linearity_U=0.02)
    return Stand(Table(speed=pi / 10, start="home"), (sensor,))


def paper_shaft() -> Artefact:
    """The shaft of the paper: base of 25 mm and bearing of 13.94 mm."""
    return Artefact(
        (Cylinder("base", 25.0, -60.0, 0.0, 0.002), Cylinder("bearing", 13.94, 0.0, 35.0, 0.002, 0.002)), "shaft M"
    )


def paper_simulation() -> Simulation:
    """The scan of the paper: 11,000 profiles, 2.75 turns, 878.9 um of eccentricity, a printed shaft 85 um oval."""
    return Simulation(
        running=Running(eccentricity=0.8789, eccentricity_direction=radians(40.0)),
        workpiece=Workpiece(form=(FormWave("base", 2, 0.085, radians(25.0)),)),
        optics=Optics(noise=0.005),
    )
