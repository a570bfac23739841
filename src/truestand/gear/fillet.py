"""Readings near the ends of profiles that may be of what is beyond them.

What a sensor makes of a steep surface moves its readings along their rays, the farther the steeper it is: by a
hundredth of a millimetre across the flank, and half a millimetre along it. Readings of the fillet then lie on the
flank's lower end, as if there were material on it, and rays that should meet the flank there meet the fillet.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import ceil, cos

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.assumptions import INCIDENCE_U
from truestand.core.robust import robust_sd
from truestand.core.surface import sensor_origins, table_angle
from truestand.gear.flanks import Flanks
from truestand.gear.geometry import SIGMA
from truestand.gear.views import GearView

MOST_ALONG = 1.0
"""mm of roll length by which a reading may be read farther along its flank than it is, at most."""
LEAST_FACING, STEEPEST = 0.05, 0.1
"""Cosine of the incidence below which nothing is seen; the fillet is seen as steeply as so much of the readings near a
root, the steepest.
"""
ROW, LEAST_READINGS, PLAINLY = 0.25, 30, 2.5
"""mm of roll length in which readings near the root are compared, how many of them at least, and robust standard
deviations of readings by which one lies plainly above the others.
"""


def surely_on_flanks(views: Sequence[GearView], more: Sequence[Array]) -> list[GearView]:
    """The views without readings that may be of what is beyond a flank's end, and which views see a root more steeply
    than another one does. ``more``: by how much each reads its flanks' points (n,) more than the mean of all, mm.

    Those lie beyond an end that do where they are moved back along their rays by that. Those may be of the fillet that
    lie within its reach and plainly above what else is read there: as far from the end as what the incidence makes of
    a reading moves it along its ray.
    """
    near = [_NearEnds.of(view, of_view) for view, of_view in zip(views, more, strict=True)]
    facing = np.array([of.root_facing for of in near])
    found = []
    for view, of in zip(views, near, strict=True):
        sure = np.ones(view.flanks.roll.size, dtype=bool)
        sure[of.which] = of.on_flank & ~of.by_fillet
        steeper = of.root_facing < facing.max(axis=0)
        found.append(replace(view, flanks=view.flanks.select(sure), steeper=steeper, fillet_reach=of.reach))
    return found


@dataclass(frozen=True, slots=True)
class _NearEnds:
    """Readings of a view near the ends of profiles, (n,)."""

    which: Mask
    """(all,): which of the view's they are."""
    on_flank: Mask
    """Whether they lie on it where they are moved back along their rays,"""
    by_fillet: Mask
    """and whether they may be of the fillet."""
    root_facing: Array
    """(2,): mean cosine of the incidence near the root, of left and right; 0 where too little was seen."""
    reach: Array
    """(2,) mm: roll length up to which readings of the fillet may be read."""

    @classmethod
    def of(cls, view: GearView, more: Array) -> "_NearEnds":
        """Of a view that reads its points (all,) so much ``more``, mm."""
        flanks, nominal = view.flanks, view.flanks.toothing.nominal
        from_root = flanks.roll - nominal.control_roll
        which = np.fmin(from_root, nominal.tip_roll - flanks.roll) < MOST_ALONG
        some = flanks.select(which)
        side, tooth = np.divmod(some.flank, nominal.gear.teeth)
        points = some.toothing.points((side, tooth), some.roll, some.height, some.delta)
        to_sensor = sensor_origins(view.calibration, table_angle(view.scan, view.calibration)[some.profile]) - points
        gradient = some.toothing.gradient(points, SIGMA[side])
        rise = (gradient * to_sensor).sum(axis=1)
        place = some.toothing.datum.pose(points - (more[which] / rise)[:, None] * to_sensor)
        roll = np.sqrt(np.maximum(place[:, 0] ** 2 + place[:, 1] ** 2 - nominal.base_radius**2, 0.0))
        facing = rise / (np.linalg.norm(to_sensor, axis=1) * np.linalg.norm(gradient, axis=1))
        at_root = [(from_root[which] < MOST_ALONG) & (side == k) for k in (0, 1)]
        told = [facing[of] if np.count_nonzero(of) >= LEAST_READINGS else np.zeros(1) for of in at_root]
        beyond = [some.roll[of & (roll < nominal.control_roll)].max(initial=0.0) for of in at_root]
        reach = np.array([_reach(view, float(np.quantile(values, STEEPEST))) for values in told])
        reach = np.maximum(reach, beyond)
        return cls(
            which,
            (roll >= nominal.control_roll) & (roll <= nominal.tip_roll),
            (some.roll < reach[side]) & _above_others(flanks.delta - more, flanks)[which],
            np.array([values.mean() for values in told]),
            reach,
        )


def _reach(view: GearView, facing: float) -> float:
    """Roll length (mm) up to which readings of a fillet may be read that is seen at a cosine ``facing`` of incidence,
    or as steeply as the sensor sees at all.
    """
    sensor, nominal = view.scan.stand.sensor, view.flanks.toothing.nominal
    off = INCIDENCE_U if sensor.incidence_U is None else sensor.incidence_U
    least = LEAST_FACING if sensor.incidence_limit is None else max(cos(sensor.incidence_limit), LEAST_FACING)
    along = min(off / max(facing, least) * nominal.base_radius / nominal.control_roll, MOST_ALONG)
    return nominal.control_roll + along


def _above_others(delta: Array, flanks: Flanks) -> Mask:
    """Readings (n,), ``delta`` mm, near the root that lie plainly above what is usual there: against the rest of their
    flanks, most readings of a side at the same roll length lie lower.
    """
    nominal = flanks.toothing.nominal
    from_root, from_tip = flanks.roll - nominal.control_roll, nominal.tip_roll - flanks.roll
    middle, number = np.fmin(from_root, from_tip) >= MOST_ALONG, 2 * nominal.gear.teeth
    above = np.zeros(delta.size, dtype=bool)
    if np.count_nonzero(middle) < LEAST_READINGS:
        return above
    total = np.bincount(flanks.flank[middle], delta[middle], minlength=number)
    rest = delta - (total / np.maximum(np.bincount(flanks.flank[middle], minlength=number), 1))[flanks.flank]
    most = PLAINLY * robust_sd(rest[middle])
    side, row = flanks.flank // nominal.gear.teeth, np.floor(from_root / ROW).astype(np.int64)
    for k, n in product((0, 1), range(ceil(MOST_ALONG / ROW))):
        of_row = np.flatnonzero((side == k) & (row == n))
        if of_row.size >= LEAST_READINGS:
            above[of_row] = rest[of_row] - np.median(rest[of_row]) > most
    return above
