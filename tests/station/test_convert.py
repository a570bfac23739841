"""From a log to scans: complete only where proven, and with the angles that the table had."""

from math import radians, tau

import numpy as np
import pytest

from truestand.core.errors import NotEnoughData, UnreadableFile
from truestand.core.stand import Sensor, Stand, Table
from truestand.devices.layout import encode_plain
from truestand.devices.sensor import Layout, Profiles
from truestand.files.recipes.recipes import stand_recipe
from truestand.files.scans.scan_log import INCOMPLETE, TABLE, Kind, LogWriter
from truestand.station.convert import convert
from truestand.station.log import SensorPlan, begin_record, load_log
from truestand.station.recipe import ScanSettings
from truestand.station.scan import write_scans

COUNTS = 360_000
REST = 0.3


def recorded(
    path,
    rate=200.0,
    speed=18.0,
    turns=0.25,
    counts=COUNTS,
    lost=(),
    names=("front",),
    silent=(),
    encoder=True,
    late=0.0,
    hurried=0.0,
    coming=0.0,
):
    """A log as ``acquire`` writes it: rest, a turn at ``speed`` (deg/s), rest; ``lost``: profiles that never came.

    ``counts``: what the encoder really gives for a turn; ``late``: s by which frames come later from the middle on,
    ``hurried``: sooner before the table turns; ``coming``: s of its frames in which the table still came to its start.
    """
    settings = ScanSettings(turns, radians(speed), radians(speed), 0.001)
    layout = Layout("plain", "test", 2, 1, rate)
    plans = tuple(SensorPlan(name, layout, encoder) for name in names)
    stand = Stand(Table(settings.speed), tuple(Sensor(name, rate, 2) for name in names), counts_per_turn=COUNTS)
    end = REST + settings.duration

    def angle(time):
        return np.clip((time - REST) * settings.speed, 0.0, settings.travel)

    def seen_angle(time):
        return angle(time) + np.minimum(time - coming, 0.0) * settings.speed

    with LogWriter(path) as log:
        log.append_json(Kind.BEGIN, begin_record(stand_recipe(stand), settings, plans, "now", "test"), 0.0)
        for time in np.arange(0.0, end + 0.05, 0.02).tolist():
            log.append(Kind.TABLE, TABLE.pack(angle(time), 1e-4, REST <= time < end), time)
        for i in range(int((end + REST) * rate)):
            time = np.array([i / rate])
            arrived = i / rate + 1e-3 + late * (i / rate > end / 2) - hurried * (i / rate < REST)
            seen = Profiles(np.zeros((1, 2)), np.ones((1, 2)), np.array([i]), time,
                            np.rint(seen_angle(time) / tau * counts).astype(np.int64))  # fmt: skip
            for source in range(len(names)):
                if i not in lost and names[source] not in silent:
                    log.append(Kind.FRAME, encode_plain(seen), arrived, source, i)
        log.append_json(Kind.END, {"complete": True, "reasons": []}, end)
    return path


def only(path):
    (scan,) = convert(load_log(path))
    return scan


@pytest.mark.parametrize("rate, speed", [(200.0, 18.0), (200.0, 86.0), (30.0, 90.0), (7.0, 18.0)])
def test_a_whole_scan_is_complete_at_any_distance_of_its_profiles(tmp_path, rate, speed):
    for i, turns in enumerate(np.linspace(0.25, 0.26, 9)):
        scan = only(recorded(tmp_path / f"k{i}.log", rate, speed, float(turns)))
        assert scan.complete, scan.reasons


@pytest.mark.parametrize("first", [215, 700, 1255])
def test_profiles_lost_at_the_ends_of_the_scan_are_counted(tmp_path, first):
    """The scan goes from profile 260 to 1260; 100 lost profiles reach into it."""
    scan = only(recorded(tmp_path / "k1.log", lost=range(first, first + 100)))
    assert not scan.complete
    assert scan.recording.acquisition["lost_profiles"] == 100


@pytest.mark.parametrize("counts, complete", [(COUNTS, True), (300_000, False), (COUNTS + 10_000, False)])
def test_a_scan_is_incomplete_where_encoder_and_table_differ_in_travel(tmp_path, counts, complete):
    scan = only(recorded(tmp_path / "k1.log", turns=1.0, counts=counts))
    assert scan.complete == complete, scan.reasons
    assert complete or "deg where the table turned 387.0: counts were lost, or counts_per_turn" in scan.reasons[0]


