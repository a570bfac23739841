"""Checks that a scan passes or fails, on fits made by hand."""

from cmath import phase

import pytest

from truestand.calibration.calibrate import calibrate
from truestand.core.calibration import TABLE_BEARING, Harmonic, shared_waves_of
from truth import scan_of, shaft


def shared(*waves):
    """Of waves (surface, upr, complex mm) on two surfaces that have little else; (waves a turn, mm)."""
    rest = tuple(Harmonic(s, n, 0.0, 0.0) for s in ("base", "step") for n in range(2, 6))
    found = shared_waves_of(rest + tuple(Harmonic(s, n, abs(w), phase(w)) for s, n, w in waves))
    return [(w.waves, pytest.approx(w.amplitude)) for w in found]


def test_form_of_one_size_and_phase_on_all_surfaces_is_shared():
    assert shared(("base", 3, 3e-3 - 4e-3j), ("step", 3, 3e-3 - 4e-3j), ("base", 2, 0.02)) == [(3, 0.005)]


def test_form_of_one_surface_or_of_another_phase_is_not_shared():
    assert shared(("base", 2, 0.02)) == []
    assert shared(("base", 2, 0.02), ("step", 2, 0.02j)) == []


def test_a_wave_of_the_bearing_is_shared_whatever_the_form():
    assert shared((TABLE_BEARING, 4, 3e-3j), ("base", 4, 0.02)) == [(4, 0.003)]


def test_what_of_a_wave_of_the_bearing_passes_for_form_counts_with_it():
    """Table angle and polar angle run against each other."""
    of_form = 1e-3 - 2e-3j
    assert shared((TABLE_BEARING, 4, 2e-3 + 1e-3j), ("base", 4, of_form), ("step", 4, of_form)) == [
        (4, abs(3e-3 + 3e-3j))
    ]


def test_one_surface_shares_nothing():
    assert shared_waves_of((Harmonic("base", 2, 0.02, 0.0), Harmonic(TABLE_BEARING, 2, 0.01, 0.0))) == ()


def test_a_wave_that_all_surfaces_share_is_in_u_of_the_eccentricity():
    """It may be the bearing's, whose first wave nobody can tell from eccentricity."""
    found = calibrate(scan_of("many harmonics"), shaft())
    (check,) = (c for c in found.checks if c.code.startswith("form_shared"))
    assert not check.ok
    (line,) = (c for c in found.uncertainty["eccentricity_um"].contributions if c.name.startswith("table bearing"))
    shared, known = line.U, check.value
    assert shared == pytest.approx(known, rel=1e-6)
    clean = calibrate(scan_of("encoder"), shaft()).uncertainty["eccentricity_um"].contributions
    (assumed,) = (c.U for c in clean if c.name.startswith("table bearing"))
    assert assumed == pytest.approx(0.5)
