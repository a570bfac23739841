"""Gage R&R against published worked examples, and against what must hold."""

import numpy as np
import pytest

from truestand.core.errors import NotEnoughData
from truestand.statistics.gage import gage_study, readings_of

AIAG = np.array([
    [0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36],
    [0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25],
    [0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31],
    [0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68],
    [0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62],
    [0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50],
    [0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49],
    [-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77],
    [-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16],
]).reshape(3, 3, 10).swapaxes(1, 2)  # fmt: skip
"""AIAG MSA 4th ed., table III-B 6: 3 appraisers, 3 trials, 10 parts (also Minitab's sample data GAGEAIAG)."""


def printed(value, text):
    """Whether a value, rounded as printed, is the printed one."""
    return f"{value:.{len(text.partition('.')[2])}f}" == text


def line(lines, name):
    return next(found for found in lines if found.name == name)


def test_the_analysis_of_variance_of_the_aiag_manual_to_its_printed_digits():
    """Table A 3 of the manual; F and p of the interaction and the last lines as Minitab prints them."""
    study = gage_study(AIAG)
    for name, dof, squares, mean in (
        ("operator", 2, "3.1673", "1.58363"), ("part", 9, "88.3619", "9.81799"),
        ("interaction", 18, "0.3590", "0.01994"), ("repeatability", 60, "2.7589", "0.04598"),
    ):  # fmt: skip
        found = line(study.full, name)
        assert found.dof == dof and printed(found.squares, squares) and printed(found.mean, mean), name
    assert printed(line(study.full, "total").squares, "94.6471") and line(study.full, "total").dof == 89
    interaction = line(study.full, "interaction")
    assert printed(interaction.F, "0.434") and printed(interaction.p, "0.974")
    assert printed(line(study.full, "part").F, "492.291") and printed(line(study.full, "operator").F, "79.406")


def test_the_components_of_the_aiag_manual_to_their_printed_digits():
    study = gage_study(AIAG)
    assert study.pooled and study.INT == 0.0
    within = line(study.used, "repeatability")
    assert within.dof == 78 and printed(within.squares, "3.1179") and printed(within.mean, "0.03997")
    assert printed(line(study.used, "operator").F, "39.617") and printed(line(study.used, "part").F, "245.614")
    for value, deviation, share, contribution in (
        (study.GRR, "0.30237", "27.86", "7.76"), (study.EV, "0.19993", "18.42", "3.39"),
        (study.AV, "0.22684", "20.90", "4.37"), (study.PV, "1.04233", "96.04", "92.24"),
    ):  # fmt: skip
        assert printed(value, deviation) and printed(study.share(value), share)
        assert printed(study.contribution(value), contribution)
    assert printed(study.EV, "0.199933") and printed(study.AV, "0.226838") and printed(study.PV, "1.042327")
    # The manual prints 0.302373, but the root of its own 0.199933 and 0.226838 squared is 0.302372.
    assert printed(study.GRR, "0.302372") and printed(np.hypot(0.199933, 0.226838), "0.302372")
    assert printed(study.EV**2, "0.03997") and printed(study.AV**2, "0.05146") and printed(study.PV**2, "1.08645")
    assert printed(study.TV, "1.08530") and study.ndc == 4


def test_an_interaction_is_kept_where_it_is_significant():
    rng = np.random.default_rng(1)
    both = rng.normal(0.0, 0.5, (4, 8, 1))
    readings = rng.normal(0.0, 3.0, (1, 8, 1)) + both + rng.normal(0.0, 0.1, (4, 8, 3))
    study = gage_study(readings)
    assert not study.pooled and 0.3 < study.INT < 0.7 and 0.07 < study.EV < 0.13
    assert np.hypot(study.GRR, study.PV) == pytest.approx(study.TV)


def test_components_are_recovered_on_average():
    rng = np.random.default_rng(2)
    found = []
    for _ in range(200):
        y = rng.normal(0, 0.3, (6, 1, 1)) + rng.normal(0, 2, (1, 10, 1)) + rng.normal(0, 0.2, (6, 10, 3))
        study = gage_study(y)
        found.append([study.EV**2, study.AV**2, study.PV**2])
    assert np.mean(found, axis=0) == pytest.approx([0.04, 0.09, 4.0], rel=0.15)


def test_equal_readings_have_no_variation_and_one_value_no_category():
    study = gage_study(np.ones((2, 3, 2)))
    assert study.TV == 0.0 and study.share(study.EV) is None and study.ndc is None
    assert gage_study(np.random.default_rng(3).normal(size=(3, 10, 3))).ndc == 1


def test_rows_become_readings_and_an_unbalanced_study_is_refused():
    rows = [(o, p, float(k)) for k in range(2) for p in ("1", "2") for o in ("Eva", "Jan")]
    readings, operators, parts = readings_of(rows)
    assert readings.shape == (2, 2, 2) and operators == ("Eva", "Jan") and parts == ("1", "2")
    with pytest.raises(NotEnoughData, match=r"1 readings of part 2 by Jan and 2"):
        readings_of(rows[:-1])
    with pytest.raises(NotEnoughData, match="2 operators"):
        gage_study(readings[:1])
