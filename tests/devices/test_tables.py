"""Each driver against its server: home, move, stop, limits, and what happens when things go wrong."""

import random
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from math import pi, radians, tau
from pathlib import Path

import pytest

from patience import NOT_FOR_EVER
from tables import ADDRESSES, PACE, SERVERS, Relay, listener, on_virtual_time, served, speed_of, table_at
from truestand.core.errors import DeviceError, DeviceLost, LimitExceeded, MoveTimeout
from truestand.devices.tables import TableRecipe, open_table
from truestand.sim.live.table import Motion
from variants import tried

QUICK = Motion(power_on=0.0, home_speed=pi)
"""Home is near: for tests in real time."""
FAR = 100.0
"""rad: further than any table gets here."""
EACH = pytest.mark.parametrize("protocol", sorted(SERVERS))
QUICKEST = pytest.mark.parametrize("protocol", tried(["grbl", "modbus", "zaber"], "opcua"))
"""A server of OPC UA takes half a second to start."""


def port_of(server):
    return int(server.address.split(":")[-1].split("/")[0])


@EACH
def test_it_homes_moves_and_stops(protocol):
    with table_at(protocol, max_speed_deg_per_s=180) as (virtual, _, table):
        state = table.state()
        assert not state.homed and not state.moving and state.fault == ""
        table.home()
        state = table.state()
        assert state.homed and not state.moving and state.position == pytest.approx(0.0, abs=1e-4)
        for target in (radians(123.456), radians(-400.0), 0.0):
            table.move_to(target, radians(180))
            assert table.state().position == pytest.approx(target, abs=table.limits.tolerance)
            assert float(virtual.angle_at(virtual.clock.now())) == pytest.approx(target, abs=table.limits.tolerance)
        table.start_move(-FAR, radians(60))
        time.sleep(2.0 / PACE)
        assert table.state().moving
        assert speed_of(virtual, 0.5) == pytest.approx(radians(-60), rel=1e-3)
        table.stop()
        state = table.state()
        assert not state.moving and state.position < -1.0
        assert state.position == pytest.approx(float(virtual.angle_at(virtual.clock.now())), abs=1e-3)


@QUICKEST
def test_a_new_speed_and_a_new_move_while_it_moves(protocol):
    with table_at(protocol) as (virtual, _, table):
        table.home()
        table.start_move(FAR, radians(30))
        time.sleep(1.0 / PACE)
        table.start_move(FAR, radians(90))
        time.sleep(1.0 / PACE)
        assert speed_of(virtual, 0.2) == pytest.approx(radians(90), rel=1e-2)
        table.stop()
        table.move_to(tau, radians(90))


@QUICKEST
def test_position_lies_between_those_at_question_and_answer(protocol):
    with table_at(protocol, pace=1.0, motion=QUICK) as (virtual, _, table):
        table.home()
        table.start_move(FAR, 1.0)
        time.sleep(0.1)
        for _ in range(10):
            asked = virtual.clock.now()
            state = table.state()
            answered = virtual.clock.now()
            low, high = virtual.angle_at(asked), virtual.angle_at(answered)
            assert low - 1e-3 <= state.position <= high + 1e-3
            assert 0 < state.time_half_width < 0.5 and abs(state.time - time.monotonic()) < 1.0
        table.stop()


@QUICKEST
def test_limits_are_refused_before_anything_moves(protocol):
    with table_at(protocol, max_speed_deg_per_s=50, range_deg=(-10, 200)) as (virtual, _, table):
        with pytest.raises(DeviceError, match="not homed"):
            table.move_to(0.1, 0.1)
        table.home()
        stood = virtual.status().position
        for wrong in (lambda: table.move_to(radians(201), 0.1), lambda: table.move_to(0.1, 1.0),
                      lambda: table.move_to(float("nan"), 0.1)):  # fmt: skip
            with pytest.raises(LimitExceeded):
                wrong()
        assert virtual.status().position == stood and not virtual.status().moving


@EACH
def test_stalled_table_times_out_and_is_halted(protocol):
    with table_at(protocol) as (virtual, _, table):
        table.home()
        table.start_move(radians(60), radians(60))
        virtual.stall()
        with pytest.raises(MoveTimeout, match="blocks"):
            table.move_to(radians(30), radians(60))
        table.stop()
        assert not virtual.status().moving
        virtual.release()
        table.move_to(radians(30), radians(60))


@EACH
def test_fault_of_the_controller_raises_error_until_reset(protocol):
    with table_at(protocol) as (virtual, _, table):
        table.home()
        table.start_move(FAR, 1.0)
        virtual.trip("following error")
        with pytest.raises(DeviceError):
            table.move_to(0.0, 1.0)
        assert table.state().fault
        time.sleep(1.0 / PACE)
        table.reset()
        assert not table.state().fault
        if not table.state().homed:
            table.home()
        table.move_to(0.3, 1.0)


@pytest.mark.more
@EACH
def test_a_server_that_dies_while_it_moves_is_lost_and_stopped_when_it_is_back(protocol):
    with served(protocol, pace=1.0, motion=QUICK, mortal=True) as (virtual, server, recipe):
        table = open_table(recipe)
        table.home()
        table.start_move(FAR, 0.5)
        assert table.state().moving
        server.stop()
        begin = time.monotonic()
        with pytest.raises(DeviceLost, match="check power"):
            table.wait(20.0, "turning", halt=False)
        assert time.monotonic() - begin < NOT_FOR_EVER
        with pytest.raises(DeviceLost):
            table.stop()
        again = SERVERS[protocol](virtual, recipe)
        again.start()
        table.stop()
        assert not virtual.status().moving
        table.close()
        again.stop()


