"""The exact model of the stand: what a reading (x, z) at table angle theta says about the shaft.

    p_T = (u - static(s) - bearing(theta) - stretch(v) travel(theta, v), d + v sin(alpha), v cos(alpha))
    p_R = Rz(-theta) p_T
    residual = (distance of p_R to the cylinder's axis - R - form(psi)) / cosine of the normal to T's X

u, v: radial and axial position in the laser plane. Unknowns: the sensor's phi, radial position, laser-plane offset d
and tilt alpha; the shaft's eccentricity and tilt; optionally the table speed; a linear drift; per further cylinder its
axis against the base's (with the certificate's prior); per cylinder form harmonics 2..n and a free static profile;
waves 2..n of the table's bearing, which move all cylinders alike; per further cylinder by how much more than the base's
its travel towards the sensor shows, in step with it. The static profile absorbs whatever does not turn with the table
(sag, taper, step, sensor linearity), so that only what turns is evidence for d and alpha (docs/theory.md, *What the
data can tell*). The Jacobian is analytic. What is known of the unknowns beforehand stands at the end of this file.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import cos, hypot, sin

import numpy as np
from numpy.polynomial import legendre

from truestand.calibration.segment import Segments
from truestand.calibration.start import RoughStand
from truestand.core.arrays import Array, Ints
from truestand.core.artefact import Artefact
from truestand.core.assumptions import COAXIALITY_U, SMOOTH, K
from truestand.core.frames import (
    ECCENTRICITY,
    ECCENTRICITY_X,
    ECCENTRICITY_Y,
    PHI,
    PLANE_OFFSET,
    PLANE_TILT,
    RADIAL,
    TILT,
    TILT_X,
    TILT_Y,
    UNKNOWNS,
    LaserPlane,
    facing,
)
from truestand.core.scan import Scan
from truestand.core.stand import Sensor
from truestand.uncertainty.range_errors import change_along_range

NEAR_ENOUGH_MM = 1e-6
"""The last step of a search for the surface; the next one would be a tenth of it at most."""
LEAST_COSINE = 0.1
"""Beyond 84 degrees a surface can't be seen."""
STATIC_DEGREE = 7
"""Degree of the free static profile (Legendre); the sensor's smooth range error fits in it."""
GEOMETRY = (
    "phi", "radial", "plane_offset", "plane_tilt",
    "eccentricity_x", "eccentricity_y", "tilt_x", "tilt_y", "drift", "speed",
)  # fmt: skip
"""The unknowns in the order of the parameter vector: the eight of ``core.frames`` first."""
DRIFT, SPEED = UNKNOWNS, UNKNOWNS + 1
PLANE = (PLANE_OFFSET, PLANE_TILT)
CLEAN_ORDERS = 6
"""Harmonics of form that are looked at in any case where the whole circumference is the shaft's."""
STEEP_ENOUGH = 0.3
"""cos(phi) from which range resolves the position along the shaft, so that the static profile may run over range."""

MOUNTING = "mounting of the laser plane"
COAXIALITY = "coaxiality of the steps"
WEAK = "form and static profile"
STRETCH = "linearity of the sensor over the shaft's travel"
BEARING = "waves of the table's bearing"
CLAMPING_U = 0.04
"""rad, k = 2: no shaft runs more tilted than this."""
DRIFT_U = 0.1
"""mm over the scan, k = 2."""
SPEED_U = 0.1
"""Relative, k = 2, of a table without an encoder."""
FIXED_U = 1e-10
"""For what is no unknown in this scan."""
STATIC_U = 0.1
"""mm, k = 2, of each Legendre coefficient of the static profile: no sensor is less linear. Without it, the polynomials
of a short stretch that the shaft's wobble moves over a longer range could take up its slope, and phi with it."""
LEAST_TRAVEL = 0.05
"""mm of eccentricity below which an axis aside counts no more."""
BEARING_WAVE_U = 0.01
"""mm, k = 2, of each wave of the bearing: what can't be told from form that all cylinders share passes for form."""
CONSIDERED_U = 1e-7
"""mm or rad: an unknown held this tightly stays where it is and still tells how the others would follow it."""


