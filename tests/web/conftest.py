"""Pages to talk to."""

import pytest

from web_lab import Client, make_state, served


@pytest.fixture
def state(tmp_path):
    """A page without users: everyone on this machine is an engineer."""
    return make_state(tmp_path)


@pytest.fixture
def client(state):
    with served(state) as port:
        client = Client(port)
        client.session()
        yield client


@pytest.fixture
def guarded_state(tmp_path):
    """A page with users."""
    return make_state(tmp_path, (("olga", "operator"), ("erik", "engineer")))


@pytest.fixture
def visitor(guarded_state):
    """One who has not logged in."""
    with served(guarded_state) as port:
        yield Client(port)
