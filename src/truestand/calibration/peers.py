"""The same scan by sine, circle and cylinder fits of general libraries, to compare with truestand's own methods.

The peers are given what they can't do: the segmentation chooses the base surface, the published line gives its
direction and the drawing its radius. They then see the base turned up into the rotor's frame, as if the laser plane ran
through the rotation axis. Where it does and nothing is dirty they tie with the exact model; elsewhere they don't.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from math import hypot

import numpy as np

from truestand.calibration.calibrate import calibrate
from truestand.calibration.paper import calibrate_paper
from truestand.calibration.segment import segment
from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.core.calibration import Calibration
from truestand.core.errors import MissingExtra, TruestandError
from truestand.core.frames import in_table, shaft_parameters
from truestand.core.scan import Scan

MOST_PROFILES, MOST_POINTS = 2_000, 20_000
NEAR_MM = 4.0
"""From the base's radius: its readings, eccentric as it runs."""
MOST_NOISE_MM = 0.1
"""Noise and form that a consensus fit expects at most."""
SLAB_MM = 0.5
"""Half-height of the section that a circle is fitted to."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What one method finds: where the shaft's axis stands in R at a height (mm), and what else it knows."""

    axis: tuple[float, float]
    height: float
    rms: float
    """mm: of the residuals on the points that it fitted."""
    phi: float | None = None
    tilt: float | None = None


@dataclass(frozen=True, slots=True)
class Peer:
    """One method to find the eccentricity, and the library that it takes."""

    name: str
    library: str
    find: Callable[[], Finding]

    def tried(self) -> Finding | str:
        """What it finds, or why it finds nothing."""
        try:
            return self.find()
        except (TruestandError, RuntimeError, ValueError, ArithmeticError) as error:
            return str(error)


@dataclass(frozen=True, slots=True)
class Given:
    """What the peers start from: the base in R, points (n, 3) mm, and the same as radius over table angle."""

    points: Array
    angle: Array
    radius: Array
    height: Array

    @property
    def middle(self) -> float:
        """mm: height of the base's visible middle."""
        return float(np.median(self.height))


def peers(scan: Scan, artefact: Artefact) -> tuple[Peer, ...]:
    """Every method to find the shaft's eccentricity in a scan of it, truestand's own two first; none is run yet.

    Raises:
        NotEnoughData: nothing that fits the drawing, or too little of it.
    """
    given = base_in_rotor(scan, artefact)
    return (
        Peer("exact model", "truestand", lambda: _own(calibrate(scan, artefact), 0.0)),
        Peer("published method", "truestand", lambda: _own(calibrate(scan, artefact, "paper"), given.middle)),
        Peer("sine fit", "scipy", lambda: _sine(given)),
        Peer("circle fit", "circle_fit", lambda: _circle(given)),
        Peer("circle fit", "engeom", lambda: _circle_engeom(given)),
        Peer("cylinder fit", "scipy", lambda: _cylinder(given)),
        Peer("cylinder fit", "engeom", lambda: _cylinder_engeom(given)),
    )


