"""A plan as tables for the terminal."""

from rich.console import Group, RenderableType

from truestand.planning.plan import Plan
from truestand.report.plan_tables import PLACE_COLUMNS, figures_of, outcome, place_row, position_text
from truestand.report.terminal import text_table


def plan_tables(plan: Plan) -> RenderableType:
    """Where the sensors go, and with what U each characteristic would be measured."""
    places = text_table("Places", ("view", "device"), PLACE_COLUMNS)
    carried = any(view.mount.position for view in plan.views)
    if carried:
        places.add_column("position")
    for view in plan.views:
        position = (position_text(view),) if carried else ()
        places.add_row(view.mount.sensor.name, view.mount.sensor.device, *place_row(view), *position)
    figures = figures_of(plan.asked)
    lines = text_table("Expected", ("characteristic", "flank or section"), tuple(figures))
    lines.add_column("")
    for e in plan.asked:
        lines.add_row(e.name, e.where, *(text(e) for text in figures.values()), outcome(e))
    return Group(places, lines)
