"""Every page loads at every size, without a word from the console, and says what it must."""

import pytest

import stored_results
from lab import lab
from stored_results import SIZES
from truestand.store import Store
from truestand.web.routes.files import STATIC
from web_lab import PASSWORD

expect_soon = pytest.importorskip("playwright.sync_api", reason="playwright is not installed").expect

PAGES = {
    "#/": "Home", "#/inspect": "Which part?", "#/inspect/gear": "demo wheel",
    "#/calibrate": "Mount the reference shaft", "#/job": "Job", "#/results": "Results",
    "#/results/{conforming}": "demo wheel", "#/results/{markup}/evidence": "Sun wheel",
    "#/results/{calibration}": "shaft M", "#/results/{verification}": "Verification",
    "#/devices": "Devices", "#/recipes": "Recipes", "#/recipes/gear.toml": "Recipes", "#/login": "Log in to Stand 1",
}  # fmt: skip


@pytest.mark.parametrize("path", PAGES)
def test_page_shows_its_heading_and_fits(open_tab, path):
    tab = open_tab(path)
    assert PAGES[path] in tab.locator("h1").first.inner_text() or path == "#/login"
    for width, height in SIZES.values():
        tab.set_viewport_size({"width": width, "height": height})
        assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert "null" not in tab.locator("main").inner_text() and "undefined" not in tab.locator("main").inner_text()


def test_a_line_that_holds_asks_for_nothing(open_tab):
    tab = open_tab("#/results/{verification}")
    tab.get_by_role("rowheader", name="sensor, radially").wait_for()
    assert "calibrate again" not in tab.locator("main").inner_text()


def test_first_view_needs_no_charts(open_tab):
    tab = open_tab("#/")
    tab.get_by_text("Calibrated", exact=True).wait_for()
    asked = tab.evaluate("performance.getEntriesByType('resource').map((e) => e.name)")
    assert asked and not [name for name in asked if "plotly" in name]


@pytest.mark.slow
def test_first_view_stands_within_a_second(open_tab):
    """A promise in seconds: on a quiet machine."""
    open_tab("#/devices").context.close()
    times = []
    for _ in range(3):
        fresh = open_tab("#/")
        fresh.get_by_text("Calibrated", exact=True).wait_for()
        times.append(fresh.evaluate("performance.getEntriesByName('truestand:view')[0].startTime"))
    assert min(times) < 1000, times


@pytest.mark.parametrize("state", ["valid", "untrusted", "expired", "none"])
def test_home_says_whether_the_stand_is_calibrated(open_tab, stand, state):
    changes = {
        "untrusted": {"status": "untrusted", "reasons": ["found dirt"]},
        "expired": {"valid_until": "2001-01-01"},
    }
    if state in ("none", "untrusted"):  # beside a good one, an untrusted one counts for nothing
        stand.forget_results()
    if state in changes:
        stand.store.add("calibration", stored_results.read(stand.made, "calibration") | changes[state])
    words = {
        "valid": "Calibrated",
        "untrusted": "Calibration not trusted",
        "expired": "Calibration expired",
        "none": "Not calibrated",
    }
    tab = open_tab("#/")
    assert tab.locator(".stamp .word").inner_text() == words[state]
    first = tab.locator(".task").first.inner_text()
    assert first == ("Inspect a part" if state == "valid" else "Calibrate")


def test_a_stand_without_results_says_so(open_tab, stand):
    stand.forget_results()
    assert "The first verdict will stand here" in open_tab("#/").locator("main").inner_text()
    assert "Nothing measured yet" in open_tab("#/results").locator("main").inner_text()


def test_markup_in_a_record_is_shown_as_text(open_tab):
    tab = open_tab("#/results/{markup}/evidence")
    assert "<img src=x onerror" in tab.locator(".remarks").inner_text()
    assert tab.locator(".remarks img").count() == 0 and "owned" not in tab.title()


def test_an_unknown_result_says_what_to_do(open_tab):
    tab = open_tab("#/results/999", expect=["404"])
    assert "found no result 999; see the list of results" in tab.get_by_role("alert").first.inner_text()


