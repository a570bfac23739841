"""Scans taken over the real protocols from the virtual stand in this process, and what can go wrong with one."""

import re
import time
from dataclasses import dataclass, replace

import numpy as np
import pytest

from lab import lab
from patience import NOT_FOR_EVER
from truestand.core.errors import BadRecipe, DeviceError, DeviceLost, Fault, LimitExceeded, NoSpace
from truestand.files.scans.read import read_recording, read_scan
from truestand.sim.live.faults import FaultKind
from truestand.station import stand as stand_module
from truestand.station.stand_lock import reset_latched_fault, state_path
from truestand.station.sync import STEADY_FACTOR


@dataclass
class Silent:
    """A drive that can't be reached."""

    inner: object

    def halt(self) -> None:
        raise DeviceLost("silent")


def test_a_scan_has_the_turns_and_profiles_of_its_settings(tmp_path):
    """At a quarter of a turn in 5 s, on a sensor that forgives a busy machine a long silence."""
    with lab(tmp_path, pace=1.0) as stand:
        taken = stand.take()
        assert stand.safe
        assert not stand.sensors[0].controlled
    assert taken.complete and not taken.fault
    recording = read_recording(taken.written[0].path)
    assert recording.acquisition["lost_profiles"] == 0
    turned = recording.encoder / 360_000
    assert recording.x.shape[0] == pytest.approx(0.25 * 4000, abs=2)
    assert 0 <= turned[0] - 0.05 < 3e-4  # the run-up of 18 degrees; a profile is 2.5e-4 turns
    assert np.ptp(turned) == pytest.approx(0.25, abs=1e-3)
    assert (np.diff(recording.counter) == 1).all()
    assert not (tmp_path / "k1.log").exists()
    assert state_path(stand.recipe).read_bytes() == b""


@pytest.mark.stand
def test_the_encoder_counts_where_the_table_is(tmp_path):
    """A second scan begins a whole number of turns later, at the same angle of the table."""
    with lab(tmp_path, turns=0.1) as stand:
        first = read_recording(stand.take("a.h5").written[0].path)
        second = read_recording(stand.take("b.h5").written[0].path)
    assert (second.encoder[0] - first.encoder[0]) / 360_000 == pytest.approx(1.0, abs=3e-4)  # a profile is 2.5e-4


@pytest.mark.stand
def test_without_an_encoder_the_angle_comes_from_the_clocks(tmp_path):
    with lab(tmp_path, encoder=False, pace=1.0) as stand:
        for i in range(5):  # the virtual clock waits on a busy machine, which no real one does
            taken = stand.take(f"k{i}.h5")
            synchronisation = taken.written[0].scan.recording.acquisition["synchronisation"]
            if taken.complete and synchronisation["steady"]:
                break
    assert taken.complete
    assert synchronisation["source"] == "clock" and synchronisation["steady"]
    scan = read_scan(taken.written[0].path)
    assert scan.angle_source == "angle"
    doubt = (STEADY_FACTOR * synchronisation["doubt_ms"] + synchronisation["clock_misfit_ms"]) / 1000
    assert scan.step == pytest.approx(0.1 * np.pi / 200, rel=2e-3 + doubt / (scan.profiles / 200))


@pytest.mark.stand
def test_two_sensors_give_two_scans(tmp_path):
    with lab(tmp_path, sensors=("front", "back"), turns=0.1) as stand:
        taken = stand.take()
    assert taken.complete
    assert [w.path.name for w in taken.written] == ["k1-front.h5", "k1-back.h5"]
    assert [read_scan(w.path).stand.sensor.name for w in taken.written] == ["front", "back"]


HARMLESS = {"lost packets that come again": (FaultKind.LOSE_PACKETS, 0.02), "disorder": (FaultKind.DISORDER, None)}


@pytest.mark.stand
@pytest.mark.parametrize("kind", HARMLESS)
def test_packets_resent_or_reordered_cost_no_profile(tmp_path, kind):
    with lab(tmp_path) as stand:
        taken = stand.take(show=stand.failing(stand.fault(*HARMLESS[kind]), at=0.1))
    assert taken.complete, taken.fault
    assert taken.written[0].scan.recording.acquisition["lost_profiles"] == 0


FAULTS = {
    "unplugged": (FaultKind.UNPLUGGED, None, "has sent nothing|no answer|doesn't answer"),
    "frozen": (FaultKind.FROZEN, None, "same profiles again: it is frozen"),
    "garbage": (FaultKind.GARBAGE, None, "garbage"),
    "latency": (FaultKind.LATENCY, 3000.0, "has sent nothing for"),
    "control lost": (FaultKind.HEARTBEAT_IGNORED, None, "sent nothing|no answer|doesn't answer|control"),
    "stuck encoder": (
        FaultKind.STUCK_ENCODER,
        None,
        "the encoder at sensor front counted .* % of what the table turned",
    ),
    "stalled table": (FaultKind.STALLED_TABLE, None, "stands still at .* though it was told to turn"),
}


IN_EVERY_RUN = "stalled table"


