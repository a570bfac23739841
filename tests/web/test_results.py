"""Results out of a real store, over HTTP."""

import asyncio
import csv
import json
import struct
from pathlib import Path

import numpy as np
import pytest

from patience import NOT_FOR_EVER
from truestand.core.errors import UnreadableFile
from truestand.files.recipes.recipes import read_stand, stand_recipe
from truestand.files.records.record import is_past
from truestand.files.shapes.clouds import open_cloud, write_cloud
from truestand.store import Store
from truestand.web.clouds import choose, thin_out
from truestand.web.interfaces.lines import lines_of
from truestand.web.result_index import ResultIndex
from truestand.web.routes import results
from truestand.web.security import REPORT_CSP
from web_lab import change as change_file

EVIL = "<img src=x onerror=alert(1)>"


def calibration(status="valid", until=None):
    found = {"status": status, "reasons": [] if status == "valid" else ["few"], "valid_until": until}
    return {"format": "truestand.calibration", "version": 1, "artefact": {"name": "shaft M"}, **found}


def inspection(verdict="conforms", name="demo wheel", **more):
    return {"format": "truestand.inspection", "version": 1, "verdict": verdict, "part": {"name": name, **more}}


@pytest.fixture
def store(state):
    return Store.open(state.settings.store, create=True)


def cloud(path, profiles=600, points=500, seed=1):
    """A cloud with a dent of a few points."""
    rng = np.random.default_rng(seed)
    x, y, z = (rng.normal(size=(profiles, points)) for _ in range(3))
    x[0, :5] = np.nan
    deviation = rng.normal(scale=3.0, size=x.shape)
    deviation[100:102, 200:202] = -80.0
    deviation[:, :50] = np.nan
    write_cloud(path, x, y, z, deviation)
    return path


def numbers(answer):
    return [entry["number"] for entry in answer.json]


def test_an_empty_stand_has_no_results(client, state):
    assert client.get("/api/results").json == []
    assert client.get("/api/results/1").status == 404
    assert client.get("/api/home").json["calibration"]["state"] == "none"
    assert client.get("/api/history").json == {"quantities": []}
    assert client.get("/api/audit").json == {"findings": []}
    assert not state.settings.store.exists()


def test_results_are_listed_newest_first_and_by_page(client, store):
    for k in range(7):
        store.add("inspection", inspection(serial=str(k)), operator="Anna")
    store.add("calibration", calibration())
    assert numbers(client.get("/api/results")) == [8, 7, 6, 5, 4, 3, 2, 1]
    assert numbers(client.get("/api/results?limit=3")) == [8, 7, 6]
    assert numbers(client.get("/api/results?limit=3&before=6")) == [5, 4, 3]
    assert numbers(client.get("/api/results?kind=calibration")) == [8]
    assert numbers(client.get("/api/results?part=demo%20wheel&limit=2")) == [7, 6]
    assert numbers(client.get("/api/results?part=gear&limit=2")) == [7, 6]  # by its recipe
    assert numbers(client.get("/api/results?part=none")) == []
    first = client.get("/api/results/1").json
    assert first["entry"]["serial"] == "0" and first["entry"]["operator"] == "Anna"
    assert first["entry"]["title"] == first["entry"]["part"] == "demo wheel" and first["entry"]["verdict"] == "conforms"
    assert first["record"] == inspection(serial="0")


def test_corrections_keep_the_original(client, store):
    store.add("calibration", calibration("untrusted"))
    store.add("calibration", calibration())
    store.correct(1, calibration(until="2000-01-01"), reason="the certificate's date was wrong")
    assert [(e["number"], e["kind"], e["corrected_by"]) for e in client.get("/api/results").json] == [
        (3, "calibration", None), (2, "calibration", None), (1, "calibration", 3)]  # fmt: skip
    assert client.get("/api/home").json["calibration"]["number"] == 2  # the newest, not the last correction
    store.correct(2, None, reason="wrong shaft")
    payload = client.get("/api/home").json["calibration"]
    assert payload["number"] == 3 and payload["state"] == "expired"
    assert client.get("/api/results/4").json["record"] == {}


@pytest.mark.parametrize(("record", "expected"), [(calibration(), "valid"), (calibration("untrusted"), "untrusted"),
                                               (calibration(until="2001-01-01"), "expired"),
                                               (calibration(until="2999-01-01T00:00:00Z"), "valid")])  # fmt: skip
