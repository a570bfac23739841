"""The individuals chart against numbers worked out by hand, and its marks."""

import numpy as np
import pytest

from truestand.statistics.control import BEYOND, CHANGED, ONE_SIDE, control_chart


def test_limits_are_the_mean_and_2_66_mean_moving_ranges():
    chart = control_chart([10.0, 12.0, 11.0, 13.0])
    assert chart.mean == 11.5
    assert chart.upper == pytest.approx(11.5 + 2.66 * 5 / 3) and chart.lower == pytest.approx(11.5 - 2.66 * 5 / 3)
    assert [p.change for p in chart.points] == [None, 2.0, -1.0, 2.0] and chart.drift == 3.0
    assert chart.provisional and all(p.ok for p in chart.points)


def test_a_point_beyond_the_limits_is_marked():
    values = [0.0, 0.1] * 12 + [1.0]
    flags = [p.flags for p in control_chart(values).points]
    assert flags[-1] == (BEYOND,) and not any(flags[:-1])


def test_eight_on_one_side_are_marked_from_the_eighth():
    values = [0.0, 1.0] * 5 + [1.1, 0.9] * 5
    flags = [ONE_SIDE in p.flags for p in control_chart(values).points]
    assert flags.index(True) == 16 and sum(flags) == 4  # the ninth reading is the first of the run


def test_a_change_beyond_the_calibrations_own_u_is_marked():
    chart = control_chart([1.0, 1.4, 2.0], [0.3, 0.4, 0.4])
    assert [p.flags for p in chart.points] == [(), (), (CHANGED,)]
    assert chart.points[1].change_U == pytest.approx(0.5)


def test_directions_go_the_short_way_round():
    chart = control_chart([179.0, -179.0, 178.0], [3.0, 3.0, None], period=360.0)
    assert [p.value for p in chart.points] == [179.0, 181.0, 178.0] and all(p.ok for p in chart.points)


@pytest.mark.parametrize("value", np.random.default_rng(0).uniform(0.0, 60.0, 5).tolist())
def test_equal_readings_are_never_marked(value):
    chart = control_chart([value] * 23)
    assert chart.mean == chart.lower == chart.upper == value
    assert all(p.ok for p in chart.points)


def test_one_reading_has_no_limits_and_none_nothing():
    chart = control_chart([1.0])
    assert chart.mean == 1.0 and chart.lower is None and chart.drift is None and chart.points[0].ok
    assert control_chart([]).points == ()
