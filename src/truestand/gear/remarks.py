"""What an inspection of a gear says beside its figures: what was not seen, what is damaged, and what the gear says
about the stand.
"""

from collections.abc import Sequence
from math import cos

import numpy as np

from truestand.core.message import Message
from truestand.core.robust import nan_median
from truestand.core.scan import Scan
from truestand.gear.blind import BlindStrip, blind_strips
from truestand.gear.coverage import Coverage
from truestand.gear.damage import Damage
from truestand.gear.evaluate import Measures, mean_seen, slope_length
from truestand.gear.flanks import Flanks, Toothing
from truestand.gear.geometry import FLANKS, Involute
from truestand.gear.grid import FINE_STEP, profiles_for, step_on_flank
from truestand.gear.teeth import Diameter
from truestand.gear.traces import profile_points
from truestand.gear.views import GearView, joined
from truestand.uncertainty.lines import once_per_turn

SHORT_FACE = 0.6
"""mm by which the flanks seen may end before the drawing's face does without a word."""
OTHER_DIAMETER = 0.1
"""Modules by which tip and root may be larger or smaller than drawn without a word."""
OTHER_THICKNESS = 0.06
"""Modules by which teeth may be thicker or thinner than drawn without a word: backlash is made so."""
MOST_REGIONS = 12
"""Damaged regions that are named."""
OR_THE_GEAR = "or the gear is made so"
TIP, NOTICEABLE_CHAMFER = 0.1, 0.02
"""Share of a profile at its upper end, and mm by which most teeth may fall away there without a word."""
MOST_APART = 0.005
"""mm, rms, by which the passes of a flank may differ by a recorded angle, beside what its U allows."""
NOTICEABLE_SLOPE = 0.003
"""mm of mean slope below which nothing is said."""


def remarks_of(
    views: Sequence[GearView],
    coverage: Coverage,
    damage: tuple[Damage, ...],
    measures: Measures,
    diameters: tuple[Diameter, ...],
) -> tuple[Message, ...]:
    """All remarks, in the order of the report."""
    flanks = joined([view.flanks for view in views], views)
    nominal = flanks.toothing.nominal
    return (
        *_sides_not_seen(coverage),
        *_limitations([view.scan for view in views], nominal),
        *_blind_points(views),
        *_damaged(damage),
        *_short_face(flanks),
        *_other_diameters(diameters, nominal),
        *(_other_thickness(flanks.toothing) if coverage.sides_tied else ()),
        *dict.fromkeys(remark for view in views for remark in _angle_source(view)),
        *_slopes(measures, nominal),
        *_chamfered_tips(measures, nominal),
    )


def unevenness(view: GearView) -> tuple[Message, ...]:
    """Why nothing is decided where the table turned unevenly; empty where it did not."""
    if view.uneven_rms is None or view.unrepeated:
        return ()
    text = (
        f"the table turned unevenly: passes of one flank are {1000 * view.uneven_rms:.1f} um (rms) apart, pitch "
        "may be wrong by as much and more: record the table's angle, or turn it steadily"
    )
    return (Message("table_uneven", text),)


def contradicting_turns(view: GearView) -> tuple[Message, ...]:
    """Why nothing is decided where flanks pass at another angle when they pass again; empty where they don't."""
    _, U = once_per_turn(view.scan)
    allowed = MOST_APART + U * view.flanks.toothing.nominal.base_radius
    if view.unrepeated:
        what = "flanks that pass twice are mostly not found where they passed before"
        why = "the table's speed or [scan] counts_per_turn is another one"
    elif view.apart_rms is not None and view.apart_rms > allowed:
        what = f"passes of one flank are {1000 * view.apart_rms:.1f} um (rms) apart, {1000 * allowed:.1f} at most"
        why = "the recorded angle jumped, [scan] counts_per_turn is another one, or part or sensor moved"
    else:
        return ()
    return (Message("turns_contradict", f"turns contradict each other: {what}; {why}: scan again"),)


def _sides_not_seen(coverage: Coverage) -> tuple[Message, ...]:
    if not coverage.position.any():
        text = (
            "hardly any of the flanks was seen near the middle of the face: check face_from_mm, the sensor's height "
            "and its fan"
        )
        return (Message("flanks_not_seen", text),)
    return tuple(
        Message(
            "side_not_seen",
            f"the {flank} flanks were not seen: the camera looks from the other side; scan once more with the gear "
            "turned over (--part-turned 0,over), or with a second sensor",
        )
        for side, flank in enumerate(FLANKS)
        if not coverage.position[side].any()
    )


