"""Layouts, the replay of recorded scans, the range camera's numbers, and the keys of ``[[devices.sensor]]``."""

import numpy as np
import pytest

from truestand.core.errors import BadRecipe, DeviceError, UnreadableFile
from truestand.core.stand import Sensor
from truestand.devices.layout import Unwrapper, decode, encode_plain
from truestand.devices.sensor import Layout, Profiles
from truestand.devices.sensors.opening import open_sensor
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.devices.sensors.replay import Replay
from truestand.files.checking import checked

LONG = "profile,point,x_mm,z_mm,encoder,counter,time_s\n"


def scan_file(folder, profiles=12, points=9, columns=True):
    """A long CSV; one point of each profile is not seen."""
    lines = [LONG if columns else "profile,point,x_mm,z_mm\n"]
    for i in range(profiles):
        for j in range(points):
            z = "" if j == 3 else f"{90 + 0.01 * i + 0.001 * j:.4f}"
            more = f",{100 + 7 * i},{5 + i + (i > 4)},{0.005 * i}" if columns else ""
            lines.append(f"{i},{j},{j - 4}.5,{z}{more}\n")
    (folder / "scan.csv").write_text("".join(lines))
    return str(folder / "scan.csv")


def replay(file, clock=None, **more):
    recipe = SensorRecipe(name="front", driver="replay", file=file, **more)
    if clock is None:
        return open_sensor(recipe, Sensor("front", 200.0))
    return Replay(recipe, Sensor("front", 200.0), clock.now, clock.sleep)


class Hands:
    """A clock that only sleep moves."""

    time = 100.0

    def now(self):
        return self.time

    def sleep(self, seconds):
        self.time += seconds


def test_a_replay_gives_what_the_file_holds(tmp_path):
    sensor = replay(scan_file(tmp_path), pace=0)
    layout = sensor.start()
    assert (layout.kind, layout.points, layout.profiles) == ("plain", 9, 4)
    frames = [sensor.next_frame(0.0) for _ in range(3)]
    assert sensor.next_frame(0.0) is None, "the file has ended"
    assert [f.number for f in frames] == [0, 1, 2] and sensor.statistics().frames == 3
    on = Unwrapper(layout)
    read = [on.unwrap(decode(layout, f.payload)) for f in frames]
    z = np.vstack([p.z for p in read])
    assert z[11, 8] == 90.118 and np.isnan(z[:, 3]).all() and read[0].x[0, 0] == -4.5
    assert np.concatenate([p.encoder for p in read]).tolist() == [100 + 7 * i for i in range(12)]
    assert np.concatenate([p.counter for p in read]).tolist() == [5 + i + (i > 4) for i in range(12)], "its gap too"
    assert np.concatenate([p.time for p in read]) == pytest.approx(0.005 * np.arange(12))
    sensor.close()


def test_replay_without_columns_has_none(tmp_path):
    sensor = replay(scan_file(tmp_path, columns=False), pace=0)
    profiles = decode(sensor.start(), sensor.next_frame(0.0).payload)
    assert profiles.counter is None and profiles.time is None and profiles.encoder is None


@pytest.mark.parametrize(("pace", "seconds"), [(1.0, 0.02), (10.0, 0.002)])
def test_a_replay_keeps_its_pace(tmp_path, pace, seconds):
    hands = Hands()
    sensor = replay(scan_file(tmp_path), hands, pace=pace)
    sensor.start()
    assert sensor.next_frame(0.001) is None, "4 profiles at 200/s take 20 ms"
    moments = [sensor.next_frame(1.0).received for _ in range(3)]
    assert np.array(moments) - 100.0 == pytest.approx(seconds * np.arange(1, 4))
    before = hands.time
    assert sensor.next_frame(0.5) is None and hands.time == before + 0.5
    sensor.stop()
    assert sensor.next_frame(0.5) is None
    assert sensor.start().profiles == 4 and sensor.next_frame(1.0).number == 0, "from the beginning"


def test_prime_number_of_profiles_is_replayed_one_by_one(tmp_path):
    assert replay(scan_file(tmp_path, profiles=13), pace=0).start().profiles == 1


def test_replay_without_file_or_rate_is_refused(tmp_path):
    with pytest.raises(UnreadableFile, match=r"gone\.csv"):
        replay(str(tmp_path / "gone.csv"))
    with pytest.raises(BadRecipe, match="profile_rate_hz"):
        open_sensor(SensorRecipe(name="front", driver="replay", file=scan_file(tmp_path)), Sensor("front"))


def test_a_range_camera_counts_from_its_scale():
    layout = Layout("range-camera", "any", 8, 2, 100.0, scale=(-2.0, 0.5, 150.0, -0.01))
    raw = np.arange(16, dtype="<u2").reshape(2, 8)
    profiles = decode(layout, raw.tobytes())
    assert np.isnan(profiles.z[0, 0]) and np.isnan(profiles.x[0, 0]), "raw 0 is no data"
    assert profiles.z[1, 7] == pytest.approx(149.85) and profiles.x[1] == pytest.approx(-2 + 0.5 * np.arange(8))
    assert profiles.counter is None and Unwrapper(layout).unwrap(profiles).z.shape == (2, 8)


