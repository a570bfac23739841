"""The event loop only waits: nothing in it reads a database or a recipe, or starts a process."""

import asyncio
import sqlite3
import subprocess
import tomllib

import pytest

from patience import NOT_FOR_EVER
from truestand.store import Store
from truestand.web.tasks import run_task
from web_lab import Client, make_state, served


def demand_thread():
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return
    raise AssertionError("called in the event loop")


@pytest.fixture
def loop_waits(monkeypatch):
    """Whatever opens a database, reads TOML or starts a process in the event loop fails."""

    def elsewhere(real):
        def checked(*arguments, **more):
            demand_thread()
            return real(*arguments, **more)

        return checked

    class Process(subprocess.Popen):
        def __init__(self, *arguments, **more):
            demand_thread()
            super().__init__(*arguments, **more)

    monkeypatch.setattr(sqlite3, "connect", elsewhere(sqlite3.connect))
    monkeypatch.setattr(tomllib, "loads", elsewhere(tomllib.loads))
    monkeypatch.setattr(subprocess, "Popen", Process)


GETS = ("/api/session", "/api/home", "/api/results", "/api/results/1", "/api/history", "/api/parts", "/api/recipes",
        "/api/recipes/gear.toml", "/api/jobs/current", "/api/results/1/certificate.xml", "/api/audit",
        "/api/devices")  # fmt: skip


def test_the_event_loop_never_blocks(tmp_path, loop_waits):
    state = make_state(tmp_path, (("erik", "engineer"),))
    Store.open(state.settings.store, create=True).add("calibration", {"status": "valid"})
    with served(state) as port:
        client = Client(port)
        assert client.login("erik").status == 200
        for path in GETS:
            assert client.get(path, timeout=60.0).status in (200, 409), path
        text = {"text": client.get("/api/recipes/gear.toml").json["text"]}
        for method, path in (("POST", "/api/recipes/gear.toml/check"), ("PUT", "/api/recipes/gear.toml")):
            assert client.ask(method, path, text).json == {"problem": None}
        assert client.post("/api/jobs", {"kind": "verify"}).status == 200
        state.runner._reader.join(20)
        assert state.runner.current()["state"] == "done"


def test_a_cancelled_task_is_ended(tmp_path, monkeypatch):
    begun = []

    class Process(subprocess.Popen):
        def __init__(self, command, **more):
            super().__init__([command[0], "-c", "input()"], **more)

        def communicate(self, *given):
            begun.append(self)
            return super().communicate(None, None)  # its input stays open

    monkeypatch.setattr(subprocess, "Popen", Process)

    async def leave():
        asking = asyncio.create_task(run_task("audit", str(tmp_path)))
        async with asyncio.timeout(NOT_FOR_EVER):
            while not begun:
                await asyncio.sleep(0.01)
        asking.cancel()
        await asyncio.gather(asking, return_exceptions=True)

    asyncio.run(leave())
    assert begun[0].wait(20) != 0
