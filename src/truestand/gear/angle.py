"""The table's angle without an encoder, corrected by what several turns say about it.

Each flank passes the laser plane once a turn. If the table turns unevenly, it passes at another angle each time; these
differences show the error of the angle over time, all of it that doesn't repeat every turn. What does repeat looks
exactly like pitch deviations: it needs an encoder, a table of its errors, or the part clamped again, and stays in U.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask
from truestand.core.calibration import Calibration
from truestand.core.robust import medians, robust_sd
from truestand.core.surface import apply_calibration, table_angle
from truestand.gear.flanks import Flanks, Toothing, find_toothing
from truestand.gear.geometry import SIGMA
from truestand.gear.grid import MEDIAN_SPAN, bin_index
from truestand.gear.views import MOST_LEFT, GearView

CLIP = 3.5
"""Robust standard deviations about the median of its pass within which a point is no outlier."""
LEAST_TURNS = 1.99
"""Fewer leave most of the flanks with one pass."""
WHOLE_PASS = 0.7
"""Share of the usual number of points that a flank's pass must have: at the scan's ends some are cut off."""
CUT_OFF, LEAST_AGAIN = 2.0, 0.5
"""Flanks that a scan's ends may cut off; share of the others that must be found again a turn later."""
KNOTS_PER_TOOTH = 1.0
SMOOTHING = 0.1
"""Weight of the change from knot to knot against the passes: without it, um of misfit turn into mm where the passes
leave the curve open."""
ROUNDS = 3
LARGEST_SHARE_LEFT = 0.5
"""Share of the disagreement that a correction may leave for it to be taken."""
MOST_WAVES = 6
FREQUENCY_STEP = 0.02
"""Waves a turn between the frequencies that are tried."""
HIGHEST_FREQUENCY = 0.9
"""Waves a tooth up to which frequencies are looked for."""
SEPARABLE = 0.1
"""Mean square of a wave about the means of its flanks from which it can be told from pitch: near whole numbers it
can't."""
WORTH = 0.6
"""Share of the squares that one more wave must leave at most,"""
EXPLAINED = 0.03
"""and all of them together."""
ROLL_BINS = 40
"""Stretches of roll length in which passes are compared."""
SHAPE_ROUNDS = 3
"""Rounds in which the positions of the passes and the shapes of the flanks are separated."""
NOTICEABLE = 5e-4
"""mm: passes that agree this well need no correction."""


def with_correct_angles(views: tuple[GearView, ...]) -> tuple[GearView, ...]:
    """The views, each with a corrected table angle where the passes of its flanks agree better with it."""
    corrected = tuple(correct_angle(view) for view in views)
    if len(views) == 1 or all(new.surface is old.surface for new, old in zip(corrected, views, strict=True)):
        return corrected
    old = views[0].flanks.toothing  # one for all again
    toothing = find_toothing([view.surface for view in corrected], old.nominal, old.datum)
    return tuple(view.rolled_up(view.surface, toothing) for view in corrected)


def correct_angle(view: GearView) -> GearView:
    """The same with a corrected table angle, as long as the passes of the flanks agree better with it."""
    if not view.flanks.delta.size:
        return view
    scan, passes = view.scan, _passes(view)
    best = replace(view, unrepeated=passes.unrepeated)
    if not passes.repeated:
        return best
    if not scan.free_speed:
        return replace(best, apart_rms=passes.rms)
    best = replace(best, before_rms=passes.rms, after_rms=passes.rms)
    for _ in range(ROUNDS if scan.revolutions >= LEAST_TURNS else 0):
        if passes.rms < NOTICEABLE:
            break
        frequencies = _frequencies(passes)
        corrected = _rolled_up(best, _angle_error(passes, frequencies, scan.profiles, view.flanks.toothing))
        again = _passes(corrected)
        if not again.repeated or again.rms > LARGEST_SHARE_LEFT * passes.rms:
            break
        explained = best.explained and (frequencies is not None or passes.rms < MOST_LEFT)
        passes, best = again, replace(corrected, after_rms=again.rms, explained=explained)
    return best


def _rolled_up(best: GearView, error: Array) -> GearView:
    """The scan rolled up with ``error`` (profiles,) rad added to its table angle, its mean left out."""
    toothing = best.flanks.toothing
    angle = table_angle(best.scan, best.calibration)
    scan = replace(best.scan, angle=angle + best.calibration.sense * (error - error.mean()))
    calibration = replace(best.calibration, speed_factor=1.0)
    surface = apply_calibration(scan, calibration)
    return best.rolled_up(surface, find_toothing(surface, toothing.nominal, toothing.datum))


