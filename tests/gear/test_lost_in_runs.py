"""Readings that sensors lose one by one or in runs, and holes in flanks among them."""

from types import SimpleNamespace

import numpy as np
import pytest

from truestand.gear.rays import BLOCKS_OF_FACE, _longer_than_usual, _usual_length

TEETH, RUNS, BLOCKS = 24, 4000, BLOCKS_OF_FACE**2


def lost(lengths, share=0.1, seed=1):
    """Gaps (n,) between readings, ``share`` of which lack readings: so many, drawn from ``lengths``; their flanks and
    their blocks of the face.
    """
    rng = np.random.default_rng(seed)
    runs = np.where(rng.random(RUNS) < share, rng.choice(lengths, RUNS), 0)
    return runs, rng.integers(0, 2 * TEETH, RUNS), rng.integers(0, BLOCKS, RUNS)


def long(runs, flank, block):
    grid = SimpleNamespace(delta=np.zeros((2, TEETH, 1, 1)))
    return _longer_than_usual(runs, flank, _usual_length(runs, block), grid)


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
    assert _usual_length(grooved, block) == pytest.approx(_usual_length(runs, block), rel=0.1)
    assert _usual_length(np.zeros(RUNS, dtype=int), block) == 1.0


def test_each_lost_reading_followed_by_another_one_as_often_makes_runs_of_a_length():
    """(1 + p) / (1 - p): that of the run which a lost reading lies in."""
    gone = np.diff(np.flatnonzero(np.random.default_rng(2).random(400_000) > 0.3)) - 1
    assert _usual_length(gone, np.arange(gone.size) % BLOCKS) == pytest.approx(1.3 / 0.7, rel=0.02)
