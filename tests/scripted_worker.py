"""A worker that speaks like truestand.station.worker and does what the request's ``serial`` asks for; no stand needed.

Where ``worker/KIND.json`` lies beside stand.toml, a job that ends well puts that record into the store.
"""

import json
import os
import signal
import sys
import time
from pathlib import Path

RATE = 50.0
"""Live events in a second."""


def kept_waiting(pid="self"):
    """s that a process's main thread was ready to run and other programs had the cores; 0 where nobody counts."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9
    except OSError:
        return 0.0


def tell(**event):
    """One line; the seconds that its reader made it wait."""
    line, began, waited = json.dumps(event) + "\n", time.perf_counter(), kept_waiting()
    sys.stdout.write(line)
    sys.stdout.flush()
    return time.perf_counter() - began - (kept_waiting() - waited)


def live(n, done=None, lost=()):
    """The n-th live event, of one sensor or of one for each of the ``lost`` profiles."""
    profile = {
        "x": [round(i * 0.1, 3) for i in range(160)],
        "z": [70.0 + i * 0.01 if i % 7 else None for i in range(160)],
    }
    sensors = [
        {"name": name, "frames_per_s": 200.0, "profiles": n, "lost": count, "profile": profile}
        for name, count in zip(("front", "rear"), lost or (0,), strict=False)
    ]
    share = min(n / 500, 1.0) if done is None else done
    return tell(event="live", state="recording", done=share, position_deg=float(n), sensors=sensors)


def turn(until):
    """Live events until a file or a signal says stop; how many, and the longest that one was held up."""
    n, longest, next_one = 0, 0.0, time.perf_counter()
    while not until():
        n += 1
        longest = max(longest, live(n))
        next_one += 1 / RATE
        time.sleep(max(0.0, next_one - time.perf_counter()))
    return n, longest


def hold():
    """The same live event until a signal says stop: half of the first step done, 50 profiles, 12 lost by one sensor."""
    while True:
        live(50, 0.5, (0, 12))
        time.sleep(0.05)


def outcome(request):
    """Number, verdict and status of the record that is put into the store, or of a calibration that is not."""
    path = Path(request.get("stand", "stand.toml")).with_name("worker") / f"{request['kind']}.json"
    if not path.exists():
        moved = request["serial"] == "moved"
        return {"number": None, "verdict": "does_not_hold" if moved else None, "status": None if moved else "valid"}
    from truestand.store import Store

    record = json.loads(path.read_text(encoding="utf-8"))
    if "part" in record:
        record["part"] |= {key: request[key] for key in ("serial", "order", "operator")}
    kind = record["format"].removeprefix("truestand.")
    entry = Store.open(Path(request["store"]), create=True).add(kind, record, operator=request["operator"])
    return {"number": entry.number, "verdict": record.get("verdict"), "status": record.get("status")}


def interrupt(number, frame):
    raise KeyboardInterrupt


def main():
    request = json.loads(sys.stdin.readline())
    folder = Path(request["folder"])
    folder.mkdir(parents=True)
    (folder / "request.json").write_text(json.dumps(request))
    does = request.get("serial") or "quick"
    signal.signal(signal.SIGINT, signal.SIG_IGN if does == "stubborn" else interrupt)
    tell(event="step", name="acquire", state="running")
    try:
        if does == "crash":
            print("Segmentation fault", file=sys.stderr)
            os._exit(3)
        if does == "fail":
            tell(event="step", name="acquire", state="failed")
            tell(event="failed", message="found <b>no shaft</b>")
            return 1
        if does == "garbage":
            print("no json\n[1, 2]\nnull\n" + '{"event": "step"}\n' + '{"event": 7}\n' + "x" * 3_000_000)
        if does == "hold":
            hold()
        if does in ("long", "stubborn"):
            n, longest = turn(lambda: (folder / "stop").exists())
            (folder.parent / "told.json").write_text(json.dumps({"told": n, "longest": longest}))
        else:
            for n in range(5):
                live(n)
    except KeyboardInterrupt:
        time.sleep(0.2)
        (folder / "stopped").write_text("the table stands still")
        tell(event="step", name="acquire", state="failed")
        tell(event="aborted")
        return 130
    for name in ("acquire", "evaluate", "report", "keep"):
        tell(event="step", name=name, state="running")
        tell(event="step", name=name, state="done")
    tell(event="done", message="", **outcome(request))
    return 0


if __name__ == "__main__":
    sys.exit(main())
