"""Every route of the page with its policy. There is no other way to register one, and none goes without."""

from collections.abc import Awaitable, Callable, Coroutine, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from fastapi import APIRouter, WebSocket
from fastapi.routing import APIRoute, APIWebSocketRoute
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response

from truestand.web.body import with_body
from truestand.web.models import ProblemBody
from truestand.web.problem import Problem
from truestand.web.sessions import COOKIE, sound
from truestand.web.users import Role

READING = ("GET", "HEAD")


@dataclass(frozen=True, slots=True)
class Policy:
    """Who may call a route, and with how much."""

    role: Role | None
    """None: anyone. An engineer may do all that an operator may."""
    body: int = 1_000
    """Bytes; what reads takes none."""


@dataclass(frozen=True, slots=True)
class Who:
    """Who asks."""

    user: str | None
    role: Role | None


class Guard(Protocol):
    """What tells who asks, and whether a write was meant."""

    def who(self, cookie: str | None, seen: bool = True) -> Who:
        """Who a cookie belongs to."""

    def is_csrf(self, cookie: str | None, token: str | None) -> bool:
        """Whether that is the cookie's token against forged writes."""


class Door(APIRoute):
    """A route that lets nobody in before its policy has been asked, nor reads a byte of the body."""

    def __init__(self, path: str, endpoint: Callable[..., Any], *, policy: Policy, **told: Any) -> None:
        self.policy = policy
        super().__init__(path, endpoint, **told)

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """FastAPI's handler behind the policy."""
        inner = super().get_route_handler()

        async def handle(request: Request) -> Response:
            admit(request, self.policy, write=request.method not in READING)
            return await inner(await with_body(request, 0 if request.method in READING else self.policy.body))

        return handle


class SocketDoor(APIWebSocketRoute):
    """A WebSocket whose policy is asked before it opens."""

    def __init__(self, path: str, endpoint: Callable[..., Any], *, policy: Policy) -> None:
        self.policy = policy

        async def guarded(websocket: WebSocket) -> None:
            try:
                admit(websocket, policy, write=False)
            except Problem:
                await websocket.close(1008)  # before it was accepted: the client sees 403
                return
            await endpoint(websocket)

        super().__init__(path, guarded)


def admit(connection: HTTPConnection, policy: Policy, write: bool) -> Who:
    """Who is let in.

    Raises:
        Problem: 401 not logged in, 403 not allowed to.
    """
    guard: Guard = connection.app.state.page
    cookie = sound(connection.cookies.get(COOKIE))
    who = guard.who(cookie)
    connection.state.who, connection.state.cookie = who, cookie
    if policy.role is not None and who.role is None:
        raise Problem(401, "found no login, need one; log in and try again")
    if policy.role == "engineer" and who.role != "engineer":
        raise Problem(403, f"found role {who.role}, need engineer; ask one of them")
    if write and not guard.is_csrf(cookie, connection.headers.get("x-csrf-token")):
        raise Problem(403, "found no valid X-CSRF-Token, need the one of GET /api/session; load the page again")
    return who


@dataclass(frozen=True, slots=True)
class Doors:
    """Where routes are registered."""

    router: APIRouter

    def add(
        self,
        method: str,
        path: str,
        endpoint: Callable[..., Any],
        policy: Policy,
        summary: str,
        responses: Sequence[int] = (),
        **told: Any,
    ) -> None:
        """A route; ``responses``: the refusals that it may answer beyond its policy's, for the documentation."""
        statuses = {*responses, *((401, 403) if policy.role else ()), *(() if method in READING else (403, 422))}
        refusals: dict[int | str, dict[str, Any]] = {s: {"model": ProblemBody} for s in sorted(statuses)}
        route = Door(path, endpoint, policy=policy, methods=[method], summary=summary, responses=refusals, **told)
        self.router.routes.append(route)

    def add_socket(self, path: str, endpoint: Callable[[WebSocket], Awaitable[None]], policy: Policy) -> None:
        """A WebSocket."""
        self.router.routes.append(SocketDoor(path, endpoint, policy=policy))


def demand_policies(routes: Sequence[object]) -> None:
    """Refuse to serve a route that was not registered here.

    Raises:
        RuntimeError: there is one.
    """
    open_ones = [str(getattr(r, "path", r)) for r in routes if not isinstance(r, Door | SocketDoor)]
    if open_ones:
        raise RuntimeError(f"routes without a policy: {', '.join(open_ones)}; register them with Doors.add")
