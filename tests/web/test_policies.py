"""Every route has a policy, and this table says which."""

import pytest
from fastapi import FastAPI
from fastapi.routing import APIRoute

from truestand.web.app import create_api
from truestand.web.routing import OPERATOR, GuardedRoute, GuardedWebSocketRoute, Routes, require_policies
from web_lab import Client, served

TABLE = {
    ("GET", "/"): None,
    ("GET", "/{name:path}"): None,
    ("GET", "/vendor/plotly.min.js"): None,
    ("GET", "/api/openapi.json"): None,
    ("GET", "/api/session"): None,
    ("POST", "/api/login"): None,
    ("POST", "/api/logout"): None,
    ("GET", "/api/home"): "operator",
    ("GET", "/api/parts"): "operator",
    ("GET", "/api/devices"): "operator",
    ("POST", "/api/reset"): "operator",
    ("POST", "/api/jobs"): "operator",
    ("GET", "/api/jobs/current"): "operator",
    ("POST", "/api/jobs/{id}/abort"): "operator",
    ("WS", "/api/live"): "operator",
    ("GET", "/api/results"): "operator",
    ("GET", "/api/results/{number}"): "operator",
    ("GET", "/api/results/{number}/report"): "operator",
    ("GET", "/api/results/{number}/cloud"): "operator",
    ("GET", "/api/results/{number}/characteristics.csv"): "operator",
    ("GET", "/api/results/{number}/certificate.xml"): "operator",
    ("POST", "/api/results/{number}/withdraw"): "engineer",
    ("GET", "/api/history"): "operator",
    ("GET", "/api/recipes"): "operator",
    ("GET", "/api/recipes/{file}"): "operator",
    ("POST", "/api/recipes/{file}/check"): "engineer",
    ("PUT", "/api/recipes/{file}"): "engineer",
    ("GET", "/api/audit"): "engineer",
}
FILLED = {"{number}": "1", "{file}": "gear.toml", "{id}": "none", "{name:path}": "nothing.js"}
HTTP = [(*route, role) for route, role in TABLE.items() if route[0] != "WS"]


def test_the_table_names_every_route(state):
    found = {}
    for route in create_api(state).routes:
        assert isinstance(route, GuardedRoute | GuardedWebSocketRoute), route.path
        methods = sorted(route.methods) if isinstance(route, GuardedRoute) else ["WS"]
        found |= {(method, route.path): route.policy.role for method in methods}
    assert found == TABLE


def test_a_route_without_a_policy_is_not_served():
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    routes = Routes()
    routes.add("GET", "/fine", OPERATOR, "Fine")(lambda: 1)
    app.router.routes.extend(routes)
    require_policies(app.routes)
    app.get("/forgotten")(lambda: 1)
    assert isinstance(app.routes[-1], APIRoute)
    with pytest.raises(RuntimeError, match="routes without a policy: /forgotten"):
        require_policies(app.routes)


def test_every_route_limits_its_body(state):
    for route in create_api(state).routes:
        assert route.policy.max_body_bytes <= 300_000


@pytest.fixture(scope="module")
def people(tmp_path_factory):
    """A visitor, an operator and an engineer at one page."""
    from web_lab import make_state

    state = make_state(tmp_path_factory.mktemp("people"), (("olga", "operator"), ("erik", "engineer")))
    with served(state) as port:
        found = {None: Client(port), "operator": Client(port), "engineer": Client(port)}
        found[None].session()
        found["operator"].login("olga")
        found["engineer"].login("erik")
        yield found


@pytest.mark.parametrize(("method", "path", "role"), HTTP, ids=lambda value: str(value))
@pytest.mark.parametrize("who", [None, "operator", "engineer"])
def test_each_role_is_answered_or_refused_as_the_table_says(people, method, path, role, who):
    rank = [None, "operator", "engineer"]
    for word, value in FILLED.items():
        path = path.replace(word, value)
    if path == "/api/logout":
        pytest.skip("it would end the session of the other tests; test_login has it")
    status = people[who].ask(method, path, {} if method != "GET" else None).status
    if rank.index(who) >= rank.index(role):
        refused = (401,) if path == "/api/login" else (401, 403)
        assert status not in refused or path == "/api/login"
    else:
        assert status == (401 if who is None else 403)


def test_every_route_is_documented(client):
    payload = client.get("/api/openapi.json").json
    for method, path in TABLE:
        if method == "WS" or not path.startswith("/api/") or path == "/api/openapi.json":
            continue
        operation = payload["paths"][path][method.lower()]
        assert operation["summary"] and operation["responses"]["200"]
