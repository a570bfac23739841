"""What a calibration is: poses, what remains, how well each number is known, and what could not be known."""

from dataclasses import dataclass, field, replace
from math import atan2, cos, hypot, inf, sin
from typing import Literal

import numpy as np

from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.core.assumptions import BEARING_U, HEIGHT_HIDDEN_U, HEIGHT_SEEN_U, HEIGHT_ZERO, K
from truestand.core.errors import BadRecipe
from truestand.core.frames import (
    ECCENTRICITY,
    ECCENTRICITY_Y,
    UNKNOWNS,
    Pose,
    about_axis,
    sensor_parameters,
    shaft_parameters,
)
from truestand.core.harmonics import shared_waves
from truestand.core.message import Message
from truestand.core.scan import AngleSource, AngleZero, Scan
from truestand.core.stand import Stand
from truestand.core.units import um

Method = Literal["stand", "paper"]


@dataclass(frozen=True, slots=True)
class Contribution:
    """One line of an uncertainty budget: U (k = 2) in the unit of the quantity."""

    name: str
    U: float
    value: float | None = None
    """Standard uncertainty of the input itself (mm, rad, K or relative)."""
    distribution: str = "normal"
    sensitivity: float | None = None
    """By how much the quantity follows the input, in the quantity's unit per the input's."""
    dof: float = inf
    """Degrees of freedom."""


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Expanded uncertainty U = k u of one quantity, with what it is made of."""

    U: float
    k: float
    contributions: tuple[Contribution, ...]
    monte_carlo: float | None = None
    """Half-width that holds 95.45 % of the trials of the same inputs: what U should be."""


TABLE_BEARING = "table bearing"
"""Stands for a surface in the harmonics that are the table's."""


@dataclass(frozen=True, slots=True)
class Harmonic:
    """Form of one surface: amplitude cos(upr psi - phase), mm and rad, positive outwards; psi = polar angle in C.

    Of the table's bearing, which moves all surfaces alike, the same over the table's angle.
    """

    surface: str
    upr: int
    amplitude: float
    phase: float


@dataclass(frozen=True, slots=True)
class StaticProfile:
    """What does not turn with the table on one surface: deviation (n,) mm over height (n,) mm.

    A smooth sensor range error looks like this; so do sag, taper and a wrong step. It is shown, never used as evidence.
    """

    surface: str
    height: Array
    deviation: Array

    @property
    def peak_to_valley(self) -> float:
        """Height of the shape, mm."""
        return float(np.ptp(self.deviation))


@dataclass(frozen=True, slots=True)
class Check:
    """A test of a scan against a limit. ``value`` and ``limit`` carry the unit named in ``name``."""

    code: str
    """For programs: it stays, whatever the name says."""
    name: str
    value: float
    limit: float
    ok: bool
    advice: str

    @classmethod
    def at_most_um(cls, code: str, name: str, value: float, limit: float, advice: str) -> "Check":
        """Passed where the size of ``value`` is at most ``limit``, both mm; the check states them in um."""
        return cls(code, name, um(value), um(limit), abs(value) <= limit, advice)

    @property
    def reason(self) -> Message:
        """Why a calibration is not trusted where the check failed."""
        return Message(self.code, f"{self.name}: {self.value:.3g} (limit {self.limit:.3g}); {self.advice}")


@dataclass(frozen=True, slots=True)
class Residuals:
    """What the method leaves on the artefact: mm, over ``points`` readings of which ``rejected`` were not trusted."""

    rms: float
    p90: float
    points: int
    rejected: int


@dataclass(frozen=True, slots=True)
class ScanSummary:
    """The scan that a calibration was made from: its hash and size."""

    sha256: str
    profiles: int
    points: int
    revolutions: float
    seen: float

    @classmethod
    def of(cls, scan: Scan) -> "ScanSummary":
        """Of a scan in memory."""
        return cls(scan.sha256, scan.profiles, int(scan.x.shape[1]), scan.revolutions, scan.seen)


@dataclass(frozen=True, slots=True)
class PaperFigures:
    """The published method's own figures: mm, and phases in units of pi."""

    bin: int
    bin_amplitude: float
    fit_amplitude: float
    phase_error_pi: float
    """Nearest Fourier bin minus fit."""
    arcsine_shift_pi: float
    """The same by the mean difference of arcsines, monotone branches paired."""


@dataclass(frozen=True, slots=True)
class Ellipse:
    """Uncertainty of a position: half axes U (k = 2 along each) in mm, azimuth of the longer one in rad."""

    major: float
    minor: float
    direction: float


