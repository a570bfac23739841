"""The application: routes behind their policies, refusals in one shape, the security middleware around it all."""

from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

import anyio.to_thread
from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse
from starlette.types import ASGIApp

from truestand._version import __version__
from truestand.core.errors import BadRecipe, TruestandError
from truestand.web.app_state import AppState
from truestand.web.problem import Problem
from truestand.web.routes import files, jobs, recipes, results, session, stand
from truestand.web.routing import ANYONE, Routes, require_policies
from truestand.web.security import AllowedHosts, SecurityMiddleware
from truestand.web.watch import watching

MAX_THREADS = 8
"""At once, for what waits for a disk; each costs memory."""
routes = Routes()


def create_app(state: AppState, hosts: AllowedHosts) -> ASGIApp:
    """The page of one stand, ready to serve.

    Raises:
        RuntimeError: a route without a policy.
    """
    return SecurityMiddleware(create_api(state), hosts)


def create_api(state: AppState) -> FastAPI:
    """The routes without the security middleware.

    Raises:
        RuntimeError: a route without a policy.
    """
    app = FastAPI(
        title="truestand",
        version=__version__,
        summary="A rotary laser inspection stand: its jobs, results and recipes.",
        description="Every write needs the header `X-CSRF-Token` of GET /api/session.",
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        lifespan=_lifespan,
        exception_handlers=EXCEPTION_HANDLERS,
    )
    app.state.shared = state
    # files last: any name that no other route has is looked for there
    for topic in (routes, *(module.routes for module in (session, stand, jobs, results, recipes, files))):
        app.router.routes.extend(topic)
    require_policies(app.routes)
    return app


@routes.add("GET", "/api/openapi.json", ANYONE, "This description", include_in_schema=False)
def openapi(request: Request) -> dict[str, Any]:
    """Of all routes."""
    description: dict[str, Any] = request.app.openapi()
    return description


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    anyio.to_thread.current_default_thread_limiter().total_tokens = MAX_THREADS
    async with watching(app.state.shared):
        yield


async def _refused(request: Request, refused: HTTPException) -> JSONResponse:
    """Ours, and the router's 404 and 405."""
    hint = "" if isinstance(refused, Problem) else "; see /api/openapi.json"
    return JSONResponse({"problem": f"{refused.detail}{hint}"}, refused.status_code, headers=refused.headers)


async def _invalid(request: Request, wrong: RequestValidationError) -> JSONResponse:
    """The first thing that is wrong, without what was sent: it may be a password."""
    first = wrong.errors()[0]
    where = ".".join(str(part) for part in first["loc"])[:100]
    return JSONResponse({"problem": f"{where}: {first['msg'][:300]}; see /api/openapi.json"}, 422)


async def _expected(request: Request, wrong: TruestandError) -> JSONResponse:
    return JSONResponse({"problem": str(wrong)}, 422 if isinstance(wrong, BadRecipe) else 409)


async def _unexpected(request: Request, wrong: Exception) -> JSONResponse:
    """The server's log has the rest."""
    return JSONResponse({"problem": "found an error of the server, see what it printed; try again"}, 500)


EXCEPTION_HANDLERS: dict[int | type[Exception], Callable[[Request, Any], Coroutine[Any, Any, Response]]] = {
    HTTPException: _refused,
    RequestValidationError: _invalid,
    TruestandError: _expected,
    Exception: _unexpected,
}
