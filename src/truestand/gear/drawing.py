"""The gear as its drawing describes it: numbers only. What follows from them is in ``geometry``."""

from dataclasses import dataclass, field
from math import cos, pi, radians
from typing import Literal

from truestand.core.errors import BadRecipe
from truestand.core.temperature import UNSTATED, Temperature

Datum = Literal["base", "seat", "common"]
Standard = Literal["ISO 1328-1:2013", "ISO 1328-1:1995"]
Ends = Literal["full", "evaluation"]
LEAST_FACE_WIDTH = 0.6
"""mm: 0.2 mm at either end are left out, where chamfers are."""


@dataclass(frozen=True, slots=True)
class Evaluation:
    """How the flanks are evaluated; None: a default that the report prints. Lengths mm."""

    control_diameter: float | None = None
    """Where the profile's control length starts (d_Cf)."""
    tip_form_diameter: float | None = None
    """Where it ends."""
    measuring_diameter: float | None = None
    """The circle on which pitch and tooth thickness are given (d_M)."""
    ball_diameter: float | None = None
    span_teeth: int | None = None
    pitch_span: int | None = None
    """k of F_pk; an eighth of the teeth by default."""
    slope_ends: Ends | None = None
    """Where a slope deviation is read off the mean line: at the ends of the control length (``full``, as the 2013
    edition) or of the evaluation range (as 1995)."""
    resolution: float = 0.25
    """Lateral resolution along the roll length: the width of a cell."""
    narrowest_damage: float | None = None
    """Of damage, along the roll length, that must not escape: between profiles farther apart nothing was seen."""


@dataclass(frozen=True, slots=True)
class Modification:
    """Intended departures from the involute helicoid, mm; they are no deviations. Reliefs and crownings: material left
    away.
    """

    tip_relief: float = 0.0
    tip_relief_from: float | None = None
    """Diameter from which it grows, linearly over the roll length."""
    profile_crowning: float = 0.0
    """At both ends of the control length, growing with the square from its middle."""
    helix_crowning: float = 0.0
    """At both ends of the face."""
    helix_slope: float = 0.0
    """By which the upper end of the face stands out against the lower one, on both flanks, about the middle: with the
    sign of f_Hbeta.
    """

    def __post_init__(self) -> None:
        if self.tip_relief and self.tip_relief_from is None:
            raise BadRecipe(
                f"found tip_relief_um {1000 * self.tip_relief:g} and no tip_relief_from_mm; add the diameter from "
                "which the relief grows"
            )


@dataclass(frozen=True, slots=True)
class Gear:
    """An external involute gear, spur or helical. mm and rad."""

    teeth: int
    module: float
    """Normal module."""
    face_width: float
    face_from: float
    """Lower end of the face: height in C."""
    tip_diameter: float
    root_diameter: float
    pressure_angle: float = radians(20.0)
    """Normal pressure angle."""
    helix_angle: float = 0.0
    """At the reference circle; + right hand, - left hand."""
    profile_shift: float = 0.0
    accuracy_class: int | None = None
    standard: Standard = "ISO 1328-1:2013"
    datum: Datum = "base"
    bore_clearance: float = 0.0
    """Diametral play between bore and seat."""
    name: str = "gear"
    evaluation: Evaluation = field(default_factory=Evaluation)
    modification: Modification = field(default_factory=Modification)
    limits: dict[str, tuple[float | None, float | None]] = field(default_factory=dict, hash=False)
    """Lower and upper limit by the characteristic's name, mm; before those of a class."""
    classes: dict[str, int] = field(default_factory=dict, hash=False)
    """Accuracy class by the characteristic's name, where it is another than ``accuracy_class``."""
    defect_depth: float | None = None
    """Limit for defects; None: they don't decide."""
    temperature: Temperature = UNSTATED
    damage_decides: bool = True
    """Whether missing, broken and chipped teeth decide; else they are only listed."""
    missing_teeth: tuple[int, ...] = ()
    """Numbers of teeth that the drawing leaves out (sector gears); counted from any of them, ccw."""

    def __post_init__(self) -> None:
        reference = self.teeth * self.module / cos(self.helix_angle)
        base = reference * cos(self.pressure_angle)
        if not self.tip_diameter > self.root_diameter:
            raise BadRecipe(
                f"found tip_diameter_mm {self.tip_diameter:g} and root_diameter_mm {self.root_diameter:g}; "
                "need a tip above the root"
            )
        if self.face_width < LEAST_FACE_WIDTH:
            raise BadRecipe(f"found face_width_mm {self.face_width:g}, need {LEAST_FACE_WIDTH:g} at least")
        if any(not 1 <= n <= self.teeth for n in self.missing_teeth):
            raise BadRecipe(f"found missing_teeth {list(self.missing_teeth)}, need numbers from 1 to {self.teeth}")
        if len(set(self.missing_teeth)) == self.teeth:
            raise BadRecipe("found every tooth in missing_teeth, need one that is there")
        if not base * 0.98 < self.tip_diameter < 2 * reference:
            raise BadRecipe(
                f"found tip_diameter_mm {self.tip_diameter:g} with {self.teeth} teeth of module {self.module:g} "
                f"(reference diameter {reference:.3f} mm); check teeth, module_mm, helix_angle_deg and tip_diameter_mm"
            )

    def class_of(self, name: str) -> int | None:
        """The accuracy class of a characteristic; None: it has none."""
        return self.classes.get(name, self.accuracy_class)

    @property
    def face_to(self) -> float:
        """Upper end of the face, height in C."""
        return self.face_from + self.face_width

    @property
    def pitch(self) -> float:
        """Angle from tooth to tooth, rad."""
        return 2 * pi / self.teeth
