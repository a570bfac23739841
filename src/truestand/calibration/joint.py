"""Fits of one shaft from several views, put together as one fit.

Each view's own fit stands in a frame of its own, T_v, whose X points at its sensor. T, the frame of all, is the first
view's; another one stands at azimuth A and height h in it:

    p_T = Rz(A) p_Tv + (0, 0, h)

With one zero of the table's angle the same holds in R. So of the shaft's axis E + T z (complex, over the height z) and
a wave of form w of n undulations (cosine + i sine) a view finds

    T_v = exp(-iA) T,    E_v = exp(-iA) (E + h T),    w_v = exp(-inA) w.

The views share the shaft; each has a pose, drift, speed and static profile of its own. Their costs, quadratic about
their own estimates, are added, so that what they share counts once.

A sensor that is not linear stretches what it sees of an eccentric shaft's travel, otherwise on each cylinder: views of
one shaft differ by that, which is no evidence of where it runs.
"""

from dataclasses import dataclass, replace
from math import hypot, pi, sqrt

import numpy as np

from truestand.calibration.estimate import Quadratic, solve
from truestand.calibration.model import FIXED_U, STRETCH, Prior, precision_of, stretches
from truestand.calibration.refine import Refined
from truestand.calibration.result import height_zero_u
from truestand.core.arrays import Array, Ints
from truestand.core.assumptions import K
from truestand.core.frames import ECCENTRICITY_X, ECCENTRICITY_Y, PHI, TILT_X, TILT_Y
from truestand.core.stand import Sensor

TRIED = 3600
"""Azimuths at which two views' shafts are laid over each other."""
LIKE_MM = 0.003
"""By which two views may see the same shaft otherwise, each by itself: offset and tilt of their planes lie in it."""
LEVER_MM = 30.0
"""Along the shaft, over which its slope counts like its offset."""
MOST_ALIKE = 16.0
"""By how much another azimuth may fit worse (chi-square) and still be the right one."""
NOT_KNOWN_U = pi / sqrt(3.0)
"""rad: standard uncertainty of an azimuth of which nothing is known."""
AZIMUTH, HEIGHT = "azimuth of the view", "height between views"
SETTLED = 1e-9
"""mm or rad."""
MOST_STEPS = 30

Key = tuple[str, int, int]
"""What a pair of unknowns of the shaft is: offset, slope or form; cylinder of the drawing; undulations."""
Pair = tuple[int, int]
"""Where it stands in a parameter vector."""


@dataclass(frozen=True, slots=True)
class Link:
    """A pair of a view's unknowns, as a complex number, that follows from one of all."""

    own: Pair
    shared: Pair
    undulations: int = 1
    lever: float | None = None
    """mm: an offset that follows from the slope, by the height and so much more; None: it follows from its like."""

    def factor(self, azimuth: float, height: float) -> tuple[complex, complex, complex]:
        """What it is multiplied with at an azimuth and a height, and the slopes of that over both."""
        turn = complex(np.exp(-1j * self.undulations * azimuth))
        if self.lever is None:
            return turn, -1j * self.undulations * turn, 0.0
        return turn * (height + self.lever), -1j * turn * (height + self.lever), turn


@dataclass(frozen=True, slots=True)
class Stretch:
    """By how much, relative, a sensor stretches the shaft's travel, or (1/mm) how that changes along the shaft."""

    own: Pair
    """The offset or slope of a view's that grows with it,"""
    shared: Pair
    """the base's offset of all,"""
    at: int
    """and where it stands among the unknowns of all."""
    u: float
    """Standard uncertainty beforehand."""


