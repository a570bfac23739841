"""Recipes of parts (CONTRACT.md): what the drawing says. mm, um and degrees in the files, mm and rad in memory."""

from collections.abc import Mapping
from functools import partial
from math import degrees, radians
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from truestand.core.arrays import Array
from truestand.core.assumptions import EXPANSION
from truestand.core.errors import BadRecipe
from truestand.core.frames import Pose
from truestand.core.temperature import Temperature
from truestand.files.checking import Recipe, checked
from truestand.files.recipes.recipes import Positive, build, read_toml
from truestand.files.shapes.meshes import read_mesh
from truestand.gear.damage import LEAST_DEPTH
from truestand.gear.drawing import Evaluation, Gear, Modification
from truestand.gear.evaluate import NEVER_NEGATIVE
from truestand.gear.match import MODULES, IdentifiedGear, is_standard
from truestand.parts.drawings import Cad, Section, Turned

NotNegative = Annotated[float, Field(ge=0)]
Limits = tuple[float, float]
Limit = Limits | Annotated[float, Field(gt=0)]
Class = Annotated[int, Field(ge=1, le=12)]
Part = Gear | Turned | Cad
KINDS = ("gear", "turned", "cad")
UM = 1000.0


class PartRecipe(Recipe):
    """What every part's recipe may say."""

    kind: Literal["gear", "turned", "cad"]
    name: str = ""
    serial: str | None = None
    order: str | None = None
    operator: str | None = None
    datum: Literal["base", "seat", "common"] = "base"
    bore_clearance_mm: NotNegative = 0.0
    part_temperature_C: Annotated[float, Field(ge=-50, le=200)] | None = None
    part_temperature_U_C: NotNegative | None = None
    expansion_per_K: Annotated[float, Field(ge=0, le=1e-3)] = EXPANSION
    simulation: dict[str, Any] = Field(default_factory=dict)
    """Only the virtual stand reads it."""


class EvaluationRecipe(Recipe):
    """``[evaluation]`` of a gear."""

    control_diameter_mm: Positive | None = None
    tip_form_diameter_mm: Positive | None = None
    measuring_diameter_mm: Positive | None = None
    ball_diameter_mm: Positive | None = None
    span_teeth: Annotated[int, Field(ge=1)] | None = None
    pitch_span: Annotated[int, Field(ge=1)] | None = None
    slope_ends: Literal["full", "evaluation"] | None = None
    resolution_mm: Positive = 0.25
    narrowest_damage_mm: Positive | None = None


class ModificationRecipe(Recipe):
    """``[modification]`` of a gear."""

    tip_relief_um: NotNegative = 0.0
    tip_relief_from_mm: Positive | None = None
    profile_crowning_um: float = 0.0
    helix_crowning_um: float = 0.0
    helix_slope_um: float = 0.0


class LimitsRecipe(Recipe):
    """``[limits]`` of a gear: one number is the largest that is allowed (of a deviation with a sign, either way)."""

    f_p_um: Limit | None = None
    F_p_um: Limit | None = None
    F_pk_um: Limit | None = None
    f_u_um: Limit | None = None
    F_r_um: Limit | None = None
    F_alpha_um: Limit | None = None
    f_falpha_um: Limit | None = None
    f_Halpha_um: Limit | None = None
    C_alpha_um: Limit | None = None
    F_beta_um: Limit | None = None
    f_fbeta_um: Limit | None = None
    f_Hbeta_um: Limit | None = None
    C_beta_um: Limit | None = None
    s_mm: Limit | None = None
    W_k_mm: Limit | None = None
    M_d_mm: Limit | None = None
    d_a_mm: Limit | None = None
    d_f_mm: Limit | None = None
    defect_depth_um: Positive | None = None
    damage: Literal["refuse", "report"] = "refuse"

    @model_validator(mode="after")
    def _ordered(self) -> "LimitsRecipe":
        for key, limit in self:
            if isinstance(limit, tuple) and not limit[0] < limit[1]:
                raise ValueError(f"{key}: found {list(limit)}, need [lower, upper]")
        depth = self.defect_depth_um
        if depth is not None and depth < UM * LEAST_DEPTH:
            raise ValueError(
                f"defect_depth_um: found {depth:g}, need {UM * LEAST_DEPTH:g} or more: damage that is shallower is not "
                "told from a sound flank"
            )
        return self

    def by_name(self) -> dict[str, tuple[float | None, float | None]]:
        """Lower and upper limit (mm) by the characteristic's name; one number limits both signs of a deviation."""
        found: dict[str, tuple[float | None, float | None]] = {}
        for key in (k for k in type(self).model_fields if k not in ("defect_depth_um", "damage")):
            limit, (name, unit) = getattr(self, key), key.rsplit("_", 1)
            if limit is None:
                continue
            scale = UM if unit == "um" else 1.0
            if isinstance(limit, tuple):
                found[name] = limit[0] / scale, limit[1] / scale
            else:
                signed = unit == "um" and name not in NEVER_NEGATIVE
                found[name] = -limit / scale if signed else None, limit / scale
        return found