def base_in_rotor(scan: Scan, artefact: Artefact) -> Given:
    """The base's readings turned up by the published line and the table's angle, thinned."""
    segments = segment(scan, artefact)
    pose = calibrate_paper(scan, artefact, segments).table_from_sensor
    band = next(b for b in segments.bands if b.cylinder == 0)
    rows = slice(None, None, max(1, scan.profiles // MOST_PROFILES))
    x, z, angle = scan.x[rows].ravel(), scan.z[rows].ravel(), np.repeat(scan.angle[rows], scan.x.shape[1])
    u, v = in_table(pose, x, z)[0], segments.plane.to_uv(x, z)[1]
    on = np.flatnonzero((np.abs(u - artefact.base.radius) < NEAR_MM) & (v > band.low) & (v < band.high))
    if on.size > MOST_POINTS:  # at random: every so many would pick the same columns of every profile
        on = np.sort(np.random.default_rng(1).choice(on, MOST_POINTS, replace=False))
    u, v, angle = u[on], v[on], angle[on]
    return Given(np.column_stack([u * np.cos(angle), -u * np.sin(angle), v]), angle, u, v)


def _own(calibration: Calibration, height: float) -> Finding:
    ex, ey, tx, ty = shaft_parameters(calibration.shaft_from_rotor)
    rms = calibration.residuals.rms if calibration.residuals is not None else np.nan
    tilt = None if calibration.method == "paper" else hypot(tx, ty)
    return Finding((ex, ey), height, rms, calibration.phi, tilt)


def _sine(given: Given) -> Finding:
    """Radius over table angle: mean, amplitude, phase and speed by Levenberg-Marquardt."""
    from scipy.optimize import curve_fit

    def wave(angle: Array, mean: float, a: float, b: float, speed: float) -> Array:
        return np.asarray(mean + a * np.cos(speed * angle) + b * np.sin(speed * angle))

    start = (float(given.radius.mean()), 0.1, 0.1, 1.0)
    (mean, a, b, speed), _ = curve_fit(wave, given.angle, given.radius, start, maxfev=20_000)
    residuals = given.radius - wave(given.angle, mean, a, b, speed)
    # Seen along T's X the axis stands at e cos(beta + theta): cos -> ex, sin -> -ey.
    return Finding((float(a), -float(b)), given.middle, _rms(residuals))


def _section(given: Given) -> Array:
    """Points (n, 2) mm of the base's middle section."""
    return given.points[np.abs(given.height - given.middle) < SLAB_MM, :2]


def _circle(given: Given) -> Finding:
    _demand("circle_fit", "circle-fit")
    from circle_fit import taubinSVD

    points = _section(given)
    x, y, radius, _ = taubinSVD(points)
    return _circle_finding(given, points, x, y, radius)


def _circle_engeom(given: Given) -> Finding:
    _demand("engeom", "engeom")
    from engeom.geom2 import Circle2

    points = np.ascontiguousarray(_section(given))
    circle = Circle2.from_fit(points)
    return _circle_finding(given, points, circle.center.x, circle.center.y, circle.r)


def _circle_finding(given: Given, points: Array, x: float, y: float, radius: float) -> Finding:
    residuals = np.hypot(points[:, 0] - x, points[:, 1] - y) - radius
    return Finding((float(x), float(y)), given.middle, _rms(residuals))


def _cylinder(given: Given) -> Finding:
    """Axis and radius of the base's points by robust least squares."""
    from scipy.optimize import least_squares

    x, y, z = given.points.T

    def distances(p: Array) -> Array:
        return np.asarray(np.hypot(x - p[0] - p[2] * z, y - p[1] - p[3] * z) - p[4])

    start = np.array([0.0, 0.0, 0.0, 0.0, float(given.radius.mean())])
    p = least_squares(distances, start, loss="soft_l1", f_scale=0.02, x_scale=[1.0, 1.0, 0.1, 0.1, 1.0]).x
    return Finding((float(p[0]), float(p[1])), 0.0, _rms(distances(p)), tilt=hypot(p[2], p[3]))


def _cylinder_engeom(given: Given) -> Finding:
    _demand("engeom", "engeom")
    from engeom.geom3 import Cylinder3

    normals = given.points * [1.0, 1.0, 0.0]
    found = Cylinder3.from_consensus(given.points, normals, MOST_NOISE_MM, seed=1)
    centre = np.array([found.center.x, found.center.y, found.center.z])
    direction = np.array([found.direction.x, found.direction.y, found.direction.z])
    slope = direction[:2] / direction[2]
    axis = centre[:2] - slope * centre[2]
    residuals = np.hypot(*(given.points[:, :2] - axis - given.height[:, None] * slope).T) - found.r
    return Finding((float(axis[0]), float(axis[1])), 0.0, _rms(residuals), tilt=hypot(*slope))


def _rms(residuals: Array) -> float:
    return float(np.sqrt(np.mean(np.square(residuals))))


def _demand(module: str, package: str) -> None:
    if find_spec(module) is None:
        raise MissingExtra(f"{package} is not installed; pip install truestand[peers]")
