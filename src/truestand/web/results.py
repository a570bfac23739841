"""What the page needs of the results store, in its own words."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Protocol

from truestand.web.models import Entry, Quantity


class Results(Protocol):
    """Results, newest first, each with its record and files."""

    def entries(
        self, kinds: Collection[str] = (), parts: Collection[str] = (), limit: int = 50, before: int | None = None
    ) -> list[Entry]:
        """The newest ``limit`` before entry ``before``, of these kinds and parts where any are given."""

    def entry(self, number: int) -> Entry | None:
        """One of them."""

    def calibration(self) -> Entry | None:
        """The calibration that counts: the newest that was not withdrawn, as last corrected."""

    def verification(self) -> Entry | None:
        """The verification that counts for that calibration; None: it was not verified."""

    def record(self, number: int) -> Mapping[str, Any]:
        """Its calibration.json, inspection.json or verification.json."""

    def file(self, number: int, role: str) -> Path | None:
        """Where a file of an entry lies: record, report, cloud; None: it has none."""

    def history(self, kind: str, parts: Collection[str]) -> list[Quantity]:
        """Trends of calibrations, or of the inspections of a part."""