def test_home_has_the_state_of_the_calibration(client, store, record, expected):
    store.add("calibration", record)
    payload = client.get("/api/home").json
    assert payload["calibration"]["state"] == expected and payload["calibration"]["reasons"] == record["reasons"]
    assert [e["number"] for e in payload["last"]] == [1]


def test_a_date_is_past_after_the_end_of_its_day():
    from datetime import UTC, datetime

    now = datetime(2026, 11, 21, 20, 0, tzinfo=UTC)
    over = {until: is_past(until, now) for until in ("2026-11-20", "2026-11-21", None, "soon")}
    assert over == {"2026-11-20": True, "2026-11-21": False, None: False, "soon": True}


def test_a_report_is_served_into_a_sandbox(client, store, tmp_path):
    (tmp_path / "r.html").write_text(f"<h1>{EVIL}</h1><script>alert(1)</script>")
    store.add("inspection", inspection(), {"report": tmp_path / "r.html"})
    store.add("inspection", inspection())
    answer = client.get("/api/results/1/report")
    assert answer.headers["content-type"].startswith("text/html")
    assert answer.headers["content-security-policy"] == REPORT_CSP
    assert REPORT_CSP.startswith("sandbox; default-src 'none'") and "script" not in REPORT_CSP
    assert answer.headers["content-disposition"].startswith("inline")
    assert client.get("/api/results/1/report?download=1").headers["content-disposition"].startswith("attachment")
    assert client.get("/api/results/2/report").status == 404


def test_markup_in_the_store_is_answered_as_json(client, store):
    store.add("inspection", inspection(name=EVIL, serial=EVIL), operator=EVIL)
    for path in ("/api/results", "/api/results/1", "/api/home"):
        answer = client.get(path)
        assert answer.headers["content-type"] == "application/json" and EVIL in answer.body.decode()


def test_a_cloud_is_served_as_float32_columns(client, state, store, tmp_path):
    store.add("inspection", inspection(), {"cloud": cloud(tmp_path / "c.ply")})
    answer = client.get("/api/results/1/cloud?points=20000")
    assert answer.status == 200 and answer.headers["content-type"] == "application/octet-stream"
    (n,) = struct.unpack("<I", answer.body[:4])
    assert 19_000 <= n <= 20_000 and len(answer.body) == 4 + 16 * n
    x, y, z, deviation = np.frombuffer(answer.body[4:], "<f4").reshape(4, n)
    assert np.isfinite([x, y, z]).all() and np.isnan(deviation).any()
    assert np.count_nonzero(deviation == -80.0) == 4  # the dent of four points among 300,000 is still there
    assert len(list(state.settings.cache_folder.iterdir())) == 1
    assert client.get("/api/results/1/cloud?points=20000").body == answer.body
    assert client.get("/api/results/1/cloud?points=9000000").status == 422
    assert client.get("/api/results/2/cloud").status == 404


def test_a_cached_cloud_waits_for_no_audit_and_no_other_cloud(state, store, tmp_path):
    for name in ("first", "second"):
        (tmp_path / name).write_text(name)
        store.add("inspection", inspection(serial=name), {"cloud": tmp_path / name})

    async def meet():
        over, asked = asyncio.Event(), []

        async def ask(task, *arguments, **more):
            asked.append(task)
            if task == "audit" or Path(arguments[0]).read_text() == "second":
                await over.wait()
            else:
                Path(arguments[1]).parent.mkdir(exist_ok=True)
                Path(arguments[1]).write_text("made")
            return []

        state.run_task = ask
        audit = asyncio.create_task(results.audit(state))
        async with asyncio.timeout(NOT_FOR_EVER):
            await results.cloud(1, state)
            making = asyncio.create_task(results.cloud(2, state))
            while len(asked) < 3:
                await asyncio.sleep(0.01)
            await results.cloud(1, state)
        assert sorted(asked) == ["audit", "cloud", "cloud"] and not audit.done() and not making.done()
        making.cancel()
        over.set()
        assert await audit == {"findings": []}

    asyncio.run(meet())


def test_a_changed_cloud_is_not_shown(client, store, tmp_path):
    store.add("inspection", inspection(), {"cloud": cloud(tmp_path / "c.ply")})
    (kept,) = [p for p in (tmp_path / "results" / "evidence").rglob("*") if p.is_file() and p.stat().st_size > 100_000]
    kept.chmod(0o644)
    with kept.open("r+b") as file:
        file.seek(5000)
        file.write(b"\x01")
    answer = client.get("/api/results/1/cloud")
    assert answer.status == 409 and "changed since" in answer.problem
    assert any(f["what"] == "evidence changed" for f in client.get("/api/audit").json["findings"])


