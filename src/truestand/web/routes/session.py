"""Who asks: login, logout, and what a page needs to know at first."""

from dataclasses import replace

from fastapi import Request, Response
from starlette.concurrency import run_in_threadpool

from truestand._version import __version__
from truestand.core.errors import BadRecipe
from truestand.files.recipes.recipes import read_toml
from truestand.web.app_state import AppState, PrincipalDep, StateDep
from truestand.web.authentication import COOKIE, Principal, new_cookie
from truestand.web.models import LoginBody, SessionInfo
from truestand.web.problem import Problem
from truestand.web.routing import ANYONE, Routes

routes = Routes()


@routes.add("GET", "/api/session", ANYONE, "Who asks, the CSRF token, the stand")
def session(request: Request, response: Response, state: StateDep, principal: PrincipalDep) -> SessionInfo:
    """A visitor without a cookie gets one; nothing is remembered of it before a login."""
    cookie = request.state.cookie
    if cookie is None:
        cookie = new_cookie()
        _set_cookie(response, cookie, request)
    return _info(state, principal, cookie)


@routes.add("POST", "/api/login", replace(ANYONE, max_body_bytes=8_000), "Log in", (401, 429))
async def login(body: LoginBody, request: Request, response: Response, state: StateDep) -> SessionInfo:
    """A new cookie where name and password are right; slower after each failure."""
    address = request.client.host if request.client else ""
    keys = (("address", address), ("user", body.user))
    wait = state.throttle.attempt(*keys)
    if wait > 0:
        headers = {"Retry-After": str(int(wait) + 1)}
        raise Problem(429, f"found too many failed logins; wait {wait:.0f} s", headers)
    user = await run_in_threadpool(state.authenticator.check, body.user, body.password)
    if user is None:
        raise Problem(401, "found no user with this name and password; try again, or ask an engineer")
    state.throttle.succeeded(*keys)
    state.sessions.end(request.state.cookie)
    cookie = state.sessions.begin(user.name)
    _set_cookie(response, cookie, request)
    return await run_in_threadpool(_info, state, Principal(user.name, user.role), cookie)


@routes.add("POST", "/api/logout", ANYONE, "Log out")
def logout(request: Request, response: Response, state: StateDep) -> SessionInfo:
    """The cookie counts no longer, here or anywhere it was copied to."""
    state.sessions.end(request.state.cookie)
    cookie = new_cookie()
    _set_cookie(response, cookie, request)
    return _info(state, state.principal(cookie), cookie)


def _set_cookie(response: Response, cookie: str, request: Request) -> None:
    secure = request.url.scheme == "https"
    response.set_cookie(COOKIE, cookie, httponly=True, samesite="strict", secure=secure, path="/")


def _info(state: AppState, principal: Principal, cookie: str) -> SessionInfo:
    return SessionInfo(
        user=principal.user,
        role=principal.role,
        login_needed=state.authenticator.login_needed,
        csrf=state.sessions.csrf(cookie),
        company=_company(state),
        version=__version__,
        stand=state.settings.stand.absolute().parent.name,
    )


def _company(state: AppState) -> str:
    """As the head of the reports has it."""
    try:
        company = read_toml(state.settings.stand).get("company", {})
    except BadRecipe:
        return ""
    return str(company.get("name", "")) if isinstance(company, dict) else ""
