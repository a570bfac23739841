"""The page's back end in small: the routes of the real one with made-up data, the same CSP. Only for the page's tests.

``python mock_server.py --port 8621``; ``POST /mock {"login_needed": true, ...}`` changes what it plays.
"""

import argparse
import asyncio
import contextlib
import math
import os
from collections.abc import AsyncIterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mock_data as data
import numpy as np
import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

Json = dict[str, Any]
STATIC = Path(__file__).parents[3] / "src" / "truestand" / "web" / "static"
CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "font-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
)
CSRF = "csrf-of-the-mock"
STEPS = {
    "calibrate": ["connect", "record", "read", "calibrate", "store"],
    "verify": ["connect", "record", "read", "verify", "store"],
    "inspect": ["connect", "record", "read", "roll", "inspect", "store"],
}
LABELS = {
    "connect": "Connect the devices", "record": "Record the scan", "read": "Read the scan", "calibrate": "Calibrate",
    "verify": "Compare with the calibration", "roll": "Roll up the surface", "inspect": "Inspect",
    "store": "Keep the evidence",
}  # fmt: skip


class Play:
    """What the mock plays: changed by the tests over POST /mock."""

    def __init__(self) -> None:
        self.reset({})

    def reset(self, wanted: Json) -> None:
        """Back to a day with some results; then what a test asks for."""
        self.login_needed = False
        self.user: str | None = "engineer"
        self.role: str | None = "engineer"
        self.fault: str | None = None
        self.calibration = "valid"
        self.outcome = "conforms"
        self.end = "done"
        self.slow = False
        self.seconds = 2.0
        self.job: Json | None = None
        self.aborted = False
        self.recipes = {file: list(entry) for file, entry in data.RECIPES.items()}
        self.entries: list[Json] = _entries()
        for key, value in wanted.items():
            setattr(self, key, value)


def _entries() -> list[Json]:
    verdicts = ["conforms", "conforms", "does_not_conform", "undecided", "conforms"]
    found: list[Json] = []
    for number in range(1, 61):
        calibration = number % 12 == 1
        part = data.PARTS[3 if number == 59 else number % 3]
        found.append(
            entry(number, "calibration" if calibration else "inspection", None if calibration else part,
                  None if calibration else verdicts[number % 5])
        )  # fmt: skip
    found[53]["corrected_by"] = 55
    found.append(entry(61, "verification", None, None))
    return found


def entry(number: int, kind: str, part: Json | None, verdict: str | None) -> Json:
    """One line of the store."""
    return {
        "number": number, "kind": kind, "time": f"2026-11-{1 + number // 3:02d}T{6 + number % 12:02d}:14:26Z",
        "operator": "M. Novák" if number % 2 else "J. Kowalczyk-Wiśniewska", "order": "P-7781" if part else "",
        "serial": f"A-{number:04d}" if part else "", "part": part["name"] if part else None,
        "title": part["title"] if part else {"calibration": "Calibration", "verification": "Verification"}[kind],
        "verdict": verdict,
        "status": ("untrusted" if number == 37 else "valid") if kind == "calibration" else None, "corrected_by": None,
        "has": {"report": kind != "verification", "cloud": kind == "inspection", "certificate": kind == "calibration"},
    }  # fmt: skip


PLAY = Play()


def problem(status: int, text: str) -> JSONResponse:
    """An error as the contract has it."""
    return JSONResponse({"problem": text}, status)


async def mock(request: Request) -> Response:
    PLAY.reset(await request.json())
    return JSONResponse({})


def session_of() -> Json:
    return {
        "user": PLAY.user, "role": PLAY.role, "login_needed": PLAY.login_needed and PLAY.role is None, "csrf": CSRF,
        "company": "Muster Verzahnung GmbH", "version": "0.1.0", "stand": "Stand 1, hall B",
    }  # fmt: skip


async def session(request: Request) -> Response:
    return JSONResponse(session_of())


async def login(request: Request) -> Response:
    body = await request.json()
    if body.get("password") != "right":
        return problem(401, "found a name or password that is not known, need both as given; try again")
    PLAY.user, PLAY.role = body["user"], "operator" if body["user"] == "operator" else "engineer"
    return JSONResponse(session_of())


