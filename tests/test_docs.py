"""The documentation is true: its code runs, its links lead somewhere, its keys exist."""

import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from command import run
from variants import tried

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")] + sorted(ROOT.glob("docs/**/*.md"))
FENCE = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
SMALL = {"profiles = 11000 ": "profiles = 1100 ", "points = 640": "points = 400", "hz = 200.0": "hz = 40.0"}


def code(page, language):
    return [text for kind, text in FENCE.findall(page.read_text(encoding="utf-8")) if kind == language]


def page_id(page):
    return str(page.relative_to(ROOT))


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """What the README's five lines need beside them: recipes, a scan of the shaft, a scan of a part."""
    folder = tmp_path_factory.mktemp("docs")
    assert run("init", folder).returncode == 0
    shrink(folder / "stand.toml")
    for name, seed, part in (("k1.csv", 1, ()), ("gear.csv", 2, ("--part", "gear.toml")), ("k2.csv", 3, ())):
        made = run("simulate", "stand.toml", "--artefact", "shaft.toml", *part, "-o", name, "--seed", seed, cwd=folder)
        assert made.returncode == 0, made.stderr
    return folder


def shrink(stand):
    """The same stand with fewer profiles and points: documentation is tried often."""
    text = stand.read_text(encoding="utf-8")
    for old, new in SMALL.items():
        assert old in text
        text = text.replace(old, new)
    stand.write_text(text, encoding="utf-8")


LONG = [ROOT / "docs" / name for name in ("inspect-a-gear.md", "where-to-put-the-sensor.md")]


@pytest.mark.parametrize("page", tried([p for p in PAGES if code(p, "python") and p not in LONG], *LONG), ids=page_id)
def test_python_of_the_page_runs(bench, page):
    for text in code(page, "python"):
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", text], cwd=bench, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    if page == ROOT / "README.md":
        assert done.stdout.strip() in ("does_not_conform", "undecided")


@pytest.mark.parametrize("page", tried([], "start.md", "inspect-a-gear.md"))
def test_the_page_runs_as_it_stands(page, tmp_path):
    commands = [line for text in code(ROOT / "docs" / page, "bash") for line in text.splitlines()]
    assert len(commands) > 5
    for command in commands:
        name, *arguments = shlex.split(command)
        assert name == "truestand"
        done = run(*arguments, cwd=tmp_path)
        assert done.returncode in ((1, 3) if arguments[0] == "inspect" else (0,)), (command, done.stderr)
        if arguments[0] == "init":
            shrink(tmp_path / "my-stand" / "stand.toml")
    assert (tmp_path / "report.html").exists()
    assert (tmp_path / ("part.ply" if page == "start.md" else "gear.ply")).exists()


@pytest.mark.more
def test_the_page_on_keeping_results_runs_as_it_stands(bench, tmp_path):
    folder = Path(shutil.copytree(bench, tmp_path / "bench"))
    codes = {"inspect": (1, 3), "verify": (0, 1, 3)}
    for text in code(ROOT / "docs" / "keep-results.md", "bash"):
        for command in text.splitlines():
            name, *arguments = shlex.split(command)
            assert name == "truestand"
            gage = "--gage-rr" in arguments  # one inspection is no study, and it says so
            done = run(*arguments, cwd=folder)
            assert done.returncode in ((2,) if gage else codes.get(arguments[0], (0,))), (command, done.stderr)
    assert run("audit", "--store", "copy-of-results", cwd=folder).returncode == 0


@pytest.mark.more
def test_the_page_on_plans_runs_as_it_stands(tmp_path):
    for text in code(ROOT / "docs" / "where-to-put-the-sensor.md", "bash"):
        for command in text.splitlines():
            name, *arguments = shlex.split(command)
            assert name == "truestand"
            done = run(*arguments, cwd=tmp_path)
            assert done.returncode in ((0, 3) if arguments[0] == "plan" else (0,)), (command, done.stderr)
            if arguments[0] == "init":
                shrink(tmp_path / "stand.toml")
    assert "Where to put the sensors" in (tmp_path / "plan.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)\s]+)\)", re.sub(FENCE, "", text)):
        if target.startswith("https://"):
            continue
        path, _, anchor = target.partition("#")
        file = page if not path else (page.parent / path).resolve()
        assert file.exists(), target
        if anchor:
            assert anchor in anchors(file), target


def anchors(page):
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


def test_the_formats_page_shows_files_that_can_be_read(tmp_path):
    blocks, long = [t for t in code(ROOT / "docs" / "formats.md", "text") if "\n0" in t]
    for text in (blocks, long):
        (tmp_path / "scan.csv").write_text(text)
        done = run("info", tmp_path / "scan.csv", "--json")
        assert done.returncode == 0, done.stderr
    page = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    schema = (ROOT / "src/truestand/files/records/schemas/calibration.json").read_text(encoding="utf-8")
    inspection = (ROOT / "src/truestand/files/records/schemas/inspection.json").read_text(encoding="utf-8")
    for key in re.findall(r'^ +"(\w+)": {', inspection, re.MULTILINE) + re.findall(
        r'^    "(\w+)": {', schema, re.MULTILINE
    ):
        assert f"`{key}" in page or key in ("properties", "items", "additionalProperties"), key