def _lever_arms(calibration: Calibration, toothing: Toothing) -> Array:
    """Arm (2 teeth,) mm with which each flank moves along the base tangent with the table's angle: the base radius on
    the gear's own axis, more or less of it where the table turns about another one.
    """
    nominal = toothing.nominal
    axis = toothing.datum.pose(calibration.shaft_from_rotor(np.array([[0.0, 0.0, nominal.middle]])))[0]
    radius = nominal.measuring_radius
    alpha = np.arccos(nominal.base_radius / radius)
    tooth = toothing.first_tooth + np.arange(nominal.gear.teeth) * nominal.gear.pitch
    arms = []
    for sigma in SIGMA:
        normal = tooth + sigma * float(nominal.half_angle(np.asarray(radius))) + sigma * (np.pi / 2 - alpha)
        arms.append(nominal.base_radius - sigma * (axis[0] * np.sin(normal) - axis[1] * np.cos(normal)))
    return np.concatenate(arms)


def _passes(rolled: GearView) -> "_Passes":
    """Every pass of every flank."""
    flanks, scan, toothing = rolled.flanks, rolled.scan, rolled.flanks.toothing
    teeth = toothing.nominal.gear.teeth
    around = toothing.first_tooth + (flanks.flank % teeth) * toothing.nominal.gear.pitch
    turn = np.rint((rolled.angle[flanks.profile] + around) / (2 * np.pi)).astype(np.int64)
    turn -= turn.min()
    turns = int(turn.max()) + 1
    key = flanks.flank.astype(np.int64) * turns + turn
    size = 2 * teeth * turns
    inliers = _inliers(flanks, key, size)
    flanks, key = flanks.select(inliers), key[inliers]
    delta = SIGMA[np.where(flanks.flank < teeth, 0, 1)] * _without_shape(flanks, key, size)
    count = np.bincount(key, minlength=size)
    position, time = (np.bincount(key, v, minlength=size) / np.maximum(count, 1) for v in (delta, flanks.profile))
    usual = np.median(count[count > 0])
    whole = np.flatnonzero(count > WHOLE_PASS * usual)
    flank = whole // turns
    at = time[whole] / scan.profiles * scan.revolutions
    arm = _lever_arms(rolled.calibration, toothing)[flank] / toothing.nominal.base_radius
    return _Passes(flank, at, position[whole], arm, scan.revolutions, teeth)


def _inliers(flanks: Flanks, key: NDArray[np.int64], passes: int) -> Mask:
    """Which points lie on the shape of their pass: outliers are few in the gate but far off."""
    cell = key * ROLL_BINS + _roll_bin(flanks)
    median, _ = medians(cell, flanks.delta, passes * ROLL_BINS, MEDIAN_SPAN)
    off = np.abs(flanks.delta - median[cell])
    return np.asarray(off <= CLIP * robust_sd(off))


def _roll_bin(flanks: Flanks) -> NDArray[np.int64]:
    nominal = flanks.toothing.nominal
    return bin_index(flanks.roll, nominal.control_roll, nominal.tip_roll, ROLL_BINS)


def _without_shape(flanks: Flanks, key: NDArray[np.int64], passes: int) -> Array:
    """delta without its flank's shape over the roll length: passes that see other parts of a flank compare as well."""
    cell = flanks.flank.astype(np.int64) * ROLL_BINS + _roll_bin(flanks)
    cells = 2 * flanks.toothing.nominal.gear.teeth * ROLL_BINS
    count, number = np.maximum(np.bincount(key, minlength=passes), 1), np.maximum(np.bincount(cell, minlength=cells), 1)
    shape = np.zeros(cells)
    for _ in range(SHAPE_ROUNDS):
        position = np.bincount(key, flanks.delta - shape[cell], minlength=passes) / count
        shape = np.bincount(cell, flanks.delta - position[key], minlength=cells) / number
    return np.asarray(flanks.delta - shape[cell])


def _angle_error(p: "_Passes", frequencies: list[float] | None, profiles: int, toothing: Toothing) -> Array:
    """By how much (rad, (profiles,)) the part stood farther round, ccw in C, than its table angle said.

    The passes of a flank only show it up to what repeats every turn. So it is looked for among what few numbers
    describe: a drift, and steady waves at no whole number a turn (a belt, a gearbox). Only where they don't explain it,
    it is the curve that changes least.
    """
    turns, base_radius = np.arange(profiles) / profiles * p.turns, toothing.nominal.base_radius
    if frequencies is None:
        return np.asarray(np.interp(turns, *_smoothest(p)) / base_radius)
    share = np.linalg.lstsq(p.about_means(p.design(frequencies)), p.about_means(p.position), rcond=None)[0]
    return np.asarray(_drift_and_waves(turns, frequencies, p.turns) @ share / base_radius)


