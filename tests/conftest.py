"""Before numpy is loaded: one thread for linear algebra, as on the command line."""

import os
import signal
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job is started with Ctrl-C ignored

LONGEST = (
    "web/test_workflow.py", "gear/test_damage.py", "gear/test_inspect.py", "cli/test_inspect.py", "test_docs.py",
    "web/test_security.py", "devices/test_tables.py", "web/test_opcua.py", "gear/", "calibration/", "cli/", "parts/",
)  # fmt: skip
"""Begun first, so that no worker ends alone with one of them."""


def pytest_collection_modifyitems(items):
    def rank(item):
        path = item.path.relative_to(Path(__file__).parent).as_posix()
        return next((k for k, name in enumerate(LONGEST) if path.startswith(name)), len(LONGEST))

    items.sort(key=rank)


def pytest_xdist_auto_num_workers():
    """One more than there are cores: many tests wait for sockets and tables."""
    return (os.cpu_count() or 1) + 1
