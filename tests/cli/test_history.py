"""Results kept by the commands, and history, audit and store of them."""

import json
import re
import shutil

import numpy as np
import pytest

from command import run
from truestand.store import Store

PIN = """kind = "turned"
name = "pin"
serial = "12"
[[section]]
name = "seat"
from_mm = 8.0
to_mm = 25.0
diameter_mm = 20.0
limits_mm = [19.9, 20.1]
"""


@pytest.fixture(scope="module")
def shop(bench, tmp_path_factory):
    """A folder after some work: two calibrations, a verification, an inspection, all in ``results``."""
    folder = tmp_path_factory.mktemp("shop")
    for name in ("stand.toml", "shaft.toml", "k1.csv"):
        shutil.copy(bench / name, folder / name)
    (folder / "pin.toml").write_text(PIN)
    with (folder / "stand.toml").open("a") as file:
        file.write('\n[store]\nfolder = "results"\n\n[company]\nname = "Gears & Sons"\n')
    artefact = ("--artefact", "shaft.toml")
    for name, seed, part in (("k2.csv", 2, ()), ("pin.csv", 3, ("--part", "pin.toml"))):
        done = run("simulate", "stand.toml", *artefact, *part, "-o", name, "--seed", seed, cwd=folder)
        assert done.returncode == 0, done.stderr
    stand = ("--stand", "stand.toml")
    calibrate = ("calibrate", "k1.csv", *artefact, *stand, "-o", "c1.json", "--report", "c1.html", "--operator", "Eva")
    assert_ended(run(*calibrate, cwd=folder), 0, "kept as entry 1")
    assert_ended(run("calibrate", "k2.csv", *artefact, *stand, "-o", "c2.json", cwd=folder), 0, "kept as entry 2")
    verify = ("verify", "k2.csv", "--calibration", "c1.json", "--store", "results", "--operator", "Jan")
    assert_ended(run(*verify, cwd=folder), 0, "kept as entry 3")
    inspect = ("inspect", "pin.csv", "--calibration", "c1.json", "--part", "pin.toml", *stand, "-o", "i.json")
    assert_ended(run(*inspect, "--serial", "13", "--operator", "Jan", cwd=folder), 0, "kept as entry 4")
    return folder


def assert_ended(done, code, words):
    assert done.returncode == code, done.stderr
    assert words in done.stderr


@pytest.mark.more
def test_results_are_kept_with_their_evidence(shop):
    store = Store.open(shop / "results")
    calibration, _, verification, inspection = store.entries()
    assert set(calibration.evidence) == {"scan", "artefact", "stand", "report"} and calibration.operator == "Eva"
    assert store.record(calibration) == json.loads((shop / "c1.json").read_text(encoding="utf-8"))
    assert store.evidence(calibration)["scan"].read_bytes() == (shop / "k1.csv").read_bytes()
    assert verification.status == "holds" and verification.evidence["calibration"] == calibration.record
    assert inspection.evidence["calibration"] == calibration.record
    assert (inspection.serial, inspection.operator, inspection.part) == ("13", "Jan", "pin")
    assert store.record(inspection)["part"]["serial"] == "13"


def test_without_a_store_nothing_is_kept(shop, tmp_path):
    done = run("verify", shop / "k2.csv", "--calibration", shop / "c1.json", cwd=tmp_path)
    assert done.returncode == 0 and not list(tmp_path.iterdir())


def test_an_unusable_store_is_refused_before_the_work(shop, tmp_path):
    (tmp_path / "file").write_text("x")
    done = run("calibrate", shop / "k1.csv", "--artefact", shop / "shaft.toml", "--stand", shop / "stand.toml",
               "-o", tmp_path / "c.json", "--store", tmp_path / "file")  # fmt: skip
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and not (tmp_path / "c.json").exists()


def test_history_in_the_terminal_as_json_and_as_a_page(shop):
    done = run("history", "--report", "h.html", cwd=shop)
    assert done.returncode == 0, done.stderr
    assert "front: phi_deg" in done.stdout and "conforms" in done.stdout and "provisional" in done.stdout
    one = run("history", "--store", "results", "--quantity", "phi_deg", cwd=shop)
    assert one.returncode == 0 and len(re.findall(r"-41\.80|−41\.80", one.stdout)) >= 2, one.stdout
    found = json.loads(run("history", "--json", cwd=shop).stdout)
    phi = next(q for q in found["quantities"] if q["name"] == "phi_deg")
    assert [r["entry"] for r in phi["readings"]] == [1, 2] and phi["lower"] < phi["mean"] < phi["upper"]
    assert phi["readings"][1]["change"] == pytest.approx(phi["drift"])
    assert found["inspections"][0]["verdict"] == "conforms" and not found["inspections"][0]["corrected"]
    page = (shop / "h.html").read_text(encoding="utf-8")
    assert page.count("<svg") == len(found["quantities"]) and "Gears &amp; Sons" in page
    assert not re.search(r'(src|href)="http', page)
    later = json.loads(run("history", "--since", "2100-01-01", "--json", cwd=shop).stdout)
    assert later["quantities"] == [] == later["inspections"]
    assert run("history", "--since", "2100-01-01", "--report", "empty.html", cwd=shop).returncode == 0
    assert run("history", "--since", "soon", cwd=shop).returncode == 2


