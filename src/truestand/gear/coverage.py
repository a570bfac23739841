"""What was seen of each flank: of its area, of its traces, of its position.

Between two profiles nothing can be seen: what lies within half a step of the table of a reading counts as covered. How
wide the widest gap is stands beside it: damage may hide there.
"""

from dataclasses import dataclass

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.gear.evaluate import Evaluator, Measures
from truestand.gear.grid import Grid, bridge_gaps, step_on_flank
from truestand.gear.traces import Traces, helix_points, profile_points

NEAR_MIDDLE = 0.15
"""Share of control length and face about the middle of the measuring circle that must be seen for a position."""
NARROWEST = 1.0
"""mm of a trace without a reading in which damage may hide, unless the drawing says otherwise."""
LEAST_SEEN = 0.2
"""Share of a row or column of cells that makes a point of a trace."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """Shares 0..1, (2, teeth), and what of the traces has no reading."""

    position: Array
    """Whether the tooth's position was seen: 0 or 1."""
    profile: Array
    """Of its area along the roll length, or of the trace at mid-face where less was seen of it."""
    helix: Array
    """Of its area along the height, or of the trace on the measuring circle."""
    profile_rolls: Array
    """(2, teeth, n) mm: where readings at mid-face lie along the profile, its ends included."""
    helix_gap: Array
    """mm: what of the helix was not seen, along the height, or across the measuring circle if the readings beside it
    lie farther apart."""
    helix_ends: Array
    """(2 ends, 2, teeth) mm of height between the ends of the range, lower and upper, and the nearest points."""
    helix_blind: Array
    """(2, teeth) mm of height, in one stretch, for which the sensor's points are blind."""
    hidden: Mask
    """(2,): sides of whose profiles no tooth shows a part that rays should meet, or the lower end."""
    sides_tied: bool = True
    """Whether left and right flanks were seen in one frame."""

    @property
    def profile_gap(self) -> Array:
        """(2, teeth) mm of roll length: the widest stretch of the profile at mid-face without a reading."""
        return np.asarray(np.diff(self.profile_rolls, axis=2).max(axis=2))


def coverage_of(
    evaluator: Evaluator, measures: Measures, step: float, blind: Array, hidden: Mask, sides_tied: bool = True
) -> Coverage:
    """What was seen of each flank; ``step``: table angle from one profile to the next, rad; ``blind`` (2, teeth) mm of
    each helix for which the sensor's points are blind; ``hidden`` (2,): sides with a part of the profile that no ray
    shows on any tooth; ``sides_tied``: whether both sides were seen in one frame.
    """
    grid, nominal = evaluator.grid, evaluator.grid.nominal
    seen = bridge_gaps(grid.solid, grid, step)
    (low, high), (bottom, top) = nominal.profile_range, nominal.helix_range
    rolls = (grid.rolls >= low) & (grid.rolls <= high)
    heights = (grid.heights >= bottom) & (grid.heights <= top)
    area = seen[:, :, rolls][:, :, :, heights]
    near_roll = np.abs(grid.rolls - nominal.measuring_roll) < NEAR_MIDDLE * nominal.control_length
    near_height = np.abs(grid.heights - nominal.middle) < NEAR_MIDDLE * nominal.gear.face_width
    near = seen[:, :, near_roll][:, :, :, near_height].mean(axis=(2, 3))
    profile, helix = profile_points(nominal), helix_points(nominal)
    helix_share = np.minimum.reduce([
        (area.mean(axis=2) > LEAST_SEEN).mean(axis=2),
        _share_seen(measures.helix, helix, np.full(helix.shape, grid.size[1])),
        1.0 - blind / (top - bottom),
    ])  # fmt: skip
    return Coverage(
        (near >= 0.5).astype(np.float64),
        np.minimum(
            (area.mean(axis=3) > LEAST_SEEN).mean(axis=2),
            _share_seen(measures.profile, profile, step_on_flank(nominal, profile, step) / 2),
        ),
        helix_share,
        _profile_rolls(evaluator.traces).reshape(*near.shape, -1),
        np.maximum((1.0 - helix_share) * (top - bottom), evaluator.traces.across.reshape(near.shape)),
        _open_ends(evaluator.traces).reshape(2, *near.shape),
        blind,
        hidden | _lower_end_unseen(grid),
        sides_tied,
    )


def _lower_end_unseen(grid: Grid) -> Mask:
    """(2,): sides of which no tooth shows so long a stretch of the profile's lower end that damage may hide in it: what
    is true of it, an undercut or a fillet, is true of all teeth, and no flank says so.
    """
    narrowest = grid.nominal.gear.evaluation.narrowest_damage or NARROWEST
    shown = np.asarray(grid.solid.any(axis=(1, 3)))
    return np.asarray(np.where(shown.any(axis=1), shown.argmax(axis=1), grid.rolls.size) * grid.size[0] > narrowest)


def _share_seen(trace: Array, at: Array, reach: Array) -> Array:
    """Share (2, teeth) of the points of ``trace`` (2, teeth, points), NaN: not seen, within ``reach`` of a seen one."""
    near = np.abs(at[:, None] - at) <= reach[:, None]
    return np.asarray(((np.isfinite(trace).astype(np.float64) @ near.T.astype(np.float64)) > 0).mean(axis=2))


def _open_ends(traces: Traces) -> Array:
    """How far (2 ends, flanks) mm the helix' points end before its range does."""
    low, high = traces.nominal.helix_range
    lowest, highest = (np.where(np.isfinite(traces.heights), traces.heights, sign * np.inf) for sign in (1, -1))
    return np.maximum([lowest.min(axis=1) - low, high - highest.max(axis=1)], 0.0)


def _profile_rolls(traces: Traces) -> Array:
    """Where (flanks, n) mm readings at the middle of the face lie along the profile, increasing, its ends included."""
    low, high = traces.nominal.profile_range
    at = np.nan_to_num(np.clip(traces.rolls[:, traces.band], low, high), nan=high)
    return np.pad(np.sort(at.reshape(at.shape[0], -1), axis=1), ((0, 0), (1, 1)), constant_values=(low, high))
