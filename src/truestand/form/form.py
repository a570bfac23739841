"""Form of associated features: roundness, cylindricity, straightness, flatness, and run-out about a datum axis.

Terms of ISO 12181 (roundness), ISO 12180 (cylindricity), ISO 12780 (straightness), ISO 12781 (flatness) and ISO 1101
(run-out). Run-out is indicator travel about the datum, not form: a round shaft that runs eccentric has a run-out of
twice its eccentricity.
"""

from dataclasses import dataclass, replace
from math import hypot, log, sqrt
from statistics import NormalDist
from typing import Literal

import numpy as np

from truestand.core.arrays import Array, Ints
from truestand.core.assumptions import K
from truestand.core.errors import BadRecipe
from truestand.core.message import Message
from truestand.form.associate import LAYOUTS, LEAST_POINTS, Feature, FittedFeature, associate
from truestand.form.lobes import FEW_LOBES, form_covariance, lobe_leverage
from truestand.form.upr import UprFilter, upr_filter
from truestand.form.zone import Zone
from truestand.form.zoned import ZonedFeature, zoned

Reference = Literal["LSC", "MZC", "MIC", "MCC"]

REFERENCES: dict[Feature, tuple[Reference, ...]] = {
    "line": ("LSC", "MZC"),
    "plane": ("LSC", "MZC"),
    "circle": ("LSC", "MZC", "MIC", "MCC"),
    "cylinder": ("LSC", "MZC", "MIC", "MCC"),
    "sphere": ("LSC", "MZC", "MIC", "MCC"),
    "cone": ("LSC", "MZC"),
}
NOISE_POINTS = 20_000
"""Points whose nearest neighbours the noise is estimated from."""
NEIGHBOURS_AMONG = 300_000
MOST_FORM = 0.1
"""Share of a feature's size: with more form, the points are of something else."""
MOST_LEVERAGE = 1.0
"""Of lobes on a feature's centre, above which it is said."""
PLANE_NOISE = 10.0
"""By how much more noise points may have over a circle's plane than in it: not all instruments are alike in all
directions, and a plane that is turned within such heights makes the circle narrower by less than its noise."""
FLAT = 1e-3
"""Heights over its plane as a share of a circle's size, rms, that don't matter: turned as much, it is 2e-6 narrower."""
RING = 5e-3
"""Heights over its plane as a share of a ring's radius, rms, that hold no sphere: noise of 30 um on 6 mm makes as much,
and along a sphere's normal it passes for a sphere that bends the other way."""
SURE = 0.999
HELD = 3.0
"""By how much more form an inscribed or circumscribed feature may read than the least squares: held all round, it moves
by no more than their form, and that widens its own by twice as much."""
ROUNDING = 1e-9
ACROSS = 0.9
"""Cosine between an axis and the normal of a plane that lies across it."""
SAME_PLACE = 1e-12
"""Of the largest coordinate: as a double rounds what was worked out twice, from angles a turn apart."""
NEARLY = 1e-6
"""mm: no instrument meets a place again so nearly (a nanometre); a file written twice does."""
MOST_NEARLY = 0.1
"""Share of such points from which they, and not the instrument's noise, are what neighbours tell."""
MOST_ATTENUATED = 0.05
"""Share by which noise makes a slope over a ring's height too flat; more is too near to the height itself."""
OPEN = 0.1
"""U of the position as a share of the size, or of the direction in rad, from which the points leave a feature open."""


@dataclass(frozen=True, slots=True)
class Form:
    """An associated feature and how far the points depart from it: mm."""

    feature: Feature
    reference: Reference
    point: Array
    direction: Array | None
    radius: float | None
    half_angle: float | None
    """rad, of a cone: positive where its radius grows along ``direction``."""
    rms: float
    """Of the orthogonal distances."""
    form: float
    """Width of the zone: roundness, cylindricity, straightness, flatness; of sphere and cone the deviations' range."""
    n: int
    """Points that were seen, each place once."""
    low_pass: UprFilter | None
    noise: float
    """Standard deviation of one point at most: from differences of nearest neighbours, form between them included."""
    noise_floor: float
    """Expected ``form`` of a perfect feature with that noise."""
    U: dict[str, float]
    """Expanded (k = 2), from the points' scatter and form: point, radius and form in mm, direction and half_angle in
    rad."""
    deviation: Array
    """(n,) mm from the feature; NaN where a point was not seen."""
    certificate: Zone | None = None
    """The zone that gave the reference, proven by forces at its contacts that hold the feature in balance."""
    reasons: tuple[Message, ...] = ()
    """Why the feature is doubtful; none: it is not."""
    remarks: tuple[Message, ...] = ()


