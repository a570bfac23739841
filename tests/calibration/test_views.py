"""Several sensors calibrated together: where they stand to each other, and how well that is known."""

import json
from dataclasses import replace
from functools import cache
from math import degrees, pi, radians

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from truestand.apply.transfer import roll
from truestand.apply.verify import verify
from truestand.calibration.calibrate import calibrate
from truestand.calibration.views import calibrate_views
from truestand.core.calibration import VIEW_UNKNOWNS
from truestand.core.errors import BadRecipe
from truestand.core.frames import UNKNOWNS, Pose, about_axis, sensor_parameters, shaft_parameters
from truestand.core.harmonics import wrap
from truestand.core.scan import interpret
from truestand.core.stand import Sensor
from truestand.files.records.calibration_record import calibration_record, read_calibration, write_calibration
from truestand.files.records.schemas import schema_text
from truestand.sim import Misalignment, Running, Workpiece
from variants import tried
from views import AZIMUTH, FRONT, REAR, SHAFT, scans_of, seen, two_sensors, two_views

UM, URAD = 1e-3, 1e-6
OUTSIDE = 25.0
"""mm: radius at which the sensors' relative pose is looked at."""
TWO = two_views()
CENTRED = replace(TWO, running=Running(0.0), workpiece=replace(TWO.workpiece, form=()))
OVAL = replace(TWO, running=Running(0.0))


@cache
def calibrated(simulation):
    return calibrate_views(scans_of(simulation), SHAFT)


def off_at(calibration, simulation):
    """By how much (3,) mm, in T, a point before the second sensor lies elsewhere for the first one, and turned, rad."""
    front, rear = calibration.views
    found = front.table_from_sensor.inverse @ rear.first_from_table @ rear.table_from_sensor
    true = [Pose.from_matrix(seen(simulation, v).truth.table_from_sensor) for v in ("front", "rear")]
    between = true[0].inverse @ about_axis(AZIMUTH, 0.0) @ true[1]
    point = true[1].inverse(np.array([OUTSIDE, 0.0, 0.0]))
    turned = (found.inverse @ between).rotation
    return true[0].rotation @ (found(point) - between(point)), float(np.arccos((np.trace(turned) - 1) / 2))


@pytest.mark.parametrize("offsets", tried([(0.25, -0.3), (-0.62, 0.17)], ((0.9, 1.0),)), ids=str)
@pytest.mark.parametrize(
    ("noise", "most", "most_turned"), [(0.0, 1.0, 30.0), (0.5, 1.2, 55.0)], ids=["no noise", "0.5 um"]
)
def test_ideal_sensors_stand_where_they_stand(noise, most, most_turned, offsets):
    """With noise twice the most of 20 stands of four times the readings (``two_views.py ideal``, seeds 105000)."""
    front, rear = (replace(place, plane_offset=d) for place, d in zip((FRONT, REAR), offsets, strict=True))
    ideal = two_views(front, rear, optics=replace(TWO.optics, noise=noise * UM, step_z=0.0, step_x=0.0))
    stated = calibrate_views(scans_of(ideal, two_sensors(linearity_U=0.0005)), SHAFT)
    off, turned = off_at(stated, ideal)
    assert np.hypot(off[0], off[1]) < most * UM and turned < most_turned * URAD


def test_azimuth_and_poses_lie_in_their_u():
    calibration = calibrated(TWO)
    rear = calibration.of_view("rear")
    assert calibration.status == "valid" and calibration.of_view("front") == calibration.views[0]
    assert abs(wrap(rear.azimuth - AZIMUTH)) < radians(rear.uncertainty["azimuth_deg"].U) < radians(0.1)
    assert abs(rear.height) < rear.uncertainty["height_mm"].U
    for view in calibration.views:
        true = sensor_parameters(Pose.from_matrix(seen(TWO, view.name).truth.table_from_sensor))
        phi, _, _, tilt, offset = np.array(sensor_parameters(view.table_from_sensor)) - true
        for value, key in ((degrees(phi), "phi_deg"), (degrees(tilt), "laser_plane_tilt_deg"),
                           (offset, "laser_plane_offset_mm")):  # fmt: skip
            assert abs(value) < view.uncertainty[key].U, (view.name, key)


def test_all_views_have_one_shaft():
    front, rear = calibrated(TWO).views
    turned = front.shaft_from_rotor @ about_axis(rear.azimuth, rear.height)
    assert shaft_parameters(rear.shaft_from_rotor) == pytest.approx(shaft_parameters(turned), abs=1e-7)


@pytest.mark.more
def test_the_order_of_the_scans_changes_nothing_but_the_frame():
    front, rear = scans_of(TWO)
    one, other = calibrate_views((front, rear), SHAFT).views[1], calibrate_views((rear, front), SHAFT).views[1]
    U = one.uncertainty
    assert other.name == "front" and abs(other.height + one.height) < 0.01 * U["height_mm"].U
    assert abs(wrap(other.azimuth + one.azimuth)) < 0.01 * radians(U["azimuth_deg"].U)


