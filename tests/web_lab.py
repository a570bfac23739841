"""A page that is really served, on a port of its own, with a fake worker; and a client that speaks plain HTTP."""

import asyncio
import http.client
import json
import socket
import sys
import threading
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from websockets.sync.client import connect

from truestand.files.recipes.recipes import write_starters
from truestand.web import app_state
from truestand.web.app_state import Settings
from truestand.web.authentication import make_user, users_path, write_users
from truestand.web.serving import Binding, Server, bind, config

WORKER = (sys.executable, str(Path(__file__).with_name("scripted_worker.py")))
PASSWORD = "correct horse battery"
NOBODY_THERE = {"127.0.0.1:5020": "127.0.0.1:9", 'address = "127.0.0.1"': 'address = "127.0.0.2"'}
"""In the starter's stand.toml: its devices, which a virtual stand may serve on this machine, where nobody answers."""
SERVERS = {}
"""By port, to look into."""


def weak_user(name, role):
    """A user whose password is checked in no time."""
    return make_user(name, role, PASSWORD, {"n": 16, "r": 8, "p": 1})


def change(file, texts):
    """Replace ``texts`` (old to new) in a file that has them all."""
    text = file.read_text(encoding="utf-8")
    for old, new in texts.items():
        assert old in text, old
        text = text.replace(old, new)
    file.write_text(text, encoding="utf-8")


def make_state(folder, users=(), worker=WORKER):
    """Of a stand with the starter recipes, and a scripted worker."""
    stand = folder / "stand.toml"
    if not stand.exists():
        write_starters(folder)
        change(stand, NOBODY_THERE)
    settings = Settings(stand, folder / "shaft.toml", folder / "results")
    if users:
        write_users(users_path(settings.store), {name: weak_user(name, role) for name, role in users})
    return app_state.make_state(settings, worker)


@contextmanager
def served(state, **binding):
    """Its port."""
    at = Binding(port=0, **binding)
    listening = bind(at)
    ready = threading.Event()
    server = Server(config(state, at), state.runner, ready.set)
    thread = threading.Thread(target=lambda: asyncio.run(server.serve([listening])))
    thread.start()
    try:
        assert ready.wait(60.0)
        port = listening_port(server)
        SERVERS[port] = server
        yield port
    finally:
        server.should_exit = True
        thread.join(60.0)
        assert not thread.is_alive()


def listening_port(server):
    return server.servers[0].sockets[0].getsockname()[1]


@dataclass
class Answer:
    status: int
    headers: http.client.HTTPMessage
    body: bytes

    @property
    def json(self):
        return json.loads(self.body)

    @property
    def problem(self):
        return self.json["problem"]


@dataclass
class Client:
    """Keeps the cookie and sends the token with every write, as the page does."""

    port: int
    cookie: str = ""
    csrf: str = ""
    log: list = field(default_factory=list)

    def ask(self, method, path, body=None, headers=None, timeout=20.0):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=timeout)
        sent = {} if not self.cookie else {"Cookie": f"truestand={self.cookie}"}
        if method not in ("GET", "HEAD") and self.csrf:
            sent["X-CSRF-Token"] = self.csrf
        if body is not None and not isinstance(body, bytes):
            body, sent["Content-Type"] = json.dumps(body).encode(), "application/json"
        try:
            connection.request(method, path, body, {**sent, **(headers or {})})
            got = connection.getresponse()
            answer = Answer(got.status, got.headers, got.read())
        finally:
            connection.close()
        given = answer.headers.get("Set-Cookie", "")
        if given.startswith("truestand="):
            self.cookie = given.partition("=")[2].partition(";")[0]
        return answer

    def get(self, path, **more):
        return self.ask("GET", path, **more)

    def post(self, path, body=None, **more):
        return self.ask("POST", path, body, **more)

    def session(self):
        payload = self.get("/api/session").json
        self.csrf = payload["csrf"]
        return payload

    def login(self, user, password=PASSWORD):
        self.session()
        answer = self.post("/api/login", {"user": user, "password": password})
        if answer.status == 200:
            self.csrf = answer.json["csrf"]
        return answer

    def live(self, **headers):
        """A WebSocket."""
        sent = {"Cookie": f"truestand={self.cookie}"} | headers
        return connect(f"ws://127.0.0.1:{self.port}/api/live", additional_headers=sent, compression=None, proxy=None)


def raw(port, request, timeout=10.0):
    """What comes back for bytes as they are."""
    with socket.create_connection(("127.0.0.1", port), timeout=timeout) as connection:
        connection.sendall(request)
        got = b""
        try:
            while block := connection.recv(65536):
                got += block
        except (ConnectionResetError, TimeoutError):
            pass
        return got


def snapshot(folder):
    """Every file of a folder and what is in it."""
    return {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in sorted(folder.rglob("*")) if p.is_file()}


def main(folder, port=0):
    """Serve a page with the fake worker until the input ends: ``python web_lab.py FOLDER [PORT]`` prints the port."""
    state, at = make_state(Path(folder)), Binding(port=int(port))
    listening = bind(at)
    server = Server(config(state, at), state.runner, lambda: print(listening_port(server), flush=True))
    threading.Thread(target=lambda: (sys.stdin.read(), setattr(server, "should_exit", True)), daemon=True).start()
    asyncio.run(server.serve([listening]))


if __name__ == "__main__":
    main(*sys.argv[1:])