@dataclass(frozen=True, slots=True)
class _Passes:
    """The passes of the flanks, (n,)."""

    flank: NDArray[np.int64]
    """side * teeth + tooth."""
    at: Array
    """When it passed, in turns."""
    position: Array
    """sigma delta along the base circle, mm."""
    arm: Array
    """By how much the position goes with the table's angle, over the base radius."""
    turns: float
    teeth: int

    @property
    def repeated(self) -> int:
        """How many passes are not the first of their flank."""
        return int(self.flank.size - np.unique(self.flank).size)

    @property
    def unrepeated(self) -> bool:
        """Whether fewer flanks than the turns tell were found again where they passed before: the others are farther
        from there than a flank is looked for.
        """
        again = np.unique(self.flank).size * min(self.turns - 1.0, 1.0) - CUT_OFF
        return again >= CUT_OFF and self.repeated < LEAST_AGAIN * again

    @property
    def rms(self) -> float:
        """mm, about the mean of each flank, degrees of freedom counted."""
        return float(np.sqrt(np.square(self.about_means(self.position)).sum() / max(self.repeated, 1)))

    def about_means(self, values: Array) -> Array:
        """Values (n,) or (n, m) about the mean of their flank."""
        flat = values.reshape(values.shape[0], -1)
        number = np.maximum(np.bincount(self.flank), 1)
        mean = np.stack([np.bincount(self.flank, column) / number for column in flat.T], axis=1)
        return np.asarray((flat - mean[self.flank]).reshape(values.shape))

    def design(self, frequencies: list[float]) -> Array:
        """Effect of a drift and of waves on the positions, (n, m)."""
        return np.asarray(self.arm[:, None] * _drift_and_waves(self.at, frequencies, self.turns))

    def residual(self, frequencies: list[float]) -> Array:
        """What a drift and waves leave of the positions, (n,) mm."""
        a, b = self.about_means(self.design(frequencies)), self.about_means(self.position)
        return np.asarray(b - a @ np.linalg.lstsq(a, b, rcond=None)[0])

    def mean_square(self, frequencies: list[float]) -> float:
        """Of the residual, mm^2."""
        return float(np.square(self.residual(frequencies)).mean())


def _drift_and_waves(at: Array, frequencies: list[float], turns: float) -> Array:
    """A slow drift, and cos and sin of each frequency (waves a turn), (n, m); ``at`` in turns."""
    share = at / turns - 0.5
    waves = [f(2 * np.pi * frequency * at) for frequency in frequencies for f in (np.cos, np.sin)]
    return np.stack([share, share**2, share**3, *waves], axis=1)


def _frequencies(p: _Passes) -> list[float] | None:
    """Waves a turn that explain, with a drift, nearly all; None where no few of them do: half an explanation would
    change pitch by what it can't know.
    """
    total, frequencies = float(np.square(p.about_means(p.position)).mean()), list[float]()
    left = p.mean_square(frequencies)
    while left > max(EXPLAINED * total, NOTICEABLE**2):
        more = _one_more(p, frequencies) if len(frequencies) < MOST_WAVES else None
        if more is None or p.mean_square(more) > WORTH * left:
            return None
        frequencies, left = more, p.mean_square(more)
    return frequencies


def _one_more(p: _Passes, frequencies: list[float]) -> list[float] | None:
    """The frequencies (waves a turn), one more among them, each where it explains most; None where none can be told."""
    from scipy.optimize import minimize

    residual = p.residual(frequencies)
    tried = np.arange(1.0 / p.turns, HIGHEST_FREQUENCY * p.teeth, FREQUENCY_STEP)
    waves = p.arm[:, None] * np.exp(2j * np.pi * np.outer(p.at, tried))
    c, s = p.about_means(waves.real), p.about_means(waves.imag)
    cc, ss, cs = (c * c).sum(axis=0), (s * s).sum(axis=0), (c * s).sum(axis=0)
    cr, sr = residual @ c, residual @ s
    area = cc * ss - cs * cs
    separable = area > (SEPARABLE * p.at.size) ** 2
    if not separable.any():
        return None
    gain = np.where(separable, (ss * cr**2 - 2 * cs * cr * sr + cc * sr**2) / np.where(separable, area, 1.0), 0.0)
    start = [*frequencies, float(tried[np.argmax(gain)])]
    scale = max(p.mean_square(start), 1e-30)
    best = minimize(
        lambda found: p.mean_square(list(found)) / scale, start, method="Nelder-Mead",
        bounds=[(f - FREQUENCY_STEP, f + FREQUENCY_STEP) for f in start],
        options={"xatol": 1e-6, "fatol": 1e-6, "maxiter": 400},
    )  # fmt: skip
    return [float(f) for f in best.x]


def _smoothest(p: _Passes) -> tuple[Array, Array]:
    """The curve over the turns (knots and values, mm) that changes least from knot to knot, by least squares on the
    passes, each flank with a position of its own.
    """
    knots = max(8, round(KNOTS_PER_TOOTH * p.teeth * p.turns))
    x = p.at / p.turns * (knots - 1)
    left = np.clip(x.astype(np.intp), 0, knots - 2)
    rows = np.arange(p.flank.size)
    design = np.zeros((p.flank.size, knots))
    design[rows, left], design[rows, left + 1] = p.arm * (left + 1 - x), p.arm * (x - left)
    change = SMOOTHING * np.diff(np.eye(knots), axis=0)
    matrix = np.concatenate([p.about_means(design), change])
    wanted = np.concatenate([p.about_means(p.position), np.zeros(knots - 1)])
    return np.linspace(0.0, p.turns, knots), np.linalg.lstsq(matrix, wanted, rcond=None)[0]