@dataclass(frozen=True, slots=True)
class Readings:
    """Readings or means of readings, each (n,): x, z in mm, table angle rad, time -0.5..0.5, which cylinder."""

    x: Array
    z: Array
    angle: Array
    time: Array
    cylinder: Ints

    @classmethod
    def of(cls, scan: Scan, rows: Ints, picked: tuple[Ints, Ints], cylinder: Ints) -> "Readings":
        """Of a scan's profiles ``rows``: the readings ``picked`` by their place among these and their column."""
        row, column = rows[picked[0]], picked[1]
        return cls(scan.x[row, column], scan.z[row, column], scan.angle[row], scan.time_at(row), cylinder)

    def taken(self, rows: "slice | Ints") -> "Readings":
        """These readings alone."""
        return Readings(self.x[rows], self.z[rows], self.angle[rows], self.time[rows], self.cylinder[rows])


@dataclass(frozen=True, slots=True)
class Model:
    """Which unknowns there are and where they stand in the parameter vector; the fixed numbers they go with."""

    radii: tuple[float, ...]
    """mm, of the cylinders in use, the base first."""
    middles: tuple[float, ...]
    """mm: height at which a further cylinder's axis offset is counted."""
    height: float
    """mm: position of the sensor's origin along the laser plane's upward direction (a convention, not an unknown)."""
    start_angle: float
    """rad: table angle of the first profile, from which a wrong speed counts."""
    orders: int
    """Form harmonics 2..orders per cylinder, and waves of the bearing."""
    static_axis: tuple[float, float]
    """Direction (along x, along z) of the sensor coordinate over which the static profile runs."""
    static_spans: tuple[tuple[float, float], ...]
    """mm, per cylinder: the part of that coordinate that is mapped to -1..1."""
    longest: int = 0
    """The cylinder whose static profile has no slope, so that phi rests on it: the longest in view."""
    eccentricity: float = 0.0
    """mm, roughly: of the base."""
    axes: tuple[tuple[float, float, float, float], ...] = ()
    """Offset x, y (mm) and slope x, y of the further cylinders' axes against the base's, as far as they are known; the
    unknowns count from there. Empty: coaxial."""

    @property
    def size(self) -> int:
        """Number of unknowns, p."""
        return int(self.stretches_slice.stop)

    def static_degrees(self, cylinder: int) -> list[int]:
        """Legendre degrees of the free static profile: all but the base's constant (its diameter) and one slope."""
        return [n for n in range(STATIC_DEGREE + 1) if (n or cylinder) and (n != 1 or cylinder != self.longest)]

    @property
    def axes_slice(self) -> slice:
        """Axes of all further cylinders, one behind the other."""
        return slice(len(GEOMETRY), len(GEOMETRY) + 4 * (len(self.radii) - 1))

    def axis_slice(self, cylinder: int) -> slice:
        """Offset x, y (mm) and angle x, y (rad) of a further cylinder's axis against the base's."""
        start = len(GEOMETRY) + 4 * (cylinder - 1)
        return slice(start, start + 4)

    def static_slice(self, cylinder: int) -> slice:
        """Legendre coefficients (mm) of the static profile, in the order of ``static_degrees``."""
        start = self.axes_slice.stop + sum(len(self.static_degrees(k)) for k in range(cylinder))
        return slice(start, start + len(self.static_degrees(cylinder)))

    def form_slice(self, cylinder: int) -> slice:
        """Form: cos 2..orders, then sin 2..orders (mm)."""
        terms = 2 * max(self.orders - 1, 0)
        start = self.static_slice(len(self.radii)).start + terms * cylinder
        return slice(start, start + terms)

    @property
    def forms_slice(self) -> slice:
        """Form of all cylinders, one behind the other."""
        return slice(self.form_slice(0).start, self.form_slice(len(self.radii)).start)

    @property
    def bearing_slice(self) -> slice:
        """Radial waves of the table's bearing: cos 2..orders, then sin 2..orders (mm) of the table's angle."""
        return self.form_slice(len(self.radii))

    @property
    def stretches_slice(self) -> slice:
        """Stretch of all further cylinders, one behind the other."""
        start = self.bearing_slice.stop
        return slice(start, start + 2 * (len(self.radii) - 1))

    def stretch_slice(self, cylinder: int) -> slice:
        """By how much, relative, and (1/mm) how that changes along it, a further cylinder's travel shows larger."""
        start = self.stretches_slice.start + 2 * (cylinder - 1)
        return slice(start, start + 2)

    def angle(self, parameters: Array, nominal: Array) -> Array:
        """Table angle with the estimated speed, rad."""
        return np.asarray(nominal + parameters[SPEED] * (nominal - self.start_angle))

    def static_basis(self, x: Array, z: Array, cylinder: int) -> Array:
        """(n, terms): the static profile's Legendre polynomials at these readings."""
        low, high = self.static_spans[cylinder]
        s = (self.static_axis[0] * x + self.static_axis[1] * z - low) * (2.0 / (high - low)) - 1.0
        full = legendre.legvander(np.clip(s, -1.1, 1.1), STATIC_DEGREE)
        return np.asarray(full[:, self.static_degrees(cylinder)], dtype=np.float64)

    def residuals(self, parameters: Array, readings: Readings, turned: Array | None = None) -> Array:
        """Distance (n,) mm of each reading from the modelled surface along T's X, positive outwards.

        Not the shortest distance: the sensor errs along its line of sight, and under a plane far off the axis the
        shortest distances shrink with the noise in them, which would draw the plane there. ``turned``: as ``turns`` of
        other parameters has it (n,) rad; None: of these.
        """
        out = np.empty(readings.x.size)
        for k in range(len(self.radii)):
            rows = _rows(readings, k)
            own = None if turned is None else turned[rows]
            out[rows] = self._one_cylinder(parameters, readings.taken(rows), k, None, own)
        return out

    def turns(self, parameters: Array, readings: Readings) -> Array:
        """By how much (n,) rad each reading meets its cylinder farther round than the cylinder's middle is met."""
        out = np.empty(readings.x.size)
        for k in range(len(self.radii)):
            rows = _rows(readings, k)
            at = self._geometry(parameters, readings.taken(rows), k)
            x, y, _ = at.seen.normal
            across, beside = at.c * x - at.s * y, at.s * x + at.c * y
            out[rows] = np.arctan2(beside, across) - self._azimuth_of_middle(parameters, k, at)
        return out

    def linearised(self, parameters: Array, readings: Readings) -> tuple[Array, Array]:
        """Residuals (n,) and their Jacobian (n, size), the ``turns`` as they are.

        How form is turned along the shaft is no evidence of a tilted plane or axis: a wave of the bearing, taken for
        form, is not turned, and lobes that are twisted along a printed or clamped shaft are.
        """
        out = np.empty(readings.x.size)
        jacobian = np.zeros((self.size, readings.x.size)).T  # it is filled column by column
        for k in range(len(self.radii)):
            rows = _rows(readings, k)
            block = jacobian[rows]
            out[rows] = self._one_cylinder(parameters, readings.taken(rows), k, block, None)
            jacobian[rows] = block  # a copy where the cylinder's readings are scattered
        return out, jacobian

    def _one_cylinder(self, p: Array, r: Readings, k: int, jacobian: Array | None, turned: Array | None) -> Array:
        """Residuals on cylinder ``k``; fills ``jacobian`` where one is given."""
        at = self._geometry(p, r, k)
        a, b = np.split(p[self.form_slice(k)], 2)
        towards = at.seen.normal[:2] if turned is None else at.on_shaft(self._azimuth_of_middle(p, k, at) + turned)
        cosines, sines = _waves(towards[0], towards[1], self.orders)
        residual, at = at.on_surface(self.radii[k] + a @ cosines + b @ sines)
        if jacobian is None:
            return np.asarray(residual)
        slope = _slope(a, b, cosines, sines)
        self._fill_geometry(jacobian, p, r, at, at.seen.normal)
        if k:
            self._fill_stretch(jacobian, p, r, at, k)
        over_geometry, over_angle = self._slopes_of_middle(p, k, at)
        jacobian[:, :UNKNOWNS] -= slope[:, None] * over_geometry
        # A table that turns on shows the next form, and the bearing's next move.
        a, b = np.split(p[self.bearing_slice], 2)
        of_bearing = _slope(a, b, at.bearing[0], at.bearing[1])
        turned_on = slope * (1.0 - over_angle) - of_bearing * jacobian[:, RADIAL]
        jacobian[:, SPEED] += turned_on * (r.angle - self.start_angle)
        if k:
            axis = self.axis_slice(k).start
            jacobian[:, axis : axis + 2] = jacobian[:, ECCENTRICITY]
            jacobian[:, axis + 2 : axis + 4] = jacobian[:, TILT] - self.middles[k] * jacobian[:, ECCENTRICITY]
        jacobian[:, self.static_slice(k)] = -at.static * jacobian[:, RADIAL, None]
        jacobian[:, self.bearing_slice] = -np.vstack(at.bearing).T * jacobian[:, RADIAL, None]
        jacobian[:, self.form_slice(k)] = -np.vstack([cosines, sines]).T
        jacobian /= at.seen.facing[:, None]
        return np.asarray(residual)

    def _geometry(self, p: Array, r: Readings, k: int) -> "_ReadingGeometry":
        """The readings on their way into R and to the axis of cylinder ``k``."""
        offset, tilt = p[PLANE_OFFSET], p[PLANE_TILT]
        across, along = LaserPlane(p[PHI]).to_uv(r.x, r.z)
        static = self.static_basis(r.x, r.z, k)
        v = along + self.height
        y, z = offset + sin(tilt) * v, cos(tilt) * v
        angle = self.angle(p, r.angle)
        c, s = np.cos(angle), np.sin(angle)
        bearing = _waves(c, s, self.orders)
        waves = p[self.bearing_slice] @ np.vstack(bearing)
        ex, ey, tx, ty = _axis(self, p, k)
        at_x, at_y = ex + tx * z, ey + ty * z
        sideways = y / np.sqrt(np.maximum(self.radii[k] ** 2 - y * y, (LEAST_COSINE * self.radii[k]) ** 2))
        travel = c * at_x - s * at_y + sideways * (s * at_x + c * at_y)
        u = across + p[RADIAL] + p[DRIFT] * r.time - static @ p[self.static_slice(k)] - waves
        if k:
            more, along_it = p[self.stretch_slice(k)]
            u = u - (more + along_it * (v - self.middles[k])) * travel
        point, axis = np.stack([c * u + s * y, c * y - s * u, z]), (ex, ey, tx, ty)
        seen = _FromAxis.of(point, axis, c, s)
        return _ReadingGeometry(across, along, static, bearing, travel, sideways, v, c, s, point, axis, seen)

    def _fill_geometry(self, jacobian: Array, p: Array, r: Readings, at: "_ReadingGeometry", gradient: Array) -> None:
        """Columns of the geometry's unknowns, in the order of ``GEOMETRY``, from the residual's gradient in R."""
        tilt = p[PLANE_TILT]
        across = at.c * gradient[0] - at.s * gradient[1]
        beside = at.s * gradient[0] + at.c * gradient[1]
        upward = sin(tilt) * beside + cos(tilt) * gradient[2]
        jacobian[:, PHI] = facing(p[PHI]) * (at.across * upward - at.along * across)
        jacobian[:, RADIAL] = across
        jacobian[:, PLANE_OFFSET] = beside
        jacobian[:, PLANE_TILT] = at.v * (cos(tilt) * beside - sin(tilt) * gradient[2])
        jacobian[:, ECCENTRICITY_X], jacobian[:, ECCENTRICITY_Y] = -gradient[0], -gradient[1]
        jacobian[:, TILT_X], jacobian[:, TILT_Y] = -at.seen.lever * gradient[0], -at.seen.lever * gradient[1]
        jacobian[:, DRIFT] = across * r.time
        turning = gradient[0] * at.point[1] - gradient[1] * at.point[0]
        jacobian[:, SPEED] = turning * (r.angle - self.start_angle)

    def _fill_stretch(self, jacobian: Array, p: Array, r: Readings, at: "_ReadingGeometry", k: int) -> None:
        """Columns of a further cylinder's stretch, and what it adds to those that its travel follows."""
        ex, ey, tx, ty = _axis(self, p, k)
        more, along_it = p[self.stretch_slice(k)]
        up, z = at.v - self.middles[k], cos(p[PLANE_TILT]) * at.v
        stretched = -at.travel * jacobian[:, RADIAL]
        jacobian[:, self.stretch_slice(k)] = np.stack([stretched, stretched * up], axis=1)
        share = -(more + along_it * up) * jacobian[:, RADIAL]
        x, y = ex + tx * z, ey + ty * z
        slopes = at.c + at.sideways * at.s, at.sideways * at.c - at.s
        for i, slope in enumerate(slopes):
            jacobian[:, ECCENTRICITY_X + i] += share * slope
            jacobian[:, TILT_X + i] += share * slope * z
        steeper = share * (at.s * x + at.c * y) * (1.0 + at.sideways**2) ** 1.5 / self.radii[k]
        jacobian[:, PLANE_OFFSET] += steeper
        jacobian[:, PLANE_TILT] += steeper * z
        jacobian[:, SPEED] += share * (slopes[1] * x - slopes[0] * y) * (r.angle - self.start_angle)

    def _azimuth_of_middle(self, p: Array, k: int, at: "_ReadingGeometry") -> Array:
        """Azimuth in T (n,) rad at which the middle of cylinder ``k`` is met: it runs ahead of what turns by."""
        v, tilt = self.middles[k], p[PLANE_TILT]
        ex, ey, tx, ty = _axis(self, p, k)
        z = cos(tilt) * v
        beside = p[PLANE_OFFSET] + sin(tilt) * v - at.s * (ex + tx * z) - at.c * (ey + ty * z)
        return np.asarray(np.arcsin(np.clip(beside / self.radii[k], -1.0, 1.0)))

    def _slopes_of_middle(self, p: Array, k: int, at: "_ReadingGeometry") -> tuple[Array, Array]:
        """Slopes (n, UNKNOWNS) of ``_azimuth_of_middle`` over the geometry, and (n,) over the table's angle."""
        z, slopes = cos(p[PLANE_TILT]) * self.middles[k], np.zeros((at.c.size, UNKNOWNS))
        ex, ey, tx, ty = _axis(self, p, k)
        slopes[:, PLANE_OFFSET], slopes[:, PLANE_TILT] = 1.0, z
        slopes[:, ECCENTRICITY_X], slopes[:, ECCENTRICITY_Y] = -at.s, -at.c
        slopes[:, TILT_X], slopes[:, TILT_Y] = -z * at.s, -z * at.c
        lever = self.radii[k] * np.maximum(np.cos(self._azimuth_of_middle(p, k, at)), LEAST_COSINE)
        return slopes / lever[:, None], (at.s * (ey + ty * z) - at.c * (ex + tx * z)) / lever

    def radial_position(self, parameters: Array, v: Array, nominal_angle: Array, time: Array, which: Ints) -> Array:
        """Where the sensor sees the modelled surface: u (n,) mm, drift included, for axial positions v (n,) mm on the
        cylinders ``which`` (n,)."""
        plane = LaserPlane(parameters[PHI], parameters[RADIAL], self.height)
        drift = parameters[DRIFT] * time
        u = np.array(self.radii)[which]
        for _ in range(6):  # the residual changes by 0.97..1 per unit of u: each pass gains over one digit
            x, z = plane.from_uv(u - drift, v)
            step = self.residuals(parameters, Readings(x, z, nominal_angle, time, which))
            u = u - step
            if np.abs(step).max(initial=0.0) < NEAR_ENOUGH_MM:
                break
        return np.asarray(u - drift)


