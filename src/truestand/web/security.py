"""The outermost layer: which hosts and origins are answered at all, and the headers of every answer.

A foreign Host (DNS rebinding) or Origin (another site in the same browser) is refused before anything else is looked
at, WebSockets too.
"""

import ipaddress
import socket
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from truestand.web.problem import Problem
from truestand.web.routing import READ_METHODS

CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "font-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
)
REPORT_CSP = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'"
)
HEADERS = {
    "content-security-policy": CSP,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=(), usb=(), serial=(), payment=()",
    "cache-control": "no-store",
}
"""On every answer that doesn't bring its own."""
LOCAL = ("localhost", "127.0.0.1", "[::1]")
PORTS = {"http": 80, "ws": 80, "https": 443, "wss": 443}


@dataclass(frozen=True, slots=True)
class AllowedHosts:
    """The names that a Host header may give."""

    local: frozenset[str]
    """At the server's port."""
    proxied: frozenset[str] = frozenset()
    """At any port: a proxy stands before it."""

    def allows(self, host: str, scope: Scope) -> bool:
        """Whether a Host header names this server: a known name or the address that was reached, and its port."""
        server: tuple[str, int | None] = scope.get("server") or ("", None)
        name, port = _split(host.lower())
        if name in self.proxied:
            return True
        expected = PORTS[scope["scheme"]] if port is None else port
        return expected == server[1] and (name in self.local or _address(name) == _address(server[0]) != "")


def allowed_hosts(host: str, proxied: Iterable[str] = ()) -> AllowedHosts:
    """The machine's names and the host that is bound to, and those ``proxied``."""
    local = (*LOCAL, socket.gethostname(), host if ":" not in host else f"[{host}]")
    return AllowedHosts(frozenset(n.lower() for n in local if n), frozenset(n.lower() for n in proxied))


class SecurityMiddleware:
    """Around the whole application."""

    def __init__(self, app: ASGIApp, hosts: AllowedHosts) -> None:
        self._app, self._hosts = app, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        try:
            self._check(scope)
        except Problem as refused:
            await _refuse(refused, scope, receive, send)
            return
        with suppress(ClientDisconnect):
            await self._app(scope, receive, send if scope["type"] == "websocket" else _with_headers(scope, send))

    def _check(self, scope: Scope) -> None:
        """Refuse what isn't from this page.

        Raises:
            Problem: 403 foreign, 400 a body where none belongs.
        """
        headers = Headers(scope=scope)
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or not self._hosts.allows(hosts[0], scope):
            raise Problem(403, "found a foreign Host, need this stand's address; see truestand serve --name")
        for origin in origins:
            scheme, _, at = origin.lower().partition("://")
            secure = scope["scheme"] in ("https", "wss")
            if at != hosts[0].lower() or scheme not in (("https",) if secure else ("http", "https")):
                raise Problem(403, "found a request from another site, need one from this page; open the page itself")
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin") and scope["path"].startswith("/api/"):
            raise Problem(403, "found a request from another site, need one from this page; open the page itself")
        has_body = headers.get("content-length", "0") != "0" or "transfer-encoding" in headers
        if scope["type"] == "http" and scope["method"] in READ_METHODS and has_body:
            raise Problem(400, f"found a body with {scope['method']}, need none; leave it out")


def _with_headers(scope: Scope, send: Send) -> Send:
    """Answers with ``HEADERS``; a refused write ends its connection, so that its body is not read on."""

    async def with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
            if message["status"] >= 400 and scope["method"] not in READ_METHODS:
                headers["connection"] = "close"
        await send(message)

    return with_headers


async def _refuse(refused: Problem, scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": ""})  # not yet accepted: 403
        return
    headers = {**HEADERS, "connection": "close"}
    await JSONResponse({"problem": refused.detail}, refused.status_code, headers)(scope, receive, send)


def _split(host: str) -> tuple[str, int | None]:
    """Name and port of a Host header."""
    name, colon, port = host.rpartition(":")
    if not colon or name.startswith("[") != name.endswith("]"):
        return host, None
    return (name, int(port)) if port.isascii() and port.isdecimal() and len(port) <= 5 else ("", None)


def _address(name: str) -> str:
    """An IP address in its one form; nothing for any other name."""
    try:
        return ipaddress.ip_address(name.strip("[]")).compressed
    except ValueError:
        return ""
