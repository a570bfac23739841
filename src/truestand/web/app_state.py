"""What all routes work with: one stand, its folder, its job runner, its results, and who may do what."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from fastapi import Depends
from starlette.requests import HTTPConnection, Request

from truestand.web.authentication import Authenticator, Principal, Sessions, Throttle, users_path
from truestand.web.hub import Hub
from truestand.web.recipes import RecipeFolder
from truestand.web.result_index import ResultIndex
from truestand.web.runner import WORKER, JobRunner
from truestand.web.tasks import run_task


@dataclass(frozen=True, slots=True)
class Settings:
    """The files of a stand, as ``truestand serve`` was given them."""

    stand: Path
    artefact: Path
    store: Path

    @property
    def cache_folder(self) -> Path:
        """For what can be made again."""
        return self.store.with_name(f"{self.store.name}.cache")

    @property
    def jobs_folder(self) -> Path:
        """Where jobs work, and leave what came of those that failed."""
        return self.store.with_name(f"{self.store.name}.jobs")


@dataclass(slots=True)
class AppState:
    """The state that all requests share."""

    settings: Settings
    results: ResultIndex
    hub: Hub
    runner: JobRunner
    authenticator: Authenticator
    run_task: Callable[..., Awaitable[Any]] = run_task
    sessions: Sessions = field(default_factory=Sessions)
    throttle: Throttle = field(default_factory=Throttle)
    devices_lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Held while something other than a job talks to the stand's devices."""
    cloud_lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Held while a cloud is thinned out: one at a time, for its memory."""
    audit_lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Held while the store is audited."""
    recipe_lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Held while a recipe is written, and while a job reads what it starts with: neither comes between the other."""
    is_watched: bool = False
    """Whether a task looks at the disk already."""

    @property
    def folder(self) -> RecipeFolder:
        """The recipes."""
        return RecipeFolder(self.settings.stand.parent)

    def principal(self, cookie: str | None, is_use: bool = True) -> Principal:
        """Who a cookie belongs to; ``is_use``: its session is idle no longer."""
        return self.authenticator.principal(self.sessions.user(cookie, is_use))


def make_state(settings: Settings, worker: Sequence[str] = WORKER) -> AppState:
    """The state of a stand's page; ``worker``: the command that runs a job."""
    hub = Hub()
    return AppState(
        settings,
        ResultIndex(settings.store, settings.stand),
        hub,
        JobRunner(hub, worker),
        Authenticator(users_path(settings.store)),
    )


def app_state(connection: HTTPConnection) -> AppState:
    """The state of the application that a request is for."""
    state: AppState = connection.app.state.shared
    return state


def _principal(request: Request) -> Principal:
    """Who sends the request, as its route's policy found it."""
    principal: Principal = request.state.principal
    return principal


StateDep = Annotated[AppState, Depends(app_state)]
PrincipalDep = Annotated[Principal, Depends(_principal)]