@dataclass(frozen=True, slots=True)
class _ReadingGeometry:
    """Readings (n,) seen from one cylinder's axis."""

    across: Array
    along: Array
    static: Array
    bearing: tuple[Array, Array]
    """cos and sin (orders - 1, n) of 2..orders times the table's angle."""
    travel: Array
    """mm by which the surface stands towards the sensor where it is met: as its axis does, and the slope ``sideways``
    times as far as the axis stands to the side.
    """
    sideways: Array
    """Slope of the surface where a laser plane beside the axis meets it."""
    v: Array
    c: Array
    s: Array
    point: Array
    """(3, n) mm in R."""
    axis: tuple[float, float, float, float]
    """In R: offset at height 0 and slope."""
    seen: "_FromAxis"

    def on_surface(self, radius: Array) -> tuple[Array, "_ReadingGeometry"]:
        """How far (n,) mm outwards of a surface of some ``radius`` (n,) mm readings lie along T's X, and the geometry
        of where the sensor would meet it: slopes at a reading itself go along with its noise, and what hardly turns the
        surface would be drawn by the noise's square.
        """
        away = (self.seen.distance - radius) / self.seen.facing
        point = self.point - away * np.stack([self.c, -self.s, np.zeros_like(self.c)])
        met = _FromAxis.of(point, self.axis, self.c, self.s)
        return away + (met.distance - radius) / met.facing, replace(self, point=point, seen=met)

    def on_shaft(self, azimuths: Array) -> tuple[Array, Array]:
        """Direction (cosine and sine, (n,) each) in R of azimuths (n,) rad in T."""
        across, beside = np.cos(azimuths), np.sin(azimuths)
        return across * self.c + beside * self.s, beside * self.c - across * self.s


