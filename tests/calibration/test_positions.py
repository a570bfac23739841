"""Several clampings separate what one scan can't: laser plane and coaxiality, shaft and bearing."""

from dataclasses import replace
from functools import cache
from math import degrees, hypot, radians

import numpy as np
import pytest

from truestand.apply.verify import verify
from truestand.calibration.calibrate import calibrate
from truestand.calibration.positions import calibrate_positions
from truestand.core.errors import BadRecipe
from truestand.core.frames import sensor_parameters
from truestand.core.scan import interpret
from truestand.sim import FormWave, Misalignment, simulate
from truth import ABOVE, PLANE, TILTED, Named, shaft
from variants import tried

OFF = 0.02 * np.exp(0.7j)
"""mm: the bearing's axis against the base's, ten times the 2 um that a shaft without a certificate is taken to have."""
LEAN = 5e-4 * np.exp(2.1j)
OWN = (FormWave("base", 2, 0.085, 0.4), FormWave("base", 3, 0.004, 1.0), FormWave("bearing", 3, 0.006, 2.0))
BEARING = (2, 0.001, -1.0), (3, 0.002, 1.0)
STAND = Named({"phi": ABOVE, **PLANE}, TILTED, acquisition={"profiles": 2000, "columns": ("angle",)})


def artefact():
    """The shaft with a certificate that leaves its coaxiality open."""
    base, bearing = shaft().cylinders
    return replace(shaft(), cylinders=(base, replace(bearing, coaxiality_U=0.04)))


@cache
def scan(clamped_deg, standoff=95.0, turned=0.0, off=OFF, lean=LEAN, own=OWN):
    """The stand's scan with the shaft clamped at an angle, a bit more eccentric and elsewhere each time."""
    turn = radians(clamped_deg)
    off, lean = off * np.exp(1j * turn), lean * np.exp(1j * turn)
    base = STAND.simulation()
    form = tuple(replace(w, phase=w.phase + w.upr * turn) for w in own)
    form += tuple(FormWave(s, *wave) for s in ("base", "bearing") for wave in BEARING)
    axis = Misalignment("bearing", off.real, off.imag, lean.real, lean.imag)
    running = replace(base.running, eccentricity=0.85 + 0.0003 * clamped_deg, eccentricity_direction=0.3 + 0.5 * turn)
    simulation = replace(
        base, running=running, workpiece=replace(base.workpiece, form=form, misalignments=(axis,)),
        mounting=replace(base.mounting, standoff=standoff, phi=base.mounting.phi + turned),
    )  # fmt: skip
    return interpret(simulate(STAND.stand(), simulation, shaft(), int(clamped_deg)).recording, STAND.stand())


@cache
def found(*clamped_deg):
    scans = tuple(scan(a) for a in clamped_deg)
    return calibrate_positions(scans, tuple(radians(a) for a in clamped_deg), artefact())


def test_two_clampings_take_coaxiality_out_of_the_laser_plane():
    """20 um of coaxiality put a single scan's offset off by 200 um (18 um per um); GEOMETRY.md asks for 2 um here."""
    alone = calibrate(scan(0), artefact())
    assert {"laser_plane_offset_mm", "laser_plane_tilt_deg"} <= {*alone.not_identifiable}
    both = found(0, 180)
    assert both.status == "valid", both.reasons
    _, _, _, tilt, offset = sensor_parameters(both.table_from_sensor)
    U = both.uncertainty["laser_plane_offset_mm"].U
    assert abs(offset - PLANE["plane_offset"]) < U < 0.003
    assert degrees(abs(tilt - PLANE["plane_tilt"])) < both.uncertainty["laser_plane_tilt_deg"].U < 0.03
    assert not both.not_identifiable


@pytest.mark.more
def test_scans_whose_fits_have_form_of_other_orders_share_their_unknowns():
    """Of a base with a wave that one of two fits just did not see, the unknowns that both share were laid on others:
    the laser plane's tilt was 3 U off, and valid.
    """
    scans = scan(0), scan(180, own=(*OWN, FormWave("base", 9, 0.002, 0.0)))
    both = calibrate_positions(scans, (0.0, np.pi), artefact())
    _, _, _, tilt, offset = sensor_parameters(both.table_from_sensor)
    assert abs(offset - PLANE["plane_offset"]) < both.uncertainty["laser_plane_offset_mm"].U < 0.003
    assert degrees(abs(tilt - PLANE["plane_tilt"])) < both.uncertainty["laser_plane_tilt_deg"].U < 0.03


def test_an_axis_that_leans_within_its_certificate_is_no_moved_sensor():
    """45 urad of 57 across the eccentricity were one: each scan's own laser plane is drawn aside by what the
    certificate's weight leaves of it.
    """
    across = 4.5e-5j * np.exp(0.3j)
    scans = tuple(scan(clamped, off=0.0, lean=across, own=()) for clamped in (0, 180))
    both = calibrate_positions(scans, (0.0, np.pi), shaft())
    assert both.status == "valid", both.reasons
    _, _, _, tilt, offset = sensor_parameters(both.table_from_sensor)
    assert abs(offset - PLANE["plane_offset"]) < both.uncertainty["laser_plane_offset_mm"].U < 0.01
    assert degrees(abs(tilt - PLANE["plane_tilt"])) < both.uncertainty["laser_plane_tilt_deg"].U