def test_all_points_of_a_small_cloud_are_shown(tmp_path):
    n = thin_out(cloud(tmp_path / "c.ply", 10, 20), tmp_path / "o.bin", 200_000)
    assert n == 195


def test_a_cloud_without_deviations_has_none(tmp_path):
    x = np.random.default_rng(2).normal(size=(50, 60))
    write_cloud(tmp_path / "c.ply", x, x, x)
    assert thin_out(tmp_path / "c.ply", tmp_path / "o.bin", 1000) == 1000
    assert np.isnan(np.frombuffer((tmp_path / "o.bin").read_bytes()[4:], "<f4")[3000:]).all()


def test_points_are_chosen_evenly_and_never_too_many():
    deviation = np.full(1_000_000, np.nan, dtype=np.float32)
    chosen = choose(deviation.size, deviation, 1000)
    assert 900 <= chosen.size <= 1000 and np.ptp(np.diff(chosen)) <= 1
    deviation[:] = np.random.default_rng(3).normal(size=deviation.size)
    chosen = choose(deviation.size, deviation, 1000)
    assert chosen.size <= 1000 and (np.diff(chosen) > 0).all()
    assert set(np.argsort(np.abs(deviation))[-50:]) <= set(chosen)


@pytest.mark.parametrize(
    "damage",
    [
        lambda b: b[:-1],
        lambda b: b[:50],
        lambda b: b"",
        lambda b: b[4:],
        lambda b: b.replace(b"float z", b"list z"),
        lambda b: b"x" * 5000,
    ],
)
def test_a_damaged_cloud_is_refused(tmp_path, damage):
    path = cloud(tmp_path / "c.ply", 10, 20)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(UnreadableFile):
        open_cloud(path)


def test_the_cloud_cache_removes_the_least_recently_used(client, state, store, tmp_path, monkeypatch):
    monkeypatch.setattr(results, "MAX_CACHED_CLOUDS", 2)
    store.add("inspection", inspection(), {"cloud": cloud(tmp_path / "c.ply", 100, 100)})
    for points in (1000, 2000, 3000, 4000):
        client.get(f"/api/results/1/cloud?points={points}")
    assert sorted(int(p.stem.split("-")[1]) for p in state.settings.cache_folder.iterdir()) == [3000, 4000]


def test_a_store_is_read_again_only_after_a_new_entry(state, store):
    kept = ResultIndex(store.folder, state.settings.stand)
    store.add("calibration", calibration(), time="2026-01-01T00:00:00Z")
    assert [e.number for e in kept.entries()] == [1]
    before = kept._results
    kept.entries()
    assert kept._results is before
    store.add("calibration", calibration(), time="2026-01-01T00:00:00Z")
    assert [e.number for e in kept.entries()] == [2, 1]


def test_a_result_stored_after_the_clock_was_set_back_is_listed(state, store):
    kept = ResultIndex(store.folder, state.settings.stand)
    store.add("calibration", calibration(), time="2026-01-02T00:00:00Z")
    assert [e.number for e in kept.entries()] == [1]
    store.add("calibration", calibration(), time="2026-01-01T00:00:00Z")
    assert [e.number for e in kept.entries()] == [2, 1]
    assert kept.calibration().number == 2


def test_another_store_in_the_same_folder_is_read_anew(state, store, tmp_path):
    kept = ResultIndex(store.folder, state.settings.stand)
    store.add("calibration", calibration())
    assert len(kept.entries()) == 1
    store.folder.rename(tmp_path / "before")
    other = Store.open(store.folder, create=True)
    for serial in ("1", "2"):
        other.add("inspection", inspection(serial=serial))
    assert [(e.number, e.serial) for e in kept.entries()] == [(2, "2"), (1, "1")]


def test_a_damaged_store_answers_409(client, state, store):
    store.add("calibration", calibration())
    (state.settings.store / "store.db").write_bytes(b"no database")
    answer = client.get("/api/results")
    assert answer.status == 409 and "audit" in answer.problem


def line(name, value, **more):
    own = {"U_mm": 0.004} if "value_mm" in more else {"value_um": value, "U_um": 2.0}
    seen = {"coverage": 1.0, "status": "measured", "verdict": None}
    return {"name": name, "flank": None, "tooth": None, **seen, **own, **more}


