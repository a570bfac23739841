"""The OPC UA server as asyncua's own client sees it, over a real socket."""

import asyncio
import gc
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import replace

import pytest
from asyncua import ua
from asyncua.server import address_space

from command import run
from interface_lab import keep, make_state, plc, served
from patience import NOT_FOR_EVER
from small_records import calibration, inspection, line, verification
from truestand.core.errors import BadRecipe
from truestand.files.recipes.recipes import write_starters
from truestand.files.scans.read import sha256_of
from truestand.station.stand_lock import reset_latched_fault, state_path
from truestand.web.authentication import write_users
from truestand.web.interfaces.access import OpcUaUserManager, peer
from truestand.web.interfaces.lines import lines_of
from truestand.web.interfaces.opcua import StandNodes
from truestand.web.interfaces.startup import interface_settings
from web_lab import PASSWORD

LINES = "LastResult/Characteristics"


@pytest.fixture
def state(tmp_path):
    return make_state(tmp_path)


def talk(state, conversation, **more):
    """``conversation`` with a client of the page's server."""

    async def meet():
        async with served(state) as address, plc(address, **more) as client:
            return await conversation(client)

    try:
        return asyncio.run(meet())
    finally:
        gc.collect()  # an address space has 40 MB of cycles, and no process of ours but this one makes several


class Heard(list):
    def datachange_notification(self, node, value, data):
        self.append(value)


def test_an_empty_stand_has_nulls(state):
    async def look(client):
        names = ("State", "Done", "Fault", "Calibrated", "CalibrationStatus", "CalibratedUntil", "ResultReady")
        assert await client.reads("Stand", *names) == ["idle", 0.0, None, False, "none", None, 0]
        assert await client.reads("LastResult", "Number", "Verdict", "Reasons", "Time") == [None] * 4
        assert await client.node(LINES).get_children() == []

    talk(state, look)


def test_the_last_result_with_every_line(state):
    keep(state, "calibration", calibration(valid_until="2099-01-01"))
    number = keep(state, "inspection", inspection())

    async def look(client):
        assert await client.reads("Stand", "Calibrated", "CalibratedUntil") == [True, "2099-01-01"]
        assert await client.reads("Stand", "ResultCount", "ResultReady") == [2, number]
        values = await client.reads("LastResult", "Number", "Kind", "Part", "Serial", "Order", "Operator", "Verdict")
        assert values == [number, "inspection", "gear", "7", "A 12", "olga", "does_not_conform"]
        assert await client.reads("LastResult", "ResultEvaluation", "Reasons") == [2, ["F_p left is too large"]]
        assert await client.read("LastResult/RecordHash") == sha256_of(state.results.file(number, "record"))
        assert (await client.read("LastResult/Time")).tzinfo is not None
        names = {(await node.read_browse_name()).Name for node in await client.node(LINES).get_children()}
        assert names == {"F_p left", "f_Halpha left 3", "F_beta left", "d_a"}
        values = ("Value", "U", "Lower", "Upper", "Unit", "Verdict", "ResultEvaluation", "Status", "Coverage")
        assert await client.reads(f"{LINES}/F_p left", *values) == [
            41.0, 1.5, None, 35.0, "um", "does_not_conform", 2, "measured", 1.0]  # fmt: skip
        assert (await client.reads(f"{LINES}/f_Halpha left 3", *values))[2:4] == [-12.0, 12.0]
        assert await client.reads(f"{LINES}/d_a", *values) == [
            52.01, 0.02, 51.9, None, "mm", "conforms", 1, "partial", 0.9]  # fmt: skip

    talk(state, look)


def test_a_part_that_conforms_by_a_calibration_in_doubt_is_not_in_tolerance(state):
    resting = {"calibration": {"sha256": state.results.file(keep(state, "calibration", calibration()), "record").name}}
    keep(state, "verification", verification() | {"verdict": "does_not_hold"} | resting)
    keep(state, "inspection", inspection(verdict="conforms") | resting)

    async def look(client):
        verdict, evaluation, reasons = await client.reads("LastResult", "Verdict", "ResultEvaluation", "Reasons")
        assert (verdict, evaluation) == ("conforms", 3) and "did not hold before: verification #2" in reasons[0]

    talk(state, look)


