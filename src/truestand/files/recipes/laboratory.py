"""laboratory.toml: who calibrated what, for whom and where.

Every key may be left out here; a certificate asks by name for those it needs.
"""

from datetime import date
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, StringConstraints, model_validator

from truestand.files.checking import Recipe, checked
from truestand.files.recipes.recipes import read_toml

Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
Country = Annotated[str, StringConstraints(pattern="^[A-Z]{2}$")]
Place = Literal["laboratory", "customer", "laboratoryBranch", "customerBranch", "other"]


class ContactRecipe(Recipe):
    """Name and address; ``country`` is the code of ISO 3166-1 with two letters."""

    name: Text | None = None
    street: Text | None = None
    street_no: Text | None = None
    post_code: Text | None = None
    city: Text | None = None
    country: Country | None = None
    e_mail: Text | None = None
    phone: Text | None = None


class LaboratoryTable(ContactRecipe):
    """``[laboratory]``."""

    code: Text | None = None
    """As the accreditation body gave it."""


class ResponsibleRecipe(Recipe):
    """``[[responsible]]``."""

    name: Text
    role: Text | None = None
    signs: bool = False


class StandTable(Recipe):
    """``[stand]``: what was calibrated."""

    name: Text | None = None
    serial: Text | None = None
    manufacturer: Text | None = None
    model: Text | None = None


class PerformanceRecipe(Recipe):
    """``[performance]``: where, when and how warm."""

    place: Place | None = None
    begin: date | None = None
    end: date | None = None
    temperature_C: float | None = None
    temperature_U_C: Annotated[float, Field(gt=0)] | None = None

    @model_validator(mode="after")
    def _ordered(self) -> "PerformanceRecipe":
        if self.begin is not None and self.end is not None and self.end < self.begin:
            raise ValueError(f"found begin {self.begin} and end {self.end}, need an end that isn't before the begin")
        if self.temperature_U_C is not None and self.temperature_C is None:
            raise ValueError("found temperature_U_C without temperature_C, need both")
        return self


class LaboratoryRecipe(Recipe):
    """laboratory.toml as a whole."""

    laboratory: LaboratoryTable = LaboratoryTable()
    responsible: list[ResponsibleRecipe] = Field(default_factory=list)
    customer: ContactRecipe = ContactRecipe()
    stand: StandTable = StandTable()
    performance: PerformanceRecipe = PerformanceRecipe()


def read_laboratory(path: Path | str) -> LaboratoryRecipe:
    """The laboratory of a laboratory.toml.

    Raises:
        BadRecipe: unreadable, no TOML, or a wrong or unknown key.
    """
    return checked(LaboratoryRecipe, read_toml(path), str(path))
