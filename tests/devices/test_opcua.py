"""The OPC UA server looked at with a plain client, and what the driver says of servers that are others."""

import asyncio
import random
import threading
from math import radians

import pytest
from asyncua import Client, ua

from patience import NOT_FOR_EVER
from tables import listener, on_virtual_time, served
from truestand.core.errors import DeviceError
from truestand.devices.tables import TableRecipe, open_table


def plainly(address, talk):
    """``talk`` with a client of its own, with nothing of our driver."""

    async def run():
        async with Client(address, timeout=NOT_FOR_EVER, watchdog_intervall=NOT_FOR_EVER) as client:
            space = await client.get_namespace_index("urn:truestand:table")
            return await talk(await client.nodes.objects.get_child(f"{space}:RotaryTable"), space, client)

    return asyncio.run(run())


def test_object_has_the_default_names():
    async def talk(table, space, _):
        async def read(name):
            return await (await table.get_child(f"{space}:{name}")).read_value()

        assert [await read(n) for n in ("Position", "Moving", "Homed", "Fault")] == [0.0, False, False, ""]
        await table.call_method(f"{space}:Home")
        assert await read("Moving")
        while await read("Moving"):
            await asyncio.sleep(0.01)
        assert await read("Homed")
        await table.call_method(f"{space}:MoveTo", 45.0, 90.0)
        while await read("Moving"):
            await asyncio.sleep(0.01)
        assert await read("Position") == pytest.approx(45.0)
        await table.call_method(f"{space}:MoveTo", 0.0, 10.0)
        assert await read("Moving")
        await table.call_method(f"{space}:Stop")
        with pytest.raises(ua.UaStatusCodeError):
            await table.call_method(f"{space}:MoveTo", 45.0)
        with pytest.raises(ua.UaStatusCodeError):
            await table.call_method(f"{space}:MoveTo", "north", 45.0)

    with served("opcua") as (_, server, _):
        plainly(server.address, talk)


def test_subscribers_are_notified():
    heard = []

    class Handler:
        def datachange_notification(self, node, value, data):
            heard.append(value)

    async def talk(table, space, client):
        subscription = await client.create_subscription(50, Handler())
        await subscription.subscribe_data_change(await table.get_child(f"{space}:Position"))
        await table.call_method(f"{space}:MoveTo", 1000.0, 10.0)
        await asyncio.sleep(0.5)
        await subscription.delete()

    with served("opcua") as (_, server, _):
        plainly(server.address, talk)
    assert len(heard) > 2 and heard == sorted(heard)


OTHER = {"namespace": "http://example.org/plc", "object": "Machine/Table", "unit": "rad", "home": "Referenzieren",
         "move": "Positionieren", "turn": "Drehen", "halt": "Halt", "reset": "Quittieren", "position": "Istwinkel",
         "moving": "Bewegt", "homed": "Referenziert", "fault": "Stoerung"}  # fmt: skip


def test_other_names_are_only_a_recipe():
    with served("opcua", tables=OTHER) as (virtual, server, recipe):
        table = on_virtual_time(open_table(recipe), virtual.clock)
        table.home()
        table.move_to(1.0, 1.5)
        assert table.state().position == pytest.approx(1.0)
        table.close()
        for wrong, said in (({}, "knows no namespace"), ({**OTHER, "halt": "Hal"}, "BadNoMatch.*names")):
            with pytest.raises(DeviceError, match=said):
                open_table(TableRecipe(protocol="opcua", address=server.address, opcua=wrong))


def test_commands_in_a_fault_raise_error_with_the_fault():
    with served("opcua") as (virtual, _, recipe):
        table = open_table(recipe)
        virtual.trip("following error")
        assert table.state().fault == "following error"
        with pytest.raises(DeviceError, match="refused, BadInvalidState"):
            table.drive.start_move(1.0, radians(10))
        table.close()


def test_random_answers_never_raise_anything_else_and_no_thread_is_left():
    chance = random.Random(1)
    acknowledge = bytes.fromhex("41434b461c000000000000000000010000000100000000000000 0000".replace(" ", ""))

    def answer(request):
        if request[:3] == b"HEL" and chance.random() < 0.7:
            return acknowledge
        size = chance.randrange(12, 80)
        kind = chance.choice([b"OPNF", b"MSGF", b"ERRF", b"ACKF", b"XXXX"])
        return kind + size.to_bytes(4, "little") + chance.randbytes(size - 8)

    before = threading.active_count()
    with listener(answer) as port:
        recipe = TableRecipe(protocol="opcua", address=f"opc.tcp://127.0.0.1:{port}", timeout_s=0.05)
        for _ in range(25):
            with pytest.raises(DeviceError, match=r"127\.0\.0\.1"):
                open_table(recipe)
    assert threading.active_count() == before