@dataclass(frozen=True, slots=True)
class _FromAxis:
    """Points (n,) seen from an axis."""

    distance: Array
    """mm."""
    lever: Array
    """mm along the axis from height 0, by which a slope of the axis moves it sideways."""
    normal: Array
    """(3, n) unit vectors across the axis, in R."""
    facing: Array
    """Cosine between the normal and T's X, along which the sensor errs."""

    @classmethod
    def of(cls, point: Array, axis: tuple[float, float, float, float], c: Array, s: Array) -> "_FromAxis":
        """``point`` (3, n) mm in R, with the table at angles of which ``c`` and ``s`` (n,) are cosine and sine."""
        ex, ey, tx, ty = axis
        length = np.sqrt(tx * tx + ty * ty + 1.0)
        away = point - np.array([[ex], [ey], [0.0]])
        lengthwise = (tx * away[0] + ty * away[1] + away[2]) / length
        normal = away - lengthwise * np.array([[tx], [ty], [1.0]]) / length
        distance = np.sqrt(np.einsum("ij,ij->j", normal, normal))
        normal /= distance
        return cls(distance, lengthwise / length, normal, np.maximum(c * normal[0] - s * normal[1], LEAST_COSINE))


def _rows(r: Readings, cylinder: int) -> slice | Ints:
    """Where the cylinder's readings stand: a slice where they stand together, as cells do."""
    rows = np.flatnonzero(r.cylinder == cylinder)
    if rows.size and rows[-1] - rows[0] == rows.size - 1:
        return slice(int(rows[0]), int(rows[-1]) + 1)
    return rows


