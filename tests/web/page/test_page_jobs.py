"""Guided jobs: by keyboard alone, seen live, stopped, failed, and what the end says."""

import pytest

expect = pytest.importorskip("playwright.sync_api", reason="playwright is not installed").expect


TABS = 60


def focus(tab, name):
    """Go on with the Tab key until an element of that name has the focus."""
    for _ in range(TABS):
        tab.keyboard.press("Tab")
        told = tab.evaluate("[document.activeElement.innerText, document.activeElement.id].join(' ')")
        if name in told:
            return
    raise AssertionError(f"Tab never reached {name}")


def test_inspect_by_keyboard_alone(open_tab, mock):
    mock.play(seconds=0.6)
    tab = open_tab("#/")
    focus(tab, "Inspect a part")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="Which part?").wait_for()
    focus(tab, "Pump shaft")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="Pump shaft").wait_for()
    focus(tab, "i-serial")
    tab.keyboard.type("S-17")
    focus(tab, "i-operator")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="Mount the part").wait_for()
    assert "S-17" in tab.locator(".facts-list").inner_text()
    focus(tab, "Start")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="conforms").wait_for()
    assert tab.evaluate("document.activeElement.tagName") == "H1"
    focus(tab, "Next part")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="Pump shaft").wait_for()
    assert tab.locator("#i-serial").input_value() == ""
    assert tab.locator("#i-operator").input_value() == "engineer"


def test_what_was_said_of_the_part_is_ordered(open_tab, mock):
    mock.play(slow=True)
    tab = open_tab("#/inspect/demo-wheel")
    for name, text in (("serial", "S-1"), ("order", "O-2"), ("operator", "Olga")):
        tab.locator(f"#i-{name}").fill(text)
    tab.get_by_role("button", name="Next").click()
    tab.get_by_role("button", name="Start").click()
    tab.get_by_role("button", name="Stop").wait_for()
    job = tab.evaluate("fetch('api/jobs/current').then((r) => r.json())")
    assert job["asked"] == {"operator": "Olga", "order": "O-2", "serial": "S-1"} and job["part"] == "demo-wheel"


def test_a_job_is_seen_live_and_stopped(open_tab, mock):
    mock.play(slow=True)
    mock.run()
    tab = open_tab("#/job")
    expect(tab.locator(".gauge .share")).to_have_text("42 %", timeout=8000)
    assert tab.locator(".sensor").count() == 2
    assert tab.locator(".lost").all_inner_texts() == ["0 ✓", "12 ✗"]
    assert tab.locator(".dial strong").inner_text().endswith("°")
    picture = "c.getContext('2d').getImageData(0, 0, c.width, c.height).data"
    drawn = f"(c) => {picture}.filter((v, i) => i % 4 === 3 && v > 200).length"
    assert tab.locator("canvas.profile").first.evaluate(drawn) > 500
    box = tab.get_by_role("button", name="Stop").bounding_box()
    assert box["height"] >= 48 and box["y"] + box["height"] <= 800
    tab.get_by_role("button", name="Stop").click()
    tab.get_by_role("heading", name="Stopped").wait_for()
    assert "what was recorded is kept" in tab.locator(".stamp").inner_text()


def test_a_running_job_shows_on_every_page(open_tab, mock):
    mock.play(slow=True)
    mock.run()
    tab = open_tab("#/recipes")
    tab.locator(".strip.busy").get_by_role("link", name="Show").click()
    tab.get_by_role("button", name="Stop").wait_for()
    tab.goto(mock.url + "#/inspect")
    tab.get_by_role("button", name="Stop").wait_for()


def test_a_failed_job_says_what_to_do(open_tab, mock):
    mock.play(seconds=0.4, end="failed")
    mock.run()
    tab = open_tab("#/job")
    tab.get_by_role("heading", name="Failed").wait_for()
    assert "check the network cable of front" in tab.locator(".stamp").inner_text()
    assert tab.get_by_role("link", name="Try again").is_visible()


def test_a_bad_part_says_why(open_tab, mock):
    mock.play(seconds=0.4, outcome="does_not_conform")
    mock.run()
    tab = open_tab("#/job")
    tab.get_by_role("heading", name="does not conform").wait_for()
    tab.locator(".decisive").wait_for()
    text = tab.locator(".decisive").inner_text()
    assert "Not measurable in this scan" in text and "17.7 ± 1.8 µm" in text and "One defect deeper than 50 µm" in text
    assert tab.locator(".stamp .word").bounding_box()["height"] >= 60


def test_calibrate_and_verify(open_tab, mock):
    mock.play(seconds=0.4)
    tab = open_tab("#/calibrate")
    assert "“shaft M”" in tab.locator(".todo").inner_text()
    tab.get_by_role("button", name="Start").click()
    tab.get_by_role("heading", name="valid").wait_for()
    tab.goto(mock.url + "#/calibrate")
    tab.get_by_label("Only verify").check()
    tab.get_by_text("Changes nothing").wait_for()
    tab.get_by_role("button", name="Start").click()
    tab.get_by_role("heading", name="holds").wait_for()


def test_a_refusal_stands_beside_the_button(open_tab, mock):
    mock.play(fault="door open")
    tab = open_tab("#/calibrate", expect=["409"])
    tab.get_by_role("button", name="Start").click()
    tab.get_by_text("found the stand in fault: door open").wait_for()
    assert tab.get_by_role("button", name="Start").is_enabled()


def test_inspect_warns_before_the_work(open_tab, mock):
    mock.play(calibration="expired")
    assert "The calibration has expired" in open_tab("#/inspect").locator(".notice").inner_text()


def test_without_the_live_channel_the_page_asks(chromium, mock):
    mock.play(seconds=3.0)
    context = chromium.new_context()
    tab = context.new_page()
    tab.route_web_socket("**/api/live", lambda socket: socket.close())
    mock.run()
    tab.goto(mock.url + "#/job")
    tab.get_by_text("No connection to the stand").wait_for()
    tab.get_by_role("heading", name="conforms").wait_for(timeout=15000)
    context.close()
