"""The table told from the gear by closure: what stays with the table while the gear is turned on it is the table's,

    F_c(j) = g(j) + t(theta_j + o_c) + const_c,    t = sum of waves a turn

(multi-step technique: D. J. Whitehouse, J. Phys. E 9 (1976) 531). The calibration's own errors, those of the sensor's
range and the seat's axis stay with the stand as well: without them a laser plane beside where it is taken to be, or a
seat off the base, looks like a part that sits otherwise, and what a range error does to a part that runs eccentrically
like an error of the table. What is left of the table's errors, and of all else that does not turn with the gear, is
averaged over the clampings.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt, tau

import numpy as np
from numpy.typing import NDArray

from truestand.apply.datum import Datum, datum_of
from truestand.core.arrays import Array
from truestand.core.assumptions import SEATED_U, SIDEWAYS_U, K
from truestand.core.calibration import Calibration
from truestand.core.errors import BadRecipe
from truestand.core.frames import UNKNOWNS
from truestand.core.message import Message
from truestand.core.scan import Scan
from truestand.core.surface import Surface, apply_calibration, readings_of, seen_at, sensor_origins, table_angle
from truestand.gear.drawing import Gear
from truestand.gear.flanks import Toothing, find_toothing, flank_offsets
from truestand.gear.geometry import SIGMA, Involute
from truestand.uncertainty.influence import independent_parts, influence_of_view, part_from_shaft, without
from truestand.uncertainty.lines import once_per_turn
from truestand.uncertainty.range_errors import lifts_of_range, range_errors

MOST = 1.5
"""Times its U that what closure finds may be."""
LEAST_VARIANCE = 1e-16
"""rad2: no wave is known better."""
LEAST_NOISE = 1e-7
"""rad: flanks' places are not known better."""
OF_CLAMPING, OF_AXIS = 4, 2
"""Unknowns of each clamping but the first: by what it turned the gear, where the part sits, and by what its teeth are
read as thicker, which is the sensor's; and of the seat."""
LEAST_SEAT = 1e-5
"""mm: its axis is not known better."""


@dataclass(frozen=True, slots=True)
class Closure:
    """What several clampings tell of the table, and of how the part sat in each."""

    orders: tuple[int, ...]
    """Waves a turn of the table's error:"""
    waves: Array
    """(2 orders,) rad, cosine and sine of each,"""
    covariance: Array
    """(2 orders, 2 orders) rad2."""
    seats: Array
    """(clampings, 2) mm: how far off the first one's axis the part sat in each, because it was seated otherwise,"""
    aside: Array
    """(clampings, 2) mm: and how far off the shaft's axis that is, which does not turn with the part."""
    turns: Array
    """(clampings,) rad: by how much the part stands turned in each against the first one, all else corrected."""
    known: Array
    """(2 orders,) rad: standard uncertainty of the waves beforehand,"""
    seated: float
    """and mm, of the seats."""
    left: float
    """rad: standard deviation of what differs between clampings beyond all that."""
    calibrated: dict[str, tuple[Array, Array]]
    """By view: by how much (8,) the unknowns of its calibration are off, mm and rad, and their covariance (8, 8)."""

    def expanded(self, wave: int) -> float:
        """Of a wave (k = 2, rad), in the phase in which it is known worst."""
        own = slice(2 * wave, 2 * wave + 2)
        return K * sqrt(max(float(np.linalg.eigvalsh(self.covariance[own, own])[-1]), LEAST_VARIANCE))

    @property
    def faster(self) -> float:
        """U (k = 2, rad) of the waves beyond once a turn: of those that were found, and of all others."""
        found = max(self.expanded(k) for k in range(1, len(self.orders)))
        return max(found, K * self.left / sqrt(len(self.seats)))

    def contradictions(self, radius: float) -> tuple[Message, ...]:
        """What of it can't be, by what was known beforehand; ``radius``: mm, of the measuring circle."""
        found, once = [], float(np.hypot(*self.waves[:2]))
        if once > MOST * K * self.known[0]:
            text = (
                f"closure: the table would err by {1000 * once * radius:.1f} um once a turn at the measuring circle, "
                f"which its U ({1000 * K * self.known[0] * radius:.1f} um) does not allow: count the teeth, see that "
                "the part sits as it sat (bore_clearance_mm), or state angle_U_arcsec under [table]"
            )
            found.append(Message("closure_contradicts", text))
        off = float(np.hypot(*self.seats.T).max(initial=0.0))
        if off > MOST * K * self.seated:
            text = (
                f"closure: the part would sit {1000 * off:.1f} um otherwise than in the first clamping, U is "
                f"{1000 * K * self.seated:.1f} um: state its play (bore_clearance_mm)"
            )
            found.append(Message("part_sits_otherwise", text))
        return tuple(found)

    def corrected(self, surface: Surface, radius: float) -> Surface:
        """The surface with the table's waves taken off its angle, by the corrected calibration; what is left of the
        waves is known, as angle once a turn and, at the measuring ``radius`` (mm), as sideways motion beyond.
        """
        scan, calibration = surface.origin
        angle = table_angle(scan, calibration)
        table = replace(scan.stand.table, angle_U=self.expanded(0), sideways_U=self.faster * radius)
        angle = angle - waves_of(angle % tau, self.orders) @ self.waves
        corrected = replace(scan, angle=angle, stand=replace(scan.stand, table=table))
        if calibration.name in self.calibrated:
            off, covariance = self.calibrated[calibration.name]
            calibration = replace(without(calibration, np.append(off, [0.0, 0.0])), covariance=covariance)
        return apply_calibration(corrected, replace(calibration, speed_factor=1.0, applied_to=corrected))