def test_together_the_laser_planes_differ_less_than_each_is_known():
    """The steps' coaxiality moves both readings of the plane alike."""
    steps = (Misalignment("bearing", 0.004, -0.003),)
    simulation = replace(TWO, workpiece=replace(TWO.workpiece, misalignments=steps))
    calibration = calibrated(simulation)
    joint, at = calibration.joint.matrix, {"front": 2, "rear": 12}
    own = [np.sqrt(joint[i, i]) for i in at.values()]
    between = np.sqrt(joint[2, 2] + joint[12, 12] - 2 * joint[2, 12])
    off = [v.plane_offset - seen(simulation, v.name).truth.simulation.mounting.plane_offset for v in calibration.views]
    assert between < 0.5 * min(own) and abs(off[0] - off[1]) < 2 * between


LEVEL = two_views(replace(FRONT, phi=radians(-77.0)), replace(REAR, phi=radians(-105.5)))
BENT = replace(LEVEL, optics=replace(TWO.optics, noise=0.001, nonlinearity=0.024))
"""Their range errs by a sine of 24 um, nearly twice what 20 um (k = 2) mean; they hardly look up or down."""


@pytest.mark.more
@pytest.mark.parametrize("phase", [0.4, 2.0, 3.6, 5.2])
def test_sensors_that_are_not_linear_bend_no_shaft(phase):
    """Each stretches the shaft's travel otherwise: between two views that is no tilt of shaft or laser plane."""
    other = replace(BENT, optics=replace(BENT.optics, nonlinearity_phase=phase + 1.7))
    first = replace(BENT, optics=replace(BENT.optics, nonlinearity_phase=phase))
    calibration = calibrate_views((scans_of(first)[0], scans_of(other)[1]), SHAFT)
    joint = calibration.joint.matrix
    for k, view in enumerate(calibration.views):
        true = seen(LEVEL, view.name).truth
        tilt = (
            sensor_parameters(view.table_from_sensor)[3]
            - sensor_parameters(Pose.from_matrix(true.table_from_sensor))[3]
        )
        assert abs(tilt) < 2 * np.sqrt(joint[10 * k + 3, 10 * k + 3]), view.name
        off = np.array(shaft_parameters(view.shaft_from_rotor)) - shaft_parameters(
            Pose.from_matrix(true.shaft_from_rotor)
        )
        U = 2 * np.sqrt(np.diag(joint)[10 * k + 4 : 10 * k + 8])
        assert (np.abs(off) < 1.2 * U).all(), (view.name, off / U)


@pytest.mark.parametrize("range_error", [0.0, 0.03])
def test_a_step_that_travels_more_makes_no_waves(range_error):
    """6 um aside along the eccentricity, and stretched by its range, a round shaft had waves of form of 8 to 29 um
    twice a turn, and the table's bearing the opposite ones.
    """
    towards = LEVEL.running.eccentricity_direction
    aside = Workpiece(misalignments=(Misalignment("bearing", 0.006 * np.cos(towards), 0.006 * np.sin(towards)),))
    bent = replace(LEVEL.optics, nonlinearity=range_error, nonlinearity_phase=2.0)
    stand = two_sensors(linearity_U=0.03)
    recording = seen(replace(LEVEL, optics=bent, workpiece=aside), "front", stand).recording
    found = calibrate(interpret(recording, stand, view="front"), SHAFT)
    assert found.status == "valid" and max(h.amplitude for h in found.harmonics) < 0.5e-3


def test_what_is_known_of_all_views_holds_what_each_knows_of_itself():
    """Form that changes along the shaft, and sag beyond slopes, were in a view's own covariance only."""
    small = calibrated(replace(TWO, running=replace(TWO.running, eccentricity=0.05)))
    for k, view in enumerate(small.views):
        own = slice(k * VIEW_UNKNOWNS, k * VIEW_UNKNOWNS + UNKNOWNS)
        assert np.array_equal(small.joint.matrix[own, own], view.covariance)
    least, *_, largest = np.linalg.eigvalsh(small.joint.matrix)
    assert least > -1e-12 * largest


@pytest.mark.parametrize("simulation", [CENTRED, OVAL], ids=["round", "oval: two azimuths fit"])
def test_a_centred_shaft_tells_no_azimuth(simulation):
    calibration = calibrated(simulation)
    assert "azimuth_deg" in calibration.of_view("rear").not_identifiable
    assert calibration.status == "untrusted" and "azimuth_unknown" in {r.code for r in calibration.reasons}


def test_the_phases_of_the_form_tell_the_azimuth_where_the_eccentricity_is_small():
    small = replace(TWO, running=replace(TWO.running, eccentricity=0.02))
    rear = calibrated(small).of_view("rear")
    assert abs(wrap(rear.azimuth - AZIMUTH)) < radians(rear.uncertainty["azimuth_deg"].U)


