"""The stand on a real broker (mosquitto), as another client of it sees it."""

import asyncio
import json
import shutil
import socket
import subprocess
import sys
import time
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

import pytest

from interface_lab import keep, make_state
from patience import NOT_FOR_EVER
from small_records import calibration, inspection
from truestand.core.errors import BadRecipe, MissingExtra
from truestand.web.interfaces import mqtt
from truestand.web.interfaces.mqtt import PASSWORD_VARIABLE, broker_of
from truestand.web.interfaces.startup import InterfaceSettings, open_interfaces

MOSQUITTO = shutil.which("mosquitto") or shutil.which("/usr/sbin/mosquitto")
needs_broker = pytest.mark.skipif(MOSQUITTO is None, reason="needs mosquitto (Debian: apt-get install mosquitto)")
BASE = "plant/line_1"


def aiomqtt():
    return pytest.importorskip("aiomqtt", reason="needs the extra mqtt")


@contextmanager
def broker(folder, port, *lines):
    """mosquitto on that port."""
    settings = folder / "mosquitto.conf"
    given = (f"listener {port} 127.0.0.1", "persistence false", *(lines or ("allow_anonymous true",)))
    settings.write_text("\n".join(given) + "\n")
    process = subprocess.Popen([MOSQUITTO, "-c", settings], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        for _ in range(100):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            assert process.poll() is None
            time.sleep(0.05)
        yield process
    finally:
        process.kill()
        process.wait()


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as found:
        return found.getsockname()[1]


@pytest.fixture
def state(tmp_path):
    """Its stand is called by its folder."""
    folder = tmp_path / "line+1"
    folder.mkdir()
    return make_state(folder)


@asynccontextmanager
async def telling(state, port, **more):
    found = broker_of(f"mqtt://127.0.0.1:{port}/plant", environment={}, **more)
    async with open_interfaces(state, InterfaceSettings(mqtt=found)) as (address,):
        assert address == f"mqtt://127.0.0.1:{port}/{BASE}"
        yield
        await asyncio.to_thread(state.runner.close)


class Reader:
    """The newest of each topic, and how often it came."""

    def __init__(self):
        self.newest, self.heard = {}, []

    async def read(self, port, **more):
        async with aiomqtt().Client("127.0.0.1", port, **more) as client:
            await client.subscribe("#", qos=1)
            async for message in client.messages:
                topic, text = str(message.topic).removeprefix(f"{BASE}/"), message.payload.decode()
                self.newest[topic] = text if topic.endswith("online") else json.loads(text)
                self.heard.append(topic)

    async def until(self, what, within=NOT_FOR_EVER):
        async with asyncio.timeout(within):
            while not what(self.newest):
                await asyncio.sleep(0.02)


@asynccontextmanager
async def reading(port, **more):
    reader = Reader()
    task = asyncio.create_task(reader.read(port, **more))
    try:
        yield reader
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


@needs_broker
def test_topics_are_retained_for_later_subscribers(state, tmp_path):
    aiomqtt()
    port = free_port()
    keep(state, "calibration", calibration(valid_until="2099-01-01"))
    number = keep(state, "inspection", inspection())

    async def run():
        async with telling(state, port):
            await asyncio.sleep(1.0)
            async with reading(port) as reader:
                await reader.until(lambda payloads: len(payloads) == 6)
            payloads = reader.newest
        async with reading(port) as later:
            await later.until(lambda payloads: payloads.get("online") == "offline")
        return payloads

    with broker(tmp_path, port):
        payloads = asyncio.run(run())
    assert payloads["online"] == "online"
    state = payloads["state"]
    assert (state["state"], state["calibrated"], state["result"], state["result_count"]) == ("idle", True, number, 2)
    assert payloads["calibration"]["valid_until"] == "2099-01-01"
    assert payloads["job"] is None
    assert (payloads["result"]["verdict"], payloads["result"]["evaluation"]) == ("does_not_conform", 2)
    assert len(payloads["result"]["record_sha256"]) == 64
    lines = {one["name"]: one for one in payloads["result/characteristics"]["characteristics"]}
    assert payloads["result/characteristics"]["number"] == number
    assert (lines["F_p left"]["value"], lines["F_p left"]["upper"], lines["F_p left"]["lower"]) == (41.0, 35.0, None)
    assert lines["F_beta left"]["value"] is None and lines["d_a"]["unit"] == "mm"


@needs_broker
def test_a_job_is_published_and_then_its_result(state, tmp_path):
    aiomqtt()
    port = free_port()

    async def run():
        async with telling(state, port), reading(port) as reader:
            await reader.until(lambda payloads: "result" in payloads)
            request = {"kind": "calibrate", "store": str(state.settings.store), "operator": "olga", "serial": "hold",
                     "stand": str(state.settings.stand), "folder": str(tmp_path / "first")}  # fmt: skip
            job = state.runner.start(request, "shaft", None, (("acquire", "Scan"),))
            await reader.until(lambda payloads: (payloads["job"] or {}).get("done") == 0.5)
            assert reader.newest["state"]["state"] == "running"
            heard = len(reader.heard)
            await asyncio.sleep(1.5)
            assert len(reader.heard) - heard < 10  # 20 live events a second are no news
            state.runner.abort(job["id"])
            await reader.until(lambda payloads: payloads["job"]["state"] == "aborted")
            while state.runner.busy:
                await asyncio.sleep(0.02)
            await asyncio.to_thread(state.runner._reader.join)
            state.runner.start(
                request | {"serial": None, "folder": str(tmp_path / "second")}, "shaft", None, (("acquire", "Scan"),)
            )
            await reader.until(lambda payloads: (payloads["result"] or {}).get("number") == 1)
            assert reader.newest["result/characteristics"]["number"] == 1
            await reader.until(lambda payloads: payloads["state"]["calibrated"])

    with broker(tmp_path, port):
        asyncio.run(run())


@needs_broker
def test_a_broker_that_starts_late_or_restarts_gets_all_topics(state, tmp_path, monkeypatch, capsys):
    aiomqtt()
    monkeypatch.setattr(mqtt, "RECONNECT_DELAYS_S", (0.1,))
    port = free_port()
    keep(state, "inspection", inspection())

    async def see(port):
        async with reading(port) as reader:
            await reader.until(lambda payloads: len(payloads) == 6 and payloads["online"] == "online")

    async def run():
        async with telling(state, port):
            await asyncio.sleep(0.5)
            for _ in range(2):
                with broker(tmp_path, port):
                    await see(port)

    asyncio.run(run())
    printed = capsys.readouterr().err
    counts = [printed.count(text) for text in ("can't be reached", "publishing to the broker")]
    assert counts == [3, 2], printed  # no line a try


@needs_broker
def test_the_last_will_says_that_a_page_died(tmp_path):
    aiomqtt()
    port = free_port()
    script = (
        "import asyncio, sys\n"
        "import interface_lab\n"
        "from pathlib import Path\n"
        "from truestand.web.interfaces.startup import InterfaceSettings, open_interfaces\n"
        "from truestand.web.interfaces.mqtt import broker_of\n"
        "async def main():\n"
        "    state = interface_lab.make_state(Path(sys.argv[1]))\n"
        "    async with open_interfaces(state, InterfaceSettings(mqtt=broker_of(sys.argv[2]))):\n"
        "        await asyncio.sleep(60)\n"
        "asyncio.run(main())\n"
    )

    async def run():
        async with reading(port) as reader:
            (tmp_path / "other").mkdir()
            command = [sys.executable, "-c", script, tmp_path / "other", f"mqtt://127.0.0.1:{port}"]
            dying = subprocess.Popen(command, cwd=Path(__file__).parents[1])
            try:
                await reader.until(lambda payloads: payloads.get("other/online") == "online")
            finally:
                dying.kill()
                dying.wait()
            await reader.until(lambda payloads: payloads["other/online"] == "offline")

    with broker(tmp_path, port):
        asyncio.run(run())


@needs_broker
def test_the_password_is_read_from_a_file(state, tmp_path):
    aiomqtt()
    port = free_port()
    passwords = tmp_path / "passwords"
    maker = shutil.which("mosquitto_passwd")
    if maker is None:
        pytest.skip("needs mosquitto_passwd")
    subprocess.run([maker, "-b", "-c", passwords, "stand", "s3cret"], check=True)
    (tmp_path / "secret").write_text("s3cret\n")
    found = broker_of(f"mqtt://stand@127.0.0.1:{port}/plant", tmp_path / "secret", environment={})

    async def run():
        async with (
            open_interfaces(state, InterfaceSettings(mqtt=found)),
            reading(port, username="stand", password="s3cret") as reader,
        ):
            await reader.until(lambda payloads: "result" in payloads)

    with broker(tmp_path, port, "allow_anonymous false", f"password_file {passwords}", "user root"):
        asyncio.run(run())


def test_broker_urls_are_parsed_and_passwords_in_them_refused(tmp_path):
    parsed = broker_of("mqtt://stand@broker.example/plant/a/", environment={PASSWORD_VARIABLE: "s3cret"})
    assert (parsed.host, parsed.port, parsed.prefix, parsed.user, parsed.password) == (
        "broker.example", 1883, "plant/a/", "stand", "s3cret")  # fmt: skip
    assert "s3cret" not in repr(parsed) and "s3cret" not in str(parsed)
    assert (broker_of("mqtts://b", environment={}).port, broker_of("mqtts://b", environment={}).prefix) == (8883, "")
    with pytest.raises(BadRecipe, match="found a password in the MQTT URL") as refused:
        broker_of("mqtt://stand:s3cret@broker/plant")
    assert "s3cret" not in str(refused.value)
    for url in ("http://broker", "mqtt://", "mqtt://b:x", "mqtt://b/a+b", "mqtt://b/a#b", "mqtt://b/?a=1", "b:1883"):
        with pytest.raises(BadRecipe, match="found no MQTT URL"):
            broker_of(url)
    with pytest.raises(BadRecipe, match="no readable password"):
        broker_of("mqtt://b", tmp_path / "missing")


def test_mqtt_without_its_extra_says_what_to_install(state, monkeypatch):
    monkeypatch.setitem(sys.modules, "aiomqtt", None)

    async def run():
        async with open_interfaces(state, InterfaceSettings(mqtt=broker_of("mqtt://127.0.0.1", environment={}))):
            pass

    with pytest.raises(MissingExtra, match=r"truestand\[mqtt\]"):
        asyncio.run(run())