def evaluate(points: Array, feature: Feature, reference: Reference = "LSC", low_pass: UprFilter | None = None) -> Form:
    """The ``feature`` of points (n, 3) mm by its reference, and its form; NaN: not seen.

    ``low_pass``: through which a circle's profile goes first.

    Raises:
        BadRecipe: a reference or filter that the feature doesn't have.
        NotEnoughData: too few points, an open profile for a filter, points that don't hold the feature.
    """
    if reference not in REFERENCES[feature]:
        raise BadRecipe(
            f"found --reference {reference} for a {feature}, need {' or '.join(REFERENCES[feature])} (inscribed and "
            "circumscribed are circle, cylinder and sphere); pass one of these"
        )
    if low_pass is not None and feature != "circle":
        raise BadRecipe(f"found a UPR filter for a {feature}, need a closed circular profile; leave the filter out")
    seen = np.isfinite(points).all(axis=1)
    first, same = _each_once(points[seen])
    points, repeated = points[seen][first], int(same.size - first.size)
    fitted = as_measured = associate(points, feature)
    noise = PointNoise(point_noise(points, fitted), float(len(points)), fitted.spatial)
    if low_pass is not None:
        points = _filtered(points, fitted, low_pass)
        fitted, noise = associate(points, feature), noise.through(low_pass)
    covariance = _covariance(points, fitted, noise)
    if reference == "LSC":
        found = _by_least_squares(fitted, noise, covariance)
    else:
        found = _by_zone(zoned(points, fitted, reference), reference, noise, _expanded(fitted, covariance))
    deviation = np.full(seen.size, np.nan)
    deviation[seen] = found.deviation[same]
    certificate = _of_all(found.certificate, np.flatnonzero(seen)[first])
    return replace(
        found, deviation=deviation, low_pass=low_pass, certificate=certificate,
        reasons=_reasons(found, points, as_measured, fitted), remarks=_remarks(points, fitted, repeated),
    )  # fmt: skip


def _each_once(points: Array) -> tuple[Ints, Ints]:
    """Where points (n, 3) mm stand for the first time, (k,), and which of these each of them is, (n,).

    A point given again is no second reading: it would halve the noise, and be its own nearest neighbour.
    """
    if not len(points):
        return np.empty(0, np.intp), np.empty(0, np.intp)
    place = np.rint(points / max(SAME_PLACE * float(np.abs(points).max()), 1e-300))
    order = np.lexsort(place.T)
    new = np.append(True, (np.diff(place[order], axis=0) != 0).any(axis=1))
    if new.all():
        return np.arange(len(points)), np.arange(len(points))
    same = np.empty(len(points), np.intp)
    same[order] = np.cumsum(new) - 1
    return order[new], same


def _of_all(zone: Zone | None, place: Ints) -> Zone | None:
    """The zone whose contacts count among all points, where those that it was made of have their ``place`` (k,)."""
    return None if zone is None else replace(zone, contacts=place[zone.contacts])


@dataclass(frozen=True, slots=True)
class PointNoise:
    """Standard deviation of a point, mm, and number of independent points."""

    sd: float
    count: float
    spatial: bool = False
    """Whether points depart all round, as from a line in space: then the form is twice the largest distance."""

    @property
    def floor(self) -> float:
        """Expected range of that many normal readings (Blom 1958), mm: form that noise alone makes."""
        n = self.count
        if n < 2:
            return 0.0
        share = (n - 0.375) / (n + 0.25)
        return 2.0 * self.sd * (sqrt(-2.0 * log(1.0 - share)) if self.spatial else NormalDist().inv_cdf(share))

    def expanded_form(self, form: float, U: float) -> float:
        """U (mm) of a ``form`` whose extremes are known to ``U``: noise only ever widens it, by the floor at most.

        A doubt to one side is added whole (GUM F.2.4.5); no form is less than none.
        """
        return max(U, min(form, self.floor + U))

    def through(self, low_pass: UprFilter) -> "PointNoise":
        """The noise after the UPR filter: the energy that passes, in twice as many waves as pass."""
        waves = np.arange(1, int(2 * low_pass.highest) + 1)
        passed = 1.0 + 2.0 * float(np.square(low_pass.transmission(waves)).sum())
        return self if passed >= self.count else PointNoise(self.sd * sqrt(passed / self.count), passed)


