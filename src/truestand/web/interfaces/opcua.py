"""The stand as an OPC UA server: its state, its newest result with every line, and methods to run jobs.

Without encryption: names, passwords and results cross the network as they are. It belongs on a machine's own network.
"""

import asyncio
import gc
import logging
import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from datetime import UTC, datetime
from urllib.parse import urlsplit

from asyncua import Server, ua
from asyncua.common.connection import TransportLimits

from truestand._version import __version__
from truestand.core.errors import BadRecipe
from truestand.web.interfaces.access import Peers, People, Rules
from truestand.web.interfaces.lines import Line
from truestand.web.interfaces.methods import START, Methods
from truestand.web.interfaces.nodes import TEXTS, Kind, Nodes, Value
from truestand.web.interfaces.status import EVALUATIONS, Json, Teller, Told

NAMESPACE = "urn:truestand"
MESSAGE = 1 << 20
"""Bytes of a client's message."""
STAND = {
    "State": Kind.String, "Step": Kind.String, "Done": Kind.Double, "Message": Kind.String, "Fault": Kind.String,
    "Refused": Kind.String, "Calibrated": Kind.Boolean, "CalibrationStatus": Kind.String,
    "CalibratedUntil": Kind.String, "JobId": Kind.String, "JobState": Kind.String,
}  # fmt: skip
LIVE = {"State": Kind.String, "Position_deg": Kind.Double}
SENSOR = {"FramesPerSecond": Kind.Double, "Profiles": Kind.Int64, "Lost": Kind.Int64}
RESULT = {
    "Number": Kind.Int64, "Kind": Kind.String, "Time": Kind.DateTime, "Part": Kind.String, "Serial": Kind.String,
    "Order": Kind.String, "Operator": Kind.String, "Verdict": Kind.String, "Status": Kind.String,
    "ResultEvaluation": Kind.Int32, "Reasons": TEXTS, "RecordHash": Kind.String, "CorrectedBy": Kind.Int64,
}  # fmt: skip
LINE = {
    "Value": Kind.Double, "U": Kind.Double, "Lower": Kind.Double, "Upper": Kind.Double, "Unit": Kind.String,
    "Verdict": Kind.String, "ResultEvaluation": Kind.Int32, "Status": Kind.String, "Coverage": Kind.Double,
    "Standard": Kind.String,
}  # fmt: skip
COUNT = {"ResultCount": Kind.Int64, "ResultReady": Kind.Int64}
LINES = "LastResult/Characteristics"

logging.getLogger("asyncua").addHandler(logging.NullHandler())  # our own errors tell what goes wrong


@asynccontextmanager
async def opcua_server(teller: Teller, url: str) -> AsyncIterator[str]:
    """A server that shows what the teller tells, as long as this is open; its address.

    Raises:
        BadRecipe: an address that can't be had.
    """
    people = People(teller.page)
    server = Server(Peers(people))
    try:
        await _build(server, people, url)
        shown = Shown(Nodes(server, await server.register_namespace(NAMESPACE)))
        await shown.build(Methods(teller.page, shown.refuse))
        await shown.show(teller.newest)
        await _start(server, url)
        showing = asyncio.create_task(_follow(teller, shown))
        try:
            yield _address(server, url)
        finally:
            showing.cancel()
            await asyncio.gather(showing, return_exceptions=True)
    finally:
        await server.stop()  # its executor for methods too, which is there before it starts
        gc.unfreeze()


