"""The server: bound before it says so, ended in order. A job that runs is aborted first, and waited for."""

import asyncio
import ipaddress
import signal
import socket
import webbrowser
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import uvicorn

from truestand.core.errors import BadRecipe
from truestand.web.app import create_app
from truestand.web.app_state import AppState
from truestand.web.connections import HEAD_TIMEOUT_S, ConnectionMonitor, protocols
from truestand.web.runner import JobRunner
from truestand.web.security import allowed_hosts

SHUTDOWN_TIMEOUT_S = 3
"""For open connections."""
MAX_HEAD_BYTES = 16_384
MAX_MESSAGE_BYTES = 4_096
"""Of a WebSocket's message; none is expected."""
Interfaces = AbstractAsyncContextManager[Sequence[str]]
"""Other servers and clients in the same event loop; yields their addresses."""


@dataclass(frozen=True, slots=True)
class Binding:
    """Where the page is served."""

    host: str = "127.0.0.1"
    port: int = 8620
    names: tuple[str, ...] = ()
    """Host names under which it may be reached besides its own."""
    proxies: tuple[str, ...] = ()
    """IP addresses or networks whose X-Forwarded-For and X-Forwarded-Proto headers are trusted."""
    certificate: Path | None = None
    key: Path | None = None


def serve(
    state: AppState,
    binding: Binding,
    announce: Callable[[str], None],
    open_browser: bool = False,
    interfaces: Interfaces | None = None,
) -> None:
    """Serve until SIGINT or SIGTERM; ``announce`` gets the addresses as soon as they answer, the page's first.

    Raises:
        BadRecipe: a page that others can reach, and no users; or an address that is none or is taken.
        MissingExtra: one of the interfaces needs a package that isn't installed.
    """
    reachable = f"--host {binding.host}" if not is_loopback(binding.host) else "--proxy" if binding.proxies else ""
    if reachable and not state.authenticator.users:
        raise BadRecipe(
            f"found {reachable} and no users, need one for a page that others can reach; "
            "run truestand serve --add-user NAME --role engineer"
        )
    _require_addresses(binding.proxies)
    listening = bind(binding)
    host, port = listening.getsockname()[:2]
    shown = f"[{host}]" if ":" in host else host
    address = f"{'http' if binding.certificate is None else 'https'}://{shown}:{port}/"

    def ready() -> None:
        for served in (address, *server.addresses):
            announce(served)
        if open_browser:
            webbrowser.open(address)

    with listening:  # closed also where an interface can't start
        server = Server(config(state, binding), state.runner, ready, interfaces)
        asyncio.run(server.serve([listening]))


def _require_addresses(proxies: Sequence[str]) -> None:
    """Refuse what uvicorn would silently take for a host name, or as trust in every proxy.

    Raises:
        BadRecipe: no IP address or network.
    """
    for proxy in proxies:
        try:
            ipaddress.ip_network(proxy)
        except ValueError as wrong:
            raise BadRecipe(f"found --proxy {proxy}, need the proxy's IP address, as in --proxy 127.0.0.1") from wrong


def bind(binding: Binding) -> socket.socket:
    """A socket that listens.

    Raises:
        BadRecipe: the address is taken, or none of this machine's.
    """
    family = socket.AF_INET6 if ":" in binding.host else socket.AF_INET
    try:
        return socket.create_server((binding.host, binding.port), family=family, backlog=256)
    except OSError as wrong:
        raise BadRecipe(
            f"{binding.host}:{binding.port}: {wrong.strerror or wrong}; end what serves there, or choose another --port"
        ) from wrong


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach it."""
    try:
        addresses = {info[4][0] for info in socket.getaddrinfo(host, None)}
    except OSError:
        return False
    return all(ipaddress.ip_address(str(address).partition("%")[0]).is_loopback for address in addresses)


class Server(uvicorn.Server):
    """uvicorn's server, which watches its connections and stops the stand before it ends."""

    def __init__(
        self, config: uvicorn.Config, runner: JobRunner, ready: Callable[[], None], interfaces: Interfaces | None = None
    ) -> None:
        super().__init__(config)
        self.addresses: Sequence[str] = ()
        """Of the interfaces."""
        self._interfaces: Interfaces = interfaces or nullcontext(())
        self.monitor = ConnectionMonitor()
        config.http, config.ws = protocols(self.monitor)
        self._runner, self._ready = runner, ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Open the interfaces and the sockets, then call ``ready``."""
        self.addresses = await self._interfaces.__aenter__()
        await super().startup(sockets)
        self._watching = asyncio.create_task(self.monitor.watch())
        self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Stop the stand first, so that listeners see it stop."""
        await asyncio.to_thread(self._runner.close)
        self._watching.cancel()
        await self._interfaces.__aexit__(None, None, None)
        await super().shutdown(sockets)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End without raising the signal again, as uvicorn's own handler would: being asked to end is no failure."""
        self.force_exit |= self.should_exit and sig == signal.SIGINT
        self.should_exit = True


def config(state: AppState, binding: Binding) -> uvicorn.Config:
    """How uvicorn serves the page: no log of requests, small limits, no compression that would cost memory."""
    return uvicorn.Config(
        create_app(state, allowed_hosts(binding.host, binding.names)),
        log_config=None,
        log_level="error",
        access_log=False,
        server_header=False,
        proxy_headers=bool(binding.proxies),
        forwarded_allow_ips=list(binding.proxies),
        loop="asyncio",
        lifespan="on",
        timeout_keep_alive=int(HEAD_TIMEOUT_S),
        timeout_graceful_shutdown=SHUTDOWN_TIMEOUT_S,
        h11_max_incomplete_event_size=MAX_HEAD_BYTES,
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_per_message_deflate=False,
        ssl_certfile=binding.certificate,
        ssl_keyfile=binding.key,
    )