@pytest.mark.parametrize("name", [n if n == IN_EVERY_RUN else pytest.param(n, marks=pytest.mark.stand) for n in FAULTS])
def test_a_fault_while_recording_stops_the_stand(tmp_path, name):
    kind, strength, words = FAULTS[name]
    with lab(tmp_path, turns=1.0, pace=3.0, heartbeat_ms=500) as stand:
        taken = stand.take(show=stand.failing(stand.fault(kind, strength), at=0.2))
    assert re.search(words, taken.fault), taken.fault
    assert stand.since_fault is not None
    assert not taken.complete
    assert taken.fault in taken.written[0].scan.reasons
    scan = read_scan(taken.written[0].path)
    assert scan.reasons and 0.1 < scan.revolutions < 0.9
    with pytest.raises(Fault, match="in fault since"):
        stand.take("b.h5")
    assert taken.fault in reset_latched_fault(stand.recipe)


@pytest.mark.stand
def test_packets_lost_for_good_end_the_scan(tmp_path):
    def lose() -> None:
        stand.faults.begin(FaultKind.NO_RESEND)
        stand.faults.begin(FaultKind.LOSE_PACKETS, 0.5)

    with lab(tmp_path, turns=1.0, packet_size=1500) as stand:
        taken = stand.take(show=stand.failing(lose, at=0.2))
    assert "lost" in taken.fault and "profiles" in taken.fault
    assert stand.since_fault is not None
    assert read_recording(taken.written[0].path).acquisition["lost_profiles"] > 0


@pytest.mark.stand
def test_a_dead_controller_is_a_fault(tmp_path):
    with lab(tmp_path, turns=1.0, pace=3.0) as stand:
        taken = stand.take(show=stand.failing(stand.server.stop, at=0.2))
        assert not any(sensor.laser for sensor in stand.sensors)
    assert "127.0.0.1" in taken.fault
    assert not taken.complete


@pytest.mark.stand
def test_a_device_that_can_not_be_stopped_is_named_and_left_to_the_guard(tmp_path, monkeypatch):
    """The controller is silent for a moment, just when the stand has to stop."""
    real = stand_module.Station.make_safe

    def make_safe(station):
        silent = replace(station, table=replace(station.table, drive=Silent(station.table.drive)))
        failed, station.not_stopped = real(silent), silent.not_stopped
        return failed

    def interrupt() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(stand_module.Station, "make_safe", make_safe)
    with lab(tmp_path, turns=10.0, pace=1.0) as stand:
        taken = stand.take(show=stand.failing(interrupt, at=0.002))
        assert taken.not_stopped == ("Table may be turning: silent",)
        until = time.monotonic() + NOT_FOR_EVER
        while not stand.safe:
            assert time.monotonic() < until
            time.sleep(0.02)
        with pytest.raises(Fault, match=r"Table may be turning: silent; it was interrupted by the operator"):
            stand.take("b.h5")


@pytest.mark.stand
def test_without_recorded_frames_the_fault_is_reported_and_no_empty_log(tmp_path):
    with lab(tmp_path) as stand:
        stand.faults.begin(FaultKind.LATENCY, 60_000.0)
        with pytest.raises(Fault, match=r"found no profile in 3 s, .*check trigger mode.*`truestand stand reset`"):
            stand.take()
        assert stand.safe
    assert not (tmp_path / "k1.log").exists()


@pytest.mark.stand
def test_a_folder_that_vanishes_while_recording_is_a_fault(tmp_path, monkeypatch):
    import shutil

    def gone(path):
        raise FileNotFoundError(2, "No such file or directory", str(path))

    with lab(tmp_path, turns=1.0) as stand:
        taken = stand.take(show=stand.failing(lambda: monkeypatch.setattr(shutil, "disk_usage", gone), at=0.2))
        assert stand.safe
    assert "No such file" in taken.fault and not taken.complete
    assert taken.fault in reset_latched_fault(stand.recipe)


