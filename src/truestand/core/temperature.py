"""The temperature of a part while it was scanned: sizes hold at 20 degrees Celsius (ISO 1)."""

from dataclasses import dataclass
from math import hypot

from truestand.core.assumptions import ASSUMED, EXPANSION, TEMPERATURE_U
from truestand.core.errors import BadRecipe

REFERENCE = 20.0
"""Degrees Celsius (ISO 1)."""
EXPANSION_SHARE_U = 0.1
"""Share of a coefficient of expansion, as handbooks have it, that is its U (k = 2)."""


@dataclass(frozen=True, slots=True)
class Temperature:
    """As measured; None: nobody measured, it is taken for 20 degrees and ``TEMPERATURE_U`` of them."""

    celsius: float | None = None
    U: float | None = None
    """K, k = 2."""
    expansion: float = EXPANSION
    """1/K, of the part's material."""

    def __post_init__(self) -> None:
        if self.U is not None and self.celsius is None:
            raise BadRecipe(f"found part_temperature_U_C {self.U:g} and no part_temperature_C; add what was measured")

    @property
    def growth(self) -> float:
        """By how much, relative, the part was larger than at 20 degrees."""
        return 0.0 if self.celsius is None else self.expansion * (self.celsius - REFERENCE)

    @property
    def expanded(self) -> float:
        """U (k = 2) of the temperature, K: as stated or as assumed."""
        return TEMPERATURE_U if self.U is None else self.U

    @property
    def expanded_growth(self) -> float:
        """U (k = 2) of the part's lengths, relative."""
        return hypot(self.expansion * self.expanded, EXPANSION_SHARE_U * self.growth)

    @property
    def line(self) -> str:
        """Name of the budget's line."""
        return "temperature of the part" + (ASSUMED if self.U is None else "")


UNSTATED = Temperature()
