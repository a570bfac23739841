"""Jobs: started, followed, aborted; and the worker never waits for who watches."""

import io
import json
import threading
import time

import pytest

from patience import NOT_FOR_EVER
from truestand.core.errors import Fault, TruestandError
from truestand.station.worker import EventWriter
from truestand.web import runner as runners
from truestand.web.hub import Hub
from truestand.web.runner import JobRunner
from web_lab import WORKER, make_state, served

STEPS = (("acquire", "Scan the shaft"), ("evaluate", "Calibrate"), ("report", "Write"), ("keep", "Keep"))


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "jobs" / "1"


@pytest.fixture
def running(folder):
    found = JobRunner(Hub(), WORKER)
    yield found
    found.close()


def start(runner, folder, does):
    return runner.start({"kind": "calibrate", "serial": does, "folder": str(folder)}, "shaft M", None, STEPS)


def ended(runner, within=NOT_FOR_EVER):
    until = time.monotonic() + within
    while runner.busy or runner._reader.is_alive():
        assert time.monotonic() < until
        time.sleep(0.01)
    return runner.current()


def wait_for(condition, within=NOT_FOR_EVER):
    until = time.monotonic() + within
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.01)


def test_a_job_goes_through_its_steps(running, folder):
    job = start(running, folder, "quick")
    assert job["state"] == "running" and job["done"] < 1.0 and job["title"] == "shaft M"
    assert [s["label"] for s in job["steps"]] == ["Scan the shaft", "Calibrate", "Write", "Keep"]
    done = ended(running)
    assert done["state"] == "done" and done["done"] == 1.0 and done["status"] == "valid"
    assert {s["state"] for s in done["steps"]} == {"done"}


def test_a_second_job_at_the_same_time_is_refused(running, folder):
    job = start(running, folder, "long")
    with pytest.raises(TruestandError, match="runs already"):
        start(running, folder, "quick")
    running.abort(job["id"])
    assert ended(running)["state"] == "aborted"


def test_a_failed_job_has_the_workers_message(running, folder):
    start(running, folder, "fail")
    job = ended(running)
    assert job["state"] == "failed" and job["message"] == "found <b>no shaft</b>"
    assert job["steps"][0]["state"] == "failed" and job["steps"][1]["state"] == "waiting"


def test_a_worker_that_dies_has_failed(running, folder, capfd):
    start(running, folder, "crash")
    job = ended(running)
    assert job["state"] == "failed" and "code 3: Segmentation fault" in job["message"]
    assert job["steps"][0]["state"] == "failed"
    assert "Segmentation fault" in capfd.readouterr().err


def test_a_worker_that_cannot_be_started_has_failed(tmp_path, folder):
    gone = JobRunner(Hub(), (WORKER[0], str(tmp_path / "none.py")))
    start(gone, folder, "quick")
    assert ended(gone)["state"] == "failed"


def test_garbage_of_a_worker_is_ignored(running, folder):
    start(running, folder, "garbage")
    assert ended(running)["state"] == "done"


def test_a_worker_whose_server_died_stops_the_stand_and_says_why():
    class Gone(io.StringIO):
        def flush(self):
            raise BrokenPipeError

    events = EventWriter(Gone())
    events.emit({"event": "live"})
    events.close()
    with pytest.raises(Fault, match="the page's server stopped while the job ran"):
        events.emit({"event": "live"})


def test_a_server_that_reads_nothing_does_not_block_the_worker():
    class Stalled(io.StringIO):
        began, go = threading.Event(), threading.Event()

        def flush(self):
            self.began.set()
            self.go.wait(20)

    out = Stalled()
    events = EventWriter(out)
    events.emit({"event": "step", "n": 0})
    assert out.began.wait(20)
    for n in range(1, 100):  # all of it while the first one is not taken
        events.emit({"event": "live", "n": n})
    events.emit({"event": "step", "n": 100})
    out.go.set()
    events.close()
    assert [json.loads(line)["n"] for line in out.getvalue().splitlines()] == [0, 1, 100]


def test_an_abort_lets_the_stand_stop(running, folder):
    job = start(running, folder, "long")
    wait_for(lambda: running.current()["done"] > 0)
    assert running.abort("another") is None
    assert running.abort(job["id"])["message"] == "stopping"
    assert running.abort(job["id"])["state"] == "running"  # at once again: nothing more
    assert ended(running)["state"] == "aborted"
    assert (folder / "stopped").exists()
    assert running.abort(job["id"])["state"] == "aborted"


def test_a_second_abort_some_seconds_later_ends_a_worker_that_does_not_obey(running, folder, monkeypatch):
    job = start(running, folder, "stubborn")
    wait_for(lambda: running.current()["done"] > 0)
    running.abort(job["id"])
    running.abort(job["id"])
    time.sleep(0.3)
    assert running.busy
    monkeypatch.setattr(runners, "KILL_DELAY_S", 0.2)
    running.abort(job["id"])
    assert ended(running)["state"] == "aborted"
    assert "see that table and laser are off" in running.current()["message"]


