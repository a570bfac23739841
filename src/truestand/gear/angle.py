"""The table's angle without an encoder: what several turns say about it.

Each flank comes by once a turn. If the table turns unevenly, it comes by at another angle each time; these differences
tell the error of the angle over time, all of it that doesn't repeat every turn. What does repeat looks exactly like
pitch deviations: it needs an encoder, a table of its errors, or the part clamped again, and stays in the budget.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truestand.core.calibration import Calibration
from truestand.core.frames import Pose
from truestand.core.robust import medians, robust_sd
from truestand.core.scan import Scan
from truestand.core.surface import Surface, apply_calibration, table_angle
from truestand.gear.flanks import Flanks, find_flanks, only
from truestand.gear.geometry import SIGMA, Involute
from truestand.gear.grid import CLIP, SPAN

Array = NDArray[np.float64]

LEAST_TURNS = 1.99
"""Fewer leave most of the flanks with one pass."""
WHOLE = 0.7
"""Share of the usual number of points that a flank's pass must have: at the scan's ends some are cut off."""
KNOTS_PER_TOOTH = 1.0
SMOOTHING = 0.1
"""Weight of the change from knot to knot against the passes: without it, um of misfit turn into mm of what they leave
open."""
ROUNDS = 3
BETTER = 0.5
"""Share of their disagreement that a correction may leave for it to be one."""
MOST_LEFT = 2e-3
"""mm."""
MOST_LINES = 6
FINE_LINE = 0.02
"""Waves a turn between the lines that are tried."""
HIGHEST = 0.9
"""Waves a tooth up to which lines are looked for."""
TELLING = 0.1
"""Mean square of a wave about the means of its flanks from which it can be told from pitch: near whole numbers it
can't."""
WORTH = 0.6
"""Share of the squares that a line must leave at most,"""
NEARLY = 0.03
"""and all of them together."""
ROLLS = 40
"""Stretches of roll length in which passes are compared."""
SHAPED = 3
"""Rounds in which the places of the passes and the shapes of the flanks are told from each other."""
NOTICEABLE = 5e-4
"""mm: passes that agree this well need no correction."""


@dataclass(frozen=True, slots=True)
class Steadied:
    """A scan rolled up again with a table angle freed of what does not repeat every turn."""

    surface: Surface
    flanks: Flanks
    scan: Scan
    calibration: Calibration
    was: float | None = None
    """mm, rms: how far the passes of a flank were apart; None where the angle was measured or nothing came by twice."""
    left: float | None = None
    """The same afterwards."""
    explained: bool = True
    """Whether a drift and a few lines explained it: a curve only says what differs from turn to turn."""

    @property
    def uneven(self) -> bool:
        """Whether the passes still disagree by more than pitch may be wrong by without a word."""
        if self.was is None or self.left is None:
            return False
        return (self.left if self.explained else self.was) > MOST_LEFT


def steadied(
    surface: Surface, flanks: Flanks, scan: Scan, calibration: Calibration, nominal: Involute, datum: Pose
) -> Steadied:
    """The same with a corrected angle, as long as the passes of the flanks agree better for it."""
    now = Steadied(surface, flanks, scan, calibration)
    passes = _passes(now, nominal, datum) if scan.angle_source in ("index", "time") else None
    if passes is None:
        return now
    now = replace(now, was=passes.apart, left=passes.apart)
    for _ in range(ROUNDS if scan.revolutions >= LEAST_TURNS else 0):
        if passes.apart < NOTICEABLE:
            break
        lines = _lines(passes)
        better = _turned_on(now, _error(passes, lines, scan.profiles, nominal), nominal, datum)
        found = _passes(better, nominal, datum)
        if found is None or found.apart > BETTER * passes.apart:
            break
        explained = now.explained and (lines is not None or passes.apart < MOST_LEFT)
        passes, now = found, replace(better, left=found.apart, explained=explained)
    return now


def _turned_on(now: Steadied, error: Array, nominal: Involute, datum: Pose) -> Steadied:
    """The scan rolled up with ``error`` (profiles,) rad added to its table angle, its mean left out."""
    angle = table_angle(now.scan, now.calibration)
    scan = replace(now.scan, angle=angle + error - error.mean())
    calibration = replace(now.calibration, speed_factor=1.0)
    surface = apply_calibration(scan, calibration)
    return replace(
        now, surface=surface, flanks=find_flanks(surface, nominal, datum), scan=scan, calibration=calibration
    )