class Shown:
    """The nodes and what they show."""

    def __init__(self, nodes: Nodes) -> None:
        self._nodes = nodes

    async def build(self, methods: Methods) -> None:
        """All that is always there."""
        n = self._nodes
        for path in ("Stand", "Stand/Live", "LastResult"):
            await n.add_object(path)
        for path in ("Stand/Live/Sensors", LINES):
            await n.add_object(path, folder=True)
        for path, kinds in (("Stand", STAND | COUNT), ("Stand/Live", LIVE), ("LastResult", RESULT)):
            await n.add_variables(path, kinds)
        await n.add_method("Stand/StartJob", methods.start, START, {"id": "of the job"})
        await n.add_method("Stand/Abort", methods.abort, {}, {"id": "of the job that was aborted"})
        await n.add_method("Stand/ResetFault", methods.reset, {}, {"fault": "that was reset; empty: none"})
        await n.write("Stand", {"Refused": "", "ResultReady": 0, "ResultCount": 0})

    async def refuse(self, why: str) -> None:
        """Why the last call was refused, or nothing."""
        await self._nodes.write("Stand", {"Refused": why})

    async def show(self, told: Told) -> None:
        """Show all of it; that a result is ready last of all."""
        await self._nodes.write("Stand", _stand(told))
        await self._show_live(told.live or {})
        await self._nodes.write("LastResult", _result(told.result or {}))
        await self._show_lines(told.lines)
        await self._nodes.write("Stand", {"ResultCount": told.count, "ResultReady": told.number})

    async def _show_live(self, live: Json) -> None:
        await self._nodes.write("Stand/Live", {"State": live.get("state"), "Position_deg": live.get("position_deg")})
        for sensor in live.get("sensors") or ():
            path = f"Stand/Live/Sensors/{sensor['name'].replace('/', '_')}"
            if path not in self._nodes:
                await self._nodes.add_object(path)
                await self._nodes.add_variables(path, SENSOR)
            told = (sensor.get(key) for key in ("frames_per_s", "profiles", "lost"))
            await self._nodes.write(path, dict(zip(SENSOR, told, strict=True)))

    async def _show_lines(self, lines: tuple[Line, ...]) -> None:
        """One object each; those of the last result that this one hasn't are gone."""
        wanted = {f"{LINES}/{line.name.replace('/', '_')}": line for line in lines}
        await self._nodes.remove(LINES, {at for at in self._nodes.children(LINES) if at not in wanted})
        for path, line in wanted.items():
            if path not in self._nodes:
                await self._nodes.add_object(path)
                await self._nodes.add_variables(path, LINE)
                await asyncio.sleep(0)  # some 3 ms each: let the page live
            await self._nodes.write(path, _line(line))


async def _follow(teller: Teller, shown: Shown) -> None:
    async for told in teller.changes():
        await shown.show(told)


async def _build(server: Server, people: People, url: str) -> None:
    """All that a server needs before anybody can reach it; the standard's address space takes asyncua a second."""
    with _no_collection():
        await server.init()
    await server.set_application_uri(f"{NAMESPACE}:{socket.gethostname()}")
    await server.set_build_info(NAMESPACE, "truestand", "truestand", __version__, "0", datetime.now(UTC))
    server.set_server_name("truestand")
    server.set_endpoint(url)
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity], Rules(people))
    server.set_identity_tokens([ua.AnonymousIdentityToken, ua.UserNameIdentityToken])
    server.iserver.allow_remote_admin = False
    server.limits = TransportLimits(max_chunk_count=MESSAGE // 65535 + 1, max_message_size=MESSAGE)


async def _start(server: Server, url: str) -> None:
    try:
        await server.start()
    except OSError as wrong:
        raise BadRecipe(
            f"{url}: {wrong.strerror or wrong}; end what serves there, or choose another address"
        ) from wrong


def _stand(told: Told) -> dict[str, Value]:
    s, job = told.state, told.job or {}
    return {
        "State": s["state"], "Step": s["step"], "Done": s["done"], "Message": s["message"], "Fault": s["fault"],
        "Calibrated": s["calibrated"], "CalibrationStatus": s["calibration_status"],
        "CalibratedUntil": s["calibrated_until"], "JobId": job.get("id"), "JobState": job.get("state"),
    }  # fmt: skip


def _result(r: Json) -> dict[str, Value]:
    return {
        "Number": r.get("number"), "Kind": r.get("kind"), "Time": _time(r.get("time")), "Part": r.get("part"),
        "Serial": r.get("serial"), "Order": r.get("order"), "Operator": r.get("operator"),
        "Verdict": r.get("verdict"), "Status": r.get("status"), "ResultEvaluation": r.get("evaluation"),
        "Reasons": r.get("reasons"), "RecordHash": r.get("record_sha256"), "CorrectedBy": r.get("corrected_by"),
    }  # fmt: skip


def _line(line: Line) -> dict[str, Value]:
    return {
        "Value": line.value, "U": line.U, "Lower": line.lower, "Upper": line.upper, "Unit": line.unit,
        "Verdict": line.verdict, "ResultEvaluation": EVALUATIONS.get(line.verdict or "", 0), "Status": line.status,
        "Coverage": line.coverage, "Standard": line.standard,
    }  # fmt: skip


def _time(told: str | None) -> datetime | None:
    """An ISO time as OPC UA has it; one without a zone is UTC."""
    if told is None:
        return None
    time = datetime.fromisoformat(told)
    return time.astimezone(UTC) if time.tzinfo else time.replace(tzinfo=UTC)


def _address(server: Server, url: str) -> str:
    """With the port that was free, where it was 0."""
    told = urlsplit(url)
    assert server.bserver is not None
    host = f"[{told.hostname}]" if ":" in (told.hostname or "") else told.hostname
    return f"opc.tcp://{host}:{server.bserver.port}{told.path}"


@contextmanager
def _no_collection() -> Iterator[None]:
    """While the address space is built; it then stays, and is never looked through for garbage again."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if collecting:
            gc.enable()
