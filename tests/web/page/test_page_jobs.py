"""Guided jobs: by keyboard alone, seen live, stopped, failed, and what the end says."""

import json
import re

import pytest

import stored_results

expect = pytest.importorskip("playwright.sync_api", reason="playwright is not installed").expect


TABS = 60


def focus(tab, name):
    """Go on with the Tab key until an element of that name has the focus."""
    for _ in range(TABS):
        tab.keyboard.press("Tab")
        shown = tab.evaluate("[document.activeElement.innerText, document.activeElement.id].join(' ')")
        if name in shown:
            return
    raise AssertionError(f"Tab never reached {name}")


def inspection(stand):
    return stored_results.read(stand.made, "inspection")


def test_inspect_by_keyboard_alone(open_tab, stand):
    stand.will_measure("inspect", stored_results.conforming(inspection(stand)))
    tab = open_tab("#/")
    focus(tab, "Inspect a part")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="Which part?").wait_for()
    focus(tab, "demo wheel")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="demo wheel").wait_for()
    focus(tab, "i-serial")
    tab.keyboard.type("S-17")
    focus(tab, "i-operator")
    tab.keyboard.type("kim")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="Mount the part").wait_for()
    assert "S-17" in tab.locator(".facts-list").inner_text()
    focus(tab, "Start")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="conforms").wait_for()
    assert tab.evaluate("document.activeElement.tagName") == "H1"
    focus(tab, "Next part")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="demo wheel").wait_for()
    assert tab.locator("#i-serial").input_value() == ""
    assert tab.locator("#i-operator").input_value() == "kim"


def test_fields_of_the_part_reach_the_worker(open_tab, stand):
    tab = open_tab("#/inspect/gear")
    for name, text in (("serial", "long"), ("order", "O-2"), ("operator", "Olga")):
        tab.locator(f"#i-{name}").fill(text)
    tab.get_by_role("button", name="Next").click()
    tab.get_by_role("button", name="Start").click()
    tab.locator(".sensor").wait_for()
    request = json.loads((stand.job_folder / "request.json").read_text(encoding="utf-8"))
    assert {key: request[key] for key in ("operator", "order", "serial")} == {
        "operator": "Olga", "order": "O-2", "serial": "long"}  # fmt: skip
    assert request["part"] == str(stand.folder / "gear.toml")


def test_a_job_is_seen_live_and_stopped(open_tab, stand):
    stand.run("hold")
    tab = open_tab("#/job")
    expect(tab.locator(".gauge .share")).to_have_text("12 %")
    expect(tab.locator(".sensor")).to_have_count(2)
    expect(tab.locator(".lost")).to_have_text(["0 ✓", "12 ✗"])
    expect(tab.locator(".dial strong")).to_have_text(re.compile("°$"))
    picture = "c.getContext('2d').getImageData(0, 0, c.width, c.height).data"
    drawn = f"(c) => {picture}.filter((v, i) => i % 4 === 3 && v > 200).length > 500"
    tab.wait_for_function(drawn, arg=tab.locator("canvas.profile").first.element_handle())
    box = tab.get_by_role("button", name="Stop").bounding_box()
    assert box["height"] >= 48 and box["y"] + box["height"] <= 800
    tab.get_by_role("button", name="Stop").click()
    tab.get_by_role("heading", name="Stopped").wait_for()
    assert (stand.job_folder / "stopped").exists()


def test_a_running_job_shows_on_every_page(open_tab, stand):
    stand.run("long")
    tab = open_tab("#/recipes")
    tab.locator(".strip.busy").get_by_role("link", name="Show").click()
    tab.get_by_role("button", name="Stop").wait_for()
    tab.goto(stand.url + "#/inspect")
    tab.get_by_role("button", name="Stop").wait_for()


def test_a_failed_job_says_why(open_tab, stand):
    stand.run("fail")
    tab = open_tab("#/job")
    tab.get_by_role("heading", name="Failed").wait_for()
    assert "found <b>no shaft</b>" in tab.locator(".stamp").inner_text()
    assert tab.get_by_role("link", name="Try again").is_visible()


def test_a_nonconforming_part_says_why(open_tab, stand):
    record = stored_results.partly_seen(inspection(stand))
    stand.will_measure("inspect", record)
    stand.run(kind="inspect", part="gear")
    tab = open_tab("#/job")
    tab.get_by_role("heading", name="does not conform").wait_for()
    tab.locator(".decisive").wait_for()
    text = tab.locator(".decisive").inner_text()
    pitch = next(c for c in record["characteristics"] if (c["name"], c["flank"]) == ("f_p", "right"))
    assert "Not measurable in this scan" in text and f"{pitch['value_um']:.1f} ± {pitch['U_um']:.1f} µm" in text
    assert "Chipped end" in text
    assert " · quick" in tab.locator(".stamp .over").inner_text()
    assert tab.locator(".stamp .word").bounding_box()["height"] >= 60


