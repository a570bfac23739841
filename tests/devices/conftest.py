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
    here, so that its warning does not fail the test that is running when Python comes across it."""
    yield
    if "opcua" in request.node.nodeid:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)
            gc.collect()
