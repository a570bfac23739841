"""Pages to talk to."""

import pytest

from web_lab import Client, make_page, served


@pytest.fixture
def page(tmp_path):
    """A page without users: everyone on this machine is an engineer."""
    return make_page(tmp_path)


@pytest.fixture
def client(page):
    with served(page) as port:
        client = Client(port)
        client.session()
        yield client


@pytest.fixture
def guarded_page(tmp_path):
    """A page with users."""
    return make_page(tmp_path, (("olga", "operator"), ("erik", "engineer")))


@pytest.fixture
def visitor(guarded_page):
    """One who has not logged in."""
    with served(guarded_page) as port:
        yield Client(port)
