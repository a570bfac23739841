"""Our GigE Vision client against libaravis' fake camera: control, its own GenICam nodes, its stream."""

import re
import time
from contextlib import closing

import numpy as np
import pytest

from devices.fake_camera import LIBRARY, fake_camera, library
from patience import NOT_FOR_EVER
from truestand.core.errors import DeviceError, DeviceLost
from truestand.core.stand import Sensor
from truestand.devices.gige.camera import Camera
from truestand.devices.layout import decode
from truestand.devices.sensors.opening import open_sensor
from truestand.devices.sensors.recipe import SensorRecipe

pytestmark = pytest.mark.skipif(
    library() is None, reason=f"{LIBRARY} is not installed (apt-get install libaravis-0.8-0)"
)


@pytest.fixture(scope="module")
def fake():
    with fake_camera() as running:
        yield running


@pytest.fixture
def mortal(fake):
    """The camera of a test that kills it."""
    yield fake
    fake.kill()
    fake.start()


@pytest.fixture(scope="module")
def address(fake):
    return fake.address


@pytest.fixture
def camera(address):
    opened = Camera("fake", address)
    yield opened
    opened.close()


def test_identity_of_the_camera_is_read(camera):
    found = camera.control.identity()
    assert (found["manufacturer"], found["model"], found["serial"], found["address"]) == (
        "Aravis", "Fake", "GV07", "127.0.0.1",
    )  # fmt: skip


def test_its_features_are_read_and_written(camera):
    nodes = camera.nodes
    assert nodes.get("DeviceVendorName") == "Aravis" and nodes.get("SensorWidth") == 2048
    assert "Width" in nodes.names() and nodes.has("Height") and not nodes.has("Depth")
    nodes.set("Width", 320)
    assert nodes.get("Width") == 320 and camera.control.read(0x100) == 320, "the register behind it"
    nodes.set("AcquisitionFrameRate", 200.0)
    assert camera.control.read(0x138) == 5000, "us, by the converter"
    nodes.set("PixelFormat", "Mono16")
    nodes.set("Height", 3)
    assert nodes.get("PayloadSize") in (320 * 3, 320 * 3 * 2)
    nodes.set("PixelFormat", "Mono8")
    nodes.set("TestBoolean", True)
    assert nodes.get("TestBoolean") is True


@pytest.mark.parametrize(
    ("feature", "value", "message"),
    [
        ("Widht", 1, r"no feature Widht; did you mean Width"),
        ("Width", 100_000, r"Width refused 100000 .*2048"),
        ("PixelFormat", "Mono99", r"PixelFormat refused 'Mono99' .*it knows .*Mono8"),
        ("DeviceVendorName", "us", r"DeviceVendorName refused 'us'"),
        ("Height", "tall", r"Height refused 'tall'"),
    ],
)
def test_refused_features_raise_error(camera, feature, value, message):
    with pytest.raises(DeviceError, match=message):
        camera.nodes.set(feature, value)


def test_a_feature_is_no_command_and_a_command_no_feature(camera):
    with pytest.raises(DeviceError, match="Width was refused"):
        camera.nodes.execute("Width")
    with pytest.raises(DeviceError, match="AcquisitionStart can't be read"):
        camera.nodes.get("AcquisitionStart")


@pytest.mark.parametrize(
    "seconds",
    [pytest.param(2.0, id="2s"), pytest.param(10.0, id="10s", marks=pytest.mark.slow)],
)
@pytest.mark.parametrize(("height", "rate"), [(2, 200), (2, 1000), (128, 500)])
def test_stream_arrives_and_every_loss_is_counted(camera, height, rate, seconds):
    width, nodes = 640, camera.nodes
    for feature, value in (
        ("PixelFormat", "Mono8"), ("Width", width), ("Height", height), ("AcquisitionFrameRate", float(rate)),
        ("ExposureTimeAbs", 10_000.0), ("GainRaw", 0),
    ):  # fmt: skip
        nodes.set(feature, value)
    camera.start_stream(width * height, width)
    frames, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        frame = camera.next_frame(0.2)
        frames += [] if frame is None else [frame]
    camera.stop()
    found = camera.statistics()
    lost = frames[-1].number + 1 - len(frames)
    assert lost <= found.lost and found.malformed == found.foreign == 0
    assert lost + sum(f.missing > 0 for f in frames) <= 0.01 * len(frames), found
    assert len(frames) > 0.1 * rate * seconds, "it may be slower than asked, on a busy machine"
    first = np.frombuffer(frames[0].payload, np.uint8).reshape(height, width)
    start = int(first[0, 0])
    for frame in frames:
        if not frame.missing:
            image = np.frombuffer(frame.payload, np.uint8).reshape(height, width)
            ramp = (np.arange(width) + np.arange(height)[:, None] + start + frame.number) % 255
            shift = (int(image[0, 0]) - ramp[0, 0]) % 255
            assert np.array_equal(image, (ramp + shift) % 255)
            assert shift == 0 or frame.number > 500, "the pattern jumps only where its 16 bit block id starts again"


def test_the_range_camera_driver_reads_it(address):
    recipe = SensorRecipe(
        name="front", driver="range-camera", address=address, x_first_mm=-10.0, x_step_mm=0.05, z_step_mm=0.01,
        resend=False,
    )  # fmt: skip
    with closing(Camera("before", address)) as other:
        other.nodes.set("Width", 400)
        other.nodes.set("Height", 2)
        other.nodes.set("AcquisitionFrameRate", 200.0)
    sensor = open_sensor(recipe, Sensor("front", 400.0, 400))
    try:
        layout = sensor.start()
        assert (layout.kind, layout.points, layout.profiles, layout.model) == ("range-camera", 400, 2, "Fake")
        frame = next(f for f in iter(lambda: sensor.next_frame(0.5), 0) if f is not None)
        profiles = decode(layout, frame.payload)
        assert profiles.x.shape == (2, 400)
        sensor.set_laser("full")
        sensor.stop()
    finally:
        sensor.close()
    with pytest.raises(DeviceError, match=r"found 400 columns, need the 640 points"):
        wrong = open_sensor(recipe, Sensor("front", 400.0, 640))
        try:
            wrong.start()
        finally:
            wrong.close()


def test_killed_camera_is_lost(mortal, camera, address):
    camera.nodes.set("AcquisitionFrameRate", 100.0)
    camera.nodes.set("PixelFormat", "Mono8")
    width, height = camera.nodes.get("Width"), camera.nodes.get("Height")
    camera.start_stream(width * height, width, resend=False)
    assert camera.next_frame(NOT_FOR_EVER) is not None
    mortal.kill()
    begun = time.monotonic()
    with pytest.raises(DeviceLost, match=re.escape(address)):
        while time.monotonic() < begun + NOT_FOR_EVER:
            camera.next_frame(0.1)
    assert time.monotonic() - begun < NOT_FOR_EVER