def test_trends_of_calibrations_have_limits_and_findings(client, store):
    for k in range(12):
        record = calibration() | {"sensor": {"name": "front", "phi_deg": -41.8 + 0.001 * (k % 2)}}
        store.add("calibration", record | {"uncertainty": {"phi_deg": {"U": 0.05, "k": 2}}})
    store.add("calibration", calibration() | {"sensor": {"name": "front", "phi_deg": -40.0}})
    (phi,) = client.get("/api/history").json["quantities"]
    assert (phi["name"], phi["label"], phi["unit"]) == ("phi_deg", "Angle φ", "°")
    first = phi["points"][0]
    assert len(phi["points"]) == 13 and (first["number"], first["value"], first["U"]) == (1, -41.8, 0.05)
    assert phi["lower"] < phi["centre"] < phi["upper"]
    assert phi["findings"][-1]["number"] == 13 and "beyond" in phi["findings"][-1]["text"]
    store.correct(13, None, reason="another shaft")
    assert len(client.get("/api/history").json["quantities"][0]["points"]) == 12


def test_trends_of_a_part_are_by_characteristic_and_flank(client, store):
    for k in range(3):
        lines = [
            line("F_p", 10.0 + k, flank="left", limit_um=20.0),
            line("F_p", 11.0, flank="right", limit_um=20.0),
            line("s", 0, value_mm=3.1, limits_mm=[3.0, 3.2]),
            line("f_p", 3.0, tooth=4),
        ]
        store.add("inspection", inspection() | {"characteristics": lines})
    store.add("inspection", inspection(name="another") | {"characteristics": [line("F_p", 99.0)]})
    found = {q["name"]: q for q in client.get("/api/history?kind=inspection&part=gear").json["quantities"]}
    assert list(found) == ["F_p left", "F_p right", "s"]
    assert [p["value"] for p in found["F_p left"]["points"]] == [10.0, 11.0, 12.0]
    assert found["F_p left"]["limit"] == 20.0 and found["F_p left"]["unit"] == "µm"
    assert found["s"]["limits"] == [3.0, 3.2] and found["s"]["unit"] == "mm"
    assert client.get("/api/history?kind=inspection&part=none").json == {"quantities": []}


def test_characteristics_are_served_as_csv(client, store):
    lines = [
        line("F_p", 10.0, flank="left", limit_um=20.0),
        line("f_Halpha", -3.0, limit_um=9.5),
        line("=cmd()", 0, value_mm=3.1, limits_mm=[3.0, 3.2]),
    ]
    store.add("inspection", inspection() | {"part": {"kind": "gear", "name": "x"}, "characteristics": lines})
    store.add("calibration", calibration())
    store.add("inspection", inspection() | {"characteristics": [{"name": "F_p"}]})
    answer = client.get("/api/results/1/characteristics.csv")
    assert answer.status == 200 and answer.headers["content-type"] == "text/csv; charset=utf-8"
    assert answer.headers["content-disposition"] == 'attachment; filename="inspection-1.csv"'
    rows = [row.split(",") for row in answer.body.decode().split("\r\n")]
    assert rows[1][0] == "F_p" and rows[1][8:10] == ["", "20.0"]
    assert rows[2][8:10] == ["-9.5", "9.5"]
    assert rows[3][0] == "'=cmd()" and rows[3][8:10] == ["3.0", "3.2"]
    assert client.get("/api/results/2/characteristics.csv").status == 404
    damaged = client.get("/api/results/3/characteristics.csv")
    assert damaged.status == 409 and "damaged" in damaged.problem


LIMITED = [
    (line("C_alpha", 4.0, limit_um=5.0, limits_um=[-5.0, 5.0]), [-5.0, 5.0]),
    (line("C_beta", 4.0, limit_um=5.0), [-5.0, 5.0]),  # as 0.1 wrote it
    (line("f_Halpha", 3.0, limit_um=5.0, limits_um=[None, 5.0]), [None, 5.0]),
    (line("F_alpha", 3.0, limit_um=5.0, limits_um=[-5.0, 5.0]), [-5.0, 5.0]),
    (line("F_beta", 3.0, limit_um=5.0), [None, 5.0]),
    (line("deviation_min", 3.0, limit_um=-5.0, limits_um=[-5.0, None]), [-5.0, None]),
    (line("F_r", 3.0, limit_um=None, limits_um=None), [None, None]),
    (line("s", 0, value_mm=3.1, limits_mm=[3.0, None]), [3.0, None]),
]