def test_the_axes_of_the_steps_are_estimated():
    (axis,) = found(0, 180).positions.axes
    # The simulator states the offset at the drawing's middle of the bearing, here it counts where it was seen.
    middle = sum(getattr(shaft().cylinders[1], end) for end in ("bottom", "top")) / 2
    true = (OFF + LEAN * (axis.height - middle)) * np.exp(1j * np.pi)
    assert hypot(axis.x - true.real, axis.y - true.imag) < axis.U < 4e-4
    assert hypot(axis.slope_x + LEAN.real, axis.slope_y + LEAN.imag) < 2e-5


def test_the_pose_of_the_shaft_is_the_last_scans():
    assert found(0, 180).eccentricity == pytest.approx(0.85 + 0.0003 * 180, abs=2e-4)


@pytest.mark.slow
def test_form_and_bearing_are_separated():
    positions = found(0, 100).positions
    assert positions.inseparable == ()
    turn = radians(100)
    for wave in OWN:
        own = next(s for s in positions.form if (s.harmonic.surface, s.harmonic.upr) == (wave.surface, wave.upr))
        true = wave.amplitude * np.exp(-1j * (wave.phase + wave.upr * turn))
        turned = 2e-3 * wave.upr * wave.amplitude  # by the laser plane of each scan alone, 30 um at a radius of 15 mm
        assert abs(own.harmonic.amplitude * np.exp(-1j * own.harmonic.phase) - true) < 1e-4 + turned
    for upr, amplitude, phase in BEARING:
        table = next(s.harmonic for s in positions.bearing if s.harmonic.upr == upr)
        assert abs(table.amplitude * np.exp(-1j * table.phase) - amplitude * np.exp(-1j * phase)) < 1e-4


def test_half_a_turn_can_not_separate_even_harmonics():
    positions = found(0, 180).positions
    assert set(positions.inseparable) == {n for n in range(2, 40) if n % 2 == 0 and n <= max(positions.inseparable)}
    assert all(s.harmonic.upr % 2 for s in positions.bearing)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("moved", "turned", "status"), [(0.008, 0.0, "valid"), (0.02, 0.0, "untrusted"), (0.0, 1e-3, "untrusted")]
)
def test_a_sensor_that_moved_in_its_plane_between_the_scans_leaves_the_laser_plane(moved, turned, status):
    """With one place for both, 10 um between them put the plane 48 um off at U 18, and it was valid; half a milliradian
    tilted it by 3.3 U.
    """
    found = calibrate_positions((scan(0), scan(180, 95.0 + moved, turned)), (0.0, radians(180)), artefact())
    _, _, _, tilt, offset = sensor_parameters(found.table_from_sensor)
    assert abs(offset - PLANE["plane_offset"]) < 0.003
    assert abs(degrees(tilt - PLANE["plane_tilt"])) < 0.02
    # A sideways move as large would move the plane by half of it; two thirds of the standoff's lie radially.
    assert (moved or 95.0 * turned) / 3 < found.uncertainty["laser_plane_offset_mm"].U
    assert [r.code for r in found.reasons] == ["sensor_moved_between_scans"] * (status == "untrusted")
    assert found.status == status


@pytest.mark.parametrize("clamped", [(0.0,), (0.0, 0.05), (0.0, 2 * np.pi)])
def test_angles_that_are_much_the_same_are_refused(clamped):
    with pytest.raises(BadRecipe, match="clamping angles"):
        calibrate_positions((scan(0), scan(180)), clamped, artefact())


@pytest.mark.slow
@pytest.mark.parametrize("clamped", tried([(0.0, 60.0)], rarely=[((0.0, -100.0),)]))
def test_wrong_angles_are_noticed(clamped):
    """Turned by 100 degrees and stated otherwise: the scans read no one laser plane, or no one table bearing."""
    wrong = calibrate_positions((scan(0), scan(100)), tuple(map(radians, clamped)), artefact())
    assert any("check --clamped-at-deg" in r for r in wrong.reasons)


def test_the_same_scan_twice_and_scans_of_two_stands_are_refused():
    named = replace(scan(0), sha256="a")
    with pytest.raises(BadRecipe, match="the same scan twice"):
        calibrate_positions((named, replace(scan(180), sha256="a")), (0.0, radians(180)), artefact())
    homed = replace(scan(180), angle_source="index")
    with pytest.raises(BadRecipe, match="one zero for all"):
        calibrate_positions((scan(0), homed), (0.0, radians(180)), artefact())
    sensor = replace(scan(180).stand.sensor, name="rear")
    rear = replace(scan(180), stand=replace(scan(180).stand, sensors=(sensor,)))
    with pytest.raises(BadRecipe, match="by views 'front' and 'rear', need one view; leave out --clamped-at-deg"):
        calibrate_positions((scan(0), rear), (0.0, radians(180)), artefact())


def test_a_shaft_known_from_clampings_verifies_with_its_axes():
    """Without them its 20 um of coaxiality would count as a move of the laser plane."""
    now = verify(scan(180, 95.0), found(0, 180), artefact())
    assert now.verdict == "holds", now.reasons