def test_a_part_that_conforms_by_changed_recipes_is_not_in_tolerance(state):
    change = {"code": "recipe_changed", "text": "changed since the calibration: stand.toml: points is 320, was 640"}
    number = keep(state, "inspection", inspection(verdict="conforms") | {"remarks": [change]})
    entry = state.results.entry(number)
    assert (entry.verdict, entry.standing, entry.doubts) == ("conforms", "in_doubt", [change["text"]])

    async def look(client):
        verdict, evaluation, reasons = await client.reads("LastResult", "Verdict", "ResultEvaluation", "Reasons")
        assert (verdict, evaluation, reasons[0]) == ("conforms", 3, change["text"])

    talk(state, look)


def test_a_value_not_measured_is_null_of_its_type_and_never_nan(state):
    keep(state, "inspection", inspection())

    async def look(client):
        for name in ("Value", "U", "Coverage"):
            node = client.node(f"{LINES}/F_beta left/{name}")
            data = await node.read_data_value()
            assert data.Value.VariantType == ua.VariantType.Null and data.StatusCode.is_good()
            assert await node.read_data_type() == ua.NodeId(ua.ObjectIds.Double)
        assert await client.read(f"{LINES}/F_beta left/Status") == "not_measurable"

    talk(state, look)


@pytest.mark.more
def test_result_ready_is_notified_after_the_whole_result(state):
    keep(state, "inspection", inspection())
    ready, values = Heard(), Heard()

    async def wait(client):
        subscription = await client.client.create_subscription(20, ready)
        await subscription.subscribe_data_change(client.node("Stand/ResultReady"))
        other = await client.client.create_subscription(20, values)
        await other.subscribe_data_change(client.node(f"{LINES}/F_p left/Value"))
        new = inspection(line("F_p", None), line("F_r", 8.0, flank=None), verdict="undecided")
        number = await asyncio.to_thread(keep, state, "inspection", new)
        async with asyncio.timeout(NOT_FOR_EVER):
            while number not in ready:
                await asyncio.sleep(0.01)
        assert await client.reads("LastResult", "Number", "ResultEvaluation") == [number, 3]
        names = {(await node.read_browse_name()).Name for node in await client.node(LINES).get_children()}
        assert names == {"F_p left", "F_r"}
        with pytest.raises(ua.uaerrors.BadNodeIdUnknown):
            await client.read(f"{LINES}/d_a/Value")
        await asyncio.sleep(0.2)

    talk(state, wait)
    assert ready == [1, 2]
    assert values == [41.0, None]


def test_a_job_from_start_to_result(state):
    async def work(client):
        job = await client.call("StartJob", "calibrate", "", "olga", "", "")
        assert job == state.runner.current()["id"]
        await client.until("Stand/ResultReady", 1)
        assert await client.reads("Stand", "JobId", "JobState", "State", "Done") == [job, "done", "idle", 1.0]
        assert await client.reads("LastResult", "Kind", "Status", "Operator") == ["calibration", "valid", "olga"]
        assert await client.reads(f"{LINES}/phi", "Value", "U", "Unit", "Verdict") == [-41.8, 0.05, "deg", None]
        assert await client.reads(f"{LINES}/height", "Value", "Status") == [None, "not_identifiable"]
        await client.call("StartJob", "inspect", "gear", None, None, "42")
        await client.until("Stand/ResultReady", 2)
        assert await client.reads("LastResult", "Kind", "Serial") == ["inspection", "42"]

    talk(state, work)


@pytest.mark.more
def test_busy_live_and_abort(state):
    async def work(client):
        await client.call("StartJob", "calibrate", "", "", "", "hold")
        await client.until("Stand/Live/Position_deg", 50.0)
        assert await client.reads("Stand", "State", "Step") == ["running", "acquire"]
        await client.until("Stand/Done", 0.125)
        assert await client.reads("Stand/Live/Sensors/front", "FramesPerSecond", "Profiles", "Lost") == [200.0, 50, 0]
        with pytest.raises(ua.uaerrors.BadInvalidState):
            await client.call("StartJob", "calibrate", "", "", "", "")
        assert "a job runs already" in await client.read("Stand/Refused")
        await client.call("Abort")
        await client.until("Stand/JobState", "aborted")
        assert await client.reads("Stand", "State", "ResultReady", "Refused") == ["idle", 0, ""]
        assert await client.read("Stand/Live/Position_deg") is None
        with pytest.raises(ua.uaerrors.BadInvalidState):
            await client.call("Abort")

    talk(state, work)