class ClassesRecipe(Recipe):
    """``[classes]`` of a gear: an accuracy class for each of these, instead of ``accuracy_class``."""

    f_p: Class | None = None
    F_p: Class | None = None
    F_r: Class | None = None
    F_alpha: Class | None = None
    f_falpha: Class | None = None
    f_Halpha: Class | None = None
    F_beta: Class | None = None
    f_fbeta: Class | None = None
    f_Hbeta: Class | None = None


class GearRecipe(PartRecipe):
    """gear.toml as a whole."""

    teeth: Annotated[int, Field(ge=3)]
    module_mm: Positive
    pressure_angle_deg: Annotated[float, Field(gt=5, lt=45)] = 20.0
    helix_angle_deg: Annotated[float, Field(gt=-60, lt=60)] = 0.0
    profile_shift: float = 0.0
    face_width_mm: Positive
    face_from_mm: float
    tip_diameter_mm: Positive
    root_diameter_mm: Positive
    accuracy_class: Class | None = None
    standard: Literal["ISO 1328-1:2013", "ISO 1328-1:1995"] = "ISO 1328-1:2013"
    evaluation: EvaluationRecipe = EvaluationRecipe()
    modification: ModificationRecipe = ModificationRecipe()
    limits: LimitsRecipe = LimitsRecipe()
    classes: ClassesRecipe = ClassesRecipe()
    missing_teeth: list[Annotated[int, Field(ge=1)]] = Field(default_factory=list)


class SectionRecipe(Recipe):
    """``[[section]]`` of a turned part."""

    name: str
    from_mm: float
    to_mm: float
    diameter_mm: Positive
    limits_mm: Limits | None = None
    roundness_um: Positive | None = None
    cylindricity_um: Positive | None = None
    runout_um: Positive | None = None
    total_runout_um: Positive | None = None


class TurnedRecipe(PartRecipe):
    """A turned part's recipe as a whole."""

    section: Annotated[list[SectionRecipe], Field(min_length=1)]
    upr: Annotated[int, Field(ge=2)] = 50