def _limitations(scans: Sequence[Scan], nominal: Involute) -> tuple[Message, ...]:
    found = []
    if nominal.gear.accuracy_class is None and not nominal.gear.limits and not nominal.gear.classes:
        text = "no line has a limit: measured, not judged; add accuracy_class to the recipe"
        found.append(Message("no_limits", text))
    coarse = float(step_on_flank(nominal, nominal.control_roll, max(abs(scan.step) for scan in scans)))
    if coarse > 4 * FINE_STEP:
        enough = profiles_for(nominal, max(nominal.control_roll, 3.0))
        text = (
            f"coarse near the root: one profile a {coarse:.1f} mm of roll length at its lower end; {enough} profiles a "
            f"turn would make it {FINE_STEP:g} mm from 3 mm up; damage narrower than a step may not be seen: "
            "narrowest_damage_mm in the recipe says what must not escape"
        )
        found.append(Message("coarse_near_root", text))
    if nominal.gear.helix_angle and min(scan.revolutions for scan in scans) < 1:
        found.append(Message("less_than_a_turn", "less than a turn: teeth at the ends of the scan are seen in part"))
    return tuple(found)


def _blind_points(views: Sequence[GearView]) -> tuple[Message, ...]:
    """The widest strip of each view in which its sensor is blind."""
    named = ((f"view {view.name!r}: " if len(views) > 1 else "", blind_strips(view)) for view in views)
    return tuple(_blind_in(strips).prefixed(name) for name, strips in named if strips)


def _blind_in(strips: tuple[BlindStrip, ...]) -> Message:
    widest, number = max(strips, key=lambda s: s.width), sum(s.number for s in strips)
    first, last = widest.first + 1, widest.first + widest.number
    which = f"point {first} of the sensor sees" if first == last else f"points {first} to {last} of the sensor see"
    in_all = f" ({number} in all)" if number > widest.number else ""
    where = f"no flank is seen at heights {widest.bottom:.1f} to {widest.top:.1f} mm, damage there does not show"
    return Message("points_blind", f"{which} nothing{in_all}: {where}")


def _damaged(damage: tuple[Damage, ...]) -> tuple[Message, ...]:
    """Damage of flanks: what was not seen and the deepest first."""
    gravest = sorted(damage, key=lambda d: -1e9 if d.depth is None else -abs(d.depth))
    more = len(damage) - MOST_REGIONS
    named = tuple(
        Message("damage", f"{'not seen' if d.depth is None else 'damage'}: {d.text}") for d in gravest[:MOST_REGIONS]
    )
    return (*named, Message("more_damage", f"{more} more regions of flanks are damaged")) if more > 0 else named


def _short_face(flanks: Flanks) -> tuple[Message, ...]:
    g = flanks.toothing.nominal.gear
    bottom, top = float(flanks.height.min()), float(flanks.height.max())
    if bottom - g.face_from < SHORT_FACE and g.face_to - top < SHORT_FACE:
        return ()
    text = (
        f"flanks were seen from height {bottom:.1f} to {top:.1f} mm, the drawing's face is {g.face_from:g} to "
        f"{g.face_to:g} mm: check face_from_mm and face_width_mm, or part of it is out of view"
    )
    return (Message("short_face", text),)


def _other_diameters(diameters: tuple[Diameter, ...], nominal: Involute) -> tuple[Message, ...]:
    """Tip and root that are not the drawing's, where it has no limits for them."""
    g, found = nominal.gear, []
    for d, what, key, drawn in zip(
        diameters, ("tip", "root"), ("tip_diameter_mm", "root_diameter_mm"), (g.tip_diameter, g.root_diameter),
        strict=True,
    ):  # fmt: skip
        if d.name not in g.limits and abs(d.value - drawn) > OTHER_DIAMETER * g.module + d.U:
            text = f"the {what} diameter is {d.value:.2f} mm, the drawing's is {drawn:g} mm: check {key}"
            found.append(Message("other_diameter", text))
    return tuple(found)


def _other_thickness(toothing: Toothing) -> tuple[Message, ...]:
    """Teeth that are thicker or thinner than another profile shift would make them by slip."""
    nominal = toothing.nominal
    left, right = mean_seen(toothing.offsets.reshape(2, -1))
    thicker = float(left + right) * nominal.arc_per_delta
    if not abs(thicker) > OTHER_THICKNESS * nominal.gear.module:  # NaN: one side was not seen
        return ()
    how = "thicker" if thicker > 0 else "thinner"
    text = (
        f"the teeth are {abs(thicker):.3f} mm {how} than drawn, on the measuring circle: check profile_shift, or state "
        "limits for s_mm"
    )
    return (Message("other_thickness", text),)


