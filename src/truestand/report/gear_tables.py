"""The tables of a gear's inspection: left and right flanks side by side, worst teeth, every tooth, defects."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from truestand.core.inspection import WORST, Characteristic, Defect, Inspection
from truestand.core.units import um
from truestand.gear.evaluate import AREAL, PER_TOOTH
from truestand.gear.inspect import GearEvidence
from truestand.report.inspection_tables import (
    U_HEAD,
    cell,
    headings,
    name_cell,
    result_cells,
    result_headings,
    table,
    whole_part_lines,
)
from truestand.report.notation import (
    NONE,
    limit_text,
    number,
    prose,
    result_text,
    symbol,
    u_text,
    value_text,
    verdict_text,
)
from truestand.report.true_values import FLANKS, Key

MEAN_TRACES, WORST_SECTIONS = (tuple(name + behind for name in PER_TOOTH) for behind in (AREAL, WORST))
GROUPS = (
    ("Pitch", ("f_p", "F_p", "F_pk", "f_u", "f_p_areal", "F_p_areal")),
    ("Profile: mean of all teeth", ("F_alpha", "f_falpha", "f_Halpha", "C_alpha")),
    ("Helix: mean of all teeth", ("F_beta", "f_fbeta", "f_Hbeta", "C_beta")),
    ("Whole flanks: mean of all teeth", MEAN_TRACES),
    ("Whole flanks: worst section of any tooth", WORST_SECTIONS),
)
MOST_DEFECTS = 20
"""Defects listed openly, and numbered on the maps."""
MOST_LINES = 12
"""Lines that damage touches, listed openly."""
AS_READ_NOTE = (
    "<p>Single pitches and positions are as they were read, without <i>U</i>; that of each flank's figures stands in "
    "the record and in the CSV.</p>"
)
PUBLISHED = ("f_p", "F_p", "F_pk", "f_u")

ByFlank = dict[str | None, Characteristic]


def _by_name(lines: Iterable[Characteristic]) -> dict[str, ByFlank]:
    """Lines by name and flank, in their order."""
    found: dict[str, ByFlank] = {}
    for c in lines:
        found.setdefault(c.name, {})[c.flank] = c
    return found


def flank_table(inspection: Inspection, values: Mapping[Key, float] | None) -> str:
    """Pitch, profile and helix of the whole gear, left and right side by side."""
    by_name = {n: p for n, p in _by_name(whole_part_lines(inspection)).items() if None not in p}
    width = 6 + (2 if values is not None else 0)
    grouped = [*GROUPS, ("Other", tuple(n for n in by_name if not any(n in names for _, names in GROUPS)))]
    body = ""
    for title, names in grouped:
        rows = "".join(_flank_row(by_name[n], values, width) for n in names if n in by_name)
        body += f'<tr class="group"><th colspan="{2 + 2 * width}">{title}</th></tr>{rows}' if rows else ""
    columns = result_headings(values is not None, grade=True)
    head = (
        f'<tr><th></th><th></th><th class="side" colspan="{width}">left flanks</th>'
        f'<th class="side" colspan="{width}">right flanks</th></tr>'
        f'<tr><th></th><th class="n">limit</th>{columns}{columns}</tr>'
    )
    return table(head, body, "results") if body else ""


def _flank_row(pair: ByFlank, values: Mapping[Key, float] | None, width: int) -> str:
    either = next(iter(pair.values()))
    cells = "".join(
        result_cells(pair[f], values, grade=True) if f in pair else cell(NONE, "gap", width) for f in FLANKS
    )
    return f"<tr>{name_cell(either)}{cell(limit_text(either))}{cells}</tr>"


def gear_table(inspection: Inspection, values: Mapping[Key, float] | None) -> str:
    """What both flanks tell together: run-out and sizes."""
    lines = [c for c in whole_part_lines(inspection) if c.flank is None]
    body = "".join(f"<tr>{name_cell(c)}{cell(limit_text(c))}{result_cells(c, values, grade=True)}</tr>" for c in lines)
    head = f'<tr><th></th><th class="n">limit</th>{result_headings(values is not None, grade=True)}</tr>'
    return table(head, body, "results") if body else ""


def _teeth(inspection: Inspection) -> dict[tuple[str, str | None], list[Characteristic]]:
    found: dict[tuple[str, str | None], list[Characteristic]] = {}
    for c in inspection.characteristics:
        if c.tooth is not None:
            found.setdefault((c.name, c.flank), []).append(c)
    return found


def worst_teeth(inspection: Inspection) -> str:
    """For each characteristic the tooth that is farthest off, and how many fail."""
    lines = _teeth(inspection)
    body = ""
    for name in dict.fromkeys(n for n, _ in lines):
        sides = [lines.get((name, f), []) for f in FLANKS]
        either = next(side[0] for side in sides if side)
        body += f"<tr>{name_cell(either)}{cell(limit_text(either))}{''.join(_worst(side) for side in sides)}</tr>"
    columns = '<th class="n first">tooth</th>' + headings(["value", U_HEAD, "class"]) + "<th>verdict</th>"
    columns += '<th class="n">✓ · ? · ✗</th>'
    head = (
        '<tr><th></th><th></th><th class="side" colspan="6">left flanks</th>'
        '<th class="side" colspan="6">right flanks</th></tr>'
        f'<tr><th></th><th class="n">limit</th>{columns}{columns}</tr>'
    )
    return table(head, body, "results") if body else ""


def _worst(lines: Sequence[Characteristic]) -> str:
    seen = [c for c in lines if c.value is not None and c.status != "not_measurable"]
    if not seen:
        return cell('<span class="none">not measurable</span>', "gap", 6)
    worst = max(seen, key=lambda c: abs(c.value or 0.0))
    counts = [sum(c.verdict == v for c in seen) for v in ("conforms", "undecided", "does_not_conform")]
    counted = " · ".join(map(str, counts)) if sum(counts) else NONE
    return (
        cell(f"<b>{worst.tooth}</b>", "n first") + cell(f"<b>{value_text(worst)}</b>") + cell(u_text(worst))
        + cell(NONE if worst.grade is None else str(worst.grade)) + cell(verdict_text(worst), "verdict-cell")
        + cell(counted)
    )  # fmt: skip


def every_tooth(inspection: Inspection) -> str:
    """Tooth by tooth, folded away: pitch, position, run-out and the flanks' figures, where ``worst_teeth`` has any."""
    lines = {(c.name, c.flank, c.tooth): c for c in inspection.characteristics if c.tooth is not None}
    numbers = sorted({tooth for _, _, tooth in lines if tooth is not None})
    names = [n for n in PER_TOOTH if any(key[0] == n for key in lines)]
    columns = [(n, f) for n in names for f in FLANKS]
    pitch = _pitches(inspection.evidence)
    body = ""
    for tooth in numbers:
        cells = "".join(cell(text) for text in pitch.get(tooth, ()))
        body += f"<tr>{cell(str(tooth))}{cells}{''.join(_single(lines.get((n, f, tooth))) for n, f in columns)}</tr>"
    titles = [("<i>f</i><sub>pi</sub>", 2), ("<i>F</i><sub>i</sub>", 2), ("ball", 1)] if pitch else []
    titles += [(symbol(n), 2) for n in names]
    first = "".join(f'<th class="side" colspan="{span}">{title}</th>' for title, span in titles)
    second = "".join(headings(FLANKS if span == 2 else ["out"]) for _, span in titles)
    head = f'<tr><th></th>{first}</tr><tr><th class="n">tooth</th>{second}</tr>'
    return f"<details><summary>Every tooth (µm)</summary>{AS_READ_NOTE}{table(head, body, 'teeth')}</details>"


