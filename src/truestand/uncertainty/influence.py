"""How a calibration's uncertainty reaches the points of a part: its unknowns moved one by one through the rigid chain.

A reading's point in C follows the eight unknowns of the stand's geometry; their covariance, split into independent
parts of one standard deviation each, moves all points of a part at once. What an inspection then reads off the moved
points, part by part, is the calibration's line in its budget, correlations included.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import sqrt

import numpy as np

from truestand.core.arrays import Array
from truestand.core.assumptions import K
from truestand.core.calibration import AZIMUTH, HEIGHT, VIEW_UNKNOWNS, Calibration
from truestand.core.frames import (
    ECCENTRICITY_X,
    PHI,
    PLANE_OFFSET,
    PLANE_TILT,
    RADIAL,
    UNKNOWNS,
    LaserPlane,
    Pose,
    in_rotor,
    sensor_parameters,
    shaft_from_rotor,
    shaft_parameters,
    table_from_sensor,
)
from truestand.uncertainty.budget import square_root

SAME_FRAME = 1e-13
"""Of the entries of a pose that moves nothing."""
STEPS = np.array([1e-6, 1e-4, 1e-4, 1e-6, 1e-4, 1e-4, 1e-6, 1e-6])
"""rad and mm: small against any curvature, large against rounding."""


def points_of(p: Array, height: float, x: Array, z: Array, angle: Array) -> Array:
    """Points (..., 3) mm in C of readings x, z (...) mm at table angles (...) rad, for unknowns (8,) mm and rad.

    ``height`` (mm) places the sensor's origin along the laser plane, which is a convention and no unknown.
    """
    pose = table_from_sensor(p[PHI], p[RADIAL], height, p[PLANE_TILT], p[PLANE_OFFSET])
    table = pose(np.stack([x, np.zeros_like(x), z], axis=-1))
    rotor = np.stack([*in_rotor(table[..., 0], table[..., 1], angle), table[..., 2]], axis=-1)
    return shaft_from_rotor(*p[ECCENTRICITY_X:UNKNOWNS])(rotor)


def moved_points(calibration: Calibration, step: Array, x: Array, z: Array, angle: Array) -> Array:
    """Points (..., 3) mm in C of readings x, z (...) mm at table angles (...) rad, the unknowns off by ``step`` (8,).

    C: that which the calibration's chain leads to, be it another view's, or that of a part before it was turned.
    """
    p, height = unknowns_of(calibration)
    own = points_of(p + step, height, x, z, angle)
    turn = _from_own_shaft(calibration)
    return own if np.allclose(turn.matrix, np.eye(4), rtol=0.0, atol=SAME_FRAME) else turn(own)


def part_from_shaft(calibration: Calibration) -> Pose:
    """How a part was turned back that was clamped again; of any other the pose that moves nothing."""
    return _from_own_shaft(calibration) @ calibration.first_from_table.inverse


def _from_own_shaft(calibration: Calibration) -> Pose:
    """From the C of the calibration's own unknowns into the one that its chain leads to."""
    p, _ = unknowns_of(calibration)
    return calibration.shaft_from_rotor @ shaft_from_rotor(*p[ECCENTRICITY_X:UNKNOWNS]).inverse


def unknowns_of(calibration: Calibration) -> tuple[Array, float]:
    """The calibration's eight unknowns, mm and rad, and the sensor's height by convention, mm.

    Of a view placed in another's C: those in its own frames.
    """
    phi, radial, height, tilt, offset = sensor_parameters(calibration.table_from_sensor)
    return np.array([phi, radial, offset, tilt, *shaft_parameters(calibration.shaft_from_rotor)]), height


def influence(calibration: Calibration, x: Array, z: Array, angle: Array) -> Array:
    """By how much the points in C of n readings follow each unknown: (8, n, 3), mm per mm or rad."""
    moved = []
    for change in np.diag(STEPS):
        after, before = (moved_points(calibration, sign * change, x, z, angle) for sign in (1.0, -1.0))
        moved.append((after - before) / (2 * change.max()))
    return np.stack(moved)


def influence_of_view(calibration: Calibration, points: Array, x: Array, z: Array, angle: Array) -> Array:
    """By how much ``points`` (n, 3) mm of C, the places of n readings, follow each unknown of a view, its azimuth and
    its height: (``VIEW_UNKNOWNS``, n, 3), mm per mm or rad.
    """
    part = part_from_shaft(calibration)
    up = part.rotation[:, 2]
    round_it = np.cross(up, points - part.translation)
    own = influence(calibration, x, z, angle)
    return np.concatenate([own, round_it[None], np.broadcast_to(up, (1, *points.shape))])


def independent_parts(calibration: Calibration) -> Array | None:
    """The covariance, and what a positioner adds, as independent parts (k, 8), each one standard deviation of the
    unknowns together.

    None where the record carries no covariance of them all.
    """
    covariance = calibration.covariance
    if covariance.shape != (UNKNOWNS, UNKNOWNS):
        return None
    root, values = square_root(covariance)
    again = retaken(calibration)[:UNKNOWNS].T
    return np.concatenate([root.T[values > 1e-12 * values[-1]], again[again.any(axis=1)]])


