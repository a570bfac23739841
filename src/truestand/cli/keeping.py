"""Results into the store, after their files are written: the record with all that it rests on."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from truestand.cli.terminal import hint

if TYPE_CHECKING:
    from truestand.station.pipeline import Outcome
    from truestand.store import Store


@dataclass(frozen=True)
class Keeping:
    """Where to, and who; without a store nothing is kept."""

    folder: Path | None
    operator: str | None
    quiet: bool

    def keep(self, done: "Outcome[Any]") -> None:
        """Put a result into the store and say under which number."""
        self.add(done.kind, done.record, done.evidence)

    def add(self, kind: str, record: Mapping[str, Any], evidence: Mapping[str, Path]) -> None:
        """The same of a record with the files by role that it rests on."""
        if self.folder is None:
            return
        from truestand.store import Store

        entry = Store.open(self.folder, create=True).add(kind, record, evidence, operator=self.operator)
        hint(f"truestand: kept as entry {entry.number} in {self.folder}", self.quiet)


def keeping(store: Path | None, stand: Path | None, operator: str | None, quiet: bool) -> Keeping:
    """As the options say; without ``--store`` as the stand.toml says. To be asked before the work, not after it.

    Raises:
        BadStore: a store that can't be written to.
    """
    from truestand.files.recipes.recipes import read_store_folder

    folder = store or (None if stand is None else read_store_folder(stand))
    if folder is not None:
        from truestand.store import Store

        Store.open(folder, create=True)
    return Keeping(folder, operator, quiet)


def opened(store: Path | None) -> "Store":
    """The store to look into.

    Raises:
        BadRecipe: none was named.
        BadStore: none is there.
    """
    from truestand.store import Store

    return Store.open(folder_of(store))


def folder_of(store: Path | None) -> Path:
    """``--store``, or what the stand.toml in this folder says.

    Raises:
        BadRecipe: neither.
    """
    from truestand.core.errors import BadRecipe
    from truestand.files.recipes.recipes import read_store_folder

    here = Path("stand.toml")
    folder = store or (read_store_folder(here) if here.is_file() else None)
    if folder is None:
        raise BadRecipe("found no --store and no stand.toml with [store] here; pass --store DIR")
    return folder
