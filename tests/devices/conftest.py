"""What the tests of devices share."""

import gc
import warnings

import pytest

from tables import KEPT


@pytest.fixture(scope="module", autouse=True)
def _no_server_is_left():
    yield
    while KEPT:
        KEPT.pop().stop()


@pytest.fixture(autouse=True)
def collected(request):
    """asyncua loses a transport whose connection is cancelled just as it is made (asyncio before 3.12): it is collected
    here and not before, so that its warning fails no test, neither this one nor another."""
    if "opcua" not in request.node.nodeid:
        yield
        return
    gc.disable()
    yield
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()
    gc.enable()
