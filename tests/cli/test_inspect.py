"""``truestand inspect`` and ``identify`` from outside: files, keys, exit codes."""

import csv
import json
import os
from dataclasses import replace
from importlib.resources import files

import jsonschema
import numpy as np
import pytest

from command import run, run_process
from truestand.core.surface import apply_calibration
from truestand.files.records.calibration_record import read_calibration
from truestand.files.records.inspection_record import judged_lines
from truestand.files.scans.read import read_recording, read_scan
from truestand.files.scans.write_scan import write_recording

PERFECT = "[simulation]\nphase_deg = 3.0\n"


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Recipes, a calibration, a scan of the starter's gear and one of a perfect gear."""
    folder = tmp_path_factory.mktemp("inspect")
    assert run("init", folder).returncode == 0
    stand = folder / "stand.toml"
    full = stand.read_text().replace("profiles = 11000 ", "profiles = 4400 ")
    (folder / "full.toml").write_text(full)  # for dents of 30 um
    stand.write_text(full.replace("points = 640", "points = 214"))
    drawing = (folder / "gear.toml").read_text().split("# Only `truestand simulate`")[0]
    (folder / "perfect.toml").write_text(drawing.replace("accuracy_class = 7", "accuracy_class = 11") + PERFECT)
    (folder / "unknown.toml").write_text(stand.read_text().replace('start = "home"', 'start = "unknown"'))
    for out, recipe, more in (
        ("k1.h5", "stand.toml", ()),
        ("gear.h5", "stand.toml", ("--part", "gear.toml", "--truth", "truth.json")),
        ("dents.h5", "full.toml", ("--part", "gear.toml")),
        ("perfect.h5", "stand.toml", ("--part", "perfect.toml")),
    ):
        done = run("simulate", recipe, "--artefact", "shaft.toml", *more, "-o", out, cwd=folder)
        assert done.returncode == 0, done.stderr
    assert run("calibrate", "k1.h5", "--artefact", "shaft.toml", cwd=folder).returncode == 0
    return folder


def inspect(bench, *arguments, scan="gear.h5", part="gear.toml"):
    return run("inspect", scan, "--calibration", "calibration.json", "--part", part, *arguments, cwd=bench)


def test_a_gear_with_errors_does_not_conform(bench):
    done = inspect(bench, "--truth", "truth.json", scan="dents.h5")
    assert done.returncode == 1, done.stderr
    assert "does not conform" in done.stdout and "paper's method" in done.stdout
    record = json.loads((bench / "inspection.json").read_text())
    schema = json.loads(files("truestand.files.records.schemas").joinpath("inspection.json").read_text())
    jsonschema.Draft202012Validator(schema).validate(record)
    truth = json.loads((bench / "truth.json").read_text())["part"]
    for c in judged_lines(record):
        if c["name"] in ("F_p", "f_p"):
            assert c["value_um"] == pytest.approx(truth[f"{c['name']}_{c['flank']}_um"], abs=1.0)
            assert c["U_um"] > 0 and c["limit_um"] in (12.0, 35.0)
    kinds = {(d["tooth"], d["flank"], d["kind"]) for d in record["defects"]}
    assert kinds == {(5, "left", "dent"), (16, "right", "dent"), (11, None, "chipped end")}
    assert "NaN" not in (bench / "inspection.json").read_text()


@pytest.fixture(scope="module")
def written(bench):
    """All that one inspection can write, under the company's name."""
    text = (bench / "stand.toml").read_text().replace("[scan]", '[company]\nname = "Precis & Co"\n\n[scan]')
    (bench / "company.toml").write_text(text)
    files = ("--csv", "c.csv", "--cloud", "c.ply", "--report", "k.html", "-o", "c.json", "--stand", "company.toml")
    assert inspect(bench, *files, "-q").returncode == 1
    return bench


