"""``[simulation]`` of a part's recipe: what the real part has beyond its drawing. um, mm, degrees outside."""

from collections.abc import Mapping
from math import radians
from typing import Annotated, Any, Literal

from pydantic import Field

from truestand.files.checking import Recipe, checked
from truestand.gear.drawing import Gear
from truestand.parts.drawings import Cad, Turned
from truestand.sim.gear_errors import Chip, Dent, FlankErrors, GearErrors, Worn
from truestand.sim.parts import VirtualCad, VirtualGear, VirtualPart, VirtualTurned, check_gear
from truestand.sim.recipe import ShapeRecipe, workpiece_of

Tooth = Annotated[int, Field(ge=1)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
UM = 1000.0


class DentRecipe(Recipe):
    """``[[simulation.dent]]``: a smooth bowl on one flank."""

    tooth: Tooth
    flank: Literal["left", "right"]
    roll_length_mm: Positive
    height_mm: float
    radius_mm: Positive
    depth_um: float
    """Positive into the material."""


class WornRecipe(Recipe):
    """``[[simulation.worn]]``: a groove or a worn band on one flank, or on that flank of every tooth."""

    tooth: Tooth | None = None
    flank: Literal["left", "right"]
    from_roll_length_mm: NotNegative
    to_roll_length_mm: Positive
    from_mm: float
    to_mm: float
    depth_um: float
    """Positive into the material."""
    edge_mm: Positive = 0.1


class ChipRecipe(Recipe):
    """``[[simulation.chip]]``: a tip broken off."""

    tooth: Tooth
    from_mm: float
    to_mm: float
    depth_mm: Positive


class GearErrorsRecipe(Recipe):
    """``[simulation]`` of gear.toml."""

    phase_deg: float = 3.0
    seed: Annotated[int, Field(ge=0)] = 0
    pitch_um: NotNegative = 0.0
    pitch_left_um: tuple[float, ...] = ()
    pitch_right_um: tuple[float, ...] = ()
    eccentricity_um: NotNegative = 0.0
    eccentricity_direction_deg: float = 0.0
    thickness_um: float = 0.0
    profile_slope_um: float = 0.0
    profile_slope_left_um: float | None = None
    profile_slope_right_um: float | None = None
    profile_wave_um: float = 0.0
    profile_waves: Positive = 1.0
    profile_crowning_um: float = 0.0
    helix_slope_um: float = 0.0
    helix_slope_left_um: float | None = None
    helix_slope_right_um: float | None = None
    helix_crowning_um: float = 0.0
    dent: tuple[DentRecipe, ...] = ()
    worn: tuple[WornRecipe, ...] = ()
    chip: tuple[ChipRecipe, ...] = ()
    missing: tuple[Tooth, ...] = ()


class CadPlaceRecipe(Recipe):
    """``[simulation]`` of a part with a CAD model."""

    turned_deg: float = 0.0
    lifted_mm: float = 0.0


def virtual_part_from(
    part: Gear | Turned | Cad, table: Mapping[str, Any], where: str = "[simulation] of the part"
) -> VirtualPart:
    """The part as it really is: its drawing and its recipe's ``[simulation]`` table, which errors call ``where``.

    Raises:
        BadRecipe: a wrong or unknown key, or a tooth that the gear hasn't got.
    """
    if isinstance(part, Gear):
        gear = VirtualGear(part, _gear_errors(checked(GearErrorsRecipe, table, where)))
        check_gear(gear)
        return gear
    if isinstance(part, Turned):
        return VirtualTurned(part, workpiece_of(checked(ShapeRecipe, table, where)))
    place = checked(CadPlaceRecipe, table, where)
    return VirtualCad(part, radians(place.turned_deg), place.lifted_mm)


def _gear_errors(r: GearErrorsRecipe) -> GearErrors:
    return GearErrors(
        phase=radians(r.phase_deg),
        seed=r.seed,
        pitch=r.pitch_um / UM,
        pitch_left=tuple(p / UM for p in r.pitch_left_um),
        pitch_right=tuple(p / UM for p in r.pitch_right_um),
        eccentricity=r.eccentricity_um / UM,
        eccentricity_direction=radians(r.eccentricity_direction_deg),
        thickness=r.thickness_um / UM,
        left=_flank(r, r.profile_slope_left_um, r.helix_slope_left_um),
        right=_flank(r, r.profile_slope_right_um, r.helix_slope_right_um),
        profile_wave=r.profile_wave_um / UM,
        profile_waves=r.profile_waves,
        profile_crowning=r.profile_crowning_um / UM,
        helix_crowning=r.helix_crowning_um / UM,
        dents=tuple(
            Dent(d.tooth, d.flank, d.roll_length_mm, d.height_mm, d.radius_mm, d.depth_um / UM) for d in r.dent
        ),
        worn=tuple(
            Worn(
                w.tooth,
                w.flank,
                (w.from_roll_length_mm, w.to_roll_length_mm),
                (w.from_mm, w.to_mm),
                w.depth_um / UM,
                w.edge_mm,
            )
            for w in r.worn
        ),
        chips=tuple(Chip(c.tooth, c.from_mm, c.to_mm, c.depth_mm) for c in r.chip),
        missing=r.missing,
    )


def _flank(r: GearErrorsRecipe, profile: float | None, helix: float | None) -> FlankErrors:
    """What holds for one flank, else for both."""
    return FlankErrors(
        (r.profile_slope_um if profile is None else profile) / UM, (r.helix_slope_um if helix is None else helix) / UM
    )