def _levers(calibration: Calibration, nominal: Involute, datum: Pose, turned: float) -> Array:
    """Arm (2 teeth,) mm with which each flank's place along the base tangent goes with the table's angle: the base
    radius on the gear's own axis, more or less of it where the table turns about another one.
    """
    axis = datum(calibration.shaft_from_rotor(np.array([[0.0, 0.0, nominal.middle]])))[0]
    arms = []
    for sigma in SIGMA:
        radius = nominal.measuring_radius
        alpha = np.arccos(nominal.base_radius / radius)
        tooth = turned + np.arange(nominal.gear.teeth) * nominal.gear.pitch
        normal = tooth + sigma * float(nominal.half_angle(np.asarray(radius))) + sigma * (np.pi / 2 - alpha)
        arms.append(nominal.base_radius - sigma * (axis[0] * np.sin(normal) - axis[1] * np.cos(normal)))
    return np.concatenate(arms)


def _passes(now: Steadied, nominal: Involute, datum: Pose) -> "_Passes | None":
    """Every pass of every flank; None where nothing came by twice."""
    flanks, scan, calibration = now.flanks, now.scan, now.calibration
    angle = table_angle(scan, calibration)
    teeth = nominal.gear.teeth
    around = flanks.turned + (flanks.which % teeth) * nominal.gear.pitch
    turn = np.rint((angle[flanks.profile] + around) / (2 * np.pi)).astype(np.int64)
    turn -= turn.min()
    turns = int(turn.max()) + 1
    key = flanks.which.astype(np.int64) * turns + turn
    size = 2 * teeth * turns
    kept = _agreeing(flanks, key, size, nominal)
    flanks, key = only(flanks, kept), key[kept]
    value = SIGMA[np.where(flanks.which < teeth, 0, 1)] * _freed(flanks, key, size, nominal)
    count = np.bincount(key, minlength=size)
    with np.errstate(invalid="ignore", divide="ignore"):
        place, time = (np.bincount(key, v, minlength=size) / count for v in (value, flanks.profile))
    usual = np.median(count[count > 0]) if (count > 0).any() else 0.0
    whole = np.flatnonzero(count > WHOLE * usual)
    which = whole // turns
    if np.unique(which).size == which.size:
        return None
    at = time[whole] / scan.profiles * scan.revolutions
    arm = _levers(calibration, nominal, datum, flanks.turned)[which] / nominal.base_radius
    return _Passes(which, at, place[whole], arm, scan.revolutions, teeth)


def _agreeing(flanks: Flanks, key: NDArray[np.int64], passes: int, nominal: Involute) -> NDArray[np.bool_]:
    """Which points lie on the shape of their pass: strays are few in the gate but far off."""
    place = key * ROLLS + _roll_bin(flanks, nominal)
    median, _ = medians(place, flanks.delta, passes * ROLLS, SPAN)
    off = np.abs(flanks.delta - median[place])
    return np.asarray(off <= CLIP * robust_sd(off))


def _roll_bin(flanks: Flanks, nominal: Involute) -> NDArray[np.int64]:
    share = (flanks.roll - nominal.control_roll) / nominal.control_length
    return np.clip((share * ROLLS).astype(np.int64), 0, ROLLS - 1)


def _freed(flanks: Flanks, key: NDArray[np.int64], passes: int, nominal: Involute) -> Array:
    """delta without its flank's shape over the roll length: passes that see other parts of a flank compare as well."""
    at = flanks.which.astype(np.int64) * ROLLS + _roll_bin(flanks, nominal)
    bins = 2 * nominal.gear.teeth * ROLLS
    count, number = np.maximum(np.bincount(key, minlength=passes), 1), np.maximum(np.bincount(at, minlength=bins), 1)
    shape = np.zeros(bins)
    for _ in range(SHAPED):
        place = np.bincount(key, flanks.delta - shape[at], minlength=passes) / count
        shape = np.bincount(at, flanks.delta - place[key], minlength=bins) / number
    return np.asarray(flanks.delta - shape[at])


def _error(p: "_Passes", lines: list[float] | None, profiles: int, nominal: Involute) -> Array:
    """By how much (rad, (profiles,)) the part stood farther round, ccw, than its table angle said.

    The passes of a flank only tell it up to what repeats every turn. So it is looked for among what few numbers
    describe: a drift, and lines, steady waves at no whole number a turn (a belt, a gearbox). Only where they don't
    explain it, it is the curve that changes least.
    """
    every = np.arange(profiles) / profiles * p.turns
    if lines is None:
        return np.asarray(np.interp(every, *_least_changing(p)) / nominal.base_radius)
    share = np.linalg.lstsq(p.within(p.waves(lines)), p.within(p.place), rcond=None)[0]
    return np.asarray(_waves(every, lines, p.turns) @ share / nominal.base_radius)