def waves_of(angle: Array, orders: Sequence[int]) -> Array:
    """Cosine and sine (n, 2 orders) of each wave a turn at angles (n,) rad."""
    return np.stack([f(n * angle) for n in orders for f in (np.cos, np.sin)], axis=-1)


def seated_u(gear: Gear) -> float:
    """Standard uncertainty (mm) of where a part sits on its seat that is clamped again, in each direction."""
    return max(gear.bore_clearance / 2 / sqrt(3.0), SEATED_U / K)


@dataclass(frozen=True, slots=True)
class _Unknowns:
    """Where the unknowns of the least squares stand: flanks, clampings but the first, the seat, views, waves."""

    teeth: int
    clampings: int
    parts: dict[str, Array]
    """Independent parts (k, 8) of the covariance of each view's calibration, none where that isn't known."""
    ranges: int
    """Errors of the range of each view."""
    orders: tuple[int, ...]

    def clamping(self, c: int) -> slice:
        """Of clamping ``c``: by what it turned the gear, where that sits (2), how much thicker its teeth are read."""
        first = 2 * self.teeth + OF_CLAMPING * (c - 1)
        return slice(first, first + OF_CLAMPING)

    @property
    def axis(self) -> slice:
        """Of the seat."""
        first = self.clamping(self.clampings).start
        return slice(first, first + OF_AXIS)

    def calibration(self, name: str) -> slice:
        """Of a view's calibration: its parts, each in standard deviations."""
        names = list(self.parts)
        first = self.axis.stop + sum(len(self.parts[n]) + self.ranges for n in names[: names.index(name)])
        return slice(first, first + len(self.parts[name]))

    def range_errors(self, name: str) -> slice:
        """Of the range of a view's sensor, each in standard deviations."""
        first = self.calibration(name).stop
        return slice(first, first + self.ranges)

    @property
    def waves(self) -> slice:
        """Of the table."""
        first = self.axis.stop + sum(len(parts) + self.ranges for parts in self.parts.values())
        return slice(first, first + 2 * len(self.orders))

    @property
    def number(self) -> int:
        """Of them all."""
        return int(self.waves.stop)


def closure_of(surfaces: Sequence[Surface], nominal: Involute, datum: Datum) -> Closure:
    """Least squares: the gear's own places are free, and so is what each clamping turns it by; the table, the
    calibration, the sensor's range, and how far off the axis a part sits that was clamped again, are known beforehand
    as their budget says.
    """
    scan, calibration = surfaces[0].origin
    orders = _orders(nominal.gear.teeth)
    parts, ranges = _parts([s.origin[1] for s in surfaces]), len(range_errors(calibration))
    at = _Unknowns(nominal.gear.teeth, len(surfaces), parts, ranges, orders)
    known, seated = _before(scan, nominal, orders), seated_u(nominal.gear)
    precision = np.zeros(at.number)
    for c in range(1, at.clampings):
        precision[at.clamping(c)][1:3] = 1.0 / seated**2
    precision[at.axis.stop : at.waves.start] = 1.0
    precision[at.axis], precision[at.waves] = 1.0 / _seat_known(calibration) ** 2, 1.0 / np.square(known)
    design, places = _equations(surfaces, find_toothing(surfaces[0], nominal, datum), at)
    left = _noise(design, places)
    normal = design.T @ design / left**2 + np.diag(precision)
    covariance = np.asarray(np.linalg.pinv(normal, rcond=1e-14, hermitian=True))
    found = np.asarray(covariance @ design.T @ places / left**2)
    clampings = np.array([np.zeros(OF_CLAMPING), *(found[at.clamping(c)] for c in range(1, at.clampings))])
    return Closure(
        orders, found[at.waves], np.asarray(covariance[at.waves, at.waves]), clampings[:, 1:3],
        np.stack([(_turned(s.origin[1]) + np.eye(2)) @ found[at.axis] for s in surfaces]), clampings[:, 0],
        known, seated, left,
        {
            name: _corrected(own, found, covariance, at.calibration(name)) for name, own in parts.items() if own.size
        },
    )  # fmt: skip


def _corrected(parts: Array, found: Array, covariance: Array, own: slice) -> tuple[Array, Array]:
    """By how much (8,) the unknowns of a calibration are off, of whose covariance these are the ``parts``, and what is
    left of it (8, 8).
    """
    return parts.T @ found[own], parts.T @ covariance[own, own] @ parts


