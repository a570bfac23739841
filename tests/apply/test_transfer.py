"""A calibration is applied only where something ties the two scans together: index, home, or the shaft in view."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from truestand.apply.transfer import roll, transfer, transfer_remarks
from truestand.apply.witness import witness
from truestand.calibration.calibrate import calibrate
from truestand.core.artefact import Artefact, Cylinder
from truestand.core.frames import RADIAL
from truestand.core.scan import interpret
from truestand.core.stand import Table
from truestand.core.surface import apply_calibration, table_angle
from truestand.parts.drawings import Section, Turned
from truestand.parts.inspect import inspect
from truestand.sim import FormWave, simulate
from truth import PLANE, TILTED, Named, scan_of, shaft

FOUND = Named(PLANE, TILTED, acquisition={"profiles": 1000, "columns": ("angle",)})
BLIND = Named(PLANE, TILTED, acquisition={"profiles": 1100})
NAMED = {"index": FOUND, "home": BLIND, "centred": replace(BLIND, running={"eccentricity": 0.0})}
GEAR_RADIUS = 25.0


@cache
def calibrated(name):
    named = NAMED[name]
    scan = interpret(simulate(named.stand(), named.simulation(), shaft(), 0).recording, named.stand())
    return calibrate(scan, shaft())


@cache
def homed_with(eccentricity):
    named = replace(BLIND, running={**BLIND.running, "eccentricity": eccentricity})
    return calibrate(
        interpret(simulate(named.stand(), named.simulation(), shaft(), 0).recording, named.stand()), shaft()
    )


def wheel():
    """The shaft with a wheel of 24 lobes on its seat: as far as the sensor can tell, a gear."""
    base, seat = shaft().cylinders
    return Artefact(
        (
            base,
            Cylinder("seat", seat.diameter, 0.0, 5.0),
            Cylinder("wheel", 47.0, 5.0, 25.0),
            Cylinder("end", seat.diameter, 25.0, 35.0),
        )
    )


def part_scan(name, start="home", seed=5, **changes):
    """A scan of the wheel on a named stand, with something changed since the calibration."""
    named = NAMED[name]
    mounting = {**named.mounting, **changes.get("mounting", {})}
    acquisition = {**named.acquisition, "profiles": 1100, **changes.get("acquisition", {})}
    running = {**named.running, **changes.get("running", {})}
    optics = {**named.optics, **changes.get("optics", {})}
    now = replace(named, mounting=mounting, acquisition=acquisition, running=running, optics=optics)
    simulation = now.simulation()
    lobes = (*simulation.workpiece.form, FormWave("wheel", 24, 2.0))
    simulation = replace(simulation, workpiece=replace(simulation.workpiece, form=lobes))
    stand = replace(now.stand(), table=replace(now.stand().table, start=start))
    return interpret(simulate(stand, simulation, wheel(), seed).recording, stand)


def scan_from_farther_out(by):
    """With the sensor farther out, across the axis, ``by`` so many mm than when it was calibrated by index."""
    outward = -calibrated("index").table_from_sensor.rotation[0, 2]
    return part_scan("index", mounting={"standoff": 95.0 + by / outward})


@pytest.fixture(scope="module")
def by_index():
    return calibrate(scan_of("mirrored, from above, clockwise"), shaft())


def test_a_scan_of_the_same_stand_gives_no_reasons(by_index):
    tied = transfer(scan_of("mirrored, from above, clockwise"), by_index)
    assert tied.calibration.reasons == ()
    assert tied.calibration.angle_zero == "index"


def test_another_sense_of_rotation_and_another_mirror_are_reasons(by_index):
    scan = scan_of("mirrored, from above, clockwise")
    turned = replace(scan, stand=replace(scan.stand, table=Table(scan.stand.table.speed, "ccw")))
    assert any("turns ccw" in r for r in transfer(turned, by_index).calibration.reasons)
    straight = replace(scan.stand.sensor, mirrored=False)
    straightened = replace(scan, stand=replace(scan.stand, sensors=(straight,)))
    assert any("mirrored differently" in r for r in transfer(straightened, by_index).calibration.reasons)


@pytest.mark.parametrize("start", [0.0, 0.0157, 0.5, 2.0, 4.0])
@pytest.mark.parametrize("zero", ["home", "unknown"])
def test_the_shaft_in_view_ties_a_scan_that_starts_elsewhere(start, zero):
    """Within 20 um at the gear's radius (TRUST.md): 0.8 mrad; a tenth of it is what the noise leaves."""
    scan = part_scan("home", zero, acquisition={"start_angle": start})
    tied = transfer(scan, calibrated("home"))
    assert tied.calibration.status == "valid", tied.calibration.reasons
    off = (tied.scan.angle[0] - start + np.pi) % (2 * np.pi) - np.pi
    assert abs(off) * GEAR_RADIUS < 0.002
    assert abs(off) < tied.witness.angle_U < 0.02 / GEAR_RADIUS
    assert tied.witness.surfaces == ("base",)


