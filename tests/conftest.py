"""For all tests. Before numpy is loaded: one thread for linear algebra, as on the command line."""

import compileall
import ctypes
import gc
import os
import signal
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.dont_write_bytecode = False  # else every worker and every command compiles every module again
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job is started with Ctrl-C ignored

settings.register_profile("repeatable", derandomize=True)
settings.register_profile("searching")
settings.load_profile("repeatable")  # a run that is green once is green again; --hypothesis-profile searching looks on

LONGEST = (
    "gear/test_unseen_damage.py", "gear/test_damage.py", "gear/test_inspect.py",
    "cli/test_inspect.py", "test_docs.py", "web/test_security.py",
    "devices/test_tables.py", "web/test_opcua.py", "gear/", "calibration/", "cli/", "parts/",
)  # fmt: skip
"""Begun first, so that no worker ends alone with one of them."""


def pytest_configure(config):
    """Compile once what every worker imports."""
    if not hasattr(config, "workerinput"):
        compileall.compile_dir(Path(find_spec("truestand").origin).parent, quiet=2)


def pytest_collection_modifyitems(items):
    def rank(item):
        path = item.path.relative_to(Path(__file__).parent).as_posix()
        return next((k for k, name in enumerate(LONGEST) if path.startswith(name)), len(LONGEST))

    items.sort(key=rank)


def pytest_collection_finish():
    """What is imported and collected lives as long as the run: later collections pass it over."""
    gc.collect()
    gc.freeze()


def pytest_xdist_auto_num_workers():
    """One more than there are cores: many tests wait for sockets and tables."""
    return (os.cpu_count() or 1) + 1


@pytest.fixture(autouse=True, scope="module")
def _memory_of_a_module(request):
    """Scans and results that a module cached end with it; servers leave cycles that are not collected in time.

    What was freed goes back to the system: between small blocks that live on, the next module finds no room for scans.
    """
    yield
    own = [f for f in vars(request.module).values() if getattr(f, "__module__", "") == request.module.__name__]
    for cached in (*own, getattr(sys.modules.get("gears"), "scanned", None)):
        getattr(cached, "cache_clear", int)()
    gc.collect()
    if not gc.get_freeze_count():  # an OPC UA server of ours has ended
        gc.freeze()
    if sys.platform == "linux":
        getattr(ctypes.CDLL(None), "malloc_trim", int)(0)
