"""What a certificate is made of."""

from dataclasses import dataclass
from datetime import date
from hashlib import sha256
from typing import Any

from truestand.core.calibration import Calibration
from truestand.core.errors import UnreadableFile
from truestand.files.recipes.laboratory import LaboratoryRecipe

Record = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Issue:
    """A record, its meaning and what the laboratory stated."""

    record: Record
    calibration: Calibration
    """What the record means: held against what it says."""
    source: bytes
    """The record's file, which the certificate carries."""
    file_name: str
    laboratory: LaboratoryRecipe | None = None
    number: str | None = None
    """The certificate's; None: one out of date and content."""

    @property
    def stated(self) -> LaboratoryRecipe:
        """What the laboratory stated, be it nothing."""
        return self.laboratory or LaboratoryRecipe()

    @property
    def draft(self) -> bool:
        """Whether no laboratory issues it."""
        return self.laboratory is None

    @property
    def sha256(self) -> str:
        """Of the record's file."""
        return sha256(self.source).hexdigest()

    @property
    def performed(self) -> tuple[date, date]:
        """First and last day: as the laboratory stated them, otherwise the day of the record.

        Raises:
            UnreadableFile: neither is there.
        """
        p, created = self.stated.performance, self.record.get("created")
        if p.begin is not None or p.end is not None:
            begin, end = p.begin or p.end, p.end or p.begin
            assert begin is not None and end is not None
            return begin, end
        try:
            day = date.fromisoformat(str(created)[:10])
        except ValueError:
            raise UnreadableFile(
                f"{self.file_name}: found created {created!r}, need the day of the calibration; calibrate again"
            ) from None
        return day, day

    @property
    def identifier(self) -> str:
        """The certificate's number."""
        own = " ".join((self.number or "").split())
        return own or f"truestand-{self.performed[1]}-{self.sha256[:16]}"
