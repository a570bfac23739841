"""The scanCONTROL driver against the virtual sensor, over its sockets: what is set arrives, what it sends is read."""

import time

import numpy as np
import pytest

from patience import NOT_FOR_EVER
from recorded import RecordedSource, Steady
from truestand.core.errors import BadRecipe, DeviceError, DeviceLost
from truestand.core.stand import Sensor
from truestand.devices.gige.control import Control
from truestand.devices.layout import Unwrapper, decode
from truestand.devices.sensors import scancontrol
from truestand.devices.sensors.opening import open_sensor
from truestand.devices.sensors.recipe import SensorRecipe, profiles_per_frame
from truestand.files.checking import checked
from truestand.sim.live.clock import Clock
from truestand.sim.live.faults import FaultKind, Faults
from truestand.sim.live.gige_device import GigeDevice
from truestand.sim.live.registers import DeviceRegister, Identity

SPEED, COUNTS = 2.0, 36000
POINTS = 320
SENSOR = Sensor("front", 2000.0, POINTS)


def ramp():
    """Raw profiles of which each can be told from the others."""
    raw = np.zeros((400, 3, POINTS), np.uint16)
    raw[:, 0] = 32768 + np.arange(400)[:, None]
    raw[:, 1] = 30000 + np.arange(POINTS)
    raw[:, 0, :7] = 0
    return raw


@pytest.fixture
def stand(request):
    """A virtual sensor on an address of its own, its faults, and the recipe that opens it."""
    last = 10 + sum(map(ord, request.node.name)) % 240
    faults = Faults()
    device = GigeDevice(
        Identity(f"127.0.41.{last}", serial="V77"), RecordedSource(ramp(), Steady(SPEED)), Clock(), faults
    )
    with device:
        yield device, faults


def recipe(device, **more):
    return checked(
        SensorRecipe,
        {"name": "front", "driver": "scancontrol", "address": device.identity.address, "model": "29xx-50",
         "heartbeat_ms": 10_000, **more},
        "stand.toml",
    )  # fmt: skip


def frames_of(sensor, count):
    frames, end = [], time.monotonic() + NOT_FOR_EVER
    while len(frames) < count:
        assert time.monotonic() < end, sensor.statistics()
        frame = sensor.next_frame(0.2)
        frames += [] if frame is None else [frame]
    return frames


def test_configure_stream_and_read(stand):
    device, _ = stand
    sensor = open_sensor(recipe(device), SENSOR)
    try:
        assert sensor.identity()["serial"] == "V77" and sensor.identity()["model"] == "scanCONTROL 29xx-50"
        layout = sensor.start()
        assert (layout.points, layout.profiles, layout.rate) == (POINTS, 20, 2000.0)
        sensor.set_laser("full")
        assert device.laser == 2
        frames = frames_of(sensor, 100)
        sensor.set_laser("reduced")
        assert device.laser == 1
        sensor.stop()
        assert not device.registers.streaming
    finally:
        sensor.close()
    assert device.laser == 0 and not device.controlled
    assert [f.number for f in frames] == list(range(100)) and not any(f.missing for f in frames)
    on = Unwrapper(layout)
    read = [on.unwrap(decode(layout, f.payload)) for f in frames]
    x, z = np.vstack([p.x for p in read]), np.vstack([p.z for p in read])
    lit = 40  # the first frames were exposed before the laser was on
    assert np.isnan(z[:, :7]).all() and np.isnan(x[:, :7]).all()
    assert x[lit, 7] == pytest.approx((30007 - 32768) * 0.002) and z[lit + 1, 7] - z[lit, 7] == pytest.approx(0.002)
    counter, t = np.concatenate([p.counter for p in read]), np.concatenate([p.time for p in read])
    encoder = np.concatenate([p.encoder for p in read])
    assert (np.diff(counter) == 1).all()
    assert np.diff(t) == pytest.approx(1 / 2000.0, abs=1e-6)
    assert np.diff(encoder).sum() / COUNTS * 2 * np.pi == pytest.approx(SPEED * (t[-1] - t[0]), rel=1e-2)


