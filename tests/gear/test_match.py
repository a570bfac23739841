"""Which gear is it: identified from the cloud alone; wrong drawings are refused, right ones never."""

from dataclasses import replace
from functools import lru_cache
from math import cos, degrees, radians

import numpy as np
import pytest

from gears import POINTS, SPUR, UPRIGHT_POINTS, WORN, helical, line, scan_of, simulation, true_calibration
from truestand.core.calibration import VIEW_UNKNOWNS
from truestand.core.errors import NotEnoughData, WrongDrawing
from truestand.core.frames import PLANE_TILT, Pose
from truestand.core.surface import apply_calibration
from truestand.gear.drawing import Gear
from truestand.gear.inspect import inspect_gear
from truestand.gear.match import identify, toothed_heights
from truestand.sim import GearErrors, Worn
from truestand.uncertainty.influence import without
from variants import tried

ON_C = Pose.from_matrix(np.eye(4))
PERFECT = GearErrors(phase=radians(3.0))
FINE = Gear(60, 0.5, 20.0, 5.0, 31.0, 28.75)
SHIFTED = Gear(17, 3.0, 20.0, 5.0, 59.4, 46.0, profile_shift=0.4)
STEEP = replace(SPUR, pressure_angle=radians(25.0))


def gear_of(teeth, module, helix=0.0):
    reference = teeth * module / cos(radians(helix))
    return Gear(teeth, module, 20.0, 5.0, reference + 2 * module, reference - 2.5 * module, helix_angle=radians(helix))


@lru_cache(maxsize=4)
def surface_of(gear, errors=PERFECT, profiles=4400, how=(), moved=()):
    upright = gear.helix_angle != 0
    scan = scan_of(gear, errors, simulation(profiles, upright, **dict(how)), UPRIGHT_POINTS if upright else POINTS)
    return apply_calibration(scan, replace(wrong_by(true_calibration(upright), **dict(moved)), reasons=()))


def wrong_by(calibration, radial=0.0, offset=0.0, eccentric=0.0):
    """The calibration as if sensor (radially and sideways) and shaft stood elsewhere, mm."""
    sensor, shaft = calibration.table_from_sensor, calibration.shaft_from_rotor
    sensor = Pose(sensor.rotation, sensor.translation + np.array([radial, offset, 0.0]))
    shaft = Pose(shaft.rotation, shaft.translation + np.array([eccentric, 0.0, 0.0]))
    return replace(calibration, table_from_sensor=sensor, shaft_from_rotor=shaft)


@pytest.mark.slow
@pytest.mark.parametrize(
    "gear", tried([helical(15.0)], SPUR, SHIFTED, STEEP, rarely=[helical(-20.0), FINE]),
    ids=["15 right", "spur", "shifted", "25 degrees", "20 left", "fine"],
)  # fmt: skip
def test_a_gear_is_identified(gear):
    seen = identify(surface_of(gear), ON_C, gear.face_from, gear.face_to)
    assert seen.teeth == gear.teeth
    assert seen.module == pytest.approx(gear.module, rel=0.002)
    assert seen.pressure_angle == pytest.approx(gear.pressure_angle)
    assert degrees(seen.helix_angle) == pytest.approx(degrees(gear.helix_angle), abs=0.2)
    assert seen.profile_shift == pytest.approx(gear.profile_shift, abs=0.03)
    assert seen.tip_diameter == pytest.approx(gear.tip_diameter, abs=0.02)
    inspect_gear(surface_of(gear), gear)  # and not refused


@pytest.mark.more
@pytest.mark.parametrize(
    "gear", tried([gear_of(20, 2.0, 15.0), gear_of(13, 3.0)], gear_of(30, 1.5, -20.0), gear_of(40, 1.25, 10.0), FINE)
)
def test_stray_readings_make_no_other_gear(gear):
    """With the face as it is seen: half a per cent of strays made 15 degrees -33.65, and module 3 2.99."""
    surface = surface_of(gear, how=(("outliers", 0.005),))
    bottom, top = toothed_heights(surface, ON_C)
    assert (bottom, top) == pytest.approx((gear.face_from, gear.face_to), abs=0.3)
    seen = identify(surface, ON_C, bottom, top)
    assert (seen.teeth, seen.module) == (gear.teeth, pytest.approx(gear.module, rel=5e-4))
    assert degrees(seen.helix_angle) == pytest.approx(degrees(gear.helix_angle), abs=0.01)
    assert seen.sure and seen.confidence > 0.95 and not seen.rivals


