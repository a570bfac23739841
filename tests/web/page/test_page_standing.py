"""What the page says of results and calibrations whose worth has changed, in a real browser on the real server."""

import json
from contextlib import ExitStack

import pytest

from command import run
from small_records import calibration, inspection
from truestand.files.recipes.recipes import read_shaft, read_stand, shaft_recipe, stand_recipe
from truestand.station.stand_lock import StandLock
from truestand.store import Store
from web_lab import Client, change, served

expect = pytest.importorskip("playwright.sync_api", reason="playwright is not installed").expect


@pytest.fixture
def store(state):
    """With a calibration and a part that conforms by it."""
    found = Store.open(state.settings.store, create=True)
    found.add("calibration", calibration())
    found.add("inspection", CONFORMING, rests_on(found, 1))
    return found


CONFORMING = inspection(verdict="conforms") | {"reasons": [], "characteristics": [], "scan": None}


def rests_on(store, number):
    return {"calibration": store.evidence(store.entry(number))["record"]}


def verify(store, verdict, number=1):
    record = {"format": "truestand.verification", "version": 1, "verdict": verdict, "reasons": [f"it {verdict}"]}
    return store.add("verification", record, rests_on(store, number))


TAKEN_BACK = [
    (lambda store: store.correct(1, None, reason="the shaft was dirty"),
     "rests on calibration #1, which is withdrawn by #3 (the shaft was dirty); inspect again"),
    (lambda store: verify(store, "does_not_hold"), "since then calibration #1 did not hold: verification #3 of"),
]  # fmt: skip


@pytest.mark.parametrize(("happens", "said"), TAKEN_BACK, ids=["withdrawn", "verified since"])
def test_a_result_in_doubt_is_green_nowhere_and_says_why(state, store, tab, happens, said):
    happens(store)
    with served(state) as port:
        for path in ("#/", "#/results"):
            tab.goto(f"http://127.0.0.1:{port}/{path}")
            row = tab.locator(".row", has_text="gear")
            expect(row.locator(".verdict")).to_have_text("conforms, in doubt")
            expect(row.locator(".doubt")).to_contain_text(said)
            expect(row.locator(".mark.open")).to_be_visible()
        tab.goto(f"http://127.0.0.1:{port}/#/results/2")
        expect(tab.locator(".stamp.open .word")).to_have_text("conforms, in doubt")
        expect(tab.locator(".decisive li").first).to_contain_text(said)
        assert tab.locator("main .good").count() == 0


def test_a_job_whose_calibration_did_not_hold_does_not_end_green(state, store, tab):
    verify(store, "does_not_hold")
    worker = state.settings.stand.with_name("worker")
    worker.mkdir()
    resting = CONFORMING | {"calibration": {"sha256": store.entry(1).record}}
    (worker / "inspect.json").write_text(json.dumps(resting))
    with served(state) as port:
        client = Client(port)
        client.session()
        client.post("/api/jobs", {"kind": "inspect", "part": "gear"})
        tab.goto(f"http://127.0.0.1:{port}/#/job")
        expect(tab.locator(".stamp.open h1")).to_have_text("conforms, in doubt")
        expect(tab.locator(".decisive")).to_contain_text("rests on calibration #1, which did not hold before")


def test_an_undecided_line_says_why(state, store, tab):
    line = inspection()["characteristics"][0] | {"verdict": "undecided", "reason": "a dent of 20 um may be hidden"}
    number = store.add("inspection", CONFORMING | {"verdict": "undecided", "characteristics": [line]}).number
    with served(state) as port:
        tab.goto(f"http://127.0.0.1:{port}/#/results/{number}")
        expect(tab.locator("tr.undecided")).to_contain_text("a dent of 20 µm may be hidden")


def test_home_says_why_a_calibration_is_not_used(state, store, tab):
    store.add("calibration", calibration() | {"method": "paper"})
    with served(state) as port:
        tab.goto(f"http://127.0.0.1:{port}/")
        expect(tab.locator(".stamp.good .word")).to_have_text("Calibrated")
        why = "Calibration #3 is not used: it is of the published method, which can inspect nothing."
        expect(tab.locator(".stamp")).to_contain_text(why)
        store.correct(1, None, reason="the shaft was dirty")
        tab.reload()
        expect(tab.locator(".stamp.bad .word")).to_have_text("Not calibrated")
        expect(tab.locator(".stamp")).to_contain_text(why)