@pytest.mark.more
@EACH
def test_a_server_that_hangs_while_it_moves_is_lost_and_found_again(protocol):
    with (
        served(protocol, pace=1.0, motion=QUICK) as (virtual, server, _),
        Relay(port_of(server)) as relay,
    ):
        address = ADDRESSES[protocol].format(port=relay.port)
        table = open_table(TableRecipe(protocol=protocol, address=address, timeout_s=3.0))
        table.home()
        table.start_move(FAR, 0.5)
        assert table.state().moving
        relay.frozen.set()
        begin = time.monotonic()
        with pytest.raises(DeviceLost, match=r"no answer within 3 s"):
            table.wait(20.0, "turning", halt=False)
        assert time.monotonic() - begin < NOT_FOR_EVER
        relay.frozen.clear()
        table.stop()
        assert not virtual.status().moving
        table.close()


@QUICKEST
def test_unreachable_and_silent_controllers_are_lost_in_time(protocol):
    with listener(lambda _: None) as port:
        for address in (port, 1):
            begin = time.monotonic()
            with pytest.raises(DeviceLost, match="check power"):
                open_table(TableRecipe(protocol=protocol, address=ADDRESSES[protocol].format(port=address)))
            assert time.monotonic() - begin < NOT_FOR_EVER


@QUICKEST
@pytest.mark.parametrize(
    "garbage",
    [b"\x00" * 40, b"\xff" * 3000, b"HTTP/1.1 400 Bad Request\r\n\r\n", bytes(range(256)), b"\n\n\n\n"],
    ids=["zeros", "ones", "http", "all", "newlines"],
)
def test_garbage_is_an_error_of_the_device(protocol, garbage):
    with listener(lambda _: garbage) as port:
        begin = time.monotonic()
        with pytest.raises(DeviceError, match=r"need|refused"):
            open_table(TableRecipe(protocol=protocol, address=ADDRESSES[protocol].format(port=port), timeout_s=0.1))
        assert time.monotonic() - begin < NOT_FOR_EVER


@QUICKEST
def test_damaged_answers_raise_nothing_else(protocol):
    chance = random.Random(3)

    def spoil(data):
        place = chance.randrange(len(data))
        return data if chance.random() < 0.9 else data[:place] + chance.randbytes(1) + data[place + 1 :]

    with served(protocol) as (_, server, _), Relay(port_of(server), spoil) as relay:
        recipe = TableRecipe(protocol=protocol, address=ADDRESSES[protocol].format(port=relay.port), timeout_s=0.05)
        for _ in range(25):
            with suppress(DeviceError):
                table = open_table(recipe)
                try:
                    table.state()
                    table.drive.halt()
                finally:
                    table.close()


class Interrupted(BaseException):
    """What Ctrl-C raises, but for pytest."""


@pytest.fixture
def alarm_interrupts():
    def interrupt(*_):
        raise Interrupted

    before = signal.signal(signal.SIGALRM, interrupt)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


@EACH
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs timers that interrupt")
def test_a_stop_gets_through_after_an_interrupt_at_any_moment(protocol, alarm_interrupts):
    chance = random.Random(4)
    with table_at(protocol, tolerance_deg=360.0) as (virtual, _, table):
        table.home()
        for _ in range(20):
            table.start_move(chance.choice([-FAR, FAR]), radians(60))
            with pytest.raises(Interrupted):
                signal.setitimer(signal.ITIMER_REAL, chance.uniform(1e-4, 4e-3))
                while True:
                    table.state()
            table.stop()
            assert not virtual.status().moving


@EACH
def test_a_halt_from_another_thread_gets_through_while_it_waits(protocol):
    with table_at(protocol) as (virtual, _, table):
        table.home()
        timer = threading.Timer(0.1, table.drive.halt)
        timer.start()
        with pytest.raises(MoveTimeout, match="stopped"):
            table.move_to(100.0, 1.5)
        timer.join()
        assert not virtual.status().moving


def test_a_library_is_loaded_only_where_it_is_needed():
    code = "import sys, truestand.devices.tables; print({'pymodbus', 'asyncua', 'serial'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def answered(ask):
    """What ``ask`` returns in the end: on a busy machine an answer may take longer than the table's timeout."""
    end = time.monotonic() + NOT_FOR_EVER
    while True:
        try:
            return ask()
        except DeviceError:
            if time.monotonic() > end:
                raise


def quietly(protocol):
    """What goes wrong with a table: a server that hangs, dies, talks nonsense."""
    settings = {"protocol": protocol, "timeout_s": 0.4}
    with served(protocol, mortal=True) as (_, server, _), Relay(port_of(server)) as relay:
        recipe = TableRecipe(address=ADDRESSES[protocol].format(port=relay.port), **settings)
        table = answered(lambda: open_table(recipe))
        relay.frozen.set()
        with suppress(DeviceError):
            while True:
                table.state()
        relay.frozen.clear()
        answered(table.state)
        server.stop()
        for _ in range(2):
            with suppress(DeviceError):
                table.stop()
        table.close()
    with listener(lambda _: bytes(range(256))) as port, suppress(DeviceError):
        open_table(TableRecipe(address=ADDRESSES[protocol].format(port=port), **settings))


@pytest.mark.more
def test_nothing_is_printed_or_logged_whatever_happens():
    """In a process without pytest's own ways of catching it."""
    here = Path(__file__).parent
    code = (
        f"import sys; sys.path[:0] = [{str(here)!r}, {str(here.parent)!r}]; import test_tables\n"
        "for protocol in test_tables.SERVERS: test_tables.quietly(protocol)\n"
        "print('done')"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("done\n", "")


def test_on_virtual_time_nothing_else_changes():
    with served("modbus") as (virtual, _, recipe):
        table = open_table(recipe)
        assert on_virtual_time(table, virtual.clock).limits == table.limits
        table.close()