def _angle_source(view: GearView) -> tuple[Message, ...]:
    scan, before, after = view.scan, view.before_rms, view.after_rms
    if scan.angle_source in ("angle", "encoder"):
        return ()
    remark = "the angle comes from a steady speed"
    if before is not None and after is not None and after < before:
        remark += (
            f"; {scan.revolutions:.2f} turns freed it of {1000 * before:.1f} um (rms) that don't repeat every turn"
        )
    elif scan.revolutions < 2:
        remark += "; two turns and more would tell it from uneven turning"
    text = f"{remark}; what repeats every turn looks like pitch and stands in U: an encoder would settle it"
    return (Message("angle_from_speed", text),)


def _slopes(m: Measures, nominal: Involute) -> tuple[Message, ...]:
    """Mean slopes that point at the stand, alike or opposite on both sides; none where a side was not seen.

    A lateral offset h of the laser plane reads +-h cos(alpha_y) on the flanks, a radial zero off by dr reads
    dr sin(alpha_y), a skew eps of the laser line tilts the helices by +-eps b cos(alpha). A gear can have such slopes
    of its own, so these are remarks: they say which number of the calibration to look at first.
    """
    (left, right), (helix_left, helix_right) = (mean_seen(m.of_flank[n]) for n in ("f_Halpha", "f_Hbeta"))
    if not np.isfinite([left, right, helix_left, helix_right]).all():
        return ()
    found = []
    opposite, alike, skew = (left - right) / 2, (left + right) / 2, (helix_left - helix_right) / 2
    if abs(opposite) > NOTICEABLE_SLOPE:
        h = abs(opposite / _profile_slope(nominal, np.cos))
        text = (
            f"profile slopes are opposite on both sides by {1000 * abs(opposite):.1f} um, as with a laser plane "
            f"{1000 * h:.0f} um beside where the calibration has it"
        )
        found.append(Message("profile_slopes_opposite", f"{text}; {OR_THE_GEAR}"))
    if abs(alike) > NOTICEABLE_SLOPE:
        dr = alike / _profile_slope(nominal, np.sin)
        text = (
            f"profile slopes are alike on both sides by {1000 * alike:.1f} um, as with a radial zero "
            f"{1000 * dr:.0f} um off"
        )
        found.append(Message("profile_slopes_alike", f"{text}; {OR_THE_GEAR}"))
    if abs(skew) > NOTICEABLE_SLOPE:
        eps = abs(skew) / (slope_length(nominal, along_profile=False) * cos(nominal.transverse_pressure))
        text = (
            f"helix slopes are opposite on both sides by {1000 * abs(skew):.1f} um, as with a laser line skew by "
            f"{1000 * eps:.2f} mrad"
        )
        found.append(Message("helix_slopes_opposite", f"{text}; {OR_THE_GEAR}"))
    return tuple(found)


def _profile_slope(nominal: Involute, wave: np.ufunc) -> float:
    """Slope deviation that 1 mm of wave(alpha_y) reads."""
    roll = np.linspace(*nominal.profile_range, 100)
    line = np.polyfit(roll, wave(np.arctan(roll / nominal.base_radius)), 1)
    return float(line[0]) * slope_length(nominal, along_profile=True)


def _chamfered_tips(m: Measures, nominal: Involute) -> tuple[Message, ...]:
    """Profiles that most teeth of a side have falling away at the end of their range: figures and defects read it."""
    points, found = profile_points(nominal), []
    below = points < points[-1] - TIP * (points[-1] - points[0])
    for flank, profiles in zip(FLANKS, m.profile, strict=True):
        trace = nan_median(profiles, axis=0)
        if not np.isfinite(trace).all():
            continue
        rest = trace - np.polyval(np.polyfit(points[below], trace[below], 2), points)
        if -rest[-1] > NOTICEABLE_CHAMFER:
            begins = points[np.flatnonzero(rest > -NOTICEABLE_CHAMFER / 4)[-1]]
            text = (
                f"profiles of {flank} flanks fall away by {-1000 * rest[-1]:.0f} um at their upper end, from diameter "
                f"{2 * nominal.radius(begins):.2f} mm on, on most teeth: if they are chamfered there, state "
                "tip_form_diameter_mm"
            )
            found.append(Message("chamfered_tips", text))
    return tuple(found)