@pytest.mark.more
def test_the_characteristics_as_csv(written):
    with (written / "c.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    lines = judged_lines(json.loads((written / "c.json").read_text()))
    assert [(r["name"], r["flank"]) for r in rows] == [(c["name"], c["flank"] or "") for c in lines]
    assert float(rows[0]["value"]) == lines[0]["value_um"]
    assert rows[0]["verdict"] == lines[0]["verdict"]


def test_a_pdf_without_its_extra_is_refused_before_the_work(bench, tmp_path, monkeypatch):
    (tmp_path / "weasyprint.py").write_text("raise ImportError('absent')")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    common = ("--calibration", "calibration.json", "--part", "gear.toml")
    done = run_process("inspect", "gear.h5", *common, "--report", "r.pdf", "-o", "never.json", cwd=bench)
    assert done.returncode == 2
    assert "pip install 'truestand[pdf]'" in done.stderr
    assert not (bench / "never.json").exists() and not (bench / "r.pdf").exists()


@pytest.mark.more
def test_the_company_stands_at_the_head_of_the_report(written):
    report = (written / "k.html").read_text(encoding="utf-8")
    assert "Precis &amp; Co" in report and "does not conform" in report.lower()
    text = (written / "company.toml").read_text()
    (written / "logo.toml").write_text(text.replace('name = "Precis & Co"', 'logo = "none.png"'))
    done = inspect(written, "--stand", "logo.toml", "-o", "k2.json")
    assert done.returncode == 2
    assert "none.png can't be read" in done.stderr


def test_the_cloud_carries_the_deviations(written):
    data = (written / "c.ply").read_bytes()
    header, body = data.split(b"end_header\n", 1)
    assert b"property float deviation" in header
    kind = np.dtype([(n, "<f4") for n in "xyz"] + [("profile", "<i4"), ("point", "<i4"), ("deviation", "<f4")])
    points = np.frombuffer(body, kind)
    judged = np.isfinite(points["deviation"])
    assert 0.01 < judged.mean() < 0.9
    assert np.median(np.abs(points["deviation"][judged])) < 50.0  # um


def test_a_perfect_gear_conforms_to_a_coarse_class(bench):
    done = inspect(bench, "-o", "p.json", "--json", scan="perfect.h5", part="perfect.toml")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["verdict"] == "conforms"


@pytest.mark.more
def test_a_class_finer_than_the_uncertainty_is_undecided_and_ends_3(bench):
    text = (bench / "perfect.toml").read_text().replace("accuracy_class = 11", "accuracy_class = 7")
    (bench / "fine.toml").write_text(text)
    assert inspect(bench, "-o", "u.json", scan="perfect.h5", part="fine.toml").returncode == 3
    assert json.loads((bench / "u.json").read_text())["verdict"] == "undecided"


@pytest.mark.more
def test_an_untrusted_calibration_ends_3_and_says_why(bench):
    record = json.loads((bench / "calibration.json").read_text())
    record["status"], record["reasons"] = "untrusted", ["dropped"]
    (bench / "untrusted.json").write_text(json.dumps(record))
    done = run(
        "inspect", "gear.h5", "--calibration", "untrusted.json", "--part", "gear.toml", "-o", "x.json", cwd=bench
    )
    assert done.returncode == 3 and "untrusted: dropped" in done.stderr
    assert json.loads((bench / "x.json").read_text())["reasons"] == [{"code": "uncoded", "text": "dropped"}]


def test_a_wrong_drawing_ends_2_and_writes_nothing(bench):
    text = (bench / "gear.toml").read_text().replace("teeth = 24", "teeth = 23").replace("= 52.0", "= 50.0")
    (bench / "wrong.toml").write_text(text)
    done = inspect(bench, "-o", "none.json", "--report", "none.html", part="wrong.toml")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and "saw 24 teeth, module 2 mm" in done.stderr
    assert not (bench / "none.json").exists() and not (bench / "none.html").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("teeth = 24", "teath = 24"), "did you mean 'teeth'"),
        (('kind = "gear"', 'kind = "cog"'), "need one of gear, turned, cad"),
        (("tip_diameter_mm = 52.0", "tip_diameter_mm = 42.0"), "tip above the root"),
        (("accuracy_class = 7", "accuracy_class = 12"), "need 1..11"),
    ],
)
def test_a_bad_recipe_ends_2_in_one_line(bench, change, message):
    (bench / "bad.toml").write_text((bench / "gear.toml").read_text().replace(*change))
    done = inspect(bench, "-o", "none.json", part="bad.toml")
    assert done.returncode == 2
    assert message in done.stderr and done.stderr.count("\n") == 1
    assert not (bench / "none.json").exists()


@pytest.fixture(scope="module")
def turned(bench):
    """A scan of the gear that starts at another table angle than the calibration's."""
    recipe = (bench / "unknown.toml").read_text().replace("fan_deg", "start_angle_deg = 77.0\nfan_deg")
    (bench / "turned.toml").write_text(recipe)
    common = ("--artefact", "shaft.toml", "--part", "gear.toml")
    made = run("simulate", "turned.toml", *common, "-o", "turned.h5", cwd=bench)
    assert made.returncode == 0, made.stderr
    return bench / "turned.h5"


