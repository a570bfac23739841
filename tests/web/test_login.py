"""Users, passwords, sessions, and what slows guessing down."""

import contextlib
import os
import stat
import sys
import time

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from command import run
from patience import NOT_FOR_EVER
from truestand.core.errors import BadRecipe
from truestand.web.authentication import (
    THROTTLE_RULES,
    Authenticator,
    Sessions,
    Throttle,
    make_user,
    read_users,
    users_path,
    write_users,
)
from truestand.web.routes import jobs
from web_lab import PASSWORD, Client, make_state, served

posix = pytest.mark.skipif(sys.platform == "win32", reason="file modes")


class Clock:
    now = 1000.0

    def __call__(self):
        return self.now


def test_login_and_logout(visitor):
    payload = visitor.session()
    assert payload["login_needed"] and payload["user"] is None and payload["role"] is None
    assert visitor.get("/api/home").status == 401
    answer = visitor.login("olga")
    assert answer.json["user"] == "olga" and answer.json["role"] == "operator"
    assert visitor.get("/api/home").status == 200
    copied = Client(visitor.port, visitor.cookie)
    assert visitor.post("/api/logout").status == 200
    assert visitor.get("/api/home").status == 401
    assert copied.get("/api/home").status == 401


def test_a_login_changes_the_cookie(visitor):
    """A cookie that someone planted beforehand is worth nothing afterwards."""
    visitor.session()
    planted = visitor.cookie
    assert visitor.login("olga").status == 200
    assert visitor.cookie != planted
    assert Client(visitor.port, planted).get("/api/home").status == 401


@pytest.mark.parametrize("cookie", ["", "x", "a" * 43, "../../etc/passwd", "a" * 5000, "%00"])
def test_a_made_up_cookie_is_not_logged_in(visitor, cookie):
    assert Client(visitor.port, cookie).get("/api/home").status == 401


def test_wrong_names_and_passwords_get_the_same_answer(visitor):
    answers = [visitor.login("olga", "wrong password"), visitor.login("nobody", PASSWORD), visitor.login("eve", "x")]
    assert {a.status for a in answers} == {401}
    assert len({a.body for a in answers}) == 1


def test_an_unknown_name_takes_as_long_to_check(tmp_path):
    write_users(tmp_path / "u", {"olga": make_user("olga", "operator", PASSWORD)})
    authenticator, took = Authenticator(tmp_path / "u"), {}
    for name in ("olga", "eve") * 3:
        began = time.thread_time()
        assert authenticator.check(name, "wrong password") is None
        took[name] = min(took.get(name, 9.0), time.thread_time() - began)
    assert 0.5 < took["olga"] / took["eve"] < 2.0


def test_guessing_is_slowed_down(visitor):
    visitor.session()
    answers = [visitor.post("/api/login", {"user": "olga", "password": f"guess {k}"}) for k in range(8)]
    free = THROTTLE_RULES["address"].free_failures
    assert [a.status for a in answers[:free]] == [401] * free
    assert answers[-1].status == 429 and int(answers[-1].headers["Retry-After"]) >= 1
    assert visitor.login("olga").status == 429  # even with the right password


def test_throttle_waits_longer_forgets_and_spares_other_addresses():
    clock = Clock()
    throttle = Throttle(clock)
    here, there = ("address", "10.0.0.1"), ("address", "10.0.0.2")
    waits = [throttle.attempt(here) for _ in range(6)]
    assert waits[:5] == [0.0] * 5 and waits[5] == 1.0
    assert throttle.attempt(there) == 0.0
    clock.now += 1.0
    assert throttle.attempt(here) == 0.0 and throttle.attempt(here) == 2.0
    for _ in range(40):
        clock.now += THROTTLE_RULES["address"].max_wait_s
        assert throttle.attempt(here) == 0.0
    assert throttle.attempt(here) == THROTTLE_RULES["address"].max_wait_s
    clock.now += 1e4
    assert throttle.attempt(here) == 0.0


