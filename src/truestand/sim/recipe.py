"""``[simulation]`` of stand.toml and of a part's recipe: um, mm, degrees; unknown keys refused with the nearest one."""

from collections.abc import Mapping
from dataclasses import replace
from math import radians
from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from truestand.files.checking import Recipe, checked
from truestand.gear.drawing import Gear
from truestand.parts.drawings import Cad, Turned
from truestand.sim.gear_errors import Chip, Dent, FlankErrors, GearErrors, Scratch, Worn
from truestand.sim.parts import VirtualCad, VirtualGear, VirtualPart, VirtualTurned
from truestand.sim.simulation import (
    Acquisition,
    FormWave,
    Keyway,
    Misalignment,
    Mounting,
    Optics,
    Patch,
    Running,
    Simulation,
    Workpiece,
)

Share = Annotated[float, Field(ge=0, le=1)]
Tooth = Annotated[int, Field(ge=1)]
UM = 1000.0
"""Per mm."""


class FormRecipe(Recipe):
    """``[[simulation.form]]``."""

    surface: str
    upr: Annotated[int, Field(ge=2)]
    amplitude_um: float
    phase_deg: float = 0.0


class KeywayRecipe(Recipe):
    """``[[simulation.keyway]]``."""

    surface: str
    azimuth_deg: float = 0.0
    width_mm: PositiveFloat
    depth_mm: PositiveFloat
    from_mm: float = -1e9
    to_mm: float = 1e9


class FlatRecipe(Recipe):
    """``[[simulation.flat]]``."""

    surface: str
    azimuth_deg: float = 0.0
    share: Annotated[float, Field(gt=0, lt=0.5)]


class DirtRecipe(Recipe):
    """``[[simulation.dirt]]``."""

    surface: str
    azimuth_deg: float = 0.0
    share: Share
    height_um: float
    edge_deg: NonNegativeFloat = 0.0


class MisalignmentRecipe(Recipe):
    """``[[simulation.misalignment]]``."""

    surface: str
    offset_x_um: float = 0.0
    offset_y_um: float = 0.0
    slope_x_mrad: float = 0.0
    slope_y_mrad: float = 0.0


class DiameterRecipe(Recipe):
    """``[[simulation.diameter]]``."""

    surface: str
    error_um: float


class WorkpieceRecipe(Recipe):
    """Deviations of shafts and turned parts from their drawing."""

    form: tuple[FormRecipe, ...] = ()
    keyway: tuple[KeywayRecipe, ...] = ()
    flat: tuple[FlatRecipe, ...] = ()
    dirt: tuple[DirtRecipe, ...] = ()
    misalignment: tuple[MisalignmentRecipe, ...] = ()
    diameter: tuple[DiameterRecipe, ...] = ()


class MountingRecipe(Recipe):
    """Where a sensor stands."""

    phi_deg: float = -41.802
    standoff_mm: PositiveFloat = 95.0
    height_mm: float = -1.0
    laser_plane_tilt_deg: float = 0.0
    laser_plane_offset_mm: float = 0.0
    azimuth_deg: float = 0.0


class ViewRecipe(MountingRecipe):
    """``[[simulation.view]]``: where one of several sensors stands."""

    name: str


class SimulationRecipe(MountingRecipe, WorkpieceRecipe):
    """``[simulation]`` as a whole."""

    view: tuple[ViewRecipe, ...] = ()
    eccentricity_um: NonNegativeFloat = 878.9
    eccentricity_direction_deg: float = 0.0
    tilt_mrad: float = 0.0
    tilt_direction_deg: float = 0.0
    clamped_deg: float = 0.0
    chamfer_mm: NonNegativeFloat = 0.0
    fillet_mm: NonNegativeFloat = 0.0
    table_disc_mm: float | None = None
    fan_deg: PositiveFloat = 16.0
    noise_um: NonNegativeFloat = 4.0
    correlated_noise_um: NonNegativeFloat = 0.0
    correlation_points: Annotated[int, Field(ge=1)] = 8
    speckle_um: NonNegativeFloat = 0.0
    speckle_cell_mm: PositiveFloat = 0.1
    nonlinearity_um: float = 0.0
    nonlinearity_phase_deg: float = 57.3
    scale_error_ppm: float = 0.0
    step_z_um: NonNegativeFloat = 4.0
    step_x_um: NonNegativeFloat = 1.0
    triangulation_deg: float = 0.0
    incidence_noise: bool = False
    incidence_bias_um: float = 0.0
    most_incidence_deg: Annotated[float, Field(gt=0, le=90)] = 88.0
    mixed_pixels: Share = 0.0
    outliers: Share = 0.0
    ghosts: Share = 0.0
    reflection: Share = 0.0
    dropouts: Share = 0.0
    patches: Annotated[int, Field(ge=0)] = 0
    profiles: Annotated[int, Field(ge=2, le=1_000_000)] = 11000
    start_angle_deg: float = 0.0
    columns: tuple[Literal["angle", "time", "encoder", "counter"], ...] = ()
    speed_factor: PositiveFloat = 1.0
    ripple: float = 0.0
    ripple_per_turn: Annotated[int, Field(ge=1)] = 1
    ramp_s: NonNegativeFloat = 0.0
    dropped: Annotated[int, Field(ge=0)] = 0