def stamped(counter, seconds, encoder, points=8):
    """A scanCONTROL profile by the vendor's own description."""
    raw = np.full(3 * points, 40000, "<u2")
    row = bytearray(raw.tobytes())
    ticks = round(seconds * 8000) << 12
    stamp = ticks % (1 << 32)
    whole, rest = divmod(ticks >> 12, 8000)
    stamp = (whole % 128) << 25 | rest << 12
    row[-16:] = (
        b"\0" + (counter % (1 << 24)).to_bytes(3, "big") + stamp.to_bytes(4, "big")
        + (2 * encoder % (1 << 16)).to_bytes(2, "big") + b"\0\0" + stamp.to_bytes(4, "big")
    )  # fmt: skip
    return bytes(row)


SCANCONTROL = Layout("scancontrol", "29xx-50", 8, 2, 1000.0, 1 << 24, 128.0, 1 << 15)


def test_stamps_go_on_over_their_moduli_from_frame_to_frame():
    counts = [(1 << 24) - 3 + i for i in range(6)]
    times = [127.998 + i / 1000 for i in range(6)]
    encoders = [3 - 2 * i for i in range(6)]
    on, counter, time, encoder = Unwrapper(SCANCONTROL), [], [], []
    for i in (0, 2, 4):
        payload = b"".join(stamped(counts[k], times[k], encoders[k]) for k in (i, i + 1))
        profiles = on.unwrap(decode(SCANCONTROL, payload))
        counter += profiles.counter.tolist()
        time += profiles.time.tolist()
        encoder += profiles.encoder.tolist()
    assert counter == counts and time == pytest.approx(times) and encoder == encoders


def test_incomplete_profile_is_left_out_and_leaves_a_gap_in_the_counter():
    payload = stamped(7, 1.0, 5) + bytes(48)
    raw = decode(SCANCONTROL, payload)
    assert raw.counter.tolist() == [7, -1] and np.isnan(raw.z[1]).all()
    on = Unwrapper(SCANCONTROL)
    assert on.unwrap(raw).counter.tolist() == [7]
    assert len(on.unwrap(decode(SCANCONTROL, bytes(96))).x) == 0
    assert on.unwrap(decode(SCANCONTROL, stamped(10, 1.003, 6) * 2)).counter[0] == 10


def test_without_encoder_there_is_no_column():
    layout = Layout("scancontrol", "29xx-50", 8, 2, 1000.0, 1 << 24, 128.0)
    assert decode(layout, stamped(1, 0, 9) * 2).encoder is None


def test_the_middle_of_an_exposure_over_the_start_of_the_clock():
    row = bytearray(stamped(1, 127.999, 0))
    row[-4:] = stamped(1, 0.001, 0)[-4:]
    time = decode(SCANCONTROL, bytes(row) * 2).time[0]
    assert min(time, 128 - time) < 1e-4


def test_a_payload_of_another_size_is_refused():
    with pytest.raises(DeviceError, match="found a frame of 95 bytes, need 96"):
        decode(SCANCONTROL, bytes(95))
    with pytest.raises(DeviceError, match="without its scale"):
        decode(Layout("range-camera", "any", 8, 1, 100.0), bytes(16))


def test_plain_frames_keep_every_bit():
    rng = np.random.default_rng(0)
    made = Profiles(rng.normal(size=(3, 5)), rng.normal(size=(3, 5)), np.array([1, 2, 1 << 40]))
    found = decode(Layout("plain", "replay", 5, 3, 100.0), encode_plain(made))
    assert np.array_equal(found.x, made.x) and np.array_equal(found.z, made.z)
    assert found.counter.tolist() == made.counter.tolist() and found.time is None


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"driver": "scancontrol", "model": "29xx-50"}, "stand.toml: driver scancontrol needs the key address"),
        ({"driver": "scancontrol", "address": "10.0.0.5"}, "driver scancontrol needs the key model"),
        (
            {"driver": "scancontrol", "address": "10.0.0.5", "model": "99-1"},
            "stand.toml: model: found scanCONTROL type '99-1'",
        ),
        (
            {"driver": "scancontrol", "address": "10.0.0.5", "model": "29xx-50", "laser": "none"},
            "stand.toml: laser: found none",
        ),
        ({"driver": "scancontrol", "address": "it", "model": "29xx-50"}, "address: found 'it'; expected 4 octets"),
        ({"driver": "range-camera", "address": "10.0.0.5", "z_step_mm": 0.01}, "needs the key x_step_mm"),
        ({"driver": "replay"}, "driver replay needs the key file"),
        ({"driver": "laser"}, "driver: found 'laser'"),
        ({"driver": "replay", "file": "a", "adress": "b"}, "unknown key 'adress'; did you mean 'address'?"),
        ({"driver": "replay", "file": "a", "heartbeat_ms": 20}, "heartbeat_ms: found 20"),
    ],
)
def test_wrong_keys_are_named(keys, message):
    with pytest.raises(BadRecipe) as told:
        checked(SensorRecipe, {"name": "front", **keys}, "stand.toml")
    assert message in str(told.value)


def test_rate_and_points_come_from_the_sensor_or_the_recipe():
    recipe = SensorRecipe(name="front", driver="scancontrol", address="10.0.0.5", model="29xx-50", points=320)
    assert recipe.shape(Sensor("front", 100.0, 640)) == (320, 100.0)
    with pytest.raises(BadRecipe, match="'profile_rate_hz' is missing"):
        recipe.shape(Sensor("front", None, 640))