def test_fault_is_reset_after_a_look_at_the_stand(open_tab, stand):
    with lab(stand.folder):
        stand.fail("the table followed its order late")
        tab = open_tab("#/results")
        tab.get_by_text("the table followed its order late").wait_for()
        tab.get_by_role("button", name="Reset the fault").click()
        dialog = tab.get_by_role("dialog")
        assert "Go to the stand and look" in dialog.inner_text()
        dialog.get_by_role("button", name="Cancel").click()
        assert tab.locator(".strip.bad").is_visible()
        tab.get_by_role("button", name="Reset the fault").click()
        dialog.get_by_role("button", name="Reset the fault").click()
        tab.locator(".strip.bad").wait_for(state="hidden")


def test_login_leads_back_to_the_page_asked_for(open_tab, stand):
    stand.users = (("olga", "operator"),)
    tab = open_tab("#/results", expect=["401"])
    tab.get_by_label("Name").fill("olga")
    tab.get_by_label("Password").fill("wrong")
    tab.keyboard.press("Enter")
    tab.get_by_text("found no user with this name and password").wait_for()
    tab.get_by_label("Password").fill(PASSWORD)
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="Results", level=1).wait_for()
    tab.get_by_role("button", name="Log out").click()
    tab.get_by_label("Password").wait_for()
    assert not tab.locator("body > nav").is_visible()


def test_results_are_filtered_and_paged(open_tab):
    tab = open_tab("#/results")
    expect_soon(tab.locator(".row")).to_have_count(30)
    tab.get_by_role("button", name="Show older ones").click()
    tab.locator(".row").nth(stored_results.CALIBRATIONS + stored_results.INSPECTIONS).wait_for()
    tab.get_by_label("Calibrations").check()
    tab.locator(".row").nth(stored_results.CALIBRATIONS).wait_for(state="detached")
    expect_soon(tab.locator(".row")).to_have_count(stored_results.CALIBRATIONS)
    assert tab.locator(".row .verdict").all_inner_texts().count("not trusted") == 1


def test_older_results_come_where_a_new_one_came_first(open_tab, stand):
    tab, held = open_tab("#/results"), []
    expect_soon(tab.locator(".row")).to_have_count(30)
    tab.route("**/api/results?*before=*", lambda route: route.continue_() if held else held.append(route))
    with tab.expect_request("**/api/results?*before=*"):
        tab.get_by_role("button", name="Show older ones").click()
    record = stored_results.read(stand.made, "inspection")
    Store.open(stand.folder / "results").add("inspection", stored_results.of_part(record, "demo wheel", "A-0077"))
    expect_soon(tab.locator(".row").first).to_contain_text("A-0077")
    held[0].continue_()
    tab.locator(".row").nth(stored_results.CALIBRATIONS + stored_results.INSPECTIONS + 1).wait_for()


def test_result_says_first_what_was_not_measurable(open_tab, stand):
    tab = open_tab("#/results/{nonconforming}")
    assert tab.locator(".stamp .word").inner_text().lower() == "does not conform"
    assert tab.locator(".decisive li").first.inner_text().startswith("Not measurable in this scan")
    rows = tab.locator("table").first.locator("tbody tr")
    assert "not measurable" in rows.first.inner_text()
    texts = " ".join(" ".join(rows.all_inner_texts()).split())
    lines = stored_results.read(stand.made, "inspection")["characteristics"]
    pitch = next(c for c in lines if (c["name"], c["flank"]) == ("f_p", "right"))
    assert f"{pitch['value_um']:.1f} ± {pitch['U_um']:.1f} µm" in texts
    assert f"≤ {pitch['limit_um']:g} µm" in texts and "± 9.5 µm" in texts
    assert tab.get_by_role("link", name="Save report").get_attribute("href").endswith("/report?download=1")
    with tab.expect_download() as download:
        tab.get_by_role("link", name="Characteristics as CSV").click()
    assert download.value.failure() is None


