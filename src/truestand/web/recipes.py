"""The recipes of the stand's folder, and nothing outside of it: listed, read, checked, written.

A name is one plain file name that ends in .toml; a path, a link or anything else is refused, so there is nothing to
resolve: ``folder/name`` lies in the folder itself.
"""

import re
import stat
import tempfile
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from truestand.core.errors import BadRecipe, TruestandError
from truestand.files.atomic import write_text_atomic
from truestand.files.recipes.parts import KINDS, part_of
from truestand.files.recipes.recipes import read_devices_table, read_shaft, read_stand, read_toml
from truestand.station.recipe import read_devices
from truestand.web.problem import Problem

Kind = Literal["stand", "artefact", "part"]
NAME = re.compile(r"[^\W_][\w .+-]{0,79}\.toml")
MAX_RECIPE_BYTES = 200_000


@dataclass(frozen=True, slots=True)
class RecipeFile:
    """A recipe by what it says of itself."""

    file: str
    kind: Kind
    title: str
    part_kind: Literal["gear", "turned", "cad"] | None = None
    part_name: str = ""
    """In records."""

    @property
    def name(self) -> str:
        """The file's name without its suffix."""
        return self.file.removesuffix(".toml")


@dataclass(frozen=True, slots=True)
class RecipeFolder:
    """Where stand.toml lies."""

    path: Path

    def file(self, name: str) -> Path:
        """The path of a recipe, be it there or not.

        Raises:
            Problem: 404 for anything that could lead elsewhere.
        """
        if not NAME.fullmatch(name) or ".." in name:
            raise Problem(404, "found no such recipe, need a plain file name like gear.toml")
        path = self.path / name
        if _file_type(path) not in (None, stat.S_IFREG):
            raise Problem(404, f"found {name} is no plain file; links and folders aren't followed")
        return path

    def read(self, name: str) -> str:
        """A recipe's text.

        Raises:
            Problem: 404 there is none, 422 it is no text.
        """
        path = self.file(name)
        if not path.exists():
            raise Problem(404, f"found no {name} in the stand's folder, need one; see the list of recipes")
        if path.stat().st_size > MAX_RECIPE_BYTES:
            raise Problem(422, f"found {name} larger than {MAX_RECIPE_BYTES} bytes, need less; edit it elsewhere")
        try:
            return path.read_text(encoding="utf-8-sig")
        except UnicodeDecodeError as wrong:
            raise Problem(422, f"{name}: no UTF-8 text at byte {wrong.start}; save it as UTF-8") from wrong

    def write(self, name: str, text: str) -> None:
        """Replace a recipe, or begin one.

        Raises:
            Problem: 404 for anything that could lead elsewhere.
        """
        write_text_atomic(self.file(name), text)

    def recipes(self) -> list[RecipeFile]:
        """All of them, by file name; files that are no recipes are left out."""
        names = (p.name for p in sorted(self.path.glob("*.toml")) if NAME.fullmatch(p.name) and _is_small(p))
        return [recipe for name in names if (recipe := self._described(name)) is not None]

    def part(self, name: str) -> RecipeFile:
        """The part of that name (without suffix).

        Raises:
            Problem: 404 there is none.
        """
        found = next((r for r in self.recipes() if r.kind == "part" and r.name == name), None)
        if found is None:
            raise Problem(404, f"found no part {name!r}, need one of the list of parts; add its recipe")
        return found

    def problem_of(self, name: str, text: str) -> str | None:
        """What the worker would find wrong with a text, were it saved as ``name``; None: nothing."""
        with tempfile.TemporaryDirectory() as place:
            path, home = Path(place) / name, self.path / name
            path.write_bytes(text.encode("utf-8", "surrogatepass"))
            try:
                _read_as_worker(path, home)
            except TruestandError as wrong:
                return str(wrong).replace(f"{path}: ", "").replace(f"{home}: ", "")
        return None

    def _described(self, name: str) -> RecipeFile | None:
        try:
            recipe = read_toml(self.path / name)
        except BadRecipe:
            return RecipeFile(name, "part", f"{name} (can't be read)") if name != "stand.toml" else None
        kind = kind_of(recipe)
        if kind is None:
            return None
        title = str(recipe.get("name") or name.removesuffix(".toml"))
        if kind != "part":
            return RecipeFile(name, kind, title)
        unnamed = {"gear": "gear", "turned": "turned part", "cad": Path(str(recipe.get("file", ""))).stem}
        return RecipeFile(name, kind, title, recipe["kind"], str(recipe.get("name") or unnamed[recipe["kind"]]))


def kind_of(recipe: Mapping[str, Any]) -> Kind | None:
    """What a recipe describes, by its keys; None: nothing that truestand knows."""
    if recipe.get("kind") in KINDS:
        return "part"
    return "artefact" if "cylinder" in recipe else "stand" if "sensor" in recipe else None


def loads_model(text: str) -> bool:
    """Whether a CAD model would have to be loaded, which may take seconds and a gigabyte."""
    try:
        return tomllib.loads(text).get("kind") == "cad"
    except (ValueError, RecursionError):
        return False


def _read_as_worker(path: Path, home: Path) -> None:
    """As the worker will read it once it is ``home``: the files that it names lie beside that.

    Raises:
        TruestandError: it can't.
    """
    recipe = read_toml(path)
    kind = kind_of(recipe)
    if kind is None:
        raise BadRecipe("found no recipe, need [[sensor]] for a stand, [[cylinder]] for a shaft, or a part's kind")
    if kind == "part":
        part_of(recipe, home)
    elif kind == "artefact":
        read_shaft(path)
    else:
        read_stand(path)
        if read_devices_table(path):
            read_devices(path)


def _file_type(path: Path) -> int | None:
    """Of the file itself, be it a link; None: there is nothing."""
    try:
        return stat.S_IFMT(path.lstat().st_mode)
    except OSError:
        return None


def _is_small(path: Path) -> bool:
    return _file_type(path) == stat.S_IFREG and path.stat().st_size <= MAX_RECIPE_BYTES
