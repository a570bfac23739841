"""An operator's work in a real browser, on the virtual stand behind its real protocols: nothing is a mock."""

import json
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lab import lab
from patience import NOT_FOR_EVER
from truestand.store import Store
from truestand.web.authentication import make_user, users_path, write_users

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
         "--disable-background-networking", "--disable-gpu-rasterization", "--disable-gpu-compositing"]  # fmt: skip
READ_BACK = "GPU stall due to ReadPixels"
"""Drawn without a graphics card, every frame of the cloud is read back; the browser remarks it."""
JOB = 180_000
"""ms that a job may take on a busy machine."""


@pytest.fixture
def stand(tmp_path):
    with lab(tmp_path, pace=4.0, points=320, rate=100.0, turns=1.1, part="gear.toml") as found:
        gear = (tmp_path / "gear.toml").read_text()
        (tmp_path / "gear.toml").write_text(gear.replace("accuracy_class = 7", "accuracy_class = 4"))
        good = gear.partition("[simulation]")[0]
        good = good.replace('name = "demo wheel"', 'name = "good wheel"').replace(
            "accuracy_class = 7", "accuracy_class = 11"
        )
        (tmp_path / "good.toml").write_text(good)
        yield found


@pytest.fixture
def page(stand):
    """The operator page of the stand, with one operator."""
    store = stand.folder / "results"
    store.mkdir()
    write_users(users_path(store), {"kim": make_user("kim", "operator", "a long password")})
    command = [sys.executable, "-W", "error", "-m", "truestand", "serve", "--stand", str(stand.recipe), "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    line = process.stdout.readline()
    yield re.search(r"http://\S+", line)[0]
    process.terminate()
    _, said = process.communicate(timeout=30)
    assert process.returncode == 0, said


@pytest.fixture
def tab():
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is missing: apt-get install chromium")
    heard = []
    with api.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=str(CHROMIUM), args=FLAGS)
        look = {"viewport": {"width": 1280, "height": 800}, "reduced_motion": "reduce"}
        tab = browser.new_context(accept_downloads=True, **look).new_page()
        tab.set_default_timeout(JOB)
        tab.on("console", lambda m: m.type in ("error", "warning") and READ_BACK not in m.text and heard.append(m.text))
        tab.on("pageerror", lambda wrong: heard.append(str(wrong)))
        yield tab
        browser.close()
    assert heard == []


@pytest.mark.browser
def test_an_operator_calibrates_inspects_and_sees_results_in_the_browser(stand, page, tab, tmp_path):
    log_in(tab, page)
    calibrate(tab)
    verdict = inspect(tab, stand, "gear.toml", "demo wheel", "A-1")
    assert verdict == ("undecided" if loosely_tied(stand) else "does not conform"), reasons(stand)
    see_the_cloud(tab, tmp_path)
    download_the_report(tab, tmp_path)
    look_at_the_trend(tab)
    audit = [sys.executable, "-m", "truestand", "audit", "--store", str(stand.folder / "results"), "--json"]
    sound = subprocess.run(audit, capture_output=True, text=True, check=False)
    assert sound.returncode == 0 and json.loads(sound.stdout)


@pytest.mark.browser
def test_a_good_wheel_is_not_said_to_be_bad(stand, page, tab):
    log_in(tab, page)
    calibrate(tab)
    assert inspect(tab, stand, "good.toml", "good wheel", "A-2") != "does not conform", reasons(stand)


def log_in(tab, page) -> None:
    tab.goto(page)
    tab.get_by_label("Name").fill("kim")
    tab.get_by_label("Password").fill("a long password")
    began = time.monotonic()
    tab.get_by_role("button", name="Log in").click()
    tab.get_by_text("Not calibrated").wait_for()
    assert time.monotonic() - began < NOT_FOR_EVER


def calibrate(tab) -> None:
    tab.get_by_role("link", name="Calibrate").last.click()
    tab.get_by_role("button", name="Start").click()
    tab.get_by_role("button", name="Stop").wait_for()
    tab.get_by_text("valid", exact=True).or_(tab.get_by_text("Calibrated", exact=True)).first.wait_for(timeout=JOB)


def inspect(tab, stand, recipe, name, serial) -> str:
    stand.put(recipe)
    tab.get_by_role("link", name="Inspect", exact=True).click()
    tab.get_by_role("link", name=name).click()
    tab.get_by_label("Serial number").fill(serial)
    tab.get_by_role("button", name="Next").click()
    tab.get_by_role("button", name="Start").click()
    words = ("conforms", "does not conform", "undecided")
    verdict = tab.locator(".stamp .word").filter(has_text=re.compile("|".join(words), re.IGNORECASE))
    verdict.wait_for(timeout=JOB)
    return verdict.inner_text().lower()


def reasons(stand) -> list[str]:
    """Why the last result is what it is."""
    store = Store.open(stand.folder / "results")
    record = store.record(store.entries()[-1])
    return [message["text"] for message in (*record["reasons"], *record["remarks"])]


def loosely_tied(stand) -> bool:
    """Whether the two scans' angles are a millisecond or more apart: a busy machine ties the clocks of table and sensor
    worse than the shaft in view allows, and the product says so.
    """
    return any("against the table's zero" in reason for reason in reasons(stand))


def see_the_cloud(tab, folder) -> None:
    tab.get_by_role("link", name="Results").click()
    tab.get_by_role("link", name="demo wheel").first.click()
    began = time.monotonic()
    tab.get_by_role("tab", name="Cloud").click()
    tab.locator("canvas").first.wait_for()
    tab.get_by_text(re.compile(r"\d points\.")).wait_for()
    assert time.monotonic() - began < NOT_FOR_EVER
    tab.screenshot(path=folder / "cloud.png")
    colours = tab.locator("canvas").first.screenshot()
    assert len(colours) > 20_000, "the cloud is not to be seen"


def download_the_report(tab, folder) -> None:
    with tab.expect_download() as coming:
        tab.get_by_role("link", name="Save report").click()
    coming.value.save_as(folder / "report.html")
    assert "does not conform" in (folder / "report.html").read_text(encoding="utf-8").lower()


def look_at_the_trend(tab) -> None:
    tab.get_by_role("link", name="History").click()
    tab.get_by_text("Eccentricity").first.wait_for()