def _axis(model: Model, p: Array, k: int) -> tuple[float, float, float, float]:
    """The axis of cylinder ``k`` in R: offset at height 0 and slope."""
    ex, ey, tx, ty = p[ECCENTRICITY_X:UNKNOWNS]
    if k:
        cx, cy, gx, gy = p[model.axis_slice(k)] + (model.axes[k - 1] if model.axes else np.zeros(4))
        # The offset counts at the cylinder's middle, as a certificate states it.
        ex, ey = ex + cx - gx * model.middles[k], ey + cy - gy * model.middles[k]
        tx, ty = tx + gx, ty + gy
    return float(ex), float(ey), float(tx), float(ty)


def _waves(c: Array, s: Array, orders: int) -> tuple[Array, Array]:
    """cos and sin (orders - 1, n) of harmonics 2..orders at the polar angle of directions (c, s), each (n,)."""
    size = np.hypot(c, s)
    c, s = c / size, s / size
    cosines, sines = np.empty((2, max(orders, 1), c.size))
    cosines[0], sines[0] = c, s
    for n in range(1, orders):
        cosines[n], sines[n] = cosines[n - 1] * c - sines[n - 1] * s, sines[n - 1] * c + cosines[n - 1] * s
    return cosines[1:], sines[1:]


def _slope(a: Array, b: Array, cosines: Array, sines: Array) -> Array:
    """Slope (n,) over the angle of waves 2..orders, a of their cosines and b of their sines, (orders - 1,) mm each."""
    n = np.arange(2, a.size + 2)
    return np.asarray((n * b) @ cosines - (n * a) @ sines)


