"""Watches: what must be true of sensor, table and encoder while a scan is recorded.

Each call returns the problem in plain words, or an empty text. Pure: times are passed in. The station turns the first
problem into a fault. Thresholds leave the half of the second that a fault may take for stopping.
"""

from collections import deque
from dataclasses import dataclass, field
from math import degrees, tau

import numpy as np

from truestand.devices.sensor import Frame, Layout
from truestand.files.scans.scancontrol import decode_stamps

SILENCE_S = 0.5
"""Without a frame."""
FRESH_S = 0.15
"""After a frame, within which its encoder count is compared with the table."""
WINDOW_S = 0.5
"""Over which the progress of table and encoder is checked."""
SETTLING_S = 1.0
"""After the start of a motion, in which the table may still be getting up to speed."""
STALLED_SHARE = 0.1
"""Of the set speed, below which the table counts as stalled."""
ENCODER_SHARES = (0.5, 2.0)
"""Lowest and highest permitted ratio of the encoder's counts to what the table's own position gives."""
PERMITTED_LOST = 20
"""Profiles that may be lost in any scan before their share counts."""


@dataclass(slots=True)
class SensorWatch:
    """One sensor's stream."""

    name: str
    layout: Layout
    began: float
    """s at which the stream was started."""
    profiles: int = 0
    lost: int = 0
    encoder: int = 0
    """Counts since the first profile, unwrapped."""
    quiet_until: float = 0.0
    """s until which it may send nothing."""
    _last_frame: Frame | None = None
    _counter: int | None = None
    _raw_encoder: int | None = None

    def see(self, frame: Frame) -> str:
        """The problem of a frame; empty = none."""
        before, self._last_frame = self._last_frame, frame
        if len(frame.payload) != self.layout.frame_bytes:
            return (
                f"sensor {self.name} sends {len(frame.payload)} bytes a frame, {self.layout.frame_bytes} were agreed: "
                "garbage, or its settings were changed from elsewhere"
            )
        if self.layout.kind == "scancontrol":
            return self._see_stamps(frame)
        skipped = 0 if before is None else frame.number - before.number - 1
        self.lost += (skipped + bool(frame.missing)) * self.layout.profiles
        self.profiles += self.layout.profiles
        if before is not None and before.payload == frame.payload and any(frame.payload):
            return f"sensor {self.name} sends the same image again and again: it is frozen; switch it off and on"
        return ""

    def _see_stamps(self, frame: Frame) -> str:
        stamps = decode_stamps(frame.payload, self.layout.points)
        whole = (
            np.flatnonzero((stamps.opened > 0) | (stamps.closed > 0))
            if frame.missing
            else np.arange(len(stamps.counter))
        )
        if not whole.size:
            return ""
        counter, modulus = stamps.counter[whole], self.layout.counter_modulus
        steps = np.diff(counter) % modulus
        step = 1 if self._counter is None else (int(counter[0]) - self._counter) % modulus
        if (steps != np.diff(whole)).any() or (np.diff(stamps.opened[whole]) % self.layout.time_modulus > 1.0).any():
            return f"sensor {self.name} sends garbage: profile counters and times don't follow each other"
        if step == 0 or step > modulus // 2:
            return f"sensor {self.name} sends the same profiles again: it is frozen; switch it off and on"
        self.lost += step - 1 + int((steps - 1).sum())
        self.profiles += whole.size
        self._counter = int(counter[-1])
        self._follow_encoder(int(stamps.encoder[whole[-1]]))
        return ""

    def _follow_encoder(self, raw: int) -> None:
        modulus = self.layout.encoder_modulus
        if self._raw_encoder is not None and modulus:
            self.encoder += (raw - self._raw_encoder + modulus // 2) % modulus - modulus // 2
        self._raw_encoder = raw

    def fresh(self, now: float) -> bool:
        """Whether a frame came just now (s)."""
        return self._last_frame is not None and now - self._last_frame.received < FRESH_S

    def overdue(self, now: float) -> str:
        """The problem where no frame came for too long before ``now`` (s)."""
        last = max(self.quiet_until, self.began if self._last_frame is None else self._last_frame.received)
        if now - last > SILENCE_S:
            return f"sensor {self.name} has sent nothing for {now - last:.1f} s; check its cable, power and trigger"
        return ""

    def too_lossy(self, most_lost: float, expected: int) -> str:
        """The problem where more than the share ``most_lost`` of the ``expected`` profiles was lost."""
        permitted = max(PERMITTED_LOST, most_lost * expected)
        if self.lost > permitted:
            return (
                f"sensor {self.name} lost {self.lost} profiles, at most {int(permitted)} may be: check cable, switch "
                "and packet_size, or slow the sensor down"
            )
        return ""


@dataclass(slots=True)
class TableWatch:
    """The table's motion to ``target`` (rad) at ``speed`` (rad/s), begun at ``began`` (s)."""

    speed: float
    target: float
    tolerance: float
    began: float
    _seen: deque[tuple[float, float]] = field(default_factory=deque)

    def see(self, now: float, position: float, moving: bool) -> str:
        """The problem of a table at ``position`` (rad); empty = none."""
        if position - self.target > max(self.tolerance, WINDOW_S * self.speed):
            return f"the table ran past the end of the scan, to {degrees(position):.2f} deg; check its controller"
        if not moving and abs(position - self.target) > self.tolerance and now - self.began > WINDOW_S:
            return f"the table stopped by itself at {degrees(position):.2f} deg, before the end of the scan"
        span = _span(self._seen, now, position)
        if not moving or now - self.began < SETTLING_S or span is None:
            return ""
        seconds, angle = span
        if angle < -STALLED_SHARE * self.speed * seconds:
            return f"the table turns backwards at {degrees(position):.2f} deg; check its controller"
        if abs(angle) < STALLED_SHARE * self.speed * seconds and not self.arrived(position, moving=False):
            return f"the table stands still at {degrees(position):.2f} deg though it was told to turn: it is blocked"
        return ""

    def arrived(self, position: float, moving: bool) -> bool:
        """Whether the motion is over, at its target."""
        return not moving and abs(position - self.target) <= self.tolerance


@dataclass(slots=True)
class EncoderWatch:
    """Compares a sensor's encoder with the table while the table turns and the sensor sends."""

    name: str
    counts_per_turn: int
    speed: float
    began: float
    _seen: deque[tuple[float, tuple[float, int]]] = field(default_factory=deque)

    def see(self, now: float, position: float, counts: int, fresh: bool) -> str:
        """The problem of the encoder at a table position (rad); ``fresh``: its counts are of this moment."""
        if not fresh:
            self._seen.clear()
            return ""
        self._seen.append((now, (position, counts)))
        while self._seen and now - self._seen[0][0] > WINDOW_S:
            self._seen.popleft()
        if now - self.began < SETTLING_S + WINDOW_S or len(self._seen) < 2:
            return ""
        first, last = self._seen[0][1], self._seen[-1][1]
        turned = last[0] - first[0]
        if abs(turned) < 0.5 * WINDOW_S * self.speed:
            return ""
        expected = turned / tau * self.counts_per_turn
        share = (last[1] - first[1]) / expected
        if share < 0:
            return f"the encoder at sensor {self.name} counts against the table's sense; swap its tracks A and B"
        if not ENCODER_SHARES[0] <= share <= ENCODER_SHARES[1]:
            return (
                f"the encoder at sensor {self.name} counted {100 * share:.0f} % of what the table turned in the last "
                "half second: it is stuck, not wired, or counts_per_turn in stand.toml is wrong"
            )
        return ""


def _span(seen: deque[tuple[float, float]], now: float, value: float) -> tuple[float, float] | None:
    """Over the last ``WINDOW_S``: seconds, and by how much the value went on; None until there is most of one."""
    seen.append((now, value))
    while len(seen) > 2 and now - seen[1][0] >= WINDOW_S:
        seen.popleft()
    seconds = now - seen[0][0]
    return (seconds, value - seen[0][1]) if seconds >= 0.8 * WINDOW_S else None
