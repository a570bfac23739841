"""Whom the page answers at all, and what every answer says."""

import http.client
import json
import socket

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from truestand.core.errors import BadRecipe
from truestand.web.authentication import make_user, write_users
from truestand.web.security import CSP, HEADERS, allowed_hosts
from truestand.web.serving import Binding, serve
from web_lab import PASSWORD, Client, make_state, raw, served

WRITES = [
    ("POST", "/api/login"),
    ("POST", "/api/logout"),
    ("POST", "/api/reset"),
    ("POST", "/api/jobs"),
    ("POST", "/api/jobs/x/abort"),
    ("POST", "/api/recipes/gear.toml/check"),
    ("PUT", "/api/recipes/gear.toml"),
]


FOREIGN = ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "localhost:80", "10.0.0.1:{port}",
           "127.0.0.1:{port}.evil.example", "[::2]:{port}", "", "a:b:c"]  # fmt: skip


@pytest.mark.parametrize("host", FOREIGN)
@pytest.mark.parametrize("path", ["/", "/api/session", "/api/home", "/nothing"])
def test_a_foreign_host_is_refused(client, host, path):
    answer = client.get(path, headers={"Host": host.format(port=client.port)})
    assert answer.status == 403
    assert "foreign Host" in answer.problem


@pytest.mark.parametrize("host", ["127.0.0.1:{port}", "localhost:{port}", "LOCALHOST:{port}", "[::1]:{port}"])
def test_the_machines_own_host_names_are_answered(client, host):
    assert client.get("/api/session", headers={"Host": host.format(port=client.port)}).status == 200


def test_a_request_without_a_host_or_with_two_is_refused(client):
    for head in (b"", b"Host: 127.0.0.1:%d\r\nHost: evil.example\r\n" % client.port):
        got = raw(client.port, b"GET /api/session HTTP/1.1\r\n" + head + b"Connection: close\r\n\r\n")
        assert got.split()[1] in (b"400", b"403"), got


def test_only_the_given_further_host_names_are_answered(tmp_path):
    with served(make_state(tmp_path), names=("stand7.example",)) as port:
        client = Client(port)
        for host in ("stand7.example", f"stand7.example:{port}", "stand7.example:443"):
            assert client.get("/api/session", headers={"Host": host}).status == 200
        assert client.get("/api/session", headers={"Host": "stand8.example"}).status == 403


def test_forwarded_headers_of_a_trusted_proxy_count(tmp_path):
    state = make_state(tmp_path, (("olga", "operator"),))
    with served(state, names=("stand7.example",), proxies=("127.0.0.1",)) as port:
        client, own = Client(port), {"Host": "stand7.example"}
        assert "secure" not in client.get("/api/session", headers=own).headers["Set-Cookie"].lower()
        client.cookie = ""
        over = own | {"X-Forwarded-Proto": "https", "X-Forwarded-For": "192.0.2.7", "Origin": "https://stand7.example"}
        answer = client.get("/api/session", headers=over)
        assert "; secure" in answer.headers["Set-Cookie"].lower()
        client.csrf = answer.json["csrf"]
        assert client.post("/api/login", {"user": "olga", "password": "wrong"}, headers=over).status == 401
        assert ("address", "192.0.2.7") in state.throttle._failures
        assert client.get("/api/session", headers=over | {"Origin": "http://stand7.example"}).status == 403
        assert client.post("/api/login", {"user": "olga", "password": PASSWORD}, headers=over).status == 200
        sent = {name: over[name] for name in ("X-Forwarded-Proto", "Origin")} | {"Cookie": f"truestand={client.cookie}"}
        to = socket.create_connection(("127.0.0.1", port))
        with connect("ws://stand7.example/api/live", sock=to, additional_headers=sent, compression=None) as live:
            state.hub.publish("job", "{}")
            while live.recv(20) != "{}":
                pass


@pytest.mark.parametrize("proxies", [(), ("192.0.2.1",)])
def test_forwarded_headers_of_others_are_ignored(tmp_path, proxies):
    state = make_state(tmp_path, (("olga", "operator"),))
    with served(state, proxies=proxies) as port:
        client, claimed = Client(port), {"X-Forwarded-Proto": "https", "X-Forwarded-For": "192.0.2.7"}
        answer = client.get("/api/session", headers=claimed)
        assert "secure" not in answer.headers["Set-Cookie"].lower()
        client.csrf = answer.json["csrf"]
        assert client.post("/api/login", {"user": "eve", "password": "wrong"}, headers=claimed).status == 401
        assert [key for key in state.throttle._failures if key[0] == "address"] == [("address", "127.0.0.1")]


def test_a_proxy_needs_an_address_and_users(tmp_path):
    state = make_state(tmp_path)
    with pytest.raises(BadRecipe, match="found --proxy and no users"):
        serve(state, Binding(port=0, proxies=("127.0.0.1",)), print)
    write_users(state.authenticator.path, {"olga": make_user("olga", "operator", PASSWORD)})
    for proxy in ("*", "proxy.example", "10.0.0.1/8", ""):
        with pytest.raises(BadRecipe, match="IP address"):
            serve(state, Binding(port=0, proxies=(proxy,)), print)