def test_every_setting_of_the_virtual_stand_is_explained():
    from truestand.sim.recipe import SimulationRecipe, simulation_from

    page = ROOT / "docs" / "build-your-stand.md"
    text = page.read_text(encoding="utf-8")
    tables = ("form", "keyway", "flat", "dirt", "misalignment", "diameter")
    for key in SimulationRecipe.model_fields:
        assert (f"[[simulation.{key}]]" if key in tables else f"`{key}`") in text, key
    example, _ = code(page, "toml")
    assert simulation_from(tomllib.loads(example)["simulation"]).workpiece.form[0].upr == 3


def test_every_error_of_a_virtual_gear_is_explained():
    from truestand.gear.drawing import Gear
    from truestand.sim import virtual_part_from
    from truestand.sim.recipe import CadPoseRecipe, GearErrorsRecipe

    page = ROOT / "docs" / "build-your-stand.md"
    text = page.read_text(encoding="utf-8")
    for key in (*GearErrorsRecipe.model_fields, *CadPoseRecipe.model_fields):
        assert (f"[[simulation.{key}]]" if key in ("dent", "worn", "scratch", "chip") else f"`{key}`") in text, key
    _, example = code(page, "toml")
    made = virtual_part_from(Gear(24, 2.0, 20.0, 5.0, 52.0, 43.0), tomllib.loads(example)["simulation"])
    assert made.errors.dents[0].depth == 0.04


def test_every_key_of_the_recipes_is_explained():
    from truestand.files.recipes import parts
    from truestand.files.recipes.recipes import (
        CertificateRecipe,
        CompanyRecipe,
        CylinderRecipe,
        ScanRecipe,
        SensorRecipe,
        StoreRecipe,
        TableRecipe,
    )

    text = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    stand = (TableRecipe, SensorRecipe, ScanRecipe, CylinderRecipe, CertificateRecipe, StoreRecipe, CompanyRecipe)
    part = (parts.GearRecipe, parts.EvaluationRecipe, parts.ModificationRecipe, parts.LimitsRecipe, parts.ClassesRecipe,
            parts.TurnedRecipe, parts.SectionRecipe, parts.CadRecipe, parts.PoseRecipe)  # fmt: skip
    for recipe in (*stand, *part):
        for key in recipe.model_fields:
            assert re.search(rf"`[^`]*\b{key}[`\]]", text), key


def test_every_key_of_a_plan_is_explained(tmp_path):
    from truestand.files.recipes.plan import KeepOutRecipe, PlanRecipe, read_task
    from truestand.files.records.schemas import schema_text

    page = ROOT / "docs" / "where-to-put-the-sensor.md"
    (example,) = code(page, "toml")
    for key in (*PlanRecipe.model_fields, *KeepOutRecipe.model_fields):
        assert re.search(rf"\b{key}\b", example), key
    stand = tmp_path / "stand.toml"
    stand.write_text(f"[[sensor]]\nrange_mm = [70.0, 120.0]\n{example}", encoding="utf-8")
    assert read_task(stand).most_views == 3
    formats = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    for key in re.findall(r'^ {4,}"(\w+)": {', schema_text("plan"), re.MULTILINE):
        assert f"`{key}" in formats or key in ("properties", "items", "additionalProperties"), key


def test_the_certificate_page_shows_a_laboratory_that_lacks_nothing(bench, tmp_path):
    from truestand.files.recipes import laboratory

    page = ROOT / "docs" / "certificate.md"
    text = page.read_text(encoding="utf-8")
    (example,) = code(page, "toml")
    (tmp_path / "laboratory.toml").write_text(example, encoding="utf-8")
    shaft = (bench / "shaft.toml").read_text(encoding="utf-8")
    (tmp_path / "shaft.toml").write_text(f'{shaft}\n[certificate]\nid = "7"\nlaboratory = "M"\n', encoding="utf-8")
    scan = ("calibrate", bench / "k1.csv", "--stand", bench / "stand.toml", "--artefact", "shaft.toml")
    assert run(*scan, cwd=tmp_path).returncode == 0
    for command in code(page, "bash"):
        name, *arguments = shlex.split(command.replace("--schema-dir schemas", ""))
        assert name == "truestand"
        done = run(*arguments, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert not done.stderr
    tables = (
        laboratory.LaboratoryTable,
        laboratory.ResponsibleRecipe,
        laboratory.StandTable,
        laboratory.PerformanceRecipe,
    )
    for key in {k for table in tables for k in table.model_fields}:
        assert re.search(rf"\b{key}\b", example), key
        assert key in text


def test_every_key_of_a_sensor_device_is_explained():
    from truestand.devices.sensors.recipe import SensorRecipe
    from truestand.files.checking import checked

    page = ROOT / "docs" / "protocols-sensors.md"
    text = page.read_text(encoding="utf-8")
    for key in SensorRecipe.model_fields:
        assert f"`{key}`" in text, key
    (example,) = code(page, "toml")
    for given in tomllib.loads(example)["devices"]["sensor"]:
        checked(SensorRecipe, given, page.name)


def test_nothing_names_a_machine_or_a_package_host_and_no_figure_is_missing():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for word in ("index-url", "to be filled in"):
            assert word not in text, (page.name, word)
        assert not re.search(r"/(home|root|work|tmp|Users)/", text), page.name


def test_the_readme_states_the_two_commands():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for marker, end in (("<!-- demo -->", "truestand demo --open"), ("<!-- tests -->", "-m pytest")):
        (command,) = re.findall(rf"{marker}\n```bash\n(.*)\n```", text)
        assert command.endswith(end)
    assert (ROOT / "docs" / "stand.svg").read_text(encoding="utf-8").startswith("<svg")