def test_settings_arrive(stand):
    device, _ = stand
    sensor = open_sensor(
        recipe(device, profile_rate_hz=40.0, exposure_us=300, trigger="encoder", trigger_input="digital",
               packet_size=2000, heartbeat_ms=700), SENSOR,
    )  # fmt: skip
    try:
        assert sensor.start().profiles == 1
        value = device.registers.value
        assert (value(DeviceRegister.EXPOSURE), value(DeviceRegister.IDLE)) == (30, 2470)
        assert value(DeviceRegister.TRIGGER) == 1 << 25 | 1 << 24 | 1 << 21 | 3 << 16
        assert value(DeviceRegister.SIZE) == 3 * POINTS << 16 | 1
        assert value(0x0938) == 700 and value(0x0D04) == 2000
    finally:
        sensor.close()


def test_the_largest_packet_that_arrives_is_taken(stand):
    device, _ = stand
    sensor = open_sensor(recipe(device), SENSOR)
    try:
        sensor.start()
        assert device.registers.value(0x0D04) & 0xFFFF == 16_000, "loopback carries all"
    finally:
        sensor.close()


def test_lost_packets_are_received_again(stand):
    device, faults = stand
    faults.begin(FaultKind.LOSE_PACKETS, 0.05)
    sensor = open_sensor(recipe(device, packet_size=1500), SENSOR)
    try:
        layout = sensor.start()
        frames = frames_of(sensor, 150)
        found = sensor.statistics()
    finally:
        sensor.close()
    assert found.resent > 20
    complete = [f for f in frames if not f.missing]
    assert len(complete) >= 0.95 * len(frames)
    counter = np.concatenate([Unwrapper(layout).unwrap(decode(layout, f.payload)).counter for f in complete])
    assert (np.diff(counter) >= 1).all()


def test_without_resend_every_loss_is_counted(stand):
    device, faults = stand
    faults.begin(FaultKind.LOSE_PACKETS, 0.1)
    sensor = open_sensor(recipe(device, packet_size=1500, resend=False), SENSOR)
    try:
        layout = sensor.start()
        frames = frames_of(sensor, 60)
        found = sensor.statistics()
    finally:
        sensor.close()
    assert found.incomplete > 20 and found.resent == 0
    on = Unwrapper(layout)
    kept = sum(len(on.unwrap(decode(layout, f.payload)).counter) for f in frames)
    assert kept < 20 * len(frames), "profiles that came in part are left out"


@pytest.mark.parametrize("heartbeat_ms", [500, 1000])
@pytest.mark.parametrize("fault", [FaultKind.UNPLUGGED, FaultKind.HEARTBEAT_IGNORED])
def test_unplugged_sensor_raises_device_lost(stand, fault, heartbeat_ms):
    device, faults = stand
    sensor = open_sensor(recipe(device, heartbeat_ms=heartbeat_ms), SENSOR)
    try:
        sensor.start()
        frames_of(sensor, 10)
        faults.begin(fault)
        begun = time.monotonic()
        with pytest.raises(DeviceLost, match=r"front: .*(answer|control)"):
            while time.monotonic() < begun + NOT_FOR_EVER:
                sensor.next_frame(0.05)
        assert time.monotonic() - begun < NOT_FOR_EVER
        begun = time.monotonic()
        with pytest.raises(DeviceLost):
            sensor.set_laser("off")
        assert time.monotonic() - begun < NOT_FOR_EVER
    finally:
        begun = time.monotonic()
        sensor.close()
    assert time.monotonic() - begun < NOT_FOR_EVER


def test_garbage_and_frozen_frames_arrive_as_they_are(stand):
    device, faults = stand
    sensor = open_sensor(recipe(device), SENSOR)
    try:
        layout = sensor.start()
        frames_of(sensor, 5)
        faults.begin(FaultKind.FROZEN)
        frozen = frames_of(sensor, 20)[10:]
        faults.clear()
        faults.begin(FaultKind.GARBAGE)
        garbage = frames_of(sensor, 20)[-1]
    finally:
        sensor.close()
    assert len({f.payload for f in frozen}) == 1 and len({f.number for f in frozen}) == 10
    assert decode(layout, garbage.payload).z.shape == (20, POINTS)


