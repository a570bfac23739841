"""A worker that scans nothing and keeps a result; with the serial number "hold" it turns until it is aborted."""

import json
import signal
import sys
import time
from pathlib import Path

from small_records import calibration, inspection
from truestand.store import Store


def tell(**event):
    print(json.dumps(event), flush=True)


def interrupt(number, frame):
    raise KeyboardInterrupt


def main():
    order = json.loads(sys.stdin.readline())
    signal.signal(signal.SIGINT, interrupt)
    tell(event="step", name="acquire", state="running")
    sensor = {"name": "front", "frames_per_s": 200.0, "profiles": 50, "lost": 0, "profile": {"x": [0.0], "z": [None]}}
    try:
        while True:
            tell(event="live", state="recording", done=0.5, position_deg=12.5, sensors=[sensor])
            if order.get("serial") != "hold":
                break
            time.sleep(0.05)
    except KeyboardInterrupt:
        tell(event="aborted")
        return 130
    tell(event="step", name="acquire", state="done")
    record = calibration() if order["kind"] == "calibrate" else inspection(serial=order["serial"])
    kind = "calibration" if order["kind"] == "calibrate" else "inspection"
    entry = Store.open(Path(order["store"]), create=True).add(kind, record, operator=order["operator"])
    tell(event="done", number=entry.number, verdict=record.get("verdict"), status=record.get("status"), message="")
    return 0


sys.exit(main())