def model_for(scan: Scan, segments: Segments, artefact: Artefact, start: RoughStand) -> Model:
    """The unknowns for what is seen of the artefact."""
    cylinders = [artefact.cylinders[b.cylinder] for b in segments.bands]
    phi = segments.phi
    axis = (0.0, 1.0) if over_range(phi) else (sin(phi), cos(phi))
    eccentricity = hypot(*start.eccentricity)
    spans = []
    for band, cylinder in zip(segments.bands, cylinders, strict=True):
        ends = np.array([band.low, band.high])
        if over_range(phi):
            ends = LaserPlane(phi, start.radial, segments.height).from_uv(np.full(2, cylinder.radius), ends)[1]
            slack = eccentricity * abs(sin(phi)) + 0.1
        else:
            ends, slack = ends - segments.height, 0.1
        spans.append((float(ends.min() - slack), float(ends.max() + slack)))
    return Model(
        radii=tuple(c.radius for c in cylinders),
        middles=tuple(b.middle for b in segments.bands),
        height=segments.height,
        start_angle=float(scan.angle[0]),
        orders=start.orders if start.outliers.any() else max(start.orders, CLEAN_ORDERS),
        static_axis=axis,
        static_spans=tuple(spans),
        longest=segments.longest,
        eccentricity=eccentricity,
    )


