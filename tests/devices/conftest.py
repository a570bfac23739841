"""What the tests of devices share."""

import pytest

from tables import KEPT


@pytest.fixture(scope="session", autouse=True)
def _no_server_is_left():
    yield
    while KEPT:
        KEPT.pop().stop()
