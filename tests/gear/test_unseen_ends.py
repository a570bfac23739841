"""What traces may do where their ends were not seen."""

from math import sqrt

import numpy as np
import pytest

from truestand.gear.trace_line import line_of, unseen_ends

AT = np.linspace(0.0, 5.0, 200)
CELLS = 20


def figures(trace):
    return line_of(trace, AT, np.full(len(trace), CELLS), 5.0, 5.0, 5.0)


def cut(trace, from_, to=5.0):
    return np.where((from_ <= AT) & (to >= AT), trace, np.nan)


@pytest.mark.parametrize("phase", np.linspace(0.0, 2 * np.pi, 12, endpoint=False))
@pytest.mark.parametrize(("from_", "to"), [(0.9, 5.0), (0.0, 4.3)])
def test_form_that_bends_beyond_what_was_seen_stands_in_u(phase, from_, to):
    """One tooth has a wave of one length over its profile: 6.2 um of form were read, with U 3.1, where 12.7 is true."""
    wave = 0.006 * np.sin(2 * np.pi * AT / 5.0 + phase)
    traces = np.zeros((20, AT.size))
    traces[3] = cut(wave, from_, to)
    U = 2 / sqrt(3.0) * unseen_ends(traces, AT, figures).form[3]
    read, true = (figures(t).form[3] for t in (traces, np.where(np.arange(20)[:, None] == 3, wave, traces)))
    assert abs(read - true) < 1.1 * U + 0.0005
    assert U < 0.012


def test_an_end_may_be_as_other_flanks_of_its_side_are():
    """What bends only where a flank was not seen can be told by others alone: their forms scatter there."""
    rng = np.random.default_rng(3)
    down = np.clip(1.0 - AT, 0.0, None) * rng.normal(0.0, 0.006, (20, 1))
    traces = np.where(np.arange(40)[:, None] < 20, np.concatenate([down, down]), 0.0)
    traces[[5, 25]] = cut(np.zeros(AT.size), 1.0)
    form = unseen_ends(traces, AT, figures).form
    assert 0.002 < form[5] < 0.02 and form[25] == pytest.approx(0.0, abs=1e-9)
    assert np.delete(form, [5, 25]) == pytest.approx(0.0, abs=1e-12)


def test_noise_of_a_flat_flank_makes_no_end_of_it():
    rng = np.random.default_rng(4)
    noisy = np.stack([np.interp(AT, np.linspace(0, 5, CELLS), n) for n in rng.normal(0.0, 0.001, (40, CELLS))])
    noisy[:20] = cut(noisy[:20], 0.8)
    assert np.median(unseen_ends(noisy, AT, figures).form[:20]) < 0.003