def point_noise(points: Array, fitted: FittedFeature) -> float:
    """Standard deviation of one point, mm: deviations of nearest neighbours differ by sqrt(2) times that.

    It is not more than what is left of all points: far apart, neighbours differ by form.
    """
    from scipy.spatial import cKDTree

    n = len(points)
    if n < 4:
        return 0.0
    among = np.arange(n) if n <= NEIGHBOURS_AMONG else np.linspace(0, n - 1, NEIGHBOURS_AMONG).astype(np.intp)
    on_feature = (points - fitted.deviation[:, None] * _normals(points, fitted))[among]
    asked = np.unique(np.linspace(0, among.size - 1, NOISE_POINTS).astype(np.intp))
    _, near = cKDTree(on_feature).query(on_feature[asked], k=2)
    other = np.where(near[:, 0] == asked, near[:, 1], near[:, 0])
    if fitted.spatial:
        away = points[among] - on_feature
        squares = np.square(away[asked] - away[other]).sum(axis=1) / 2  # of two components
    else:
        squares = np.square(fitted.deviation[among[asked]] - fitted.deviation[among[other]])
    known = fitted.scatter[np.isfinite(fitted.scatter)]
    return min(float(np.sqrt(np.mean(squares) / 2)), float(known.max(initial=0.0)) if known.size else np.inf)


def _normals(points: Array, fitted: FittedFeature) -> Array:
    """Unit normals (n, 3) of the feature at its points, towards positive deviations."""
    if fitted.feature == "plane" and fitted.direction is not None:
        return np.broadcast_to(fitted.direction, points.shape)
    away = points - fitted.point
    if fitted.direction is not None:
        away = away - np.outer(away @ fitted.direction, fitted.direction)
    length = np.maximum(np.linalg.norm(away, axis=1), 1e-300)
    if fitted.feature == "line":  # in a plane it has two sides
        length = np.where(fitted.deviation < 0, -length, length)
    return np.asarray(away / length[:, None])


def _filtered(points: Array, fitted: FittedFeature, low_pass: UprFilter) -> Array:
    """The circle's points with their radial deviations filtered."""
    local = (points - fitted.point) @ fitted.frame.T
    angle = np.arctan2(local[:, 1], local[:, 0])
    passed = upr_filter(angle, fitted.deviation, low_pass)
    return np.asarray(points + (passed - fitted.deviation)[:, None] * _normals(points, fitted))


def _covariance(points: Array, fitted: FittedFeature, noise: PointNoise) -> Array | None:
    """Covariance (m, m) of the parameters from the points' scatter and, of round features, their form; None where no
    point is redundant.
    """
    if not np.isfinite(fitted.scatter).all():
        return None
    scattered = fitted.unit_covariance * np.outer(fitted.scatter, fitted.scatter)
    return scattered + form_covariance(points, fitted, noise.sd)


def _expanded(fitted: FittedFeature, covariance: Array | None) -> dict[str, float]:
    """U (k = 2) of point, direction, radius and half angle."""
    if covariance is None:
        return {}
    layout = LAYOUTS[fitted.feature]
    U = {}
    for key, part in (("point", layout.position), ("direction", layout.slopes)):
        if part is not None:
            U[key] = _largest(covariance[part, part])
    for key, at in (("radius", layout.radius), ("half_angle", layout.half_angle)):
        if at is not None:
            U[key] = K * sqrt(covariance[at, at])
    return U


def _largest(covariance: Array) -> float:
    return K * float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))


def _by_least_squares(fitted: FittedFeature, noise: PointNoise, covariance: Array | None) -> Form:
    width = 2 * float(fitted.deviation.max()) if fitted.spatial else float(np.ptp(fitted.deviation))
    U = _expanded(fitted, covariance)
    if U:
        U["form"] = noise.expanded_form(width, K * (2.0 if fitted.spatial else sqrt(2.0)) * noise.sd)
    return Form(
        fitted.feature, "LSC", fitted.point, fitted.direction, fitted.radius, fitted.half_angle, fitted.rms, width,
        fitted.deviation.size, None, noise.sd, min(noise.floor, width), U, fitted.deviation,
    )  # fmt: skip


def _by_zone(found: ZonedFeature, reference: Reference, noise: PointNoise, least: dict[str, float]) -> Form:
    """The form by a zone, its U from the noise of the contacts and of the ``least`` squares, which form moves, too.

    The farthest and nearest of many points are so by their noise, which widens the zone, and half of it either radius.
    """
    U = least | {key: hypot(value, least.get(key, 0.0)) for key, value in found.expanded(noise.sd).items()}
    U["form"] = noise.expanded_form(found.width, U["form"])
    if reference in ("MIC", "MCC"):
        U["radius"] += min(noise.floor, found.width) / 2
    return Form(
        found.feature, reference, found.point, found.direction, found.radius, found.half_angle,
        float(np.sqrt(np.mean(found.deviation**2))), found.width, found.deviation.size, None, noise.sd,
        min(noise.floor, found.width), U, found.deviation, found.zone,
    )  # fmt: skip


