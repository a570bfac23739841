"""Views as they would be calibrated: the shaft is imagined in each place, and its scans are calibrated."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from truestand.apply.views import in_first_frame
from truestand.apply.witness import LEAST_HEIGHT_MM
from truestand.calibration.calibrate import calibrate
from truestand.calibration.segment import MOST_SLID_MM
from truestand.calibration.views import calibrate_views
from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.core.assumptions import K
from truestand.core.calibration import VIEW_UNKNOWNS, Calibration, JointCovariance
from truestand.core.errors import NotEnoughData
from truestand.core.frames import UNKNOWNS, Pose
from truestand.core.message import UNTIED
from truestand.core.scan import Scan
from truestand.core.stand import AxisPosition, Sensor, Stand
from truestand.planning.carried import Carrier
from truestand.planning.imagined_scan import angle_source, imagined_scan
from truestand.planning.obstacles import Body, Round
from truestand.planning.optics import Optics
from truestand.planning.place import Place
from truestand.planning.sight import centred, look
from truestand.planning.target import Mount, Target, View
from truestand.uncertainty.range_errors import waves_of_range

PROFILES, POINTS, TURNS = 150, 120, 1.1
"""Of the imagined scan of a shaft."""
ROUGH_PLACE_U = (1.5e-3, 0.1)
"""rad and mm, standard: azimuth and height between views."""
OFFSET_FACTOR = 3.0
"""Times the plane offset of a place, as U, within which the calibration looks for it."""
SPACING = 0.5
"""mm along the shaft at which it is looked for,"""
MARGIN = 0.5
"""but for so much at its ends."""
MOST_HIDDEN = MOST_SLID_MM / 2
"""mm at the shoulder of the shaft that a view need not see, ``SPACING`` included: of a place that is not hit to the
degree it may be more.
"""
LEAST_SHAFT, LEAST_SHARE = 5.0, 0.5
"""mm of each of two cylinders that must be seen to calibrate, or share of shorter ones."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What does not change from place to place."""

    stand: Stand
    """With a sensor of each view."""
    artefact: Artefact
    eccentricity: float
    """mm: by which the shaft will run out."""
    carrier: Carrier | None = None
    """The positioner."""
    profiles: int = PROFILES
    """That a scan of the shaft will have."""

    @property
    def shaft(self) -> tuple[Round, ...]:
        """Its cylinders, the base first."""
        return tuple(Round(c.radius, c.bottom, c.top) for c in self.artefact.cylinders)

    @property
    def thinnest(self) -> float:
        """mm: radius of the thinner of the two cylinders by which it is calibrated."""
        return min(c.radius for c in self.artefact.cylinders[:2])


def uncalibrated(place: Place, setting: Setting) -> Calibration:
    """A view that nobody has calibrated, its shaft running true: to look from there."""
    pose = place.pose(setting.artefact.base.radius)
    return Calibration("stand", pose, Pose(np.eye(3), np.zeros(3)), setting.stand, angle_source(setting.stand), "index")


def views_at(mounts: Sequence[Mount], setting: Setting, target: Target) -> tuple[View, ...]:
    """Sensors in their places, calibrated together.

    Raises:
        NotEnoughData: the shaft can't be calibrated from there, or not to be trusted.
    """
    scans = tuple(_scan_of_shaft(mount, setting) for mount in mounts)
    several, artefact = len(scans) > 1, setting.artefact
    found = calibrate_views(scans, artefact) if several else calibrate(scans[0], artefact)
    untrusted = [reason for reason in found.reasons if reason.code != UNTIED.code]
    if untrusted:
        raise NotEnoughData(str(untrusted[0]))
    calibrations = [in_first_frame(view, found) for view in found.views] if several else [found]
    return tuple(
        View(mount, scan, _followed(calibration, mount, target))
        for mount, scan, calibration in zip(mounts, scans, calibrations, strict=True)
    )