async def logout(request: Request) -> Response:
    PLAY.user = PLAY.role = None
    return JSONResponse(session_of())


async def home(request: Request) -> Response:
    last = [e for e in reversed(PLAY.entries) if e["kind"] != "verification"][:8]
    known = {
        "valid": {"number": 49, "time": "2026-11-20T06:02:11Z", "valid_until": "2026-11-27T06:02:11Z", "reasons": []},
        "expired": {"number": 37, "time": "2026-11-10T06:02:11Z", "valid_until": "2026-11-17T06:02:11Z", "reasons": []},
        "untrusted": {"number": 37, "time": "2026-11-20T06:02:11Z", "valid_until": None,
                      "reasons": ["residual, um rms: 141 is above 100; look for dirt, a keyway or a loose shaft"]},
        "none": {"number": None, "time": None, "valid_until": None, "reasons": []},
    }  # fmt: skip
    calibration = {"state": PLAY.calibration, **known[PLAY.calibration]}
    return JSONResponse(
        {"calibration": calibration, "last": last, "job": PLAY.job, "fault": PLAY.fault, "parts": data.PARTS}
    )


async def parts(request: Request) -> Response:
    return JSONResponse(data.PARTS)


async def devices(request: Request) -> Response:
    if PLAY.job and PLAY.job["state"] == "running":
        return problem(409, "found a job at work, need the devices free; wait for its end")
    await asyncio.sleep(0.2)
    return JSONResponse(data.DEVICES)


async def reset(request: Request) -> Response:
    reason, PLAY.fault = PLAY.fault, None
    return JSONResponse({"fault": reason})


async def start(request: Request) -> Response:
    body = await request.json()
    if PLAY.job and PLAY.job["state"] == "running":
        return problem(409, "found a job at work, need it ended; wait for it or abort it")
    if PLAY.fault:
        return problem(409, f"found the stand in fault: {PLAY.fault}; look at the stand, then reset the fault")
    names = STEPS[body["kind"]]
    part = next((p for p in data.PARTS if p["name"] == body.get("part")), None)
    PLAY.aborted = False
    PLAY.job = {
        "id": "job-1", "kind": body["kind"], "part": body.get("part"), "title": part["title"] if part else "",
        "state": "running", "step": names[0],
        "steps": [{"name": n, "label": LABELS[n], "state": "waiting"} for n in names],
        "done": 0.0, "message": "", "number": None, "verdict": None, "status": None,
        "asked": {k: body.get(k) for k in ("operator", "order", "serial")},
    }  # fmt: skip
    return JSONResponse(PLAY.job)


async def run_jobs() -> None:
    """Carries the job on, forever."""
    while True:
        await asyncio.sleep(0.05)
        job = PLAY.job
        if not job or job["state"] != "running":
            continue
        job["done"] = min(1.0, job["done"] + (0.0 if PLAY.slow and job["done"] > 0.42 else 0.05 / PLAY.seconds))
        at = min(int(job["done"] * len(job["steps"])), len(job["steps"]) - 1)
        for i, step in enumerate(job["steps"]):
            step["state"] = "done" if i < at else "running" if i == at else "waiting"
        job["step"] = job["steps"][at]["name"]
        if PLAY.aborted:
            job["state"], job["steps"][at]["state"] = "aborted", "failed"
            job["message"] = "stopped on request; what was recorded is kept"
        elif PLAY.end == "failed" and job["done"] > 0.4:
            job["state"], job["steps"][at]["state"] = "failed", "failed"
            job["message"] = (
                "found 12 lost profiles, need all of them; check the network cable of front, then run again"
            )
        elif job["done"] >= 1.0:
            _finish(job)