def over_range(phi: float) -> bool:
    """Whether the static profile runs over range, at the sensor's angle ``phi`` rad."""
    return abs(cos(phi)) > STEEP_ENOUGH


def start_values(model: Model, segments: Segments, start: RoughStand) -> Array:
    """The parameters (p,) mm and rad from which the fit starts."""
    p = np.zeros(model.size)
    p[PHI], p[RADIAL], p[SPEED] = segments.phi, start.radial, start.speed
    p[[ECCENTRICITY_X, ECCENTRICITY_Y]] = start.eccentricity
    p[[TILT_X, TILT_Y]] = start.tilt
    for k, wave in enumerate(start.waves):
        form = p[model.form_slice(k)].reshape(2, -1)  # a view of p
        # At table angle theta the sensor sees the surface at psi = -theta: sines change sign.
        form[0, : wave.cos.size - 1], form[1, : wave.sin.size - 1] = wave.cos[1:], -wave.sin[1:]
    return p


def carried(before: Model, after: Model, parameters: Array) -> Array:
    """The parameters (p,) of a model with more form harmonics, all else as it was."""
    p = np.zeros(after.size)
    common = before.form_slice(0).start
    p[:common] = parameters[:common]
    for k in range(len(before.radii)):
        old = parameters[before.form_slice(k)].reshape(2, -1)
        p[after.form_slice(k)].reshape(2, -1)[:, : old.shape[1]] = old
    old = parameters[before.bearing_slice].reshape(2, -1)
    p[after.bearing_slice].reshape(2, -1)[:, : old.shape[1]] = old
    p[after.stretches_slice] = parameters[before.stretches_slice]
    return p


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of some unknowns before the scan: index, standard uncertainty, under one name in the budget.

    Where ``considered``, the unknowns are held at zero in the fit and only their uncertainty is carried on (consider
    analysis): for what seven million readings seem to tell about them comes from effects that nobody modelled.
    """

    name: str
    index: tuple[int, ...]
    u: float
    considered: bool = False

    @property
    def precision(self) -> float:
        """With which the fit holds the unknowns, 1/unit2."""
        return 1.0 / (CONSIDERED_U if self.considered else self.u) ** 2


def priors_for(model: Model, scan: Scan, segments: Segments, artefact: Artefact) -> tuple[Prior, ...]:
    """The priors of stand, certificate and common sense, each under its name in the budget."""
    sensor = scan.stand.sensor
    priors = [
        Prior(MOUNTING, (PLANE_OFFSET,), sensor.mounting[0] / 2),
        Prior(MOUNTING, (PLANE_TILT,), sensor.mounting[1] / 2),
        Prior("clamping", (TILT_X, TILT_Y), CLAMPING_U / 2),
        Prior("drift", (DRIFT,), DRIFT_U / 2),
        Prior("table speed", (SPEED,), SPEED_U / 2 if scan.free_speed else FIXED_U),
    ]
    aside = []
    for k, band in enumerate(segments.bands):
        cylinder = artefact.cylinders[band.cylinder]
        if k:
            coaxiality = cylinder.coaxiality_U or COAXIALITY_U
            aside.append(coaxiality / K)
            start = model.axis_slice(k).start
            slope = coaxiality / 2 / cylinder.length
            priors.append(Prior(COAXIALITY, (start, start + 1), coaxiality / 2, considered=True))
            priors.append(Prior(COAXIALITY, (start + 2, start + 3), slope, considered=True))
        statics, forms = model.static_slice(k), model.form_slice(k)
        low, high = model.static_spans[k]
        for i, degree in enumerate(model.static_degrees(k), statics.start):
            # A smooth error bends with degree n only by the nth power of the share of SMOOTH that is seen. A step to
            # the base may be wrong in the drawing.
            u = STATIC_U / 2 * min(1.0, (high - low) / SMOOTH) ** degree if degree else 1.0
            priors.append(Prior(WEAK, (i,), u))
        if forms.stop > forms.start:
            priors.append(Prior(WEAK, tuple(range(forms.start, forms.stop)), 1.0))
    priors += stretches_for(model, scan, segments, aside)
    bearing = model.bearing_slice
    if bearing.stop > bearing.start:
        priors.append(Prior(BEARING, tuple(range(bearing.start, bearing.stop)), BEARING_WAVE_U / 2))
    return tuple(priors)


def stretches_for(model: Model, scan: Scan, segments: Segments, aside: Iterable[float]) -> tuple[Prior, ...]:
    """How much more the travel of further cylinders may show than the base's: a range that errs smoothly stretches what
    lies elsewhere in it otherwise; and axes may be ``aside`` (mm, standard) along the eccentricity, which tells nothing
    of the laser plane.
    """
    plane, sensor = LaserPlane(segments.phi, segments.radial, segments.height), scan.stand.sensor
    _, z = plane.from_uv(np.array(model.radii), np.array([band.middle for band in segments.bands]))
    priors = list[Prior]()
    for k, (band, off) in enumerate(zip(segments.bands[1:], aside, strict=True), 1):
        at, share = model.stretch_slice(k).start, off / max(model.eccentricity, LEAST_TRAVEL)
        of_range = [sensor.linearity / K * by for by in stretches(sensor, segments.phi, float(z[k] - z[0]))]
        for i, both in enumerate(((share, of_range[0]), (share / band.length, of_range[1]))):
            priors.append(Prior(STRETCH, (at + i,), max(hypot(*both), FIXED_U)))
    return tuple(priors)


def stretches(sensor: Sensor, phi: float, apart: float | None = None) -> tuple[float, float]:
    """How much more of a shaft's travel a sensor at the angle ``phi`` rad shows, for each mm by which its range may err
    (1/mm), and how that changes along the shaft (1/mm2); or shows than it does so many mm of range ``apart``.

    A travel of e mm changes the range at a height by e sin phi, of which the error shows sin phi across the shaft. How
    the error bends is known where the static profile runs over range.
    """
    across, aslant = sin(phi) ** 2, 0.0 if over_range(phi) else abs(cos(phi))
    return across * change_along_range(sensor, 1, apart), across * aslant * change_along_range(sensor, 2, apart)


def precision_of(priors: Iterable[Prior], size: int) -> Array:
    """Precision (size,) with which the priors hold each unknown, 1/unit2."""
    precision = np.zeros(size)
    for prior in priors:
        precision[list(prior.index)] = prior.precision
    return precision