ORIGINS = ["http://evil.example", "null", "", "http://127.0.0.1", "http://127.0.0.1:1", "http://localhost:{port}",
           "http://127.0.0.1:{port}.evil.example", "file://", "ftp://127.0.0.1:{port}"]  # fmt: skip


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("ask", [("GET", "/api/home"), ("POST", "/api/reset"), ("GET", "/")])
def test_a_foreign_origin_is_refused(client, origin, ask):
    assert client.ask(*ask, headers={"Origin": origin.format(port=client.port)}).status == 403


def test_the_pages_own_origin_is_answered(client):
    own = {"Origin": f"http://127.0.0.1:{client.port}", "Sec-Fetch-Site": "same-origin"}
    assert client.get("/api/home", headers=own).status == 200
    assert client.post("/api/logout", headers=own).status == 200


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_api_requests_of_other_sites_are_refused(client, site):
    """Another port of this machine is the same site to a browser."""
    assert client.get("/api/results/1/cloud", headers={"Sec-Fetch-Site": site}).status == 403


@pytest.mark.parametrize("origin", ORIGINS)
def test_a_websocket_of_another_origin_is_refused(client, origin):
    with pytest.raises(InvalidStatus) as refused:
        client.live(Origin=origin.format(port=client.port))
    assert refused.value.response.status_code == 403


def test_a_websocket_with_a_foreign_host_is_refused(client):
    key = (
        b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
        + b"a" * 22
        + b"==\r\n\r\n"
    )
    got = raw(client.port, b"GET /api/live HTTP/1.1\r\nHost: evil.example\r\n" + key)
    assert got.split()[1] == b"403"


def test_a_websocket_needs_a_login_where_there_are_users(visitor):
    with pytest.raises(InvalidStatus) as refused:
        visitor.live()
    assert refused.value.response.status_code == 403


@pytest.mark.parametrize("path", ["/", "/api/session", "/api/home", "/api/results/1/report", "/nothing", "/api/nothing",
                                  "/api/results/none", "/vendor/plotly.min.js", "/api/openapi.json"])  # fmt: skip
def test_every_answer_carries_the_headers(client, path):
    answer = client.get(path)
    for name, value in HEADERS.items():
        if name != "cache-control":
            assert answer.headers[name] == value, name
    assert "server" not in answer.headers
    assert answer.headers["cache-control"] == "no-store" or not path.startswith("/api")


def test_refusals_and_server_errors_carry_the_headers(client, state):
    state.results = None  # a fault of the program
    for answer in (client.get("/api/results"), client.get("/", headers={"Host": "evil"}), client.ask("PATCH", "/")):
        assert answer.headers["content-security-policy"] == CSP
        assert answer.headers["x-content-type-options"] == "nosniff"
    answer = client.get("/api/results")
    assert answer.status == 500 and b"Traceback" not in answer.body and b"NoneType" not in answer.body


def test_no_policy_allows_inline_scripts():
    for directive in CSP.split("; "):
        assert "unsafe" not in directive and "http:" not in directive and "*" not in directive
    assert "default-src 'none'" in CSP and "frame-ancestors 'none'" in CSP and "base-uri 'none'" in CSP


@pytest.mark.parametrize("ask", WRITES)
@pytest.mark.parametrize("token", [None, "", "wrong", "0" * 64, "ü"])
def test_a_write_without_its_token_is_refused(client, ask, token):
    client.csrf = ""
    headers = {} if token is None else {"X-CSRF-Token": token}
    answer = client.ask(*ask, {}, headers=headers)
    assert answer.status == 403 and "CSRF" in answer.problem


def test_a_token_counts_for_its_own_cookie_only(client):
    other = Client(client.port)
    other.session()
    client.csrf = other.csrf
    assert client.post("/api/logout").status == 403
    client.cookie = ""
    assert client.post("/api/logout").status == 403


def test_reading_changes_nothing(client, state, tmp_path):
    """Every GET route there is, on a stand in fault."""
    from truestand.web.app import create_api
    from web_lab import snapshot

    (tmp_path / ".stand.toml.state").write_text(json.dumps({"state": "fault", "since": "now", "reason": "a test"}))
    before = snapshot(tmp_path)
    paths = [r.path for r in create_api(state).routes if "GET" in getattr(r, "methods", ())]
    assert len(paths) > 12
    for path in paths:
        filled = path.format(number=1, file="gear.toml", name="x") if ":path" not in path else "/x"
        client.get(filled)
        client.get(f"{filled}?delete=1&_method=DELETE")
        client.ask("HEAD", filled)
    assert snapshot(tmp_path) == before
    assert state.runner.current() is None
    assert client.get("/api/home").json["fault"].startswith("the stand is in fault since now: a test")


