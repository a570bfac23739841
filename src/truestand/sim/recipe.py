"""``[simulation]`` of stand.toml: mm, um, degrees outside; unknown keys refused with the nearest right one."""

from collections.abc import Mapping
from dataclasses import replace
from math import radians
from typing import Annotated, Any, Literal

from pydantic import Field

from truestand.files.checking import Recipe, checked
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
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


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
    width_mm: Positive
    depth_mm: Positive
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


class ShapeRecipe(Recipe):
    """What shafts and turned parts may have beyond their drawing."""

    form: tuple[FormRecipe, ...] = ()
    keyway: tuple[KeywayRecipe, ...] = ()
    flat: tuple[FlatRecipe, ...] = ()
    dirt: tuple[DirtRecipe, ...] = ()
    misalignment: tuple[MisalignmentRecipe, ...] = ()
    diameter: tuple[DiameterRecipe, ...] = ()


class SimulationRecipe(ShapeRecipe):
    """``[simulation]`` as a whole."""

    phi_deg: float = -41.802
    standoff_mm: Positive = 95.0
    height_mm: float = -1.0
    laser_plane_tilt_deg: float = 0.0
    laser_plane_offset_mm: float = 0.0
    azimuth_deg: float = 0.0
    eccentricity_um: NotNegative = 878.9
    eccentricity_direction_deg: float = 0.0
    tilt_mrad: float = 0.0
    tilt_direction_deg: float = 0.0
    clamped_deg: float = 0.0
    chamfer_mm: NotNegative = 0.0
    fillet_mm: NotNegative = 0.0
    table_disc_mm: float | None = None
    fan_deg: Positive = 16.0
    noise_um: NotNegative = 4.0
    correlated_noise_um: NotNegative = 0.0
    correlation_points: Annotated[int, Field(ge=1)] = 8
    speckle_um: NotNegative = 0.0
    speckle_cell_mm: Positive = 0.1
    nonlinearity_um: float = 0.0
    nonlinearity_phase_deg: float = 57.3
    scale_error_ppm: float = 0.0
    step_z_um: NotNegative = 4.0
    step_x_um: NotNegative = 1.0
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
    speed_factor: Positive = 1.0
    ripple: float = 0.0
    ripple_per_turn: Annotated[int, Field(ge=1)] = 1
    ramp_s: NotNegative = 0.0
    dropped: Annotated[int, Field(ge=0)] = 0


def simulation_from(table: Mapping[str, Any]) -> Simulation:
    """The simulation that a ``[simulation]`` table describes.

    Raises:
        BadRecipe: a wrong or unknown key.
    """
    return _simulation(checked(SimulationRecipe, table, "[simulation]"))


def _simulation(r: SimulationRecipe) -> Simulation:
    return Simulation(
        mounting=Mounting(
            radians(r.phi_deg),
            r.standoff_mm,
            r.height_mm,
            radians(r.laser_plane_tilt_deg),
            r.laser_plane_offset_mm,
            radians(r.azimuth_deg),
        ),
        running=Running(
            r.eccentricity_um / 1e3,
            radians(r.eccentricity_direction_deg),
            r.tilt_mrad / 1e3,
            radians(r.tilt_direction_deg),
        ),
        workpiece=replace(
            workpiece_of(r),
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
    )


def workpiece_of(r: ShapeRecipe) -> Workpiece:
    """Form, slots, flats, dirt, diameters and axes of a shaft or turned part."""
    return Workpiece(
        form=tuple(FormWave(f.surface, f.upr, f.amplitude_um / 1e3, radians(f.phase_deg)) for f in r.form),
        keyways=tuple(
            Keyway(k.surface, radians(k.azimuth_deg), k.width_mm, k.depth_mm, k.from_mm, k.to_mm) for k in r.keyway
        ),
        misalignments=tuple(
            Misalignment(
                m.surface, m.offset_x_um / 1e3, m.offset_y_um / 1e3, m.slope_x_mrad / 1e3, m.slope_y_mrad / 1e3
            )
            for m in r.misalignment
        ),
        diameter_errors=tuple((d.surface, d.error_um / 1e3) for d in r.diameter),
        patches=(
            *(Patch(f.surface, radians(f.azimuth_deg), f.share) for f in r.flat),
            *(Patch(d.surface, radians(d.azimuth_deg), d.share, d.height_um / 1e3) for d in r.dirt),
        ),
    )


def _optics(r: SimulationRecipe) -> Optics:
    return Optics(
        fan=radians(r.fan_deg),
        noise=r.noise_um / 1e3,
        correlated_noise=r.correlated_noise_um / 1e3,
        correlation=r.correlation_points,
        speckle=r.speckle_um / 1e3,
        speckle_cell=r.speckle_cell_mm,
        nonlinearity=r.nonlinearity_um / 1e3,
        nonlinearity_phase=radians(r.nonlinearity_phase_deg),
        scale_error=r.scale_error_ppm / 1e6,
        step_z=r.step_z_um / 1e3,
        step_x=r.step_x_um / 1e3,
        triangulation=radians(r.triangulation_deg),
        incidence_noise=r.incidence_noise,
        incidence_bias=r.incidence_bias_um / 1e3,
        most_incidence=radians(r.most_incidence_deg),
        mixed_pixels=r.mixed_pixels,
        outliers=r.outliers,
        ghosts=r.ghosts,
        reflection=r.reflection,
        dropouts=r.dropouts,
        patches=r.patches,
    )