def test_home_and_inspect_name_what_changed_in_the_recipes(state, store, tab):
    stand, shaft = state.settings.stand, state.settings.artefact
    made = {"stand": stand_recipe(read_stand(stand)), "artefact": shaft_recipe(read_shaft(shaft))}
    store.add("calibration", calibration() | made)
    with served(state) as port:
        tab.goto(f"http://127.0.0.1:{port}/")
        expect(tab.locator(".stamp.good .word")).to_have_text("Calibrated")
        change(stand, {"points = 640": "points = 320 # fewer", "[devices.acquire]": "# a comment\n[devices.acquire]"})
        change(shaft, {"diameter_mm = 25.0": "diameter_mm = 25.5"})
        tab.reload()
        expect(tab.locator(".stamp.open .word")).to_have_text("Recipe changed")
        expect(tab.locator(".task.primary")).to_have_text("Calibrate")
        tab.goto(f"http://127.0.0.1:{port}/#/inspect")
        for text in (
            "stand.toml: sensor front points is 320, was 640",
            "shaft.toml: cylinder base diameter_mm is 25.5, was 25",
        ):
            expect(tab.locator(".notice.open")).to_contain_text(text)
        expect(tab.locator(".notice p")).to_have_count(3)


def truestand(state, *arguments):
    """The command line at work in the same store."""
    done = run(*arguments, "--store", state.settings.store)
    assert done.returncode == 0, done.stderr


def test_open_pages_follow_what_other_programs_do(state, store, chromium):
    with served(state) as port, ExitStack() as tabs:
        shown = {}
        for path in ("#/", "#/inspect", "#/results", "#/results/2"):
            context = chromium.new_context(viewport={"width": 1280, "height": 800})
            tabs.callback(context.close)
            shown[path] = context.new_page()
            shown[path].goto(f"http://127.0.0.1:{port}/{path}")
            shown[path].locator("main .page").wait_for()
        expect(shown["#/"].locator(".stamp.good")).to_be_visible()
        expect(shown["#/inspect"].locator(".warning")).to_be_hidden()
        verify(store, "does_not_hold")
        expect(shown["#/"].locator(".stamp.bad .word")).to_have_text("Calibration does not hold")
        expect(shown["#/"].locator(".row", has_text="gear").locator(".verdict")).to_have_text("conforms, in doubt")
        expect(shown["#/inspect"].locator(".warning")).to_contain_text("The calibration does not hold")
        expect(shown["#/results"].locator(".row")).to_have_count(3)
        expect(shown["#/results/2"].locator(".stamp.open .word")).to_have_text("conforms, in doubt")
        truestand(state, "store", "correct", 3, "--reason", "the shaft was dirty")
        expect(shown["#/"].locator(".stamp.good .word")).to_have_text("Calibrated")
        expect(shown["#/inspect"].locator(".warning")).to_be_hidden()
        expect(shown["#/results/2"].locator(".stamp.good .word")).to_have_text("conforms")
        truestand(state, "store", "correct", 1, "--reason", "another shaft")
        expect(shown["#/"].locator(".stamp.bad .word")).to_have_text("Not calibrated")
        expect(shown["#/inspect"].locator(".warning")).to_contain_text("The stand is not calibrated")


def test_an_open_page_shows_a_fault_that_another_program_latched(state, store, tab):
    with served(state) as port:
        tab.goto(f"http://127.0.0.1:{port}/#/results")
        expect(tab.locator(".row")).to_have_count(2)
        lock = StandLock(state.settings.stand)
        lock.latch_fault("2026-11-21T10:00:00Z", "the table stopped by itself", {})
        lock.close()
        expect(tab.locator(".strip.bad")).to_contain_text("the table stopped by itself")


def test_withdrawn_and_corrected_results_lose_their_tick(state, store, tab):
    store.add("inspection", CONFORMING)
    store.correct(2, CONFORMING | {"verdict": "undecided"}, reason="wrong drawing")
    store.correct(3, None, reason="another part was clamped")
    with served(state) as port:
        tab.goto(f"http://127.0.0.1:{port}/#/results")
        expect(tab.locator(".row .verdict")).to_have_text(["withdrawn", "undecided", "withdrawn", "corrected", "valid"])
        expect(tab.locator(".row .verdict.good")).to_have_count(1)
        tab.goto(f"http://127.0.0.1:{port}/#/results/3")
        expect(tab.locator(".stamp.none .word")).to_have_text("withdrawn")
        expect(tab.locator(".stamp .under")).to_contain_text("it said: conforms")
        expect(tab.locator(".notice")).to_contain_text("withdrawn by #5")
        tab.get_by_role("link", name="Show the correction").click()
        expect(tab.locator(".stamp .under")).to_contain_text("withdraws #3")
        expect(tab.get_by_role("button", name="Withdraw")).to_have_count(0)
