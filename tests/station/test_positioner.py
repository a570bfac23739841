"""A sensor that a positioner carries from view to view, over the real protocols, and what can go wrong on the way."""

import re
import subprocess
import sys
import threading
import time
from math import degrees, radians
from types import SimpleNamespace

import numpy as np
import pytest

from patience import NOT_FOR_EVER
from positioned import AT, SWEPT, positioned_lab
from truestand.cli.simulate import _endpoints
from truestand.core.errors import BadRecipe, Fault
from truestand.devices.positioner import Positioner
from truestand.files.scans.read import read_scan
from truestand.sim.live.faults import FaultKind
from truestand.station.diagnostics import ask_devices, reset_fault
from truestand.station.recipe import read_devices, stops_of
from truestand.station.route import Route
from truestand.station.stand_lock import state_path

LONGEST_STOP_S = 1.0


def test_each_view_is_scanned_from_its_place(tmp_path):
    with positioned_lab(tmp_path) as stand:
        taken = stand.take("k.h5")
        assert stand.safe
        stood = stand.positioner.position
    assert taken.complete and not taken.fault
    assert [w.path.name for w in taken.written] == ["k-front.h5", "k-rear.h5"]
    scans = [read_scan(w.path) for w in taken.written]
    assert [scan.view for scan in scans] == ["front", "rear"]
    assert [tuple(p.value for p in scan.stand.sensor.position) for scan in scans] == [
        pytest.approx((lift, radians(swivel))) for lift, swivel in AT.values()
    ]
    assert stood[0] == pytest.approx(20.0, abs=0.02) and degrees(stood[1]) == pytest.approx(-20.0, abs=0.02)
    front, rear = (np.nanmedian(scan.z) for scan in scans)
    assert front == pytest.approx(rear, abs=8.0) and not np.array_equal(scans[0].z, scans[1].z)
    assert not list(tmp_path.glob("*.log")) and state_path(stand.recipe).read_bytes() == b""


@pytest.mark.stand
def test_one_view_is_scanned_alone(tmp_path):
    with positioned_lab(tmp_path) as stand:
        taken = stand.take("k.h5", views=["rear"])
    assert [w.path.name for w in taken.written] == ["k.h5"] and read_scan(taken.written[0].path).view == "rear"


