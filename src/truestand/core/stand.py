"""The stand as its builder describes it: table, sensors, and what the columns of its scans mean."""

from dataclasses import dataclass, field, replace
from typing import Literal

from truestand.core.assumptions import LEAST_LINEARITY, LINEARITY_SHARE, PLANE_OFFSET_U, PLANE_TILT_U
from truestand.core.errors import BadRecipe

Direction = Literal["ccw", "cw"]
YMeaning = Literal["index", "time_s", "angle_deg", "encoder"]


@dataclass(frozen=True, slots=True)
class Table:
    """The rotary table. ``direction`` is the sense in which the part turns, seen from +Z (above)."""

    speed: float | None = None
    """rad/s, positive; used where the scan brings no angle of its own."""
    direction: Direction = "ccw"
    start: Literal["home", "unknown"] = "unknown"
    """Whether every scan starts at the same table position: nobody knows where nobody says."""
    angle_U: float | None = None
    """rad, expanded (k = 2): error of the angle that repeats once a turn."""
    sideways_U: float | None = None
    """mm, expanded (k = 2): error motion of the axis across the laser plane, beyond once a turn."""

    @property
    def sign(self) -> float:
        """+1 for ccw, -1 for cw."""
        return 1.0 if self.direction == "ccw" else -1.0


@dataclass(frozen=True, slots=True)
class AxisPosition:
    """Where an axis of the positioner stands."""

    axis: str
    value: float
    """mm, or rad of an axis that is not ``linear``."""
    linear: bool = True


@dataclass(frozen=True, slots=True)
class Sensor:
    """A laser line-profile sensor. Expanded uncertainties are k = 2."""

    name: str = "sensor"
    """Of the view: a device in a place."""
    profile_rate: float | None = None
    """Profiles per second."""
    points: int | None = None
    range: tuple[float, float] | None = None
    """mm; readings outside are not seen."""
    mirrored: bool = False
    """The sensor reports x mirrored: it is negated before anything else."""
    serial: str | None = None
    linearity_U: float | None = None
    """mm, from the data sheet; None: ``linearity`` assumes."""
    scale_U: float | None = None
    """Relative, from the data sheet."""
    plane_offset_U: float | None = None
    """mm: how well the laser plane was mounted through the rotation axis; None: ``mounting`` assumes."""
    plane_tilt_U: float | None = None
    """rad: how well it was mounted parallel to it."""
    incidence_U: float | None = None
    """mm: by how much it reads steep surfaces differently, e.g. after a correction learnt on a master gear."""
    stability_U: float | None = None
    """mm: by how much its zero changes from the scan of the artefact to that of a part."""
    device: str | None = None
    """Which device it is; None: one of its own name. Several views may be one device in several places."""
    noise: float | None = None
    """mm, standard deviation of a reading along its range. This and what follows is for planning where to put it."""
    line: tuple[float, float] | None = None
    """mm: length of the laser line at the near and at the far end of ``range``."""
    triangulation: float | None = None
    """rad: angle between the laser plane and the camera's line of sight, + towards the sensor's y."""
    incidence_limit: float | None = None
    """rad: between ray and surface normal, beyond which nothing comes back."""
    housing: tuple[float, float, float] | None = None
    """mm along the sensor's x, y and z: a box about x = y = 0 that ends at z = 0."""
    position: tuple[AxisPosition, ...] = ()
    """Of the positioner that carries it to this place; empty: it stands there."""
    position_U: float | None = None
    """mm along any direction, k = 2: how well a positioner takes the place again,"""
    position_tilt_U: float | None = None
    """and rad about any."""

    @property
    def mounting(self) -> tuple[float, float]:
        """mm and rad, k = 2: offset and tilt of the laser plane as stated; where nobody says, as assumed."""
        offset, tilt = self.plane_offset_U, self.plane_tilt_U
        return PLANE_OFFSET_U if offset is None else offset, PLANE_TILT_U if tilt is None else tilt

    @property
    def linearity(self) -> float:
        """mm, k = 2: as stated; where nobody says, a share of the measuring range that few data sheets exceed."""
        if self.linearity_U is not None:
            return self.linearity_U
        low, high = self.range or (0.0, 0.0)
        return max(LINEARITY_SHARE * (high - low), LEAST_LINEARITY)


@dataclass(frozen=True, slots=True)
class Stand:
    """Table, sensors and the meaning of a scan's own columns."""

    table: Table = field(default_factory=Table)
    sensors: tuple[Sensor, ...] = (Sensor(),)
    y: YMeaning = "index"
    """What the Y block of an XYZ scan holds."""
    counts_per_turn: int = 0
    """Encoder counts of one turn of the table."""

    @property
    def sensor(self) -> Sensor:
        """The sensor of a stand that has just one."""
        if len(self.sensors) != 1:
            names = ", ".join(s.name for s in self.sensors)
            raise BadRecipe(
                f"found {len(self.sensors)} sensors ({names}), need one; name the scan's view, or describe "
                "one sensor in stand.toml"
            )
        return self.sensors[0]

    def of_view(self, name: str) -> "Stand":
        """The stand as one of its sensors sees it.

        Raises:
            BadRecipe: no sensor of that name.
        """
        sensors = tuple(s for s in self.sensors if s.name == name)
        if not sensors:
            names = ", ".join(repr(s.name) for s in self.sensors)
            raise BadRecipe(f"found view {name!r}, need one of the [[sensor]]s of the stand: {names}")
        return replace(self, sensors=sensors)