class DentRecipe(Recipe):
    """``[[simulation.dent]]``: a smooth bowl on one flank."""

    tooth: Tooth
    flank: Literal["left", "right"]
    roll_length_mm: PositiveFloat
    height_mm: float
    radius_mm: PositiveFloat
    depth_um: float
    """Positive into the material."""


class WornRecipe(Recipe):
    """``[[simulation.worn]]``: a groove or a worn band on one flank, or on that flank of every tooth."""

    tooth: Tooth | None = None
    flank: Literal["left", "right"]
    from_roll_length_mm: NonNegativeFloat
    to_roll_length_mm: PositiveFloat
    from_mm: float
    to_mm: float
    depth_um: float
    """Positive into the material."""
    edge_mm: PositiveFloat = 0.1


class ScratchRecipe(Recipe):
    """``[[simulation.scratch]]``: a straight groove between two places of a flank, in any direction."""

    tooth: Tooth
    flank: Literal["left", "right"]
    from_roll_length_mm: NonNegativeFloat
    from_mm: float
    to_roll_length_mm: NonNegativeFloat
    to_mm: float
    width_mm: PositiveFloat
    depth_um: float
    """Positive into the material."""


class ChipRecipe(Recipe):
    """``[[simulation.chip]]``: a tip broken off."""

    tooth: Tooth
    from_mm: float
    to_mm: float
    depth_mm: PositiveFloat


class GearErrorsRecipe(Recipe):
    """``[simulation]`` of gear.toml."""

    turned_deg: float = 0.0
    turned_over: bool = False
    phase_deg: float = 3.0
    seed: Annotated[int, Field(ge=0)] = 0
    pitch_um: NonNegativeFloat = 0.0
    pitch_left_um: tuple[float, ...] = ()
    pitch_right_um: tuple[float, ...] = ()
    eccentricity_um: NonNegativeFloat = 0.0
    eccentricity_direction_deg: float = 0.0
    thickness_um: float = 0.0
    profile_slope_um: float = 0.0
    profile_slope_left_um: float | None = None
    profile_slope_right_um: float | None = None
    profile_wave_um: float = 0.0
    profile_waves: PositiveFloat = 1.0
    profile_crowning_um: float = 0.0
    helix_slope_um: float = 0.0
    helix_slope_left_um: float | None = None
    helix_slope_right_um: float | None = None
    helix_crowning_um: float = 0.0
    feed_marks_um: float = 0.0
    feed_mark_spacing_mm: PositiveFloat = 2.0
    feed_mark_slant: float = 0.0
    dent: tuple[DentRecipe, ...] = ()
    worn: tuple[WornRecipe, ...] = ()
    scratch: tuple[ScratchRecipe, ...] = ()
    chip: tuple[ChipRecipe, ...] = ()
    missing: tuple[Tooth, ...] = ()


class CadPoseRecipe(Recipe):
    """``[simulation]`` of a part with a CAD model."""

    turned_deg: float = 0.0
    lifted_mm: float = 0.0


def simulation_from(table: Mapping[str, Any]) -> Simulation:
    """The simulation that a ``[simulation]`` table describes.

    Raises:
        BadRecipe: a wrong or unknown key.
    """
    r = checked(SimulationRecipe, table, "[simulation]")
    return Simulation(
        mounting=_mounting(r),
        running=Running(
            r.eccentricity_um / UM,
            radians(r.eccentricity_direction_deg),
            r.tilt_mrad / 1e3,
            radians(r.tilt_direction_deg),
        ),
        workpiece=replace(
            _workpiece(r),
            chamfer=r.chamfer_mm,
            fillet=r.fillet_mm,
            table_disc=r.table_disc_mm,
            clamped=radians(r.clamped_deg),
        ),
        optics=_optics(r),
        acquisition=Acquisition(
            profiles=r.profiles,
            start_angle=radians(r.start_angle_deg),
            columns=r.columns,
            speed_factor=r.speed_factor,
            ripple=r.ripple,
            ripple_per_turn=r.ripple_per_turn,
            ramp=r.ramp_s,
            dropped=r.dropped,
        ),
        views=tuple((view.name, _mounting(view)) for view in r.view),
    )