@dataclass(frozen=True, slots=True)
class StepAxis:
    """A further step's axis against the base's: x, y (mm) at ``height``, slopes, in C; ``U`` (k = 2) of x and y."""

    surface: str
    x: float
    y: float
    slope_x: float
    slope_y: float
    height: float
    U: float

    def at(self, height: float) -> tuple[float, float, float, float]:
        """x and y (mm) at a height (mm) in C, and the slopes."""
        lever = height - self.height
        return self.x + self.slope_x * lever, self.y + self.slope_y * lever, self.slope_x, self.slope_y


@dataclass(frozen=True, slots=True)
class Separated:
    """A harmonic that several clampings separated: amplitude cos(upr psi - phase), with U (k = 2) of the amplitude."""

    harmonic: Harmonic
    U: float


@dataclass(frozen=True, slots=True)
class Positions:
    """What several scans separate whose shaft was clamped again at known angles."""

    clamped: tuple[float, ...]
    """rad, ccw from above, one a scan."""
    scans: tuple[str, ...]
    """SHA-256 of each."""
    axes: tuple[StepAxis, ...]
    form: tuple[Separated, ...]
    """The shaft's own, in C of the last scan."""
    bearing: tuple[Separated, ...]
    """The table's, as it would look as form (at psi = -theta); once per turn can't be separated from eccentricity."""
    inseparable: tuple[int, ...]
    """Harmonics that these angles can't separate: they stand in ``form``."""


AZIMUTH, HEIGHT, VIEW_UNKNOWNS = UNKNOWNS, UNKNOWNS + 1, UNKNOWNS + 2
"""Of each view: the unknowns of its geometry, then its azimuth and its height."""


@dataclass(frozen=True, slots=True)
class JointCovariance:
    """How well the unknowns of several views are known together, what they share counted once."""

    views: tuple[str, ...]
    matrix: Array
    """(``VIEW_UNKNOWNS`` views,) squared, mm and rad; azimuth and height of the first view are known."""


@dataclass(frozen=True, slots=True)
class Wobble:
    """A radial wave of a part's scan that its calibration does not know."""

    waves: int
    """A turn."""
    amplitude: float
    """mm."""


def shared_waves_of(harmonics: tuple[Harmonic, ...]) -> tuple[Wobble, ...]:
    """Waves that all surfaces have alike, and those that only the table's bearing can have made; none with one surface.

    What can't be told from the bearing passes for form, on all surfaces the same.
    """
    of_surface: dict[str, dict[int, complex]] = {}
    for h in harmonics:
        of_surface.setdefault(h.surface, {})[h.upr] = h.amplitude * complex(cos(h.phase), sin(h.phase))
    bearing = of_surface.pop(TABLE_BEARING, {})
    if len(of_surface) < 2:
        return ()
    orders = sorted(set.intersection(*(set(waves) for waves in of_surface.values())))
    of_table = np.array([bearing.get(n, 0.0) for n in orders])
    # At table angle theta the sensor sees the surface at psi = -theta: the phases of form change sign.
    together = of_table + np.array([[waves[n].conjugate() for n in orders] for waves in of_surface.values()])
    sizes = np.maximum(shared_waves(together), np.abs(of_table))
    return tuple(Wobble(n, float(size)) for n, size in zip(orders, sizes, strict=True) if size > 0)


