"""The tables of an inspection that any kind of part has: verdicts, budget, settings. Texts from files are escaped."""

from collections.abc import Iterable, Mapping
from html import escape

from truestand.core.inspection import Characteristic, Defect, Inspection
from truestand.core.units import um
from truestand.report.notation import (
    NONE,
    decimals,
    limit_text,
    line_name,
    meaning,
    number,
    prose,
    result_text,
    seen_text,
    shown,
    symbol,
    tolerance_share_text,
    two_digits,
    u_text,
    unit,
    value_text,
    verdict_text,
    with_u,
)
from truestand.report.page import not_measured
from truestand.report.true_values import Key, true_value

U_HEAD = "<i>U</i><small>k = 2</small>"
AGREE = {True: "agree", False: "<b>contradict each other</b>"}
LEAST_SHARE = 0.02
"""Of U: smaller lines of a budget stand in the record."""
MOST_LISTED = 8
"""Lines that the head lists one by one."""
MAIN_CHARACTERISTICS = (
    "f_p", "F_p", "F_r", "F_alpha", "f_Halpha", "F_beta", "f_Hbeta", "s", "M_d", "d", "roundness", "runout",
)  # fmt: skip
"""Whose U a reader asks for first; of a comparison with CAD, all."""


def table(head: str, body: str, kind: str = "") -> str:
    """A table from its cells."""
    css = f' class="{kind}"' if kind else ""
    return f'<div class="wide"><table{css}><thead>{head}</thead><tbody>{body}</tbody></table></div>'


def cell(text: str, kind: str = "n", span: int = 1) -> str:
    """One cell, right-aligned unless said otherwise."""
    across = f' colspan="{span}"' if span > 1 else ""
    return f'<td class="{kind}"{across}>{text}</td>'


def headings(names: Iterable[str]) -> str:
    """Cells of a head over numbers."""
    return "".join(f'<th class="n">{n}</th>' for n in names)


def name_cell(c: Characteristic) -> str:
    """The first cell of a row: symbol, unit and what it means."""
    words = meaning(c.name)
    small = f"<small>{words}</small>" if words else ""
    return f'<td class="name">{symbol(c.name)} <span class="unit">{unit(c)}</span>{small}</td>'


def true_cells(c: Characteristic, values: Mapping[Key, float]) -> str:
    """``true`` and ``error`` of a line."""
    known = true_value(values, c)
    if known is None or c.value is None:
        return cell(NONE) * 2
    return cell(number(known, decimals(c))) + cell(number(shown(c, c.value) - known, decimals(c)))


def result_cells(c: Characteristic, values: Mapping[Key, float] | None, grade: bool) -> str:
    """Value, U, U/T, class, coverage, verdict, truth. No number at all where nothing was measured."""
    width = 5 + grade + (2 if values is not None else 0)
    if c.value is None or c.status == "not_measurable":
        undecided = " · undecided" if c.limits is not None and c.verdict is not None else ""
        return cell(f'<span class="none">not measurable{undecided}</span>', "gap", width)
    cells = cell(f"<b>{value_text(c)}</b>", "n first") + cell(u_text(c)) + cell(tolerance_share_text(c))
    if grade:
        cells += cell(NONE if c.grade is None else str(c.grade))
    cells += cell(seen_text(c)) + cell(verdict_text(c), "verdict-cell")
    return cells if values is None else cells + true_cells(c, values)


def result_headings(truth: bool, grade: bool) -> str:
    """Of ``result_cells``."""
    first = '<th class="n first">value</th>' + headings([U_HEAD, "<i>U</i>/<i>T</i>"])
    return (
        first + headings(["class"] * grade) + headings(["seen"]) + "<th>verdict</th>"
        + headings(["true", "error"] if truth else [])
    )  # fmt: skip


def whole_part_lines(inspection: Inspection) -> list[Characteristic]:
    """Lines of the whole part."""
    return [c for c in inspection.characteristics if c.tooth is None]


def main_lines(inspection: Inspection) -> list[Characteristic]:
    """Of each main characteristic the line with the largest U."""
    lines = [c for c in whole_part_lines(inspection) if c.U is not None and c.budget]
    names = MAIN_CHARACTERISTICS if inspection.kind != "cad" else dict.fromkeys(c.name for c in lines)
    same = ([c for c in lines if c.name == name] for name in names)
    return [max(found, key=lambda c: c.U or 0.0) for found in same if found]