def _mounting(r: MountingRecipe) -> Mounting:
    return Mounting(
        radians(r.phi_deg), r.standoff_mm, r.height_mm, radians(r.laser_plane_tilt_deg), r.laser_plane_offset_mm,
        radians(r.azimuth_deg),
    )  # fmt: skip


def _workpiece(r: WorkpieceRecipe) -> Workpiece:
    """Form, slots, flats, dirt, diameters and axes of a shaft or turned part."""
    return Workpiece(
        form=tuple(FormWave(f.surface, f.upr, f.amplitude_um / UM, radians(f.phase_deg)) for f in r.form),
        keyways=tuple(
            Keyway(k.surface, radians(k.azimuth_deg), k.width_mm, k.depth_mm, k.from_mm, k.to_mm) for k in r.keyway
        ),
        misalignments=tuple(
            Misalignment(m.surface, m.offset_x_um / UM, m.offset_y_um / UM, m.slope_x_mrad / 1e3, m.slope_y_mrad / 1e3)
            for m in r.misalignment
        ),
        diameter_errors=tuple((d.surface, d.error_um / UM) for d in r.diameter),
        patches=(
            *(Patch(f.surface, radians(f.azimuth_deg), f.share) for f in r.flat),
            *(Patch(d.surface, radians(d.azimuth_deg), d.share, d.height_um / UM, radians(d.edge_deg)) for d in r.dirt),
        ),
    )


def _optics(r: SimulationRecipe) -> Optics:
    return Optics(
        fan=radians(r.fan_deg),
        noise=r.noise_um / UM,
        correlated_noise=r.correlated_noise_um / UM,
        correlation=r.correlation_points,
        speckle=r.speckle_um / UM,
        speckle_cell=r.speckle_cell_mm,
        nonlinearity=r.nonlinearity_um / UM,
        nonlinearity_phase=radians(r.nonlinearity_phase_deg),
        scale_error=r.scale_error_ppm / 1e6,
        step_z=r.step_z_um / UM,
        step_x=r.step_x_um / UM,
        triangulation=radians(r.triangulation_deg),
        incidence_noise=r.incidence_noise,
        incidence_bias=r.incidence_bias_um / UM,
        most_incidence=radians(r.most_incidence_deg),
        mixed_pixels=r.mixed_pixels,
        outliers=r.outliers,
        ghosts=r.ghosts,
        reflection=r.reflection,
        dropouts=r.dropouts,
        patches=r.patches,
    )


def virtual_part_from(
    part: Gear | Turned | Cad, table: Mapping[str, Any], where: str = "[simulation] of the part"
) -> VirtualPart:
    """The part of a drawing with the deviations of its recipe's ``[simulation]`` table, which errors call ``where``.

    Raises:
        BadRecipe: a wrong or unknown key, or a tooth that the gear hasn't got.
    """
    if isinstance(part, Gear):
        gear = checked(GearErrorsRecipe, table, where)
        return VirtualGear(part, _gear_errors(gear), radians(gear.turned_deg), gear.turned_over)
    if isinstance(part, Turned):
        return VirtualTurned(part, _workpiece(checked(WorkpieceRecipe, table, where)))
    pose = checked(CadPoseRecipe, table, where)
    return VirtualCad(part, radians(pose.turned_deg), pose.lifted_mm)


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
        feed_marks=r.feed_marks_um / UM,
        feed_mark_spacing=r.feed_mark_spacing_mm,
        feed_mark_slant=r.feed_mark_slant,
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
        scratches=tuple(
            Scratch(
                s.tooth,
                s.flank,
                (s.from_roll_length_mm, s.from_mm),
                (s.to_roll_length_mm, s.to_mm),
                s.width_mm,
                s.depth_um / UM,
            )
            for s in r.scratch
        ),
        chips=tuple(Chip(c.tooth, c.from_mm, c.to_mm, c.depth_mm) for c in r.chip),
        missing=r.missing,
    )


def _flank(r: GearErrorsRecipe, profile: float | None, helix: float | None) -> FlankErrors:
    """The slopes of one flank: its own, else those of both."""
    return FlankErrors(
        (r.profile_slope_um if profile is None else profile) / UM, (r.helix_slope_um if helix is None else helix) / UM
    )