@pytest.mark.more
@pytest.mark.parametrize("wrong", [{"radial": 1.0}, {"offset": 1.0}, {"eccentric": 0.5}], ids=str)
def test_a_gear_that_the_stand_distorts_is_not_sure(wrong):
    """The sensor has moved by a millimetre, or the shaft runs otherwise than calibrated: no other gear is made up."""
    surface = surface_of(SPUR, moved=tuple(wrong.items()))
    seen = identify(surface, ON_C, SPUR.face_from, SPUR.face_to)
    assert not seen.sure or (seen.teeth, round(seen.module, 2)) == (24, 2.0)
    if "eccentric" not in wrong:
        with pytest.raises(WrongDrawing, match="sensor or shaft have moved since the calibration"):
            inspect_gear(surface, SPUR)


def test_a_glimpse_identifies_nothing():
    with pytest.raises(NotEnoughData, match="most of"):
        identify(surface_of(SPUR, profiles=200), ON_C, SPUR.face_from, SPUR.face_to)


@pytest.mark.parametrize(
    "change",
    [
        {"teeth": 23, "tip_diameter": 50.0, "root_diameter": 41.0},
        {"teeth": 48, "module": 1.0},
        {"teeth": 12, "module": 4.0},
        {"module": 2.05},
        {"helix_angle": radians(1.0)},
        {"pressure_angle": radians(22.5)},
        {"profile_shift": 0.4},
    ],
    ids=["a tooth less", "twice the teeth", "half the teeth", "module", "helix", "pressure angle", "shift"],
)
def test_a_wrong_drawing_is_refused(change):
    with pytest.raises(WrongDrawing, match="saw 24 teeth, module 2 mm"):
        inspect_gear(surface_of(SPUR), replace(SPUR, **change))


@pytest.mark.more
@pytest.mark.parametrize(
    "errors",
    tried(
        [replace(PERFECT, missing=tuple(range(1, 13)))],
        replace(WORN, thickness=-0.3),
        rarely=[replace(WORN, eccentricity=0.1), replace(PERFECT, missing=(5, 6))],
    ),
    ids=["half of the teeth gone", "thin", "eccentric", "two teeth gone"],
)
def test_a_bad_gear_is_not_another_gear(errors):
    inspect_gear(surface_of(SPUR, errors), SPUR)


@pytest.mark.slow
def test_teeth_worn_alike_are_not_of_another_pressure_angle():
    """A step of 80 um on all flanks: the drawing was refused, *saw 22.5 degrees*."""
    worn = tuple(Worn(None, flank, (8.5, 20.0), (0.0, 30.0), 0.08, 0.15) for flank in ("left", "right"))
    found = inspect_gear(surface_of(SPUR, replace(PERFECT, worn=worn)), SPUR)
    said = [c.verdict for c in found.characteristics if c.name == "F_alpha" and c.tooth]
    assert "conforms" not in said and said.count("does_not_conform") > 0.75 * len(said)  # the step may be a reflection


@pytest.mark.more
def test_slopes_that_the_calibration_leaves_open_make_no_other_gear():
    """A laser plane whose tilt was off by its U, 0.32 deg: one sound gear of a hundred was refused."""
    off = np.zeros(VIEW_UNKNOWNS)
    off[PLANE_TILT] = radians(0.8)
    scan, tilted = scan_of(SPUR, WORN), without(true_calibration(), off)
    with pytest.raises(WrongDrawing, match="saw 24 teeth"):
        inspect_gear(apply_calibration(scan, replace(tilted, reasons=())), SPUR)
    covariance = tilted.covariance.copy()
    covariance[PLANE_TILT, PLANE_TILT] += (off[PLANE_TILT] / 2) ** 2
    found = inspect_gear(apply_calibration(scan, replace(tilted, covariance=covariance, reasons=())), SPUR)
    slope = line(found, "f_Hbeta", "left")
    assert abs(slope.value) > 0.1 and abs(slope.value - 0.003) < 1.1 * slope.U
