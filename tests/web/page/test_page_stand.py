"""What the page says of the stand, in a real browser on the real server: nothing is a mock but the worker."""

import subprocess
import sys
from contextlib import contextmanager

import pytest

import web_lab
from truestand.station.stand_lock import StandLock
from truestand.store import Store
from web_lab import Client, served

expect = pytest.importorskip("playwright.sync_api", reason="playwright is not installed").expect

MOVED = "sensor, radially: the sensor has moved or turned in the laser plane: calibrate again"


@pytest.fixture
def store(state):
    """With a calibration that is valid."""
    found = Store.open(state.settings.store, create=True)
    found.add("calibration", {"format": "truestand.calibration", "version": 1, "status": "valid", "reasons": []})
    return found


def verify(store, verdict, reasons=(), number=1):
    """Keep a verification of a calibration, as the job and the command line do."""
    against = store.evidence(store.entry(number))["record"]
    record = {"format": "truestand.verification", "version": 1, "verdict": verdict, "reasons": list(reasons)}
    return store.add("verification", record, {"calibration": against})


def test_a_verification_that_does_not_hold_asks_to_calibrate(state, store, tab):
    verify(store, "does_not_hold", [MOVED])
    with served(state) as port:
        tab.goto(f"http://127.0.0.1:{port}/")
        expect(tab.locator(".stamp.bad .word")).to_have_text("Calibration does not hold")
        expect(tab.locator(".stamp")).to_contain_text(MOVED)
        expect(tab.locator(".stamp .until")).to_contain_text("verified")
        expect(tab.locator(".task.primary")).to_have_text("Calibrate")
        tab.goto(f"http://127.0.0.1:{port}/#/inspect/gear")
        tab.get_by_role("button", name="Next").click()
        expect(tab.locator(".notice.bad")).to_contain_text("The calibration does not hold, as the verification of")
        expect(tab.locator(".notice.bad")).to_contain_text(MOVED)
        expect(tab.locator("main .button.primary")).to_have_text("Calibrate")


def test_an_undecided_verification_is_shown_as_undecided(state, store, tab):
    verify(store, "undecided", ["sensor, radially: found 9.80 um with U 2.00 um, limit 10.00 um"])
    with served(state) as port:
        tab.goto(f"http://127.0.0.1:{port}/")
        expect(tab.locator(".stamp.open .word")).to_have_text("Verification undecided")
        expect(tab.locator(".stamp")).to_contain_text("found 9.80 µm with U 2.00 µm, limit 10.00 µm")
        expect(tab.locator(".task.primary")).to_have_text("Calibrate")
        tab.goto(f"http://127.0.0.1:{port}/#/inspect")
        expect(tab.locator(".notice.open")).to_contain_text("whether the calibration still holds is not known")
        expect(tab.locator("main .button.primary")).to_have_text("Calibrate")


def test_a_verify_job_that_does_not_hold_leads_to_the_calibration(state, store, tab):
    with served(state) as port:
        client = Client(port)
        client.session()
        client.post("/api/jobs", {"kind": "verify", "serial": "moved"})
        tab.goto(f"http://127.0.0.1:{port}/#/job")
        expect(tab.locator(".stamp.bad .word")).to_have_text("does not hold")
        expect(tab.locator("main .button.primary")).to_have_text("Calibrate")


