"""Turned parts and parts with a CAD model, as their recipes describe them: numbers only."""

from dataclasses import dataclass, field
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array
from truestand.core.errors import BadRecipe
from truestand.core.temperature import UNSTATED, Temperature

Datum = Literal["base", "seat", "common"]
FitTo = Literal["none", "angle", "angle_and_height", "all"]


@dataclass(frozen=True, slots=True)
class Section:
    """A stretch of a turned part, round about the datum axis; heights in C, lengths mm."""

    name: str
    bottom: float
    top: float
    diameter: float
    diameter_limits: tuple[float, float] | None = None
    roundness_limit: float | None = None
    cylindricity_limit: float | None = None
    runout_limit: float | None = None
    """Circular radial run-out about the datum axis."""
    total_runout_limit: float | None = None

    def __post_init__(self) -> None:
        if not self.top > self.bottom or not self.diameter > 0:
            raise BadRecipe(
                f"section {self.name!r}: found diameter {self.diameter:g} mm from {self.bottom:g} to {self.top:g} mm; "
                "need a positive diameter and to_mm above from_mm"
            )


@dataclass(frozen=True, slots=True)
class Turned:
    """A turned part: sections along the axis, from below."""

    sections: tuple[Section, ...]
    name: str = "turned part"
    datum: Datum = "base"
    bore_clearance: float = 0.0
    upr: int = 50
    """Cut-off of the Gaussian filter of roundness and run-out, undulations per revolution."""
    temperature: Temperature = UNSTATED

    def __post_init__(self) -> None:
        if not self.sections:
            raise BadRecipe("found no section, need at least one; add a [[section]] with from_mm, to_mm, diameter_mm")
        for first, second in combinations(self.sections, 2):
            low, high = max(first.bottom, second.bottom), min(first.top, second.top)
            if low < high and first.diameter != second.diameter:
                raise BadRecipe(
                    f"sections {first.name!r} and {second.name!r}: found both from {low:g} to {high:g} mm, with "
                    f"diameters of {first.diameter:g} and {second.diameter:g} mm; need one diameter at a height"
                )


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles: ``vertices`` (V, 3) mm, ``faces`` (F, 3) counter-clockwise seen from outside."""

    vertices: Array
    faces: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Cad:
    """A part that is compared with its CAD model."""

    mesh: Mesh
    name: str = "part"
    pose: Array = field(default_factory=lambda: np.eye(4))
    """shaft_from_model (4, 4): where the model stands in C."""
    fit: FitTo = "angle"
    """What the model may be moved by before the comparison: about the axis, along it, or freely."""
    limits: tuple[float, float] | None = None
    """Lower and upper limit of the normal deviation, mm."""
    reach: float = 1.0
    """Readings farther than this from the model (mm) are counted as no part of it."""
    datum: Datum = "base"
    bore_clearance: float = 0.0
    temperature: Temperature = UNSTATED
