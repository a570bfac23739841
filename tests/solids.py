"""Exact surfaces seen by an exact stand: an involute spur wheel and a cylinder, scanned without the virtual stand."""

from dataclasses import dataclass, replace
from functools import cache
from math import cos, pi, radians, sin, sqrt, tan, tau

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from truestand.core.artefact import Artefact, Cylinder
from truestand.core.calibration import Calibration
from truestand.core.frames import Pose, shaft_from_rotor, table_from_sensor
from truestand.core.scan import Scan
from truestand.core.stand import Sensor, Stand, Table
from truestand.parts.drawings import Mesh

DOUBT = [1e-6, 3e-4, 2e-3, 3e-5, 3e-4, 3e-4, 1e-5, 1e-5]
"""Standard uncertainties of the stand's unknowns, rad and mm."""
SHAFT = Artefact(
    (Cylinder("base", 25.0, -60.0, 0.0, 0.002), Cylinder("bearing", 13.94, 0.0, 35.0, 0.002, coaxiality_U=0.002))
)


def calibration(covariance=None, **changes):
    """A stand of known poses that looks up at a part between heights 5 and 25."""
    stand = Stand(Table(speed=pi / 10, start="home"), (Sensor("front", 200.0, 640, (60.0, 140.0), linearity_U=0.01),))
    sensor = table_from_sensor(radians(-41.802), 83.0, -50.0, radians(0.3), 0.25)
    return Calibration(
        "stand", sensor, shaft_from_rotor(0.6, -0.64, 1e-3, 5e-4), stand, "angle", "index", artefact=SHAFT,
        covariance=np.diag(np.square(DOUBT)) if covariance is None else covariance,
        **changes,
    )  # fmt: skip


@dataclass(frozen=True)
class Wheel:
    """An involute spur wheel; teeth centred at angle 0 and every pitch."""

    teeth: int = 24
    module: float = 2.0
    alpha: float = radians(20.0)
    tip: float = 26.0
    root: float = 21.5
    bottom: float = 5.0
    top: float = 25.0

    @property
    def base(self):
        return self.teeth * self.module / 2 * cos(self.alpha)

    def half(self, radius):
        """Half the tooth's angle at a radius: of an involute down to the base circle, radial below."""
        at = np.arccos(np.minimum(self.base / np.maximum(radius, self.base), 1.0))
        return pi / (2 * self.teeth) + (tan(self.alpha) - self.alpha) - (np.tan(at) - at)

    def outline(self, points=80, without=()):
        """(n, 2) mm, counter-clockwise; the teeth in ``without`` are missing."""
        flank = np.concatenate([[self.root], np.linspace(sqrt(self.base), sqrt(self.tip), points) ** 2])
        pitch, tip, foot = tau / self.teeth, float(self.half(self.tip)), float(self.half(self.root))
        one = [
            (self.root, np.linspace(-pitch / 2, -foot, 20)[:-1]), (flank, -self.half(flank)),
            (self.tip, np.linspace(-tip, tip, 20)[1:-1]), (flank[::-1], self.half(flank[::-1])),
            (self.root, np.linspace(foot, pitch / 2, 20)[1:-1]),
        ]  # fmt: skip
        radius = np.concatenate([np.broadcast_to(r, np.shape(a)) for r, a in one])
        angle = np.concatenate([a for _, a in one])
        turns = np.arange(self.teeth)[:, None] * pitch
        r, a = np.tile(radius, (self.teeth, 1)), turns + angle
        r[list(without)] = self.root
        r, a = r.ravel(), a.ravel()
        return np.column_stack([r * np.cos(a), r * np.sin(a)])

    def sharpen(self, origins, ways, s):
        """The exact involute or cylinder next to each start ``s`` along the rays, Newton's method by differences."""
        on_flank = self._off(origins + s[:, None] * ways)[1]
        for _ in range(6):
            here = self._off(origins + s[:, None] * ways, on_flank)[0]
            ahead = self._off(origins + (s + 1e-6)[:, None] * ways, on_flank)[0]
            slope = (ahead - here) / 1e-6
            s = s - here / np.where(np.abs(slope) > 1e-3, slope, np.inf)
        return s

    def _off(self, p, which=None):
        """Distance-like functions of points: which surface is the nearest, 0 tip, 1 flank, 2 root, 3 up, 4 down."""
        r, pitch = np.hypot(p[:, 0], p[:, 1]), tau / self.teeth
        a = np.abs((np.arctan2(p[:, 1], p[:, 0]) + pitch / 2) % pitch - pitch / 2)
        off = np.stack([r - self.tip, r * (a - self.half(r)), r - self.root, p[:, 2] - self.top, self.bottom - p[:, 2]])
        if which is None:
            which = np.argmin(np.abs(off), axis=0)
        return off[which, np.arange(r.size)], which