def test_an_answer_from_before_the_end_does_not_bring_a_job_back(open_tab, stand):
    stand.run("long")
    tab, held = open_tab("#/job"), []

    def hold(route):
        held.append((route, route.fetch()))

    tab.get_by_role("button", name="Stop").wait_for()
    tab.route("**/api/home", hold, times=1)
    ask = "window.asked = import('./js/api.js').then((api) => api.loadHome())"
    with tab.expect_request("**/api/home"):
        tab.evaluate(f"() => void ({ask})")
    while not held:
        tab.wait_for_timeout(10)
    (stand.job_folder / "stop").touch()
    tab.get_by_role("heading", name="valid").wait_for()
    ((route, answer),) = held
    route.fulfill(response=answer)
    tab.evaluate("() => window.asked")
    assert tab.get_by_role("heading", name="valid").is_visible()
    assert not tab.get_by_role("button", name="Stop").is_visible()


def test_a_result_that_could_not_be_read_at_once_is_asked_for_again(open_tab, stand):
    stand.will_measure("inspect", stored_results.partly_seen(inspection(stand)))
    tab, refused = open_tab("#/", expect=["503"]), []

    def refuse_once(route):
        refused.append(route.request.url)
        route.fulfill(status=503) if len(refused) == 1 else route.fallback()

    tab.route(re.compile(r"/api/results/\d+$"), refuse_once)
    stand.run(kind="inspect", part="gear")
    tab.goto(stand.url + "#/job")
    tab.locator(".decisive").wait_for()
    assert len(refused) > 1


def test_the_end_takes_the_keyboard_whichever_answer_comes_first(open_tab, stand):
    stand.will_measure("inspect", stored_results.conforming(inspection(stand)))
    stand.run("long", kind="inspect", part="gear")
    tab, held = open_tab("#/job"), []

    def hold_first(route):
        held.append(route)
        if len(held) > 1:
            route.fallback()

    tab.get_by_role("button", name="Stop").wait_for()
    tab.route(re.compile(r"/api/results/\d+$"), hold_first)
    (stand.job_folder / "stop").touch()
    tab.get_by_role("heading", name="conforms").wait_for()
    held[0].fallback()
    assert tab.evaluate("document.activeElement.tagName") == "H1"


def test_calibrate_and_verify(open_tab, stand):
    stand.will_measure("calibrate", stored_results.read(stand.made, "calibration"))
    stand.will_measure("verify", stored_results.read(stand.made, "verification"))
    tab = open_tab("#/calibrate")
    assert "“shaft M”" in tab.locator(".todo").inner_text()
    tab.get_by_role("button", name="Start").click()
    tab.get_by_role("heading", name="valid").wait_for()
    tab.goto(stand.url + "#/calibrate")
    tab.get_by_label("Only verify").check()
    tab.get_by_text("Changes nothing").wait_for()
    tab.get_by_role("button", name="Start").click()
    tab.get_by_role("heading", name="holds").wait_for()


def test_a_refusal_stands_beside_the_button(open_tab, stand):
    stand.forget_results()
    tab = open_tab("#/inspect/gear", expect=["409"])
    tab.get_by_role("button", name="Next").click()
    tab.get_by_role("button", name="Start").click()
    tab.get_by_text("found no calibration of this stand").wait_for()
    assert tab.get_by_role("button", name="Start").is_enabled()


def test_inspect_warns_before_the_work(open_tab, stand):
    expired = stored_results.read(stand.made, "calibration") | {"valid_until": "2001-01-01"}
    stand.store.add("calibration", expired)
    assert "The calibration has expired" in open_tab("#/inspect").locator(".notice").inner_text()


def test_without_the_live_channel_the_page_asks(chromium, stand):
    context = chromium.new_context()
    tab = context.new_page()
    tab.route_web_socket("**/api/live", lambda socket: socket.close())
    stand.run("long")
    tab.goto(stand.url + "#/job")
    tab.get_by_text("No connection to the stand").wait_for()
    (stand.job_folder / "stop").touch()
    tab.get_by_role("heading", name="valid").wait_for()
    context.close()
