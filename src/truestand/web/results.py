"""What the page needs of the results store, in its own words."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from truestand.web.models import Entry, Quantity


class Results(Protocol):
    """Results, newest first, each with its record and files."""

    def entries(
        self, kinds: Sequence[str] = (), part: str | None = None, limit: int = 50, before: int | None = None
    ) -> list[Entry]:
        """The newest ``limit`` before entry ``before``; without ``kinds`` all of them."""

    def entry(self, number: int) -> Entry | None:
        """One of them."""

    def record(self, number: int) -> Mapping[str, Any]:
        """Its calibration.json, inspection.json or verification.json."""

    def file(self, number: int, role: str) -> Path | None:
        """Where a file of an entry lies: record, report, cloud; None: it has none."""

    def history(self, kind: str, part: str | None) -> list[Quantity]:
        """Trends of calibrations, or of the inspections of a part."""


class NoResults:
    """A stand without a store yet."""

    def entries(
        self, kinds: Sequence[str] = (), part: str | None = None, limit: int = 50, before: int | None = None
    ) -> list[Entry]:
        """None."""
        return []

    def entry(self, number: int) -> Entry | None:
        """None."""
        return None

    def record(self, number: int) -> Mapping[str, Any]:
        """Never asked for."""
        return {}

    def file(self, number: int, role: str) -> Path | None:
        """None."""
        return None

    def history(self, kind: str, part: str | None) -> list[Quantity]:
        """None."""
        return []
