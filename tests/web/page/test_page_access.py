"""For everyone: no serious finding of axe-core in light and dark, targets for gloves, words for what colour says."""

from stored_results import SIZES

PATHS = [
    "#/", "#/inspect", "#/inspect/gear", "#/calibrate", "#/job", "#/results", "#/results/{nonconforming}",
    "#/results/{conforming}/cloud", "#/results/{nonconforming}/evidence", "#/results/{calibration}",
    "#/results/{verification}", "#/history", "#/devices", "#/recipes/gear.toml", "#/login",
]  # fmt: skip
SMALLEST = 48
TARGETS = """() => [...document.querySelectorAll("a[href], button, input, select, summary")]
  .filter((e) => e.checkVisibility() && !e.closest(".skip, .plot") && !e.matches(".skip, p a, li > a.plain, .under a"))
  .map((e) => [e.outerHTML.slice(0, 90), e.getBoundingClientRect().height, e.getBoundingClientRect().width])"""


def settle(tab):
    """Wait for what comes later than the page."""
    if "/cloud" in tab.url:
        tab.locator("canvas.cloud[data-drawn]").wait_for()
    if "/devices" in tab.url:
        tab.locator(".device").first.wait_for()
    if "/history" in tab.url:
        tab.locator(".plot .main-svg").first.wait_for(timeout=30_000)
        tab.wait_for_timeout(300)


def looked_at(open_tab, axe, paths):
    """What axe finds serious on pages, and targets too small for gloves; each page is opened once for both."""
    serious, small = {}, {}
    for path in paths:
        tab = open_tab(path, expect=["willReadFrequently"], bypass_csp=True)
        settle(tab)
        tab.evaluate(axe)
        for scheme in ("light", "dark"):
            tab.emulate_media(color_scheme=scheme)
            for violation in tab.evaluate("axe.run(document, {resultTypes: ['violations']})")["violations"]:
                if violation["impact"] in ("serious", "critical"):
                    serious[path, scheme, violation["id"]] = [n["html"][:160] for n in violation["nodes"][:3]]
        for size in ("panel", "tablet"):
            width, height = SIZES[size]
            tab.set_viewport_size({"width": width, "height": height})
            for html, high, wide in tab.evaluate(TARGETS):
                if high < SMALLEST or wide < SMALLEST:
                    small[html] = (path, size, high, wide)
        tab.context.close()
    return serious, small


def test_axe_finds_nothing_serious_and_targets_are_large_enough_for_gloves(open_tab, axe, stand):
    stand.run()
    assert looked_at(open_tab, axe, PATHS) == ({}, {})


def test_a_fault_is_shown_as_accessibly(open_tab, axe, stand):
    stand.fail("a fault")
    assert looked_at(open_tab, axe, ["#/", "#/devices"]) == ({}, {})


def test_marks_differ_in_shape(open_tab):
    tab = open_tab("#/results")
    shapes = {
        kind: tab.locator(f".row .mark.{kind} .shape").first.evaluate("(e) => e.outerHTML")
        for kind in ("good", "bad", "open")
    }
    assert len(set(shapes.values())) == 3


def test_the_first_tab_skips_to_the_content(open_tab):
    tab = open_tab("#/results")
    tab.keyboard.press("Tab")
    assert tab.evaluate("document.activeElement.className") == "skip"
    tab.keyboard.press("Enter")
    assert tab.evaluate("document.activeElement.tagName") == "H1"


def test_tabs_of_a_result_go_by_arrow(open_tab, stand):
    tab = open_tab("#/results/{nonconforming}")
    tab.get_by_role("tab", name="Values").focus()
    tab.keyboard.press("End")
    assert tab.get_by_role("tab", name="Evidence").get_attribute("aria-selected") == "true"
    assert tab.url.endswith(f"/results/{stand.numbers.nonconforming}/evidence")
    tab.get_by_role("heading", name="What it rests on").wait_for()
    tab.keyboard.press("ArrowRight")
    assert tab.get_by_role("tab", name="Values").get_attribute("aria-selected") == "true"


def test_document_has_language_and_title(open_tab):
    tab = open_tab("#/devices")
    assert tab.evaluate("document.documentElement.lang") == "en"
    assert tab.title() == "Devices · Stand 1, hall B · truestand"
