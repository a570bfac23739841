"""Faults on request, of a sensor, its network, the table and the positioner."""

from collections.abc import Sequence
from enum import IntEnum

from truestand.core.errors import BadRecipe
from truestand.sim.live.table import VirtualTable


class FaultKind(IntEnum):
    """A fault; the numbers are those of the node VirtualFault."""

    NONE = 0
    LOSE_PACKETS = 1
    """Strength: share of the packets, 0..1."""
    LATENCY = 2
    """Strength: ms by which frames come later."""
    FROZEN = 3
    """Frames with new numbers and always the same content."""
    GARBAGE = 4
    """Frames of random bytes."""
    DISORDER = 5
    """Packets out of order, some of them twice."""
    UNPLUGGED = 6
    """Not a byte on any socket, in or out."""
    HEARTBEAT_IGNORED = 7
    """Commands are neither answered nor counted as a heartbeat; the stream goes on until the heartbeat's timeout."""
    NO_RESEND = 8
    """Requests to send packets again are not answered."""
    STUCK_ENCODER = 9
    STALLED_TABLE = 10
    STALLED_AXIS = 11
    """Of the positioner: all of its axes."""


DEFAULT_STRENGTH = {FaultKind.LOSE_PACKETS: 0.02, FaultKind.LATENCY: 200.0}
NAMES = {kind.name.lower().replace("_", "-"): kind for kind in FaultKind}
"""As on the command line."""


class Faults:
    """The active faults; read by the device's threads, so each change is one assignment."""

    def __init__(self, table: VirtualTable | None = None, axes: Sequence[VirtualTable] = ()) -> None:
        self._table, self._axes = table, tuple(axes)
        self._active: dict[FaultKind, float] = {}

    def __contains__(self, kind: FaultKind) -> bool:
        return kind in self._active

    def strength(self, kind: FaultKind) -> float:
        """Strength of a fault; 0 where it is not active."""
        return self._active.get(kind, 0.0)

    @property
    def latest(self) -> FaultKind:
        """The fault that began last."""
        return next(reversed(self._active), FaultKind.NONE)

    def begin(self, kind: FaultKind, strength: float | None = None) -> None:
        """Add a fault; ``NONE`` ends all.

        Raises:
            BadRecipe: a share of packets beyond 0..1, a fault of the table where there is none.
        """
        if kind is FaultKind.NONE:
            self.clear()
            return
        given = DEFAULT_STRENGTH.get(kind, 1.0) if strength is None else strength
        if given < 0 or (kind is FaultKind.LOSE_PACKETS and given > 1):
            raise BadRecipe(f"found a strength of {given:g} for {kind.name}, need a share 0..1 or ms")
        if kind in (FaultKind.STUCK_ENCODER, FaultKind.STALLED_TABLE):
            if self._table is None:
                raise BadRecipe(f"{kind.name} is a fault of the table, and this stand has none")
            self._table.stick_encoder() if kind is FaultKind.STUCK_ENCODER else self._table.stall()
        if kind is FaultKind.STALLED_AXIS:
            if not self._axes:
                raise BadRecipe(f"{kind.name} is a fault of the positioner, and this stand has none")
            for axis in self._axes:
                axis.stall()
        self._active = {**self._active, kind: given}

    def clear(self) -> None:
        """End all faults."""
        self._active = {}
        for moving in (self._table, *self._axes):
            if moving is not None:
                moving.release()


def fault_at(text: str) -> tuple[FaultKind, float | None, float]:
    """A fault, its strength and its time (s) from KIND@SECONDS or KIND:STRENGTH@SECONDS.

    Raises:
        BadRecipe: something else.
    """
    kind, at, seconds = text.partition("@")
    name, _, strength = kind.partition(":")
    try:
        return NAMES[name], float(strength) if strength else None, float(seconds) if at else 0.0
    except (KeyError, ValueError):
        raise BadRecipe(
            f"found --fault {text}, need KIND@SECONDS or KIND:STRENGTH@SECONDS with KIND one of {', '.join(NAMES)}"
        ) from None
