"""What ``truestand serve`` opens beside its page for other machines."""

import sys
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from truestand.core.errors import BadRecipe
from truestand.web.app_state import AppState
from truestand.web.interfaces.mqtt import Broker, broker_of, mqtt_publisher
from truestand.web.interfaces.status import StatusPublisher
from truestand.web.serving import is_loopback


@dataclass(frozen=True, slots=True)
class InterfaceSettings:
    """Which interfaces to open."""

    opcua: str | None = None
    """opc.tcp://host:port"""
    mqtt: Broker | None = None


def interface_settings(
    state: AppState, opcua: str | None = None, mqtt: str | None = None, password_file: Path | None = None
) -> InterfaceSettings:
    """The interfaces of these URLs.

    Raises:
        BadRecipe: a URL that is none, or an OPC UA server that others can reach without users.
    """
    if opcua is not None and not is_loopback(_host(opcua)) and not state.authenticator.users:
        raise BadRecipe(
            f"found --opcua {opcua} and no users, need one for a server that others can reach; "
            "run truestand serve --add-user NAME --role operator"
        )
    return InterfaceSettings(opcua, None if mqtt is None else broker_of(mqtt, password_file))


@asynccontextmanager
async def open_interfaces(state: AppState, settings: InterfaceSettings) -> AsyncIterator[tuple[str, ...]]:
    """The interfaces of ``settings``, as long as this is open; their addresses.

    Raises:
        BadRecipe: an address that is taken, or none of this machine's.
        MissingExtra: what one of them needs isn't installed.
    """
    if settings == InterfaceSettings():
        yield ()
        return
    async with AsyncExitStack() as stack:
        status = await stack.enter_async_context(StatusPublisher(state).running())
        addresses = []
        if settings.opcua is not None:
            from truestand.web.interfaces.opcua import opcua_server  # asyncua: half a second, 50 MB

            addresses.append(await stack.enter_async_context(opcua_server(status, settings.opcua)))
        if settings.mqtt is not None:
            stand = state.settings.stand.absolute().parent.name
            addresses.append(await stack.enter_async_context(mqtt_publisher(status, settings.mqtt, stand, _log)))
        yield tuple(addresses)


def _host(url: str) -> str:
    try:
        parts = urlsplit(url)
        if parts.scheme == "opc.tcp" and parts.hostname and parts.port is not None and parts.username is None:
            return parts.hostname
    except ValueError:
        pass
    raise BadRecipe(f"found --opcua {url!r}, need an address like opc.tcp://127.0.0.1:4840")


def _log(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