def test_failures_of_others_lock_a_user_out_for_seconds_only():
    clock = Clock()
    throttle = Throttle(clock)
    for k in range(2000):
        throttle.attempt(("address", str(k)), ("user", "olga"))
    assert throttle.attempt(("address", "own"), ("user", "olga")) <= THROTTLE_RULES["user"].max_wait_s


def test_a_successful_login_does_not_reset_its_addresss_failures():
    throttle = Throttle(Clock())
    here = ("address", "10.0.0.1")
    for k in range(4):
        assert throttle.attempt(here, ("user", f"guessed {k}")) == 0.0
    assert throttle.attempt(here, ("user", "own")) == 0.0
    throttle.succeeded(here, ("user", "own"))
    assert throttle.attempt(here, ("user", "guessed")) == 0.0
    assert throttle.attempt(here, ("user", "guessed")) > 0.0


def test_sessions_end_when_idle_and_at_their_maximum_age():
    clock = Clock()
    sessions = Sessions(idle=600.0, clock=clock)
    cookie = sessions.begin("olga")
    for _ in range(10):
        clock.now += 500.0
        assert sessions.user(cookie) == "olga"
    clock.now += 500.0
    assert sessions.user(cookie, is_use=False) == "olga"  # a page that only listens is not use
    clock.now += 101.0
    assert sessions.user(cookie) is None
    cookie = sessions.begin("olga")
    for _ in range(100):
        clock.now += 500.0
        sessions.user(cookie)
    assert sessions.user(cookie) is None


def test_sessions_take_bounded_memory():
    sessions = Sessions()
    first = sessions.begin("olga")
    for _ in range(600):
        sessions.begin("olga")
    assert len(sessions._sessions) <= 500
    assert sessions.user(first) is None


def test_a_visitor_without_login_takes_no_session(visitor, guarded_state):
    for _ in range(20):
        Client(visitor.port).session()
    assert not guarded_state.sessions._sessions


def test_a_removed_user_is_refused_at_once(visitor, guarded_state):
    visitor.login("olga")
    assert visitor.get("/api/home").status == 200
    users = read_users(guarded_state.authenticator.path)
    del users["olga"]
    write_users(guarded_state.authenticator.path, users)
    assert visitor.get("/api/home").status == 401


def test_users_are_read_again_though_the_files_time_is_the_same(tmp_path):
    authenticator, time_ns = Authenticator(tmp_path / "u"), 1_800_000_000_000_000_000
    for name in ("olga", "anna"):
        write_users(tmp_path / "u", {name: make_user(name, "operator", PASSWORD)})
        os.utime(tmp_path / "u", ns=(time_ns, time_ns))
        assert set(authenticator.users) == {name}


def test_a_websocket_is_closed_at_logout(visitor, monkeypatch):
    monkeypatch.setattr(jobs, "LOGIN_CHECK_INTERVAL_S", 0.2)
    visitor.login("olga")
    with visitor.live() as socket:
        assert visitor.post("/api/logout").status == 200
        with pytest.raises(ConnectionClosed):
            while True:
                socket.recv(timeout=NOT_FOR_EVER)
    with contextlib.suppress(InvalidStatus):
        visitor.live()
        raise AssertionError


def test_the_server_prints_no_secret(tmp_path, capfd):
    state = make_state(tmp_path, (("olga", "operator"),))
    with served(state) as port:
        visitor = Client(port)
        visitor.login("olga", "wrong password")
        visitor.login("olga")
        visitor.get("/api/home")
        visitor.post("/api/login", {"user": "olga", "password": 7})
        got = visitor.post("/api/login", {"user": "olga", "password": PASSWORD, "more": PASSWORD})
    assert got.status == 422 and PASSWORD not in got.body.decode()
    printed = "".join(capfd.readouterr())
    for secret in (PASSWORD, "wrong password", visitor.cookie, visitor.csrf):
        assert secret not in printed


