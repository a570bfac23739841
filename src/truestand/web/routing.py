"""Routes with their policies: there is no other way to register one, and none goes without.

A route lets nobody in before its policy has been asked, nor reads a byte of the body. A body is read whole before
anything is made of it, within its route's limit, and in time.
"""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from fastapi import Request, Response, WebSocket
from fastapi.routing import APIRoute, APIWebSocketRoute
from starlette.requests import HTTPConnection
from starlette.types import Message, Receive

from truestand.web.app_state import app_state
from truestand.web.authentication import COOKIE, Role, valid_cookie
from truestand.web.models import ProblemBody
from truestand.web.problem import Problem

READ_METHODS = ("GET", "HEAD")
BODY_TIMEOUT_S = 15.0
Endpoint = TypeVar("Endpoint", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True)
class Policy:
    """Who may call a route, and with how much."""

    role: Role | None
    """None: anyone. An engineer may do all that an operator may."""
    max_body_bytes: int = 1_000
    """Read methods take none."""


ANYONE, OPERATOR, ENGINEER = Policy(None), Policy("operator"), Policy("engineer")


class GuardedRoute(APIRoute):
    """An HTTP route behind its policy."""

    def __init__(self, path: str, endpoint: Callable[..., Any], *, policy: Policy, **options: Any) -> None:
        self.policy = policy
        super().__init__(path, endpoint, **options)

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """FastAPI's handler, called after the policy with a body that is already there."""
        inner = super().get_route_handler()

        async def handle(request: Request) -> Response:
            reads = request.method in READ_METHODS
            authorize(request, self.policy, write=not reads)
            return await inner(await _with_body(request, 0 if reads else self.policy.max_body_bytes))

        return handle


class GuardedWebSocketRoute(APIWebSocketRoute):
    """A WebSocket whose policy is asked before it opens."""

    def __init__(self, path: str, endpoint: Callable[..., Any], *, policy: Policy) -> None:
        self.policy = policy

        async def guarded(websocket: WebSocket) -> None:
            try:
                authorize(websocket, policy, write=False)
            except Problem:
                await websocket.close(1008)  # before it was accepted: the client sees 403
                return
            await endpoint(websocket)

        super().__init__(path, guarded)


def authorize(connection: HTTPConnection, policy: Policy, write: bool) -> None:
    """Note who sends a request, as ``connection.state.principal``, and let them in.

    Raises:
        Problem: 401 not logged in, 403 not allowed to, or a write without its CSRF token.
    """
    state = app_state(connection)
    cookie = valid_cookie(connection.cookies.get(COOKIE))
    principal = state.principal(cookie)
    connection.state.principal, connection.state.cookie = principal, cookie
    if policy.role is not None and principal.role is None:
        raise Problem(401, "found no login, need one; log in and try again")
    if policy.role == "engineer" and principal.role != "engineer":
        raise Problem(403, f"found role {principal.role}, need engineer; ask one of them")
    if write and not state.sessions.is_csrf(cookie, connection.headers.get("x-csrf-token")):
        raise Problem(403, "found no valid X-CSRF-Token, need the one of GET /api/session; load the page again")


class Routes(list[GuardedRoute | GuardedWebSocketRoute]):
    """The routes of one topic; HTTP routes are registered by decorating their functions."""

    def add(
        self, method: str, path: str, policy: Policy, summary: str, refusals: Sequence[int] = (), **options: Any
    ) -> Callable[[Endpoint], Endpoint]:
        """Register the function; ``refusals``: statuses that it may answer beyond its policy's, for OpenAPI."""
        statuses = {*refusals, *((401, 403) if policy.role else ()), *(() if method in READ_METHODS else (403, 422))}
        responses: dict[int | str, dict[str, Any]] = {s: {"model": ProblemBody} for s in sorted(statuses)}

        def register(endpoint: Endpoint) -> Endpoint:
            route = GuardedRoute(
                path, endpoint, policy=policy, methods=[method], summary=summary, responses=responses, **options
            )
            self.append(route)
            return endpoint

        return register


def require_policies(routes: Sequence[object]) -> None:
    """Refuse to serve a route that was not registered here.

    Raises:
        RuntimeError: there is one.
    """
    unguarded = [str(getattr(r, "path", r)) for r in routes if not isinstance(r, GuardedRoute | GuardedWebSocketRoute)]
    if unguarded:
        raise RuntimeError(f"routes without a policy: {', '.join(unguarded)}; register them with Routes.add")


async def _with_body(request: Request, limit: int) -> Request:
    """The same request with its body, of at most ``limit`` bytes, already there.

    Raises:
        Problem: 413 too large, 408 too slow.
    """
    stated = request.headers.get("content-length", "0")
    chunked = "transfer-encoding" in request.headers
    if (stated.isdecimal() and int(stated) > limit) or (chunked and limit == 0):
        raise _too_large(limit)
    complete = Request(request.scope, _limited(request.receive, limit))
    if limit > 0:
        try:
            async with asyncio.timeout(BODY_TIMEOUT_S):
                await complete.body()
        except TimeoutError:
            raise Problem(408, f"found a body slower than {BODY_TIMEOUT_S:g} s, need it at once; try again") from None
    return complete


def _limited(receive: Receive, limit: int) -> Receive:
    size = 0

    async def limited() -> Message:
        nonlocal size
        message = await receive()
        size += len(message.get("body", b""))
        if size > limit:
            raise _too_large(limit)
        return message

    return limited


def _too_large(limit: int) -> Problem:
    return Problem(413, f"found a body of more than {limit} bytes, need {'less' if limit else 'none'}; shorten it")
