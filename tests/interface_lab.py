"""A stand with a fake worker, and other machines that talk to it."""

import asyncio
import json
from contextlib import asynccontextmanager

from asyncua import Client

import web_lab
from patience import NOT_FOR_EVER
from small_records import calibration, inspection
from truestand.store import Store
from truestand.web.interfaces.startup import InterfaceSettings, open_interfaces


def make_state(folder, users=()):
    (folder / "worker").mkdir(parents=True, exist_ok=True)
    for kind, record in (("calibrate", calibration()), ("inspect", inspection())):
        (folder / "worker" / f"{kind}.json").write_text(json.dumps(record))
    return web_lab.make_state(folder, users)


def keep(state, kind, record):
    """The number of a result that some other program puts into the store."""
    return Store.open(state.settings.store, create=True).add(kind, record).number


class Plc:
    """asyncua's own client, by the names of the nodes."""

    def __init__(self, client, space):
        self.client, self.space = client, space

    def node(self, path):
        return self.client.get_node(f"ns={self.space};s={path}")

    async def read(self, path):
        return await self.node(path).read_value()

    async def reads(self, path, *names):
        return [await self.read(f"{path}/{name}") for name in names]

    async def call(self, name, *arguments):
        return await self.node("Stand").call_method(f"{self.space}:{name}", *arguments)

    async def until(self, path, value, within=NOT_FOR_EVER):
        async with asyncio.timeout(within):
            while await self.read(path) != value:
                await asyncio.sleep(0.02)


@asynccontextmanager
async def served(state):
    """The address of the page's OPC UA server."""
    async with open_interfaces(state, InterfaceSettings("opc.tcp://127.0.0.1:0")) as (address,):
        try:
            yield address
        finally:
            await asyncio.to_thread(state.runner.close)


@asynccontextmanager
async def plc(address, user=None, password=None):
    client = Client(address, timeout=NOT_FOR_EVER, watchdog_intervall=NOT_FOR_EVER)
    if user:
        client.set_user(user)
        client.set_password(password)
    async with client:
        yield Plc(client, await client.get_namespace_index("urn:truestand"))
