"""Readings that sensors lose one by one or in runs, and holes in flanks among them."""

from types import SimpleNamespace

import numpy as np
import pytest

from truestand.gear.runs import (
    BLOCKS_OF_FACE,
    _beside_each_other,
    _longer_than_usual,
    _of_many_profiles,
    _Runs,
    _usual_length,
)

TEETH, RUNS, BLOCKS, ROWS, PROFILES = 24, 4000, BLOCKS_OF_FACE**2, 16, 20


def runs_of(length, flank, block, alone=False):
    none = np.zeros(len(length), dtype=int)
    return _Runs(np.asarray(length), np.asarray(flank), none, none, np.asarray(block), none, none + alone > 0)


def lost(lengths, share=0.1, seed=1):
    """Gaps (n,) between readings, ``share`` of which lack readings: so many, drawn from ``lengths``; their flanks and
    their blocks of the face.
    """
    rng = np.random.default_rng(seed)
    runs = np.where(rng.random(RUNS) < share, rng.choice(lengths, RUNS), 0)
    return runs, rng.integers(0, 2 * TEETH, RUNS), rng.integers(0, BLOCKS, RUNS)


def usual(length, block, flank=0, alone=False):
    return _usual_length(runs_of(length, np.broadcast_to(flank, len(length)), block, alone=alone), TEETH)


def long(length, flank, block):
    return _longer_than_usual(runs_of(length, flank, block), usual(length, block), TEETH)


@pytest.mark.parametrize("lengths", [[1], np.arange(3, 13), [1] * 9 + [8, 12]], ids=["single", "runs", "both"])
def test_runs_as_long_as_others_are_no_holes(lengths):
    assert not long(*lost(lengths)).any()


@pytest.mark.parametrize("lengths", [[1], np.arange(3, 13)], ids=["single", "runs"])
@pytest.mark.parametrize("on", [1, 2 * TEETH], ids=["one flank", "every flank"])
def test_a_hole_is_longer_at_one_place_of_one_flank_or_all(lengths, on):
    runs, flank, block = lost(lengths)
    holes = np.full(on, 5 if max(lengths) == 1 else 60), np.arange(on), np.full(on, 3)
    told = long(*(np.concatenate(both) for both in zip((runs, flank, block), holes, strict=True)))
    assert told[RUNS:].all() and not told[:RUNS].any()


def test_holes_say_nothing_of_how_long_runs_usually_are():
    runs, _, block = lost([1, 2])
    grooved = np.where(block % BLOCKS_OF_FACE == 1, 40, runs)  # along the profile, on every flank
    assert usual(grooved, block) == pytest.approx(usual(runs, block), rel=0.1)
    assert usual(np.zeros(RUNS, dtype=int), block) == 1.0


def test_each_lost_reading_followed_by_another_one_as_often_makes_runs_of_a_length():
    """(1 + p) / (1 - p): that of the run which a lost reading lies in."""
    gone = np.diff(np.flatnonzero(np.random.default_rng(2).random(400_000) > 0.3)) - 1
    assert usual(gone, np.arange(gone.size) % BLOCKS) == pytest.approx(1.3 / 0.7, rel=0.02)


@pytest.mark.parametrize(
    ("flanks", "blocks", "alone", "length"),
    [
        (range(5), range(5), True, 8.0),
        (range(5), range(5), False, 1.0),
        (range(24), [1, 5, 9, 13] * 6, True, 1.0),  # a groove along the profile, or across it
        ([3] * 7, range(7), True, 1.0),  # one flank
    ],
)
def test_few_runs_that_one_profile_lacks_alone_are_usual_where_they_are_anywhere(flanks, blocks, alone, length):
    """Five of them, and 146 lines of a sound gear were undecided."""
    assert usual(np.full(len(blocks), 8), np.array(blocks), np.array(flanks), alone) == length


def runs_at(flank, profile, columns, row=None):
    number, row = len(flank), np.zeros(len(flank), dtype=int) if row is None else row
    return _Runs(
        np.full(number, 3), np.asarray(flank), np.asarray(profile), row, row * BLOCKS_OF_FACE // ROWS * BLOCKS_OF_FACE,
        np.asarray(columns).T, np.zeros(number, dtype=bool),
    )  # fmt: skip


def test_profiles_beside_each_other_whose_runs_overlap_are_counted():
    """On helical flanks a hole lies lower in each profile: the first and the last have no column in common."""
    columns = [(6, 7), (4, 4), (4, 6), (4, 4), (9, 9), (7, 8)]
    runs = runs_at([0, 0, 0, 0, 0, 1], [12, 10, 11, 20, 12, 13], columns)
    assert _beside_each_other(runs, *runs.columns_each()).tolist() == [3, 3, 3, 1, 1, 1]
    none = runs_at([], [], np.zeros((0, 2), dtype=int))
    assert not _beside_each_other(none, *none.columns_each()).size


@pytest.mark.parametrize(("share", "profiles"), [(0.0005, 3), (0.02, 6)])
def test_a_hole_is_one_that_more_profiles_beside_each_other_lack_than_chance_makes(share, profiles):
    """40 profiles pass 88 columns of each flank."""
    rng, columns = np.random.default_rng(3), 88
    gone = rng.random((2 * TEETH, 2 * PROFILES, columns)) < share
    gone[7, 10 : 10 + profiles, 40:44] = True
    flank, profile, column = np.nonzero(gone)
    row = profile * ROWS // (2 * PROFILES)
    runs = runs_at(flank, 100 * flank + profile, np.stack([column, column], axis=1), row)
    grid = SimpleNamespace(delta=np.zeros((2, TEETH, 1, 1)), rolls=np.zeros(ROWS))
    told = _of_many_profiles(runs, grid, np.full(ROWS, gone.size / ROWS))
    hole = (flank == 7) & (column >= 40) & (column < 44) & (profile >= 10) & (profile < 10 + profiles)
    assert told[hole].all() and not told[(flank != 7)].any()


def test_hairs_hide_no_hole():
    """They lack readings in long chains of profiles, narrowly. Holes of 1.1 to 1.9 mm *conformed* among them."""
    flank, start = np.repeat(np.arange(0, 40, 2), 20), np.repeat(np.arange(20) * 4, 20)
    column = start + np.tile(np.arange(20) // 4, 20)
    hairs, hole = (flank, np.tile(np.arange(20), 20), column, column + 1), ([7] * 4, range(4), [40] * 4, [44] * 4)
    flank, profile, low, high = (np.concatenate(both) for both in zip(hairs, hole, strict=True))
    runs = runs_at(flank, 100 * flank + profile, np.stack([low, high], axis=1))
    grid = SimpleNamespace(delta=np.zeros((2, TEETH, 1, 1)), rolls=np.zeros(ROWS))
    assert _of_many_profiles(runs, grid, np.full(ROWS, 40_000.0)).all()