@pytest.mark.more
def test_a_scan_from_another_table_angle_is_tied_by_the_shaft_in_view(bench, turned):
    assert inspect(bench, "-o", "home.json").returncode == 1
    done = inspect(bench, "-o", "turned.json", scan=turned)
    assert done.returncode == 1, done.stderr
    home, tied = (pitch(bench / name) for name in ("home.json", "turned.json"))
    for key, value in home.items():
        assert tied[key] == pytest.approx(value, abs=2.0)  # the noise of two scans of 214 points


def pitch(path):
    lines = judged_lines(json.loads(path.read_text()))
    return {(c["name"], c["flank"]): c["value_um"] for c in lines if c["name"] in ("F_p", "f_p")}


@pytest.mark.more
def test_without_the_shaft_in_view_an_unknown_start_ends_3(bench, turned):
    """The same scan without its readings of the shaft; the calibration's own zero is the table's home."""
    recording = read_recording(turned)
    surface = apply_calibration(read_scan(turned), read_calibration(bench / "calibration.json"))
    z = np.where(surface.z < 5.0, np.nan, recording.z)
    blind = replace(recording, x=np.where(np.isnan(z), np.nan, recording.x), z=z)
    write_recording(blind, bench / "blind.h5", recording.stand, force=True)
    done = inspect(bench, "-o", "blind.json", scan="blind.h5")
    assert done.returncode == 3
    assert "bring the shaft into view" in done.stderr
    assert json.loads((bench / "blind.json").read_text())["verdict"] == "undecided"


def test_an_unknown_gear_is_identified_and_its_recipe_inspected(bench):
    done = run("identify", "gear.h5", "--calibration", "calibration.json", "-o", "found.toml", cwd=bench)
    assert done.returncode == 0, done.stderr
    assert "24 teeth, module 2" in done.stdout
    done = inspect(bench, "-o", "found.json", scan="gear.h5", part="found.toml")
    assert done.returncode == 1 and "no line has a limit" in done.stderr  # but its eleventh tooth is chipped by 0.5 mm
    assert (
        run("identify", "gear.h5", "--calibration", "calibration.json", "-o", "found.toml", cwd=bench).returncode == 2
    )
    done = run("identify", "gear.h5", "--calibration", "calibration.json", "--json", cwd=bench)
    assert json.loads(done.stdout)["teeth"] == 24


def test_a_turned_part_and_a_cad_model_are_inspected_by_the_same_command(bench):
    """The calibration's shaft as a turned part, and as a cylinder of triangles."""
    import trimesh

    (bench / "shaft-part.toml").write_text(
        'kind = "turned"\n[[section]]\nname = "base"\nfrom_mm = -12.0\nto_mm = -2.0\ndiameter_mm = 25.0\n'
        "limits_mm = [24.97, 25.03]\nroundness_um = 100.0\n"
    )
    done = inspect(bench, "-o", "turned-part.json", "--report", "t.html", scan="k1.h5", part="shaft-part.toml")
    assert done.returncode == 1, done.stderr  # 85 um oval: 170 um of roundness
    lines = {c["name"]: c for c in json.loads((bench / "turned-part.json").read_text())["characteristics"]}
    assert lines["d"]["value_mm"] == pytest.approx(25.0, abs=0.0005) and lines["d"]["verdict"] == "conforms"
    assert lines["roundness"]["value_um"] == pytest.approx(170.0, abs=1.0)
    assert lines["roundness"]["verdict"] == "does_not_conform" and lines["roundness"]["section"] == "base"

    model = trimesh.creation.cylinder(radius=12.5, height=60.0, sections=720)
    model.apply_translation([0, 0, -30.0])
    model.export(bench / "base.stl")
    (bench / "cad.toml").write_text('kind = "cad"\nfile = "base.stl"\nfit = "none"\nlimits_um = [-150.0, 150.0]\n')
    done = inspect(bench, "-o", "cad.json", "--report", "c.html", scan="k1.h5", part="cad.toml")
    assert done.returncode == 0, done.stderr
    schema = json.loads(files("truestand.files.records.schemas").joinpath("inspection.json").read_text())
    for name in ("turned-part.json", "cad.json"):
        jsonschema.Draft202012Validator(schema).validate(json.loads((bench / name).read_text()))
    lines = {c["name"]: c for c in json.loads((bench / "cad.json").read_text())["characteristics"]}
    assert lines["deviation_max"]["value_um"] == pytest.approx(85.0, abs=3.0)
