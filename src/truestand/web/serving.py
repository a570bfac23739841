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
from truestand.web.app_state import Page, Settings
from truestand.web.connections import HEAD, Keeper, protocols
from truestand.web.hub import Hub
from truestand.web.result_index import Kept
from truestand.web.runner import Runner
from truestand.web.security import names_of
from truestand.web.tasks import ask
from truestand.web.users import Gatekeeper, users_path

ENDING = 3
"""s that open connections have when the server ends."""
HEADERS = 16_384
"""Bytes of a request's head."""
MESSAGE = 4_096
"""Bytes of a listener's message; none is expected."""


Beside = AbstractAsyncContextManager[Sequence[str]]
"""What is served in the same loop, and where."""


@dataclass(frozen=True, slots=True)
class Binding:
    """Where the page is served."""

    host: str = "127.0.0.1"
    port: int = 8620
    names: tuple[str, ...] = ()
    """Under which it may be reached besides its own."""
    proxies: tuple[str, ...] = ()
    """IP addresses or networks that are believed who asks, and whether over https (X-Forwarded-For and -Proto)."""
    certificate: Path | None = None
    key: Path | None = None


def make_page(settings: Settings) -> Page:
    """The page of a stand with its worker and store."""
    hub = Hub()
    gatekeeper = Gatekeeper(users_path(settings.store))
    return Page(settings, Kept(settings.store), Runner(hub), hub, gatekeeper, ask)


def serve(
    page: Page,
    binding: Binding,
    tell: Callable[[str], None],
    open_browser: bool = False,
    beside: Beside | None = None,
) -> None:
    """Serve until SIGINT or SIGTERM; ``tell`` gets the addresses as soon as they answer, the page's first.

    Raises:
        BadRecipe: a page that others can reach, and no users; or an address that is none or can't be had.
        MissingExtra: what is served beside the page needs a package that isn't installed.
    """
    opened = f"--host {binding.host}" if not is_loopback(binding.host) else "--proxy" if binding.proxies else ""
    if opened and not page.gatekeeper.users:
        raise BadRecipe(
            f"found {opened} and no users, need one for a page that others can reach; "
            "run truestand serve --add-user NAME --role engineer"
        )
    _demand_addresses(binding.proxies)
    listening = bind(binding)
    host, port = listening.getsockname()[:2]
    shown = f"[{host}]" if ":" in host else host
    address = f"{'http' if binding.certificate is None else 'https'}://{shown}:{port}/"

    def ready() -> None:
        for one in (address, *server.addresses):
            tell(one)
        if open_browser:
            webbrowser.open(address)

    with listening:  # where what is served beside it doesn't come up
        server = Server(config(page, binding), page.runner, ready, beside)
        asyncio.run(server.serve([listening]))


def _demand_addresses(proxies: Sequence[str]) -> None:
    """Refuse what uvicorn would silently take for a name, or for anybody.

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
        found = {info[4][0] for info in socket.getaddrinfo(host, None)}
    except OSError:
        return False
    return all(ipaddress.ip_address(str(address).partition("%")[0]).is_loopback for address in found)


class Server(uvicorn.Server):
    """uvicorn's, which looks after its connections and stops the stand before it ends."""

    def __init__(
        self, config: uvicorn.Config, runner: Runner, ready: Callable[[], None], beside: Beside | None = None
    ) -> None:
        super().__init__(config)
        self.addresses: Sequence[str] = ()
        """Of what is served beside the page."""
        self._beside: Beside = beside or nullcontext(())
        self.keeper = Keeper()
        config.http, config.ws = protocols(self.keeper)
        self._runner, self._ready = runner, ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Say so when it answers."""
        self.addresses = await self._beside.__aenter__()
        await super().startup(sockets)
        self._watching = asyncio.create_task(self.keeper.watch())
        self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """The stand first; whoever listens sees it stop."""
        await asyncio.to_thread(self._runner.close)
        self._watching.cancel()
        await self._beside.__aexit__(None, None, None)
        await super().shutdown(sockets)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Being asked to end is how a server ends well: uvicorn's own would raise the signal again at the end."""
        self.force_exit |= self.should_exit and sig == signal.SIGINT
        self.should_exit = True


def config(page: Page, binding: Binding) -> uvicorn.Config:
    """How uvicorn serves the page: no log of requests, small limits, no compression that would cost memory."""
    return uvicorn.Config(
        create_app(page, names_of(binding.host, binding.names)),
        log_config=None,
        log_level="error",
        access_log=False,
        server_header=False,
        proxy_headers=bool(binding.proxies),
        forwarded_allow_ips=list(binding.proxies),
        loop="asyncio",
        lifespan="on",
        timeout_keep_alive=int(HEAD),
        timeout_graceful_shutdown=ENDING,
        h11_max_incomplete_event_size=HEADERS,
        ws_max_size=MESSAGE,
        ws_per_message_deflate=False,
        ssl_certfile=binding.certificate,
        ssl_keyfile=binding.key,
    )