def test_height_is_not_told_where_a_view_does_not_see_the_shoulder():
    assert calibrated(TWO).of_view("rear").not_identifiable == ("height_mm",)
    above = replace(FRONT, phi=radians(-138.0)), REAR
    both = calibrated(two_views(*above)).of_view("rear")
    assert both.not_identifiable == () and abs(both.height) < both.uncertainty["height_mm"].U < 0.02


def test_a_shaft_that_was_clamped_again_between_the_views_is_noticed():
    again = replace(TWO, running=replace(TWO.running, eccentricity=0.95))
    calibration = calibrate_views((scans_of(TWO)[0], scans_of(again)[1]), SHAFT)
    assert "view_of_another_shaft" in {r.code for r in calibration.reasons}
    assert all(view.status == "untrusted" for view in calibration.views)


def test_without_a_common_zero_the_azimuth_is_not_told():
    stand = two_sensors()
    stand = replace(stand, table=replace(stand.table, start="unknown"))
    simulation = replace(TWO, acquisition=replace(TWO.acquisition, columns=()))
    calibration = calibrate_views(scans_of(simulation, stand), SHAFT)
    assert "azimuth_deg" in calibration.of_view("rear").not_identifiable
    assert [r.code for r in calibration.reasons] == ["angle_zero_unknown"]


def test_a_scan_is_rolled_up_by_the_calibration_of_its_view():
    calibration = calibrated(TWO)
    for scan in scans_of(TWO):
        surface = roll(scan, calibration)
        on_base = (surface.z > -8.0) & (surface.z < -1.0) & (np.abs(surface.radius - 12.5) < 0.2)
        assert surface.calibration.name == scan.view and np.count_nonzero(on_base) > 10_000
        assert np.median(surface.radius[on_base]) == pytest.approx(12.5, abs=2 * UM)
        assert max(abs(c.value) for c in verify(scan, calibration, SHAFT).changes) < 2 * UM
    with pytest.raises(BadRecipe, match="found a scan of view 'sensor', the calibration has 'front', 'rear'"):
        roll(replace(scan, stand=replace(scan.stand, sensors=(Sensor(),))), calibration)


def test_views_that_cannot_be_are_refused():
    front, rear = scans_of(TWO)
    with pytest.raises(BadRecipe, match="found the views front, front, need another one for each"):
        calibrate_views((front, front), SHAFT)
    faster = replace(rear.stand, table=replace(rear.stand.table, speed=1.0))
    with pytest.raises(BadRecipe, match="need one table for all views"):
        calibrate_views((front, replace(rear, stand=faster)), SHAFT)
    with pytest.raises(BadRecipe, match="found a scan of view 'side', the calibration has 'front', 'rear'"):
        calibrated(TWO).of_view("side")
    with pytest.raises(BadRecipe, match="found 2 sensors"):
        interpret(seen(TWO, "front").recording, two_sensors())
    with pytest.raises(BadRecipe, match="found view 'back', need one of the \\[\\[sensor\\]\\]s of the stand: 'front'"):
        interpret(seen(TWO, "front").recording, two_sensors(), view="back")
    carried = replace(seen(TWO, "front").recording, stand=two_sensors().of_view("front"))
    with pytest.raises(BadRecipe, match="found --view rear for a scan that carries view 'front'"):
        interpret(carried, two_sensors(), view="rear")
    assert interpret(carried, two_sensors()).view == "front"


def test_a_record_keeps_all_views(tmp_path):
    calibration = calibrated(TWO)
    record = write_calibration(tmp_path / "c.json", calibration, "2026-11-24")
    Draft202012Validator(json.loads(schema_text("calibration"))).validate(record)
    assert [s["name"] for s in record["sensors"]] == ["front", "rear"]
    assert record["sensors"][0]["table_from_sensor"] == record["sensor"]["table_from_sensor"]
    assert record["sensors"][1]["azimuth_deg"] == pytest.approx(120.0, abs=0.1)
    again = read_calibration(tmp_path / "c.json")
    assert again.joint.views == ("front", "rear") and np.array_equal(again.joint.matrix, calibration.joint.matrix)
    for one, other in zip(again.views, calibration.views, strict=True):
        assert np.allclose(one.table_from_sensor.matrix, other.table_from_sensor.matrix, atol=1e-12)
        assert np.allclose(one.shaft_from_rotor.matrix, other.shaft_from_rotor.matrix, atol=1e-7)
        assert (one.stand, one.checks, one.reasons) == (other.stand, other.checks, other.reasons)
    assert calibration_record(again, "2026-11-24").keys() == record.keys()


def test_half_a_turn_apart_they_see_opposite_sides():
    rear = replace(REAR, azimuth=pi)
    found = calibrated(two_views(FRONT, rear)).of_view("rear")
    assert abs(wrap(found.azimuth - pi)) < radians(found.uncertainty["azimuth_deg"].U)
