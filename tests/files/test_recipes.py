"""stand.toml and shaft.toml: exact keys, and a typo is an error that knows the right word."""

from math import cos, degrees, radians

import pytest

from truestand.core.errors import BadRecipe
from truestand.core.stand import Sensor, Stand, Table
from truestand.files.recipes.changes import differences
from truestand.files.recipes.parts import part_of, read_part
from truestand.files.recipes.recipes import (
    read_shaft,
    read_simulation,
    read_stand,
    shaft_from_recipe,
    shaft_recipe,
    stand_from_recipe,
    stand_recipe,
    write_starters,
)

STAND = """
[table]
speed_rad_per_s = 0.3141592653589793
direction = "cw"
start = "home"
[[sensor]]
name = "front"
profile_rate_hz = 200.0
points = 640
range_mm = [70.0, 120.0]
mirrored = true
serial = "S1"
linearity_U_um = 20.0
scale_U_ppm = 50.0
plane_offset_U_mm = 0.5
plane_tilt_U_deg = 0.25
incidence_U_um = 8.0
stability_U_um = 4.0
[scan]
y = "encoder"
counts_per_turn = 36000
[simulation]
seed_free = 1
"""
SHAFT = """
name = "shaft M"
[[cylinder]]
name = "base"
diameter_mm = 25.0
from_mm = -60.0
to_mm = 0.0
diameter_U_mm = 0.002
[[cylinder]]
name = "bearing"
diameter_mm = 13.94
from_mm = 0.0
to_mm = 35.0
coaxiality_U_mm = 0.003
[certificate]
id = "K-17"
date = 2026-03-01
valid_until = "2027-03-01"
temperature_C = 20.0
"""


def stand(folder, text):
    path = folder / "stand.toml"
    path.write_text(text, encoding="utf-8")
    return read_stand(path)


def shaft(folder, text):
    path = folder / "shaft.toml"
    path.write_text(text, encoding="utf-8")
    return read_shaft(path)


def test_units_end_at_the_border(tmp_path):
    made = stand(tmp_path, STAND)
    assert (made.table.sign, made.table.speed) == (-1, 0.3141592653589793)
    assert made.sensor.linearity_U == 0.02
    assert made.sensor.scale_U == pytest.approx(5e-5)
    assert (made.sensor.incidence_U, made.sensor.stability_U) == (0.008, 0.004)
    assert made.sensor.plane_tilt_U == radians(0.25)
    assert (made.y, made.counts_per_turn) == ("encoder", 36000)
    assert read_simulation(tmp_path / "stand.toml") == {"seed_free": 1}
    assert stand_from_recipe(stand_recipe(made)) == made


def test_the_certificate_keeps_dates_as_text(tmp_path):
    made = shaft(tmp_path, SHAFT)
    assert made.certificate.date == "2026-03-01"
    assert made.certificate.temperature == 20.0
    assert [c.radius for c in made.cylinders] == [12.5, 6.97]
    assert shaft_from_recipe(shaft_recipe(made)) == made


def test_a_byte_order_mark_does_no_harm(tmp_path):
    (tmp_path / "s.toml").write_bytes(b"\xef\xbb\xbf" + SHAFT.encode())
    assert read_shaft(tmp_path / "s.toml").name == "shaft M"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("direction", "directoin", ["[table]", "'directoin'", "did you mean 'direction'"]),
        ("range_mm", "range_in_mm", ["did you mean 'range_mm'"]),
        ("[scan]", "[scans]", ["'scans'", "did you mean 'scan'"]),
        ("counts_per_turn", "turns", ["unknown key 'turns'"]),
        ('"cw"', '"left"', ["direction", "'left'", "ccw"]),
        ("= 200.0", "= -200.0", ["profile_rate_hz", "-200"]),
        ("= 200.0", '= "fast"', ["profile_rate_hz", "fast"]),
        ("= 200.0", "= nan", ["profile_rate_hz"]),
        ("= 200.0", "= inf", ["profile_rate_hz"]),
        ("= 640", "= 0", ["points"]),
        ("[70.0, 120.0]", "[120.0, 70.0]", ["range_mm", "nearest"]),
        ("[70.0, 120.0]", "[120.0]", ["range_mm", "value 2 is missing"]),
        ("[70.0, 120.0]", "[70.0, 120.0, 130.0]", ["range_mm", "need 2 values"]),
        ("[70.0, 120.0]", "70.0", ["range_mm: found 70.0; need a list"]),
        ("= 640", "= true", ["points: found True; need no truth value"]),
        ("[table]", "[table", ["no valid TOML"]),
        ("[[sensor]]", "[sensor]", ["sensor"]),
    ],
)
def test_a_mistake_in_the_stand_is_named_in_one_line(tmp_path, old, new, words):
    with pytest.raises(BadRecipe) as caught:
        stand(tmp_path, STAND.replace(old, new))
    for word in ("stand.toml", *words):
        assert word in str(caught.value), str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_sensors_of_one_name_are_refused(tmp_path):
    with pytest.raises(BadRecipe, match=r"found two \[\[sensor\]\]s named 'front', need a name"):
        stand(tmp_path, '[[sensor]]\nname = "front"\n[[sensor]]\nname = "front"\n')


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("diameter_mm = 25.0", "diametre_mm = 25.0", ["[cylinder[1]]", "did you mean 'diameter_mm'"]),
        ("diameter_mm = 25.0", "", ["diameter_mm", "missing"]),
        ("diameter_mm = 25.0", "diameter_mm = 0.0", ["diameter_mm"]),
        ("[[cylinder]]", "[[cilinder]]", ["did you mean 'cylinder'"]),
        ("to_mm = 0.0", "to_mm = -70.0", ["base"]),
        ("from_mm = 0.0", "from_mm = -5.0", ["bearing"]),
        ("temperature_C", "temperature_c", ["did you mean 'temperature_C'"]),
    ],
)
def test_a_mistake_in_the_shaft_is_named_in_one_line(tmp_path, old, new, words):
    with pytest.raises(BadRecipe) as caught:
        shaft(tmp_path, SHAFT.replace(old, new))
    for word in ("shaft.toml", *words):
        assert word in str(caught.value), str(caught.value)