@dataclass(frozen=True, slots=True)
class _Passes:
    """The passes of the flanks, (n,)."""

    which: NDArray[np.int64]
    """flank * teeth + tooth."""
    at: Array
    """When it came by, in turns."""
    place: Array
    """sigma delta along the base circle, mm."""
    arm: Array
    """By how much the place goes with the table's angle, over the base radius."""
    turns: float
    teeth: int

    @property
    def apart(self) -> float:
        """rms (mm) about the mean of each flank, degrees of freedom counted."""
        free = max(self.which.size - np.unique(self.which).size, 1)
        return float(np.sqrt(np.square(self.within(self.place)).sum() / free))

    def within(self, values: Array) -> Array:
        """Values (n,) or (n, m) about the mean of their flank."""
        flat = values.reshape(values.shape[0], -1)
        number = np.maximum(np.bincount(self.which), 1)
        mean = np.stack([np.bincount(self.which, column) / number for column in flat.T], axis=1)
        return np.asarray((flat - mean[self.which]).reshape(values.shape))

    def waves(self, lines: list[float]) -> Array:
        """What a drift and lines do to the places, (n, m)."""
        return np.asarray(self.arm[:, None] * _waves(self.at, lines, self.turns))

    def rest(self, lines: list[float]) -> Array:
        """What a drift and lines leave of the places, mm."""
        a, b = self.within(self.waves(lines)), self.within(self.place)
        return np.asarray(b - a @ np.linalg.lstsq(a, b, rcond=None)[0])

    def left(self, lines: list[float]) -> float:
        """Mean square of it, mm^2."""
        return float(np.square(self.rest(lines)).mean())


def _waves(at: Array, lines: list[float], turns: float) -> Array:
    """A slow drift and a wave (cos and sin) for each line, (n, m); ``at`` in turns."""
    share = at / turns - 0.5
    waves = [f(2 * np.pi * line * at) for line in lines for f in (np.cos, np.sin)]
    return np.stack([share, share**2, share**3, *waves], axis=1)


def _lines(p: _Passes) -> list[float] | None:
    """Waves a turn that explain, with a drift, nearly all; None where no few of them do: half an explanation would
    change pitch by what it can't know.
    """
    total, lines = float(np.square(p.within(p.place)).mean()), list[float]()
    left = p.left(lines)
    while left > max(NEARLY * total, NOTICEABLE**2):
        found = _next_line(p, lines) if len(lines) < MOST_LINES else None
        if found is None or p.left(found) > WORTH * left:
            return None
        lines, left = found, p.left(found)
    return lines


def _next_line(p: _Passes, lines: list[float]) -> list[float] | None:
    """The lines (waves a turn), one more among them, each where it explains most; None where none can be told."""
    from scipy.optimize import minimize

    rest = p.rest(lines)
    tried = np.arange(1.0 / p.turns, HIGHEST * p.teeth, FINE_LINE)
    waves = p.arm[:, None] * np.exp(2j * np.pi * np.outer(p.at, tried))
    c, s = p.within(waves.real), p.within(waves.imag)
    cc, ss, cs, cr, sr = (c * c).sum(axis=0), (s * s).sum(axis=0), (c * s).sum(axis=0), rest @ c, rest @ s
    area = cc * ss - cs * cs
    able = area > (TELLING * p.at.size) ** 2
    if not able.any():
        return None
    gain = np.where(able, (ss * cr**2 - 2 * cs * cr * sr + cc * sr**2) / np.where(able, area, 1.0), 0.0)
    start = [*lines, float(tried[np.argmax(gain)])]
    scale = max(p.left(start), 1e-30)
    best = minimize(
        lambda found: p.left(list(found)) / scale, start, method="Nelder-Mead",
        bounds=[(line - FINE_LINE, line + FINE_LINE) for line in start],
        options={"xatol": 1e-6, "fatol": 1e-6, "maxiter": 400},
    )  # fmt: skip
    return [float(line) for line in best.x]


def _least_changing(p: _Passes) -> tuple[Array, Array]:
    """A curve over the turns (knots and values, mm) and one place a flank, by least squares on the passes and on how
    the curve changes from knot to knot.
    """
    knots = max(8, round(KNOTS_PER_TOOTH * p.teeth * p.turns))
    x = p.at / p.turns * (knots - 1)
    left = np.clip(x.astype(np.intp), 0, knots - 2)
    rows = np.arange(p.which.size)
    design = np.zeros((p.which.size, knots))
    design[rows, left], design[rows, left + 1] = p.arm * (left + 1 - x), p.arm * (x - left)
    change = SMOOTHING * np.diff(np.eye(knots), axis=0)
    matrix = np.concatenate([p.within(design), change])
    wanted = np.concatenate([p.within(p.place), np.zeros(knots - 1)])
    return np.linspace(0.0, p.turns, knots), np.linalg.lstsq(matrix, wanted, rcond=None)[0]