def decisive(inspection: Inspection) -> str:
    """Which lines carry the verdict, as a list: what fails, what is undecided, what can't be shown."""
    items = []
    for verdict, words in (("does_not_conform", "Does not conform"), ("undecided", "Undecided")):
        broken = [_defect_text(d) for d in inspection.defects if d.verdict == verdict]
        if broken:
            items.append(f'<li class="{verdict}"><b>{words}:</b> {"; ".join(broken)}</li>')
        found = [c for c in inspection.characteristics if c.verdict == verdict and c.value is not None]
        if found:
            items.append(f'<li class="{verdict}"><b>{words}:</b> {_failed_lines(found)}</li>')
    unable = [c for c in whole_part_lines(inspection) if not c.capable]
    if unable:
        names = ", ".join(dict.fromkeys(symbol(c.name) for c in unable))
        items.append(f"<li><b>Not capable:</b> {names}. <i>U</i> leaves no room between the limits.</li>")
    return f'<ul class="decisive">{"".join(items)}</ul>' if items else ""


def _defect_text(d: Defect) -> str:
    deep = "" if d.depth is None or d.U is None else f" {with_u(um(abs(d.depth)), um(d.U))} µm"
    return f"tooth {d.tooth}: {escape(d.kind)}{deep}"


def _failed_lines(found: list[Characteristic]) -> str:
    """Lines of the whole part by name and value; lines of single teeth as a count."""
    single = [c for c in found if c.tooth is not None]
    texts = [
        f"{line_name(c)} {result_text(c)} {unit(c)} (limit {limit_text(c)})"
        for c in found if c.tooth is None
    ]  # fmt: skip
    more = len(texts) - MOST_LISTED
    texts = [*texts[:MOST_LISTED], f"{more} more"] if more > 1 else texts
    if single:
        names = ", ".join(dict.fromkeys(symbol(c.name) for c in single))
        texts.append(f"{len(single)} line{'s' if len(single) > 1 else ''} of single teeth ({names})")
    return "; ".join(texts)


def unmeasured(inspection: Inspection) -> str:
    """What could not be measured, by flank or section; empty where everything was."""
    by_place: dict[str, list[str]] = {}
    for c in whole_part_lines(inspection):
        if c.status == "not_measurable":
            by_place.setdefault(c.section or c.flank or "", []).append(symbol(c.name))
    items = []
    for place, names in by_place.items():
        where = f"<b>{place} flanks:</b> " if place in ("left", "right") else f"<b>{escape(place)}:</b> "
        items.append(f"{where if place else ''}{', '.join(dict.fromkeys(names))}")
    return not_measured("Not measurable in this scan", items)


def budgets(lines: Iterable[Characteristic]) -> str:
    """Where each line's U comes from, as bars."""
    return f'<div class="cards">{"".join(_budget(c) for c in lines if c.budget and c.U)}</div>'


def _budget(c: Characteristic) -> str:
    U = c.U or 0.0
    rows = "".join(
        f'<tr><td>{escape(b.name)}</td><td class="n">{two_digits(shown(c, b.U))}</td>'
        f'<td class="bars"><span class="bar" style="width:{6 * b.U / max(U, 1e-15):.2f}rem"></span></td></tr>'
        for b in c.budget
        if b.U >= LEAST_SHARE * U
    )
    total = f'<tr><th>{line_name(c)}</th><th class="n">{two_digits(shown(c, U))}</th><th>{unit(c)}</th></tr>'
    return f'<table class="budget"><thead>{total}</thead><tbody>{rows}</tbody></table>'


def seams(inspection: Inspection) -> str:
    """What views differ by on the surface that both saw, with its heading; empty of one view."""
    rows = "".join(
        f"<tr><th>{escape(' – '.join(seam.views))}</th><td>{escape(seam.place)}</td>"
        f"{cell(with_u(um(seam.difference), um(seam.U)))}<td>{AGREE[seam.ok]}</td></tr>"
        for seam in inspection.seams
    )
    if not rows:
        return ""
    head = '<tr><th>views</th><th>where</th><th class="n">difference, µm</th><th></th></tr>'
    return (
        "<h2>Seams</h2><p>What is left of the difference between two views of the same surface when all others have "
        f"told where the views stand; beyond 1.5 <i>U</i> they contradict each other.</p>{table(head, rows)}"
    )


def settings(inspection: Inspection) -> str:
    """How it was evaluated, with its heading; empty where nothing is known."""
    rows = "".join(
        f"<tr><th>{escape(key)}</th><td>{prose(text)}</td></tr>" for key, text in inspection.settings.items()
    )
    table = f'<table class="settings"><tbody>{rows}</tbody></table>'
    return f"<h2>How it was evaluated</h2>{table}" if rows else ""
