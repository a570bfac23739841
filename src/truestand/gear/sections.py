"""Profiles and helices elsewhere than the standard reads them: information, beside the lines that decide.

The mean of the traces across the whole face, or up the whole profile, is quieter than the one trace of the standard;
the worst of them shows damage that this one does not cross.
"""

from dataclasses import dataclass, replace

import numpy as np

from truestand.core.arrays import Array
from truestand.gear.evaluate import (
    PER_TOOTH,
    Bias,
    Evaluator,
    Figures,
    figures_of_lines,
    helix_line,
    mean_seen,
    profile_line,
)
from truestand.gear.grid import TRACE_SHARE
from truestand.gear.smooth_flanks import shared_shape
from truestand.gear.traces import SHARED_BY, helix_of, profile_of, traces_of

OF_PROFILE = frozenset(("F_alpha", "f_falpha", "f_Halpha"))


@dataclass(frozen=True, slots=True)
class Sections:
    """Figures (``PER_TOOTH``) of all sections, mm, (2, teeth) each; NaN where not seen."""

    mean: Figures
    """Of the mean trace, freed of what noise lifts them by,"""
    worst: Figures
    """the largest of either sign among the sections, likewise,"""
    place: Figures
    """and where it was found: height (mm in C) of a profile, roll length (mm) of a helix."""


def sections_of(evaluator: Evaluator, bias: Bias, step: float) -> Sections:
    """What other sections say; ``step``: table angle from one profile to the next, rad."""
    grid, nominal = evaluator.grid, evaluator.grid.nominal
    by_flank, number = grid.delta.shape[:2], round(1 / (2 * TRACE_SHARE))
    heights, rolls = (_middles(*ends, number) for ends in (nominal.helix_range, nominal.profile_range))
    shared = shared_shape(grid.delta, evaluator.smooth, SHARED_BY)
    profiles, helices, figures = [], [], []
    for height, roll in zip(heights, rolls, strict=True):
        there = replace(evaluator, traces=traces_of(grid, evaluator.noise, shared, step, height, roll))
        profiles.append(profile_of(grid.delta, there.traces))
        helices.append(helix_of(grid.delta, there.traces))
        lines = profile_line(profiles[-1], there), helix_line(helices[-1], there)
        figures.append(bias.corrected(_per_tooth(figures_of_lines(*lines, by_flank))))
    lines = profile_line(_mean(profiles), evaluator), helix_line(_mean(helices), evaluator)
    places = {name: heights if name in OF_PROFILE else rolls for name in PER_TOOTH}
    found = {name: _worst(np.stack([f[name] for f in figures]), places[name]) for name in PER_TOOTH}
    quieter = replace(bias, lifted={name: square / number for name, square in bias.lifted.items()})
    return Sections(
        quieter.corrected(_per_tooth(figures_of_lines(*lines, by_flank))),
        {name: worst for name, (worst, _) in found.items()},
        {name: place for name, (_, place) in found.items()},
    )


def _middles(low: float, high: float, number: int) -> Array:
    return np.asarray(low + (np.arange(number) + 0.5) * (high - low) / number)


def _mean(traces: list[Array]) -> Array:
    """Mean (flanks, points) of traces, where any of them was seen."""
    return mean_seen(np.stack(traces, axis=-1))


def _per_tooth(figures: Figures) -> Figures:
    return {name: figures[name] for name in PER_TOOTH}


def _worst(values: Array, places: Array) -> tuple[Array, Array]:
    """The largest (2, teeth) of values (sections, 2, teeth) by its size, NaN aside, and its place."""
    at = np.where(np.isfinite(values), np.abs(values), -1.0).argmax(axis=0)
    worst = np.take_along_axis(values, at[None], axis=0)[0]
    return worst, np.where(np.isfinite(worst), places[at], np.nan)
