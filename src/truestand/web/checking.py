"""What is wrong with a recipe's text, as the worker would find it once it is saved."""

import tempfile
import tomllib
from pathlib import Path

from truestand.core.errors import BadRecipe, TruestandError
from truestand.files.recipes.parts import part_of
from truestand.files.recipes.recipes import read_devices_table, read_shaft, read_stand, read_toml
from truestand.station.recipe import read_devices
from truestand.web.recipes import kind_of


def is_heavy(text: str) -> bool:
    """Whether a model would have to be loaded, which may take seconds and a gigabyte."""
    try:
        return tomllib.loads(text).get("kind") == "cad"
    except (ValueError, RecursionError):
        return False


def problem_of(folder: Path, name: str, text: str) -> str | None:
    """What is wrong, were it saved as ``name`` in the stand's folder; None: nothing."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / name
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        try:
            _read(path, folder / name)
        except TruestandError as wrong:
            return str(wrong).replace(f"{path}: ", "").replace(f"{folder / name}: ", "")
    return None


def _read(path: Path, home: Path) -> None:
    """As the worker will once it is ``home``: what it names stands beside it.

    Raises:
        TruestandError: it can't.
    """
    told = read_toml(path)
    kind = kind_of(told)
    if kind is None:
        raise BadRecipe("found no recipe, need [[sensor]] for a stand, [[cylinder]] for a shaft, or a part's kind")
    if kind == "part":
        part_of(told, home)
    elif kind == "artefact":
        read_shaft(path)
    else:
        read_stand(path)
        if read_devices_table(path):
            read_devices(path)
