"""The register map, looked at with a plain client; and answers that are none."""

import random
import struct
import time
from math import pi, tau

import pytest
from pymodbus.client import ModbusTcpClient

from tables import listener, served, table_at
from truestand.core.errors import BadRecipe, DeviceError, LimitExceeded
from truestand.devices.tables import TableRecipe, open_table
from truestand.files.checking import checked

COUNTS = 360000


def port_of(server):
    return int(server.address.rpartition(":")[2])


@pytest.fixture
def plain():
    """A server and a client of its own, with nothing of our driver."""
    with (
        served("modbus") as (virtual, server, _),
        ModbusTcpClient("127.0.0.1", port=port_of(server), timeout=1) as client,
    ):
        yield virtual, client


def status(client):
    word, high, low, code = client.read_holding_registers(16, count=4, device_id=1).registers
    (position,) = struct.unpack(">i", struct.pack(">HH", high, low))
    return word, position, code


def wait(client):
    while status(client)[0] & 2:
        time.sleep(0.01)


def test_registers_follow_the_default_map(plain):
    virtual, client = plain
    assert status(client) == (0, 0, 0)
    client.write_register(0, 1 << 8 | 1, device_id=1)
    assert status(client)[0] == 1 << 8 | 2
    wait(client)
    assert status(client) == (1 << 8 | 1, 0, 0)
    client.write_registers(0, [2 << 8 | 2, 0xFFFE, 0xA070, 0x0003, 0x7EB8], device_id=1)  # -90000 counts, 229048 /s
    assert status(client)[0] == 2 << 8 | 3
    wait(client)
    assert status(client) == (2 << 8 | 1, -90000, 0)
    assert float(virtual.angle_at(virtual.clock.now())) == pytest.approx(-pi / 2)


def test_a_command_with_the_same_number_is_taken_once(plain):
    virtual, client = plain
    client.write_registers(1, [100, 0, 0, COUNTS // 10], device_id=1)
    client.write_register(0, 1 << 8 | 2, device_id=1)
    assert virtual.status().moving
    virtual.halt()
    wait(client)
    client.write_register(0, 1 << 8 | 2, device_id=1)
    assert not virtual.status().moving
    client.write_register(0, 2 << 8 | 2, device_id=1)
    assert virtual.status().moving


def test_fault_sets_status_bit_and_fault_code(plain):
    virtual, client = plain
    virtual.trip("drive too hot")
    assert status(client) == (4, 0, 1)
    client.write_register(0, 1 << 8 | 16, device_id=1)
    assert status(client) == (1 << 8, 0, 0)


OTHER = {"unit": 7, "words": "low-first", "status_in": "input", "command": 100, "target": 110, "speed": 112,
         "heartbeat": 120, "status": 10, "position": 20, "fault_code": 30, "counts_per_turn": 65536}  # fmt: skip


def test_another_map_is_only_a_recipe():
    with table_at("modbus", tables=OTHER) as (virtual, _, table):
        table.home()
        table.move_to(-1.0, 1.5)
        assert table.state().position == pytest.approx(-1.0, abs=tau / 65536)
        assert float(virtual.angle_at(virtual.clock.now())) == pytest.approx(-1.0, abs=tau / 65536)
        virtual.trip("drive too hot")
        assert table.state().fault == "fault 1 of the controller"


def test_plc_with_watchdog_stops_when_the_heartbeat_ends():
    from truestand.sim.live.clock import Clock
    from truestand.sim.live.modbus_server import ModbusServer
    from truestand.sim.live.table import VirtualTable

    virtual = VirtualTable(Clock())
    recipe = {"protocol": "modbus", "modbus": {"heartbeat": 5}}
    server = ModbusServer(virtual, TableRecipe(address="127.0.0.1:0", **recipe), watchdog=0.3)
    server.start()
    table = open_table(TableRecipe(address=server.address, **recipe))
    table.drive.start_move(100.0, 0.5)
    for _ in range(10):
        assert table.state().moving
        time.sleep(0.05)
    time.sleep(0.5)
    assert not virtual.status().moving
    assert table.state().fault == "fault 2 of the controller"
    table.reset()
    assert not table.state().fault
    table.close()
    server.stop()


def test_a_target_that_no_register_holds_is_refused():
    with table_at("modbus") as (virtual, _, table):
        table.home()
        with pytest.raises(LimitExceeded, match="turns"):
            table.move_to(6000 * tau, 1.0)
        assert not virtual.status().moving


def test_plc_without_running_program_raises_error():
    answers = {3: lambda r: bytes([3, 8]) + bytes(8), 16: lambda r: r[7:12]}
    with listener(lambda r: r[:4] + struct.pack(">H", 1 + len(a := answers[r[7]](r))) + r[6:7] + a) as port:
        table = open_table(TableRecipe(protocol="modbus", address=f"127.0.0.1:{port}"))
        with pytest.raises(DeviceError, match="program runs"):
            table.home()
        table.close()


def test_missing_registers_raise_error_about_the_map():
    with (
        served("modbus") as (_, server, _),
        pytest.raises(DeviceError, match=r"exception 2.*map"),
    ):
        recipe = {"status": 1000, "position": 1001, "fault_code": 1003}
        open_table(TableRecipe(protocol="modbus", address=server.address, modbus=recipe))


def test_random_answers_never_raise_anything_else():
    chance = random.Random(1)

    def answer(request):
        body = chance.randbytes(chance.randrange(1, 20))
        kind = chance.randrange(4)
        if kind == 0:
            return body
        function = request[7:8] if kind == 1 else b"" if kind == 2 else bytes([request[7], len(body)])
        return request[:4] + struct.pack(">H", 1 + len(function + body)) + request[6:7] + function + body

    with listener(answer) as port:
        recipe = TableRecipe(protocol="modbus", address=f"127.0.0.1:{port}", timeout_s=0.03)
        for _ in range(80):
            try:
                open_table(recipe).close()
            except DeviceError as told:
                assert "127.0.0.1" in str(told)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"protocol": "modbus", "address": "127.0.0.1:502", "modbus": {"target": 0}}, "register 0 is used twice"),
        ({"protocol": "modbus", "address": "127.0.0.1:502", "modbus": {"positon": 0}}, "did you mean 'position'"),
        ({"protocol": "modbus", "address": "opc.tcp://x:4840"}, "need host:port"),
        ({"protocol": "modbus", "address": "127.0.0.1:99999"}, "need host:port"),
        ({"protocol": "opcua", "address": "127.0.0.1:4840"}, "need opc.tcp://"),
        ({"protocol": "modbus", "address": "a:1", "range_deg": [10, -10]}, "need \\[lowest, highest\\]"),
        ({"protocol": "grbl", "address": "COM3", "grbl": {"axis": "A"}}, "not among axes"),
        ({"protocol": "can", "address": "COM3"}, "protocol"),
    ],
)
def test_wrong_recipe_is_refused_in_one_line(wrong, said):
    with pytest.raises(BadRecipe, match=said) as told:
        checked(TableRecipe, wrong, "stand.toml")
    assert "\n" not in str(told.value)
