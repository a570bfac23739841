"""A browser on a stand's page, served by the real application. Whatever the browser complains of fails the test."""

import shutil
import subprocess
from contextlib import ExitStack
from pathlib import Path

import pytest

import stored_results
from stored_results import SIZES, StoredStand

CHROMIUM = Path("/usr/bin/chromium")
PATIENCE_MS = 30_000
"""For whatever the page must show in the end: machines are shared."""
FLAGS = [
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-background-networking", "--disable-accelerated-2d-canvas", "--disable-gpu-rasterization",
]  # fmt: skip
NAME = "Stand 1, hall B"


def pytest_collection_modifyitems(items):
    for item in items:
        if "chromium" in item.fixturenames and item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.browser)


@pytest.fixture(scope="module")
def chromium():
    """Ended with each file: as long as it lives it keeps an event loop running, in which others can't start theirs."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is missing: apt-get install chromium")
    api.expect.set_options(timeout=PATIENCE_MS)
    with api.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=str(CHROMIUM), args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def tab(chromium):
    """A tab of a server that a test starts itself."""
    context = chromium.new_context(viewport={"width": 1280, "height": 800})
    yield context.new_page()
    context.close()


@pytest.fixture(scope="session")
def measured(tmp_path_factory):
    """What the commands made of virtual scans."""
    folder = tmp_path_factory.mktemp("measured")
    stored_results.measure(folder)
    return folder


@pytest.fixture(scope="session")
def filled(tmp_path_factory, measured):
    """A stand's folder with results, which tests copy, and the results' numbers."""
    folder = tmp_path_factory.mktemp("filled")
    return folder, stored_results.fill(folder, measured)


@pytest.fixture
def stand(tmp_path, measured, filled):
    """A stand with results of its own."""
    template, numbers = filled
    with ExitStack() as stack:
        yield StoredStand(shutil.copytree(template, tmp_path / NAME), measured, numbers, stack)


@pytest.fixture
def open_tab(chromium, stand):
    """Open tabs; what their consoles say is collected and must be nothing."""
    contexts, heard = [], []

    def open_one(path="#/", expect=(), **context):
        width, height = SIZES["panel"]
        contexts.append(chromium.new_context(viewport={"width": width, "height": height}, **context))
        tab = contexts[-1].new_page()
        tab.on("console", lambda m: m.type in ("error", "warning") and heard.append((m.text, tuple(expect))))
        tab.on("pageerror", lambda wrong: heard.append((str(wrong), tuple(expect))))
        tab.goto(stand.url + path.format(**vars(stand.numbers)))
        tab.locator("main .page").wait_for()
        return tab

    yield open_one
    for context in contexts:
        context.close()
    assert [text for text, expected in heard if not any(e in text for e in expected)] == []


@pytest.fixture(scope="session")
def axe(tmp_path_factory):
    """The source of axe-core, a tool of the tests only."""
    npm, tar = shutil.which("npm"), shutil.which("tar")
    if npm is None or tar is None:
        pytest.skip("npm is missing, it fetches axe-core: apt-get install npm")
    folder = tmp_path_factory.mktemp("axe")
    try:
        subprocess.run([npm, "pack", "axe-core@4"], cwd=folder, check=True, capture_output=True, timeout=90)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as wrong:
        pytest.skip(f"npm did not fetch axe-core: {wrong}")
    subprocess.run([tar, "xzf", next(folder.glob("axe-core-*.tgz")), "package/axe.min.js"], cwd=folder, check=True)
    return (folder / "package" / "axe.min.js").read_text(encoding="utf-8")