def _finish(job: Json) -> None:
    for step in job["steps"]:
        step["state"] = "done"
    part = next((p for p in data.PARTS if p["name"] == job["part"]), None)
    kind = {"calibrate": "calibration", "verify": "verification", "inspect": "inspection"}[job["kind"]]
    number = PLAY.entries[-1]["number"] + 1
    PLAY.entries.append(entry(number, kind, part, PLAY.outcome if part else None))
    job["number"], job["verdict"] = number, PLAY.outcome if part else "holds" if kind == "verification" else None
    job["status"] = "valid" if kind == "calibration" else None
    job["state"] = "done"


async def current(request: Request) -> Response:
    return JSONResponse(PLAY.job)


async def abort(request: Request) -> Response:
    PLAY.aborted = True
    return JSONResponse(PLAY.job)


async def live(socket: WebSocket) -> None:
    await socket.accept()
    said: Any = None
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        for tick in range(100_000):
            job = PLAY.job
            if job and str(job) != said:
                said = str(job)
                await socket.send_json({"type": "job", "job": job})
            if job and job["state"] == "running":
                await socket.send_json({"type": "live", "live": live_of(job, tick)})
            await asyncio.sleep(0.2)


def live_of(job: Json, tick: int) -> Json:
    """A gear's tooth going by, one sensor that loses profiles."""
    x = np.linspace(-24, 24, 160)
    z = 92 + 2.2 * np.clip(2 * np.sin(x / 2.1 + tick / 3), -1, 1) + 0.02 * x
    gone = (np.abs(x - 6) < 1.4) | (x < -21)
    profile = {"x": x.round(3).tolist(), "z": [None if g else round(float(v), 4) for g, v in zip(gone, z, strict=True)]}
    done = job["done"]
    return {
        "state": "recording", "done": job["done"], "position_deg": 360 * 2.75 * job["done"],
        "sensors": [
            {"name": "front", "frames_per_s": 998.4 + math.sin(tick), "profiles": int(11000 * done), "lost": 0,
             "profile": profile},
            {"name": "back", "frames_per_s": 999.1, "profiles": int(10990 * done), "lost": 12, "profile": profile},
        ],
    }  # fmt: skip


async def results(request: Request) -> Response:
    q = request.query_params
    found = [
        e for e in reversed(PLAY.entries)
        if (not q.get("kind") or e["kind"] == q["kind"]) and (not q.get("part") or e["part"] == q["part"])
        and (not q.get("before") or e["number"] < int(q["before"]))
    ]  # fmt: skip
    return JSONResponse(found[: int(q.get("limit", 50))])


def _entry(request: Request) -> Json | None:
    return next((e for e in PLAY.entries if e["number"] == request.path_params["number"]), None)


async def result(request: Request) -> Response:
    e = _entry(request)
    if e is None:
        return problem(404, f"found no result {request.path_params['number']}; choose one of the list")
    rng = np.random.default_rng(e["number"])
    record = {
        "inspection": lambda: data.inspection_record(e["verdict"], rng),
        "calibration": lambda: data.calibration_record(e["status"]),
        "verification": data.verification_record,
    }[e["kind"]]()
    return JSONResponse({"entry": e, "record": record})


async def report(request: Request) -> Response:
    headers = {"content-security-policy": "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"}
    if request.query_params.get("download"):
        headers["content-disposition"] = 'attachment; filename="report.html"'
    return Response("<!doctype html><title>Report</title><h1>Report</h1>", media_type="text/html", headers=headers)


async def download(request: Request) -> Response:
    return Response("name,value\nf_p,1\n", media_type="text/csv", headers={"content-disposition": "attachment"})


async def cloud(request: Request) -> Response:
    return Response(data.cloud(int(request.query_params.get("points", 200_000))), media_type="application/octet-stream")


async def history(request: Request) -> Response:
    return JSONResponse(data.history(request.query_params.get("kind", "calibration")))


async def recipes(request: Request) -> Response:
    return JSONResponse([{"file": f, "kind": kind, "title": title} for f, (kind, title, _) in PLAY.recipes.items()])


def _problem_of(text: str) -> str | None:
    for at, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.startswith(("#", "[")) and "=" not in line:
            return f"line {at}: found {line!r}, need key = value; put a value behind it"
    return None


