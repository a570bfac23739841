"""The GRBL codec by lines out of its manual; the server by a plain socket; what a board does at odd moments."""

import os
import socket
import threading
import time
from contextlib import suppress
from math import radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from patience import NOT_FOR_EVER
from tables import listener, on_virtual_time, served, table_at
from truestand.core.errors import DeviceError, DeviceLost, MoveTimeout
from truestand.devices.tables import TableRecipe, open_table
from truestand.devices.wire.grbl import Alarm, Ok, Refused, Report, Welcome, decode_line, jog_to
from truestand.devices.wire.malformed import Malformed
from truestand.sim.live.clock import Clock
from truestand.sim.live.grbl_server import GrblServer
from truestand.sim.live.table import VirtualTable

SAID = [
    (b"ok", Ok()),
    (b"error:9\r", Refused(9)),
    (b"ALARM:1", Alarm(1)),
    (b"Grbl 1.1h ['$' for help]", Welcome()),
    (b"[MSG:'$H'|'$X' to unlock]", None),
    (b"", None),
    (b"<Idle|MPos:0.000,0.000,0.000|FS:0.0,0>", Report("Idle", (0.0, 0.0, 0.0))),
    (b"<Jog|MPos:-5.250,0.000,0.000|Bf:15,128|FS:100,0|Pn:X|Ov:100,100,100>", Report("Jog", (-5.25, 0.0, 0.0))),
    (b"<Hold:1|MPos:1.000,2.000,3.000,4.000|FS:0,0>", Report("Hold", (1.0, 2.0, 3.0, 4.0), 1)),
    (b"<Alarm|WPos:0.000,0.000,0.000|FS:0,0>", Report("Alarm", None)),
]


@pytest.mark.parametrize(("line", "message"), SAID)
def test_messages_of_a_board_are_decoded(line, message):
    assert decode_line(line) == message


@pytest.mark.parametrize(
    "line", [b"OK", b"hello", b"<Idle", b"<idle|MPos:0>", b"<Idle|MPos:x>", b"<Idle|MPos:1,,2>", b"error:", b"\xff"]
)
def test_what_is_no_grbl_is_malformed(line):
    with pytest.raises(Malformed):
        decode_line(line)


def test_jogs_as_the_manual_writes_them():
    assert jog_to("X", 10.0, 100.0) == b"$J=G90 G21 G53 X10.0000 F100.000\n"


@given(st.sampled_from("XYZABC"), st.floats(-1e6, 1e6), st.floats(0.001, 1e5))
def test_a_jog_says_what_it_was_given(axis, position, feed):
    words = {w[0]: float(w[1:]) for w in jog_to(axis, position, feed).decode()[3:].split() if w[0] != "G"}
    assert words == {axis: pytest.approx(position, abs=1e-4), "F": pytest.approx(feed, abs=1e-3)}


@given(st.lists(st.integers(-(10**8), 10**8), min_size=1, max_size=6), st.sampled_from(["Idle", "Jog", "Run"]))
def test_a_report_comes_back(thousandths, state):
    text = ",".join(f"{n / 1000:.3f}" for n in thousandths)
    report = decode_line(f"<{state}|MPos:{text}|FS:0,0>".encode())
    assert report == Report(state, tuple(n / 1000 for n in thousandths))


@given(st.binary(max_size=60), st.sampled_from([b"", b"<Idle|MPos:", b"error:", b"[", b"Grbl "]))
def test_any_bytes_are_read_or_malformed(data, head):
    with suppress(Malformed):
        decode_line(head + data)


@pytest.fixture
def plain():
    """The board and a bare socket."""
    with served("grbl") as (virtual, server, _):
        host, port = server.address.split(":")
        with socket.create_connection((host, int(port)), 2.0) as connection, connection.makefile("rwb", 0) as lines:
            yield virtual, lines


def said(lines, text, count=1):
    lines.write(text)
    return [lines.readline().decode().strip() for _ in range(count)]


def test_the_board_is_locked_until_it_is_homed_and_silent_meanwhile(plain):
    virtual, lines = plain
    assert said(lines, b"?") == ["<Alarm|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>"]
    assert said(lines, b"$J=G91 X10 F100\n") == ["error:9"]
    lines.write(b"$H\n")
    assert said(lines, b"?", 2) == ["ok", "<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>"]
    assert virtual.status().homed


def test_the_board_jogs_one_after_the_other_and_drops_them_when_cancelled(plain):
    virtual, lines = plain
    said(lines, b"$X\n", 2)
    assert said(lines, b"$J=G91 G21 X30 F6000\n$J=G91G21X-10F6000\n", 2) == ["ok", "ok"]
    assert said(lines, b"?")[0].startswith("<Jog|")
    time.sleep(0.2)
    assert said(lines, b"?")[0].startswith("<Idle|MPos:20.000,")
    said(lines, b"$J=G53 X500 F1000\n$J=G53 X0 F1000\n", 2)
    lines.write(b"\x85")
    time.sleep(0.1)
    assert said(lines, b"?")[0].startswith("<Idle|") and not virtual.status().moving


