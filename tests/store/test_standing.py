"""What a result is worth after its calibration was withdrawn, corrected, expired or found not to hold."""

import json
from datetime import UTC, datetime

import pytest

from small_records import calibration, inspection
from truestand.core.errors import BadStore
from truestand.store import Store

NOW = datetime(2026, 11, 21, 12, 0, tzinfo=UTC)
EARLY, LATE = "2026-11-01T08:00:00Z", "2026-11-20T08:00:00Z"


@pytest.fixture
def store(tmp_path):
    return Store.open(tmp_path / "store", create=True)


def calibrate(store, time=EARLY, **more):
    return store.add("calibration", calibration(**more), time=time).number


def rests_on(store, number):
    return {"calibration": store.evidence(store.entry(number))["record"]}


def inspect(store, of, time=LATE, **more):
    return store.add("inspection", inspection(verdict="conforms", **more), rests_on(store, of), time=time).number


def verify(store, of, verdict):
    record = {"format": "truestand.verification", "version": 1, "verdict": verdict, "reasons": []}
    return store.add("verification", record, rests_on(store, of), time=LATE).number


def codes(store, number):
    known = store.standing()
    found = known.doubts(number, NOW)
    assert (known.standing(number, NOW) == "in_doubt") == bool(found)
    return [doubt.code for doubt in found]


def test_a_result_stands_on_a_sound_calibration(store):
    number = inspect(store, calibrate(store, valid_until="2026-11-20"))
    verify(store, 1, "holds")
    assert codes(store, number) == []
    assert codes(store, 1) == ["calibration_expired"]  # by now, not when the part was inspected


def test_a_result_is_in_doubt_after_its_calibration_was_withdrawn(store):
    number = inspect(store, calibrate(store))
    check = verify(store, 1, "holds")
    store.correct(1, None, reason="the shaft was dirty")
    (doubt,) = store.standing().doubts(number, NOW)
    assert doubt == "rests on calibration #1, which is withdrawn by #4 (the shaft was dirty); inspect again"
    assert codes(store, check) == ["calibration_withdrawn"]
    assert store.standing().standing(1, NOW) == "withdrawn" == store.standing().standing(4, NOW)


def test_a_withdrawal_stands_for_the_same_calibration_kept_again(store):
    number = inspect(store, calibrate(store))
    withdrawal = store.correct(1, None, reason="the shaft was dirty").number
    again = calibrate(store)
    assert store.entry(again).record == store.entry(1).record
    assert codes(store, number) == ["calibration_withdrawn"]
    known = store.standing()
    assert known.standing(again, NOW) == "withdrawn" and known.replaced_by(again) == withdrawal
    assert list(known.not_withdrawn("calibration")) == []
    assert [result.verdict for result in store.results("calibration")] == ["withdrawn", "withdrawn"]
    with pytest.raises(BadStore, match=f"withdrawn already, by entry {withdrawal}"):
        store.correct(again, None, reason="once more")


def test_a_withdrawn_calibration_that_is_kept_for_a_reason_carries_its_results(store):
    number = inspect(store, calibrate(store))
    store.correct(1, None, reason="the wrong line")
    store.correct(1, calibration(), reason="it was the right shaft after all")
    assert codes(store, number) == []
    assert [entry.number for entry in store.standing().not_withdrawn("calibration")] == [4]
    again = calibrate(store)
    assert store.standing().standing(again, NOW) == "stands"


def test_another_calibration_stands_beside_one_that_was_withdrawn(store):
    calibrate(store)
    store.correct(1, None, reason="the shaft was dirty")
    assert codes(store, inspect(store, calibrate(store, valid_until="2027-11-10"))) == []


def test_a_result_is_in_doubt_after_its_calibration_was_corrected(store):
    number = inspect(store, calibrate(store))
    store.correct(1, calibration("untrusted"), reason="the wrong shaft")
    assert codes(store, number) == ["calibration_corrected"]
    assert store.standing().standing(1, NOW) == "corrected"


def test_a_result_is_in_doubt_whose_recipes_had_changed_since_its_calibration(store):
    change = {"code": "recipe_changed", "text": "changed since the calibration: stand.toml: points is 320, was 640"}
    other = {"code": "datum", "text": "datum: the shaft's base"}
    record = inspection(verdict="conforms") | {"remarks": [other, change]}
    number = store.add("inspection", record, rests_on(store, calibrate(store)), time=LATE).number
    assert codes(store, number) == ["recipe_changed"]
    assert list(store.standing().doubts(number, NOW)) == [change["text"]]


def test_a_result_of_an_expired_calibration_is_in_doubt(store):
    number = inspect(store, calibrate(store, valid_until="2026-11-10"))
    assert codes(store, number) == ["calibration_expired"]


@pytest.mark.parametrize(("verdicts", "expected"), [
    (("does_not_hold",), ["calibration_did_not_hold"]), (("undecided",), ["calibration_undecided"]),
    (("does_not_hold", "undecided"), ["calibration_did_not_hold"]), (("does_not_hold", "holds"), []),
])  # fmt: skip
def test_a_result_counts_by_the_last_verification_before_it(store, verdicts, expected):
    calibrate(store)
    for verdict in verdicts:
        verify(store, 1, verdict)
    assert codes(store, inspect(store, 1)) == expected


@pytest.mark.parametrize(("verdicts", "expected"), [
    (("does_not_hold",), ["calibration_does_not_hold"]), (("undecided",), []),
    (("undecided", "does_not_hold"), ["calibration_does_not_hold"]), (("holds", "does_not_hold"), []),
    (("does_not_hold", "holds"), ["calibration_does_not_hold"]),
])  # fmt: skip
def test_a_result_counts_by_the_next_decided_verification_after_it(store, verdicts, expected):
    number = inspect(store, calibrate(store))
    for verdict in verdicts:
        verify(store, 1, verdict)
    assert codes(store, number) == expected


def test_a_withdrawn_verification_says_nothing(store):
    number = inspect(store, calibrate(store))
    store.correct(verify(store, 1, "does_not_hold"), None, reason="the shaft was dirty")
    assert codes(store, number) == [] == codes(store, 1)


def test_a_calibration_counts_by_its_verification(store):
    calibrate(store)
    verify(store, 1, "undecided")
    assert codes(store, 1) == ["calibration_undecided"]
    verify(store, 1, "does_not_hold")
    assert codes(store, 1) == ["calibration_does_not_hold"]


def test_a_result_by_its_record_alone_and_one_of_an_unknown_calibration(store, tmp_path):
    calibrate(store)
    sha256 = store.entry(1).record
    by_record = store.add("inspection", inspection() | {"calibration": {"sha256": sha256}}, time=LATE).number
    (tmp_path / "elsewhere.json").write_text(json.dumps(calibration(valid_until="2026-11-10")))
    elsewhere = store.add("inspection", inspection(), {"calibration": tmp_path / "elsewhere.json"}, time=LATE).number
    store.correct(1, None, reason="dirty")
    assert codes(store, by_record) == ["calibration_withdrawn"]
    assert codes(store, elsewhere) == ["calibration_expired"]


def test_missing_evidence_is_said_and_hides_nothing_else(store):
    number = inspect(store, calibrate(store))
    store.evidence(store.entry(1))["record"].unlink()
    assert codes(store, number) == codes(store, 1) == ["evidence_missing"]
