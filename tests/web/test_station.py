"""The page with the real worker, on the virtual stand: what people do, over HTTP."""

import json
import time

import pytest

from lab import lab
from truestand.web.runner import WORKER
from web_lab import Client, make_state, served

pytestmark = pytest.mark.stand  # test_workflow.py goes the same way through the browser in every run
WITHIN = 180.0
"""s for a job on a busy machine."""


@pytest.fixture(scope="module")
def at_stand(tmp_path_factory):
    """A client, the virtual stand and its page."""
    folder = tmp_path_factory.mktemp("stand")
    with lab(folder, turns=1.1, points=320, pace=2.5) as stand:
        state = make_state(folder, worker=WORKER)
        with served(state) as port:
            client = Client(port)
            client.session()
            yield client, stand, state


def followed(client, job, until=lambda event: False):
    """Live events until the job ends, or ``until`` says so; the job as told last."""
    live, end = [], time.monotonic() + WITHIN
    with client.live() as socket:
        while time.monotonic() < end:
            event = json.loads(socket.recv(timeout=WITHIN))
            if event["type"] == "live":
                live.append(event["live"])
            elif event["type"] == "job" and event["job"]["id"] == job["id"]:
                job = event["job"]
            if job["state"] != "running" or until(event):
                return job, live
    raise AssertionError


def test_devices_are_asked(at_stand):
    client, _, _ = at_stand
    table, front = client.get("/api/devices", timeout=60).json
    assert table["device"] == "table" and table["answers"] and "position_deg" in table["told"]
    assert front["name"] == "front" and front["told"]["serial"] == "V0" and front["problem"] is None


def test_an_abort_stops_the_stand_and_keeps_the_recording(at_stand):
    client, stand, state = at_stand
    job = client.post("/api/jobs", {"kind": "calibrate"}).json
    followed(client, job, lambda event: event["type"] == "live" and event["live"]["done"] > 0.2)
    client.post(f"/api/jobs/{job['id']}/abort")
    job, _ = followed(client, job)
    assert job["state"] == "aborted" and job["number"] is None
    assert stand.safe
    assert list(state.settings.jobs_folder.glob("*-calibrate/*.h5"))
    assert client.get("/api/home").json["fault"] is None


def test_calibrate_and_verify(at_stand):
    client, _, state = at_stand
    job = client.post("/api/jobs", {"kind": "calibrate", "operator": "Anna"}).json
    job, live = followed(client, job)
    assert job["state"] == "done" and job["number"] == 1, job["message"]
    assert job["done"] == 1.0 and {s["state"] for s in job["steps"]} == {"done"}
    assert live and len(live[-1]["sensors"][0]["profile"]["x"]) <= 160
    payload = client.get("/api/results/1").json
    assert payload["entry"]["operator"] == "Anna" and payload["record"]["format"] == "truestand.calibration"
    assert client.get("/api/results/1/report").status == 200
    assert client.get("/api/home").json["calibration"]["number"] == 1
    job = client.post("/api/jobs", {"kind": "verify"}).json
    job, _ = followed(client, job)
    assert job["state"] == "done" and job["number"] == 2, job["message"]
    assert client.get("/api/audit", timeout=60).json == {"findings": []}
    assert not list(state.settings.jobs_folder.glob("*-verify"))  # the store has it


def test_a_fault_is_latched_shown_and_reset(at_stand):
    from truestand.sim.live.faults import FaultKind

    client, stand, _ = at_stand
    job = client.post("/api/jobs", {"kind": "calibrate"}).json
    followed(client, job, lambda event: event["type"] == "live" and event["live"]["done"] > 0.1)
    stand.faults.begin(FaultKind.UNPLUGGED)
    job, _ = followed(client, job)
    stand.faults.clear()
    assert job["state"] == "failed" and "front" in job["message"]
    fault = client.get("/api/home").json["fault"]
    assert "front" in fault
    assert client.get("/api/home").json["not_stopped"] == ["Laser may be ON: sensor front"]
    refused = client.post("/api/jobs", {"kind": "calibrate"})
    assert refused.status == 409 and refused.problem == fault
    assert client.get("/api/jobs/current").json["id"] == job["id"]
    assert client.post("/api/reset", timeout=60).json["fault"] == fault
    assert client.get("/api/home").json["fault"] is None
