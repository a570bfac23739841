"""All that the routes work with: one stand, its folder, its worker, its results, and who may do what."""

import asyncio
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Protocol

from fastapi import Depends
from starlette.requests import HTTPConnection, Request

from truestand.web.hub import Hub
from truestand.web.recipes import Folder
from truestand.web.results import Results
from truestand.web.routing import Who
from truestand.web.runner import Runner
from truestand.web.sessions import Sessions
from truestand.web.throttle import Throttle
from truestand.web.users import Gatekeeper


@dataclass(frozen=True, slots=True)
class Settings:
    """What ``truestand serve`` was told."""

    stand: Path
    artefact: Path
    store: Path
    cache: Path | None = None
    """Default: beside the store."""

    @property
    def cache_folder(self) -> Path:
        """For what can be made again."""
        return self.cache or self.store.with_name(f"{self.store.name}.cache")

    @property
    def jobs_folder(self) -> Path:
        """Where jobs work, and leave what came of those that failed."""
        return self.store.with_name(f"{self.store.name}.jobs")


class Ask(Protocol):
    """One-shot helpers in a process of their own (tasks.py)."""

    async def __call__(self, *arguments: str, text: str = "", within: float = 30.0) -> object:
        """Their answer."""


@dataclass(slots=True)
class Page:
    """The page of one stand."""

    settings: Settings
    results: Results
    runner: Runner
    hub: Hub
    gatekeeper: Gatekeeper
    ask: Ask
    sessions: Sessions = field(default_factory=Sessions)
    throttle: Throttle = field(default_factory=Throttle)
    devices: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Held while something other than a job talks to the stand's devices."""
    clouds: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Held while a cloud is thinned out: one at a time, for its memory."""
    audits: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Held while the store is audited."""
    recipes: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Held while a recipe is written, and while a job reads what it starts with: neither comes between the other."""

    @property
    def folder(self) -> Folder:
        """The recipes."""
        return Folder(self.settings.stand.parent)

    @property
    def login_needed(self) -> bool:
        """Whether there are users, or were."""
        return self.gatekeeper.login_needed

    def who(self, cookie: str | None, seen: bool = True) -> Who:
        """Who a cookie belongs to; on a page that never had users everyone is an engineer."""
        if not self.login_needed:
            return Who(None, "engineer")
        user = self.gatekeeper.users.get(self.sessions.user(cookie, seen) or "")
        return Who(None, None) if user is None else Who(user.name, user.role)

    def is_csrf(self, cookie: str | None, token: str | None) -> bool:
        """Whether that is the cookie's token against forged writes."""
        return self.sessions.is_csrf(cookie, token)


def page_of(request: HTTPConnection) -> Page:
    """The page that a request is for."""
    page: Page = request.app.state.page
    return page


def who_of(request: Request) -> Who:
    """Who asks; the route's policy has let them in."""
    who: Who = request.state.who
    return who


ThePage = Annotated[Page, Depends(page_of)]
TheWho = Annotated[Who, Depends(who_of)]