def test_page_interfaces_csv_and_trends_have_the_same_limits(client, store):
    record = inspection() | {"part": {"kind": "gear", "name": "demo wheel"}, "characteristics": [c for c, _ in LIMITED]}
    store.add("inspection", record)
    expected = {c["name"]: both for c, both in LIMITED}
    shown = client.get("/api/results/1").json["record"]["characteristics"]
    assert {c["name"]: c.get("limits_um") or c.get("limits_mm") or [None, None] for c in shown} == expected
    assert {one.name: [one.lower, one.upper] for one in lines_of("inspection", record)} == expected
    table = csv.DictReader(client.get("/api/results/1/characteristics.csv").body.decode().splitlines())
    assert {
        row["name"]: [float(row[end]) if row[end] else None for end in ("lower_limit", "upper_limit")] for row in table
    } == expected
    trends = client.get("/api/history?kind=inspection&part=gear").json["quantities"]
    assert {q["name"]: q["limits"] or [None, None] for q in trends} == expected


def test_a_calibration_is_served_as_a_certificate(client, store):
    released = Path(__file__).parent.parent / "released" / "calibration-1.json"
    store.add("calibration", json.loads(released.read_text(encoding="utf-8")))
    store.add("calibration", calibration("untrusted"))
    store.add("inspection", inspection())
    assert [e["has"]["certificate"] for e in client.get("/api/results").json] == [False, False, True]
    answer = client.get("/api/results/1/certificate.xml")
    assert answer.status == 200 and answer.headers["content-type"] == "application/xml"
    assert b"digitalCalibrationCertificate" in answer.body and b"not stated" in answer.body
    refused = client.get("/api/results/2/certificate.xml")
    assert refused.status == 409 and "few" in refused.problem
    assert client.get("/api/results/3/certificate.xml").status == 404
    store.correct(1, None, reason="the shaft was dirty")
    assert not client.get("/api/results/1").json["entry"]["has"]["certificate"]
    refused = client.get("/api/results/1/certificate.xml")
    assert refused.status == 409 and "found calibration 1 withdrawn" in refused.problem


def test_the_company_is_that_of_the_reports(client, tmp_path):
    stand = tmp_path / "stand.toml"
    assert client.session()["company"] == ""
    stand.write_text(stand.read_text(encoding="utf-8") + '\n[company]\nname = "Gears & Sons"\n', encoding="utf-8")
    assert client.session()["company"] == "Gears & Sons"


def verification(store, verdict, of=1):
    """Keep a verification of a calibration."""
    record = {"format": "truestand.verification", "version": 1, "verdict": verdict, "reasons": [f"{verdict} {of}"],
              "created": f"after entry {store.head()[0]}"}  # fmt: skip
    return store.add("verification", record, {"calibration": store.evidence(store.entry(of))["record"]})


def test_a_verification_that_does_not_hold_counts_until_another_one_holds(client, store):
    def calibration_now():
        found = client.get("/api/home").json["calibration"]
        return found["state"], found["verification"], found["reasons"]

    store.add("calibration", calibration())
    assert calibration_now() == ("valid", None, [])
    verification(store, "undecided")
    assert calibration_now() == ("undecided", 2, ["undecided 1"])
    verification(store, "does_not_hold")
    assert calibration_now() == ("does_not_hold", 3, ["does_not_hold 1"])
    verification(store, "undecided")
    assert calibration_now() == ("does_not_hold", 3, ["does_not_hold 1"])  # what is undecided takes nothing back
    verification(store, "holds")
    assert calibration_now() == ("valid", 5, [])


def test_a_verification_counts_for_its_own_calibration_only(client, store):
    def calibration_now():
        found = client.get("/api/home").json["calibration"]
        return found["state"], found["verification"]

    store.add("calibration", calibration())
    verification(store, "does_not_hold")
    store.correct(1, calibration(until="2999-01-01"), reason="the certificate's date was wrong")
    assert calibration_now() == ("does_not_hold", 2)  # a correction is no new calibration
    store.add("calibration", calibration(until="2999-01-02"))
    assert calibration_now() == ("valid", None)
    verification(store, "does_not_hold", of=1)
    assert calibration_now() == ("valid", None)
    store.correct(4, None, reason="wrong shaft")
    assert calibration_now() == ("does_not_hold", 5)
    store.correct(5, None, reason="dirty shaft")
    store.correct(2, None, reason="dirty shaft")
    assert calibration_now() == ("valid", None)


