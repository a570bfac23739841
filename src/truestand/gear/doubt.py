"""What is not known of damage: in the U of each line, and what is left of its verdict.

Damage is read as it was seen. It may be deeper than that, lie on top or be a second reflection, end anywhere within a
cell of the middle of the face, or be where no reading shows anything.
"""

from dataclasses import replace
from math import hypot, sqrt

import numpy as np

from truestand.core.calibration import Contribution
from truestand.core.inspection import Characteristic, Verdict, decided
from truestand.gear.assess import Assessment
from truestand.gear.damage import Damage, Zone, damage_in
from truestand.gear.evaluate import AREAL, MEAN, MEANS, PITCH, PROFILE_NAMES
from truestand.gear.gaps import gap_with_damage, without_reading

SIZES = ("s", "W_k", "M_d")
AT_BALL = frozenset({"F_r", "M_d"})
FORMS = frozenset({"F_alpha", "f_falpha", "F_beta", "f_fbeta"})
"""What grows with every damage."""
ON_TOP = "on top of a flank, or a second reflection"
NOT_SEEN = "damage that was not seen whole"
EDGES = "edges of damage in the middle of the face"
HIDDEN = "damage like that found elsewhere, where nothing was seen"


def with_damage(line: Characteristic, a: Assessment, name: str, at: tuple[int, ...]) -> Characteristic:
    """The line with what is not known of damage in its U, and the verdict that is left of it: of damage that it reads,
    and of such as may be where nothing was seen.
    """
    regions, gap = touching(a, line.name, at), gap_with_damage(line, a, name, at)
    if not regions:
        line = _borne_out_by_nothing(line)
        if line.status == "partial" and line.name in MEANS:
            line = replace(line, reason=without_reading(line, a, gap))
            if line.name not in FORMS and line.verdict == "does_not_conform":
                line = replace(line, verdict="undecided")  # what was not seen may make a slope better
        if not gap.depth:
            return line
    value = line.value or 0.0
    without_top = float(a.without_top[name][at]) if any(d.on_top for d in regions) else value
    half_widths = {
        ON_TOP: abs(value - (without_top if np.isfinite(without_top) else 0.0)),
        EDGES: _edges(regions, a, name) * _per_delta(name, a),
        NOT_SEEN: _unknown_depth(regions, a, name) * _per_delta(name, a),
        HIDDEN: (gap.depth / a.teeth if name.endswith(MEAN) else gap.depth) * _per_delta(name, a),
    }
    causes = [Contribution(c, 2 * half / sqrt(3.0), half / sqrt(3.0), "rectangular") for c, half in half_widths.items()]
    budget = tuple(sorted((*line.budget, *(c for c in causes if c.U)), key=lambda c: -c.U))
    wider = replace(line, grade=None, U=hypot(*(c.U for c in budget)), budget=budget)
    if line.verdict is not None:
        if regions:
            line = decided(replace(line, U=hypot(line.U or 0.0, *(c.U for c in causes if c.name == EDGES))))
        material_gone = not regions or any((d.depth or 0.0) > 0 for d in regions)
        wider = replace(decided(wider), verdict=_verdict(line, wider, without_top, material_gone))
    return replace(wider, reason=_gravest(regions, wider.verdict) if regions else without_reading(line, a, gap))


def _gravest(regions: tuple[Damage, ...], verdict: Verdict | None) -> str:
    """What is gravest for a verdict: what was seen where the line fails for it, else what was not."""
    failing = verdict == "does_not_conform" and any(d.depth for d in regions)
    gravest = max(
        regions, key=lambda d: (not failing and d.hidden, not failing and not d.resolved, abs(d.depth or 0.0))
    )
    return gravest.text


def _borne_out_by_nothing(line: Characteristic) -> Characteristic:
    """The line; form that fails where no region shows why must fail at twice its noise: pairs of outliers do that."""
    if line.verdict != "does_not_conform" or line.name not in FORMS or line.U is None:
        return line
    return replace(line, verdict=decided(replace(line, U=hypot(line.U, sqrt(3.0) * noise_of(line)))).verdict)


def noise_of(line: Characteristic) -> float:
    """U (k = 2, mm) of noise in a line's budget."""
    return next((c.U for c in line.budget if c.name == "noise"), 0.0)


def _edges(regions: tuple[Damage, ...], a: Assessment, name: str) -> float:
    """By how much (mm) delta may be off, where a figure is the mean of the middle of the face, because edges of damage
    run there: each may lie half a cell elsewhere, and a range has two of them at either end.
    """
    if _zone(name.removesuffix(MEAN)) in ("helix", "area"):
        return 0.0
    deepest = 2 * a.edge_share * max((abs(d.depth or 0.0) for d in regions if d.ends_at_middle), default=0.0)
    return deepest / a.teeth if name.endswith(MEAN) or name in SIZES else deepest


def _unknown_depth(regions: tuple[Damage, ...], a: Assessment, name: str) -> float:
    """By how much (mm) delta may be off, where a figure reads it, because damage may be deeper than it was seen.

    As deep as half a tooth where its bottom is hidden, by as much again where few profiles cross it, or a helix has no
    point. Areal figures read the smooth flank, which damage has no part in.
    """
    if name.endswith(AREAL):
        return 0.0
    helix = _zone(name.removesuffix(MEAN)) == "helix"
    depths = [
        a.nominal.thickness / 2 if d.hidden else 0.0 if d.resolved and not (helix and d.unread) else abs(d.depth or 0.0)
        for d in regions
    ]
    mean = name.endswith(MEAN) or name in SIZES
    return sum(depths) / a.teeth if mean else max(depths, default=0.0)


def _per_delta(name: str, a: Assessment) -> float:
    """By how much a figure may follow delta where it is read; a slope, on half of a flank."""
    plain = name.removesuffix(MEAN)
    if plain in PITCH or plain == "s":
        return a.nominal.arc_per_delta * (2.0 if plain == "f_u" else 1.0)
    at_ball = a.nominal.runout_per_delta
    others = {
        "F_r": at_ball, "M_d": 2 * at_ball, "W_k": a.nominal.normal_per_delta,
        "f_Halpha": 1.5, "f_Hbeta": 1.5,
    }  # fmt: skip
    return others.get(plain, 1.0)


def _verdict(line: Characteristic, wider: Characteristic, without_top: float, material_gone: bool) -> Verdict | None:
    """The verdict of a line that damage makes ``wider``.

    What lies on top may be a second reflection: with it and without, the line must say the same. Forms and totals are
    no less than what was seen, where readings show that material is gone: what was not seen makes them no better.
    """
    if not np.isfinite(without_top) or decided(replace(line, value=without_top)).verdict != line.verdict:
        return "undecided"
    if line.verdict == "does_not_conform" and line.name in FORMS and material_gone:
        return line.verdict
    return decided(wider).verdict


def touching(a: Assessment, name: str, at: tuple[int, ...]) -> tuple[Damage, ...]:
    """The damage that a figure reads."""
    side, tooth = (*at, None, None)[:2]
    return damage_in(a.damage, a.zones[_zone(name)], side, tooth)


def _zone(name: str) -> Zone:
    if name.endswith(AREAL):
        return "area"
    if name in AT_BALL:
        return "ball"
    return "profile" if name in PROFILE_NAMES else "helix" if name in MEANS else "position"
