"""The figures of a gear with every line of their budget: of a scan that was taken, or of one that is planned."""

from dataclasses import dataclass

from truestand.core.arrays import Array, Mask
from truestand.gear.budget import BETWEEN_READINGS, expanded
from truestand.gear.coverage import Coverage
from truestand.gear.damage import Damage, Zone, clear_of, without_damage, zones_of
from truestand.gear.evaluate import (
    DRAWS,
    FEW_DRAWS,
    ROUGHNESS,
    VIBRATION,
    Evaluator,
    Figures,
    Measures,
    bias_of,
    evaluate,
    evaluator_of,
    figures_of,
    roughness_of,
    sampling_of,
    steepness_of,
    vibration_of,
    with_noise_beside,
)
from truestand.gear.geometry import Involute
from truestand.gear.grid import TRACE_SHARE
from truestand.gear.sections import Sections, sections_of
from truestand.gear.seen_flanks import Influence


@dataclass(frozen=True, slots=True)
class Assessment:
    """Figures (mm) and by how much each input of the budget may move them (U, k = 2)."""

    nominal: Involute
    figures: Figures
    without_damage: Figures
    """The same as if no reading had fallen on damage,"""
    without_top: Figures
    """or on what lies on top of a flank."""
    expanded: dict[str, Figures]
    """U by the name of the input."""
    influences: tuple[Influence, ...]
    coverage: Coverage
    damage: tuple[Damage, ...]
    told: tuple[Damage, ...]
    """Those of them that show in readings, or in rays that should have met the flank and didn't: no mere gaps."""
    zones: dict[Zone, Mask]
    """From which cells (roll lengths, heights) figures are read."""
    there: Mask
    """(teeth,): but for those that the drawing leaves out."""
    sections: Sections | None
    """None: only the sections that the standard reads."""
    cell_height: float
    """mm."""

    @property
    def teeth(self) -> int:
        """How many are there, one at least."""
        return max(int(self.there.sum()), 1)

    @property
    def edge_share(self) -> float:
        """Half a cell's height over the height of the middle of the face."""
        return self.cell_height / (4 * TRACE_SHARE * self.nominal.gear.face_width)

    @property
    def open_end(self) -> float:
        """mm before the end of its range at which a helix that was seen to its end may have its last point."""
        return self.cell_height / 2


def assess(
    influences: tuple[Influence, ...],
    evaluator: Evaluator,
    step: float,
    measures: Measures,
    coverage: Coverage,
    told: tuple[Damage, ...],
    gaps: tuple[Damage, ...],
    there: Mask,
    planned: Array | None = None,
) -> Assessment:
    """The figures, freed of the bias of noise, with every line of their budget.

    ``influences``: every input of the budget but noise; ``told``: damage that shows; ``gaps``: what was not seen;
    ``there`` (teeth,): those that the drawing has; ``planned``: of one of several imagined scans, which share the draws
    of noise, and of which no other sections are read: how further gears stand ``otherwise`` (``expanded``).
    """
    nominal, damage = evaluator.grid.nominal, (*told, *gaps)
    figures = figures_of(measures, nominal)
    if (damaged := clear_of(damage, evaluator.grid)).any():
        evaluator = with_noise_beside(damaged, evaluator, step)
    noise = bias_of(figures, evaluator, DRAWS if planned is None else FEW_DRAWS)
    corrected, on_top = noise.corrected(figures), tuple(d for d in damage if d.on_top)
    return Assessment(
        nominal,
        corrected,
        _without(damage, evaluator, step) if any(d.depth for d in damage) else corrected,
        _without(on_top, evaluator, step) if on_top else corrected,
        expanded(influences, evaluator, planned)
        | {
            "noise": noise.expanded(figures, steepness_of(evaluator)),
            BETWEEN_READINGS: sampling_of(evaluator),
            ROUGHNESS: roughness_of(corrected, evaluator),
            VIBRATION: vibration_of(figures, corrected, evaluator),
        },
        influences,
        coverage,
        damage,
        told,
        zones_of(evaluator.grid, step),
        there,
        sections_of(evaluator, noise, step) if planned is None else None,
        evaluator.grid.size[1],
    )


def _without(damage: tuple[Damage, ...], evaluator: Evaluator, step: float) -> Figures:
    """The figures, freed of the bias of noise, as if no reading had fallen on the damage."""
    sound = evaluator_of(without_damage(evaluator.grid, damage), step)
    figures = figures_of(evaluate(sound.grid.delta, sound), sound.grid.nominal)
    return bias_of(figures, sound, FEW_DRAWS).corrected(figures)