def retaken(calibration: Calibration) -> Array:
    """By how much (``VIEW_UNKNOWNS``, 6) the unknowns of a view, its azimuth and its height may be off because a
    positioner has taken its place again since the calibration: standard deviations, one column a direction.

    It went there twice, so that its repeatability counts twice. What shaft in view has told is none of it: the sensor
    is as far out, where it sees the base, as it was.
    """
    sensor, scan, calibrated = calibration.stand.sensor, calibration.applied_to, calibration.scan
    same = scan is not None and calibrated is not None and bool(scan.sha256) and scan.sha256 == calibrated.sha256
    if not sensor.position or same:
        return np.zeros((VIEW_UNKNOWNS, 0))
    shift, turn = (sqrt(2.0) / K * (U or 0.0) for U in (sensor.position_U, sensor.position_tilt_U))
    p, height = unknowns_of(calibration)
    columns = np.zeros((VIEW_UNKNOWNS, 6))
    columns[RADIAL, 0] = 0.0 if calibration.followed else shift
    columns[PLANE_OFFSET, 1] = columns[HEIGHT, 2] = shift
    columns[PHI, 3] = turn
    columns[RADIAL, 3] = -turn * _outwards_by_phi(calibration) if calibration.followed else 0.0
    columns[[PLANE_TILT, PLANE_OFFSET], 4] = turn, -height * turn  # about its own origin, which stays
    columns[[AZIMUTH, PLANE_OFFSET], 5] = turn, -p[RADIAL] * turn
    return columns


def _outwards_by_phi(calibration: Calibration) -> float:
    """By how much (mm/rad) the middle of the shaft's base, as the sensor saw it, moves outwards with its angle phi."""
    base = None if calibration.artefact is None else calibration.artefact.base
    seen = [s for s in calibration.static_profiles if base is not None and s.surface == base.name]
    if base is None or not seen:
        return 0.0
    phi, radial, height, _, _ = sensor_parameters(calibration.table_from_sensor)
    at = np.array([seen[0].height.mean() - calibration.height])
    x, z = LaserPlane(phi, radial, height).from_uv(np.array([base.radius]), at)
    (more, _), (less, _) = (LaserPlane(phi + step, radial, height).to_uv(x, z) for step in (STEPS[PHI], -STEPS[PHI]))
    return float((more - less)[0] / (2 * STEPS[PHI]))


def without(calibration: Calibration, off: Array) -> Calibration:
    """A view's calibration whose unknowns, azimuth and height (``VIEW_UNKNOWNS``,) were ``off``, mm and rad."""
    p, height = unknowns_of(calibration)
    *moved, azimuth, up = -off
    q = p + np.array(moved)
    placed = replace(calibration, azimuth=calibration.azimuth + azimuth, height=calibration.height + up)
    own = shaft_from_rotor(*q[ECCENTRICITY_X:UNKNOWNS])
    return replace(
        placed,
        table_from_sensor=table_from_sensor(q[PHI], q[RADIAL], height, q[PLANE_TILT], q[PLANE_OFFSET]),
        shaft_from_rotor=part_from_shaft(calibration) @ placed.first_from_table @ own,
    )


def joint_covariance(calibrations: Sequence[Calibration]) -> Array | None:
    """The covariance of all unknowns of several views, in their order; None where their record carries none.

    What a witness band adds to the radial position of one of them is added here.
    """
    joint = calibrations[0].joint
    if joint is None or any(c.covariance.shape[0] < UNKNOWNS for c in calibrations):
        return None
    at = np.concatenate([VIEW_UNKNOWNS * joint.views.index(c.name) + np.arange(VIEW_UNKNOWNS) for c in calibrations])
    covariance = np.array(joint.matrix[np.ix_(at, at)])
    for k, calibration in enumerate(calibrations):
        radial = k * VIEW_UNKNOWNS + RADIAL
        covariance[radial, radial] = max(covariance[radial, radial], calibration.covariance[RADIAL, RADIAL])
    return covariance


def joint_parts(calibrations: Sequence[Calibration]) -> Array | None:
    """The joint covariance of several views, and what a positioner adds, as independent parts (k, ``VIEW_UNKNOWNS`` a
    view); None where their record carries none.
    """
    covariance = joint_covariance(calibrations)
    if covariance is None:
        return None
    root, values = square_root(covariance)
    parts = [root.T[values > 1e-12 * values[-1]]]
    for k, calibration in enumerate(calibrations):
        again = retaken(calibration)
        wide = np.zeros((again.shape[1], covariance.shape[0]))
        wide[:, k * VIEW_UNKNOWNS : (k + 1) * VIEW_UNKNOWNS] = again.T
        parts.append(wide[again.any(axis=0)])
    return np.concatenate(parts)