@pytest.mark.parametrize("speed", [0.997, 1.0013])
@pytest.mark.parametrize("eccentric", [0.88, 0.3])
def test_a_table_that_turns_at_another_speed_than_at_the_calibration_is_followed(speed, eccentric):
    """Homed, without an angle: *shaft turned against the table's zero*, or pitch with U of hundreds of um."""
    known = homed_with(eccentric)
    scan = part_scan("home", acquisition={"speed_factor": speed}, running={"eccentricity": eccentric})
    tied = transfer(scan, known)
    assert tied.calibration.status == "valid", tied.calibration.reasons
    assert tied.calibration.speed_change == pytest.approx(speed - 1.0, abs=tied.witness.gained_U / 6.9)
    turned = table_angle(tied.scan, tied.calibration)
    true = scan.angle * speed
    assert abs(turned - true).max() < tied.witness.angle_U + tied.witness.gained_U / 2
    assert tied.witness.angle_U == tied.calibration.angle_U
    (remark,) = (m for m in transfer_remarks(tied.calibration) if m.code == "table_speed_followed")
    assert ("faster" if speed > 1.0 else "slower") in remark


def test_a_shaft_that_has_turned_is_told_at_another_speed_too():
    """The band is too unsure of the angle to tie it."""
    known, running = homed_with(0.3), {"eccentricity": 0.3}
    scan = part_scan("home", acquisition={"speed_factor": 0.997, "start_angle": 0.03}, running=running)
    tied = transfer(scan, known)
    assert tied.witness.angle_U > 0.02 / GEAR_RADIUS
    assert [r.code for r in tied.calibration.reasons] == ["shaft_turned"]


def test_outliers_and_lost_readings_do_not_change_the_tie():
    scan = part_scan("home", "unknown", acquisition={"start_angle": 1.0}, optics={"outliers": 0.2, "dropouts": 0.1})
    tied = transfer(scan, calibrated("home"))
    assert tied.calibration.status == "valid"
    assert abs(tied.scan.angle[0] - 1.0) * GEAR_RADIUS < 0.005


def test_without_shaft_in_view_an_unknown_start_is_untrusted():
    scan = part_scan("home", "unknown")
    known = calibrated("home")
    height = apply_calibration(scan, known).z
    hidden = replace(scan, z=np.where(height > 4.0, scan.z, np.nan))
    tied = transfer(hidden, known)
    assert tied.witness is None
    assert any("--start-angle-deg" in r for r in tied.calibration.reasons)
    assert transfer(hidden, known, start_stated=True).calibration.status == "valid"


def test_a_centred_shaft_shows_no_direction():
    tied = transfer(part_scan("centred", "unknown"), calibrated("centred"))
    assert tied.calibration.status == "untrusted"
    assert tied.witness.angle_U > 0.1


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"mounting": {"standoff": 95.02}}, "sensor moved radially"),
        ({"mounting": {"plane_offset": 0.27}}, "against the table's zero"),
        ({"running": {"eccentricity": 0.9}}, "eccentrically"),
        ({"running": {"eccentricity_direction": 0.01}}, "against the table's zero"),
    ],
)
def test_what_moved_since_the_calibration_is_flagged(changes, what):
    tied = transfer(part_scan("index", **changes), calibrated("index"))
    assert any(what in r for r in tied.calibration.reasons)


def test_nothing_moved_is_no_alarm():
    tied = transfer(part_scan("index"), calibrated("index"))
    assert tied.calibration.status == "valid"
    assert len(tied.checks) == 4
    assert abs(tied.witness.radial) < 2e-4


