"""Scans: what a file holds (``Recording``) and what it means on a given stand (``Scan``).

NaN = not seen. No point is ever dropped; a row is a profile, in the order of the file.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import tau
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.errors import BadRecipe
from truestand.core.message import Message
from truestand.core.robust import robust_sd
from truestand.core.stand import Stand
from truestand.core.stuck import without_stuck

AngleSource = Literal["index", "time", "angle", "encoder"]
AngleZero = Literal["index", "home", "witness", "unknown"]
"""What ties a table angle to that of another scan: an index, the home position, a witness band, nothing."""
BESIDE, MOST_OFF, OFF_SD = 20, 1.5, 5.0
"""Steps of an encoder to either side of where it starts again; counts, and robust standard deviations of those steps,
by which the table may be out of step there.
"""
LEAP, HELD = 4, 0.1
"""Usual steps of the angle that make a leap, and profiles for which it stood still before; share of a step that counts
as none.
"""


@dataclass(frozen=True, slots=True)
class Recording:
    """A scan file's own content, before a stand says what it means.

    ``x`` and ``z`` are (N, M) in mm as reported; the other columns are (N,), one value a profile, or None.
    """

    x: Array
    z: Array
    format: str
    sha256: str
    y: Array | None = None
    """The Y block of an XYZ file, or a height map's Y in mm: its meaning is ``[scan] y`` in stand.toml."""
    time: Array | None = None
    """s."""
    angle: Array | None = None
    """rad, as reported (not yet signed by the table's direction)."""
    encoder: Array | None = None
    """Counts."""
    counter: NDArray[np.int64] | None = None
    intensity: Array | None = None
    """(N, M), sensor units."""
    stand: Stand | None = None
    """The stand that the file carries (native files)."""
    acquisition: Mapping[str, Any] | None = None
    """How it was recorded, where truestand did: ``complete``, ``reasons``, what was lost (docs/formats.md)."""


@dataclass(frozen=True, slots=True)
class Scan:
    """What one sensor saw in one pass, on a known stand.

    ``x`` (N, M) mm along the laser line, already un-mirrored; ``z`` (N, M) mm range; ``angle`` (N,) rad is the table
    angle theta, positive counter-clockwise seen from +Z.
    """

    x: Array
    z: Array
    angle: Array
    stand: Stand
    angle_source: AngleSource
    sha256: str = ""
    time: Array | None = None
    counter: NDArray[np.int64] | None = None
    intensity: Array | None = None
    reasons: tuple[Message, ...] = ()
    """Why it is not proven complete; empty where it is, or where the recording does not say."""
    remarks: tuple[Message, ...] = ()
    """What else to know of it: points of the sensor that are stuck, and left out."""

    @property
    def view(self) -> str:
        """Name of the sensor, in its place, that took it."""
        return self.stand.sensor.name

    @property
    def profiles(self) -> int:
        """Number of profiles, N."""
        return int(self.x.shape[0])

    @property
    def step(self) -> float:
        """Mean table angle from one profile to the next, rad, signed."""
        return float((self.angle[-1] - self.angle[0]) / max(self.profiles - 1, 1))

    @property
    def revolutions(self) -> float:
        """Turns covered: N profiles span N steps, not N - 1."""
        return abs(self.step) * self.profiles / tau

    @property
    def seen(self) -> float:
        """Share of the readings that carry a point, 0..1."""
        return float(np.count_nonzero(np.isfinite(self.z)) / max(self.z.size, 1))

    @property
    def live(self) -> Mask:
        """Points (M,) of the sensor that see anything in the whole scan."""
        return np.asarray(np.isfinite(self.z).any(axis=0))

    @property
    def angle_zero(self) -> AngleZero:
        """What ties this scan's table angle to another scan's."""
        if self.angle_source in ("angle", "encoder"):
            return "index"
        return "home" if self.stand.table.start == "home" else "unknown"

    @property
    def free_speed(self) -> bool:
        """Whether the table angle rests on the stated speed, so that the calibration estimates it."""
        return self.angle_source in ("index", "time")

    def time_at(self, rows: Ints | Array) -> Array:
        """Time (n,) of profiles, as the share -0.5..0.5 of the scan."""
        return np.asarray(rows / max(self.profiles - 1, 1) - 0.5)

    def spread(self, profiles: int) -> Ints:
        """Rows of at most so many ``profiles``, spread evenly over the scan, the first and the last among them."""
        return np.unique(np.linspace(0, self.profiles - 1, profiles).astype(np.intp))

    def taken(self, rows: Ints | slice) -> "Scan":
        """The scan of these rows alone, with x, z and angle only."""
        return replace(
            self, x=self.x[rows], z=self.z[rows], angle=self.angle[rows], time=None, counter=None, intensity=None
        )