@dataclass(frozen=True, slots=True)
class Calibration:
    """What the stand is like today."""

    method: Method
    table_from_sensor: Pose
    shaft_from_rotor: Pose
    stand: Stand
    angle_source: AngleSource
    angle_zero: AngleZero
    angle_U: float | None = None
    """rad, k = 2: how well the zero of the angle is known where a witness band gave it (``transfer``)."""
    speed_factor: float = 1.0
    """Estimated over stated table speed; 1 with an angle of the scan's own."""
    rad_per_profile: float | None = None
    artefact: Artefact | None = None
    residuals: Residuals | None = None
    harmonics: tuple[Harmonic, ...] = ()
    static_profiles: tuple[StaticProfile, ...] = ()
    uncertainty: dict[str, Uncertainty] = field(default_factory=dict)
    """By key of the record, in the record's unit."""
    covariance_names: tuple[str, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """mm and rad, of the unknowns named."""
    repeatability: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """The part of ``covariance`` that a second scan of the same artefact does not share: noise only."""
    height_repeats: float | None = None
    """mm, standard: how well a second scan gives the same height 0; None where neither face nor edge tells it."""
    azimuth_repeats: float | None = None
    """rad, standard: how well second scans by all views give the same ``azimuth``; None for the first or one alone."""
    not_identifiable: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()
    reasons: tuple[Message, ...] = ()
    """Why the calibration is untrusted; empty where it is valid."""
    scan: ScanSummary | None = None
    paper: PaperFigures | None = None
    positions: Positions | None = None
    views: tuple["Calibration", ...] = ()
    """Of several sensors, one each, the first the same as this one's: each in frames T, R and C of its own."""
    azimuth: float = 0.0
    """rad: where this view's T stands about the axis in the T of the first view,"""
    height: float = 0.0
    """and how high, mm."""
    joint: JointCovariance | None = None
    """Of all views' unknowns together."""
    software: str = ""
    created: str | None = None
    """ISO time, put on when the record is written."""
    valid_until: str | None = None
    moved_out: float = 0.0
    """mm by which the sensor stands farther out than when it was calibrated, taken into account by ``transfer``."""
    speed_change: float = 0.0
    """Relative: by how much faster the table turned than when it was calibrated, taken into account by ``transfer``."""
    wobble: Wobble | None = None
    """What the shaft in view of a part's scan tells ``transfer`` of how sensor or table wobble."""
    followed: bool = False
    """Whether shaft in view of a part's scan told ``moved_out``; else the sensor may have moved unseen."""
    part_growth: float = 0.0
    """Relative: by how much the part was larger than at 20 degrees; what is rolled up is as at 20 degrees."""
    applied_to: Scan | None = field(default=None, repr=False, compare=False)
    """The scan that ``transfer`` tied to it: what speaks against applying it there stands in ``reasons`` already."""

    @property
    def status(self) -> Literal["valid", "untrusted"]:
        """Whether a verdict may rest on the calibration."""
        return "untrusted" if self.reasons else "valid"

    @property
    def name(self) -> str:
        """Of its view."""
        return self.stand.sensor.name

    @property
    def sense(self) -> float:
        """-1 where it brings a part into C that was turned over, which the table then turns the other way; else +1."""
        return 1.0 if self.shaft_from_rotor.rotation[2, 2] > 0 else -1.0

    @property
    def reader(self) -> str:
        """Who reads a part by it: a view, or a view after the part was turned over, which shows it from below."""
        return self.name if self.sense > 0 else f"{self.name}, part turned over"

    @property
    def first_from_table(self) -> Pose:
        """From its own T into the T of the first view."""
        return about_axis(self.azimuth, self.height)

    @property
    def height_known(self) -> float:
        """U (mm, k = 2) of the height 0 of its own C, which is the shoulder: its edge stands in where it is hidden."""
        lines = (line for u in self.uncertainty.values() for line in u.contributions if line.name == HEIGHT_ZERO)
        stated = max((line.value or 0.0 for line in lines), default=0.0)
        if stated:
            return K * stated
        return HEIGHT_HIDDEN_U if "height" in self.not_identifiable else HEIGHT_SEEN_U

    @property
    def shoulder_radius(self) -> float:
        """mm, where height 0 was told: amid the shoulder's face, or at the edge of it where that is hidden."""
        assert self.artefact is not None
        inner, outer = sorted(c.radius for c in self.artefact.cylinders[:2])
        return outer if "height" in self.not_identifiable else (inner + outer) / 2

    @property
    def whole_stand(self) -> Stand:
        """The stand with the sensors of all views."""
        sensors = tuple(c.stand.sensor for c in self.views)
        return replace(self.stand, sensors=sensors) if sensors else self.stand

    def for_scan(self, scan: Scan) -> "Calibration":
        """The calibration of the view that took a scan, in its own frames; of one sensor, the same.

        Raises:
            BadRecipe: a view of which the calibration is not.
        """
        return self.of_view(scan.view) if self.views else self

    def of_view(self, name: str) -> "Calibration":
        """The calibration of one view, in its own frames.

        Raises:
            BadRecipe: no such view.
        """
        every = {c.name: c for c in self.views or (self,)}
        if name not in every:
            names = ", ".join(map(repr, every))
            raise BadRecipe(f"found a scan of view {name!r}, the calibration has {names}; give the scan of one of them")
        return every[name]

    @property
    def phi(self) -> float:
        """Angle between the rotation axis and the sensor's z, rad."""
        return sensor_parameters(self.table_from_sensor)[0]

    @property
    def plane_tilt(self) -> float | None:
        """Laser plane's tilt against the rotation axis, rad; None where it is not identifiable."""
        return self._known("laser_plane_tilt_deg", sensor_parameters(self.table_from_sensor)[3])

    @property
    def plane_offset(self) -> float | None:
        """Laser plane's offset from the rotation axis at C's origin, mm; None where it is not identifiable."""
        return self._known("laser_plane_offset_mm", sensor_parameters(self.table_from_sensor)[4])

    @property
    def eccentricity(self) -> float:
        """Offset of the shaft axis from the rotation axis at C's origin, mm."""
        ex, ey, _, _ = shaft_parameters(self.shaft_from_rotor)
        return hypot(ex, ey)

    @property
    def eccentricity_direction(self) -> float | None:
        """Its azimuth in R, rad; None where the shaft is so well centred that it has none."""
        ex, ey, _, _ = shaft_parameters(self.shaft_from_rotor)
        return None if "eccentricity_direction_deg" in self.not_identifiable else atan2(ey, ex)

    @property
    def eccentricity_ellipse(self) -> Ellipse | None:
        """U of the eccentricity as a vector, which holds near zero too; None where the record has no covariance.

        The fit's covariance, with what else is in the budget added along the eccentricity and across it.
        """
        if self.covariance.shape[0] <= ECCENTRICITY_Y or "eccentricity_um" not in self.uncertainty:
            return None
        ex, ey, _, _ = shaft_parameters(self.shaft_from_rotor)
        size = hypot(ex, ey)
        along = np.array([ex, ey]) / size if size > 0 else np.array([1.0, 0.0])
        across = np.array([-along[1], along[0]])
        covariance = self.covariance[ECCENTRICITY, ECCENTRICITY].copy()
        # What the budget has beyond the fit (bearing, scale, linearity) is known along the vector; across it, the
        # bearing's part is in the direction's U, which is capped where there is no direction.
        beyond = (self.uncertainty["eccentricity_um"].U / 2000.0) ** 2 - float(along @ covariance @ along)
        across_u2 = float(np.sum([(c.U / 2 * size * np.pi / 180) ** 2 for c in self._across_lines()]))
        covariance += max(beyond, 0.0) * np.outer(along, along) + across_u2 * np.outer(across, across)
        values, vectors = np.linalg.eigh(covariance)
        major = vectors[:, 1]
        return Ellipse(
            2 * float(np.sqrt(values[1])), 2 * float(np.sqrt(max(values[0], 0.0))), atan2(major[1], major[0])
        )

    def _across_lines(self) -> list[Contribution]:
        """Lines of the direction's budget that the fit's covariance doesn't hold."""
        lines = self.uncertainty.get("eccentricity_direction_deg")
        return (
            [] if lines is None else [c for c in lines.contributions if c.name.startswith(("table bearing", "zero of"))]
        )

    @property
    def tilt(self) -> float | None:
        """Angle between shaft axis and rotation axis, rad."""
        _, _, tx, ty = shaft_parameters(self.shaft_from_rotor)
        return self._known("tilt_mrad", float(np.arctan(hypot(tx, ty))))

    @property
    def tilt_direction(self) -> float | None:
        """Azimuth in R towards which the shaft leans going up, rad; None where it stands too straight to have one."""
        _, _, tx, ty = shaft_parameters(self.shaft_from_rotor)
        return self._known("tilt_direction_deg", atan2(ty, tx))

    def form_of(self, surface: str, angle: Array) -> Array:
        """Form (any shape) mm of a surface at polar angles (rad) in C, by its harmonics."""
        form = np.zeros_like(angle)
        for h in self.harmonics:
            if h.surface == surface:
                form += h.amplitude * np.cos(h.upr * angle - h.phase)
        return form

    def bearing_at(self, angle: Array) -> Array:
        """By how much (any shape) mm the bearing brings all surfaces nearer to the sensor at table angles (rad)."""
        return self.form_of(TABLE_BEARING, angle)

    @property
    def shared_waves(self) -> tuple[Wobble, ...]:
        """Waves that all surfaces of the shaft have alike, beyond a good bearing's: its form, or the table's bearing,
        which a part's scan has as well.
        """
        return tuple(wave for wave in shared_waves_of(self.harmonics) if wave.amplitude > BEARING_U)

    def _known(self, key: str, value: float) -> float | None:
        return None if key in self.not_identifiable or self.method == "paper" else value
