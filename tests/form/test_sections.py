"""Cells of a section: what form is read from."""

import numpy as np
import pytest

from truestand.core.calibration import Calibration
from truestand.core.frames import Pose
from truestand.core.scan import interpret
from truestand.core.surface import apply_calibration
from truestand.form.form import evaluate
from truestand.form.sections import CIRCLE_CELLS, SECTION, section
from truestand.sim import FormWave, simulate
from truth import PLANE, TILTED, Named, shaft


def test_few_readings_do_not_make_a_section_lean_to_where_more_of_its_cells_are_filled():
    """160 points a profile filled half of the cells, most to one side: an oval of 170 um read 189, 13 um off centre."""
    form = {"form": (FormWave("base", 2, 0.085, 0.4),)}
    named = Named(PLANE, TILTED, form, acquisition={"profiles": 1000, "columns": ("angle",)}, points=160)
    stand = named.stand()
    made = simulate(stand, named.simulation(), shaft(), 3)
    poses = (Pose.from_matrix(m) for m in (made.truth.table_from_sensor, made.truth.shaft_from_rotor))
    surface = apply_calibration(interpret(made.recording, stand), Calibration("stand", *poses, stand, "angle", "index"))
    for height in (-7.0, -5.1, -4.3):
        points = section(surface, 12.5, height - SECTION / 2, height + SECTION / 2, CIRCLE_CELLS)
        around = np.sort(np.arctan2(points[:, 1], points[:, 0]))
        assert np.diff(around).max() < 1.5 * np.diff(around).min()
        found = evaluate(points, "circle")
        assert found.form == pytest.approx(0.170, abs=0.005)
        assert np.hypot(*found.point[:2]) < 1e-3
