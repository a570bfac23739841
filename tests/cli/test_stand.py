"""acquire, recover and stand as a user runs them, against the virtual stand's sockets."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from command import run_process as run
from lab import lab
from patience import NOT_FOR_EVER
from truestand.sim.live.faults import FaultKind
from truestand.store import Store


@pytest.fixture(scope="module")
def stand(tmp_path_factory):
    with lab(tmp_path_factory.mktemp("stand"), turns=0.3, pace=2.0, sensors=("front", "back"), points=320) as found:
        yield found


@pytest.fixture
def single(tmp_path):
    with lab(tmp_path, turns=0.5, pace=3.0, heartbeat_ms=500) as found:
        yield found


def started(*arguments, **options):
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-m", "truestand", *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options,
    )  # fmt: skip


def acquiring(stand, *more):
    """``acquire`` in a process of its own, the table already turning."""
    process = started("acquire", "--stand", stand.recipe, "-o", stand.folder / "k1.h5", *more)
    while not (stand.folder / "k1.log").exists() or stand.at_rest:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    return process


def test_list_shows_which_devices_answer(stand):
    done = run("stand", "list", "--stand", stand.recipe, "--json")
    assert done.returncode == 0, done.stderr
    table, front, back = json.loads(done.stdout)
    assert table["answers"] and front["serial"] == "V0" and back["serial"] == "V1"
    stand.faults.begin(FaultKind.UNPLUGGED)
    try:
        done = run("stand", "list", "--stand", stand.recipe)
    finally:
        stand.faults.clear()
    assert done.returncode == 2
    assert "front" in done.stdout and "nobody" in done.stdout


@pytest.mark.stand
def test_test_streams_turns_and_counts(stand):
    done = run("stand", "test", "--stand", stand.recipe, "--seconds", "0.5", "--laser", "--move", "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads(done.stdout)
    assert report["sensors"]["front"]["lost_profiles"] == 0
    assert report["sensors"]["back"]["seen"] > 0.5
    assert report["table"]["encoder_at_back"] == "10000 counts in 10 degrees, 10000 expected"
    assert stand.safe


@pytest.mark.stand
def test_identify_blinks_the_laser_of_one_sensor(stand):
    lit = []
    process = started("stand", "identify", "back", "--stand", stand.recipe)
    while process.poll() is None:
        lit.append([s.laser for s in stand.sensors])
        time.sleep(0.02)
    assert process.communicate() == ("back has shown itself\n", "")
    assert [0, 1] in lit and not any(front for front, _ in lit)
    assert stand.safe
    done = run("stand", "identify", "left", "--stand", stand.recipe)
    assert done.returncode == 2 and "need one of table, front, back" in done.stderr


@pytest.mark.stand
def test_watch_shows_live_numbers(stand):
    done = run("stand", "watch", "--stand", stand.recipe, "--seconds", "0.8", "--laser")
    assert done.returncode == 0, done.stderr
    assert "front" in done.stdout and "profiles/s" in done.stdout
    assert stand.safe


@pytest.mark.stand
def test_acquire_ends_0_with_a_complete_scan_of_each_sensor(stand):
    target = stand.folder / "k1.h5"
    done = run("acquire", "--stand", stand.recipe, "-o", target, "--store", stand.folder / "results")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(stand.folder / "k1-front.h5"), str(stand.folder / "k1-back.h5")]
    info = json.loads(run("info", stand.folder / "k1-front.h5", "--json").stdout)
    assert info["complete"] is True and info["lost_profiles"] == 0
    again = run("acquire", "--stand", stand.recipe, "-o", target)
    assert again.returncode == 2 and "never overwritten without --force" in again.stderr
    (kept,) = Store.open(stand.folder / "results").entries()
    assert (kept.kind, kept.status) == ("scan", "complete")
    assert set(kept.evidence) == {"scan front", "scan back", "stand"}


@pytest.mark.stand
def test_a_fault_ends_3_and_stays_until_reset(single):
    process = acquiring(single)
    time.sleep(1.0)
    single.faults.begin(FaultKind.STALLED_TABLE)
    out, err = process.communicate(timeout=NOT_FOR_EVER)
    assert process.returncode == 3, err
    assert out.strip() == str(single.folder / "k1.h5")
    assert "truestand: incomplete: the table stands still" in err
    single.faults.clear()
    again = run("acquire", "--stand", single.recipe, "-o", single.folder / "b.h5")
    assert again.returncode == 2 and "in fault since" in again.stderr and "stand reset" in again.stderr
    info = json.loads(run("info", single.folder / "k1.h5", "--json").stdout)
    assert info["complete"] is False and "stands still" in info["reasons"][0]
    calibrated = run("calibrate", single.folder / "k1.h5", "--artefact", single.folder / "shaft.toml",
                     "-o", single.folder / "c.json")  # fmt: skip
    assert calibrated.returncode in (2, 3)
    reset = run("stand", "reset", "--stand", single.recipe)
    assert reset.returncode == 0 and "stands still" in reset.stdout
    assert run("acquire", "--stand", single.recipe, "-o", single.folder / "b.h5", "--turns", "0.05").returncode == 0


@pytest.mark.stand
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_the_stand_and_keeps_the_frames(single, number):
    process = acquiring(single)
    time.sleep(1.0)
    process.send_signal(number)
    _, err = process.communicate(timeout=NOT_FOR_EVER)
    assert process.returncode == 130
    assert "incomplete: it was interrupted by the operator" in err
    assert single.safe
    assert json.loads(run("info", single.folder / "k1.h5", "--json").stdout)["complete"] is False
    assert run("acquire", "--stand", single.recipe, "-o", single.folder / "b.h5", "--turns", "0.05").returncode == 0


@pytest.mark.stand
def test_recover_makes_a_scan_of_the_log_of_a_crash(single):
    process = acquiring(single)
    time.sleep(1.0)
    process.kill()
    process.communicate()
    refused = run("acquire", "--stand", single.recipe, "-o", single.folder / "b.h5")
    assert refused.returncode == 2 and "truestand recover" in refused.stderr
    done = run("recover", single.folder / "k1.log", "--json")
    assert done.returncode == 3
    (scan,) = json.loads(done.stdout)["scans"]
    assert scan["complete"] is False and scan["reasons"] == ["the recording was cut off before its end"]
    assert scan["profiles"] > 100
    assert run("recover", single.folder / "k1.log").returncode == 2  # k1.h5 is there now
    assert run("recover", single.recipe).returncode == 2
    refused = run("recover", single.folder / "k1.log", "-o", single.folder / "k1.csv")
    assert refused.returncode == 2 and "need .h5, which says whether the scan is complete" in refused.stderr


def test_wrong_use_is_one_line(single, tmp_path):
    assert "need .h5" in run("acquire", "--stand", single.recipe, "-o", tmp_path / "k.csv").stderr
    recipe = single.recipe.read_text()
    single.recipe.write_text(recipe.replace('driver = "scancontrol"', 'driver = "scancontroll"'))
    done = run("stand", "list", "--stand", single.recipe)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "scancontroll" in done.stderr
    single.recipe.write_text(recipe.replace('name = "front"\ndriver', 'name = "left"\ndriver'))
    assert "need one of the [[sensor]]s: front" in run("stand", "list", "--stand", single.recipe).stderr
    single.recipe.write_text(recipe.partition("[devices.table]")[0])
    assert "found no [devices]" in run("stand", "list", "--stand", single.recipe).stderr


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_refused(single, tmp_path):
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o500)
    done = run("acquire", "--stand", single.recipe, "-o", folder / "k1.h5")
    assert done.returncode == 2 and "truestand:" in done.stderr
    assert single.safe
