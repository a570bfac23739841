"""The newest to everyone, a backlog to nobody."""

import asyncio
import json
import threading
import time

import pytest
from websockets.exceptions import ConnectionClosed

from patience import NOT_FOR_EVER
from small_records import calibration
from truestand.store import Store
from truestand.web import watch
from truestand.web.hub import Hub
from truestand.web.interfaces.status import StatusPublisher
from truestand.web.routes import jobs


def until(socket, accepts, within=NOT_FOR_EVER):
    end = time.monotonic() + within
    while time.monotonic() < end:
        event = json.loads(socket.recv(timeout=within))
        if accepts(event):
            return event
    raise AssertionError


def test_a_job_is_seen_from_start_to_end(client):
    with client.live() as socket:
        client.post("/api/jobs", {"kind": "calibrate", "serial": "long"})
        event = until(socket, lambda e: e["type"] == "live")
        assert set(event["live"]) == {"state", "done", "position_deg", "sensors"}
        assert len(event["live"]["sensors"][0]["profile"]["x"]) == 160
        job = client.get("/api/jobs/current").json
        client.post(f"/api/jobs/{job['id']}/abort")
        until(socket, lambda e: e["type"] == "job" and e["job"]["state"] == "aborted")


def test_a_late_listener_gets_the_newest_job(client, state):
    client.post("/api/jobs", {"kind": "calibrate", "serial": "fail"})
    state.runner._reader.join(20)
    with client.live() as socket:
        event = json.loads(socket.recv(timeout=NOT_FOR_EVER))
        assert event["type"] == "job" and event["job"]["state"] == "failed"
        with pytest.raises(TimeoutError):
            assert json.loads(socket.recv(timeout=0.3))["type"] == "home"
            socket.recv(timeout=0.3)


def test_a_listener_that_sends_is_disconnected(client):
    for message in ("hello", b"\x00" * 100, "{" * 4000, "x" * 10_000_000):
        with client.live() as socket, pytest.raises(ConnectionClosed):
            socket.send(message)
            until(socket, lambda event: False)


def test_too_many_listeners_are_told_to_try_again_later(client, monkeypatch):
    monkeypatch.setattr(jobs, "MAX_LISTENERS", 1)
    with client.live() as first:
        with client.live() as second, pytest.raises(ConnectionClosed) as refused:
            second.recv(timeout=NOT_FOR_EVER)
        assert refused.value.rcvd.code == jobs.TRY_AGAIN_LATER
        first.ping().wait(5)


def test_a_slow_listener_gets_the_newest_only():
    async def listen():
        hub = Hub()
        listener = hub.listen()
        for n in range(10_000):
            hub.publish("live", str(n))
            if n % 1000 == 0:
                hub.publish("job", f"job {n}")
        first = await listener.next()
        hub.publish("live", "last")
        return first, await listener.next()

    assert asyncio.run(listen()) == (["job 9000", "9999"], ["last"])


def test_publishing_from_a_thread_wakes_listeners():
    async def listen():
        hub = Hub()
        listener = hub.listen()
        threading.Timer(0.05, hub.publish, ("live", "came")).start()
        async with asyncio.timeout(NOT_FOR_EVER):
            return await listener.next()

    assert asyncio.run(listen()) == ["came"]


def test_publishing_costs_the_same_however_many_listen():
    async def cost(listeners):
        hub = Hub()
        kept = [hub.listen() for _ in range(listeners)]
        began = time.perf_counter()
        for n in range(20_000):
            hub.publish("live", str(n))
        return time.perf_counter() - began, kept

    few, many = asyncio.run(cost(1))[0], asyncio.run(cost(100))[0]
    assert many < 3 * few + 0.05


def test_one_task_looks_at_the_disk_for_the_page_and_the_interfaces(state, monkeypatch):
    looks = []
    monkeypatch.setattr(watch, "home", lambda state: looks.append(1) or {"version": str(len(looks))})
    monkeypatch.setattr(watch, "POLL_INTERVAL_S", 0.05)

    async def both():
        async with StatusPublisher(state).running(), watch.watching(state):
            assert len([t for t in asyncio.all_tasks() if t.get_coro().__name__ == "watch"]) == 1
            async with asyncio.timeout(NOT_FOR_EVER):
                while len(looks) < 3:
                    await asyncio.sleep(0.01)
        assert not state.is_watched and not state.hub.listeners

    asyncio.run(both())


def test_the_interfaces_follow_what_another_program_stores(state):
    async def see():
        async with StatusPublisher(state).running() as status:
            store = Store.open(state.settings.store, create=True)
            await asyncio.to_thread(store.add, "calibration", calibration())
            async with asyncio.timeout(NOT_FOR_EVER):
                async for snapshot in status.changes():
                    if snapshot.number:
                        break
            assert (snapshot.number, snapshot.count) == (1, 1)

    asyncio.run(see())