def test_a_sleeve_on_the_shaft_is_no_witness():
    """A ring of 1 mm wall on the base, less than the reach: the rest of the base tells."""
    base, seat = shaft().cylinders
    lower = Cylinder("base", base.diameter, base.bottom, -8.0)
    sleeve = Cylinder("sleeve", base.diameter + 2.0, -8.0, 0.0)
    stand, simulation = BLIND.stand(), BLIND.simulation()
    scan = interpret(simulate(stand, simulation, Artefact((lower, sleeve, seat)), 3).recording, stand)
    found = witness(scan, calibrated("home"))
    assert abs(found.radial) < 5e-4


def test_roll_asks_what_transfer_asks():
    """The README's five lines: the table turned the other way, a scan that isn't whole, an angle that nothing ties."""
    scan, known = part_scan("index"), calibrated("index")
    assert roll(scan, known).calibration.reasons == ()
    stand = replace(scan.stand, table=replace(scan.stand.table, direction="cw"))
    assert any("check [table] direction" in r for r in roll(replace(scan, stand=stand), known).calibration.reasons)
    partial = replace(scan, reasons=("the scan is incomplete: 12 profiles lost; scan again",))
    assert "the scan is incomplete: 12 profiles lost; scan again" in roll(partial, known).calibration.reasons
    loose = part_scan("centred", "unknown")  # no direction in the band to tie it by
    assert any("counts from an unknown position" in r for r in roll(loose, calibrated("centred")).calibration.reasons)


def test_roll_ties_a_scan_once():
    scan, known = part_scan("home", "unknown"), calibrated("home")
    tied = transfer(scan, known)
    once, again = roll(scan, known), roll(tied.scan, tied.calibration)
    assert np.array_equal(once.x, again.x, equal_nan=True)
    assert once.calibration.reasons == again.calibration.reasons == ()
    unknown = part_scan("centred", "unknown")
    stated = transfer(unknown, calibrated("centred"), start_stated=True)
    assert roll(stated.scan, stated.calibration).calibration.reasons == stated.calibration.reasons == ()


def test_a_sensor_that_stands_a_little_farther_out_is_followed():
    """9 um across the axis, less than makes a scan untrusted: a diameter read 18 um too small, and said 8 um of U."""
    known = calibrated("index")
    tied = transfer(scan_from_farther_out(0.009), known)
    assert tied.calibration.status == "valid"
    moved = tied.calibration.table_from_sensor.translation - known.table_from_sensor.translation
    assert moved == pytest.approx([0.009, 0.0, 0.0], abs=5e-4)
    assert tied.calibration.covariance[RADIAL, RADIAL] >= known.covariance[RADIAL, RADIAL] + (
        tied.witness.radial_U / 2
    ) ** 2 * (1 - 1e-9)


@pytest.mark.more
def test_a_part_that_is_the_shaft_in_view_is_not_measured_by_itself():
    """A sensor 9 um farther out and a shaft 18 um smaller look alike: where it is the part, the sensor stays."""
    known, base = calibrated("index"), shaft().cylinders[0]
    surface = roll(scan_from_farther_out(0.009), known)
    assert surface.calibration.moved_out == pytest.approx(0.009, abs=5e-4)
    itself = Turned((Section("base", base.bottom + 1, base.top - 1, base.diameter),))
    before, found = inspect(roll(part_scan("index"), known), itself), inspect(surface, itself)
    assert found.characteristics[0].value - before.characteristics[0].value == pytest.approx(-0.018, abs=1e-3)
    assert not any("by the shaft in view" in r for r in found.remarks)
    beside = Turned((Section("wheel", 6.0, 24.0, 47.0),))
    assert any("by the shaft in view the sensor stands" in r for r in inspect(surface, beside).remarks)


@pytest.mark.parametrize(("drift", "flagged"), [(0.02, True), (-0.02, True), (0.004, False)])
def test_a_sensor_that_moves_while_the_part_is_scanned_is_flagged(drift, flagged):
    scan = part_scan("index")
    drifting = replace(scan, z=scan.z + np.linspace(-drift / 2, drift / 2, scan.profiles)[:, None])
    tied = transfer(drifting, calibrated("index"))
    assert any("during the scan" in r for r in tied.calibration.reasons) is flagged