class PoseRecipe(Recipe):
    """``[pose]`` of a CAD model: turned about X, then Y, then Z of the datum axis's frame, then moved."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    z_mm: float = 0.0
    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)


class CadRecipe(PartRecipe):
    """The recipe of a part with a CAD model as a whole."""

    file: str
    """Beside the recipe, or a full path."""
    unit: Literal["mm", "inch"] = "mm"
    pose: PoseRecipe = PoseRecipe()
    fit: Literal["none", "angle", "angle_and_height", "all"] = "angle"
    limits_um: Limits | None = None
    reach_mm: Positive = 1.0

    @model_validator(mode="after")
    def _ordered(self) -> "CadRecipe":
        if self.limits_um is not None and not self.limits_um[0] < self.limits_um[1]:
            raise ValueError(f"limits_um: found {list(self.limits_um)}, need [lower, upper]")
        return self


def read_part(path: Path | str) -> Part:
    """The part of a gear.toml, of a turned part's recipe or of a CAD comparison's.

    Raises:
        BadRecipe: unreadable, no TOML, or a wrong, missing or unknown key.
        UnreadableFile: a CAD model that can't be read.
        MissingExtra: a STEP model without its extra.
    """
    return part_of(read_toml(path), path)


def part_of(table: Mapping[str, Any], path: Path | str) -> Part:
    """The part of a recipe's tables, as if they stood in ``path``.

    Raises:
        BadRecipe, UnreadableFile, MissingExtra: as ``read_part``.
    """
    match table.get("kind"):
        case "gear":
            return build(_gear, checked(GearRecipe, table, str(path)), path)
        case "turned":
            return build(_turned, checked(TurnedRecipe, table, str(path)), path)
        case "cad":
            return build(partial(_cad, Path(path).parent), checked(CadRecipe, table, str(path)), path)
        case kind:
            found = "no kind" if kind is None else f"kind {kind!r}"
            raise BadRecipe(f'{path}: found {found}, need one of {", ".join(KINDS)}, as in kind = "gear"')


def recipe_of_identified(seen: IdentifiedGear, bottom: float, top: float) -> str:
    """A gear.toml (text) of a gear that was identified, to start from: rounded as drawings are where that is near."""
    shift = 0.0 if seen.profile_shift is None or abs(seen.profile_shift) < 0.02 else seen.profile_shift
    helix = degrees(seen.helix_angle)
    module = min(MODULES, key=lambda m: abs(m - seen.module)) if is_standard(seen.module) else round(seen.module, 4)
    return (
        "# Identified from a scan: check every number against the drawing, and add accuracy_class.\n\n"
        'kind = "gear"\n'
        f"teeth = {seen.teeth}\n"
        f"module_mm = {module}\n"
        f"pressure_angle_deg = {degrees(seen.pressure_angle):g}\n"
        f"helix_angle_deg = {0.0 if abs(helix) < 0.1 else round(helix, 2)}\n"
        f"profile_shift = {round(shift, 3)}\n"
        f"face_width_mm = {round(top - bottom, 2)}\n"
        f"face_from_mm = {round(bottom, 2)}\n"
        f"tip_diameter_mm = {round(seen.tip_diameter, 2)}\n"
        f"root_diameter_mm = {round(seen.root_diameter, 2)}\n"
    )


def read_identity(path: Path | str) -> dict[str, str]:
    """Serial, order and operator, where the recipe has them.

    Raises:
        BadRecipe: unreadable or no TOML.
    """
    table = read_toml(path)
    return {k: str(table[k]) for k in ("serial", "order", "operator") if table.get(k) is not None}


def model_of(path: Path | str) -> Path | None:
    """The file of the CAD model that a part's recipe names; None for other parts.

    Raises:
        BadRecipe: unreadable or no TOML.
    """
    table = read_toml(path)
    return Path(path).parent / str(table["file"]) if table.get("kind") == "cad" else None


def read_part_simulation(path: Path | str) -> dict[str, Any]:
    """The ``[simulation]`` table of a recipe that ``read_part`` takes, as it stands; empty where there is none.

    Raises:
        BadRecipe: unreadable or no TOML.
    """
    return dict(read_toml(path).get("simulation", {}))


def _gear(r: GearRecipe) -> Gear:
    e, m = r.evaluation, r.modification
    return Gear(
        teeth=r.teeth,
        module=r.module_mm,
        face_width=r.face_width_mm,
        face_from=r.face_from_mm,
        tip_diameter=r.tip_diameter_mm,
        root_diameter=r.root_diameter_mm,
        pressure_angle=radians(r.pressure_angle_deg),
        helix_angle=radians(r.helix_angle_deg),
        profile_shift=r.profile_shift,
        accuracy_class=r.accuracy_class,
        standard=r.standard,
        datum=r.datum,
        bore_clearance=r.bore_clearance_mm,
        name=r.name or "gear",
        evaluation=Evaluation(
            e.control_diameter_mm, e.tip_form_diameter_mm, e.measuring_diameter_mm, e.ball_diameter_mm,
            e.span_teeth, e.pitch_span, e.slope_ends, e.resolution_mm, e.narrowest_damage_mm,
        ),
        modification=Modification(
            m.tip_relief_um / UM, m.tip_relief_from_mm, m.profile_crowning_um / UM, m.helix_crowning_um / UM,
            m.helix_slope_um / UM,
        ),
        limits=r.limits.by_name(),
        classes={name: c for name, c in r.classes if c is not None},
        defect_depth=None if r.limits.defect_depth_um is None else r.limits.defect_depth_um / UM,
        damage_decides=r.limits.damage == "refuse",
        missing_teeth=tuple(r.missing_teeth),
        temperature=_temperature(r),
    )  # fmt: skip


def _turned(r: TurnedRecipe) -> Turned:
    sections = tuple(_section(s) for s in r.section)
    return Turned(sections, r.name or "turned part", r.datum, r.bore_clearance_mm, r.upr, _temperature(r))


def _temperature(r: PartRecipe) -> Temperature:
    return Temperature(r.part_temperature_C, r.part_temperature_U_C, r.expansion_per_K)


def _section(s: SectionRecipe) -> Section:
    return Section(
        s.name, s.from_mm, s.to_mm, s.diameter_mm, s.limits_mm,
        *(None if v is None else v / UM for v in (s.roundness_um, s.cylindricity_um, s.runout_um, s.total_runout_um)),
    )  # fmt: skip


def _cad(folder: Path, r: CadRecipe) -> Cad:
    return Cad(
        mesh=read_mesh(folder / r.file, r.unit),
        name=r.name or Path(r.file).stem,
        pose=_pose(r.pose),
        fit=r.fit,
        limits=None if r.limits_um is None else (r.limits_um[0] / UM, r.limits_um[1] / UM),
        reach=r.reach_mm,
        datum=r.datum,
        bore_clearance=r.bore_clearance_mm,
        temperature=_temperature(r),
    )


def _pose(r: PoseRecipe) -> Array:
    """(4, 4), mm."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_euler("xyz", r.rotation_deg, degrees=True).as_matrix()
    return Pose(rotation, np.array([r.x_mm, r.y_mm, r.z_mm])).matrix
