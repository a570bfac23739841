"""How long the stand goes on after each fault, and what is said: the virtual stand over its sockets, in real time.

    python bench/faults.py [--times 3]

Each fault is begun at a fifth of a turn's scan; the time is from there until the table stands still and the laser is
off.
"""

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from lab import lab
from truestand.sim.live.faults import FaultKind
from truestand.station.stand_lock import reset_latched_fault

FAULTS = {
    "sensor unplugged": (FaultKind.UNPLUGGED, None),
    "frames frozen": (FaultKind.FROZEN, None),
    "garbage frames": (FaultKind.GARBAGE, None),
    "latency of 3 s": (FaultKind.LATENCY, 3000.0),
    "control not answered": (FaultKind.HEARTBEAT_IGNORED, None),
    "encoder stuck": (FaultKind.STUCK_ENCODER, None),
    "table stalled": (FaultKind.STALLED_TABLE, None),
}


def once(kind, strength):
    with tempfile.TemporaryDirectory() as folder, lab(Path(folder), turns=1.0, pace=1.0, points=640) as stand:
        taken = stand.take(show=stand.failing(stand.fault(kind, strength), at=0.2))
        reset_latched_fault(stand.recipe)
    return stand.since_fault, taken


def main():
    given = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    given.add_argument("--times", type=int, default=3)
    times = given.parse_args().times
    for name, (kind, strength) in FAULTS.items():
        results = [once(kind, strength) for _ in range(times)]
        seconds = sorted(s for s, _ in results)
        complete = sum(taken.complete for _, taken in results)
        took = f"safe after {seconds[0]:.2f} to {seconds[-1]:.2f} s; complete: {complete}"
        print(f"{name:22} {took}; {results[0][1].fault}", flush=True)


if __name__ == "__main__":
    main()
