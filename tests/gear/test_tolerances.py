"""ISO 1328-1's tolerances against the vectors that ../shared/GEAR.md gives."""

from dataclasses import replace

import pytest

from truestand.core.errors import BadRecipe
from truestand.gear.drawing import Gear
from truestand.gear.tolerances import reached, tolerance

GEAR = Gear(24, 2.0, 20.0, 5.0, 52.0, 43.0)
NAMES = ("f_p", "F_p", "F_r", "f_Halpha", "f_falpha", "F_alpha", "f_Hbeta", "f_fbeta", "F_beta")
VECTORS = {
    5: (6, 17, 16, 4.8, 6, 8, 6, 6.5, 9),
    6: (8.5, 24, 22, 7, 8.5, 11, 8.5, 9, 12),
    7: (12, 35, 31, 9.5, 12, 16, 12, 13, 18),
    8: (17, 49, 44, 14, 17, 22, 17, 18, 25),
    9: (23, 69, 62, 19, 24, 31, 24, 26, 35),
    10: (33, 98, 88, 27, 35, 44, 33, 37, 50),
}


@pytest.mark.parametrize("accuracy_class", VECTORS)
def test_the_2013_edition(accuracy_class):
    found = [1000 * tolerance(n, GEAR, accuracy_class) for n in NAMES]
    assert found == pytest.approx(VECTORS[accuracy_class], abs=1e-9)


def test_the_class_that_a_value_keeps():
    assert reached("f_p", 0.012, GEAR) == 7
    assert reached("f_p", -0.0121, GEAR) == 8
    assert reached("f_p", 0.0, GEAR) == 1
    assert reached("F_p", 5.0, GEAR) is None


def test_the_1995_edition_takes_the_geometric_means_of_its_ranges():
    """d 20..50: 31.62; m 0.5..2: 1; b 10..20: 14.14. Class 5, from the formulas by hand."""
    old = replace(GEAR, standard="ISO 1328-1:1995")
    assert 1000 * tolerance("f_p", old, 5) == pytest.approx(5.0)  # 0.3 (1 + 0.4 * 5.623) + 4 = 4.97
    assert 1000 * tolerance("F_p", old, 5) == pytest.approx(14.0)  # 0.3 + 1.25 * 5.623 + 7 = 14.3
    assert 1000 * tolerance("F_alpha", old, 5) == pytest.approx(5.0)  # 3.2 + 1.24 + 0.7 = 5.14
    assert 1000 * tolerance("F_beta", old, 5) == pytest.approx(7.0)  # 0.56 + 2.37 + 4.2 = 7.13


@pytest.mark.parametrize(
    "wrong",
    [
        {"teeth": 4, "tip_diameter": 10.0, "root_diameter": 5.0},
        {"face_width": 3.0},
        {"helix_angle": 0.9, "tip_diameter": 80.0},
    ],
)
def test_gears_outside_the_standard_are_refused(wrong):
    with pytest.raises(BadRecipe, match="covers"):
        tolerance("f_p", replace(GEAR, **wrong), 7)


def test_classes_outside_the_standard_are_refused():
    with pytest.raises(BadRecipe, match=r"need 1\.\.11"):
        tolerance("f_p", GEAR, 12)
