"""Sound flanks whose readings end a little before their range, by the places to which the table's steps bring them."""

import numpy as np
import pytest

from gears import SPUR
from truestand.gear.ends import _ends_of_profiles
from truestand.gear.flanks import COLUMNS, FlankPoints, Flanks, Toothing
from truestand.gear.geometry import involute
from truestand.gear.grid import Grid, centres_of, height_edges
from truestand.gear.rays import _between_neighbours
from truestand.gear.runs import between_readings

NOMINAL = involute(SPUR)
LOW, HIGH = NOMINAL.profile_range
TOOTHING = Toothing(NOMINAL, None, 0.0, np.zeros(48), 1.0)
POINTS, TEETH = 100, 24
HEIGHTS = np.linspace(5.3, 24.7, POINTS)


def flanks_of(profiles):
    """``profiles``: flank, number of the profile, roll lengths and heights of its readings (NaN: lost)."""
    rows = []
    for flank, number, rolls, heights in profiles:
        on = np.flatnonzero(np.isfinite(rolls) & (rolls > NOMINAL.control_roll))
        rows.append(np.stack([0.0 * on, rolls[on], heights[on], 0 * on + flank, 0 * on + number, number * POINTS + on]))
    values = dict(zip(COLUMNS, np.concatenate(rows, axis=1), strict=True))
    whole = {name: values[name].astype(np.int64) for name in ("flank", "profile", "index")}
    none = FlankPoints(*(np.zeros(0, dtype=v.dtype) for v in (values | whole).values()))
    return Flanks(**(values | whole), toothing=TOOTHING, outside_gate=none)


def grid_of(flanks):
    """The cells that these readings lie in."""
    edges, rolls = height_edges(NOMINAL, 0.25), centres_of(NOMINAL.control_roll, NOMINAL.tip_roll, 40)
    i = np.clip(np.searchsorted(rolls + (rolls[1] - rolls[0]) / 2, flanks.roll), 0, rolls.size - 1)
    j = np.clip(np.searchsorted(edges, flanks.height) - 1, 0, edges.size - 2)
    count = np.zeros((2 * TEETH, rolls.size, edges.size - 1))
    np.add.at(count, (flanks.flank, i, j), 1.0)
    count = count.reshape(2, TEETH, *count.shape[1:])
    delta = np.where(count > 0, 0.0, np.nan)
    roll, height = (np.broadcast_to(a, delta.shape) for a in (rolls[:, None], (edges[1:] + edges[:-1]) / 2))
    return Grid(NOMINAL, delta, delta, roll, height, count, rolls, edges, 0.002)


def test_a_profile_along_the_ranges_end_misses_no_reading():
    """Its noise puts two of three readings below the range, where it is none of the flank's: those were missed."""
    rolls = NOMINAL.control_roll + 0.004 * np.where(np.arange(POINTS) % 3, -1.0, 1.0)
    flanks = flanks_of([(3, 5, rolls, HEIGHTS), (3, 6, np.full(POINTS, LOW + 2.0), HEIGHTS)])
    found = between_readings(flanks, grid_of(flanks), np.ones(POINTS, dtype=bool), (LOW + 0.1, HIGH))
    assert not found.missed.any() and not found.in_runs.any()
    assert found.cells[0, 3].any()


@pytest.mark.parametrize(("apart", "moves_on", "told"), [(0.5, 0.0, False), (0.02, 0.0, True), (0.5, 0.31, True)])
def test_readings_that_lie_apart_across_a_helical_flank_may_begin_as_much_later(apart, moves_on, told):
    """Profiles on end have them at the same roll lengths: 0.4 mm before the range's end on one flank, a little on all
    others. Where they lie 0.02 mm apart, or move on from profile to profile, that flank is not seen to its end.
    """
    profiles, number = [], 0
    for tooth in range(TEETH):
        for low in np.arange(5.0, 24.8, 0.1):
            rolls = np.full(POINTS, np.nan)
            on = min(int(2.0 / apart), POINTS)
            rolls[:on] = LOW + 0.01 + moves_on * number % apart + apart * np.arange(on)
            if tooth == 7:
                rolls = np.where(rolls > LOW + 0.4, rolls, np.nan) if moves_on else rolls + 0.39
            profiles.append((tooth, number, rolls, low + 0.02 * np.linspace(0.0, 1.0, POINTS)))
            number += 1
    flanks = flanks_of(profiles)
    turn = 2 * np.pi / number  # one turn, in which every flank is met once
    found = _ends_of_profiles(flanks, grid_of(flanks), turn, POINTS)
    assert any(d.tooth == 7 and d.side == 0 for d in found) == told
    assert all(d.tooth == 7 for d in found)


@pytest.mark.parametrize(("hidden", "told"), [(False, True), (True, False)])
def test_no_ray_meets_the_cells_between_readings_next_to_each_other(hidden, told):
    """A view that looks down on the face has them 0.5 mm apart, where cells are 0.25 mm high: a sound ring had
    flanks that *no reading shows*. Where they lie 4 mm apart, an edge hides what is between.
    """
    heights = np.arange(5.31, 24.7, 0.5)
    if hidden:
        heights[20:] += 4.0
    heights = np.pad(heights, (0, POINTS - heights.size), constant_values=np.nan)
    flanks = flanks_of([(3, 5, np.where(np.isfinite(heights), LOW + 2.0, np.nan), heights)])
    grid = grid_of(flanks)
    no_ray = _between_neighbours(flanks, grid, POINTS)[0, 3]
    row = grid.seen[0, 3].any(axis=1)
    assert not (no_ray & grid.seen[0, 3]).any() and not no_ray[~row].any()
    gap = np.abs(grid.heights - 17.0) < 1.5
    assert no_ray[row][0, ~gap].sum() > 20 and no_ray[row][0, gap].any() == told
