"""The application: routes behind their policies, refusals in one shape, the shield around it all."""

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import anyio.to_thread
from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp

from truestand._version import __version__
from truestand.core.errors import BadRecipe, TruestandError
from truestand.web.app_state import Page
from truestand.web.problem import Problem
from truestand.web.routes import devices, downloads, evidence, files, home, jobs, live, recipes, results, session
from truestand.web.routing import Doors, Policy, demand_policies
from truestand.web.security import Names, Shield

THREADS = 8
"""At once, for what waits for a disk; each costs memory."""
TOPICS = (session, home, jobs, live, results, downloads, evidence, recipes, devices, files)


def create_app(page: Page, names: Names) -> ASGIApp:
    """The page of one stand, ready to serve."""
    return Shield(routed(page), names)


def routed(page: Page) -> FastAPI:
    """The routes without the shield.

    Raises:
        RuntimeError: a route without a policy.
    """
    app = FastAPI(
        title="truestand",
        version=__version__,
        summary="A rotary laser inspection stand: its jobs, results and recipes.",
        description="Every write needs the header `X-CSRF-Token` as told by GET /api/session.",
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        lifespan=_few_threads,
    )
    app.state.page = page
    doors = Doors(app.router)
    described = app.openapi
    doors.add(
        "GET", "/api/openapi.json", lambda: described(), Policy(None), "This description", include_in_schema=False
    )
    for topic in TOPICS:
        topic.add(doors)
    demand_policies(app.routes)
    for kind, tell in REFUSALS.items():
        app.add_exception_handler(kind, tell)
    return app


@asynccontextmanager
async def _few_threads(app: FastAPI) -> AsyncIterator[None]:
    anyio.to_thread.current_default_thread_limiter().total_tokens = THREADS
    yield


async def _problem(request: Request, wrong: Exception) -> Response:
    assert isinstance(wrong, Problem)
    return JSONResponse({"problem": wrong.message}, wrong.status, headers=wrong.headers)


async def _http(request: Request, wrong: Exception) -> Response:
    """404 and 405 of the router."""
    assert isinstance(wrong, HTTPException)
    return JSONResponse({"problem": f"{wrong.detail}; see /api/openapi.json"}, wrong.status_code, headers=wrong.headers)


async def _invalid(request: Request, wrong: Exception) -> Response:
    """The first thing that is wrong, without what was sent: it may be a password."""
    assert isinstance(wrong, RequestValidationError)
    first = wrong.errors()[0]
    where = ".".join(str(part) for part in first["loc"])[:100]
    return JSONResponse({"problem": f"{where}: {first['msg'][:300]}; see /api/openapi.json"}, 422)


async def _expected(request: Request, wrong: Exception) -> Response:
    return JSONResponse({"problem": str(wrong)}, 422 if isinstance(wrong, BadRecipe) else 409)


async def _unexpected(request: Request, wrong: Exception) -> Response:
    """The server's log has the rest."""
    return JSONResponse({"problem": "found an error of the server, see what it printed; try again"}, 500)


Tell = Callable[[Request, Any], Awaitable[Response]]
REFUSALS: dict[type[Exception], Tell] = {
    Problem: _problem,
    HTTPException: _http,
    RequestValidationError: _invalid,
    TruestandError: _expected,
    Exception: _unexpected,
}