REFUSED = {
    "collision": ({"plan": "[[plan.keep_out]]\nheight_mm = [33.0, 35.0]"}, "no clear way to the place of front"),
    "collision later": (
        {"at": {"front": (20.0, 20.0), "rear": (150.0, 0.0)}, "plan": "[[plan.keep_out]]\nheight_mm = [110.0, 115.0]"},
        "no clear way to the place of rear",
    ),
    "limit": ({"at": {"front": (20.0, 20.0), "rear": (20.0, -50.0)}}, "rear needs axis swivel at -50.000 deg"),
    "nothing said of what turns": ({"swept": ""}, "no swept, need what turns"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_way_that_can_not_be_is_refused_before_anything_moves(tmp_path, why):
    how, words = REFUSED[why]
    with positioned_lab(tmp_path, **how) as stand:
        before = stand.positioner.position
        with pytest.raises(BadRecipe, match=words):
            stand.take("k.h5")
        assert stand.positioner.position == before and not stand.table.status().homed and stand.safe
    assert not list(tmp_path.glob("*.h5")) and not list(tmp_path.glob("*.log"))


def _begin_when(condition, begin, stand, times):
    """In a thread: ``begin`` once something is so, and how long the stand then goes on."""

    def watch() -> None:
        while not condition():
            time.sleep(0.002)
        since = time.monotonic()
        begin()
        while time.monotonic() - since < 10.0:
            if stand.safe and time.monotonic() - since > 0.05:
                times.append(time.monotonic() - since)
                return
            time.sleep(0.005)

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    return thread


def _on_the_way(stand):
    """Both axes are homed, and the lift goes up."""
    return lambda: stand.positioner.axes[1].status().homed and stand.positioner.position[0] > 2.0


FAULTS = {
    "stalled": (
        lambda stand: stand.faults.begin(FaultKind.STALLED_AXIS),
        "axis lift at .*: it stands still at .* while moving to 20.000 mm",
    ),
    "unplugged": (lambda stand: stand.axis_servers[0].stop(), "axis lift at .* (no answer|the connection|refused)"),
    "limit switch": (lambda stand: stand.positioner.axes[0].trip("limit switch"), "axis lift at .* while moving"),
}
IN_EVERY_RUN = "limit switch"


@pytest.mark.parametrize("name", [n if n == IN_EVERY_RUN else pytest.param(n, marks=pytest.mark.stand) for n in FAULTS])
def test_a_fault_on_the_way_stops_all_and_stays(tmp_path, name):
    begin, words = FAULTS[name]
    times: list[float] = []
    with positioned_lab(tmp_path, pace=1.0, axis="stop_timeout_s = 2.0") as stand:
        watching = _begin_when(_on_the_way(stand), lambda: begin(stand), stand, times)
        with pytest.raises(Fault, match=words):
            stand.take("k.h5")
        watching.join()
        assert stand.safe
        with pytest.raises(Fault, match="in fault since"):
            stand.take("k.h5")
    assert times and times[0] < LONGEST_STOP_S


@pytest.mark.stand
@pytest.mark.parametrize("name", ["unplugged", "limit switch"])
def test_a_positioner_that_fails_while_a_scan_is_recorded_stops_the_stand(tmp_path, name):
    with positioned_lab(tmp_path, pace=2.0, turns=0.5) as stand:
        taken = stand.take("k.h5", show=stand.failing(lambda: FAULTS[name][0](stand), at=0.2))
        assert stand.safe
    assert re.search("axis lift at|positioner: axis lift", taken.fault), taken.fault
    assert not taken.complete and len(taken.written) == 1
    assert stand.since_fault is not None and stand.since_fault < LONGEST_STOP_S


@pytest.mark.skipif(sys.platform == "win32", reason="kill -9 is of POSIX")
@pytest.mark.stand
def test_killed_on_the_way_the_guard_stops_the_positioner(tmp_path):
    with positioned_lab(tmp_path, pace=0.3) as stand:
        command = [sys.executable, "-m", "truestand", "acquire", "--stand", str(stand.recipe), "--quiet"]
        process = subprocess.Popen([*command, "--output", str(tmp_path / "k.h5")], stdin=subprocess.DEVNULL)
        while not _on_the_way(stand)():
            assert process.poll() is None
            time.sleep(0.002)
        process.kill()
        killed = time.monotonic()
        while not stand.safe:
            assert time.monotonic() - killed < NOT_FOR_EVER
            time.sleep(0.005)
        assert time.monotonic() - killed < LONGEST_STOP_S and stand.positioner.position[0] < 20.0
        process.wait()
        with pytest.raises(Fault, match=r"the program that used the stand since .* died"):
            stand.take("k.h5")


def test_devices_and_faults_of_all_axes_are_asked_and_reset(tmp_path):
    with positioned_lab(tmp_path) as stand:
        answers = ask_devices(*read_devices(stand.recipe))
        assert [(a.device, a.name) for a in answers] == [
            ("table", "modbus"), ("axis", "lift"), ("axis", "swivel"), ("sensor", "scanner"),
        ]  # fmt: skip
        assert all(a.answers for a in answers)
        stand.positioner.axes[0].trip("limit switch")
        reset_fault(stand.recipe)
        assert not stand.positioner.axes[0].status().fault


WRONG = {
    "an axis is missing": (
        "lift_mm = 20.0, swivel_deg = 20.0", "lift_mm = 20.0", "found lift_mm, need lift_mm, swivel_deg",
    ),
    "another unit": ("swivel_deg = 20.0", "swivel_mm = 20.0", "found lift_mm, swivel_mm, need lift_mm, swivel_deg"),
    "no unit": ("lift_mm = 20.0", "lift = 20.0", "lift"),
    "no ends": ("range_mm = [0.0, 200.0]", "", "range_mm: missing; an axis that carries a sensor has ends"),
    "two of a name": ('name = "swivel"', 'name = "lift"', "found the names lift, lift"),
    "no U": ("position_U_um = 4.0\n", "", "no position_U_um, need how well the positioner takes a place again"),
}  # fmt: skip


@pytest.mark.parametrize("why", WRONG)
def test_wrong_recipes_are_refused(tmp_path, why):
    old, new, words = WRONG[why]
    with positioned_lab(tmp_path) as stand:
        stand.recipe.write_text(stand.recipe.read_text().replace(old, new))
        with pytest.raises(BadRecipe, match=re.escape(words)):
            read_devices(stand.recipe)


def test_views_of_one_device_in_one_place_are_refused(tmp_path):
    with positioned_lab(tmp_path, at={"front": (20.0, 20.0), "rear": (20.0, 20.0)}) as stand:
        with pytest.raises(BadRecipe, match="views 'front' and 'rear' of device 'scanner' in one place"):
            stops_of(*read_devices(stand.recipe))
        with pytest.raises(BadRecipe, match="found --view back, need one of"):
            stops_of(*read_devices(stand.recipe), ["back"])


def test_what_turns_can_be_stated_in_tables_of_their_own(tmp_path):
    with positioned_lab(tmp_path, swept="") as stand:
        table = SWEPT.removeprefix("swept = [{ ").removesuffix(" }]").replace(", ", "\n")
        stand.recipe.write_text(f"{stand.recipe.read_text()}\n[[devices.positioner.swept]]\n{table}\n")
        _, devices = read_devices(stand.recipe)
    assert devices.positioner.bodies[0].radius == 12.5


def test_a_device_that_is_moved_by_hand_is_served_where_its_first_view_is(tmp_path):
    """The virtual stand can't be moved by hand; a scan by all views is refused, one by each is not."""
    with positioned_lab(tmp_path) as stand:
        text = re.sub(r"position = .*\n", "", stand.recipe.read_text()).partition("[devices.positioner]")
        rest = text[2][text[2].index("[devices.acquire]") :]
        stand.recipe.write_text(text[0] + rest)
        described, devices = read_devices(stand.recipe)
        (endpoint,) = _endpoints(described, devices)
        assert (endpoint.name, endpoint.view, endpoint.at) == ("scanner", "front", None)
        with pytest.raises(BadRecipe, match="moved by hand, scan each by itself"):
            stops_of(described, devices)
        assert [stop.views for stop in stops_of(described, devices, ["rear"])] == [["rear"]]


@pytest.mark.parametrize(("stands", "starts"), [(20.01, 20.0), (20.1, 20.1)])
def test_a_way_starts_where_the_move_before_should_have_ended(stands, starts):
    """Axes stop within their tolerance: a place with just the clearance asked for had no way from it."""
    axis = SimpleNamespace(
        state=lambda: SimpleNamespace(position=radians(stands), homed=True),
        limits=SimpleNamespace(tolerance=radians(0.02)),
    )
    ways = SimpleNamespace(way=lambda start, place, _: (start, place))
    route = Route(ways, (((30.0,), "the place of rear"),), frozenset({(20.0,), (30.0,)}))
    assert route.way(Positioner((axis,), (True,))) == (pytest.approx((starts,)), (30.0,))