def interpret(
    recording: Recording, stand: Stand | None = None, start_angle: float | None = None, view: str | None = None
) -> Scan:
    """The recording as seen on ``stand`` (default: the stand it carries).

    ``start_angle`` (rad, table angle of the first profile) is for scans without an angle of their own; ``view`` says
    which of the stand's sensors took it, where the recording doesn't.

    Raises:
        BadRecipe: no stand, one of several sensors and nobody says which, another view than the recording's, or the
            stand lacks what the angle needs (speed, profile rate, counts per turn).
    """
    stand = stand or recording.stand
    if stand is None:
        raise BadRecipe("the scan carries no stand; describe it with --stand STAND.toml (`truestand init` writes one)")
    stand = _seen_from(stand, recording, view)
    angle, source = table_angle(recording, stand, start_angle)
    x = -recording.x if stand.sensor.mirrored else recording.x
    z, remarks = without_stuck(_within_range(recording.z, stand.sensor.range))
    return Scan(
        x, z, angle, stand, source, recording.sha256, recording.time, recording.counter, recording.intensity,
        (*_incomplete_reasons(recording), *_held_reasons(angle, source)), remarks,
    )  # fmt: skip


def _seen_from(stand: Stand, recording: Recording, view: str | None) -> Stand:
    """The stand with the one sensor that took the recording."""
    carried = None if recording.stand is None or len(recording.stand.sensors) != 1 else recording.stand.sensor.name
    if view is not None and carried not in (None, view):
        raise BadRecipe(f"found --view {view} for a scan that carries view {carried!r}; leave it out, or give its scan")
    view = view or (carried if len(stand.sensors) > 1 else None)
    return stand if view is None else stand.of_view(view)


def _incomplete_reasons(recording: Recording) -> tuple[Message, ...]:
    if recording.acquisition is None or recording.acquisition.get("complete") is True:
        return ()
    reasons = recording.acquisition.get("reasons") or ["nothing proves it whole"]
    return tuple(Message("scan_incomplete", f"the scan is incomplete: {reason}; scan again") for reason in reasons)


def _held_reasons(angle: Array, source: AngleSource) -> tuple[Message, ...]:
    """Why a recorded angle (N,) isn't that of its profiles: it stands still for some, and then makes up for them."""
    steps = np.abs(np.diff(angle)) if source in ("angle", "encoder") else np.zeros(0)
    usual = float(np.median(steps)) if steps.size else 0.0
    for leap in np.flatnonzero(steps > LEAP * usual) if usual else ():
        held = int(np.argmax(np.append(steps[:leap][::-1] > HELD * usual, True)))  # steps before it that are none
        if held >= LEAP and steps[leap] > held / 2 * usual:
            text = (
                f"the recorded angle stands still for {held} profiles before profile {leap + 1}, and then leaps by "
                f"{steps[leap] / usual:.0f} steps: their angle is wrong; check the encoder's connection and scan again"
            )
            return (Message("angle_held", text),)
    return ()