def test_frames_from_when_the_table_still_came_to_its_start_do_not_move_the_angles(tmp_path):
    """They were under way, or not yet full, when the recording began."""
    late, early = (only(recorded(tmp_path / name, coming=coming)) for name, coming in (("a.log", 0.12), ("b.log", 0.0)))
    assert late.complete, late.reasons
    assert np.array_equal(late.recording.angle, early.recording.angle)
    assert np.array_equal(late.recording.time, early.recording.time)


@pytest.mark.parametrize("late, complete", [(0.0, True), (0.01, True), (0.05, False)])
def test_a_scan_is_incomplete_where_the_clocks_jump(tmp_path, late, complete):
    scan = only(recorded(tmp_path / "k1.log", encoder=False, late=late))
    assert scan.complete == complete, scan.reasons
    assert complete or "the clocks of sensor and host left their line by 42 ms, 0.8 deg" in scan.reasons[0]


def test_clocks_that_jump_at_rest_leave_the_scan_complete(tmp_path):
    scan = only(recorded(tmp_path / "k1.log", encoder=False, turns=1.0, hurried=0.08))
    assert scan.complete, scan.reasons
    true = (scan.recording.time - REST) * radians(18.0)
    assert np.abs(scan.recording.angle - true).max() < radians(0.1)


def test_angles_by_even_clocks_are_the_table_s_but_for_the_transport_delay(tmp_path):
    """The transport delay of a frame remains, 1 ms here: it can't be told from a table that is late."""
    recording = only(recorded(tmp_path / "k1.log", encoder=False, turns=2.75)).recording
    true = (recording.time - REST) * radians(18.0)
    assert np.abs(recording.angle - true - 1e-3 * radians(18.0)).max() < 1e-6


def test_the_travel_is_not_compared_where_the_stream_ends_before_the_table_rests(tmp_path):
    """As where the encoder triggers the sensor, or its last frames are late."""
    scan = only(recorded(tmp_path / "k1.log", turns=1.0, lost=range(4340, 9999)))
    assert scan.complete, scan.reasons


def test_the_file_of_one_of_two_sensors_carries_its_name_though_the_other_is_silent(tmp_path):
    log = recorded(tmp_path / "k1.log", names=("front", "back"), silent=("back",))
    assert [w.path.name for w in write_scans(convert(load_log(log)), tmp_path / "k1.h5")] == ["k1-front.h5"]


def test_a_log_without_a_whole_profile_is_refused(tmp_path):
    path = tmp_path / "k1.log"
    settings = ScanSettings(1.0, 0.1, 0.1, 0.001)
    plan = SensorPlan("front", Layout("scancontrol", "29xx-50", 8, 4, 200.0, 1 << 24, 128.0, 1 << 15), encoder=True)
    with LogWriter(path) as log:
        log.append_json(Kind.BEGIN, begin_record(stand_recipe(Stand()), settings, (plan,), "now", "test"), 0.0)
        log.append(Kind.FRAME, bytes(plan.layout.frame_bytes), 0.1, flags=INCOMPLETE)
    with pytest.raises(NotEnoughData, match="no whole profile"):
        convert(load_log(path))


def test_a_file_of_two_logs_is_refused(tmp_path):
    one, two = recorded(tmp_path / "a.log"), recorded(tmp_path / "b.log")
    one.write_bytes(one.read_bytes() + two.read_bytes())
    with pytest.raises(UnreadableFile, match="found two recordings"):
        load_log(one)


@pytest.mark.parametrize("change", [{"kind": "hologram"}, {"points": 0}, {"rate": "fast"}, {"depth": 3}])
def test_a_layout_of_another_version_is_refused_with_that_version(tmp_path, change):
    path = tmp_path / "k1.log"
    plan = SensorPlan("front", Layout("plain", "test", 2, 1, 100.0), encoder=False)
    begin = begin_record(stand_recipe(Stand()), ScanSettings(1.0, 0.1, 0.1, 0.001), (plan,), "now", "truestand 99")
    begin["sensors"][0]["layout"].update(change)
    with LogWriter(path) as log:
        log.append_json(Kind.BEGIN, begin, 0.0)
    with pytest.raises(UnreadableFile, match=r"another version \(truestand 99\)"):
        convert(load_log(path))
