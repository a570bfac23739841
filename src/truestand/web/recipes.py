"""The recipes of the stand's folder, and nothing outside of it.

A name is one plain file name that ends in .toml; a path, a link or anything else is refused, so there is nothing to
resolve: ``folder/name`` lies in the folder itself.
"""

import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from truestand.core.errors import BadRecipe
from truestand.files.atomic import write_text_atomic
from truestand.files.recipes.parts import KINDS
from truestand.files.recipes.recipes import read_toml
from truestand.web.problem import Problem

Kind = Literal["stand", "artefact", "part"]
NAME = re.compile(r"[^\W_][\w .+-]{0,79}\.toml")
LARGEST = 200_000
"""Bytes of a recipe that is read."""


@dataclass(frozen=True, slots=True)
class Listed:
    """A recipe by what it says of itself."""

    file: str
    kind: Kind
    title: str
    part_kind: str = ""
    """gear, turned or cad."""
    called: str = ""
    """The part's name in records."""

    @property
    def name(self) -> str:
        """Without its suffix."""
        return self.file.removesuffix(".toml")


@dataclass(frozen=True, slots=True)
class Folder:
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
        if _mode(path) not in (None, stat.S_IFREG):
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
        if path.stat().st_size > LARGEST:
            raise Problem(422, f"found {name} larger than {LARGEST} bytes, need less; edit it elsewhere")
        try:
            return path.read_text(encoding="utf-8-sig")
        except UnicodeDecodeError as wrong:
            raise Problem(422, f"{name}: no UTF-8 text at byte {wrong.start}; save it as UTF-8") from wrong

    def write(self, name: str, text: str) -> None:
        """Replace a recipe, or begin one."""
        write_text_atomic(self.file(name), text)

    def recipes(self) -> list[Listed]:
        """What there is, by file name; files that are no recipes are left out."""
        names = (p.name for p in sorted(self.path.glob("*.toml")) if NAME.fullmatch(p.name) and _is_small(p))
        return [found for name in names if (found := self._listed(name)) is not None]

    def part(self, name: str) -> Listed:
        """The part of that name (without suffix).

        Raises:
            Problem: 404 there is none.
        """
        found = next((r for r in self.recipes() if r.kind == "part" and r.name == name), None)
        if found is None:
            raise Problem(404, f"found no part {name!r}, need one of the list of parts; add its recipe")
        return found

    def _listed(self, name: str) -> Listed | None:
        try:
            told = read_toml(self.path / name)
        except BadRecipe:
            return Listed(name, "part", f"{name} (can't be read)") if name != "stand.toml" else None
        kind = kind_of(told)
        if kind is None:
            return None
        title = str(told.get("name") or name.removesuffix(".toml"))
        if kind != "part":
            return Listed(name, kind, title)
        unnamed = {"gear": "gear", "turned": "turned part", "cad": Path(str(told.get("file", ""))).stem}
        return Listed(name, kind, title, told["kind"], str(told.get("name") or unnamed[told["kind"]]))


def kind_of(told: Mapping[str, Any]) -> Kind | None:
    """What a recipe describes, by its keys; None: nothing that truestand knows."""
    if told.get("kind") in KINDS:
        return "part"
    return "artefact" if "cylinder" in told else "stand" if "sensor" in told else None


def _mode(path: Path) -> int | None:
    """What kind of file it is itself, be it a link; None: there is nothing."""
    try:
        return stat.S_IFMT(path.lstat().st_mode)
    except OSError:
        return None


def _is_small(path: Path) -> bool:
    return _mode(path) == stat.S_IFREG and path.stat().st_size <= LARGEST
