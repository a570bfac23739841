"""Who asks: login, logout, and what a page needs to know at first."""

from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from truestand._version import __version__
from truestand.core.errors import BadRecipe
from truestand.files.recipes.recipes import read_toml
from truestand.web.app_state import Page, ThePage, TheWho
from truestand.web.models import LoginBody, SessionTold
from truestand.web.problem import Problem
from truestand.web.routing import Doors, Policy, Who
from truestand.web.sessions import COOKIE, new_cookie


def add(doors: Doors) -> None:
    """Register."""
    anyone = Policy(None)
    doors.add("GET", "/api/session", told, anyone, "Who asks, the CSRF token, the stand", response_model=SessionTold)
    doors.add("POST", "/api/login", login, Policy(None, body=8_000), "Log in", (401, 429), response_model=SessionTold)
    doors.add("POST", "/api/logout", logout, anyone, "Log out", response_model=SessionTold)


def told(request: Request, response: Response, page: ThePage, who: TheWho) -> dict[str, Any]:
    """A visitor without a cookie gets one; nothing is remembered of it before a login."""
    cookie = request.state.cookie
    if cookie is None:
        cookie = new_cookie()
        _give(response, cookie, request)
    return _session(page, who, cookie)


async def login(body: LoginBody, request: Request, response: Response, page: ThePage) -> dict[str, Any]:
    """A new cookie where name and password are right; slower after each failure."""
    address = request.client.host if request.client else ""
    keys = (("address", address), ("user", body.user))
    wait = page.throttle.attempt(*keys)
    if wait > 0:
        raise Problem(429, f"found too many failed logins; wait {wait:.0f} s", retry_after=int(wait) + 1)
    user = await run_in_threadpool(page.gatekeeper.check, body.user, body.password)
    if user is None:
        raise Problem(401, "found no user with this name and password; try again, or ask an engineer")
    page.throttle.succeeded(*keys)
    page.sessions.end(request.state.cookie)
    cookie = page.sessions.begin(user.name)
    _give(response, cookie, request)
    return await run_in_threadpool(_session, page, Who(user.name, user.role), cookie)


def logout(request: Request, response: Response, page: ThePage) -> dict[str, Any]:
    """The cookie counts no longer, here or anywhere it was copied to."""
    page.sessions.end(request.state.cookie)
    cookie = new_cookie()
    _give(response, cookie, request)
    return _session(page, page.who(cookie), cookie)


def _give(response: Response, cookie: str, request: Request) -> None:
    secure = request.url.scheme == "https"
    response.set_cookie(COOKIE, cookie, httponly=True, samesite="strict", secure=secure, path="/")


def _company(page: Page) -> str:
    """As the head of the reports has it."""
    try:
        told = read_toml(page.settings.stand).get("company", {})
    except BadRecipe:
        return ""
    return str(told.get("name", "")) if isinstance(told, dict) else ""


def _session(page: Page, who: Who, cookie: str) -> dict[str, Any]:
    return {
        "user": who.user,
        "role": who.role,
        "login_needed": page.login_needed,
        "csrf": page.sessions.csrf(cookie),
        "company": _company(page),
        "version": __version__,
        "stand": page.settings.stand.absolute().parent.name,
    }