def table_angle(recording: Recording, stand: Stand, start_angle: float | None = None) -> tuple[Array, AngleSource]:
    """Table angle theta (N,) rad and what it rests on, best source first: encoder, angle, time, profile number.

    Raises:
        BadRecipe: the stand lacks what the available source needs.
    """
    sign = stand.table.sign
    encoder = recording.y if stand.y == "encoder" and recording.encoder is None else recording.encoder
    if encoder is not None:
        if stand.counts_per_turn <= 0:
            raise BadRecipe("the scan has encoder counts but [scan] counts_per_turn is 0; state the counts of one turn")
        return sign * _counted_on(encoder, stand.counts_per_turn) * (tau / stand.counts_per_turn), "encoder"
    angle = np.radians(recording.y) if stand.y == "angle_deg" and recording.y is not None else recording.angle
    if angle is not None:
        return sign * np.unwrap(angle), "angle"
    if stand.y in ("angle_deg", "encoder") and recording.y is None and recording.format == "xyz blocks":
        raise BadRecipe(f"[scan] y = {stand.y!r}, but the Y block is not constant along each profile; check [scan] y")
    return _angle_from_speed(recording, stand, start_angle or 0.0)


def _counted_on(counts: Array, turn: int) -> Array:
    """Encoder counts (N,) that may start again every ``turn``, going on.

    Raises:
        BadRecipe: they start again after another number of counts.
    """
    steps = np.diff(counts)
    forward = 1.0 if np.median(steps) >= 0 else -1.0
    again = forward * steps < -turn / 4
    if not again.any() or steps.size < 2:
        return counts
    steps = steps + forward * turn * again
    off, spread = np.transpose([_out_of_step(steps, int(at)) for at in np.flatnonzero(again)])
    low, high, out = counts.min(), counts.max(), float(np.median(off))
    if abs(out) > max(MOST_OFF, OFF_SD * spread.max()) or high - low >= turn:
        raise BadRecipe(
            f"found encoder counts from {low:.0f} to {high:.0f} that start again after about {turn - forward * out:.0f}"
            f", need [scan] counts_per_turn = {turn} of them; state the counts of one turn"
        )
    return np.asarray(counts + forward * turn * np.concatenate([[0], np.cumsum(again)]))


def _out_of_step(steps: Array, at: int) -> tuple[float, float]:
    """By how much one of the steps differs from those beside it, and how much these scatter."""
    beside = np.concatenate([steps[max(at - BESIDE, 0) : at], steps[at + 1 : at + 1 + BESIDE]])
    usual = float(np.median(beside))
    return float(steps[at]) - usual, robust_sd(beside - usual)


def _angle_from_speed(recording: Recording, stand: Stand, start: float) -> tuple[Array, AngleSource]:
    speed = stand.table.speed
    if speed is None:
        raise BadRecipe("the scan has no angle and the stand no speed; set [table] speed_rad_per_s in stand.toml")
    sign = stand.table.sign
    time = recording.y if stand.y == "time_s" and recording.y is not None else recording.time
    if time is not None:
        return start + sign * speed * (time - time[0]), "time"
    rate = stand.sensor.profile_rate
    if rate is None:
        raise BadRecipe("the scan has no angle or time; set profile_rate_hz of the sensor in stand.toml")
    return start + sign * (speed / rate) * profile_number(recording), "index"


def profile_number(recording: Recording) -> Array:
    """Which profile since the start each one is (N,): by the sensor's counter where there is one, lost ones included.

    A counter that overflows at a power of two (8 bits and more) is continued.
    """
    if recording.counter is None:
        return np.arange(recording.x.shape[0], dtype=np.float64)
    steps = np.diff(recording.counter).astype(np.int64)
    for i in np.flatnonzero(steps <= 0):
        highest = int(recording.counter[: i + 1].max())
        steps[i] += 1 << max(8, highest.bit_length())
    return np.concatenate([[0.0], np.cumsum(steps, dtype=np.float64)])


def _within_range(z: Array, limits: tuple[float, float] | None) -> Array:
    """``z`` with readings outside the sensor's range marked as not seen; the same array where there are none."""
    if limits is None:
        return z
    low, high = limits
    if np.fmin.reduce(z, axis=None, initial=np.inf) >= low and np.fmax.reduce(z, axis=None, initial=-np.inf) <= high:
        return z
    return np.where((z >= low) & (z <= high), z, np.nan)