def test_an_untrusted_calibration_replaces_no_good_one(client, store):
    def calibration_now():
        found = client.get("/api/home").json["calibration"]
        return found["state"], found["number"], found["not_in_force"]

    store.add("calibration", calibration("untrusted"))
    assert calibration_now() == ("untrusted", 1, None)
    store.add("calibration", calibration())
    assert calibration_now() == ("valid", 2, None)
    store.add("calibration", calibration("untrusted"))
    assert calibration_now() == ("valid", 2, 3)
    verification(store, "does_not_hold", of=2)
    assert calibration_now() == ("does_not_hold", 2, 3)
    store.correct(2, None, reason="wrong shaft")
    assert calibration_now() == ("untrusted", 3, None)


def made_with(state, **changes):
    """What a calibration with this stand's recipes records, with other values of the sensor or the table."""
    stand = stand_recipe(read_stand(state.settings.stand))
    for key, value in changes.items():
        (stand["table"] if key in stand["table"] else stand["sensor"][0])[key] = value
    return {"sensor": {"name": stand["sensor"][0]["name"]}, "stand": stand}


@pytest.mark.parametrize(("change", "why"), [
    ({"name": "rear"}, "of sensor 'rear', stand.toml has 'front'"), ({"serial": "S 2"}, "serial number S 2"),
    ({"direction": "cw"}, "turns cw, that of stand.toml ccw"), ({"mirrored": True}, "its sensor was mirrored"),
])  # fmt: skip
def test_a_calibration_of_another_stand_is_not_used(client, state, store, change, why):
    change_file(state.settings.stand, {'name = "front"': 'name = "front"\nserial = "S 1"'})
    store.add("calibration", calibration() | made_with(state))
    store.add("calibration", calibration() | made_with(state, **change))
    found = client.get("/api/home").json["calibration"]
    assert (found["state"], found["number"], found["not_in_force"]) == ("valid", 1, 2)
    assert why in found["not_in_force_reason"]
    assert [e["standing"] for e in client.get("/api/results").json] == ["in_doubt", "stands"]
    store.correct(1, None, reason="dirty shaft")
    found = client.get("/api/home").json["calibration"]
    assert (found["state"], found["number"], found["not_in_force"]) == ("none", None, 2)
    assert client.post("/api/jobs", {"kind": "inspect", "part": "gear"}).status == 409


def test_a_calibration_by_the_published_method_is_not_used(client, store):
    store.add("calibration", calibration() | {"method": "paper"})
    found = client.get("/api/home").json["calibration"]
    assert found["state"] == "none" and "published method" in found["not_in_force_reason"]


def test_a_result_is_withdrawn_for_a_reason_and_kept(client, store):
    for until in ("2999-01-01", "2999-01-02"):
        store.add("calibration", calibration(until=until))
    assert client.post("/api/results/2/withdraw", {"reason": ""}).status == 422
    made = client.post("/api/results/2/withdraw", {"reason": "the shaft was dirty", "operator": "olga"})
    assert made.status == 200, made.problem
    assert made.json["number"] == 3
    assert client.get("/api/home").json["calibration"]["number"] == 1
    assert client.get("/api/results/2").json["entry"]["corrected_by"] == 3
    entry = store.entry(3)
    assert (entry.about, entry.record, entry.text, entry.operator) == (2, None, "the shaft was dirty", "olga")
    again = client.post("/api/results/2/withdraw", {"reason": "again"})
    assert again.status == 409 and "entry 2 is withdrawn already, by entry 3" in again.problem
    again = client.post("/api/results/3/withdraw", {"reason": "again"})
    assert again.status == 409 and "entry 3 withdraws entry 2: a withdrawal can't be withdrawn" in again.problem
    assert client.post("/api/results/9/withdraw", {"reason": "again"}).status == 404


def test_a_new_index_finds_the_verification(state, store):
    store.add("calibration", calibration())
    verification(store, "does_not_hold")
    assert ResultIndex(state.settings.store, state.settings.stand).verification().verdict == "does_not_hold"


@pytest.mark.parametrize(("record", "expected"), [(calibration("untrusted"), "untrusted"),
                                                  (calibration(until="2001-01-01"), "does_not_hold")])  # fmt: skip
def test_the_worst_state_of_a_calibration_counts(client, store, record, expected):
    store.add("calibration", record)
    verification(store, "does_not_hold")
    assert client.get("/api/home").json["calibration"]["state"] == expected