def loosely_joined(views: Sequence[View]) -> tuple[View, ...]:
    """Views that were calibrated each by itself, as if together: roughly, to compare places."""
    if len(views) == 1:
        return tuple(views)
    matrix = np.zeros((VIEW_UNKNOWNS * len(views),) * 2)
    for k, view in enumerate(views):
        own = slice(VIEW_UNKNOWNS * k, VIEW_UNKNOWNS * k + UNKNOWNS)
        matrix[own, own] = view.calibration.covariance
        if k:
            at = [own.stop, own.stop + 1]
            matrix[at, at] = np.square(ROUGH_PLACE_U)
    joint = JointCovariance(tuple(view.calibration.name for view in views), matrix)
    return tuple(replace(view, calibration=replace(view.calibration, joint=joint)) for view in views)


def _scan_of_shaft(mount: Mount, setting: Setting) -> Scan:
    all_of_them, stand = mount.sensor.optics, setting.stand.of_view(mount.sensor.name)
    fewer = PROFILES * POINTS / max(setting.profiles * all_of_them.points, PROFILES * POINTS)
    few = replace(all_of_them, points=POINTS, noise=all_of_them.noise * sqrt(fewer))  # as the means of all of them have
    stand = replace(stand, sensors=(_mounted(stand.sensor, mount, setting.carrier),))
    base = setting.artefact.base.radius
    scan = imagined_scan(setting.shaft, mount.place, base, few, stand, setting.eccentricity, TURNS, PROFILES)
    return _by_a_range_that_errs(scan)


def _by_a_range_that_errs(scan: Scan) -> Scan:
    """The scan by a sensor of whose range each wave errs by its standard uncertainty: where the shaft travels, that
    differs from point to point, which counts as noise.
    """
    sensor = scan.stand.sensor
    z = scan.z + sum(wave(scan.z) for _, wave in waves_of_range(sensor, sensor.linearity)) / K
    return replace(scan, x=scan.x * z / scan.z, z=z)


def _mounted(sensor: Sensor, mount: Mount, carrier: Carrier | None) -> Sensor:
    """The sensor as stand.toml must state it there: its laser plane may be farther off the axis than by accident, and a
    positioner may bring it.
    """
    stated, _ = sensor.mounting
    position = tuple(
        AxisPosition(axis.name, value, axis.linear)
        for axis, value in zip(() if carrier is None else carrier.kinematics.axes, mount.position or (), strict=False)
    )
    offset = max(stated, OFFSET_FACTOR * abs(mount.place.plane_offset))
    return replace(sensor, plane_offset_U=offset, position=position)


def shaft_in_view(
    view: Calibration, optics: Optics, shaft: Sequence[Round], bodies: Sequence[Body] = ()
) -> tuple[Array, ...]:
    """Where a view would see each of a shaft's cylinders, with other ``bodies`` about it: heights (n,) mm, every
    ``SPACING`` and not at their ends.
    """
    seen = []
    for cylinder in shaft:
        height = np.arange(cylinder.bottom + MARGIN, cylinder.top - MARGIN, SPACING)
        points = np.stack([np.full(height.size, cylinder.radius), np.zeros(height.size), height], axis=1)
        normals = np.tile([1.0, 0.0, 0.0], (height.size, 1))
        sight = look(points, normals, centred(view), optics, (*shaft, *bodies))
        seen.append(height[sight.seen])
    return tuple(seen)


def shows_shaft(seen: tuple[Array, ...], shaft: Sequence[Round]) -> bool:
    """Whether as much of a shaft is in view as a calibration needs: of two cylinders, if it has two, and so much of the
    shoulder between them that it can't be taken to stand elsewhere.
    """
    enough = [min(LEAST_SHAFT, LEAST_SHARE * (body.top - body.bottom)) for body in shaft]
    long = [SPACING * height.size >= least for height, least in zip(seen, enough, strict=True)]
    if len(seen) < 2 or not all(long[:2]):
        return sum(long) >= min(2, len(seen))
    lower, upper = sorted(seen[:2], key=lambda height: float(height[0]))
    return float(upper[0] - lower[-1]) <= 2 * MARGIN + MOST_HIDDEN


def _followed(view: Calibration, mount: Mount, target: Target) -> Calibration:
    """The calibration as it is applied to a part: shaft in view beside it shows where the sensor stands then."""
    seen = shaft_in_view(view, mount.sensor.optics, target.shaft, target.bodies)
    longest = max((height.size for height in seen), default=0) * SPACING
    return replace(view, followed=longest > LEAST_HEIGHT_MM)