@pytest.mark.parametrize(
    ("text", "answers"),
    [
        (b"\n", ["ok"]),
        (b"$J=G91 X10\n", ["error:22"]),
        (b"$J=G91 F10\n", ["error:16"]),
        (b"$J=G91 Xten F10\n", ["error:2"]),
        (b"$Q\n", ["error:3"]),
        (b"G0 X10\n", ["error:20"]),
        (b"\x18", ["", "Grbl 1.1h ['$' for help]"]),
        (b"!?", ["<Hold:0|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>"]),
    ],
)
def test_the_board_answers_as_grbl(plain, text, answers):
    _, lines = plain
    said(lines, b"$X\n", 2)
    assert said(lines, text, len(answers)) == answers


def test_home_position_and_units_of_another_axis_are_converted():
    virtual = VirtualTable(Clock(20.0))
    axis = {"axis": "A", "axes": "XYZA", "degrees_per_unit": 10.0}
    server = GrblServer(virtual, TableRecipe(protocol="grbl", address="127.0.0.1:0", grbl=axis), home_position=-3.5)
    server.start()
    table = open_table(TableRecipe(protocol="grbl", address=server.address, grbl=axis))
    table = on_virtual_time(table, virtual.clock)
    table.home()
    assert table.state().position == 0.0
    table.move_to(radians(47), radians(90))
    assert table.state().position == pytest.approx(radians(47), abs=1e-3)
    assert float(virtual.angle_at(virtual.clock.now())) == pytest.approx(radians(47), abs=1e-3)
    table.close()
    server.stop()


def test_halt_during_home_search_leaves_the_table_not_homed():
    with table_at("grbl", pace=1.0) as (virtual, _, table):
        timer = threading.Timer(0.2, table.drive.halt)
        timer.start()
        with pytest.raises(DeviceError, match="homing was interrupted"):
            table.home()
        timer.join()
        assert not table.state().homed and not virtual.status().homed
        table.reset()
        assert table.state().fault == ""


def test_a_search_that_takes_too_long_is_stopped():
    with table_at("grbl", pace=1.0, home_timeout_s=0.3) as (virtual, _, table):
        with pytest.raises(MoveTimeout, match="homing"):
            table.home()
        time.sleep(0.3)
        assert not virtual.status().moving


def test_home_raises_error_on_board_without_homing():
    def answer(data):
        return b"error:5\r\n" if b"$H" in data else b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n"

    with listener(answer) as port:
        table = open_table(TableRecipe(protocol="grbl", address=f"127.0.0.1:{port}"))
        with pytest.raises(DeviceError, match=r"homing is switched off \(\$22\)"):
            table.home()
        table.close()


def test_a_refusal_of_homing_that_arrives_before_the_next_question_is_not_lost():
    def answer(data):
        return b"error:5\r\n" if b"$H" in data else b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n"

    with listener(answer) as port:
        table = open_table(TableRecipe(protocol="grbl", address=f"127.0.0.1:{port}", timeout_s=5.0))
        table.drive.start_home()
        time.sleep(0.5)
        with pytest.raises(DeviceError, match=r"homing is switched off \(\$22\)"):
            table.state()
        table.close()


def test_board_that_reports_work_positions_raises_error_with_advice():
    with listener(lambda _: b"<Idle|MPos:1.0|FS:0,0>\r\n") as port, pytest.raises(DeviceError, match="axis Y"):
        recipe = {"axis": "Y"}
        open_table(TableRecipe(protocol="grbl", address=f"127.0.0.1:{port}", grbl=recipe))
    with listener(lambda _: b"<Idle|WPos:1.0,2.0,3.0|FS:0,0>\r\n") as port, pytest.raises(DeviceError, match=r"\$10=1"):
        open_table(TableRecipe(protocol="grbl", address=f"127.0.0.1:{port}"))


def test_reset_of_the_board_loses_home():
    with table_at("grbl") as (_, server, table):
        table.home()
        server.realtime(b"\x18", None)
        time.sleep(0.05)
        assert not table.state().homed


SERIAL = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")


@SERIAL
def test_a_serial_port():
    with served("grbl", address="pty") as (virtual, server, recipe):
        assert server.address.startswith("/dev/")
        table = on_virtual_time(open_table(recipe), virtual.clock)
        table.home()
        table.move_to(1.0, 1.5)
        assert float(virtual.angle_at(virtual.clock.now())) == pytest.approx(1.0, abs=1e-4)
        table.start_move(100.0, 1.0)
        server.stop()
        begin = time.monotonic()
        with pytest.raises(DeviceLost, match="check power"):
            table.wait(10.0, "turning")
        assert time.monotonic() - begin < NOT_FOR_EVER
        table.close()


@SERIAL
def test_board_that_boots_is_given_time_to_answer():
    import tty

    ours, theirs = os.openpty()
    tty.setraw(theirs)

    def boot():
        time.sleep(0.8)
        os.write(ours, b"\xfe\x00 rst:0x1 (POWERON_RESET)\r\n\r\nGrbl 1.1h ['$' for help]\r\n")
        os.read(ours, 100)
        os.write(ours, b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n")

    board = threading.Thread(target=boot)
    board.start()
    table = open_table(TableRecipe(protocol="grbl", address=os.ttyname(theirs)))
    board.join()
    table.close()
    os.close(ours)
    os.close(theirs)


def test_a_serial_port_that_is_not_there_is_lost():
    with pytest.raises(DeviceLost, match="check power"):
        open_table(TableRecipe(protocol="grbl", address="/dev/no-such-port"))