def test_ending_the_page_stops_the_stand_first(tmp_path):
    state = make_state(tmp_path)
    with served(state) as port:
        from web_lab import Client

        client = Client(port)
        client.session()
        client.post("/api/jobs", {"kind": "calibrate", "serial": "long"})
        wait_for(lambda: state.runner.current()["done"] > 0)
    assert state.runner.current()["state"] == "aborted"
    assert list(state.settings.jobs_folder.glob("*/stopped"))
    with pytest.raises(TruestandError, match="being ended"):
        start(state.runner, tmp_path / "j", "quick")


def test_a_stubborn_worker_does_not_outlive_the_page(folder, monkeypatch):
    runner = JobRunner(Hub(), WORKER)
    start(runner, folder, "stubborn")
    wait_for(lambda: runner.current()["done"] > 0)
    monkeypatch.setattr(runners, "SHUTDOWN_TIMEOUT_S", 0.5)
    runner.close()
    assert runner._running.process.poll() is not None


def test_the_request_has_all_that_the_worker_needs(client, state, tmp_path):
    answer = client.post("/api/jobs", {"kind": "calibrate", "operator": "Anna", "order": "4711", "serial": "fail"})
    assert answer.status == 200 and answer.json["kind"] == "calibrate" and answer.json["title"] == "shaft M"
    state.runner._reader.join(20)
    (written,) = state.settings.jobs_folder.glob("*/request.json")
    request = json.loads(written.read_text())
    assert request["stand"] == str(tmp_path / "stand.toml") and request["artefact"] == str(tmp_path / "shaft.toml")
    assert request["store"] == str(tmp_path / "results") and request["folder"] == str(written.parent)
    assert request["operator"] == "Anna" and request["order"] == "4711"


def test_with_users_the_operator_is_the_user_logged_in(visitor, guarded_state):
    visitor.login("olga")
    assert visitor.post("/api/jobs", {"kind": "calibrate", "operator": "somebody", "serial": "fail"}).status == 200
    guarded_state.runner._reader.join(20)
    (written,) = guarded_state.settings.jobs_folder.glob("*/request.json")
    assert json.loads(written.read_text())["operator"] == "olga"


BAD = [
    ({"kind": "inspect"}, 422, "part"),
    ({"kind": "inspect", "part": "none"}, 404, "no part"),
    ({"kind": "inspect", "part": "../gear"}, 404, "no part"),
    ({"kind": "inspect", "part": "gear"}, 409, "no calibration"),
    ({"kind": "verify"}, 409, "no calibration"),
    ({"kind": "destroy"}, 422, "kind"),
    ({}, 422, "kind"),
    ({"kind": "calibrate", "part": "stand"}, 404, "no part"),
    ({"kind": "calibrate", "stand": "x"}, 422, "stand"),
    ({"kind": "calibrate", "operator": "a\nb"}, 422, "control"),
    ({"kind": "calibrate", "operator": "x" * 200}, 422, "operator"),
]


@pytest.mark.parametrize(("body", "status", "word"), BAD)
def test_a_job_that_makes_no_sense_is_refused(client, state, body, status, word):
    answer = client.post("/api/jobs", body)
    assert answer.status == status and word in answer.problem
    assert state.runner.current() is None


def test_while_a_job_runs_other_uses_of_the_stand_are_refused(client):
    assert client.get("/api/jobs/current").json is None
    job = client.post("/api/jobs", {"kind": "calibrate", "serial": "long"}).json
    assert client.post("/api/jobs", {"kind": "calibrate"}).status == 409
    assert client.get("/api/devices").status == 409
    assert client.post("/api/reset").status == 409
    assert client.get("/api/jobs/current").json["id"] == job["id"]
    assert client.get("/api/home").json["job"]["id"] == job["id"]
    assert client.post("/api/jobs/none/abort").status == 404
    assert client.post(f"/api/jobs/{job['id']}/abort").json["message"] == "stopping"


def test_the_folder_of_a_failed_job_stays(client, state):
    client.post("/api/jobs", {"kind": "calibrate", "serial": "fail"})
    state.runner._reader.join(20)
    assert len(list(state.settings.jobs_folder.iterdir())) == 1


def test_a_latched_fault_is_shown_and_its_reset_needs_the_table(client, tmp_path):
    mark = tmp_path / ".stand.toml.state"
    mark.write_text(json.dumps({"state": "fault", "since": "2026-11-21T10:00:00Z", "reason": "sensor front lost"}))
    assert "sensor front lost" in client.get("/api/home").json["fault"]
    answer = client.post("/api/reset")  # the table does not answer: nobody can say that it is well
    assert answer.status == 409 and "no answer" in answer.problem
    assert mark.exists()


def test_a_stand_that_another_program_uses_is_in_no_fault(client, tmp_path):
    from truestand.station.stand_lock import StandLock

    lock = StandLock(tmp_path / "stand.toml")
    lock.set_in_use("now", tmp_path / "k1.log")
    assert client.get("/api/home").json["fault"] is None
    lock.latch_fault("now", "it broke", {})
    lock.close()
    assert "it broke" in client.get("/api/home").json["fault"]
    assert client.get("/api/home").json["not_stopped"] == []
    (tmp_path / ".stand.toml.state").write_text(json.dumps({"state": "in use", "since": "now", "log": "k1.log"}))
    assert "died" in client.get("/api/home").json["fault"]
