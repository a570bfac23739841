"""What ``truestand serve`` opens beside its page for other machines."""

import sys
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from truestand.core.errors import BadRecipe
from truestand.web.app_state import Page
from truestand.web.interfaces.mqtt import Broker, broker_of, mqtt_publisher
from truestand.web.interfaces.status import Teller
from truestand.web.serving import is_loopback


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which interfaces."""

    opcua: str | None = None
    """opc.tcp://host:port"""
    mqtt: Broker | None = None


def wanted(page: Page, opcua: str | None = None, mqtt: str | None = None, password_file: Path | None = None) -> Wanted:
    """The interfaces of these URLs.

    Raises:
        BadRecipe: a URL that is none, or an OPC UA server that others can reach without users.
    """
    if opcua is not None and not is_loopback(_host(opcua)) and not page.gatekeeper.users:
        raise BadRecipe(
            f"found --opcua {opcua} and no users, need one for a server that others can reach; "
            "run truestand serve --add-user NAME --role operator"
        )
    return Wanted(opcua, None if mqtt is None else broker_of(mqtt, password_file))


def _host(url: str) -> str:
    try:
        told = urlsplit(url)
        if told.scheme == "opc.tcp" and told.hostname and told.port is not None and told.username is None:
            return told.hostname
    except ValueError:
        pass
    raise BadRecipe(f"found --opcua {url!r}, need an address like opc.tcp://127.0.0.1:4840")


@asynccontextmanager
async def machines(page: Page, wanted: Wanted) -> AsyncIterator[tuple[str, ...]]:
    """The interfaces that are wanted, as long as this is open; their addresses.

    Raises:
        BadRecipe: an address that can't be had.
        MissingExtra: what one of them needs isn't installed.
    """
    if wanted.opcua is None and wanted.mqtt is None:
        yield ()
        return
    async with AsyncExitStack() as stack:
        teller = Teller(page)
        addresses = []
        await stack.enter_async_context(teller.telling())
        if wanted.opcua is not None:
            from truestand.web.interfaces.opcua import opcua_server  # asyncua: half a second, 50 MB

            server = opcua_server(teller, wanted.opcua)
            addresses.append(await stack.enter_async_context(server))
        if wanted.mqtt is not None:
            name = page.settings.stand.absolute().parent.name
            publisher = mqtt_publisher(teller, wanted.mqtt, name, _say)
            addresses.append(await stack.enter_async_context(publisher))
        yield tuple(addresses)


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
