"""The package as a whole: names that it exports, and the rooms they come from."""

from pathlib import Path

import truestand


def test_no_room_takes_the_place_of_an_exported_name():
    """A subpackage becomes an attribute of the package as soon as it is imported."""
    rooms = {p.name.removesuffix(".py") for p in Path(truestand.__file__).parent.iterdir()}
    assert rooms.isdisjoint(set(truestand.__all__) - {"__version__"})
