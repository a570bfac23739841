"""The stand on an MQTT broker: retained JSON, a topic a thing, and a last will that says when the page is gone.

It only tells; nothing can be started from here. What the broker can't be told in time is replaced by what is newer.
"""

import asyncio
import json
import logging
import os
import re
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote, urlsplit

from truestand.core.errors import BadRecipe, MissingExtra
from truestand.web.interfaces.status import Teller, Told, as_json

if TYPE_CHECKING:
    from aiomqtt import Client

PASSWORD = "TRUESTAND_MQTT_PASSWORD"
"""The environment variable."""
PORTS = {"mqtt": 1883, "mqtts": 8883}
WAITS = (1.0, 2.0, 5.0, 15.0, 30.0)
"""s before the next try to reach the broker; the last one from then on."""
ANSWER = 10.0
"""s for the broker to confirm a message."""
KEEPALIVE = 20
"""s; after half as long again a broker tells the last will of a page that is gone."""
PAUSE = 0.5
"""s between two rounds of messages: a job's progress is no film."""
ENDING = 3.0
"""s to tell the last of it when the page ends."""
ONLINE, OFFLINE = "online", "offline"
Say = Callable[[str], None]

logging.getLogger("mqtt").addHandler(logging.NullHandler())  # our own lines tell what goes wrong


@dataclass(frozen=True, slots=True)
class Broker:
    """Where to tell it."""

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
        told = urlsplit(url)
        port = told.port or PORTS.get(told.scheme)
    except ValueError:
        told, port = urlsplit(""), None
    if told.password is not None:
        raise BadRecipe(f"found a password in the MQTT URL, which everyone can read; put it into ${PASSWORD} or a file")
    if port is None or not told.hostname or told.query or told.fragment or re.search(r"[+#\x00]", told.path):
        raise BadRecipe("found no MQTT URL, need one like mqtt://host:1883/prefix (mqtts:// with TLS)")
    prefix = told.path.strip("/")
    return Broker(
        told.hostname, port, f"{prefix}/" if prefix else "", told.scheme == "mqtts",
        unquote(told.username) if told.username else None, _password(password_file, environment),
    )  # fmt: skip


def topics(told: Told) -> dict[str, Any]:
    """What each topic says, below the stand's."""
    return {
        "state": told.state | {"result_count": told.count, "result": told.number or None},
        "job": told.job,
        "calibration": told.calibration,
        "result/characteristics": {"number": told.number or None, "characteristics": as_json(told.lines)},
        "result": told.result,
    }


@asynccontextmanager
async def mqtt_publisher(teller: Teller, broker: Broker, stand: str, say: Say) -> AsyncIterator[str]:
    """Tells the broker what the teller tells, as long as this is open; where. A broker that is away is waited for.

    Raises:
        MissingExtra: aiomqtt isn't installed.
    """
    try:
        import aiomqtt  # noqa: F401
    except ImportError as wrong:
        raise MissingExtra("MQTT needs an extra package; install it with: pip install 'truestand[mqtt]'") from wrong
    publisher = Publisher(teller, broker, stand, say)
    running = asyncio.create_task(publisher.run())
    try:
        yield f"{'mqtts' if broker.tls else 'mqtt'}://{broker}/{publisher.base}"
    finally:
        publisher.end()
        with suppress(TimeoutError):
            async with asyncio.timeout(ENDING):
                await asyncio.shield(running)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


class Publisher:
    """One stand's topics on one broker."""

    def __init__(self, teller: Teller, broker: Broker, stand: str, say: Say) -> None:
        self.base = f"{broker.prefix}{re.sub(r'[+#/]', '_', stand) or 'stand'}"
        self._teller, self._broker, self._say = teller, broker, say
        self._ending = asyncio.Event()
        self._tries = 0

    def end(self) -> None:
        """Tell the last of it and leave."""
        self._ending.set()

    async def run(self) -> None:
        """Until ``end``: connect, tell, and again where the connection is lost."""
        from aiomqtt import MqttError

        while not self._ending.is_set():
            try:
                await self._connected()
            except (MqttError, OSError) as wrong:
                if self._tries == 0:
                    self._say(f"mqtt: the broker {self._broker} can't be reached ({wrong}); trying again and again")
                with suppress(TimeoutError):
                    async with asyncio.timeout(WAITS[min(self._tries, len(WAITS) - 1)]):
                        await self._ending.wait()
                self._tries += 1

    async def _connected(self) -> None:
        async with self._client() as client:
            self._say(f"mqtt: telling the broker {self._broker} below {self.base}")
            self._tries = 0
            await self._publish(client, "online", ONLINE)
            sent: dict[str, str] = {}
            jobs = (self._follow(client, sent), _hear(client), self._ending.wait())
            tasks = [asyncio.create_task(job) for job in jobs]
            try:
                ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
                for task in ended:
                    task.result()
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
            await self._tell(client, sent)
            await self._publish(client, "online", OFFLINE)

    async def _follow(self, client: "Client", sent: dict[str, str]) -> None:
        async for _ in self._teller.changes():
            await self._tell(client, sent)
            await asyncio.sleep(PAUSE)

    async def _tell(self, client: "Client", sent: dict[str, str]) -> None:
        """What is new since; the result after its characteristics."""
        for topic, told in topics(self._teller.newest).items():
            text = json.dumps(told, allow_nan=False)
            if sent.get(topic) != text:
                await self._publish(client, topic, text)
                sent[topic] = text

    async def _publish(self, client: "Client", topic: str, text: str) -> None:
        await client.publish(f"{self.base}/{topic}", text, qos=1, retain=True, timeout=ANSWER)

    def _client(self) -> "Client":
        from aiomqtt import Client, TLSParameters, Will

        broker = self._broker
        return Client(
            broker.host, broker.port, username=broker.user, password=broker.password, timeout=ANSWER,
            will=Will(f"{self.base}/online", OFFLINE, qos=1, retain=True), keepalive=KEEPALIVE,
            tls_params=TLSParameters() if broker.tls else None,
        )  # fmt: skip


async def _hear(client: "Client") -> None:
    """Nothing is expected; aiomqtt tells here that the connection is lost."""
    async for _ in client.messages:
        pass


def _password(file: Path | None, environment: Mapping[str, str]) -> str | None:
    if file is None:
        return environment.get(PASSWORD)
    try:
        return file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as wrong:
        raise BadRecipe(f"{file}: found no readable password ({wrong}); need one line of text") from wrong