def _pitches(evidence: Any) -> dict[int, tuple[str, ...]]:
    """f_pi left and right, F_i left and right, radial place of the ball, um, as they were read."""
    if not isinstance(evidence, GearEvidence):
        return {}
    m = evidence.measures
    return {
        k + 1: tuple(
            number(um(float(v)), 1)
            for v in (m.pitch[0, k], m.pitch[1, k], m.index[0, k], m.index[1, k], m.runout[k])
        )
        for k in range(m.runout.size)
    }  # fmt: skip


def _single(c: Characteristic | None) -> str:
    if c is None or c.value is None:
        return cell(NONE, "n none")
    mark = {"does_not_conform": " bad", "undecided": " open"}.get(c.verdict or "", "")
    return cell(number(um(c.value), 1), f"n{mark}")


def damage_table(inspection: Inspection) -> str:
    """Each line that damage touches beside what it would read without it, farthest apart first."""
    with_damage = {(c.name, c.flank, c.tooth): c for c in inspection.characteristics}
    pairs = [(with_damage[c.name, c.flank, c.tooth], c) for c in inspection.without_damage]
    pairs.sort(key=lambda pair: -abs((pair[0].value or 0.0) - (pair[1].value or 0.0)))
    rows = [_damage_row(*pair) for pair in pairs]
    head = "<tr><th></th><th>flank</th>" + headings(["tooth", "limit", "value", U_HEAD]) + "<th>verdict</th>"
    head += headings(["without damage"]) + "<th>damage</th></tr>"
    text = table(head, "".join(rows[:MOST_LINES]), "results") if rows else ""
    more = len(rows) - MOST_LINES
    if more > 0:
        rest = table(head, "".join(rows[MOST_LINES:]), "results")
        text += f"<details><summary>{more} more, less touched</summary>{rest}</details>"
    return text