def test_recipe_is_checked_and_saved(open_tab, stand):
    tab = open_tab("#/recipes/gear.toml", expect=["422"])
    area = tab.get_by_label("gear.toml")
    area.fill('kind = "gear"\nteeth 24\n')
    tab.get_by_text("line 2").first.wait_for()
    assert tab.locator(".numbers .bad").inner_text() == "2"
    tab.get_by_role("button", name="Go to line 2").click()
    assert area.evaluate("(e) => e.value.slice(e.selectionStart, e.selectionEnd)") == "teeth 24"
    tab.get_by_role("button", name="Save").click()
    tab.get_by_role("button", name="Go to line 2").wait_for()
    renamed = (stand.folder / "gear.toml").read_text(encoding="utf-8").replace("demo wheel", "another wheel")
    area.fill(renamed)
    tab.keyboard.press("Control+s")
    tab.get_by_role("alert").or_(tab.locator(".notice.good")).get_by_text("Saved.").wait_for()
    tab.reload()
    assert tab.get_by_label("gear.toml").input_value() == renamed


def test_leaving_an_unsaved_recipe_asks_first(open_tab):
    tab = open_tab("#/recipes/gear.toml")
    tab.get_by_label("gear.toml").fill("a = 1\n")
    tab.on("dialog", lambda asked: asked.dismiss())
    with tab.expect_event("dialog"):
        tab.get_by_role("link", name="Home").click()
    tab.evaluate("() => new Promise(requestAnimationFrame)")
    assert tab.get_by_label("gear.toml").input_value() == "a = 1\n"


def test_an_operator_reads_recipes_only(open_tab, stand):
    stand.users = (("olga", "operator"),)
    tab = open_tab("#/recipes/gear.toml", expect=["401"])
    tab.get_by_label("Name").fill("olga")
    tab.get_by_label("Password").fill(PASSWORD)
    tab.keyboard.press("Enter")
    tab.get_by_label("gear.toml").wait_for()
    assert tab.get_by_role("button", name="Save").count() == 0
    assert tab.get_by_label("gear.toml").get_attribute("readonly") is not None


def test_evidence_is_checked_by_an_engineer(open_tab, stand):
    report = stand.store.evidence(stand.store.entry(stand.numbers.nonconforming))["record"]
    report.chmod(0o644)
    report.write_bytes(report.read_bytes() + b" ")
    tab = open_tab("#/results")
    tab.get_by_role("button", name="Check the evidence").click()
    tab.get_by_text("One result is not as it was written").wait_for()


def test_an_engineer_withdraws_a_calibration_and_the_one_before_counts(open_tab, stand):
    untrusted = stand.store.add("calibration", stored_results.read(stand.made, "calibration") | {
        "status": "untrusted", "reasons": ["found dirt"]}).number  # fmt: skip
    tab = open_tab("#/")
    tab.get_by_text("is not used: it is not trusted").wait_for()
    tab.get_by_role("link", name=f"Calibration #{untrusted} is not used").click()
    tab.get_by_role("button", name="Withdraw").click()
    dialog = tab.get_by_role("dialog")
    dialog.get_by_role("button", name="Withdraw").click()
    assert dialog.is_visible(), "it needs a reason"
    dialog.get_by_role("button", name="Cancel").click()
    tab.get_by_role("button", name="Withdraw").click()
    dialog.get_by_label("Why").fill("the shaft was dirty")
    tab.keyboard.press("Enter")
    tab.locator(".stamp .word", has_text="withdrawn").wait_for()
    assert tab.get_by_role("tab").count() == 0
    tab.goto(stand.url + f"#/results/{untrusted}")
    tab.get_by_text("This result was withdrawn by").wait_for()
    assert not tab.get_by_role("button", name="Withdraw").count()
    tab.goto(stand.url + "#/")
    tab.get_by_role("heading", name="Calibrated").wait_for()
    assert not tab.get_by_text("is not used").count()


def test_devices_page_shows_which_device_does_not_answer(open_tab, stand):
    with lab(stand.folder, sensors=("front", "rear")) as virtual:
        virtual.sensors[1].close()
        tab = open_tab("#/devices")
        tab.locator(".device").nth(2).wait_for()
        words = [text.split("\n")[-1] for text in tab.locator(".device .verdict").all_inner_texts()]
        assert words == ["answers", "answers", "no answer"]
        stand.run("long")
        busy = open_tab("#/devices", expect=["409"])
        busy.get_by_text("found a job running").wait_for()


def test_static_files_are_few_and_small():
    bytes_of = sum(p.stat().st_size for p in STATIC.rglob("*") if p.is_file())
    assert bytes_of < 250_000
