"""The commands as users and machines rely on them: outputs, keys, exit codes, one helpful line for every mistake."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from command import run, run_process
from exports import scancontrol
from truestand.cli import main
from truestand.cli.demo import _demo_stand
from truestand.files.recipes.recipes import write_starters
from truestand.files.shapes.ply import ply_vertices

LOG = Path(__file__).parents[1] / "data" / "joescan" / "log.raw"
COMMANDS = [
    "demo",
    "init",
    "simulate",
    "import",
    "info",
    "calibrate",
    "verify",
    "roll",
    "form",
    "compare",
    "schema",
    "certificate",
]


def shown_and_loaded(*arguments):
    """What a command prints, and the modules that it loads."""
    script = f"import atexit, sys; atexit.register(lambda: print(*sys.modules)); sys.argv[1:] = {arguments!r}\n"
    script += "from truestand.cli.main import main; main()"
    shown = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, check=True)
    text, modules = shown.stdout.rstrip("\n").rsplit("\n", 1)
    return text, modules.split()


def test_help_names_every_command_and_loads_nothing_heavy():
    """Its 0.3 s of CPU are measured by bench/speed.py."""
    text, modules = shown_and_loaded("--help")
    assert all(name in text for name in COMMANDS)
    assert not {"numpy", "scipy", "matplotlib", "h5py", "pydantic", "fastapi"} & set(modules)


def test_calibrate_loads_nothing_that_only_inspecting_or_reading_other_files_needs():
    _, modules = shown_and_loaded("calibrate", "--help")
    assert "truestand.calibration.calibrate" in modules
    assert not [
        m for m in modules if m.startswith(("truestand.gear", "truestand.parts", "h5py", "scipy", "matplotlib"))
    ]


@pytest.mark.parametrize("commands", [main.COMMANDS, main.STAND_COMMANDS, main.STORE_COMMANDS])
def test_the_list_of_commands_shows_the_first_paragraph_of_each_command_s_help(commands):
    for name, (function, summary) in commands.items():
        paragraph, *_ = main.LazyCommand(name, function, summary).load().__doc__.split("\n\n")
        assert " ".join(paragraph.split()) == summary


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(command):
    shown = run(command, "--help")
    assert shown.returncode == 0
    assert f"truestand {command}" in shown.stdout


def test_an_error_ends_with_code_2_and_one_line(tmp_path):
    """In processes of their own; all else calls the same entry point in this one."""
    assert run_process("--version").stdout.startswith("truestand 0.")
    done = run_process("info", tmp_path / "none.csv")
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("truestand: ") and done.stderr.count("\n") == 1


def test_the_calibration_record_has_the_keys_and_the_truth(bench):
    record = json.loads((bench / "calibration.json").read_text(encoding="utf-8"))
    schema = json.loads(run("schema", "calibration").stdout)
    Draft202012Validator(schema).validate(record)
    truth = json.loads((bench / "truth.json").read_text(encoding="utf-8"))
    Draft202012Validator(json.loads(run("schema", "truth").stdout)).validate(truth)
    assert record["status"] == "valid"
    assert abs(record["shaft"]["eccentricity_um"] - truth["shaft"]["eccentricity_um"]) < 0.2
    assert abs(record["sensor"]["phi_deg"] - truth["sensor"]["phi_deg"]) < 0.002
    rotation = np.array(record["sensor"]["table_from_sensor"])[:3, :3]
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() <= 1e-12
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-12)
    assert record["created"].endswith("Z")


def test_csv_and_native_file_give_the_same_calibration(bench, tmp_path):
    out = tmp_path / "c.json"
    done = run(
        "calibrate",
        bench / "k1.csv",
        "--stand",
        bench / "stand.toml",
        "--artefact",
        bench / "shaft.toml",
        "-o",
        out,
        "--json",
    )
    assert done.returncode == 0, done.stderr
    printed, native = json.loads(done.stdout), json.loads((bench / "calibration.json").read_text(encoding="utf-8"))
    assert printed == json.loads(out.read_text(encoding="utf-8"))
    for key in ("sensor", "shaft", "residuals", "covariance"):
        assert printed[key] == native[key]


def test_the_paper_method_writes_its_keys_and_a_cloud(bench, tmp_path):
    out = tmp_path / "p.json"
    done = run("calibrate", bench / "k1.h5", "--artefact", bench / "shaft.toml", "--method", "paper", "-o", out)
    assert done.returncode == 0, done.stderr
    record = json.loads(out.read_text(encoding="utf-8"))
    assert record["sensor"]["laser_plane_offset_mm"] is None
    assert record["shaft"]["tilt_mrad"] is None
    assert record["paper"]["bin"] == 3
    assert -0.264 < record["paper"]["phase_error_pi"] < -0.236
    assert run("roll", bench / "k1.h5", "--calibration", out, "-o", tmp_path / "p.ply", "-q").returncode == 0


@pytest.mark.more
def test_roll_puts_the_shaft_where_the_drawing_has_it(bench, tmp_path):
    for suffix in ("ply", "xyz", "npz"):
        out = tmp_path / f"cloud.{suffix}"
        done = run("roll", bench / "k1.h5", "--calibration", bench / "calibration.json", "-o", out)
        assert done.returncode == 0, done.stderr
    cloud = ply_vertices((tmp_path / "cloud.ply").read_bytes(), "cloud.ply")
    assert list(cloud) == ["x", "y", "z", "profile", "point"]
    radius = np.hypot(cloud["x"], cloud["y"])
    base = (cloud["z"] < -2) & (cloud["z"] > -15)
    assert abs(np.median(radius[base]) - 12.5) < 0.01
    packed = np.load(tmp_path / "cloud.npz")
    assert np.allclose(packed["x"], cloud["x"], atol=1e-5)
    assert packed["profile"].size == len((tmp_path / "cloud.xyz").read_text().splitlines())


def test_a_minimal_calibration_record_is_accepted(bench, tmp_path):
    record = json.loads((bench / "calibration.json").read_text(encoding="utf-8"))
    minimal = {key: record[key] for key in ("format", "version", "table", "sensor", "shaft")}
    (tmp_path / "m.json").write_text(json.dumps(minimal))
    for name, calibration in (("full", bench / "calibration.json"), ("minimal", tmp_path / "m.json")):
        done = run("roll", bench / "k1.h5", "--calibration", calibration, "-o", tmp_path / f"{name}.ply")
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "full.ply").read_bytes() == (tmp_path / "minimal.ply").read_bytes()


@pytest.mark.more
def test_calibrate_takes_several_clampings(bench, tmp_path):
    """The shaft is not turned in the second scan: the commands and the record are what counts here."""
    common = ("--artefact", bench / "shaft.toml")
    assert run("simulate", bench / "stand.toml", *common, "-o", tmp_path / "k2.h5", "--seed", 3).returncode == 0
    both = (bench / "k1.h5", tmp_path / "k2.h5")
    done = run("calibrate", *both, *common, "--clamped-at-deg", "0,100", "-o", tmp_path / "c.json", "--json")
    assert done.returncode in (0, 3), done.stderr
    record = json.loads(done.stdout)
    Draft202012Validator(json.loads(run("schema", "calibration").stdout)).validate(record)
    assert record["positions"]["clamped_deg"] == pytest.approx([0.0, 100.0])
    assert len(record["positions"]["scans"]) == 2
    again = run("roll", bench / "k1.h5", "--calibration", tmp_path / "c.json", "-o", tmp_path / "c.ply")
    assert again.returncode in (0, 3), again.stderr


@pytest.mark.parametrize(
    "angles", [(), ("--clamped-at-deg", "0"), ("--clamped-at-deg", "0,x"), ("--clamped-at-deg", "0,nan")]
)
def test_several_scans_without_their_angles_are_wrong_use(bench, tmp_path, angles):
    both = (bench / "k1.h5", bench / "k1.h5")
    done = run("calibrate", *both, "--artefact", bench / "shaft.toml", *angles, "-o", tmp_path / "c.json")
    assert done.returncode == 2
    assert "--clamped-at-deg" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "c.json").exists()


@pytest.mark.more
def test_compare_lists_every_method_with_its_error(bench, tmp_path):
    common = ("--artefact", bench / "shaft.toml", "--truth", bench / "truth.json")
    done = run("compare", bench / "k1.h5", *common, "-o", tmp_path / "c.json", "--json")
    assert done.returncode == 0, done.stderr
    record = json.loads(done.stdout)
    assert json.loads((tmp_path / "c.json").read_text(encoding="utf-8")) == record
    Draft202012Validator(json.loads(run("schema", "comparison").stdout)).validate(record)
    exact = record["rows"][0]
    assert (exact["method"], exact["library"]) == ("exact model", "truestand")
    assert exact["axis_error_um"] < 1.0
    assert all(row["reason"] or row["eccentricity_um"] for row in record["rows"])
    wrong = run("compare", bench / "k1.h5", "--artefact", bench / "shaft.toml", "--truth", bench / "stand.toml")
    assert wrong.returncode == 2
    assert len(wrong.stderr.splitlines()) == 1


def test_verify_holds_moved_and_undecided(bench, tmp_path):
    common = ("--artefact", bench / "shaft.toml")
    again = run("simulate", bench / "stand.toml", *common, "-o", tmp_path / "k2.h5", "--seed", 7)
    assert again.returncode == 0
    known = ("--calibration", bench / "calibration.json")
    holds = run("verify", tmp_path / "k2.h5", *known, "-o", tmp_path / "v.json", "--json")
    assert holds.returncode == 0, holds.stderr + holds.stdout
    record = json.loads(holds.stdout)
    Draft202012Validator(json.loads(run("schema", "verification").stdout)).validate(record)
    assert record["verdict"] == "holds"

    text = (bench / "stand.toml").read_text(encoding="utf-8")
    for name, change in (
        ("sensor", ("phi_deg = -41.802", "phi_deg = -41.702")),
        ("shaft", ("eccentricity_um = 878.9", "eccentricity_um = 950.0")),
    ):
        (tmp_path / "moved.toml").write_text(text.replace(*change), encoding="utf-8")
        assert run("simulate", tmp_path / "moved.toml", *common, "-o", tmp_path / f"{name}.h5").returncode == 0
        moved = run("verify", tmp_path / f"{name}.h5", *known)
        assert moved.returncode == 1
        assert name in moved.stderr


def test_info(bench):
    facts = json.loads(run("info", bench / "k1.h5", "--json").stdout)
    Draft202012Validator(json.loads(run("schema", "info").stdout)).validate(facts)
    assert (facts["format"], facts["profiles"], facts["points_per_profile"]) == ("native", 2750, 320)
    assert facts["revolutions"] == pytest.approx(2.75)
    plain = json.loads(run("info", bench / "k1.csv", "--json").stdout)
    assert plain["format"] == "xyz blocks"
    assert plain["revolutions"] is None
    assert plain["points_seen"] == facts["points_seen"]


def test_recordings_of_a_file_of_several_heads_are_listed_and_picked(tmp_path):
    facts = json.loads(run("info", LOG, "--json").stdout)
    Draft202012Validator(json.loads(run("schema", "info").stdout)).validate(facts)
    assert (facts["format"], facts["profiles"], len(facts["recordings"])) == ("joescan raw", 24, 6)
    assert "--pick head2-camera1  4 profiles" in run("info", LOG).stdout
    refused = run("import", LOG, "-o", tmp_path / "log.h5")
    assert refused.returncode == 2
    assert "head2-camera1" in refused.stderr
    assert run("import", LOG, "--pick", "head2-camera1", "-o", tmp_path / "log.h5", "-q").returncode == 0
    taken = [json.loads(run("info", path, "--json").stdout) for path in (tmp_path / "log.h5", LOG)]
    own = {key: taken[0][key] for key in ("profiles", "points_per_profile", "points_seen")}
    assert own == {key: taken[1]["recordings"][5][key] for key in own}
    one = json.loads(run("info", LOG, "--pick", "head2-camera1", "--json").stdout)
    assert one["points_seen"] == own["points_seen"]


def test_a_raw_dump_is_imported_with_its_layout_and_refused_without(tmp_path):
    (tmp_path / "dump.raw").write_bytes(scancontrol(20, 640))
    refused = run("import", "dump.raw", "-o", "k.h5", cwd=tmp_path)
    assert refused.returncode == 2
    assert "--points 640" in refused.stderr
    assert "--raw-type" in run("info", "dump.raw", "--points", "640", cwd=tmp_path).stderr
    layout = ("--raw-type", "2950-50", "--points", "640")
    assert run("import", "dump.raw", *layout, "-o", "k.h5", cwd=tmp_path).returncode == 0
    facts = [json.loads(run("info", *f, "--json", cwd=tmp_path).stdout) for f in (("k.h5",), ("dump.raw", *layout))]
    assert [f["format"] for f in facts] == ["native", "scancontrol raw"]
    assert all((f["profiles"], f["points_seen"], f["angle_source"]) == (20, 12800, "encoder") for f in facts)


@pytest.mark.more
def test_the_report_is_one_file_that_explains_itself(bench, tmp_path):
    common = ("--artefact", bench / "shaft.toml", "--truth", bench / "truth.json", "-o", tmp_path / "c.json", "-q")
    assert run("calibrate", bench / "k1.h5", *common, "--report", tmp_path / "report.html").returncode == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "http" not in page.replace("http://www.w3.org", "")
    assert "<script" not in page
    for words in (
        "Published method and exact model",
        "Leakage",
        "Before and after",
        "static profile",
        "Checks",
        "truth",
    ):
        assert words in page


def bad_files(bench: Path, folder: Path) -> dict[str, Path]:
    """Files that carry no calibration, by name."""
    text = (bench / "k1.csv").read_bytes()
    native = (bench / "k1.h5").read_bytes()
    lines = text.split(b"\n")
    quarter = [*lines[:250], b"", *lines[2751:3001], b"", *lines[5502:5752]]
    lost = [b",".join([b"nan"] * 320)] * 1000
    contents = {
        "empty": b"",
        "truncated": text[: len(text) * 2 // 3],
        "truncated in the last line": text[:-3000],
        "binary": bytes(range(256)) * 100,
        "foreign": b"<html><body>no scan</body></html>\n" * 50,
        "foreign numbers": b"1,2,3\n4,5,6\n",
        "all lost": b"\n".join([*lost, b"", *[b"1"] * 1000, b"", *lost]) + b"\n",
        "quarter turn": b"\n".join(quarter) + b"\n",
        "truncated native": native[: len(native) // 2],
        "damaged native": native[:-2000] + bytes(1000) + native[-1000:],
    }
    paths = {}
    for name, content in contents.items():
        paths[name] = folder / f"{name}.csv"
        paths[name].write_bytes(content)
    paths["missing"] = folder / "missing.csv"
    return paths


def test_bad_scans_end_with_one_helpful_line_and_no_output(bench, tmp_path):
    for name, path in bad_files(bench, tmp_path).items():
        out, page = tmp_path / "c.json", tmp_path / "r.html"
        stand = ("--stand", bench / "stand.toml", "--artefact", bench / "shaft.toml")
        done = run("calibrate", path, *stand, "-o", out, "--report", page)
        assert done.returncode == 2, (name, done.returncode, done.stderr)
        assert done.stderr.startswith("truestand: "), (name, done.stderr)
        assert done.stderr.count("\n") == 1, (name, done.stderr)
        assert "Traceback" not in done.stderr
        assert len(done.stderr) > 40, (name, done.stderr)
        assert not out.exists(), name
        assert not page.exists(), name
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("calibrate", "k1.csv", "--artefact", "shaft.toml"), "--stand"),
        (("calibrate", "k1.h5", "--artefact", "nowhere.toml"), "nowhere.toml"),
        (("calibrate", "k1.h5", "k1.h5", "--artefact", "shaft.toml"), "--clamped-at-deg"),
        (("roll", "k1.h5", "--calibration", "truth.json", "-o", "c.ply"), "truestand.calibration"),
        (("roll", "k1.h5", "--calibration", "calibration.json", "-o", "c.foo"), ".ply"),
        (("import", "k1.csv", "-o", "k1.h5"), "--force"),
        (("simulate", "stand.toml", "-o", "k1.csv"), "--force"),
        (("init", "."), "--force"),
        (("schema", "nothing"), "calibration"),
        (("roll", "k1.h5", "--calibration", "calibration.json", "-o", "c.e57"), "e57"),
    ],
)
def test_wrong_use_ends_with_code_2_and_one_line(bench, arguments, words):
    done = run(*arguments, cwd=bench)
    assert done.returncode == 2, done.stderr
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(bench.glob("c.*"))


def test_unknown_options_end_with_2():
    assert run("calibrate", "--nonsense").returncode == 2
    assert run("nonsense").returncode == 2


def test_a_typo_in_a_recipe_names_the_right_key(bench, tmp_path):
    text = (bench / "stand.toml").read_text(encoding="utf-8").replace("profile_rate_hz", "profile_rate_Hz")
    (tmp_path / "stand.toml").write_text(text, encoding="utf-8")
    done = run("calibrate", bench / "k1.csv", "--stand", tmp_path / "stand.toml", "--artefact", bench / "shaft.toml")
    assert done.returncode == 2
    assert "did you mean 'profile_rate_hz'?" in done.stderr


def test_an_unknown_start_is_written_as_untrusted(bench, tmp_path):
    text = (bench / "stand.toml").read_text(encoding="utf-8").replace('start = "home"', 'start = "unknown"')
    (tmp_path / "stand.toml").write_text(text, encoding="utf-8")
    out = tmp_path / "c.json"
    stand = ("--stand", tmp_path / "stand.toml", "--artefact", bench / "shaft.toml")
    done = run("calibrate", bench / "k1.csv", *stand, "-o", out)
    assert done.returncode == 3
    record = json.loads(out.read_text(encoding="utf-8"))
    assert record["status"] == "untrusted"
    assert [r["code"] for r in record["reasons"]] == ["angle_zero_unknown"]
    assert "table angle" in record["reasons"][0]["text"]


@pytest.mark.stand
def test_the_demo_ends_with_its_table_and_paths(tmp_path):
    done = run_process("demo", "--out", tmp_path / "demo")
    assert done.returncode == 0, done.stderr
    for words in ("paper's method", "exact model", "truth", "report.html", "cloud.ply"):
        assert words in done.stdout
    assert (tmp_path / "demo" / "report.html").stat().st_size > 100_000


@pytest.mark.slow
def test_the_demo_with_two_sensors_measures_both_sides_of_a_helical_gear(tmp_path):
    done = run_process("demo", "--views", "2", "--out", tmp_path / "demo")
    assert done.returncode == 0, done.stderr
    assert "Views" in done.stdout and "gear-rear.h5" in done.stdout
    record = json.loads((tmp_path / "demo" / "inspection.json").read_text())
    pitch = {c["flank"]: c for c in record["characteristics"] if c["name"] == "F_p"}
    assert {c["status"] for c in pitch.values()} == {"measured"} and pitch.keys() == {"left", "right"}
    assert all(s["ok"] for s in record["seams"]) and len(record["scans"]) == 2
    assert "<h2>Sensors</h2>" in (tmp_path / "demo" / "report.html").read_text()


@pytest.mark.parametrize(
    ("command", "kept", "named"),
    [
        ("calibrate k1.h5 --artefact shaft.toml -o ./k1.h5", "k1.h5", "output and as scans"),
        ("calibrate k1.h5 --artefact shaft.toml -o shaft.toml", "shaft.toml", "output and as artefact"),
        ("calibrate k1.h5 --artefact shaft.toml -o c.json --report k1.h5", "k1.h5", "report and as scans"),
        ("calibrate k1.h5 --artefact shaft.toml -o c.html --report c.html", "k1.h5", "report and as output"),
        ("roll k1.h5 --calibration calibration.json -o k1.h5", "k1.h5", "output and as scan"),
        ("verify k1.h5 --calibration calibration.json -o calibration.json", "calibration.json", "as calibration"),
        ("form k1.h5 --calibration calibration.json --feature circle -o k1.h5", "k1.h5", "output and as points"),
        ("roll k1.h5 --calibration calibration.json -o k1.csv", "k1.csv", "a raw scan is never overwritten by this"),
    ],
)
def test_what_a_command_reads_is_never_written_over(bench, command, kept, named):
    before = (bench / kept).read_bytes()
    refused = run(*command.split(), cwd=bench)
    assert refused.returncode == 2 and refused.stderr.count("\n") == 1 and named in refused.stderr
    assert (bench / kept).read_bytes() == before and not (bench / "c.html").exists()


@pytest.mark.parametrize("output", [".", ".."])
def test_a_folder_is_no_output(bench, output):
    refused = run("calibrate", "k1.h5", "--artefact", "shaft.toml", "-o", output, cwd=bench)
    assert refused.returncode == 2 and "is a directory" in refused.stderr


@pytest.mark.parametrize("name", ["k1.h5", "gear.h5", "gear-rear.h5"])
def test_the_demo_never_overwrites_a_real_scan(tmp_path, name):
    (tmp_path / name).write_bytes(b"precious")
    done = run("demo", "--out", tmp_path)
    assert done.returncode == 2
    assert "--out" in done.stderr
    assert (tmp_path / name).read_bytes() == b"precious"
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_the_demo_leaves_other_scans_in_its_folder_alone(tmp_path):
    """It took all that begin with *k1* and *gear* for its own."""
    write_starters(tmp_path)
    for name in ("gear.h5", "gear-1234.h5", "k10.h5"):
        (tmp_path / name).write_bytes(b"precious")
    _demo_stand(tmp_path, quiet=True)
    assert {p.name for p in tmp_path.glob("*.h5")} == {"gear-1234.h5", "k10.h5"}


def test_form_of_points_and_of_a_calibrated_scan(bench, tmp_path):
    t = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    ring = np.column_stack([10 * np.cos(t) + 0.01 * np.cos(3 * t), 10 * np.sin(t), 0 * t + 5])
    np.savetxt(tmp_path / "ring.xyz", ring)
    done = run("form", tmp_path / "ring.xyz", "--feature", "circle", "--reference", "MZC", "-o", tmp_path / "form.json")
    assert done.returncode == 0, done.stderr
    assert "roundness" in done.stdout
    record = json.loads((tmp_path / "form.json").read_text())
    Draft202012Validator(json.loads(run("schema", "form").stdout)).validate(record)
    assert record["point"][2] == pytest.approx(5)
    assert record["certificate"]["imbalance"] < 1e-9
    scanned = run(
        "form", bench / "k1.h5", "--calibration", bench / "calibration.json", "--feature", "circle", "--json",
        "--filter-upr", "15",
    )  # fmt: skip
    assert scanned.returncode == 0, scanned.stderr
    found = json.loads(scanned.stdout)
    assert 1000 * found["form"] == pytest.approx(2 * 85 * 2 ** -((2 / 15) ** 2), rel=0.03)  # 85 um of 2 UPR
    assert 1000 * found["run_out"] == pytest.approx(2 * 85, rel=0.05)
    assert found["radius"] == pytest.approx(12.5, abs=0.01)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--feature", "plane", "--reference", "MIC"], "for a plane, need LSC or MZC"),
        (["--feature", "circle", "--filter-kind", "sharp"], "no --filter-upr"),
        (["--feature", "cylinder", "--filter-upr", "50"], "circular profile"),
        (["--feature", "circle", "--height-mm", "3"], "--calibration"),
        (["--feature", "circle"], "on one line"),
    ],
)
def test_form_refuses_in_one_line(tmp_path, arguments, message):
    np.savetxt(tmp_path / "p.xyz", np.arange(30.0)[:, None] * np.ones(3))
    done = run("form", tmp_path / "p.xyz", *arguments, "-o", tmp_path / "form.json")
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "form.json").exists()


CIRCLE_OF_5_MM = [(5 * np.cos(t), 5 * np.sin(t), 0.0) for t in np.linspace(0, 2 * np.pi, 72, endpoint=False)]


@pytest.mark.parametrize(
    ("header", "row", "arguments"),
    [
        ("id,x,y,z", "{i},{x:.6f},{y:.6f},{z:.6f}", []),
        ("x_um,y_um,z_um", "{x:.6f}e3,{y:.6f}e3,{z:.6f}e3", []),
        ("x_m,y_m,z_m", "{x:.6f}e-3,{y:.6f}e-3,{z:.6f}e-3", []),
        ("Z [mm];Y [um];X [m]", "{z:.6f};{y:.6f}e3;{x:.6f}e-3", []),
        ("id,east,north,up", "{i},{x:.6f}e3,{y:.6f}e3,{z:.6f}e3", ["--columns", "east,3,4", "--unit", "um"]),
        ("x_um,y_um", "{x:.6f}e3,{y:.6f}e3", []),
        ("x,z,intensity", "{x:.6f},{y:.6f},{i}", ["--columns", "x,z"]),
        ("radius_um,angle_deg", "5000,{degrees:.6f}", []),
        ("theta_rad;r", "{radians:.9f};5.0", []),
    ],
)
def test_form_places_columns_and_units_by_their_names(tmp_path, header, row, arguments):
    angle = 2 * np.pi / len(CIRCLE_OF_5_MM)
    rows = [row.format(i=i, x=x, y=y, z=z, radians=i * angle, degrees=np.degrees(i * angle))
            for i, (x, y, z) in enumerate(CIRCLE_OF_5_MM)]  # fmt: skip
    (tmp_path / "p.csv").write_text("\n".join([header, *rows, ""]))
    done = run("form", tmp_path / "p.csv", "--feature", "circle", "--json", *arguments)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["radius"] == pytest.approx(5, abs=1e-5)


@pytest.mark.parametrize(
    ("header", "arguments", "message"),
    [
        ("x,z,intensity", [], "no column 'y' among 'x, z, intensity'"),
        ("x_inch,y_inch,z_inch", [], "no column 'x'"),
        ("profile,x_mm,z_mm", [], "found a scan"),
        ("x_um,y_um,z_um", ["--unit", "mm"], "--unit mm"),
        ("x,y,z", ["--columns", "x"], "need two or three"),
        ("angle,radius,n", [], "need its unit: angle_deg or angle_rad"),
        ("x,y,z", ["--columns", "x,y,z", "--calibration", "c.json"], "are for points"),
    ],
)
def test_form_refuses_columns_that_it_can_not_place_in_one_line(tmp_path, header, arguments, message):
    np.savetxt(tmp_path / "p.csv", CIRCLE_OF_5_MM, delimiter=",", fmt="%.6f", header=header, comments="")
    done = run("form", tmp_path / "p.csv", "--feature", "circle", *arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_form_under_an_untrusted_calibration_ends_3_and_is_written(bench, tmp_path):
    record = json.loads((bench / "calibration.json").read_text())
    record["status"], record["reasons"] = "untrusted", ["made so by this test"]
    (tmp_path / "c.json").write_text(json.dumps(record))
    done = run(
        "form", bench / "k1.h5", "--calibration", tmp_path / "c.json", "--feature", "circle", "-o", tmp_path / "f.json"
    )
    assert done.returncode == 3
    assert "made so by this test" in done.stderr
    assert (tmp_path / "f.json").exists()


def test_form_writes_every_point_with_its_deviation(tmp_path):
    rows = [f"{x:.6f},{y:.6f},{z:.6f}" for x, y, z in CIRCLE_OF_5_MM]
    rows[5] = "nan,nan,nan"
    (tmp_path / "p.csv").write_text("\n".join(["x_mm,y_mm,z_mm", *rows, ""]))
    done = run("form", tmp_path / "p.csv", "--feature", "circle", "--points", tmp_path / "d.csv", "--json")
    assert done.returncode == 0, done.stderr
    header, *lines = (tmp_path / "d.csv").read_text().splitlines()
    assert header == "x_mm,y_mm,z_mm,deviation_um"
    assert len(lines) == len(rows)
    assert lines[5] == ",,,"
    assert lines[6].rpartition(",")[0] == rows[6]
    assert all(abs(float(line.rpartition(",")[2])) < 0.01 for line in lines if line != ",,,")


def test_form_remarks_on_columns_without_names(tmp_path):
    """Which three of them were taken stands in the record, and is said."""
    np.savetxt(tmp_path / "p.xyz", np.column_stack([CIRCLE_OF_5_MM, np.ones(72)]))
    done = run("form", tmp_path / "p.xyz", "--feature", "circle", "-o", tmp_path / "form.json")
    assert done.returncode == 0, done.stderr
    assert "the first 3 of 4 columns" in done.stderr
    assert json.loads((tmp_path / "form.json").read_text())["remarks"][0]["code"] == "columns_without_names"


def test_a_doubtful_feature_ends_3_and_is_written(tmp_path):
    np.savetxt(tmp_path / "p.xyz", np.random.default_rng(0).normal(size=(200, 3)))
    done = run("form", tmp_path / "p.xyz", "--feature", "cone", "-o", tmp_path / "form.json")
    assert done.returncode == 3
    assert "check that they are of a cone" in done.stderr
    record = json.loads((tmp_path / "form.json").read_text())
    Draft202012Validator(json.loads(run("schema", "form").stdout)).validate(record)
    assert record["status"] == "untrusted" and record["reasons"]
    assert record["half_angle"] is not None


def test_a_file_of_another_kind_is_refused_by_its_name(tmp_path):
    (tmp_path / "part.csv").write_text("ISO-10303-21;\nHEADER;\nENDSEC;\n")
    for arguments in (["info", tmp_path / "part.csv"], ["form", tmp_path / "part.csv", "--feature", "plane"]):
        done = run(*arguments)
        assert done.returncode == 2
        assert "this is a STEP model, need" in done.stderr
        assert len(done.stderr.splitlines()) == 1


def test_a_cone_through_no_more_points_than_it_needs_is_printed_without_doubt(tmp_path):
    t = np.arange(6.0)
    np.savetxt(tmp_path / "p.xyz", np.column_stack([(9 + t / 2) * np.cos(t), (9 + t / 2) * np.sin(t), t]))
    done = run("form", tmp_path / "p.xyz", "--feature", "cone")
    assert done.returncode in (0, 3), done.stderr
    assert "half angle" in done.stdout