REFUSALS = (
    (("inspect", "nonesuch", "", "", ""), ua.uaerrors.BadNotFound, "found no part 'nonesuch'"),
    (("inspect", "../gear", "", "", ""), ua.uaerrors.BadNotFound, "found no part"),
    (("inspect", "", "", "", ""), ua.uaerrors.BadInvalidArgument, "an inspection needs one"),
    (("inspect", "gear", "", "", ""), ua.uaerrors.BadInvalidState, "found no calibration"),
    (("polish", "", "", "", ""), ua.uaerrors.BadInvalidArgument, "kind"),
    (("calibrate", "", "x" * 121, "", ""), ua.uaerrors.BadInvalidArgument, "operator"),
    (("calibrate", "", "a\nb", "", ""), ua.uaerrors.BadInvalidArgument, "control characters"),
    (("calibrate",), ua.uaerrors.UaStatusCodeError, ""),
    (("calibrate", "", "", "", 7), ua.uaerrors.BadInvalidArgument, ""),
)


def test_refused_calls_have_their_status_codes(state):
    async def work(client):
        for arguments, error, why in REFUSALS:
            with pytest.raises(error):
                await client.call("StartJob", *arguments)
            assert why in await client.read("Stand/Refused")
            assert state.runner.current() is None

    talk(state, work)


def test_a_fault_is_shown_and_reset(state):
    state_path(state.settings.stand).write_text('{"state": "fault", "since": "noon", "reason": "encoder stuck"}')

    async def reset(*arguments, **more):
        return reset_latched_fault(state.settings.stand)

    async def work(client):
        assert await client.read("Stand/State") == "fault"
        assert "encoder stuck" in await client.read("Stand/Fault")
        with pytest.raises(ua.uaerrors.BadInvalidState):
            await client.call("ResetFault")  # it asks the table first, and there is none
        state.run_task = reset
        assert "encoder stuck" in await client.call("ResetFault")
        await client.until("Stand/State", "idle")
        assert await client.read("Stand/Fault") is None
        assert await client.call("ResetFault") == ""

    talk(state, work)


@pytest.mark.more
def test_nothing_can_be_written_or_added(state):
    async def write(client):
        for path in ("Stand/State", "Stand/ResultReady"):
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await client.node(path).write_value("mine")
        with pytest.raises(ua.UaError):
            await client.client.nodes.objects.add_object(client.space, "Mine")
        assert await client.read("Stand/State") == "idle"

    talk(state, write)
    talk(state, write, user="admin", password="admin")


def test_with_users_a_login_is_needed(tmp_path):
    state = make_state(tmp_path, (("olga", "operator"),))

    async def meet():
        async with served(state) as address:
            for who in ((None, None), ("olga", "wrong"), ("nobody", PASSWORD), ("admin", "admin")):
                with pytest.raises(ua.UaError):
                    async with plc(address, *who):
                        pass
            async with plc(address, "olga", PASSWORD) as client:
                await client.call("StartJob", "calibrate", "", "somebody else", "", "")
                await client.until("Stand/ResultReady", 1)
                assert await client.read("LastResult/Operator") == "olga"
                state.authenticator.path.write_text('{"format": "truestand.users", "version": 1, "users": []}')
                assert state.authenticator.users == {}
                with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                    await client.read("Stand/State")
                with pytest.raises(ua.UaError):
                    async with plc(address):
                        pass

    asyncio.run(meet())


def test_a_removed_opcua_user_is_refused_at_once(tmp_path):
    state = make_state(tmp_path, (("olga", "operator"), ("erik", "engineer")))
    text = state.authenticator.path.read_text()

    async def meet():
        async with served(state) as address, plc(address, "olga", PASSWORD) as client:
            assert await client.read("Stand/State") == "idle"
            for left in (text.replace('"olga"', '"anna"'), text[: text.index("[")] + "[]}"):
                state.authenticator.path.write_text(left)
                with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                    await client.read("Stand/State")
                with pytest.raises(ua.UaError):
                    async with plc(address):
                        pass
            state.authenticator.path.write_text(text)

    asyncio.run(meet())


def test_guessing_passwords_is_slowed_down(tmp_path):
    state = make_state(tmp_path, (("olga", "operator"),))
    hashed = []
    check = state.authenticator.check
    state.authenticator.check = lambda name, password: hashed.append(name) or check(name, password)

    async def meet():
        async with served(state) as address, plc(address, "olga", PASSWORD):
            for n in range(8):
                with pytest.raises(ua.UaError):
                    async with plc(address, "olga", f"guess {n}"):
                        pass
            async with plc(address, "olga", PASSWORD) as client:  # known: no hash, no waiting
                assert await client.read("Stand/State") == "idle"

    asyncio.run(meet())
    assert len(hashed) <= 7
    assert ("address", "opcua 127.0.0.1") in state.throttle._failures