def test_audit_finds_a_flipped_bit(shop, tmp_path):
    done = run("audit", "--json", cwd=shop)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["sound"] and found["sealed"] and found["entries"] >= 4
    assert run("audit", "--noted", found["head"]["hash"], "-q", cwd=shop).returncode == 0
    assert run("audit", "--noted", "0" * 64, "-q", cwd=shop).returncode == 1
    copy = shutil.copytree(shop / "results", tmp_path / "results")
    (scan,) = (copy / "evidence").glob(f"*/{Store.open(copy).entry(1).evidence['scan']}")
    scan.chmod(0o644)
    data = bytearray(scan.read_bytes())
    data[100] ^= 4
    scan.write_bytes(data)
    done = run("audit", "--store", copy)
    assert done.returncode == 1 and "evidence changed" in done.stdout and "entry 1" in done.stdout
    assert run("audit", "--store", tmp_path).returncode == 2
    assert run("audit", cwd=tmp_path).returncode == 2


def test_store_corrects_notes_backs_up_and_lists(shop, tmp_path):
    copy = tmp_path / "copy"
    assert run("store", "backup", copy, "--store", shop / "results").returncode == 0
    record = json.loads((shop / "i.json").read_text(encoding="utf-8")) | {"verdict": "does_not_conform"}
    (tmp_path / "right.json").write_text(json.dumps(record))
    with_store = ("--store", copy, "--operator", "Eva")
    done = run("store", "correct", 4, "--record", tmp_path / "right.json", "--reason", "wrong limit", *with_store)
    assert done.returncode == 0 and "corrected by entry 5" in done.stderr
    assert run("store", "note", "sensor cleaned", "--about", 1, *with_store).returncode == 0
    listed = run("store", "list", "--store", copy).stdout.splitlines()
    assert len(listed) == 6 and "wrong limit" in listed[4] and "sensor cleaned" in listed[5]
    assert len(json.loads(run("store", "list", "--store", copy, "--last", 2, "--json").stdout)) == 2
    found = json.loads(run("history", "--store", copy, "--json").stdout)["inspections"]
    assert found[0]["verdict"] == "does_not_conform" and found[0]["corrected"]
    assert run("store", "correct", 1, "--reason", "sensor was loose", *with_store).returncode == 0
    phi = json.loads(run("history", "--store", copy, "--quantity", "phi_deg", "--json").stdout)["quantities"]
    assert [r["entry"] for r in phi[0]["readings"]] == [2]
    said = "rests on calibration #1, which is withdrawn by #7 (sensor was loose); inspect again"
    (inspected,) = json.loads(run("history", "--store", copy, "--json").stdout)["inspections"]
    assert [d["code"] for d in inspected["doubts"]] == ["calibration_withdrawn"]
    assert run("history", "--store", copy, "--report", tmp_path / "h.html").returncode == 0
    assert f'<td class="bad">does not conform (corrected), in doubt: {said}</td>' in (tmp_path / "h.html").read_text()
    listed = run("store", "list", "--store", copy).stdout.splitlines()
    assert "valid  corrected by entry 7" in listed[0] and f"in doubt: {said}" in listed[4] and "in doubt" in listed[2]
    assert run("audit", "--store", copy, "-q").returncode == 0
    assert run("store", "correct", 99, "--reason", "x", *with_store).returncode == 2


def study(tmp_path, rows, head="operator;part;trial;value"):
    path = tmp_path / "study.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def test_gage_rr_of_a_table(tmp_path):
    rng = np.random.default_rng(1)
    rows = [f"{o};{p};{t};{p + 0.1 * rng.normal():.4f}".replace(".", ",") for t in (1, 2, 3) for p in range(10)
            for o in ("Eva", "Jan")]  # fmt: skip
    path = study(tmp_path, rows)
    done = run("history", "--gage-rr", path, "--json", "--report", tmp_path / "g.html")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["studies"]["value"]
    assert found["ndc"] > 20 and found["EV"] == pytest.approx(0.1, rel=0.4) and found["operators"] == 2
    assert "<svg" in (tmp_path / "g.html").read_text(encoding="utf-8")
    assert "study.csv: 2 operators x 10 parts x 3 trials" in run("history", "--gage-rr", path).stdout
    wrong = ((rows, "operator;part;trial;x"), ([*rows, "Eva;1;1;x"],), ([*rows, "Eva;1"],), (rows[:-1],), (rows[:1],))
    for content in wrong:
        done = run("history", "--gage-rr", study(tmp_path, *content))
        assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert run("history", "--gage-rr", tmp_path / "none.csv").returncode == 2


def test_gage_rr_of_repeated_inspections(tmp_path):
    store = Store.open(tmp_path / "results", create=True)
    rng = np.random.default_rng(2)
    for operator in ("Eva", "Jan"):
        for serial in ("1", "2", "3"):
            for _ in range(2):
                value = 20.0 + 0.01 * int(serial) + 0.001 * rng.normal()
                lines = [{"name": "d", "tooth": None, "section": "seat", "value_mm": value},
                         {"name": "f_p", "tooth": 1, "value_um": 1.0}]  # fmt: skip
                store.add("inspection", {"verdict": "conforms", "characteristics": lines,
                                         "part": {"name": "pin", "serial": serial}}, operator=operator)  # fmt: skip
    done = run("history", "--gage-rr", "pin", "--store", store.folder, "--json")
    assert done.returncode == 0, done.stderr
    (found,) = json.loads(done.stdout)["studies"].items()
    assert found[0] == "d seat (mm)" and found[1]["trials"] == 2 and found[1]["PV"] == pytest.approx(0.01, rel=0.3)
    assert run("history", "--gage-rr", "gear", "--store", store.folder).returncode == 2
