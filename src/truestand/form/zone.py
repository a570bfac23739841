"""Minimum zone, minimum circumscribed and maximum inscribed features, with a certificate of optimality.

All three are one problem: move the feature until the largest distance of the points from it (circumscribed), the
smallest (inscribed) or the difference of both (zone) can't be bettered. It is solved by successive linear programs on
the points that matter, more of which are added until no other point is violated, and sharpened by Newton's method on
the conditions of Karush, Kuhn and Tucker. These are the certificate: the contacts hold the feature in balance, their
forces positive. For the circumscribed circle and sphere that proves the optimum; for the others, that no small move
betters it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.errors import NotEnoughData

Kind = Literal["MZC", "MCC", "MIC"]
Distance = Callable[[Array, Ints], tuple[Array, Array]]
"""Parameters (m,) and which points: distances (k,) mm from the feature's axis, centre or surface, slopes (k, m)."""

MOST_WORKING_SETS = 60
MOST_PROGRAMS = 200
POINTS_ADDED = 24
"""Violated points that join the working points at once, on each side."""
BORDER_TOLERANCE = 1e-13
"""Relative to the feature's size: a point by less than this out of the zone lies on its border."""
MOST_MOVE = 0.5
"""Share of the size by which the feature may move from the least-squares one: further, the points don't hold it."""
CURVATURE_STEP = 1e-6
"""Share of the size by which the feature is moved for its second derivatives."""


@dataclass(frozen=True, slots=True)
class Zone:
    """The optimal feature and the contacts that prove it."""

    parameters: Array
    outer: float
    """mm: largest distance of a point from it."""
    inner: float
    """mm: smallest."""
    contacts: Ints
    """Points that hold it."""
    outside: Mask
    """Which of them touch from the outer side."""
    forces: Array
    """Multipliers of the contacts: positive, their sum 1 on each side that counts."""
    imbalance: float
    """Largest component of the unbalanced force: 0 at an optimum."""
    sensitivity: Array
    """(m + 2, contacts): how parameters, outer and inner distance follow the noise of the contacts."""
    scope: Literal["global", "local"]
    """Proven against every other place, or against every small move."""


def zone(distance: Distance, count: int, start: Array, kind: Kind, size: float) -> Zone:
    """The minimum zone (MZC), circumscribed (MCC) or inscribed (MIC) feature of ``count`` points, from ``start`` (m,).

    ``size``: mm, of the feature.

    Raises:
        NotEnoughData: the points don't hold the feature, as on less than half the circumference for MIC.
    """
    everything = np.arange(count)
    d, slopes = distance(start, everything)
    middle, effect = float(d.mean()), np.maximum(np.abs(slopes).max(axis=0), 1e-12)
    q, working = start.copy(), _extremes(d)
    for _ in range(MOST_WORKING_SETS):
        problem = _Problem(distance, working, kind, start, middle, size, effect)
        q = problem.solve(q)
        d, _ = distance(q, everything)
        missed = _violators(d, working, kind, BORDER_TOLERANCE * size)
        if not missed.size:
            break
        working = np.union1d(working, missed)
    return problem.certified(q, float(d.max()), float(d.min()))