def test_guesses_from_one_address_delay_no_other(tmp_path):
    state = make_state(tmp_path, (("olga", "operator"),))
    state.authenticator.check = lambda name, password: (
        state.authenticator.users.get(name) if password == PASSWORD else None
    )
    manager = OpcUaUserManager(state)

    def login(address, name, password):
        context = copy_context()
        context.run(peer.set, address)
        return context.run(manager.get_user, None, name, password)

    for n in range(12):
        assert login("10.0.0.1", f"guessed {n}", "guess") is None
    assert login("10.0.0.1", "olga", PASSWORD) is None
    assert login("10.0.0.2", "olga", PASSWORD).name == "olga"


def test_an_address_that_others_can_reach_needs_users(tmp_path):
    state = make_state(tmp_path)
    with pytest.raises(BadRecipe, match="no users"):
        interface_settings(state, "opc.tcp://0.0.0.0:4840")
    for url in ("opc.tcp://127.0.0.1", "http://127.0.0.1:1", "opc.tcp://:4840", "opc.tcp://a:b@127.0.0.1:1", "x"):
        with pytest.raises(BadRecipe, match="need an address"):
            interface_settings(state, url)
    interface_settings(state, "opc.tcp://127.0.0.1:4840")
    guarded = make_state(tmp_path / "guarded", (("olga", "operator"),))
    interface_settings(guarded, "opc.tcp://0.0.0.0:4840")
    write_users(guarded.authenticator.path, {})
    with pytest.raises(BadRecipe, match="no users"):
        interface_settings(guarded, "opc.tcp://0.0.0.0:4840")


@pytest.mark.stand
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_serve_opens_opcua_beside_the_page_and_prints_its_address(tmp_path):
    write_starters(tmp_path)
    serve = ("serve", "--stand", tmp_path / "stand.toml", "--port", "0")
    command = [sys.executable, "-W", "error", "-m", "truestand", *serve, "--opcua", "opc.tcp://127.0.0.1:0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        state, address = (process.stdout.readline().split(" at ")[-1].strip() for _ in range(2))
        assert state.startswith("http://127.0.0.1:"), process.communicate()

        async def look():
            async with plc(address) as client:
                return await client.read("Stand/State")

        assert asyncio.run(look()) == "idle"
        taken = run(*serve, "--opcua", address)
        assert (taken.returncode, taken.stderr.count("\n")) == (2, 1) and "choose another address" in taken.stderr
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=NOT_FOR_EVER) == ("", "") and process.returncode == 0
    finally:
        process.kill()
        process.communicate()
    refused = run(*serve, "--opcua", "opc.tcp://0.0.0.0:0")
    assert refused.returncode == 2 and "no users" in refused.stderr


def test_a_server_that_fails_to_start_leaves_no_executor(state, monkeypatch):
    made = []

    class Executor(ThreadPoolExecutor):
        def __init__(self):
            super().__init__()
            made.append(self)

    async def fail(shown, methods):
        made[0].submit(int).result(20)  # it has a thread
        raise BadRecipe("found nothing to show")

    monkeypatch.setattr(address_space, "ThreadPoolExecutor", Executor)
    monkeypatch.setattr(StandNodes, "build", fail)
    with pytest.raises(BadRecipe, match="nothing to show"):
        talk(state, None)
    with pytest.raises(RuntimeError, match="shutdown"):
        made[0].submit(int)
    assert gc.get_freeze_count() == 0


@pytest.mark.more
def test_with_an_unreadable_store_the_stand_is_not_calibrated(state):
    keep(state, "calibration", calibration())
    (state.settings.store / "store.db").write_bytes(b"no database")

    async def look(client):
        assert await client.reads("Stand", "State", "Calibrated") == ["idle", False]

    talk(state, look)


def test_lines_of_the_same_name_are_numbered():
    twice = lines_of("inspection", inspection(line("F_p", 1.0), line("F_p", 2.0)))
    assert [one.name for one in twice] == ["F_p left", "F_p left (2)"]
    assert replace(twice[1], name="F_p left", value=1.0) == twice[0]
    (change,) = lines_of("verification", verification())
    assert (change.name, change.value, change.upper, change.verdict) == ("eccentricity", 3.0, 10.0, "conforms")
    assert lines_of("scan", {}) == ()