def extruded(outline, bottom, top):
    """A prism (Mesh) from a counter-clockwise outline that can be seen from the axis."""
    n = len(outline)
    low, high = (np.column_stack([outline, np.full(n, h)]) for h in (bottom, top))
    vertices = np.vstack([low, high, [[0.0, 0.0, bottom], [0.0, 0.0, top]]])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    faces = np.vstack([
        np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n]),
        np.column_stack([j, i, np.full(n, 2 * n)]), np.column_stack([i + n, j + n, np.full(n, 2 * n + 1)]),
    ])  # fmt: skip
    return Mesh(vertices, faces)


def circle(radius, sections=3000):
    a = np.arange(sections) * tau / sections
    # Half of the polygon lies outside: its mean radius is the circle's.
    radius = radius / (1.0 - (pi / sections) ** 2 / 3.0)
    return radius * np.column_stack([np.cos(a), np.sin(a)])


def scanned(mesh, known, sharpen=None, turned=0.0, shift=(0.0, 0.0, 0.0), profiles=700, points=160, fan=0.42):
    """A scan of the part (mesh, sharpened to the exact surface) that stands turned and shifted in C."""
    angle = np.arange(profiles) * tau / profiles
    slopes = np.linspace(-tan(fan / 2), tan(fan / 2), points)
    z, x = np.full((profiles, points), np.nan), np.full((profiles, points), np.nan)
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, mesh.vertices[mesh.faces].astype(np.float32))
    place = Pose(
        np.array([[cos(turned), -sin(turned), 0], [sin(turned), cos(turned), 0], [0, 0, 1.0]]), np.array(shift)
    )
    part_from_shaft = place.inverse
    for row, theta in enumerate(angle):
        turn = Pose(np.array([[cos(theta), sin(theta), 0], [-sin(theta), cos(theta), 0], [0, 0, 1.0]]), np.zeros(3))
        chain = part_from_shaft @ known.shaft_from_rotor @ turn @ known.table_from_sensor
        ways = np.column_stack([slopes, np.zeros(points), np.ones(points)]) @ chain.rotation.T
        origins = np.broadcast_to(chain.translation, ways.shape)
        hit = scene.run(origins.astype(np.float32), ways.astype(np.float32), output=1)
        s = np.where(hit["primID"] >= 0, hit["tfar"], np.nan).astype(np.float64)
        seen = np.flatnonzero(np.isfinite(s))
        if sharpen is not None and seen.size:
            s[seen] = sharpen(origins[seen], ways[seen], s[seen])
        z[row], x[row] = s, s * slopes
    return Scan(x, z, angle, known.stand, "angle")


@cache
def wheel():
    """The wheel, its mesh, and a scan of 112,000 rays of the exact wheel, turned by 0.7 degrees."""
    known, own = calibration(), Wheel()
    mesh = extruded(own.outline(), own.bottom, own.top)
    return own, mesh, scanned(mesh, known, own.sharpen, radians(0.7)), known


def noisy(scan, sd, seed=0):
    """The scan with noise along its rays."""
    rng = np.random.default_rng(seed)
    factor = 1.0 + rng.normal(0.0, sd, scan.z.shape) / np.hypot(scan.x, scan.z)
    return replace(scan, x=scan.x * factor, z=scan.z * factor)
