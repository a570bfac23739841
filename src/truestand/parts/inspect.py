"""The one door to every inspection: what the part is decides how it is judged."""

from truestand.core.inspection import Inspection
from truestand.core.surface import Surface
from truestand.gear.drawing import Gear
from truestand.gear.inspect import inspect_gear
from truestand.parts.cad import inspect_cad
from truestand.parts.drawings import Cad, Turned
from truestand.parts.turned import inspect_turned

Part = Gear | Turned | Cad


def inspect(surface: Surface, part: Part) -> Inspection:
    """Characteristics, each with its uncertainty (mm, k = 2), of a part that ``roll`` brought into C; defects of gears.

    Source: gears by ISO 1328-1 and ISO 21771; form and run-out by ISO 12181, ISO 12180, ISO 1101; decisions by
    ISO 14253-1.

    Raises:
        NotEnoughData: nothing of the part is in view.
        WrongDrawing: what was seen is another gear than the drawing's.
        BadRecipe: the surface doesn't say from which scan and calibration it comes.
    """
    if isinstance(part, Gear):
        return inspect_gear(surface, part)
    if isinstance(part, Turned):
        return inspect_turned(surface, part)
    return inspect_cad(surface, part)
