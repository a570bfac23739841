"""Jobs: the page's worker and the commands make the same records and keep the same files."""

import shutil
from datetime import UTC, datetime

import pytest
import trimesh

from command import run
from truestand.core.errors import BadRecipe
from truestand.files.records.record import read_json
from truestand.files.scans.read import read_scan
from truestand.report import drawing
from truestand.station import jobs
from truestand.station.jobs import Job, Observer
from truestand.store import Store

CAD = 'kind = "cad"\nfile = "base.stl"\nfit = "none"\nlimits_um = [-150.0, 150.0]\n'
SMALL = (("profiles = 11000 ", "profiles = 1100 "), ("points = 640", "points = 160"), ("hz = 200.0", "hz = 50.0"))


@pytest.fixture(scope="module")
def shop(tmp_path_factory):
    """Recipes, a scan of the shaft, its calibration, and the base of the shaft as a part with a CAD model."""
    folder = tmp_path_factory.mktemp("shop")
    assert run("init", folder).returncode == 0
    text = (folder / "stand.toml").read_text()
    for old, new in SMALL:
        assert old in text
        text = text.replace(old, new)
    (folder / "stand.toml").write_text(text)
    assert run("simulate", "stand.toml", "--artefact", "shaft.toml", "-o", "k1.h5", cwd=folder).returncode == 0
    assert run("calibrate", "k1.h5", "--artefact", "shaft.toml", cwd=folder).returncode == 0
    model = trimesh.creation.cylinder(radius=12.5, height=60.0, sections=180)
    model.apply_translation([0, 0, -30.0])
    model.export(folder / "base.stl")
    (folder / "part.toml").write_text(CAD)
    return folder


COMMANDS = {
    "calibrate": ("--artefact", "shaft.toml", "-o", "c.json", "--report", "c.html"),
    "inspect": ("--calibration", "calibration.json", "--part", "part.toml", "--report", "i.html", "--cloud", "i.ply"),
    "verify": ("--calibration", "calibration.json", "--artefact", "shaft.toml", "-o", "v.json"),
}
ROLES = {
    "calibrate": {"scan", "stand", "artefact", "report"},
    "inspect": {"scan", "stand", "calibration", "part", "model", "report", "cloud"},
    "verify": {"scan", "stand", "calibration", "artefact"},
}


def copied(scan):
    """In the place of a scan with the stand."""

    def take(job, observer, path):
        path.parent.mkdir()
        shutil.copy(scan, path)
        return (read_scan(path),)

    return take


def test_an_inspection_keeps_what_had_changed_in_the_recipes_since_its_calibration(shop, tmp_path, monkeypatch):
    monkeypatch.setattr(jobs, "_scans", copied(shop / "k1.h5"))
    monkeypatch.setattr(drawing, "svg", lambda fig: "")
    for name, old, new in (("stand", "linearity_U_um = 20.0", "linearity_U_um = 30.0"),
                           ("shaft", "diameter_mm = 25.0", "diameter_mm = 25.5")):  # fmt: skip
        (tmp_path / f"{name}.toml").write_text((shop / f"{name}.toml").read_text().replace(old, new))
    job = Job("inspect", tmp_path / "stand.toml", tmp_path / "job", tmp_path / "shaft.toml", shop / "part.toml",
              shop / "calibration.json")  # fmt: skip
    outcome = jobs.run_job(job, Observer())
    changes = [r["text"] for r in outcome.record["remarks"] if r["code"] == "recipe_changed"]
    assert changes == [
        "changed since the calibration: stand.toml: sensor front linearity_U_um is 30, was 20",
        "changed since the calibration: shaft.toml: cylinder base diameter_mm is 25.5, was 25",
    ]
    store = Store.open(tmp_path / "results", create=True)
    number = store.add(outcome.kind, outcome.record, outcome.evidence).number
    for name in ("stand", "shaft"):  # as it was is what counts
        shutil.copy(shop / f"{name}.toml", tmp_path / f"{name}.toml")
    assert store.standing().standing(number, datetime.now(UTC)) == "in_doubt"
    assert list(store.standing().doubts(number, datetime.now(UTC))) == changes


@pytest.mark.parametrize("kind", ROLES)
def test_a_job_and_a_command_give_the_same_record_and_evidence(shop, tmp_path, monkeypatch, kind):
    monkeypatch.setattr(jobs, "_scans", copied(shop / "k1.h5"))
    monkeypatch.setattr(drawing, "svg", lambda fig: "")  # half the time of a report
    paths = {name: shop / f"{name}.toml" for name in ("stand", "artefact", "part")} | {"artefact": shop / "shaft.toml"}
    job = Job(kind, folder=tmp_path / "job", calibration=shop / "calibration.json", **paths)
    steps = []
    outcome = jobs.run_job(job, Observer(lambda name, state: steps.append((name, state))))
    known = ROLES[kind] | {"artefact"}  # the page keeps the shaft's recipe of an inspection, too
    assert set(outcome.evidence) == known and all(path.is_file() for path in outcome.evidence.values())
    assert [name for name, state in steps if state == "done"] == [n for n, _ in jobs.STEPS[kind] if n != "acquire"]

    store = ("--store", tmp_path / "results", "--stand", "stand.toml", "-q")
    done = run(kind, "k1.h5", *COMMANDS[kind], *store, cwd=shop)
    assert done.returncode in (0, 3), done.stderr
    (entry,) = Store.open(tmp_path / "results").entries()
    assert set(entry.evidence) == ROLES[kind] and entry.kind == outcome.kind
    record = Store.open(tmp_path / "results").record(entry)
    assert record | {"created": ""} == outcome.record | {"created": ""}


@pytest.mark.parametrize(
    ("kind", "lacking"),
    [
        ("calibrate", "shaft.toml"),
        ("inspect", "a calibration"),
        ("inspect", "the part's recipe"),
        ("verify", "a calib"),
    ],
)
def test_a_job_without_an_input_is_refused_before_any_scan(shop, tmp_path, monkeypatch, kind, lacking):
    monkeypatch.setattr(jobs, "_scans", lambda *given: pytest.fail("took a scan"))
    part = None if lacking == "the part's recipe" else shop / "part.toml"
    calibration = shop / "calibration.json" if part is None else None
    with pytest.raises(BadRecipe, match=lacking):
        jobs.run_job(Job(kind, shop / "stand.toml", tmp_path, None, part, calibration), Observer())


def test_an_unreadable_recipe_is_refused_before_any_scan(shop, tmp_path, monkeypatch):
    monkeypatch.setattr(jobs, "_scans", lambda *given: pytest.fail("took a scan"))
    logo = '[company]\nlogo = "none.png"\n'
    (tmp_path / "stand.toml").write_text((shop / "stand.toml").read_text() + logo)
    job = Job("calibrate", tmp_path / "stand.toml", tmp_path / "job", shop / "shaft.toml")
    with pytest.raises(BadRecipe, match=r"none\.png"):
        jobs.run_job(job, Observer())
    assert not (tmp_path / "job").exists() and read_json(shop / "calibration.json")["status"] == "valid"
