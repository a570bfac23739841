"""Before numpy is loaded: one thread for linear algebra, as on the command line. And a second chance for real time."""

import os
import signal
from pathlib import Path

import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job is started with Ctrl-C ignored

REAL_TIME = ("station", "devices", "web", "sim/test_gige_device.py", "sim/test_virtual_stand.py", "cli/test_stand.py")
"""Tests that hold sockets, browsers and stopping distances against a clock: on a machine that other programs keep busy,
a second of nothing is no fault of theirs. Each gets two more tries; what is wrong is wrong three times."""


def pytest_collection_modifyitems(items):
    here = Path(__file__).parent
    for item in items:
        if item.path.relative_to(here).as_posix().startswith(REAL_TIME):
            item.add_marker(pytest.mark.flaky(reruns=2, reruns_delay=1))