@dataclass(frozen=True, slots=True)
class View:
    """A view's fit, and how its unknowns follow from all."""

    fit: Refined
    private: Ints
    """Of its unknowns, those that no other view has,"""
    places: Ints
    """and where they stand among all."""
    links: tuple[Link, ...]
    stretches: tuple[Stretch, ...]
    pose: Pair | None
    """Where azimuth and height stand among all; None: the first view."""

    def seen(self, q: Array) -> tuple[Array, Array]:
        """As ``own``, but as its sensor sees the shaft: its travel stretched."""
        p, jacobian = self.own(q)
        azimuth, _ = self.place(q)
        turn = complex(np.exp(-1j * azimuth))
        for stretch in self.stretches:
            own, shared = list(stretch.own), list(stretch.shared)
            travel, by = turn * complex(*q[shared]), float(q[stretch.at])
            p[own] += _pair(by * travel)
            jacobian[np.ix_(own, shared)] += np.column_stack([_pair(by * turn), _pair(1j * by * turn)])
            jacobian[own, stretch.at] += _pair(travel)
            if self.pose is not None:
                jacobian[own, self.pose[0]] += _pair(-1j * by * travel)
        return p, jacobian

    def own(self, q: Array) -> tuple[Array, Array]:
        """Its unknowns (p,) from all ``q`` (n,), and their Jacobian (p, n)."""
        p, jacobian = np.zeros(self.fit.model.size), np.zeros((self.fit.model.size, q.size))
        p[self.private] = q[self.places]
        jacobian[self.private, self.places] = 1.0
        azimuth, height = self.place(q)
        for link in self.links:
            own, shared = list(link.own), list(link.shared)
            value = complex(*q[shared])
            factor, *slopes = link.factor(azimuth, height)
            p[own] += _pair(factor * value)
            jacobian[np.ix_(own, shared)] += np.column_stack([_pair(factor), _pair(1j * factor)])
            for at, slope in zip(self.pose or (), slopes, strict=False):
                jacobian[own, at] += _pair(slope * value)
        return p, jacobian

    @property
    def likes(self) -> list[Link]:
        """Those links by which a pair follows from its like."""
        return [link for link in self.links if link.lever is None]

    def place(self, q: Array) -> tuple[float, float]:
        """Its azimuth (rad) and height (mm) in the first view's frame."""
        return (0.0, 0.0) if self.pose is None else (float(q[self.pose[0]]), float(q[self.pose[1]]))


@dataclass(frozen=True, slots=True)
class Joint:
    """All views' unknowns together, (n,)."""

    views: tuple[View, ...]
    solution: Quadratic
    score_covariance: Array
    """(n, n): of the data's score."""
    priors: tuple[Prior, ...]

    @property
    def parameters(self) -> Array:
        """(n,)."""
        return self.solution.parameters

    def about(self, q: Array) -> "Joint":
        """With the parameters ``q`` (n,), and each view's cost about what it sees of them."""
        views = tuple(replace(view, fit=view.fit.about(view.seen(q)[0])) for view in self.views)
        data, scores = _data(views, q)
        return replace(self, views=views, solution=data, score_covariance=scores)

    def followers(self, view: View) -> Array:
        """How all unknowns follow a view's own estimate: (n, p)."""
        normal = self.solution.information + np.diag(precision_of(self.priors, self.parameters.size))
        _, jacobian = view.seen(self.parameters)
        return solve(normal, jacobian.T @ view.fit.solution.information)


def together(fits: tuple[Refined, ...], sensors: tuple[Sensor, ...]) -> Joint:
    """The views' fits as one: Gauss-Newton over all unknowns. ``sensors``: of each view."""
    views, size = _laid_out(fits, sensors)
    priors = _priors(views)
    precision = precision_of(priors, size)
    q = _start(views, size)
    for _ in range(MOST_STEPS):
        data, scores = _data(views, q)
        step = -solve(data.information + np.diag(precision), data.gradient + precision * q)
        q = q + step
        if np.abs(step).max() < SETTLED:
            break
    return Joint(views, data.moved(q), scores, priors)


