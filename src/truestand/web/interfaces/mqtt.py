"""The stand on an MQTT broker: retained JSON in a few topics, and a last will that says when the page is gone.

It only publishes; nothing can be started from here. What can't be published in time is replaced by what is newer.
"""

import asyncio
import json
import logging
import os
import re
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote, urlsplit

from truestand.core.errors import BadRecipe, MissingExtra
from truestand.web.interfaces.status import Snapshot, StatusPublisher

if TYPE_CHECKING:
    from aiomqtt import Client

PASSWORD_VARIABLE = "TRUESTAND_MQTT_PASSWORD"
"""In the environment."""
PORTS = {"mqtt": 1883, "mqtts": 8883}
RECONNECT_DELAYS_S = (1.0, 2.0, 5.0, 15.0, 30.0)
"""Before the next try to reach the broker; the last one from then on."""
CONFIRM_TIMEOUT_S = 10.0
"""For the broker to confirm a message."""
KEEPALIVE_S = 20
"""After half as long again a broker publishes the last will of a page that is gone."""
PUBLISH_INTERVAL_S = 0.5
"""Between two rounds of messages: nobody needs a job's progress more often."""
SHUTDOWN_TIMEOUT_S = 3.0
"""To publish the last snapshot when the page ends."""
ONLINE, OFFLINE = "online", "offline"
Log = Callable[[str], None]

logging.getLogger("mqtt").addHandler(logging.NullHandler())  # _log has what goes wrong


@dataclass(frozen=True, slots=True)
class Broker:
    """An MQTT broker, and how to log in there."""

    host: str
    port: int
    prefix: str
    """Of the topics, with a slash at its end or empty."""
    tls: bool = False
    user: str | None = None
    password: str | None = field(default=None, repr=False)

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def broker_of(url: str, password_file: Path | None = None, environment: Mapping[str, str] = os.environ) -> Broker:
    """The broker of mqtt[s]://[user@]host[:port][/prefix]; its password out of a file, or else the environment.

    Raises:
        BadRecipe: another URL, one with a password, or a file that can't be read.
    """
    try:
        parts = urlsplit(url)
        port = parts.port or PORTS.get(parts.scheme)
    except ValueError:
        parts, port = urlsplit(""), None
    if parts.password is not None:
        raise BadRecipe(
            f"found a password in the MQTT URL, which everyone can read; put it into ${PASSWORD_VARIABLE} or a file"
        )
    if port is None or not parts.hostname or parts.query or parts.fragment or re.search(r"[+#\x00]", parts.path):
        raise BadRecipe("found no MQTT URL, need one like mqtt://host:1883/prefix (mqtts:// with TLS)")
    prefix = parts.path.strip("/")
    return Broker(
        parts.hostname, port, f"{prefix}/" if prefix else "", parts.scheme == "mqtts",
        unquote(parts.username) if parts.username else None, _password(password_file, environment),
    )  # fmt: skip


def topics(snapshot: Snapshot) -> dict[str, Any]:
    """The payload of each topic, by its name below the stand's; the result after its characteristics."""
    lines = [asdict(line) for line in snapshot.lines]
    return {
        "state": snapshot.state | {"result_count": snapshot.count, "result": snapshot.number or None},
        "job": snapshot.job,
        "calibration": snapshot.calibration,
        "result/characteristics": {"number": snapshot.number or None, "characteristics": lines},
        "result": snapshot.result,
    }


@asynccontextmanager
async def mqtt_publisher(status: StatusPublisher, broker: Broker, stand: str, log: Log) -> AsyncIterator[str]:
    """Publishes every snapshot, as long as this is open; the topics' URL. A broker that is away is waited for.

    Raises:
        MissingExtra: aiomqtt isn't installed.
    """
    try:
        import aiomqtt  # noqa: F401
    except ImportError as wrong:
        raise MissingExtra("MQTT needs an extra package; install it with: pip install 'truestand[mqtt]'") from wrong
    publisher = MqttPublisher(status, broker, stand, log)
    running = asyncio.create_task(publisher.run())
    try:
        yield f"{'mqtts' if broker.tls else 'mqtt'}://{broker}/{publisher.base}"
    finally:
        publisher.end()
        await asyncio.wait({running}, timeout=SHUTDOWN_TIMEOUT_S)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


class MqttPublisher:
    """One stand's topics on one broker."""

    def __init__(self, status: StatusPublisher, broker: Broker, stand: str, log: Log) -> None:
        self.base = f"{broker.prefix}{re.sub(r'[+#/]', '_', stand) or 'stand'}"
        self._status, self._broker, self._log = status, broker, log
        self._ending = asyncio.Event()
        self._tries = 0

    def end(self) -> None:
        """Publish the last snapshot and disconnect."""
        self._ending.set()

    async def run(self) -> None:
        """Until ``end``: connect, publish, and again where the connection is lost."""
        from aiomqtt import MqttError

        while not self._ending.is_set():
            try:
                await self._publish_until_end()
            except (MqttError, OSError) as wrong:
                if self._tries == 0:
                    self._log(f"mqtt: the broker {self._broker} can't be reached ({wrong}); trying again and again")
                with suppress(TimeoutError):
                    async with asyncio.timeout(RECONNECT_DELAYS_S[min(self._tries, len(RECONNECT_DELAYS_S) - 1)]):
                        await self._ending.wait()
                self._tries += 1

    async def _publish_until_end(self) -> None:
        async with self._client() as client:
            self._log(f"mqtt: publishing to the broker {self._broker} below {self.base}")
            self._tries = 0
            await self._publish(client, "online", ONLINE)
            sent: dict[str, str] = {}
            jobs = (self._follow(client, sent), _until_disconnected(client), self._ending.wait())
            tasks = [asyncio.create_task(job) for job in jobs]
            try:
                ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
                for task in ended:
                    task.result()
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
            await self._publish_changed(client, sent)
            await self._publish(client, "online", OFFLINE)

    async def _follow(self, client: "Client", sent: dict[str, str]) -> None:
        async for _ in self._status.changes():
            await self._publish_changed(client, sent)
            await asyncio.sleep(PUBLISH_INTERVAL_S)

    async def _publish_changed(self, client: "Client", sent: dict[str, str]) -> None:
        for topic, payload in topics(self._status.newest).items():
            text = json.dumps(payload, allow_nan=False)
            if sent.get(topic) != text:
                await self._publish(client, topic, text)
                sent[topic] = text

    async def _publish(self, client: "Client", topic: str, text: str) -> None:
        await client.publish(f"{self.base}/{topic}", text, qos=1, retain=True, timeout=CONFIRM_TIMEOUT_S)

    def _client(self) -> "Client":
        from aiomqtt import Client, TLSParameters, Will

        broker = self._broker
        return Client(
            broker.host, broker.port, username=broker.user, password=broker.password, timeout=CONFIRM_TIMEOUT_S,
            will=Will(f"{self.base}/online", OFFLINE, qos=1, retain=True), keepalive=KEEPALIVE_S,
            tls_params=TLSParameters() if broker.tls else None,
        )  # fmt: skip


async def _until_disconnected(client: "Client") -> None:
    """Nothing is subscribed to; aiomqtt raises here where the connection is lost."""
    async for _ in client.messages:
        pass


def _password(file: Path | None, environment: Mapping[str, str]) -> str | None:
    if file is None:
        return environment.get(PASSWORD_VARIABLE)
    try:
        return file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as wrong:
        raise BadRecipe(f"{file}: found no readable password ({wrong}); need one line of text") from wrong