def test_packets_out_of_order_give_frames_in_order(stand):
    device, faults = stand
    faults.begin(FaultKind.DISORDER)
    sensor = open_sensor(recipe(device, packet_size=1500), SENSOR)
    try:
        layout = sensor.start()
        frames = frames_of(sensor, 60)
        found = sensor.statistics()
    finally:
        sensor.close()
    assert [f.number for f in frames] == list(range(60)) and not any(f.missing for f in frames)
    assert found.duplicates > 0
    on = Unwrapper(layout)
    assert (np.diff(np.concatenate([on.unwrap(decode(layout, f.payload)).counter for f in frames])) == 1).all()


def test_slow_reader_loses_frames_and_they_are_counted(stand):
    device, _ = stand
    sensor = open_sensor(recipe(device, profile_rate_hz=10_000.0), SENSOR)
    try:
        sensor.start()
        time.sleep(1.0)
        frames = frames_of(sensor, 300)
        found = sensor.statistics()
    finally:
        sensor.close()
    numbers = [f.number for f in frames]
    assert found.overrun > 0 and found.lost >= found.overrun
    assert numbers[-1] + 1 - len(numbers) >= found.overrun > 0


def test_two_sensors_stream_at_once(stand):
    first, _ = stand
    other = Identity("127.0.41.8", serial="V78")
    with GigeDevice(other, RecordedSource(ramp(), Steady(SPEED)), Clock(), Faults()) as second:
        sensors = [open_sensor(recipe(d, profile_rate_hz=500.0), SENSOR) for d in (first, second)]
        try:
            layouts = [sensor.start() for sensor in sensors]
            frames = [frames_of(sensor, 20) for sensor in sensors]
        finally:
            for sensor in sensors:
                sensor.close()
    assert all([f.number for f in seen] == list(range(20)) for seen in frames)
    assert all(decode(layouts[i], frames[i][0].payload).counter.size == 10 for i in range(2))


def test_only_one_program_controls_a_sensor(stand, monkeypatch):
    device, _ = stand
    monkeypatch.setattr("truestand.devices.gige.control.MAX_TAKE_S", 0.5)
    first = open_sensor(recipe(device), SENSOR)
    try:
        with pytest.raises(DeviceError, match="another program"):
            open_sensor(recipe(device), SENSOR)
    finally:
        first.close()
    open_sensor(recipe(device), SENSOR).close()


def test_a_crashed_program_does_not_block_the_next(stand):
    device, _ = stand
    dead = Control("dead", device.identity.address)
    dead.take(500)
    dead._stop.set()  # as if killed: no heartbeat, nothing given back
    open_sensor(recipe(device), SENSOR).close()
    dead._controls = False
    dead.close()


def test_unreachable_sensor_is_lost():
    begun = time.monotonic()
    with pytest.raises(DeviceLost, match=r"front: nobody answers at 127\.0\.41\.9; check that it is switched on"):
        open_sensor(SensorRecipe(name="front", driver="scancontrol", address="127.0.41.9", model="29xx-50"), SENSOR)
    assert time.monotonic() - begun < NOT_FOR_EVER


def test_default_exposure_and_idle_times():
    assert [profiles_per_frame(r) for r in (1, 50, 200, 1000, 10_000)] == [1, 1, 4, 20, 20]
    assert scancontrol.times(10_000) == (5, 5) and scancontrol.times(200) == (100, 400)
    assert scancontrol.times(200, 4000) == (400, 100)
    with pytest.raises(BadRecipe, match="expose shorter"):
        scancontrol.times(1000, 1000)
    with pytest.raises(BadRecipe, match="can't go below"):
        scancontrol.times(10)
