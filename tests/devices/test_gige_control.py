"""Control of a GigE Vision device over a network that loses and delays; and its description, plain or zipped."""

import builtins
import io
import socket
import threading
import time
import zipfile

import pytest

from patience import NOT_FOR_EVER
from truestand.core.errors import DeviceError, DeviceLost, MissingExtra
from truestand.devices.gige.assembly import Assembler
from truestand.devices.gige.control import Control
from truestand.devices.gige.nodes import Nodes, description
from truestand.devices.gige.stream import Stream
from truestand.devices.wire import gvcp
from truestand.devices.wire.gvcp import Acknowledge, Command, Register, Status

XML = """<?xml version="1.0"?>
<RegisterDescription ModelName="M" VendorName="V" StandardNameSpace="None" SchemaMajorVersion="1" SchemaMinorVersion="1"
 SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" SubMinorVersion="0"
 ProductGuid="5b0f7a52-6d0e-4f0a-9d3e-7f3c6a1d2b11" VersionGuid="9c1f2e34-0a5b-4c6d-8e7f-102030405060"
 xmlns="http://www.genicam.org/GenApi/Version_1_1">
<Category Name="Root"><pFeature>Gain</pFeature></Category>
<IntReg Name="Gain"><Address>0xA000</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort>
<Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
<StringReg Name="Label"><Address>0xA010</Address><Length>16</Length><AccessMode>RW</AccessMode><pPort>Device</pPort>
</StringReg><Port Name="Device"/></RegisterDescription>"""
XML_AT = 0x10000


class Memory:
    """A device of nothing but memory; ``trouble`` decides what becomes of each request."""

    def __init__(self, last):
        self.address = f"127.0.42.{last}"
        self.memory = bytearray(1 << 17)
        self.trouble = lambda request, answer: [answer]
        self.asked = []
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((self.address, gvcp.PORT))
        self.socket.settimeout(0.05)
        self.running = True
        self.thread = threading.Thread(target=self.serve)
        self.thread.start()

    def put(self, address, data):
        self.memory[address : address + len(data)] = data

    def describe(self, data, url="Local:m.xml;{at:x};{size:x}"):
        self.put(Register.FIRST_URL, url.format(at=XML_AT, size=len(data)).encode() + b"\0")
        self.put(XML_AT, data)

    def serve(self):
        while self.running:
            try:
                data, source = self.socket.recvfrom(2048)
            except OSError:
                continue
            request = gvcp.decode_request(data)
            self.asked.append(request)
            for answer in self.trouble(request, Acknowledge(request.command, request.id, self.done(request))):
                if isinstance(answer, float):
                    time.sleep(answer)
                else:
                    self.socket.sendto(answer if isinstance(answer, bytes) else answer.encode(), source)

    def done(self, request):
        numbers = gvcp.words(request.body)
        if request.command == Command.READ_REGISTER:
            return bytes(self.memory[numbers[0] : numbers[0] + 4])
        if request.command == Command.READ_MEMORY:
            return request.body[:4] + bytes(self.memory[numbers[0] : numbers[0] + numbers[1]])
        self.put(numbers[0], request.body[4:])
        return (1).to_bytes(4, "big")

    def close(self):
        self.running = False
        self.thread.join()
        self.socket.close()


@pytest.fixture
def device(request):
    made = Memory(10 + sum(map(ord, request.node.name)) % 240)
    made.describe(XML.encode())
    yield made
    made.close()


@pytest.fixture
def control(device):
    made = Control("front", device.address)
    yield made
    made.close()


def test_a_lost_request_is_sent_again_with_its_id(device, control):
    device.put(0xA000, (77).to_bytes(4, "big"))
    device.trouble = lambda request, answer: [] if len(device.asked) < 3 else [answer]
    assert control.read(0xA000) == 77
    assert len({r.id for r in device.asked}) == 1 and len(device.asked) == 3


def test_late_foreign_and_malformed_answers_are_skipped(device, control):
    device.put(0xA000, (5).to_bytes(4, "big"))

    def trouble(request, answer):
        late = Acknowledge(request.command, (request.id - 1) & 0xFFFF, bytes(4))
        return [b"", b"\x00" * 5, b"\xff" * 40, late, Acknowledge(Command.WRITE_REGISTER, request.id, bytes(4)), answer]

    device.trouble = trouble
    assert control.read(0xA000) == 5


def test_pending_acknowledge_extends_the_timeout(device, control):
    device.put(0xA000, (9).to_bytes(4, "big"))
    pending = (600).to_bytes(4, "big")
    device.trouble = lambda request, answer: [Acknowledge(Command.PENDING, request.id, pending), 0.5, answer]
    assert control.read(0xA000) == 9 and len(device.asked) == 1