def test_files_that_are_no_recipes(tmp_path):
    with pytest.raises(BadRecipe, match="can't be read"):
        read_stand(tmp_path / "none.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadRecipe, match="UTF-8"):
        read_shaft(tmp_path / "b.toml")
    (tmp_path / "e.toml").write_bytes(b"")
    with pytest.raises(BadRecipe, match="missing"):
        read_shaft(tmp_path / "e.toml")


def test_the_starters_are_valid_and_never_overwritten_unasked(tmp_path):
    paths = write_starters(tmp_path)
    assert read_stand(paths[0]).table.direction == "ccw"
    assert read_shaft(paths[1]).cylinders[0].radius == 12.5
    paths[0].write_text("mine")
    with pytest.raises(BadRecipe, match="--force"):
        write_starters(tmp_path)
    assert paths[0].read_text() == "mine"


def test_the_starters_of_two_sensors_see_a_helical_gear(tmp_path):
    stand, _, gear = write_starters(tmp_path, views=2)
    assert [s.name for s in read_stand(stand).sensors] == ["front", "rear"]
    assert [view["name"] for view in read_simulation(stand)["view"]] == ["front", "rear"]
    assert degrees(read_part(gear).helix_angle) == pytest.approx(15.0)
    assert read_part(gear).tip_diameter == pytest.approx(48 / cos(radians(15.0)) + 4.0, abs=0.01)


GEAR = {
    "kind": "gear", "teeth": 24, "module_mm": 2.0, "face_width_mm": 20.0, "face_from_mm": 5.0, "tip_diameter_mm": 52.0,
    "root_diameter_mm": 43.0,
}  # fmt: skip


def test_limits_of_a_gear_as_drawings_state_them():
    """One number is the largest that is allowed, either way of a deviation with a sign; or lower and upper."""
    limits = {"F_p_um": 40, "f_Halpha_um": 12, "C_beta_um": [2.0, 8.0], "d_a_mm": [51.9, 52.0], "damage": "report"}
    gear = part_of({**GEAR, "limits": limits, "classes": {"f_p": 6}, "missing_teeth": [3, 4]}, "gear.toml")
    assert gear.limits == {
        "F_p": (None, 0.04), "f_Halpha": (-0.012, 0.012), "C_beta": (0.002, 0.008), "d_a": (51.9, 52.0)
    }  # fmt: skip
    assert gear.class_of("f_p") == 6 and gear.class_of("F_p") is None
    assert not gear.damage_decides and gear.missing_teeth == (3, 4)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"limits": {"f_p_mm": 0.04}}, "f_p_mm"),
        ({"limits": {"f_p_um": [8.0, 2.0]}}, r"need \[lower, upper\]"),
        ({"limits": {"f_p_um": -4.0}}, "f_p_um"),
        ({"limits": {"damage": "ignore"}}, "damage"),
        ({"classes": {"f_p": 13}}, "f_p"),
        ({"missing_teeth": [25]}, "numbers from 1 to 24"),
    ],
)
def test_a_mistake_in_the_limits_of_a_gear_is_named(changes, words):
    with pytest.raises(BadRecipe, match=words):
        part_of({**GEAR, **changes}, "gear.toml")


def test_a_sensor_that_a_calibration_is_not_of_changes_nothing(tmp_path):
    stand = Stand(Table(0.3), (Sensor("front", points=640),))
    record = {"stand": stand_recipe(stand)}
    path = tmp_path / "stand.toml"
    text = '[table]\nspeed_rad_per_s = 0.3\n[[sensor]]\nname = "front"\npoints = {}\n[[sensor]]\nname = "rear"\n'
    path.write_text(text.format(640))
    assert differences(record, path, None) == []
    path.write_text(text.format(320))
    assert differences(record, path, None) == ["stand.toml: sensor front points is 320, was 640"]