async def recipe(request: Request) -> Response:
    file = request.path_params["file"]
    if request.method == "PUT":
        text = (await request.json())["text"]
        found = _problem_of(text)
        if found:
            return problem(422, found)
        PLAY.recipes.setdefault(file, ["part", file, ""])[2] = text
        return JSONResponse({"problem": None})
    if file not in PLAY.recipes:
        return problem(404, f"found no {file}; choose one of the list")
    text = PLAY.recipes[file][2]
    return JSONResponse({"file": file, "text": text, "problem": _problem_of(text)})


async def check(request: Request) -> Response:
    return JSONResponse({"problem": _problem_of((await request.json())["text"])})


async def audit(request: Request) -> Response:
    return JSONResponse({"findings": [{"what": "evidence does not match its hash", "where": "result 17, scan.h5"}]})


async def index(request: Request) -> Response:
    return FileResponse(STATIC / "index.html")


async def plotly(request: Request) -> Response:
    spec = find_spec("plotly")
    assert spec is not None and spec.origin is not None
    return FileResponse(Path(spec.origin).parent / "package_data" / "plotly.min.js")


class Guard:
    """CSP on every answer; the session and the CSRF token as the real server asks for them."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.setdefault("content-security-policy", CSP)
                headers.setdefault("x-content-type-options", "nosniff")
            await send(message)

        if scope["type"] == "http" and (refusal := self._refusal(scope)):
            return await refusal(scope, receive, send_guarded)
        return await self.app(scope, receive, send_guarded)

    def _refusal(self, scope: Scope) -> Response | None:
        path, method = scope["path"], scope["method"]
        if not path.startswith("/api/") or path == "/api/session":
            return None
        if method != "GET" and dict(scope["headers"]).get(b"x-csrf-token", b"").decode() != CSRF:
            return problem(403, "found no valid X-CSRF-Token, need that of the session; load the page again")
        if PLAY.login_needed and PLAY.role is None and path != "/api/login":
            return problem(401, "found no session, need a login; log in")
        return None


@contextlib.asynccontextmanager
async def lifespan(app: Starlette) -> AsyncIterator[None]:
    tasks = [asyncio.create_task(run_jobs()), asyncio.create_task(end_with(os.getppid()))]
    yield
    for task in tasks:
        task.cancel()


async def end_with(parent: int) -> None:
    """Outlive no test run that was killed."""
    while os.getppid() == parent:
        await asyncio.sleep(1.0)
    os._exit(0)


ROUTES = [
    Route("/mock", mock, methods=["POST"]),
    Route("/api/session", session),
    Route("/api/login", login, methods=["POST"]),
    Route("/api/logout", logout, methods=["POST"]),
    Route("/api/home", home),
    Route("/api/parts", parts),
    Route("/api/devices", devices),
    Route("/api/reset", reset, methods=["POST"]),
    Route("/api/jobs", start, methods=["POST"]),
    Route("/api/jobs/current", current),
    Route("/api/jobs/{id}/abort", abort, methods=["POST"]),
    WebSocketRoute("/api/live", live),
    Route("/api/results", results),
    Route("/api/results/{number:int}", result),
    Route("/api/results/{number:int}/report", report),
    Route("/api/results/{number:int}/characteristics.csv", download),
    Route("/api/results/{number:int}/certificate.xml", download),
    Route("/api/results/{number:int}/cloud", cloud),
    Route("/api/history", history),
    Route("/api/recipes", recipes),
    Route("/api/recipes/{file}", recipe, methods=["GET", "PUT"]),
    Route("/api/recipes/{file}/check", check, methods=["POST"]),
    Route("/api/audit", audit),
    Route("/vendor/plotly.min.js", plotly),
    Route("/", index),
]


def main() -> None:
    """Serve until stopped."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, default=8621)
    parser.add_argument("--static", type=Path, default=STATIC)
    said = parser.parse_args()
    routes = [*ROUTES, Mount("/", StaticFiles(directory=said.static))]
    app = Starlette(routes=routes, middleware=[Middleware(Guard)], lifespan=lifespan)
    uvicorn.run(app, host="127.0.0.1", port=said.port, log_level="warning")


if __name__ == "__main__":
    main()