def test_no_secret_is_taken_from_a_url(visitor):
    assert visitor.get(f"/api/login?user=olga&password={PASSWORD.replace(' ', '+')}").status in (404, 405)
    visitor.session()
    assert visitor.post("/api/login?user=olga&password=x").status == 422
    visitor.login("olga")
    cookie, visitor.cookie = visitor.cookie, ""
    assert visitor.get(f"/api/home?truestand={cookie}&session={cookie}").status == 401


@posix
def test_the_users_file_is_readable_by_its_owner_only(tmp_path):
    before = os.umask(0)
    try:
        write_users(tmp_path / "u", {"olga": make_user("olga", "operator", PASSWORD)})
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "u").stat().st_mode) == 0o600
    assert PASSWORD not in (tmp_path / "u").read_text()
    (tmp_path / "u").chmod(0o640)
    with pytest.raises(BadRecipe, match="chmod 600"):
        read_users(tmp_path / "u")


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": "truestand.users", "users": [{"name": "x"}]}',
                                  '{"format": "truestand.users", "users": 7}'])  # fmt: skip
def test_a_damaged_users_file_is_refused(tmp_path, text):
    path = tmp_path / "u"
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(BadRecipe, match="no list of users"):
        read_users(path)


UNFIT = [("", PASSWORD), ("a/b", PASSWORD), ("<b>", PASSWORD), ("x" * 65, PASSWORD), ("olga", "short"),
         ("olga", "x" * 2000)]  # fmt: skip


@pytest.mark.parametrize(("name", "password"), UNFIT)
def test_unsuitable_names_and_passwords_are_refused(name, password):
    with pytest.raises(BadRecipe, match="need"):
        make_user(name, "operator", password)


def test_passwords_are_salted():
    assert make_user("a", "operator", PASSWORD).hash != make_user("a", "operator", PASSWORD).hash


def test_users_are_added_and_removed_at_the_command_line(tmp_path, monkeypatch):
    import subprocess

    def serve(*arguments, typed=""):
        command = [
            sys.executable,
            "-W",
            "error",
            "-m",
            "truestand",
            "serve",
            "--stand",
            tmp_path / "stand.toml",
            *arguments,
        ]
        return subprocess.run(command, input=typed, capture_output=True, text=True, check=False)

    done = serve("--add-user", "erik", "--role", "engineer", typed=f"{PASSWORD}\n")
    assert done.returncode == 0 and "erik (engineer)" in done.stdout and PASSWORD not in done.stdout + done.stderr
    path = users_path(tmp_path / "results")
    assert Authenticator(path).check("erik", PASSWORD).role == "engineer"
    assert serve("--add-user", "olga", typed="short\n").returncode == 2
    assert serve("--remove-user", "eve").returncode == 2
    removed = serve("--remove-user", "erik")
    assert removed.returncode == 0 and "nobody may enter" in removed.stdout
    assert read_users(path) == {}


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_a_public_address_without_users_is_refused(tmp_path, host):
    make_state(tmp_path)
    done = run("serve", "--stand", tmp_path / "stand.toml", "--host", host, "--port", "0")
    assert done.returncode == 2
    assert "--add-user" in done.stderr and done.stderr.count("\n") == 1


def test_a_page_whose_last_user_was_removed_refuses_everyone(tmp_path):
    state = make_state(tmp_path)
    path = users_path(state.settings.store)
    assert state.principal(None).role == "engineer"
    write_users(path, {"olga": make_user("olga", "operator", PASSWORD)})  # while the page is served
    assert state.principal(None).role is None
    write_users(path, {})
    assert not state.authenticator.users and state.authenticator.login_needed and state.principal(None).role is None
    assert make_state(tmp_path).principal(None).role is None  # as after a restart
    path.unlink()
    assert state.principal(None).role is None
    assert make_state(tmp_path).principal(None).role == "engineer"
