"""The noise of cells is told from neighbouring cells, whatever the flank's shape and damage."""

from dataclasses import replace

import numpy as np
import pytest

from gears import SPUR
from truestand.gear.geometry import involute
from truestand.gear.grid import Grid, centres_of, height_edges
from truestand.gear.noise import CellNoise, noise_of_cells

UM = 1e-3


def grid(noise=0.0, of_row=0.0, of_column=0.0, correlated=0.0, ar1=0.0, damage=0.0, seed=0):
    """Smooth flanks of 16 readings a cell, with noise of a single reading."""
    nominal = involute(SPUR)
    edges, rolls = height_edges(nominal, 0.5), centres_of(nominal.control_roll, nominal.tip_roll, 40)
    shape = (2, 24, rolls.size, edges.size - 1)
    heights = (edges[:-1] + edges[1:]) / 2
    drawn = CellNoise(np.full(shape, noise**2 / 16), correlated, ar1, of_row, of_column)
    delta = 0.004 * np.sin(rolls / 3.0)[:, None] - 0.01 * ((heights - 15.0) / 10.0) ** 2
    delta = delta + drawn.draw(np.random.default_rng(seed))
    delta[:, ::4, 10:16, 10:20] -= damage
    roll, height = (np.broadcast_to(a, shape) for a in (rolls[:, None], heights))
    return Grid(nominal, delta, delta, roll, height, np.full(shape, 16.0), rolls, edges, noise)


@pytest.mark.parametrize("damage", [0.0, 0.1])
def test_noise_of_single_readings(damage):
    found = noise_of_cells(grid(noise=4 * UM, damage=damage))
    assert np.sqrt(np.median(found.variance)) == pytest.approx(1 * UM, rel=0.05)
    assert found.of_row < 0.15 * UM and found.of_column < 0.15 * UM and found.correlated < 0.1


def test_what_rows_and_columns_share():
    found = noise_of_cells(grid(noise=4 * UM, of_row=0.8 * UM, of_column=0.5 * UM))
    assert found.of_row == pytest.approx(0.8 * UM, rel=0.15)
    assert found.of_column == pytest.approx(0.5 * UM, rel=0.15)


def test_noise_that_goes_on_along_the_roll_length():
    found = noise_of_cells(grid(noise=4 * UM, correlated=0.8, ar1=0.8))
    assert found.correlated == pytest.approx(0.8, abs=0.1)
    assert found.ar1 == pytest.approx(0.8, abs=0.1)


def test_readings_on_an_edge_are_less_certain():
    """Where a flank falls by 100 um from cell to cell, a reading of the cell may be anywhere in between: 29 um."""
    sharp = replace(grid(noise=4 * UM), count=np.ones((2, 24, 40, height_edges(involute(SPUR), 0.5).size - 1)))
    sharp.delta[..., 20:] -= 0.1
    spread = np.sqrt(np.median(noise_of_cells(sharp).variance[:, :, 5:-5], axis=(0, 1, 2)))
    assert spread[20] == pytest.approx(0.1 / np.sqrt(12), rel=0.05)
    assert spread[15] < 2 * UM


def test_nothing_seen_has_no_noise():
    empty = grid()
    empty = replace(empty, delta=np.full(empty.delta.shape, np.nan), count=np.zeros(empty.delta.shape))
    found = noise_of_cells(empty)
    assert not found.variance.any() and found.of_row == found.of_column == found.correlated == 0.0