def _extremes(d: Array) -> Ints:
    """The outermost and innermost points of some stretches of the data, and of all."""
    stretches = np.array_split(np.arange(d.size), min(48, max(d.size // 4, 1)))
    picked = [s[[int(np.argmax(d[s])), int(np.argmin(d[s]))]] for s in stretches]
    order = np.argsort(d)
    return np.unique(np.concatenate([*picked, order[:16], order[-16:]]))


def _violators(d: Array, working: Ints, kind: Kind, tolerance: float) -> Ints:
    """Points out of the working points' zone, the worst first."""
    high, low = float(d[working].max()), float(d[working].min())
    worst: list[Ints] = []
    if kind != "MIC":
        out = np.flatnonzero(d > high + tolerance)
        worst.append(out[np.argsort(d[out])[::-1][:POINTS_ADDED]])
    if kind != "MCC":
        out = np.flatnonzero(d < low - tolerance)
        worst.append(out[np.argsort(d[out])[:POINTS_ADDED]])
    return np.concatenate(worst)


@dataclass(frozen=True, slots=True)
class _Problem:
    """The optimisation over the working points."""

    distance: Distance
    working: Ints
    kind: Kind
    start: Array
    middle: float
    """mm: the points' mean distance at the start."""
    size: float
    effect: Array
    """mm (m,) by which a parameter moves the distances at most, for each of its units."""

    def objective(self, d: Array) -> float:
        """The objective."""
        outer, inner = float(d.max()), float(d.min())
        return {"MZC": outer - inner, "MCC": outer, "MIC": -inner}[self.kind]

    def solve(self, q: Array) -> Array:
        """Successive linear programs within a region of trust, then Newton's method on the contacts."""
        d, slopes = self.distance(q, self.working)
        unit = self._unit(d)
        trust = 1.0
        for _ in range(MOST_PROGRAMS):
            move, predicted, _ = _linear_program((d - self.middle) / unit, slopes / self.effect, self.kind, trust)
            tried = q + move * unit / self.effect
            if np.abs((tried - self.start) * self.effect).max() > MOST_MOVE * self.size:
                raise NotEnoughData(
                    f"found points that don't hold a {self.kind} feature, need them all round; measure more or use LSC"
                )
            d_new, slopes_new = self.distance(tried, self.working)
            gained = (self.objective(d) - self.objective(d_new)) / unit
            if gained > 0:
                q, d, slopes = tried, d_new, slopes_new
            trust = trust * 2.0 if gained > 0.5 * predicted else trust * 0.25
            if predicted < 1e-9 or trust < 1e-12:
                break
        sharp = self._sharpened(q)
        return (
            sharp
            if self.objective(self.distance(sharp, self.working)[0]) <= self.objective(d) + BORDER_TOLERANCE * self.size
            else q
        )

    def _unit(self, d: Array) -> float:
        """mm in which the programs are well scaled."""
        return max(float(np.ptp(d)), 1e-15 * self.size)

    def _contacts(self, q: Array) -> tuple[Ints, Mask, Array]:
        """Which points hold the feature, on which side, with which force: the program's multipliers without a move."""
        d, slopes = self.distance(q, self.working)
        unit = self._unit(d)
        _, _, forces = _linear_program((d - self.middle) / unit, slopes / self.effect, self.kind, 1e-4)
        n = self.working.size
        holding = np.flatnonzero(forces > 1e-6)
        return self.working[holding % n], holding < n, forces[holding]

    def _sharpened(self, q: Array) -> Array:
        """Newton's method on balance and contact of the points that hold the feature."""
        contacts, outside, forces = self._contacts(q)
        if not contacts.size:
            return q
        for _ in range(12):
            matrix, right = self._conditions(q, contacts, outside, forces)
            step = np.linalg.lstsq(matrix, -right, rcond=1e-12)[0]
            q = q + step[: q.size]
            forces = forces + step[q.size + 2 :]
            if np.abs(step[: q.size]).max() < 1e-15 * self.size:
                break
        return q

    def _conditions(self, q: Array, contacts: Ints, outside: Mask, forces: Array) -> tuple[Array, Array]:
        """The conditions' matrix and their residuals: balance, sums of forces, contact.

        Unknowns: parameters (m), outer and inner distance (2), forces (k).
        """
        m, k = q.size, contacts.size
        sign = np.where(outside, 1.0, -1.0)
        d, slopes = self.distance(q, contacts)
        signed_forces = sign * forces
        matrix = np.zeros((m + 2 + k, m + 2 + k))
        matrix[:m, :m] = self._curvature(q, contacts, signed_forces)
        matrix[:m, m + 2 :] = (sign[:, None] * slopes).T
        matrix[m, m + 2 :], matrix[m + 1, m + 2 :] = outside, ~outside
        matrix[m + 2 :, :m] = slopes
        matrix[m + 2 :, m], matrix[m + 2 :, m + 1] = -1.0 * outside, -1.0 * ~outside
        outer = float(d[outside].mean()) if outside.any() else 0.0
        inner = float(d[~outside].mean()) if not outside.all() else 0.0
        sums = [float(forces[outside].sum()) - outside.any(), float(forces[~outside].sum()) - (not outside.all())]
        right = np.concatenate([slopes.T @ signed_forces, sums, d - np.where(outside, outer, inner)])
        return matrix, right

    def _curvature(self, q: Array, contacts: Ints, signed_forces: Array) -> Array:
        """Second derivative (m, m) of the contacts' balance, by differences of the slopes."""
        curvature = np.empty((q.size, q.size))
        for j, step in enumerate(CURVATURE_STEP * self.size / self.effect):
            h = step * np.eye(q.size)[j]
            after, before = (self.distance(q + sign * h, contacts)[1].T @ signed_forces for sign in (1.0, -1.0))
            curvature[:, j] = (after - before) / (2 * step)
        return (curvature + curvature.T) / 2

    def certified(self, q: Array, outer: float, inner: float) -> Zone:
        """The solution with its certificate."""
        contacts, outside, forces = self._contacts(q)
        _, slopes = self.distance(q, contacts)
        sign = np.where(outside, 1.0, -1.0)
        imbalance = float(np.abs((slopes / self.effect).T @ (sign * forces)).max(initial=0.0))
        matrix, _ = self._conditions(q, contacts, outside, forces)
        response = np.linalg.pinv(-matrix, rcond=1e-12)[: q.size + 2, q.size + 2 :]
        scope: Literal["global", "local"] = "global" if self.kind == "MCC" and q.size <= 3 else "local"
        return Zone(
            q, outer, inner, contacts, outside, forces, imbalance, np.asarray(response, dtype=np.float64), scope
        )


def _linear_program(d: Array, slopes: Array, kind: Kind, trust: float) -> tuple[Array, float, Array]:
    """The linear program about the present place: best move (m,), predicted gain, forces (2n,) outer then inner."""
    from scipy.optimize import linprog

    n, m = slopes.shape
    outer_counts, inner_counts = kind != "MIC", kind != "MCC"
    cost = np.concatenate([np.zeros(m), [1.0 * outer_counts, -1.0 * inner_counts]])
    one, zero = np.ones((n, 1)), np.zeros((n, 1))
    rows = {"MZC": slice(0, 2 * n), "MCC": slice(0, n), "MIC": slice(n, 2 * n)}[kind]
    matrix = np.vstack([np.hstack([slopes, -one, zero]), np.hstack([-slopes, zero, one])])[rows]
    radii = [(None, None) if counts else (0.0, 0.0) for counts in (outer_counts, inner_counts)]
    optimum = linprog(
        cost, matrix, np.concatenate([-d, d])[rows], bounds=[(-trust, trust)] * m + radii, method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )  # fmt: skip
    present = (d.max() if outer_counts else 0.0) - (d.min() if inner_counts else 0.0)
    forces = np.zeros(2 * n)
    if optimum.x is None:
        return np.zeros(m), 0.0, forces
    forces[rows] = -np.asarray(optimum.ineqlin.marginals)
    return np.asarray(optimum.x[:m]), float(present - optimum.fun), forces