def _orders(teeth: int) -> tuple[int, ...]:
    """Waves a turn that are looked for: slow ones, and the one that neighbouring teeth feel most."""
    return tuple(sorted({1, 2, 3, max(2, teeth // 4)}))


def _equations(surfaces: Sequence[Surface], toothing: Toothing, at: _Unknowns) -> tuple[Array, Array]:
    """How the places of the flanks follow the unknowns (n, unknowns), and the places (n,) rad."""
    nominal = toothing.nominal
    rows, values = [], []
    for c, surface in enumerate(surfaces):
        calibration, offsets = surface.origin[1], flank_offsets(surface, toothing)
        place = (SIGMA[:, None] * offsets.reshape(2, at.teeth)).reshape(-1) / nominal.base_radius
        seen = np.flatnonzero(np.isfinite(place))
        sigma = SIGMA[seen // at.teeth]
        points, gradient = _middles(toothing, seen)
        moved = sigma[:, None] * gradient[:, :2] / nominal.base_radius
        design = np.zeros((seen.size, at.number))
        design[np.arange(seen.size), seen] = 1.0
        if c:
            design[:, at.clamping(c)] = np.column_stack([np.ones(seen.size), moved, sigma])
        design[:, at.axis] = moved @ _turned(calibration)
        name, arc = calibration.name, sigma / nominal.base_radius
        of_calibration, of_range = _followed(calibration, at.parts[name], points, gradient)
        design[:, at.calibration(name)], design[:, at.range_errors(name)] = (of_calibration * arc).T, (of_range * arc).T
        # An angle that counts too much by t shows the flank turned back by t, or on, of a gear that was turned over.
        design[:, at.waves] = -calibration.sense * waves_of(seen_at(calibration, points), at.orders)
        rows.append(design)
        values.append(place[seen])
    return np.concatenate(rows), np.concatenate(values)


def _turned(calibration: Calibration) -> Array:
    """(2, 2): by how much a part that was turned back seems to sit aside, for each mm by which its seat does."""
    return np.asarray(part_from_shaft(calibration).rotation[:2, :2] - np.eye(2))


def _seat_known(calibration: Calibration) -> float:
    """Standard uncertainty (mm) of the axis of the seat, in each direction."""
    try:
        return max(datum_of(calibration, "seat").U_offset / K, LEAST_SEAT)
    except BadRecipe:  # no second cylinder: the part sits on the base
        return LEAST_SEAT


def _parts(calibrations: Sequence[Calibration]) -> dict[str, Array]:
    """The independent parts (k, 8) of the covariance of each view; none where its record carries none."""
    known = {c.name: independent_parts(c) for c in calibrations}
    return {name: np.zeros((0, UNKNOWNS)) if parts is None else parts for name, parts in known.items()}


def _followed(calibration: Calibration, parts: Array, points: Array, gradient: Array) -> tuple[Array, Array]:
    """By how much delta of flanks at ``points`` (n, 3) mm of C, of such a ``gradient``, follows the ``parts`` (k, 8) of
    the calibration's covariance: (k, n), and the errors of range: (m, n).
    """
    angle = seen_at(calibration, points)
    x, z = readings_of(calibration, points, angle)
    follow = np.einsum("unc,nc->un", influence_of_view(calibration, points, x, z, angle), gradient)
    along = np.einsum("nc,nc->n", points - sensor_origins(calibration, angle), gradient) / z
    lifts = [lift for _, lift in lifts_of_range(calibration, z, along, follow)]
    return np.asarray(parts @ follow[:UNKNOWNS]), np.stack(lifts)


def _middles(toothing: Toothing, flanks: NDArray[np.intp]) -> tuple[Array, Array]:
    """Where (n, 3) mm in C the measuring circle of some ``flanks`` (side * teeth + tooth) is at the middle of the face,
    and the gradient (n, 3) of delta there.
    """
    nominal = toothing.nominal
    side, tooth = np.divmod(flanks, nominal.gear.teeth)
    roll, height = np.full(side.size, nominal.measuring_roll), np.full(side.size, nominal.middle)
    points = toothing.points((side, tooth), roll, height, np.zeros(side.size))
    return points, toothing.gradient(points, SIGMA[side])


def _noise(design: Array, value: Array) -> float:
    """Standard deviation (rad) of the flanks' places, from what waves, teeth and clampings leave of them."""
    solution, _, rank, _ = np.linalg.lstsq(design, value, rcond=None)
    rest = value - design @ solution
    return max(sqrt(float(rest @ rest) / max(value.size - int(rank), 1)), LEAST_NOISE)


def _before(scan: Scan, nominal: Involute, orders: Sequence[int]) -> Array:
    """Standard uncertainty (2 orders,) rad of each wave beforehand."""
    _, U = once_per_turn(scan)
    stated = scan.stand.table.sideways_U
    sideways = (SIDEWAYS_U if stated is None else stated) / nominal.measuring_radius
    return np.repeat([sqrt((U / n) ** 2 + (sideways if n > 1 else 0.0) ** 2) / K for n in orders], 2)