def _damage_row(c: Characteristic, without: Characteristic) -> str:
    place = cell(NONE if c.tooth is None else str(c.tooth))
    numbers = f"{cell(limit_text(c))}{cell(f'<b>{value_text(c)}</b>')}{cell(u_text(c))}"
    verdict = cell(verdict_text(c), "verdict-cell")
    where = f"<td>{prose(c.reason or '')}</td>"
    return (
        f"<tr>{name_cell(c)}<td>{c.flank or NONE}</td>{place}{numbers}{verdict}{cell(value_text(without))}{where}</tr>"
    )


def published_table(inspection: Inspection) -> str:
    """The published compensation's figures beside ours."""
    ours = {(c.name, c.flank): c for c in whole_part_lines(inspection)}
    body = ""
    for name in PUBLISHED:
        pair = [ours.get((name, f)) for f in FLANKS]
        theirs = [inspection.published.get(f"{name} {f}") for f in FLANKS]
        either = next((c for c in pair if c is not None), None)
        if either is None or all(value is None for value in theirs):
            continue
        cells = ""
        for c, value in zip(pair, theirs, strict=True):
            cells += cell(number(None if value is None else um(value), 0), "n first")
            cells += cell(result_text(c) if c is not None and c.value is not None else NONE)
        body += f"<tr>{name_cell(either)}{cell(limit_text(either))}{cells}</tr>"
    columns = '<th class="n first">published</th><th class="n">here ± <i>U</i><small>k = 2</small></th>'
    head = (
        '<tr><th></th><th></th><th class="side" colspan="2">left flanks</th><th class="side" colspan="2">right flanks'
        f'</th></tr><tr><th></th><th class="n">limit</th>{columns}{columns}</tr>'
    )
    return table(head, body, "results narrow") if body else ""


def defect_table(inspection: Inspection) -> str:
    """What stands out, numbered as on the maps; a long list is folded after its first lines."""
    defects = inspection.defects
    if not defects:
        return '<p class="nothing">None found.</p>'
    second = any(d.second_score is not None for d in defects)
    rows = [_defect_row(i, d, second) for i, d in enumerate(defects, 1)]
    head = '<tr><th class="n">no.</th><th>kind</th><th class="n">tooth</th><th>flank</th>' + headings(
        ["roll length (mm)", "height (mm)", "depth (µm)", "extent (mm)", "score (σ)", *(["second score"] * second)]
    )
    text = table(f"{head}</tr>", "".join(rows[:MOST_DEFECTS]), "defects")
    more = len(rows) - MOST_DEFECTS
    if more > 0:
        rest = table(f"{head}</tr>", "".join(rows[MOST_DEFECTS:]), "defects")
        text += f"<details><summary>{more} more, less striking</summary>{rest}</details>"
    return text


def _defect_row(i: int, d: Defect, second: bool) -> str:
    return (
        f"<tr>{cell(str(i))}<td>{escape(d.kind)}</td>{cell(NONE if d.tooth is None else str(d.tooth))}"
        f"<td>{d.flank or 'whole tooth'}</td>{cell(number(d.roll_length, 2))}{cell(number(d.height, 2))}"
        f"{cell(number(None if d.depth is None else um(d.depth), 1))}{cell(number(d.extent, 2))}"
        f"{cell(number(d.score, 1))}{cell(number(d.second_score, 3)) if second else ''}</tr>"
    )
