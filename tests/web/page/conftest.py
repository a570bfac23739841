"""A browser on the page, with the mock server behind it. Whatever the browser complains of fails the test."""

import json
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path
from urllib.error import URLError
from urllib.request import Request, urlopen

import pytest

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = [
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]  # fmt: skip
SIZES = {"panel": (1280, 800), "screen": (1920, 1080), "tablet": (800, 1280)}
PATIENCE = 20.0


def pytest_collection_modifyitems(items):
    for item in items:
        if "chromium" in item.fixturenames and item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.browser)


class Mock:
    """The mock server's address, and what it shall play."""

    def __init__(self, port: int) -> None:
        self.url = f"http://127.0.0.1:{port}/"

    def play(self, **interface_settings):
        """Back to the start, with these differences."""
        self.post("mock", **interface_settings)

    def post(self, path, **body):
        headers = {"Content-Type": "application/json", "X-CSRF-Token": "csrf-of-the-mock"}
        with urlopen(Request(self.url + path, json.dumps(body).encode(), headers, method="POST")) as answer:
            return json.load(answer)

    def run(self, kind="inspect", part="demo-wheel"):
        """Start a job as another client would."""
        return self.post("api/jobs", kind=kind, part=part if kind == "inspect" else None, serial="A-0042")


@pytest.fixture(scope="module")
def chromium():
    """Ended with each file: as long as it lives it keeps an event loop running, in which others can't start theirs."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is missing: apt-get install chromium")
    with api.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=str(CHROMIUM), args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def server():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    script = Path(__file__).with_name("mock_server.py")
    with subprocess.Popen([sys.executable, str(script), "--port", str(port)]) as process:
        mock = Mock(port)
        end = time.monotonic() + PATIENCE
        while True:
            try:
                mock.play()
                break
            except URLError:
                assert process.poll() is None and time.monotonic() < end, "the mock server did not start"
                time.sleep(0.05)
        yield mock
        process.kill()


@pytest.fixture
def mock(server):
    server.play()
    return server


@pytest.fixture
def open_tab(chromium, mock):
    """Open tabs; what their consoles say is collected and must be nothing."""
    contexts, heard = [], []

    def open_one(path="#/", size="panel", expect=(), **context):
        width, height = SIZES[size]
        contexts.append(chromium.new_context(viewport={"width": width, "height": height}, **context))
        tab = contexts[-1].new_page()
        tab.on("console", lambda m: m.type in ("error", "warning") and heard.append((m.text, tuple(expect))))
        tab.on("pageerror", lambda wrong: heard.append((str(wrong), tuple(expect))))
        tab.goto(mock.url + path)
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
