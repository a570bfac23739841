"""The one door to every inspection: what the part is decides how it is judged."""

from collections.abc import Sequence
from dataclasses import replace
from math import degrees

from truestand.apply.right_view import taken_by_another
from truestand.apply.transfer import roll, transfer_remarks, with_sensor_as_calibrated
from truestand.core.artefact import Artefact
from truestand.core.calibration import Calibration
from truestand.core.errors import BadRecipe, TruestandError
from truestand.core.inspection import Inspection
from truestand.core.message import Message
from truestand.core.scan import Scan
from truestand.core.surface import Surface, apply_calibration, each_of
from truestand.core.temperature import Temperature
from truestand.gear.clampings import Together, laid_together
from truestand.gear.drawing import Gear
from truestand.gear.inspect import inspect_gear
from truestand.gear.ties import PartTurned
from truestand.parts.cad import inspect_cad
from truestand.parts.drawings import Cad, Turned
from truestand.parts.turned import inspect_turned

Part = Gear | Turned | Cad
LIKE_THE_SHAFT_MM = 1.0
"""Difference of radius within which a section at the height of a cylinder of the shaft may be that cylinder."""


def inspect(
    surface: Surface | Sequence[Surface], part: Part, part_turned: Sequence[PartTurned] | None = None
) -> Inspection:
    """Characteristics, each with its uncertainty (mm, k = 2), of a part that ``roll`` brought into C; defects of gears.

    Several views are inspected as one (``roll_views``); so are scans of a gear that was clamped again, ``part_turned``
    by so many teeth in each, or turned over (``gear.clampings``).

    Source: gears by ISO 1328-1 and ISO 21771; form and run-out by ISO 12181, ISO 12180, ISO 1101; decisions by
    ISO 14253-1.

    Raises:
        NotEnoughData: nothing of the part is in view.
        WrongDrawing: what was seen is another gear than the drawing's.
        BadRecipe: a surface doesn't say from which scan and calibration it comes, a scan is given twice, a part that is
            no gear was clamped again, or teeth that the pitches contradict.
    """
    surfaces = each_of(surface)
    demand_views(len(surfaces), part, part_turned is not None)
    known = [s.scan.sha256 for s in surfaces if s.scan is not None and s.scan.sha256]
    if len(set(known)) < len(known):
        raise BadRecipe("found the same scan twice, need one scan of each view or clamping")
    if isinstance(part, Turned) and _is_shaft(part, surfaces[0].origin[1].artefact):
        surfaces = tuple(with_sensor_as_calibrated(s) for s in surfaces)
    if part.temperature.growth:
        surfaces = tuple(_at_reference_temperature(s, part.temperature) for s in surfaces)
    together = Together(surfaces)
    if part_turned is not None and isinstance(part, Gear):
        together = laid_together(surfaces, part, part_turned)
    inspection = _inspected(together, part)
    inspection = replace(
        inspection,
        reasons=(*together.reasons, *_turned_pose(surfaces, part), *inspection.reasons),
        remarks=(*together.remarks, *inspection.remarks),
    )
    origins = [s.origin for s in together.surfaces]
    followed = dict.fromkeys(
        r for scan, calibration in origins for r in (*scan.remarks, *transfer_remarks(calibration))
    )
    return replace(inspection, remarks=(*followed, *inspection.remarks))


def demand_views(number: int, part: Part, clamped_again: bool = False) -> None:
    """Refuse what can't be inspected by so many scans.

    Raises:
        BadRecipe: none, or several clampings of a part that is no gear.
    """
    if clamped_again and not isinstance(part, Gear):
        raise BadRecipe("found --part-turned of a part that is no gear: only teeth tell how it was clamped again")
    if not number:
        raise BadRecipe("found no surface, need one of each view")


def demand_right_views(scans: tuple[Scan, ...], calibration: Calibration, part: Part, start_stated: bool) -> None:
    """Refuse scans that show nothing like the part where their own views stand, but the part where another one stands.

    For scans that show too little of the shaft to tell (``apply.right_view``), once ``inspect`` has refused them.

    Raises:
        BadRecipe: a scan was taken by another view; the message names it.
    """

    def shows_part(scan: Scan, view: Calibration) -> bool:
        try:
            return not inspect(roll(scan, view, start_stated), part).reasons
        except TruestandError:
            return False

    for scan in scans if calibration.views else ():
        if not shows_part(scan, calibration.for_scan(scan)):
            right = [v.name for v in calibration.views if v.name != scan.view and shows_part(scan, v)]
            if right:
                raise taken_by_another(scan.view, right)


def _turned_pose(surfaces: Sequence[Surface], part: Part) -> tuple[Message, ...]:
    """Why nothing may be decided of a model that stands where [pose] has it, by a view alone whose own C is turned
    against that of the calibration's first one.
    """
    alone = surfaces[0].origin[1]
    if not isinstance(part, Cad) or part.fit != "none" or alone.joint is not None or not alone.azimuth:
        return ()
    text = (
        f"[pose] says how the model stands, and view {alone.name!r} alone counts angles from its own side, "
        f"{degrees(alone.azimuth):.1f} deg from the calibration's first view: inspect by both views, or let fit find "
        'the angle (fit = "angle")'
    )
    return (Message("pose_of_first_view", text),)


def _at_reference_temperature(surface: Surface, temperature: Temperature) -> Surface:
    """The same scan rolled up as the part is at 20 degrees Celsius."""
    scan, calibration = surface.origin
    return apply_calibration(scan, replace(calibration, part_growth=temperature.growth))


def _is_shaft(part: Turned, artefact: Artefact | None) -> bool:
    """Whether a section may be a cylinder of the artefact, as far as height and diameter tell."""
    return artefact is not None and any(
        section.bottom < c.top and c.bottom < section.top and abs(section.diameter / 2 - c.radius) < LIKE_THE_SHAFT_MM
        for section in part.sections
        for c in artefact.cylinders
    )


def _inspected(together: Together, part: Part) -> Inspection:
    if isinstance(part, Gear):
        return inspect_gear(together.surfaces, part, together.sides_tied, together.datum)
    if isinstance(part, Turned):
        return inspect_turned(together.surfaces, part)
    return inspect_cad(together.surfaces, part)
