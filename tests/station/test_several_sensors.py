"""A stand with two sensors: each job takes a scan by each at once, and evaluates them together."""

from pathlib import Path

import pytest

from lab import lab
from truestand.files.scans.read import read_scan
from truestand.station.jobs import Job, Observer, run_job
from truestand.station.pipeline import Inputs
from truestand.store import Store

VIEWS = """
[[simulation.view]]
name = "front"
laser_plane_offset_mm = 0.15

[[simulation.view]]
name = "rear"
azimuth_deg = 120.0
laser_plane_offset_mm = -0.2
"""


@pytest.mark.stand
def test_jobs_take_and_evaluate_a_scan_by_each_sensor(tmp_path):
    with lab(tmp_path, turns=1.1, points=160, pace=4.0, sensors=("front", "rear"), views=VIEWS) as stand:

        def job(kind, **given):
            return run_job(Job(kind, stand.recipe, tmp_path / kind, tmp_path / "shaft.toml", **given), Observer())

        store = Store.open(tmp_path / "results", create=True)
        calibrated = job("calibrate")
        assert [s["name"] for s in calibrated.record["sensors"]] == ["front", "rear"]
        assert abs(calibrated.record["sensors"][1]["azimuth_deg"] - 120.0) < 0.1
        assert {path.name for path in calibrated.evidence.values()} >= {"shaft-front.h5", "shaft-rear.h5"}
        known = tmp_path / "calibrate" / "calibration.json"
        verified = job("verify", calibration=known)
        for outcome in (calibrated, verified):
            assert store.add(outcome.kind, outcome.record, outcome.evidence).evidence.keys() >= {"scan", "scan 2"}
        assert {c["view"] for c in verified.record["changes"]} == {"front", "rear"}
        assert len(verified.record["scans"]) == 2
        assert verified.record["verdict"] != "does_not_hold", verified.record["reasons"]
        stand.put("gear.toml")
        inspected = job("inspect", calibration=known, part=tmp_path / "gear.toml")
        assert {tuple(c["views"]) for c in inspected.record["characteristics"]} >= {("front", "rear")}
        assert inspected.record["seams"] and all(s["ok"] for s in inspected.record["seams"])
        store.add(inspected.kind, inspected.record, inspected.evidence)
        assert read_scan(tmp_path / "inspect" / "part-rear.h5").view == "rear"


def test_the_scan_of_a_record_is_the_first_view_s_or_the_last_clamping_s():
    """A store refused results of several views: their own scan was taken for another one."""
    scans = Inputs((Path("a.h5"), Path("b.h5"), Path("c.h5")))
    assert scans.evidence() == {"scan": Path("a.h5"), "scan 2": Path("b.h5"), "scan 3": Path("c.h5")}
    assert scans.evidence(-1) == {"scan": Path("c.h5"), "scan 1": Path("a.h5"), "scan 2": Path("b.h5")}