@pytest.mark.parametrize("status", [Status.WRITE_PROTECT, Status.INVALID_ADDRESS, 0x8FEE])
def test_refusal_names_its_status(device, control, status):
    device.trouble = lambda request, answer: [Acknowledge(request.command, request.id, b"", status)]
    word = "0x8fee" if status == 0x8FEE else Status(status).name.lower().replace("_", " ")
    with pytest.raises(DeviceError, match=rf"front: the device did not write 1 to register 0x00000a10 \({word}\)"):
        control.write(0x0A10, 1)
    with pytest.raises(DeviceError, match=word):
        control.read_memory(0, 8)


def test_silent_device_is_lost(device, control):
    device.trouble = lambda request, answer: []
    begun = time.monotonic()
    with pytest.raises(DeviceLost, match="nobody answers"):
        control.read(0xA000)
    assert time.monotonic() - begun < NOT_FOR_EVER


def test_memory_is_read_in_pieces(device, control):
    data = bytes(i % 251 for i in range(3001))
    device.put(0x8000, data)
    assert control.read_memory(0x8000, 3001) == data
    control.write_memory(0x9000, data[:1200])
    assert device.memory[0x9000 : 0x9000 + 1200] == data[:1200]


def test_control_withdrawn_by_the_device_is_lost(device, control):
    control.take(500)
    control.check()
    device.put(Register.CONTROL, bytes(4))
    end = time.monotonic() + NOT_FOR_EVER
    while not control.lost_reason and time.monotonic() < end:
        time.sleep(0.01)
    with pytest.raises(DeviceLost, match="gave up our control"):
        control.check()


def test_unreachable_address_is_lost():
    with pytest.raises(DeviceLost, match="can't be reached"):
        Control("front", "255.255.255.255")


@pytest.mark.parametrize("zipped", [False, True])
def test_the_description_comes_plain_or_zipped(device, control, zipped):
    if zipped:
        archive = io.BytesIO()
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
            file.writestr("m.xml", XML)
        device.describe(archive.getvalue(), "Local:m.zip;0x{at:x};{size:x}?SchemaVersion=1.1.0")
    nodes = Nodes(control)
    nodes.set("Gain", 12)
    assert nodes.get("Gain") == 12 and device.memory[0xA003] == 12
    nodes.set("Label", "left")
    assert nodes.get("Label") == "left" and bytes(device.memory[0xA010:0xA014]) == b"left"


@pytest.mark.parametrize(
    ("data", "url", "message"),
    [
        (b"x", "http://maker.example/m.xml", "need Local:name;address;size"),
        (b"x", "Local:m.xml;zz;10", "need Local:name;address;size"),
        (b"x", "Local:m.xml;10000;7fffffff", "found a description of 2147483647 bytes"),
        (b"PK no archive", "Local:m.zip;{at:x};{size:x}", "can't be read"),
        (b"\xff\xfe", "Local:m.xml;{at:x};{size:x}", "can't be read"),
        (b"<xml", "Local:m.xml;{at:x};{size:x}", "can't be understood"),
    ],
)
def test_wrong_description_raises_device_error(device, control, data, url, message):
    device.describe(data, url)
    with pytest.raises(DeviceError, match=message):
        Nodes(control)


def test_description_that_unpacks_too_large_is_refused(device, control):
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("m.xml", bytes(20 << 20))
    device.describe(archive.getvalue(), "Local:m.zip;{at:x};{size:x}")
    with pytest.raises(DeviceError, match="more than"):
        description(control)


def test_device_that_stops_answering_while_a_feature_is_read_is_lost(device, control):
    nodes = Nodes(control)
    device.trouble = lambda request, answer: []
    with pytest.raises(DeviceLost):
        nodes.get("Gain")


def test_without_genicam_the_message_says_what_to_do(control, monkeypatch):
    real = builtins.__import__

    def without(name, *more):
        if name.startswith("genicam"):
            raise ImportError(name)
        return real(name, *more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtra, match="pip install genicam"):
        Nodes(control)


def test_packets_from_other_addresses_are_ignored(device, control):
    stream = Stream(control)
    stream.start(Assembler(480, 136))
    port = stream._socket.getsockname()[1]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.42.5", 0))
        for _ in range(3):
            stranger.sendto(bytes(108), (control.host, port))
    device.socket.sendto(b"nonsense", (control.host, port))
    end = time.monotonic() + NOT_FOR_EVER
    while stream.statistics().malformed < 1 and time.monotonic() < end:
        time.sleep(0.005)
    stream.stop()
    assert (stream.statistics().foreign, stream.statistics().malformed) == (3, 1)
    assert stream.next_frame(0.0) is None