def test_a_method_override_header_is_ignored(client):
    answer = client.ask("GET", "/api/recipes/gear.toml", headers={"X-HTTP-Method-Override": "PUT"})
    assert answer.status == 200


@pytest.mark.parametrize("ask", [("POST", "/api/login"), ("POST", "/api/jobs"), ("PUT", "/api/recipes/a.toml"),
                                 ("POST", "/api/logout"), ("POST", "/api/reset")])  # fmt: skip
def test_a_huge_body_is_refused_before_it_is_read(client, ask):
    method, path = ask
    head = f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{client.port}\r\nX-CSRF-Token: {client.csrf}\r\n"
    head += f"Cookie: truestand={client.cookie}\r\nContent-Type: application/json\r\n"
    for length in ("Content-Length: 1000000000000", "Transfer-Encoding: chunked"):
        got = raw(client.port, f"{head}{length}\r\n\r\n".encode() + b"FFFFF\r\n" + b"x" * 0xFFFFF + b"\r\n")
        assert got.split()[1] == b"413", got[:200]


def test_a_body_with_get_is_refused(client):
    assert client.ask("GET", "/api/session", b"{}").status == 400


def test_a_huge_request_head_is_refused(client):
    got = raw(client.port, b"GET / HTTP/1.1\r\nHost: x\r\nX: " + b"y" * 100_000)
    assert got.split()[1] == b"400"


def test_markup_in_names_is_answered_as_json(client, state, tmp_path):
    """Markup in a name never gets a type that a browser would run."""
    evil = "<script>alert(1)</script>"
    (tmp_path / "gear.toml").write_text((tmp_path / "gear.toml").read_text().replace("demo wheel", evil))
    job = client.post("/api/jobs", {"kind": "calibrate", "operator": evil, "order": evil, "serial": "fail"})
    assert job.status == 200
    state.runner._reader.join(10)
    for path in (
        "/api/home",
        "/api/jobs/current",
        "/api/parts",
        f"/api/recipes/{evil}",
        f"/{evil}",
        f"/api/results?kind={evil}",
    ):
        answer = client.get(path.replace("<", "%3C").replace(">", "%3E"))
        assert answer.headers["content-type"].startswith("application/json"), path
        assert answer.headers["x-content-type-options"] == "nosniff"


def test_cookies_have_their_flags(visitor):
    visitor.session()
    for answer in (Client(visitor.port).get("/api/session"), visitor.login("olga"), visitor.post("/api/logout")):
        given = [part.strip().lower() for part in answer.headers["set-cookie"].split(";")]
        assert {"httponly", "samesite=strict", "path=/"} < set(given)
        assert "secure" not in given  # plain http on this machine; the next test has https


def test_cookies_are_secure_over_https(tmp_path):
    import asyncio

    from truestand.web.app import create_app

    app, sent = create_app(make_state(tmp_path), allowed_hosts("127.0.0.1")), []
    scope = {"type": "http", "method": "GET", "path": "/api/session", "raw_path": b"/api/session", "query_string": b"",
             "headers": [(b"host", b"stand:8620")], "scheme": "https", "server": ("stand", 8620), "client": ("::1", 1),
             "http_version": "1.1", "root_path": "", "asgi": {"version": "3.0"}, "state": {}}  # fmt: skip

    async def send(message):
        sent.append(message)

    async def receive():
        return {"type": "http.request", "body": b"", "more_body": False}

    scope["headers"] = [(b"host", b"localhost:8620")]
    asyncio.run(app(scope, receive, send))
    cookie = dict(sent[0]["headers"])[b"set-cookie"].decode().lower()
    assert "; secure" in cookie


def test_garbage_is_answered_or_dropped(client):
    for junk in (
        b"\x16\x03\x01\x02\x00\x01\x00",
        b"GET\r\n\r\n",
        b"\x00" * 20_000,
        b"GET / HTTP/9.9\r\n\r\n",
        b"\r\n" * 50,
    ):
        raw(client.port, junk, timeout=0.5)
    assert client.get("/api/session").status == 200


ODD = ["/%00", "/api/recipes/%00.toml", "/api/results/99999999999999999999", "/api/results/-1", "/%ff%fe",
       "/api/results/1/cloud?points=nan", "/api/history?kind=x", "/api/results?limit=1e9",
       "/api/results?before=0"]  # fmt: skip


@pytest.mark.parametrize("path", ODD)
def test_odd_addresses_are_refused_in_plain_words(client, path):
    answer = client.get(path)
    assert answer.status in (404, 422)
    assert answer.problem


def test_a_client_that_leaves_amid_its_body_harms_nothing(client):
    connection = http.client.HTTPConnection("127.0.0.1", client.port)
    connection.putrequest("PUT", "/api/recipes/a.toml")
    for name, value in (
        ("X-CSRF-Token", client.csrf),
        ("Cookie", f"truestand={client.cookie}"),
        ("Content-Length", "100"),
    ):
        connection.putheader(name, value)
    connection.endheaders(b"{")
    connection.close()  # in the middle of the body
    assert client.get("/api/session").status == 200
