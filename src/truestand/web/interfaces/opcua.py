"""The stand as an OPC UA server: its state, its newest result with every line, and methods to run jobs.

Without encryption: names, passwords and results cross the network as they are. It belongs on a machine's own network.
"""

import asyncio
import gc
import logging
import socket
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from urllib.parse import urlsplit

from asyncua import Server, ua
from asyncua.common.connection import TransportLimits

from truestand._version import __version__
from truestand.core.errors import BadRecipe
from truestand.web.authentication import Authenticator
from truestand.web.interfaces.access import AccessRules, OpcUaUserManager, PeerRecordingServer
from truestand.web.interfaces.lines import Line
from truestand.web.interfaces.methods import START, Methods
from truestand.web.interfaces.nodes import TEXTS, Kind, Nodes, Value
from truestand.web.interfaces.status import EVALUATIONS, Json, Snapshot, StatusPublisher

NAMESPACE = "urn:truestand"
MAX_MESSAGE_BYTES = 1 << 20
"""Of a client."""
Variables = Mapping[str, tuple[Kind, str]]
"""Of an object by name: the type, and the key under which the snapshot has the value."""
STAND: Variables = {
    "State": (Kind.String, "state"), "Step": (Kind.String, "step"), "Done": (Kind.Double, "done"),
    "Message": (Kind.String, "message"), "Fault": (Kind.String, "fault"), "Calibrated": (Kind.Boolean, "calibrated"),
    "CalibrationStatus": (Kind.String, "calibration_status"), "CalibratedUntil": (Kind.String, "calibrated_until"),
    "JobId": (Kind.String, "job_id"), "JobState": (Kind.String, "job_state"),
}  # fmt: skip
LIVE: Variables = {"State": (Kind.String, "state"), "Position_deg": (Kind.Double, "position_deg")}
SENSOR: Variables = {
    "FramesPerSecond": (Kind.Double, "frames_per_s"), "Profiles": (Kind.Int64, "profiles"),
    "Lost": (Kind.Int64, "lost"),
}  # fmt: skip
RESULT: Variables = {
    "Number": (Kind.Int64, "number"), "Kind": (Kind.String, "kind"), "Time": (Kind.DateTime, "time"),
    "Part": (Kind.String, "part"), "Serial": (Kind.String, "serial"), "Order": (Kind.String, "order"),
    "Operator": (Kind.String, "operator"), "Verdict": (Kind.String, "verdict"), "Status": (Kind.String, "status"),
    "ResultEvaluation": (Kind.Int32, "evaluation"), "Reasons": (TEXTS, "reasons"),
    "RecordHash": (Kind.String, "record_sha256"), "CorrectedBy": (Kind.Int64, "corrected_by"),
}  # fmt: skip
LINE: Variables = {
    "Value": (Kind.Double, "value"), "U": (Kind.Double, "U"), "Lower": (Kind.Double, "lower"),
    "Upper": (Kind.Double, "upper"), "Unit": (Kind.String, "unit"), "Verdict": (Kind.String, "verdict"),
    "ResultEvaluation": (Kind.Int32, "evaluation"), "Status": (Kind.String, "status"),
    "Coverage": (Kind.Double, "coverage"), "Standard": (Kind.String, "standard"),
}  # fmt: skip
LATEST = {"Refused": Kind.String, "ResultCount": Kind.Int64, "ResultReady": Kind.Int64}
"""Of the stand, written one by one."""
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
        nodes = StandNodes(server, await server.register_namespace(NAMESPACE))
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


class StandNodes(Nodes):
    """The stand's nodes, which show snapshots."""

    async def build(self, methods: Methods) -> None:
        """Add the nodes that are always there."""
        await self.add_object("Stand", _kinds(STAND) | LATEST)
        await self.add_object("Stand/Live", _kinds(LIVE))
        await self.add_object("LastResult", _kinds(RESULT))
        for path in ("Stand/Live/Sensors", LINES):
            await self.add_object(path, {}, folder=True)
        await self.add_method("Stand/StartJob", methods.start, START, {"id": "of the job"})
        await self.add_method("Stand/Abort", methods.abort, {}, {"id": "of the job that was aborted"})
        await self.add_method("Stand/ResetFault", methods.reset, {}, {"fault": "that was reset; empty: none"})
        await self.write("Stand", {"Refused": "", "ResultReady": 0, "ResultCount": 0})

    async def show_refusal(self, text: str) -> None:
        """Why the last call was refused; empty where it was not."""
        await self.write("Stand", {"Refused": text})

    async def show(self, snapshot: Snapshot) -> None:
        """Write all values; ``ResultReady`` last, so that who is notified of it finds the whole result."""
        job, result = snapshot.job or {}, snapshot.result or {}
        stand = snapshot.state | {"job_id": job.get("id"), "job_state": job.get("state")}
        await self.write("Stand", _values(STAND, stand))
        await self._show_live(snapshot.live or {})
        await self.write("LastResult", _values(RESULT, result | {"time": _time(result.get("time"))}))
        await self._show_lines(snapshot.lines)
        await self.write("Stand", {"ResultCount": snapshot.count, "ResultReady": snapshot.number})

    async def _show_live(self, live: Json) -> None:
        await self.write("Stand/Live", _values(LIVE, live))
        for sensor in live.get("sensors") or ():
            path = f"Stand/Live/Sensors/{sensor['name'].replace('/', '_')}"
            if path not in self:
                await self.add_object(path, _kinds(SENSOR))
            await self.write(path, _values(SENSOR, sensor))

    async def _show_lines(self, lines: tuple[Line, ...]) -> None:
        """One object each; those of the result before that this one lacks are removed."""
        by_path = {f"{LINES}/{line.name.replace('/', '_')}": line for line in lines}
        await self.remove(LINES, {at for at in self.children(LINES) if at not in by_path})
        for path, line in by_path.items():
            if path not in self:
                await self.add_object(path, _kinds(LINE))
                await asyncio.sleep(0)  # some 3 ms each: let the event loop answer others
            await self.write(path, _values(LINE, asdict(line) | {"evaluation": EVALUATIONS.get(line.verdict or "", 0)}))


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


def _kinds(variables: Variables) -> dict[str, Kind]:
    return {name: kind for name, (kind, _) in variables.items()}


def _values(variables: Variables, source: Json) -> dict[str, Value]:
    return {name: source.get(key) for name, (_, key) in variables.items()}


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
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