def azimuths_alike(first: Refined, other: Refined) -> bool:
    """Whether another azimuth of a view than the best one fits about as well: the shaft is centred, or looks alike from
    several sides.
    """
    misfit = _misfit(first, other)
    valley = (misfit <= np.roll(misfit, 1)) & (misfit < np.roll(misfit, -1))
    lowest = np.sort(misfit[valley])
    flat = float(np.ptp(misfit)) < MOST_ALIKE
    return flat or bool(lowest.size > 1 and lowest[1] - lowest[0] < MOST_ALIKE)


def _pair(z: complex) -> Array:
    return np.array([z.real, z.imag])


def _data(views: tuple[View, ...], q: Array) -> tuple[Quadratic, Array]:
    """The cost of all data about ``q`` (n,), and the covariance of its score (n, n)."""
    information, scores = np.zeros((2, q.size, q.size))
    gradient = np.zeros(q.size)
    for view in views:
        p, jacobian = view.seen(q)
        data = view.fit.solution
        information += jacobian.T @ data.information @ jacobian
        gradient += jacobian.T @ data.moved(p).gradient
        scores += jacobian.T @ view.fit.score_covariance @ jacobian
    return Quadratic(q, gradient, information), scores


def _laid_out(fits: tuple[Refined, ...], sensors: tuple[Sensor, ...]) -> tuple[tuple[View, ...], int]:
    """The views with the places of their unknowns among all, and how many these are.

    The first view's stand first, as they are; then of each further one its own, what it sees of the shaft that no view
    before it did, and its place.
    """
    seen: dict[Key, Pair] = {}
    middles: dict[int, float] = {}
    views, size = [], 0
    for number, (fit, sensor) in enumerate(zip(fits, sensors, strict=True)):
        pairs = _shaft_pairs(fit)
        shared = {i for pair in pairs.values() for i in pair}
        private = np.array([i for i in range(fit.model.size) if i not in shared], dtype=np.intp)
        places = private if not number else size + np.arange(private.size)
        size = fit.model.size if not number else size + private.size
        for key, pair in pairs.items():
            if key not in seen:
                seen[key] = pair if not number else (size, size + 1)
                size += 2 if number else 0
        for band, middle in zip(fit.segments.bands, fit.model.middles, strict=True):
            middles.setdefault(band.cylinder, middle)
        pose = (size, size + 1) if number else None
        size += 2 if number else 0
        stretches = _stretches(fit, pairs, seen, sensor, size)
        size += len(stretches)
        views.append(View(fit, private, places, _links(fit, pairs, seen, middles), stretches, pose))
    return tuple(views), size


def _shaft_pairs(fit: Refined) -> dict[Key, Pair]:
    """Where a view's unknowns of the shaft stand."""
    pairs: dict[Key, Pair] = {}
    for k, band in enumerate(fit.segments.bands):
        start = fit.model.axis_slice(k).start
        axis = (start, start + 1, start + 2, start + 3) if k else (ECCENTRICITY_X, ECCENTRICITY_Y, TILT_X, TILT_Y)
        pairs["offset", band.cylinder, 1], pairs["slope", band.cylinder, 1] = axis[:2], axis[2:]
        first, terms = fit.model.form_slice(k).start, max(fit.model.orders - 1, 0)
        pairs |= {("form", band.cylinder, n + 2): (first + n, first + terms + n) for n in range(terms)}
    return pairs


def _links(fit: Refined, pairs: dict[Key, Pair], seen: dict[Key, Pair], middles: dict[int, float]) -> tuple[Link, ...]:
    """How a view's unknowns of the shaft follow from those of all: the base's axis counts at height 0, others' at
    their middles, against the base's.
    """
    links = []
    for (name, cylinder, undulations), own in pairs.items():
        links.append(Link(own, seen[name, cylinder, undulations], undulations))
        if name == "offset":
            k = [b.cylinder for b in fit.segments.bands].index(cylinder)
            lever = fit.model.middles[k] - middles[cylinder] if k else 0.0
            links.append(Link(own, seen["slope", cylinder, 1], lever=lever))
    return tuple(links)


