"""What the virtual stand simulates: mm, rad, s. The defaults are the paper's stand without its troubles."""

from dataclasses import dataclass, field, replace
from math import cos, radians, sin


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
    """Where the sensor stands around the table; turns what is fixed in the lab against what the sensor sees."""


@dataclass(frozen=True, slots=True)
class Running:
    """How the shaft runs: offset and tilt of its axis against the rotation axis, azimuths in the lab at angle 0."""

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
    """A slot: material missing to ``depth`` over ``width`` about ``azimuth``, between two heights."""

    surface: str
    azimuth: float
    width: float
    depth: float
    bottom: float = -1e9
    top: float = 1e9


@dataclass(frozen=True, slots=True)
class Patch:
    """A stretch of one surface's circumference, over its whole length: ``share`` 0..1 of a turn about ``azimuth``."""

    surface: str
    azimuth: float
    share: float
    height: float | None = None
    """mm of dirt on it; None: it is milled flat."""


@dataclass(frozen=True, slots=True)
class Misalignment:
    """A step whose axis is not the base's: sideways offset at its middle, and slopes."""

    surface: str
    offset_x: float = 0.0
    offset_y: float = 0.0
    slope_x: float = 0.0
    slope_y: float = 0.0


@dataclass(frozen=True, slots=True)
class Workpiece:
    """What the real shaft has beyond its drawing."""

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
    """Height of the table's face, where it comes into view."""
    clamped: float = 0.0
    """rad by which the shaft sits turned in its clamping, ccw from above: form, slots, dirt, steps' axes go along."""

    def turned(self) -> "Workpiece":
        """The same as it stands in C, which has no twist against the table."""
        if not self.clamped:
            return self
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
    """What the sensor adds."""

    fan: float = 0.28
    """Full opening of the laser fan."""
    noise: float = 0.004
    """White, along the range."""
    correlated_noise: float = 0.0
    correlation: int = 8
    """Points over which the correlated noise is the same."""
    speckle: float = 0.0
    """Repeats every turn: fixed to the surface."""
    speckle_cell: float = 0.1
    nonlinearity: float = 0.0
    """Amplitude of a smooth range error: one sine over the range."""
    nonlinearity_phase: float = 1.0
    scale_error: float = 0.0
    """Relative, of the range about its middle."""
    step_z: float = 0.004
    step_x: float = 0.001
    """Resolution; 0 = none."""
    triangulation: float = 0.0
    """Angle between laser and camera, sideways; 0 = the camera sees all that the laser meets."""
    incidence_noise: bool = False
    """White noise grows with 1 / cos of the incidence (between ray and surface normal), up to twentyfold."""
    incidence_bias: float = 0.0
    """mm: the range reads this times (1 / cos(incidence) - 1) more, up to nineteen times."""
    most_incidence: float = radians(88.0)
    """Beyond it nothing comes back; looked at where a part is on the shaft."""
    mixed_pixels: float = 0.0
    """Share of readings next to an edge that come back from between both surfaces."""
    outliers: float = 0.0
    """Share of readings that are anywhere in the range."""
    ghosts: float = 0.0
    """Share of readings near the shoulder that come back from the other step."""
    reflection: float = 0.0
    """Share of readings, at random, that come back from one place that stands still."""
    dropouts: float = 0.0
    """Share of readings lost at random."""
    patches: int = 0
    """Whole patches lost (40 profiles by 30 points)."""


@dataclass(frozen=True, slots=True)
class Acquisition:
    """How the scan is taken."""

    profiles: int = 11000
    start_angle: float = 0.0
    columns: tuple[str, ...] = ()
    """What the scan brings: angle, time, encoder, counter."""
    speed_factor: float = 1.0
    """True over stated table speed."""
    ripple: float = 0.0
    """Relative speed ripple."""
    ripple_per_turn: int = 1
    ramp: float = 0.0
    """s: start-up at constant acceleration."""
    dropped: int = 0
    """Profiles lost, in up to five gaps."""


@dataclass(frozen=True, slots=True)
class Simulation:
    """One virtual scan."""

    mounting: Mounting = field(default_factory=Mounting)
    running: Running = field(default_factory=Running)
    workpiece: Workpiece = field(default_factory=Workpiece)
    optics: Optics = field(default_factory=Optics)
    acquisition: Acquisition = field(default_factory=Acquisition)