@contextmanager
def server(folder, port=0):
    """A page in a process of its own; the process and its port."""
    command = [sys.executable, web_lab.__file__, str(folder), str(port)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process, int(process.stdout.readline())
        finally:
            process.kill()


def watch_a_job(tab, port):
    """Start a job that runs until it is aborted, and look at it."""
    client = Client(port)
    client.session()
    client.post("/api/jobs", {"kind": "calibrate", "serial": "long"})
    tab.goto(f"http://127.0.0.1:{port}/#/job")
    tab.get_by_role("button", name="Stop").wait_for()


def silent(socket):
    """A connection that stays open though nothing comes any more: a cable that was pulled."""


@pytest.mark.parametrize("cut", [False, True])
def test_a_job_whose_server_died_is_shown_as_unknown_then_ended(tmp_path, tab, cut):
    if cut:
        tab.route_web_socket("**/api/live", silent)
    with server(tmp_path) as (process, port):
        watch_a_job(tab, port)
        process.kill()
        expect(tab.locator(".stamp.open .word")).to_be_visible()
        expect(tab.locator(".stamp.open .word")).to_have_text("State unknown")
        expect(tab.locator(".stamp")).to_contain_text("Whether the job still runs is not known")
        expect(tab.get_by_role("button", name="Stop")).to_be_hidden()
    with server(tmp_path, port):
        expect(tab.locator(".stamp.bad .word")).to_have_text("Ended")
        expect(tab.locator(".stamp")).to_contain_text("The server stopped while it ran")
        tab.get_by_role("link", name="Try again").click()
        tab.get_by_role("button", name="Start").wait_for()


def test_a_running_job_is_shown_again_after_a_lost_connection(state, tab):
    tab.route_web_socket("**/api/live", silent)
    with served(state) as port:
        watch_a_job(tab, port)
        tab.context.set_offline(True)
        expect(tab.locator(".stamp.open .word")).to_be_visible()
        expect(tab.locator(".stamp.open .word")).to_have_text("State unknown")
        tab.goto(f"http://127.0.0.1:{port}/#/results")
        expect(tab.locator(".strip.open")).to_be_visible()
        expect(tab.locator(".strip.busy")).to_be_hidden()
        tab.context.set_offline(False)
        expect(tab.locator(".strip.busy")).to_be_visible()
        tab.goto(f"http://127.0.0.1:{port}/#/job")
        tab.get_by_role("button", name="Stop").wait_for()


@pytest.mark.parametrize(
    ("begin", "link", "shown"), [("#/", "Results", "Results"), ("#/results", "Home", "Not calibrated")]
)
def test_a_page_that_did_not_load_comes_by_itself_when_the_server_is_back(tmp_path, tab, begin, link, shown):
    with server(tmp_path) as (process, port):
        tab.goto(f"http://127.0.0.1:{port}/{begin}")
        tab.locator("main .page").wait_for()
        process.kill()
        expect(tab.locator(".strip.open")).to_be_visible()
        tab.locator("nav").get_by_role("link", name=link, exact=True).click()
        expect(tab.locator("main").get_by_role("alert")).to_contain_text("The stand does not answer")
        expect(tab.locator("main").get_by_role("alert")).to_contain_text("found no answer from the stand")
    with server(tmp_path, port):
        expect(tab.get_by_role("heading", name=shown)).to_be_visible()
        expect(tab.locator("main").get_by_role("alert")).to_have_count(0)


LIT = "Laser may be ON: sensor front"
LARGE_AND_FIRST = """(page) => {
    const said = document.querySelector(".strip.hazard .left");
    const stamp = document.querySelector(`main .page.${page} .stamp`);
    return said && stamp && parseFloat(getComputedStyle(said).fontSize) >= 32
        && said.getBoundingClientRect().y < stamp.getBoundingClientRect().y;
}"""


def test_a_laser_that_may_be_on_is_shown_first_and_large(state, tab):
    with served(state) as port:
        watch_a_job(tab, port)
        lock = StandLock(state.settings.stand)
        lock.latch_fault("2026-11-21T10:00:00Z", "the table stopped by itself", {LIT: "nobody answers"})
        lock.close()
        tab.get_by_role("button", name="Stop").click()
        for page, path in (("job", "#/job"), ("home", "#/")):
            tab.goto(f"http://127.0.0.1:{port}/{path}")
            shown = tab.get_by_role("alert").get_by_text("Laser may be ON")
            expect(shown.first).to_have_text(LIT)
            expect(tab.get_by_role("alert").first).to_contain_text("Switch it off at its supply now")
            expect(tab.locator(f"main .page.{page} .stamp")).to_be_visible()
            tab.wait_for_function(LARGE_AND_FIRST, arg=page)  # at one moment: the page draws itself anew meanwhile
            expect(tab.get_by_role("alert").first).to_contain_text("nobody answers; the table stopped by itself")


def test_a_job_is_refused_while_a_laser_may_be_on_and_the_banner_stays(state, store, tab):
    lock = StandLock(state.settings.stand)
    lock.latch_fault("2026-11-21T10:00:00Z", "the table stopped by itself", {LIT: "nobody answers"})
    lock.close()
    with served(state) as port:
        tab.goto(f"http://127.0.0.1:{port}/#/calibrate")
        banner = tab.locator(".strip.hazard")
        expect(banner).to_contain_text(LIT)
        banner.evaluate("(e) => new MutationObserver(() => (window.touched = true)).observe(e, {attributes: true})")
        tab.get_by_role("button", name="Start").click()
        expect(tab.locator("main").get_by_role("alert")).to_contain_text("the stand is in fault since")
        expect(banner).to_contain_text(LIT)
        assert not tab.evaluate("window.touched"), "the banner was taken down meanwhile"
        assert state.runner.current() is None
