"""Cloud and charts: there to be seen, soon enough, under the page's policy."""

import re
from io import BytesIO

import matplotlib.image
import numpy as np
import pytest

import stored_results

expect = pytest.importorskip("playwright.sync_api", reason="playwright is not installed").expect

FIRST_CHART = 30_000


def pixels(locator):
    """RGB of a screenshot, 0..255."""
    return (255 * matplotlib.image.imread(BytesIO(locator.screenshot()))[..., :3]).astype(int)


def drawn(tab):
    """Share of the cloud's canvas that isn't ground."""
    away = np.abs(pixels(tab.locator("canvas.cloud")) - [16, 22, 29]).sum(axis=2)
    return float((away > 40).mean())


@pytest.fixture
def cloud_tab(open_tab, stand):
    stand.client.get(f"/api/results/{stand.numbers.conforming}/cloud?points=200000", timeout=60.0)  # thinned out once
    tab = open_tab("#/results/{conforming}", expect=["GPU stall"])
    tab.get_by_role("tab", name="Cloud").click()
    tab.locator("canvas.cloud[data-drawn]").wait_for()
    return tab


@pytest.mark.stand
def test_cloud_of_200_000_points_within_two_seconds(cloud_tab):
    marks = cloud_tab.evaluate("performance.getEntriesByType('mark').map((m) => [m.name, m.startTime])")
    times = dict(marks)
    assert times["truestand:cloud:drawn"] - times["truestand:cloud:begin"] < 2000
    assert re.search("(200\u2009000|19[0-9]\u2009[0-9]{3}) points", cloud_tab.locator("figcaption").inner_text())
    assert 0.05 < drawn(cloud_tab) < 0.9
    picture = pixels(cloud_tab.locator("canvas.cloud")).reshape(-1, 3)
    assert (picture[:, 0] - picture[:, 2] > 60).sum() > 300, "orange: too much material"
    assert (picture[:, 2] - picture[:, 0] > 60).sum() > 300, "blue: too little"


def test_cloud_turns_by_key_and_mouse_and_resets(cloud_tab):
    canvas = cloud_tab.locator("canvas.cloud")
    canvas.focus()
    cloud_tab.keyboard.press("0")
    cloud_tab.wait_for_timeout(400)
    first = pixels(canvas)
    for key in ("ArrowLeft", "ArrowUp", "+", "Shift+ArrowRight"):
        cloud_tab.keyboard.press(key)
    cloud_tab.wait_for_timeout(400)
    turned = pixels(canvas)
    assert (np.abs(turned - first).sum(axis=2) > 60).mean() > 0.05
    cloud_tab.keyboard.press("0")
    cloud_tab.wait_for_timeout(400)
    assert (np.abs(pixels(canvas) - first).sum(axis=2) > 60).mean() < 0.01
    box = canvas.bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    cloud_tab.mouse.move(*middle)
    cloud_tab.mouse.down()
    cloud_tab.mouse.move(middle[0] + 150, middle[1] - 60, steps=4)
    cloud_tab.mouse.up()
    cloud_tab.wait_for_timeout(400)
    assert (np.abs(pixels(canvas) - first).sum(axis=2) > 60).mean() > 0.05
    cloud_tab.get_by_role("button", name="Reset the view").click()
    cloud_tab.get_by_role("button", name="Closer").click()
    cloud_tab.wait_for_timeout(400)
    assert drawn(cloud_tab) > 0.05


def test_cloud_shows_a_clicked_point_and_changes_its_scale(cloud_tab):
    box = cloud_tab.locator("canvas.cloud").bounding_box()
    info = cloud_tab.locator(".readout")
    for down in np.linspace(0.55, 0.8, 12):
        cloud_tab.mouse.click(box["x"] + box["width"] / 2, box["y"] + down * box["height"])
        if "µm" in info.inner_text():
            break
    assert "µm" in info.inner_text() and " mm" in info.inner_text()
    assert cloud_tab.locator(".scale li").first.inner_text() == "+50"
    cloud_tab.get_by_role("button", name="Wider colour scale").click()
    assert cloud_tab.locator(".scale li").all_inner_texts() == ["+100", "+50", "0", "−50", "−100"]


@pytest.mark.parametrize(
    ("kind", "charts"), [("conforming", 3), ("nonconforming", 3), ("calibration", 3), ("verification", 1)]
)
def test_charts_draw_under_the_policy(open_tab, kind, charts):
    tab = open_tab(f"#/results/{{{kind}}}/charts", expect=["willReadFrequently"])
    tab.locator(".plot .main-svg").first.wait_for(timeout=FIRST_CHART)
    expect(tab.locator(".plot .plot-container")).to_have_count(charts, timeout=FIRST_CHART)
    svg = tab.locator(".plot .main-svg").first
    assert svg.bounding_box()["width"] > 600
    assert tab.locator(".plot .points path").count() > 0 or tab.locator(".plot .point").count() > 0


def test_history_shows_limits_and_findings(open_tab):
    tab = open_tab("#/history", expect=["willReadFrequently"])
    tab.locator(".plot .main-svg").first.wait_for(timeout=FIRST_CHART)
    assert "beyond" in tab.locator(".trend").inner_text()
    expect(tab.locator(".plot .shapelayer path")).to_have_count(3)
    assert tab.locator(".plot .errorbar").count() >= stored_results.CALIBRATIONS - 1
    tab.get_by_label("Trend of").select_option("gear")
    tab.get_by_role("heading", name="f_p left").wait_for()
    tab.get_by_role("link", name="F_beta right").click()
    tab.get_by_role("heading", name="F_beta right").wait_for()
    tab.locator(".plot .main-svg").first.wait_for(timeout=FIRST_CHART)
    expect(tab.locator(".plot .shapelayer path")).to_have_count(4)


def test_charts_without_plotly_say_what_to_install(chromium, stand):
    context = chromium.new_context()
    tab = context.new_page()
    tab.route("**/vendor/plotly.min.js", lambda route: route.fulfill(status=404))
    tab.goto(stand.url + f"#/results/{stand.numbers.conforming}/charts")
    tab.get_by_text("install the plotly package").wait_for()
    context.close()