@pytest.mark.stand
def test_a_scan_that_can_not_be_written_stays_in_its_log(tmp_path, monkeypatch):
    from truestand.station import scan

    def full(*args, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(scan, "write_recording", full)
    with lab(tmp_path, turns=0.1) as stand, pytest.raises(NoSpace, match=r"what was recorded is in .*k1.log.*recover"):
        stand.take()
    assert (tmp_path / "k1.log").exists()


def test_a_stand_in_use_is_not_reset(tmp_path):
    from truestand.station.diagnostics import reset_fault
    from truestand.station.stand_lock import StandLock

    with lab(tmp_path) as stand:
        stand.table.trip("a door is open")
        held = StandLock(stand.recipe)
        with pytest.raises(DeviceError, match="another program uses this stand"):
            reset_fault(stand.recipe)
        assert stand.table.status().fault
        held.close()


def test_an_interruption_stops_the_stand_and_keeps_the_frames(tmp_path):
    def interrupt() -> None:
        raise KeyboardInterrupt

    with lab(tmp_path) as stand:
        taken = stand.take(show=stand.failing(interrupt, at=0.5))
        assert stand.safe
    assert taken.interrupted and not taken.complete
    assert taken.written[0].scan.reasons == ("it was interrupted by the operator",)
    assert state_path(stand.recipe).read_bytes() == b""


def test_a_full_disk_is_reported_before_anything_moves(tmp_path, monkeypatch):
    import shutil

    real = shutil.disk_usage
    monkeypatch.setattr(shutil, "disk_usage", lambda path: real(path)._replace(free=10_000_000))
    with lab(tmp_path) as stand:
        with pytest.raises(NoSpace, match="found 10 MB free, the scan needs"):
            stand.take()
        assert not stand.table.status().homed
    assert not (tmp_path / "k1.log").exists()


def test_an_unwritable_folder_is_reported_before_anything_moves(tmp_path):
    (tmp_path / "file").touch()
    with lab(tmp_path) as stand:
        with pytest.raises(NoSpace, match="can't be written"):
            stand.take("file/k1.h5")
        assert not stand.table.status().homed


BEYOND = {
    "speed": ("= 0.3141592653589793", "= 2.5", "found a speed of 143.239 deg/s, the table goes up to 90"),
    "stops": ("[devices.table]", "[devices.table]\nrange_deg = [-5.0, 60.0]", "found a target of 117.000 deg"),
}


@pytest.mark.parametrize("what", BEYOND)
def test_a_scan_beyond_the_limits_is_refused_before_anything_moves(tmp_path, what):
    old, new, words = BEYOND[what]
    with lab(tmp_path) as stand:
        stand.recipe.write_text(stand.recipe.read_text().replace(old, new))
        with pytest.raises(LimitExceeded, match=words):
            stand.take()
        assert not stand.table.status().homed
    assert not list(tmp_path.glob("k1*"))


@pytest.mark.stand
def test_a_table_with_stops_starts_at_its_home(tmp_path):
    with lab(tmp_path, turns=0.1) as stand:
        stand.recipe.write_text(
            stand.recipe.read_text().replace("[devices.table]", "[devices.table]\nrange_deg = [-5.0, 400.0]")
        )
        first, second = (read_recording(stand.take(name).written[0].path) for name in ("a.h5", "b.h5"))
    assert second.encoder[0] == pytest.approx(first.encoder[0], abs=100)


def test_an_encoder_without_its_counts_is_refused(tmp_path):
    with lab(tmp_path) as stand:
        stand.recipe.write_text(stand.recipe.read_text().replace("counts_per_turn = 360000", "counts_per_turn = 0"))
        with pytest.raises(BadRecipe, match=r"sensor 'front' has encoder = true, and \[scan\] counts_per_turn is 0"):
            stand.take()


@pytest.mark.stand
def test_wrong_counts_per_turn_make_the_scan_incomplete(tmp_path):
    with lab(tmp_path) as stand:
        text = stand.recipe.read_text()
        stand.recipe.write_text(text.replace("counts_per_turn = 360000", "counts_per_turn = 300000"))
        taken = stand.take()
    assert not taken.complete
    assert "counts_per_turn in stand.toml is wrong" in taken.written[0].scan.reasons[0]


@pytest.mark.stand
def test_a_sensor_that_the_encoder_triggers_is_silent_at_rest(tmp_path):
    with lab(tmp_path, turns=0.1, pace=1.0, trigger="encoder") as stand:
        taken = stand.take()
    assert taken.complete, taken.fault
    assert np.ptp(read_recording(taken.written[0].path).encoder) == pytest.approx(36_000, abs=400)


@pytest.mark.stand
def test_a_triggered_sensor_that_falls_silent_is_a_fault(tmp_path):
    with lab(tmp_path, turns=1.0, pace=1.0, trigger="encoder") as stand:
        taken = stand.take(show=stand.failing(stand.fault(FaultKind.STUCK_ENCODER), at=0.15))
    assert "sensor front has sent nothing for 0.5 s" in taken.fault
    assert stand.since_fault is not None


@pytest.mark.stand
def test_a_disk_that_fills_up_ends_the_scan_and_keeps_valid_records(tmp_path, monkeypatch):
    import os

    real, room = os.write, [0]

    def write(file, data):
        if len(data) > 300 and room[0]:
            raise OSError(28, "No space left on device")
        return real(file, data)

    monkeypatch.setattr(os, "write", write)
    with lab(tmp_path, turns=0.5) as stand:
        taken = stand.take(show=stand.failing(lambda: room.__setitem__(0, 1), at=0.4))
        assert stand.safe
    assert "No space left on device" in taken.fault
    assert not taken.complete
    assert 0.1 < read_scan(taken.written[0].path).revolutions < 0.4


def test_a_missing_sensor_is_reported_before_anything_moves(tmp_path):
    with lab(tmp_path) as stand:
        stand.faults.begin(FaultKind.UNPLUGGED)
        with pytest.raises(DeviceError, match="front"):
            stand.take()
    assert not list(tmp_path.glob("k1*"))


def test_a_stand_in_use_is_refused_to_another_program(tmp_path):
    from truestand.station.stand_lock import StandLock

    with lab(tmp_path) as stand:
        held = StandLock(stand.recipe)
        with pytest.raises(DeviceError, match="another program uses this stand"):
            stand.take()
        held.close()
