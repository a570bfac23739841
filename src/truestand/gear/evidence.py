"""What a gear's report draws: everything that the figures were read from. It is no part of the record."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truestand.gear.coverage import Coverage
from truestand.gear.evaluate import Measures
from truestand.gear.geometry import Involute
from truestand.gear.grid import Grid

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FoldedMap:
    """All teeth cut open and laid side by side: mean radius (teeth, places, heights) mm; NaN = not seen.

    ``places`` (n,): share of the pitch from the tooth's centre, -0.5..0.5; ``heights`` (m,) mm in C.
    """

    radius: Array
    places: Array
    heights: Array


@dataclass(frozen=True, slots=True)
class DefectMap:
    """Residual against the median tooth, (2, teeth, roll lengths, heights): mm, and its score in robust sigma."""

    residual: Array
    score: Array
    rolls: Array
    heights: Array


@dataclass(frozen=True, slots=True)
class GearEvidence:
    """Arrays are (2 flanks, teeth, ...), left first; mm."""

    nominal: Involute
    turned: float
    """Polar angle (rad, C) of the centre of tooth 1 at the middle of the face."""
    grid: Grid
    measures: Measures
    rolls: Array
    """(2, teeth, n): where the points of ``measures.profile`` lie."""
    coverage: Coverage
    folded: FoldedMap | None = None
    defect_map: DefectMap | None = None
    published_index: Array | None = None
    """F_i (2, teeth) after the published compensation."""
