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
from truestand.web.interfaces.access import AccessRules, OpcUaUserManager, PeerRecordingServer
from truestand.web.interfaces.lines import Line
from truestand.web.interfaces.methods import START, Methods
from truestand.web.interfaces.nodes import TEXTS, Kind, Nodes, Value
from truestand.web.interfaces.status import EVALUATIONS, Json, Snapshot, StatusPublisher
from truestand.web.users import Authenticator

NAMESPACE = "urn:truestand"
MAX_MESSAGE_BYTES = 1 << 20
"""Of a client."""
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

logging.getLogger("asyncua").addHandler(logging.NullHandler())  # our own errors say what goes wrong


@asynccontextmanager
async def opcua_server(status: StatusPublisher, url: str) -> AsyncIterator[str]:
    """A server that shows every snapshot, as long as this is open; its address.

    Raises:
        BadRecipe: an address that is taken, or none of this machine's.
    """
    server = Server(PeerRecordingServer(OpcUaUserManager(status.state)))
    try:
        await _configure(server, status.state.authenticator, url)
        nodes = StandNodes(Nodes(server, await server.register_namespace(NAMESPACE)))
        await nodes.build(Methods(status.state, nodes.show_refusal))
        await nodes.show(status.newest)
        await _start(server, url)
        following = asyncio.create_task(_follow(status, nodes))
        try:
            yield _address(server, url)
        finally:
            following.cancel()
            await asyncio.gather(following, return_exceptions=True)
    finally:
        await server.stop()  # its executor for methods too, which is there before it starts
        gc.unfreeze()


class StandNodes:
    """The stand's nodes, which show snapshots."""

    def __init__(self, nodes: Nodes) -> None:
        self._nodes = nodes

    async def build(self, methods: Methods) -> None:
        """Add the nodes that are always there."""
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

    async def show_refusal(self, text: str) -> None:
        """Why the last call was refused; empty where it was not."""
        await self._nodes.write("Stand", {"Refused": text})

    async def show(self, snapshot: Snapshot) -> None:
        """Write all values; ``ResultReady`` last, so that who is notified of it finds the whole result."""
        await self._nodes.write("Stand", _stand(snapshot))
        await self._show_live(snapshot.live or {})
        await self._nodes.write("LastResult", _result(snapshot.result or {}))
        await self._show_lines(snapshot.lines)
        await self._nodes.write("Stand", {"ResultCount": snapshot.count, "ResultReady": snapshot.number})

    async def _show_live(self, live: Json) -> None:
        await self._nodes.write("Stand/Live", {"State": live.get("state"), "Position_deg": live.get("position_deg")})
        for sensor in live.get("sensors") or ():
            path = f"Stand/Live/Sensors/{sensor['name'].replace('/', '_')}"
            if path not in self._nodes:
                await self._nodes.add_object(path)
                await self._nodes.add_variables(path, SENSOR)
            values = (sensor.get(key) for key in ("frames_per_s", "profiles", "lost"))
            await self._nodes.write(path, dict(zip(SENSOR, values, strict=True)))

    async def _show_lines(self, lines: tuple[Line, ...]) -> None:
        """One object each; those of the result before that this one lacks are removed."""
        by_path = {f"{LINES}/{line.name.replace('/', '_')}": line for line in lines}
        await self._nodes.remove(LINES, {at for at in self._nodes.children(LINES) if at not in by_path})
        for path, line in by_path.items():
            if path not in self._nodes:
                await self._nodes.add_object(path)
                await self._nodes.add_variables(path, LINE)
                await asyncio.sleep(0)  # some 3 ms each: let the event loop answer others
            await self._nodes.write(path, _line(line))


async def _follow(status: StatusPublisher, nodes: StandNodes) -> None:
    async for snapshot in status.changes():
        await nodes.show(snapshot)


async def _configure(server: Server, authenticator: Authenticator, url: str) -> None:
    """Before anybody can reach the server; the standard's address space takes asyncua a second."""
    with _without_garbage_collection():
        await server.init()
    await server.set_application_uri(f"{NAMESPACE}:{socket.gethostname()}")
    await server.set_build_info(NAMESPACE, "truestand", "truestand", __version__, "0", datetime.now(UTC))
    server.set_server_name("truestand")
    server.set_endpoint(url)
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity], AccessRules(authenticator))
    server.set_identity_tokens([ua.AnonymousIdentityToken, ua.UserNameIdentityToken])
    server.iserver.allow_remote_admin = False
    server.limits = TransportLimits(max_chunk_count=MAX_MESSAGE_BYTES // 65535 + 1, max_message_size=MAX_MESSAGE_BYTES)


async def _start(server: Server, url: str) -> None:
    try:
        await server.start()
    except OSError as wrong:
        raise BadRecipe(
            f"{url}: {wrong.strerror or wrong}; end what serves there, or choose another address"
        ) from wrong


def _stand(snapshot: Snapshot) -> dict[str, Value]:
    s, job = snapshot.state, snapshot.job or {}
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


def _time(text: str | None) -> datetime | None:
    """An ISO time as OPC UA has it; one without a zone is UTC."""
    if text is None:
        return None
    time = datetime.fromisoformat(text)
    return time.astimezone(UTC) if time.tzinfo else time.replace(tzinfo=UTC)


def _address(server: Server, url: str) -> str:
    """With the port that was free, where it was 0."""
    parts = urlsplit(url)
    assert server.bserver is not None
    host = f"[{parts.hostname}]" if ":" in (parts.hostname or "") else parts.hostname
    return f"opc.tcp://{host}:{server.bserver.port}{parts.path}"


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """While the address space is built; it then stays, and is never looked through for garbage again."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if collecting:
            gc.enable()
