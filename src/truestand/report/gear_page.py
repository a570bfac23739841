"""What a gear's report shows, in its order: tables, charts, the published method, maps, defects."""

from math import degrees, pi

import numpy as np

from truestand.core.inspection import Inspection
from truestand.gear.inspect import GearEvidence
from truestand.report import gear_figures, gear_maps, gear_tables, gear_traces
from truestand.report.page import framed
from truestand.report.true_values import Key

LEAST_JUMP = 0.3
"""Share of the pitch beyond which a step between neighbouring teeth is no pitch deviation."""


def gear_facts(e: GearEvidence) -> list[str]:
    """The drawing in a line."""
    g = e.nominal.gear
    facts = [f"{g.teeth} teeth", f"module {g.module:g} mm", f"pressure angle {degrees(g.pressure_angle):g}°"]
    if g.helix_angle:
        facts.append(f"helix {abs(degrees(g.helix_angle)):g}° {'right' if g.helix_angle > 0 else 'left'} hand")
    else:
        facts.append("spur")
    facts += [f"profile shift {g.profile_shift:g}"] if g.profile_shift else []
    facts.append(f"face {g.face_width:g} mm")
    return facts + ([f"class {g.accuracy_class} of {g.standard}"] if g.accuracy_class is not None else [])


def gear_parts(inspection: Inspection, values: dict[Key, float] | None) -> list[str]:
    """Everything between head and budget."""
    e = inspection.evidence
    if not isinstance(e, GearEvidence):
        return [_results(inspection, values), _defects(inspection)]
    return [
        _results(inspection, values), _charts(inspection, e), _pitch(inspection, e), _published(inspection, e),
        _maps(inspection, e), _defects(inspection) + _defect_maps(inspection, e),
    ]  # fmt: skip


def _results(inspection: Inspection, values: dict[Key, float] | None) -> str:
    text = "<h2>Results</h2>"
    if any(c.limits is not None and c.value is not None and c.tooth is None for c in inspection.characteristics):
        text += framed(
            gear_figures.limits_used(inspection),
            "How much of each limit is used. A line conforms when its bar ends clearly left of 100 %, does not when it "
            "begins clearly right of it; a bar across the limit is undecided.",
        )
    text += gear_tables.flank_table(inspection, values)
    together = gear_tables.gear_table(inspection, values)
    text += f"<h3>Both flanks together</h3>{together}" if together else ""
    worst = gear_tables.worst_teeth(inspection)
    if worst:
        text += (
            "<h3>Worst tooth of each characteristic</h3><p>The last column counts the teeth that conform · are "
            f"undecided · do not conform.</p>{worst}{gear_tables.every_tooth(inspection)}"
        )
    touched = gear_tables.damage_table(inspection)
    if touched:
        text += (
            "<h3>Lines that damage touches</h3><p>Figures hold the damage that was found; what they would read without "
            f"it is for information.</p>{touched}"
        )
    return text


def _charts(inspection: Inspection, e: GearEvidence) -> str:
    how = (
        "Dashed: mean line, and the ends of the evaluation range; shaded: width of the tolerance of the total "
        "deviation. To the right: material in excess. In brackets beneath: limits."
    )
    profile = framed(gear_traces.profile_chart(inspection, e), f"Root at the bottom, tip above. {how}")
    helix = framed(gear_traces.helix_chart(inspection, e), f"Lower end of the face at the bottom. {how}")
    return f"<h2>Profile</h2>{profile}<h2>Helix</h2>{helix}"


def _pitch(inspection: Inspection, e: GearEvidence) -> str:
    return "<h2>Pitch and run-out</h2>" + framed(
        gear_figures.pitch(inspection, e),
        "Bars: each tooth against the one before it; hatched: beyond the limit. Curves: positions about their mean, as "
        "they were read; the figure at the bracket is freed of what noise adds to a range. Shaded: width of the limit.",
    )


def _published(inspection: Inspection, e: GearEvidence) -> str:
    index = e.published_index
    if index is None or not np.isfinite(index).any() or not inspection.published:
        return ""
    return (
        "<h2>What the published compensation would have said</h2><p>The same scan after the published compensation "
        "(Klarák et al., Sensors 2022, 22, 5306): it subtracts the sinusoid of the eccentricity from the radius and "
        "leaves the angle as it is. A tooth then stands where the eccentric shaft carried it, and that reads as pitch. "
        "Here the axis itself is moved. The published method states no <i>U</i>.</p>"
        + framed(
            gear_figures.published(e, index),
            "Cumulative pitch of the same gear from the same scan, about its mean. The curve of this inspection is not "
            "zero; it is that much smaller." + _jumps(inspection, e),
        )
        + gear_tables.published_table(inspection)
    )


def _jumps(inspection: Inspection, e: GearEvidence) -> str:
    """A word on teeth that the published compensation moves so far that they are taken for their neighbours."""
    pitch = pi * e.nominal.gear.module
    jumps = max(inspection.published.get(f"f_p {flank}", 0.0) for flank in ("left", "right")) > LEAST_JUMP * pitch
    return " Where its curve jumps, teeth have moved so far that they were taken for their neighbours." if jumps else ""


def _maps(inspection: Inspection, e: GearEvidence) -> str:
    teeth = e.measures.index.shape[1]
    shown = gear_maps.shown_teeth(inspection, teeth)
    text = "<h2>Flanks</h2>"
    if e.grid.seen.any():
        note = (
            f" {len(shown)} of {teeth} teeth are shown: spread evenly, and those with defects."
            if len(shown) < teeth
            else ""
        )
        text += framed(
            gear_maps.topography(inspection, e),
            "Topography: each flank from root (bottom) to tip, its face from the lower end (left) to the upper; "
            f"deviation less the tooth's position. Red: material in excess; grey: not seen.{note}",
        )
        text += framed(
            gear_maps.coverage(e),
            "Coverage: how much of the face has readings, by tooth and roll length. White: nothing seen. Dashed: "
            "evaluation range. Stripes are the gaps between profiles, which the table's steps leave near the root.",
        )
    return text


def _defects(inspection: Inspection) -> str:
    text = "<h2>Defects</h2>"
    if inspection.defects:
        text += "<p>Places and sizes are indications and carry no <i>U</i>.</p>"
    return text + gear_tables.defect_table(inspection)


def _defect_maps(inspection: Inspection, e: GearEvidence) -> str:
    text = ""
    if e.defect_map is not None and np.isfinite(e.defect_map.residual).any():
        text += framed(
            gear_maps.unrolled(inspection, e.defect_map),
            "All flanks against the median tooth: what one tooth has and its neighbours don't. Numbers as above.",
        )
    if e.folded is not None and np.isfinite(e.folded.radius).any():
        text += framed(
            gear_maps.whole_teeth(inspection, e.nominal.gear, e.folded),
            "The gear unrolled: radius against that of the median tooth. Missing teeth and broken corners are blue, "
            "burrs red.",
        )
    return text