def _reasons(found: Form, points: Array, as_measured: FittedFeature, fitted: FittedFeature) -> tuple[Message, ...]:
    """Why a feature is doubtful, beside the least squares through the points ``as_measured`` and those that were
    ``fitted`` after a filter, which leaves heights over a circle's plane alone.
    """
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    size = extent if found.radius is None else min(extent, 2 * found.radius)
    reasons = []
    if found.n <= LEAST_POINTS[found.feature]:
        text = f"found {found.n} points, which any {found.feature} fits: form and U are not known; measure more"
        reasons.append(Message("no_redundant_points", text))
    if found.form > MOST_FORM * size:
        text = (
            f"form of {found.form:.4g} mm on points {extent:.4g} mm across: check that they are of a {found.feature}, "
            "their columns, and outliers"
        )
        reasons.append(Message("poor_fit", text))
    if found.feature == "circle" and _out_of_plane(as_measured):
        text = (
            f"the points scatter by {as_measured.scatter[2]:.4g} mm (rms) over the circle's plane and by "
            f"{as_measured.scatter[0]:.4g} mm in it: they are no section; take a thinner one, a cylinder or sphere, or "
            "--columns of its plane alone"
        )
        reasons.append(Message("out_of_plane", text))
    if found.U.get("point", 0.0) > OPEN * size or found.U.get("direction", 0.0) > OPEN or _is_ring(found, points):
        reasons.append(Message("feature_open", f"the points leave the {found.feature} open: measure more of it"))
    if (share := _nearly_repeated(points)) > MOST_NEARLY:
        text = (
            f"{share:.0%} of the points lie within {NEARLY:g} mm of another: a profile given twice has no noise of its "
            "own, and U is too small; give each once"
        )
        reasons.append(Message("points_nearly_repeated", text))
    least = float(np.ptp(fitted.deviation))
    if found.reference in ("MIC", "MCC") and found.form > HELD * least + ROUNDING * size:
        text = (
            f"form of {found.form:.4g} mm by {found.reference}, {least:.4g} mm by least squares: the points hold a "
            f"{found.feature} on one side only; measure all round, or use LSC or MZC"
        )
        reasons.append(Message("held_on_one_side", text))
    return tuple(reasons)


def _nearly_repeated(points: Array) -> float:
    """Share of points (n, 3) mm that lie beside another, ``NEARLY``; some that a rounding parts are missed."""
    place = np.rint(points / NEARLY)
    beside = np.abs(np.diff(place[np.lexsort(place.T)], axis=0)).max(axis=1) <= 1
    return 2 * float(np.count_nonzero(beside)) / len(points)


def _is_ring(found: Form, points: Array) -> bool:
    """Whether points (n, 3) mm of a round feature lie so nearly in a plane that U, which knows the first order, is
    too small: a cylinder or cone across the axis is held by what its tilt does to the second, and noise of the heights
    over the plane draws a sphere's centre towards it.
    """
    if found.feature not in ("cylinder", "cone", "sphere") or found.radius is None:
        return False
    extent, axes = np.linalg.eigh(np.cov(points.T, bias=True))
    thickness, normal = sqrt(max(float(extent[0]), 1e-300)), axes[:, 0]
    if found.direction is None:
        attenuated = (found.rms / thickness) ** 2
        aside = abs(float(normal @ (found.point - points.mean(axis=0))))
        flat = thickness <= RING * sqrt(float(extent[1] + extent[2]))
        return flat or attenuated > MOST_ATTENUATED or attenuated * aside > found.U.get("point", np.inf)
    tilt = K * found.rms / (thickness * sqrt(found.n / 2))
    return abs(float(normal @ found.direction)) > ACROSS and found.radius * tilt**2 / 2 > found.U.get("radius", np.inf)


def _out_of_plane(circle: FittedFeature) -> bool:
    """Whether points scatter over a circle's plane by more than noise and a section's height do.

    Noise is much the same in all directions, so that their variances have Fisher's distribution.
    """
    from scipy.special import fdtri

    in_plane, over = float(circle.scatter[0]), float(circle.scatter[2])
    size, free = 2.0 * (circle.radius or 0.0), circle.deviation.size - LEAST_POINTS["circle"]
    if free < 1 or over <= FLAT * size:
        return False
    return over > min(PLANE_NOISE * sqrt(fdtri(free, free, SURE)) * in_plane, MOST_FORM * size)


def _remarks(points: Array, fitted: FittedFeature, repeated: int) -> tuple[Message, ...]:
    """What was done with points that were ``repeated``, and what nobody can see in those of an arc."""
    remarks = []
    if repeated:
        text = f"found {repeated} points that were there before, and counted each place once: they are no new readings"
        remarks.append(Message("points_repeated", text))
    leverage = lobe_leverage(points, fitted)
    if leverage <= MOST_LEVERAGE:
        return tuple(remarks)
    text = (
        f"only a part of the circumference was measured: a form of {FEW_LOBES[0]} to {FEW_LOBES[-1]} lobes, which that "
        f"part may not show, moves the centre by up to {leverage:.2g} times its amplitude; U holds what shows"
    )
    return (*remarks, Message("part_of_circumference", text))