def _stretches(
    fit: Refined, pairs: dict[Key, Pair], seen: dict[Key, Pair], sensor: Sensor, first: int
) -> tuple[Stretch, ...]:
    """How a ``sensor`` stretches what it sees of the base; they stand from ``first`` on. What it does to further
    cylinders against that, each view's fit knows.
    """
    base = fit.segments.bands[0].cylinder
    shared = seen["offset", base, 1]
    by = stretches(sensor, float(fit.solution.parameters[PHI]))
    return tuple(
        Stretch(pairs[name, base, 1], shared, first + n, max(sensor.linearity / K * by[n], FIXED_U))
        for n, name in enumerate(("offset", "slope"))
    )


def _priors(views: tuple[View, ...]) -> tuple[Prior, ...]:
    """What is known beforehand: of the shaft once, of each view's own, and nothing of where it stands but that its
    height 0 is the shoulder, too.
    """
    found: dict[tuple[str, tuple[int, ...]], Prior] = {}
    for view in views:
        place = dict(zip(view.private.tolist(), view.places.tolist(), strict=True))
        for link in view.likes:
            place |= dict(zip(link.own, link.shared, strict=True))
        for prior in view.fit.priors:
            index = tuple(place[i] for i in prior.index)
            found.setdefault((prior.name, index), replace(prior, index=index))
        for stretch in view.stretches:
            found[STRETCH, (stretch.at,)] = Prior(STRETCH, (stretch.at,), stretch.u)
    shoulder = [height_zero_u(view.fit) for view in views]
    for view, u in zip(views, shoulder, strict=True):
        if view.pose is not None:
            azimuth, height = view.pose
            found[AZIMUTH, (azimuth,)] = Prior(AZIMUTH, (azimuth,), NOT_KNOWN_U)
            found[HEIGHT, (height,)] = Prior(HEIGHT, (height,), hypot(shoulder[0], u))
    return tuple(found.values())


def _start(views: tuple[View, ...], size: int) -> Array:
    """All unknowns (n,) from which the fit starts: the shaft as the first view that sees it has it."""
    q, known = np.zeros(size), np.zeros(size, dtype=np.bool_)
    for view in views:
        p, azimuth = view.fit.solution.parameters, 0.0
        q[view.places] = p[view.private]
        if view.pose is not None:
            azimuth = q[view.pose[0]] = _rough_azimuth(views[0].fit, view.fit)
        for link in view.likes:
            own, shared = list(link.own), list(link.shared)
            if not known[shared].any():
                back, *_ = link.factor(-azimuth, 0.0)
                q[shared], known[shared] = _pair(complex(*p[own]) * back), True
    return q


def _rough_azimuth(first: Refined, other: Refined) -> float:
    """Azimuth (rad) at which the shaft that a view sees lies best over that of the first view."""
    return float(_azimuths()[np.argmin(_misfit(first, other))])


def _azimuths() -> Array:
    return np.linspace(-pi, pi, TRIED, endpoint=False)


def _misfit(first: Refined, other: Refined) -> Array:
    """How badly (chi-square) the shafts of two views lie over each other at each azimuth that is tried."""
    ours, theirs = _shaft_pairs(first), _shaft_pairs(other)
    misfit = np.zeros(TRIED)
    for key in ours.keys() & theirs.keys():
        name, cylinder, undulations = key
        if name == "form" or cylinder == first.segments.bands[0].cylinder:
            scale = LEVER_MM if name == "slope" else 1.0
            a, b = (complex(*f.solution.parameters[list(at[key])]) for f, at in ((first, ours), (other, theirs)))
            misfit += np.square(np.abs(a * np.exp(-1j * undulations * _azimuths()) - b) * scale / LIKE_MM)
    return misfit
