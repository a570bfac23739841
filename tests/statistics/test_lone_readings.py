"""Outliers are single readings, never regions: what is left out, and what is not."""

import numpy as np
import pytest

from truestand.statistics.lone_readings import lone_readings

PER_TURN, POINTS, NOISE = 200, 40, 0.002


def read(image):
    """The arguments for an image (profiles, points) of delta, one flank, at equal angles; NaN: not seen."""
    row, column = np.nonzero(np.isfinite(image))
    angle = np.arange(image.shape[0]) * 2 * np.pi / PER_TURN
    index = row * image.shape[1] + column
    return image[row, column], np.zeros(row.size, dtype=np.intp), index, image.shape[1], angle


def flank(turns=1.0, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(0.0, NOISE, (int(turns * PER_TURN), POINTS))


@pytest.mark.parametrize("turns", [1.0, 2.5])
def test_wild_readings_are_left_out_and_sound_ones_are_not(turns):
    image = flank(turns)
    rng = np.random.default_rng(1)
    wild = rng.random(image.shape) < 0.2
    image[wild] = rng.uniform(-0.25, 0.25, np.count_nonzero(wild))
    left_out = lone_readings(*read(image)).reshape(image.shape)
    off = np.abs(image) > 0.03
    assert left_out[off].mean() > 0.97
    assert left_out[~wild].mean() < 0.01


@pytest.mark.parametrize("turns", [1.0, 2.5])
@pytest.mark.parametrize("depth", [0.01, 0.1, 0.2])
@pytest.mark.parametrize(
    "where", [np.s_[60:61, :], np.s_[:, 12:14], np.s_[60:63, 10:13]], ids=["row", "columns", "dent"]
)
def test_regions_stay(turns, depth, where):
    """A groove that one profile meets, one that two points of each profile meet, a dent of nine readings."""
    image = flank(turns)
    damaged = np.zeros((PER_TURN, POINTS), dtype=bool)
    damaged[where] = True
    damaged = np.concatenate([damaged] * 3)[: image.shape[0]]
    image[damaged] -= depth
    left_out = lone_readings(*read(image)).reshape(image.shape)
    assert left_out[damaged].mean() < 0.15  # a corner of the dent has few like it


@pytest.mark.parametrize("depth", [0.03, 0.09, 0.2])
def test_a_round_dent_of_a_few_readings_stays(depth):
    """Five points wide and as many profiles: no two of its readings are alike."""
    row, column = np.indices((PER_TURN, POINTS))
    away = ((row - 60) ** 2 + (column - 12) ** 2) / 2.5**2
    dent = depth * np.square(np.maximum(1.0 - away, 0.0))
    left_out = lone_readings(*read(flank() - dent)).reshape(dent.shape)
    assert not left_out[dent > depth / 2].any()


def test_what_another_turn_does_not_show_is_left_out():
    image = flank(2.0)
    image[60:63, 10:20] += 0.05
    left_out = lone_readings(*read(image)).reshape(image.shape)
    assert left_out[61, 11:19].all()
    assert left_out[61 + PER_TURN, 11:19].all()  # nobody knows which of the two is right
    assert left_out.mean() < 0.01


def test_a_flank_that_stands_elsewhere_on_the_next_turn_stays():
    image = flank(2.0)
    image[PER_TURN:] += 0.05
    assert lone_readings(*read(image)).mean() < 0.01


def test_an_edge_beside_a_flank_is_no_flank_that_stands_elsewhere():
    """Profiles of two turns met the same places, and next to them the land of the tip: what lies between two profiles
    there was taken for what the turns differ by.
    """
    image = flank(2.0)
    image += np.minimum(0.0, 0.06 * (62.0 - np.arange(2 * PER_TURN) % PER_TURN))[:, None]
    image[(np.arange(2 * PER_TURN) % PER_TURN < 60) | (np.arange(2 * PER_TURN) % PER_TURN > 67)] = np.nan
    assert lone_readings(*read(image)).mean() < 0.01


def test_few_readings_are_no_error():
    assert lone_readings(*read(np.full((3, 4), np.nan))).size == 0
    assert lone_readings(*read(np.full((2 * PER_TURN, 4), np.nan))).size == 0
    assert lone_readings(*read(np.zeros((1, 1)))).all()


def test_a_steep_edge_seen_aslant_is_kept_beside_single_outliers():
    """Each profile has a reading or two of it, 20 um apart: an outsider's material near a root, 80 um high, was
    left out, and the gear conformed.
    """
    image = flank()
    for row in range(60, 100):
        image[row, 10 + (row - 60) // 4] += 0.02 * (1 + row % 4)
    single = np.array([(20, 5), (33, 30), (120, 8), (150, 33), (171, 20), (188, 12)])
    image[tuple(single.T)] = 0.08
    left_out = lone_readings(*read(image)).reshape(image.shape)
    assert left_out[60:100].sum() <= 1, "its last one has fewer beside it"
    assert left_out[tuple(single.T)].all()


def test_steep_edges_are_kept_beside_others_that_more_readings_show():
    """Craters on all flanks of a gear, of one of which five readings stood apart: it was left out, and conformed."""
    image = np.random.default_rng(2).normal(0.0, NOISE, (PER_TURN, 10 * POINTS))
    row = np.arange(PER_TURN)
    edge = np.zeros(image.shape)
    edge[:, 40:360:80] = -0.02 * (1 + row[:, None] % 4)  # every profile meets these
    edge[:, 80:321:240] = np.where(row % 4 < 2, -0.03 * (1 + row % 2), 0.0)[:, None]  # two of four these
    left_out = lone_readings(*read(image + edge)).reshape(image.shape)
    assert np.count_nonzero(left_out & (edge < 0)) <= 4, "at its ends an edge has fewer beside it"
