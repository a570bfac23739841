"""The views by which a part is inspected: what each sensor saw of it, in one frame, and all of them as one scan."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from math import hypot

import numpy as np

from truestand.core.arrays import Array, Ints
from truestand.core.assumptions import K
from truestand.core.calibration import HEIGHT, VIEW_UNKNOWNS, Calibration, Contribution
from truestand.core.frames import UNKNOWNS
from truestand.core.inspection import Seam
from truestand.core.message import Message
from truestand.core.scan import Scan
from truestand.core.surface import Surface, each_of, sensor_origins, stacked, surface_of, table_angle
from truestand.uncertainty.influence import (
    independent_parts,
    influence_of_view,
    joint_covariance,
    joint_parts,
)
from truestand.uncertainty.lines import CALIBRATION
from truestand.uncertainty.range_errors import lifts_of_range


@dataclass(frozen=True)
class PartView:
    """A part as one scan shows it."""

    surface: Surface
    scan: Scan
    calibration: Calibration

    @cached_property
    def angle(self) -> Array:
        """Table angle (N,) rad."""
        return table_angle(self.scan, self.calibration)

    @property
    def name(self) -> str:
        """Of the view."""
        return self.calibration.name


@dataclass(frozen=True)
class PartViews:
    """All views as one scan: its profiles are those of the views, one after the other (``stacked``)."""

    each: tuple[PartView, ...]

    @property
    def first(self) -> PartView:
        """The view in whose frame all are."""
        return self.each[0]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the views; of a single one none is named."""
        return tuple(view.name for view in self.each) if len(self.each) > 1 else ()

    @property
    def reasons(self) -> tuple[Message, ...]:
        """What speaks against deciding anything by their calibrations."""
        return tuple(dict.fromkeys(reason for view in self.each for reason in view.calibration.reasons))

    @cached_property
    def surface(self) -> Surface:
        """What all of them saw."""
        return stacked([view.surface for view in self.each])

    @cached_property
    def origins(self) -> Array:
        """Where the sensor's rays start, (N, 3) mm in C, of each profile."""
        return np.concatenate([sensor_origins(view.calibration, view.angle) for view in self.each])

    @cached_property
    def seen(self) -> float:
        """Share of the points of all profiles that have a reading."""
        return float(np.isfinite(self.surface.z).mean())

    @property
    def heights_known(self) -> float:
        """U (mm, k = 2) of the height of a view over the first one's; 0 where that isn't known."""
        covariance = joint_covariance([view.calibration for view in self.each]) if len(self.each) > 1 else None
        return 0.0 if covariance is None else K * float(np.sqrt(np.diag(covariance)[HEIGHT::VIEW_UNKNOWNS].max()))

    def view_of(self, row: Ints) -> Ints:
        """Which view each of some profiles (n,) is of."""
        return surface_of(row, [view.surface for view in self.each])

    def moves(self, flat: Ints, normal: Array) -> dict[str, Array] | None:
        """By how much the calibration and errors of the sensors' range lift readings, ``flat`` (n,) in the scan of all,
        along their ``normal`` (n, 3): by the budget's line, each independent part's (k, n) mm, standard. What views
        share lifts all of them at once. None where a record carries no covariance.
        """
        calibrations = [view.calibration for view in self.each]
        alone = calibrations[0].joint is None
        parts = independent_parts(calibrations[0]) if alone else joint_parts(calibrations)
        if parts is None:
            return None
        row, column = np.divmod(flat, self.surface.x.shape[1])
        of, lifts = self.view_of(row), np.zeros((parts.shape[0], flat.size))
        unknowns, first, of_range = UNKNOWNS if alone else VIEW_UNKNOWNS, 0, dict[str, list[Array]]()
        for k, view in enumerate(self.each):
            on = of == k
            own, at = row[on] - first, column[on]
            points = self._points(row[on], at)
            x, z, angle = view.scan.x[own, at], view.scan.z[own, at], view.angle[own]
            follow = influence_of_view(view.calibration, points, x, z, angle)
            lifted = np.einsum("unc,nc->un", follow, normal[on])
            lifts[:, on] = parts[:, k * unknowns : (k + 1) * unknowns] @ lifted[:unknowns]
            along = np.einsum("nc,nc->n", points - self.origins[row[on]], normal[on]) / z
            for name, own_lift in lifts_of_range(view.calibration, z, along, lifted):
                lift = np.zeros(flat.size)
                lift[on] = own_lift
                of_range.setdefault(name, []).append(lift)
            first += view.scan.profiles
        return {CALIBRATION: lifts} | {name: np.stack(each) for name, each in of_range.items()}

    def _points(self, row: Ints, column: Ints) -> Array:
        """Places (n, 3) mm in C of some readings."""
        return np.stack([a[row, column] for a in (self.surface.x, self.surface.y, self.surface.z)], axis=-1)


def views_of(surface: Surface | Sequence[Surface]) -> PartViews:
    """The views that surfaces in one frame show.

    Raises:
        BadRecipe: a surface doesn't say from which scan and calibration it comes.
    """
    surfaces = each_of(surface)
    return PartViews(tuple(PartView(s, *s.origin) for s in surfaces))


def largest(of_views: Iterable[Sequence[Contribution]]) -> list[Contribution]:
    """Lines that each view has, the largest of each name: views read the same surface, and the worst of them counts."""
    found: dict[str, Contribution] = {}
    for lines in of_views:
        for line in lines:
            if line.name not in found or line.U > found[line.name].U:
                found[line.name] = line
    return list(found.values())


def seams_between(known: Sequence[tuple[str, float, float]], section: str | None = None) -> tuple[Seam, ...]:
    """What views differ by, of which each one says where a surface stands: its name, value and U (mm)."""
    found = []
    for (a, value_a, U_a), (b, value_b, U_b) in combinations(known, 2):
        found.append(Seam.between((a, b), value_a - value_b, hypot(U_a, U_b), section=section))
    return tuple(found)
