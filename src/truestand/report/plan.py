"""The report of a plan: where to put the sensors, in one HTML file."""

from collections.abc import Iterable, Sequence
from html import escape

from truestand.files.recipes.recipes import Company
from truestand.planning.gear_target import GearTarget
from truestand.planning.plan import Expected, Plan
from truestand.report import plan_figures as figures
from truestand.report.inspection_tables import headings, table
from truestand.report.notation import meaning, prose, symbol
from truestand.report.page import K_NOTE, framed, head, not_measured, page, stamp
from truestand.report.plan_tables import (
    PLACE_COLUMNS,
    figures_of,
    outcome,
    place_row,
    position_text,
    price,
)


def plan_report(plan: Plan, company: Company | None = None, created: str | None = None) -> str:
    """The HTML text."""
    parts = [
        _head(plan, company, created),
        not_measured("Not seen", map(prose, plan.unseen)),
        _places(plan),
        _expected(plan),
        _pictures(plan),
        _price(plan),
        _assumed(plan),
        _closing(plan),
    ]
    return page(f"Plan for {plan.part.name}", parts, "Lengths in the frame of the shaft; signs as in the record.")


def _head(plan: Plan, company: Company | None, created: str | None) -> str:
    search = plan.search
    facts = [f"part {plan.part.name}", f"shaft {plan.setting.artefact.name}"]
    facts += [f"{len(search.candidates) + search.touching + search.blind} places looked at"]
    facts += [f"planned {created}"] if created else []
    if plan.complete:
        kind, mark, word = "conforms", "\N{CHECK MARK}", f"{_views(len(plan.views))} will do"
        meant = "all that the drawing asks is seen, and U is small enough to show that it conforms"
    else:
        seen = bool(plan.views) and all(e.status == "measured" for e in plan.asked)
        kind, mark = "undecided", "?"
        word = "All is seen, not all is capable" if seen else "Not everything is seen"
        meant = (
            "U is too large to show that some of what the drawing asks conforms: see what it mostly comes from"
            if seen
            else "some of what the drawing asks can't be measured from these places"
        )
    return head("Plan", "Where to put the sensors", facts, company) + stamp(kind, mark, word, meant)


def _views(number: int) -> str:
    return "One view" if number == 1 else f"{number} views"


def _places(plan: Plan) -> str:
    if not plan.views:
        return ""
    heads = "".join(f'<th class="n">{escape(name)}</th>' for name in PLACE_COLUMNS)
    rows = "".join(
        f"<tr><th>{escape(view.mount.sensor.name)}<small>{escape(view.mount.sensor.device)}</small>"
        f"<small>{escape(position_text(view))}</small></th>"
        + "".join(f'<td class="n">{escape(text)}</td>' for text in place_row(view))
        + "</tr>"
        for view in plan.views
    )
    drawn = framed(
        figures.places(plan),
        "Each sensor in its own laser plane, with its housing and the zone in which it measures; then all from above. "
        "Hatched: where no sensor may be.",
    )
    return (
        "<h2>Places</h2><p>phi is the angle between the rotation axis and the sensor's z; stand-off is the range at "
        "which the middle of the laser line meets the shaft's base, height where it does. The calibration finds where "
        "a sensor really stands: a degree and a millimetre off change little.</p>"
        + table(f"<tr><th>view</th>{heads}</tr>", rows, "narrow")
        + drawn
    )


def _expected(plan: Plan) -> str:
    if not plan.expected:
        return ""
    asked = set(map(id, plan.asked))
    lines = sorted(plan.asked, key=lambda e: -(e.share or 0.0))
    others = [e for e in plan.expected if id(e) not in asked]
    text = (
        "<h2>What to expect</h2><p>As an inspection would have it: scans from these places are imagined and assessed "
        "with the same budget. Of a gear there are three, each with the errors of a stand. <i>U</i> is the root mean "
        "square of theirs, over the teeth too; the largest of a tooth is held against the limits.</p>"
        + K_NOTE
        + _lines(lines)
    )
    if others:
        text += f"<details><summary>Without limits</summary>{_lines(others)}</details>"
    return text


def _lines(lines: Sequence[Expected]) -> str:
    figures = figures_of(lines)
    heads = headings(("<i>U</i>", *tuple(figures)[1:]))
    rows = "".join(_row(e, [text(e) for text in figures.values()]) for e in lines)
    return table(f"<tr><th>characteristic</th><th></th>{heads}<th>mostly from</th><th></th></tr>", rows, "results")


def _row(e: Expected, figures: Iterable[str]) -> str:
    return (
        f'<tr><td class="name">{symbol(e.name)}<small>{escape(meaning(e.name))}</small></td><td>{escape(e.where)}</td>'
        + "".join(f'<td class="n">{text}</td>' for text in figures)
        + f"<td>{prose(e.mostly or '')}</td><td>{escape(outcome(e))}</td></tr>"
    )


def _pictures(plan: Plan) -> str:
    text, target = "", plan.search.target
    if plan.views and isinstance(target, GearTarget):
        text += "<h2>What each view sees</h2>" + framed(
            figures.flanks(plan, target),
            "One tooth's flanks, root below. Colour: angle between laser ray and surface normal; grey: not seen, "
            "because it is too steep, out of range or line, or hidden.",
        )
    if plan.search.candidates:
        text += "<h2>Other places</h2>" + framed(
            figures.tried(plan),
            "Left: what single places show, of the surface of which they show least. Right: those that were compared "
            "by U. Crosses: chosen.",
        )
    return text


def _price(plan: Plan) -> str:
    sentences = list(price(plan, symbol))
    if not sentences:
        return ""
    return "<h2>One view less</h2>" + "".join(f"<p>{sentence}</p>" for sentence in sentences)


def _assumed(plan: Plan) -> str:
    if not plan.assumed:
        return ""
    items = "".join(f"<li>{prose(text)}</li>" for text in plan.assumed)
    return f"<h2>What was assumed</h2><p>State these in stand.toml where you know better.</p><ul>{items}</ul>"


def _closing(plan: Plan) -> str:
    return (
        "<h2>Repeat it</h2><p><code>truestand plan PART.toml --stand stand.toml --artefact shaft.toml --views "
        f"{max(len(plan.views), 1)} -o plan.json --report plan.html --stand-out planned.toml</code></p>"
    )
