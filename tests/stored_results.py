"""A stand with results: made by the commands from virtual scans, and kept in a real store."""

import json
import shutil
from dataclasses import dataclass
from functools import cached_property

from command import run
from truestand.files.recipes.recipes import write_starters
from truestand.station.stand_lock import StandLock
from truestand.store import Store
from web_lab import NOBODY_THERE, Client, change, make_state, served

FEWER = {"profiles = 11000": "profiles = 1100", "= 200.0": "= 50.0", "points = 640": "points = 320"}
"""A smaller scan of 1.1 turns."""
LONG_NAME = "Sun wheel of the second planetary stage, hobbed and shaved, drawing 4711-0815-42 rev. F"
LONG_FILE = "sun-wheel-of-the-second-stage-4711-0815-42.toml"
MARKUP = "<img src=x onerror=\"document.title='owned'\">"
CALIBRATIONS, INSPECTIONS = 13, 20
SIZES = {"panel": (1280, 800), "screen": (1920, 1080), "tablet": (800, 1280)}
"""Width and height of what pages are shown on."""


@dataclass(frozen=True)
class Numbers:
    """Of the results that tests look at; 0: unset."""

    untrusted: int = 0
    calibration: int = 0
    nonconforming: int = 0
    markup: int = 0
    conforming: int = 0
    verification: int = 0
    """The newest of all."""


def command(*arguments):
    done = run(*arguments)
    assert done.returncode in (0, 1, 3), done.stderr


def measure(folder):
    """Calibrate, inspect and verify on virtual scans; calibration.json, inspection.json, ..., and the cloud."""
    write_starters(folder)
    stand, shaft, gear = (folder / f"{name}.toml" for name in ("stand", "shaft", "gear"))
    change(stand, FEWER | NOBODY_THERE)
    record = folder / "calibration.json"
    command("simulate", stand, "--artefact", shaft, "-o", folder / "k1.h5")
    command("simulate", stand, "--artefact", shaft, "--part", gear, "-o", folder / "gear.h5")
    command("calibrate", folder / "k1.h5", "--artefact", shaft, "-o", record, "--report", folder / "calibration.html")
    command("inspect", folder / "gear.h5", "--calibration", record, "--part", gear, "-o", folder / "inspection.json",
            "--cloud", folder / "cloud.ply", "--report", folder / "inspection.html")  # fmt: skip
    command("verify", folder / "k1.h5", "--calibration", record, "--artefact", shaft, "-o",
            folder / "verification.json")  # fmt: skip


def read(folder, kind):
    return json.loads((folder / f"{kind}.json").read_text(encoding="utf-8"))


def conforming(record):
    """An inspection without the lines and defects that keep it from conforming; what is undecided conforms."""
    sure = [c for c in record["characteristics"] if c["verdict"] != "does_not_conform"]
    good = [c if c["verdict"] is None else c | {"verdict": "conforms"} for c in sure]
    return record | {"verdict": "conforms", "characteristics": good, "defects": []}


def partly_seen(record):
    """An inspection in which M_d was not seen."""
    unseen = {"status": "not_measurable", "value_mm": None, "U_mm": None, "coverage": 0.1}
    lines = [c | unseen if c["name"] == "M_d" else c for c in record["characteristics"]]
    return record | {"characteristics": lines}


def of_part(record, name, serial):
    return record | {"part": record["part"] | {"name": name, "serial": serial, "order": "P-7781"}}


def fill(folder, made):
    """Put results into the store of a folder with recipes; their numbers."""
    for name in ("stand.toml", "shaft.toml", "gear.toml"):
        shutil.copy(made / name, folder / name)
    gear = (made / "gear.toml").read_text(encoding="utf-8")
    (folder / LONG_FILE).write_text(gear.replace("demo wheel", LONG_NAME), encoding="utf-8")
    store = Store.open(folder / "results", create=True)
    calibration, inspection, verification = (read(made, kind) for kind in ("calibration", "inspection", "verification"))
    untrusted = store.add("calibration", calibration | {"status": "untrusted", "reasons": ["found dirt"]}).number
    for k in range(CALIBRATIONS - 2):
        sensor = calibration["sensor"]
        moved = {"phi_deg": sensor["phi_deg"] + (1.0 if k == CALIBRATIONS - 3 else 0.001 * (k % 2))}
        store.add("calibration", calibration | {"sensor": sensor | moved}, operator="J. Kowalczyk")
    last = store.add("calibration", calibration, {"report": made / "calibration.html"}, operator="J. Kowalczyk")
    whole = [c for c in inspection["characteristics"] if c["tooth"] is None]
    for k in range(INSPECTIONS):
        record = of_part(inspection | {"characteristics": whole, "verdict": ("conforms", "undecided")[k % 2]},
                         "demo wheel", f"A-{k:04d}")  # fmt: skip
        store.add("inspection", record, operator="M. Novák")
    store.correct(CALIBRATIONS + 1, of_part(inspection, "demo wheel", "A-0001"), reason="the serial number was wrong")
    files = {"report": made / "inspection.html", "cloud": made / "cloud.ply"}
    bad = store.add("inspection", of_part(partly_seen(inspection), "demo wheel", "A-0042"), files).number
    remarked = of_part(inspection | {"remarks": [f"note: {MARKUP}"]}, LONG_NAME, MARKUP)
    markup = store.add("inspection", remarked, operator=MARKUP).number
    good = store.add("inspection", of_part(conforming(inspection), "demo wheel", "A-0043"), files).number
    checked = store.add("verification", verification, {"calibration": store.evidence(last)["record"]}).number
    return Numbers(untrusted, last.number, bad, markup, good, checked)


class StoredStand:
    """A stand's folder, served when it is first asked for; what tests change before that, the server finds."""

    def __init__(self, folder, made, numbers, stack):
        self.folder, self.made, self.numbers, self.users, self._stack = folder, made, numbers, (), stack

    @cached_property
    def state(self):
        return make_state(self.folder, self.users)

    @cached_property
    def client(self):
        client = Client(self._stack.enter_context(served(self.state)))
        client.session()
        return client

    @property
    def url(self):
        return f"http://127.0.0.1:{self.client.port}/"

    @property
    def store(self):
        return Store.open(self.folder / "results", create=True)

    def forget_results(self):
        shutil.rmtree(self.folder / "results")

    def will_measure(self, kind, record):
        """The record that jobs of a kind put into the store."""
        (self.folder / "worker").mkdir(exist_ok=True)
        (self.folder / "worker" / f"{kind}.json").write_text(json.dumps(record), encoding="utf-8")

    def run(self, does="quick", kind="calibrate", **more):
        """Start a job as another client would; scripted_worker.py says what it can do."""
        return self.client.post("/api/jobs", {"kind": kind, "serial": does, **more}).json

    def fail(self, reason):
        """Latch a fault."""
        lock = StandLock(self.folder / "stand.toml")
        lock.latch_fault("2026-11-21T10:00:00Z", reason, {})
        lock.close()

    @property
    def job_folder(self):
        (folder,) = self.state.settings.jobs_folder.iterdir()
        return folder
