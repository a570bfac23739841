"""The virtual stand as a whole: what its sensor sees is where its table is; the command that serves it."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import replace
from math import radians, tau

import numpy as np
import pytest

from patience import NOT_FOR_EVER
from truestand.core.errors import BadRecipe, DeviceError
from truestand.core.stand import Sensor
from truestand.devices.sensors.opening import open_sensor
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.devices.tables.opening import open_table
from truestand.devices.tables.recipe import TableRecipe
from truestand.files.scans.scancontrol import decode_container, unwrap_encoder
from truestand.sim import Optics, Simulation, paper_shaft, paper_stand
from truestand.sim.live.faults import FaultKind
from truestand.sim.live.stand import SensorEndpoint, virtual_stand
from truestand.sim.sensor_model import SensorModel

COUNTS = 360_000
EXACT = Simulation(optics=Optics(noise=0.0))
NET = f"127.38.{os.getpid() % 250}"
"""Addresses of this process: the port is fixed, and tests run side by side."""
RECIPE = f"""
[table]
speed_rad_per_s = 1.0
[[sensor]]
name = "front"
profile_rate_hz = 200.0
points = 640
[scan]
counts_per_turn = 36000
[devices.table]
protocol = "modbus"
address = "{NET}.9:0"
[[devices.sensor]]
name = "front"
driver = "scancontrol"
address = "{NET}.9"
model = "LLT2950-50"
"""


def stand(direction="ccw"):
    base = paper_stand()
    return replace(base, table=replace(base.table, direction=direction), counts_per_turn=COUNTS)


def virtual(last, direction="ccw", protocol="modbus", **more):
    place = SensorEndpoint("front", f"{NET}.{last}")
    table = TableRecipe(protocol=protocol, address=f"{NET}.{last}:0")
    return virtual_stand(stand(direction), EXACT, paper_shaft(), table, [place], **more)


def sensor_at(last):
    recipe = SensorRecipe(
        name="front", driver="scancontrol", address=f"{NET}.{last}", model="29xx-50", heartbeat_ms=10_000
    )
    return open_sensor(recipe, Sensor("front", 200.0, 640))


def seen(sensor, enough):
    """z (N, M) mm, encoder (N,) counts, counter (N,) of what comes until it is ``enough``."""
    frames, until = [], time.monotonic() + NOT_FOR_EVER
    while time.monotonic() < until:
        frame = sensor.next_frame(NOT_FOR_EVER)
        assert frame is not None
        frames.append(decode_container(frame.payload, 640, "29xx-50"))
        z = np.concatenate([f.z for f in frames])
        encoder, counter = (np.concatenate([getattr(f.stamps, n) for f in frames]) for n in ("encoder", "counter"))
        if enough(z, unwrap_encoder(encoder)):
            return z, unwrap_encoder(encoder), counter
    raise AssertionError("what was waited for didn't come")


def turned(share):
    return lambda z, encoder: encoder[-1] - encoder[0] > share * COUNTS


def stands(shaft_moves):
    """The encoder over 60 profiles, and the shaft does or does not."""

    def enough(z, encoder):
        last = slice(-60, None)
        return len(z) > 60 and np.ptp(encoder[last]) == 0 and shaft_moves(np.nanmax(np.ptp(z[last], axis=0)))

    return enough


@pytest.mark.parametrize(("last", "direction", "protocol"), [(1, "ccw", "modbus"), (2, "cw", "zaber")])
def test_the_sensor_sees_the_shaft_where_the_table_has_turned_it(last, direction, protocol):
    with virtual(last, direction, protocol, pace=4.0) as made:
        where = made.addresses()[0].split()[-1]
        table = open_table(TableRecipe(protocol=protocol, address=where, timeout_s=NOT_FOR_EVER))
        sensor = sensor_at(last)
        try:
            table.home()
            sensor.set_laser("full")
            sensor.start()
            table.start_move(100.0, radians(80.0))
            z, encoder, counter = seen(sensor, turned(1 / 3))
        finally:
            sensor.close()
            table.close()
    assert np.all(np.diff(counter) == 1)
    sign = 1.0 if direction == "ccw" else -1.0
    caster = SensorModel(stand(direction), EXACT, paper_shaft(), None, np.random.default_rng(0))
    drawn = caster.profiles(sign * encoder / COUNTS * tau)[1]
    off = np.abs(z - drawn)
    assert np.nanquantile(off, 0.999) < 0.0045, "one step of the virtual optics; a count may tip a ray over an edge"
    assert np.isfinite(z).mean() > 0.7


@pytest.mark.parametrize(("last", "protocol"), [(6, "grbl"), (7, "opcua")])
def test_the_other_protocols_are_served_too(last, protocol):
    address = f"{NET}.{last}:0" if protocol == "grbl" else f"opc.tcp://{NET}.{last}:48400"
    place = SensorEndpoint("front", f"{NET}.{last}")
    recipe = TableRecipe(protocol=protocol, address=address)
    with virtual_stand(stand(), EXACT, paper_shaft(), recipe, [place]) as made:
        where = made.addresses()[0].split()[-1]
        assert f"{NET}.{last}" in where
        table = open_table(TableRecipe(protocol=protocol, address=where, timeout_s=NOT_FOR_EVER))
        assert not table.state().moving
        table.close()


def test_faults_of_the_table_reach_the_sensor():
    with virtual(3) as made:
        sensor = sensor_at(3)
        try:
            sensor.set_laser("full")
            sensor.start()
            made.table.turn(1.0)
            seen(sensor, turned(0.01))
            made.begin(FaultKind.STUCK_ENCODER)
            seen(sensor, stands(lambda moved: moved > 0.01))
            made.begin(FaultKind.NONE)
            seen(sensor, turned(0.01))
            made.begin(FaultKind.STALLED_TABLE)
            *_, counter = seen(sensor, stands(lambda moved: moved < 0.001))
            assert np.all(np.diff(counter) > 0), "the sensor goes on"
        finally:
            sensor.close()


def test_stand_that_can_not_be_served_is_refused():
    for place, table, match in (
        (SensorEndpoint("front", "192.168.1.5"), f"{NET}.4:0", "127.0.0.x"),
        (SensorEndpoint("front", f"{NET}.4"), "10.0.0.1:502", "127.0.0.x"),
        (SensorEndpoint("front", f"{NET}.4", "gocator"), f"{NET}.4:0", "29xx-50"),
    ):
        with pytest.raises(BadRecipe, match=match):
            virtual_stand(
                stand(), EXACT, paper_shaft(), TableRecipe(protocol="modbus", address=table), [place]
            )  # fmt: skip
    with virtual(5) as made:
        with pytest.raises(DeviceError, match=f"{NET}.5:3956"):
            virtual(5).start()
        with pytest.raises(BadRecipe, match="no part"):
            made.mount(True)
        assert made.truth().table_from_sensor.shape == (4, 4)


def tried_until(last, answers):
    """Opens the sensor again and again, until it answers or until it does not."""
    until = time.monotonic() + NOT_FOR_EVER
    while time.monotonic() < until:
        try:
            with closing(sensor_at(last)) as sensor:
                assert sensor.identity()["model"] == "LLT2950-50"
        except DeviceError:
            answered = False
        else:
            answered = True
        if answered is answers:
            return
    raise AssertionError(f"the sensor never {'answered' if answers else 'fell silent'}")


@pytest.mark.parametrize(("faults", "answers"), [(["unplugged@0.1"], False), (["unplugged@0", "none@0.1"], True)])
def test_command_serves_until_sigterm(tmp_path, faults, answers):
    (tmp_path / "stand.toml").write_text(RECIPE)
    command = [
        sys.executable, "-W", "error", "-m", "truestand", "stand", "simulate", "stand.toml", "--truth", "truth.json",
        *(word for fault in faults for word in ("--fault", fault)),
    ]  # fmt: skip
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            ready = process.stdout.readline()
            assert ready.startswith(f"ready · table modbus {NET}.9:")
            assert ready.endswith(f"sensor front {NET}.9:3956\n")
            tried_until(9, answers)
        finally:
            process.send_signal(signal.SIGTERM)
            rest, complaints = process.communicate(timeout=NOT_FOR_EVER)
    assert (process.returncode, rest, complaints) == (0, "", "")
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth["shaft"]["eccentricity_um"] == pytest.approx(878.9)


def test_command_refuses_an_unknown_fault(tmp_path):
    from command import run

    (tmp_path / "stand.toml").write_text(RECIPE)
    done = run("stand", "simulate", "stand.toml", "--fault", "fire@2", cwd=tmp_path)
    assert done.returncode == 2
    assert "KIND@SECONDS" in done.stderr
