"""The virtual sensor: its bytes, its registers, and libaravis' client, which nobody here wrote, talking to it."""

import os
import socket
import struct
import time

import numpy as np
import pytest

from aravis import AravisError, Client
from recorded import RecordedSource, Steady
from truestand.core.errors import BadRecipe, DeviceError
from truestand.devices.wire import gvcp, gvsp
from truestand.devices.wire.gvcp import Command, Register, Request, Resend, Status
from truestand.parts.drawings import Section, Turned
from truestand.sim import (
    Acquisition,
    Optics,
    Simulation,
    VirtualTurned,
    paper_shaft,
    paper_stand,
    simulate,
    truth_record,
)
from truestand.sim.live import scancontrol_frames as container
from truestand.sim.live.clock import Clock
from truestand.sim.live.faults import FaultKind, Faults, fault_at
from truestand.sim.live.genicam_xml import description
from truestand.sim.live.gige_device import Control, GigeDevice
from truestand.sim.live.profile_source import SimulatedSource
from truestand.sim.live.registers import (
    ENCODER_ACTIVE,
    EXTERNAL,
    TRIGGER_BY_ENCODER,
    DeviceRegister,
    Identity,
    RegisterError,
    Registers,
)
from truestand.sim.live.scancontrol_frames import FrameFormat, default_format, frame_bytes, raw_profiles, scale_of

NET = f"127.37.{os.getpid() % 250}"
"""Addresses of this process: the port is fixed, and tests run side by side."""
COUNTS = 36000
SPEED = 0.5


class TableDouble:
    def __init__(self):
        self.commands = []

    def stick_encoder(self):
        self.commands.append("stuck")

    def stall(self):
        self.commands.append("stalled")

    def release(self):
        self.commands.append("released")


def noise_frames(points=640, profiles=100):
    return np.random.default_rng(0).integers(1, 65535, (profiles, 3, points)).astype(np.uint16)


def device(last, source=None, faults=None, **more):
    source = source or RecordedSource(noise_frames(more.get("points", 640)), Steady(SPEED))
    return GigeDevice(Identity(f"{NET}.{last}", serial="V123"), source, Clock(), faults, **more)


def stamp_of(payload, profile, length):
    """Counter, opened, closed (s), encoder: the vendor's own arithmetic, byte by byte."""
    d = payload[(profile + 1) * length - 16 : (profile + 1) * length]

    def seconds(a, b, c, e):
        return (a >> 1) + ((a & 1) << 12 | b << 4 | c >> 4) / 8000 + ((c & 15) << 8 | e) / 24_576_000

    return d[1] << 16 | d[2] << 8 | d[3], seconds(*d[4:8]), seconds(*d[12:16]), (d[8] << 8 | d[9]) / 2


# Container


def test_a_frame_holds_mm_and_stamps_as_the_vendor_reads_them():
    shape = default_format(640, 3)
    assert shape.rearrangement == 1 << 20 | 2 | 1 | 1 << 10 | 1 << 11 | 1 << 17 | 9 << 12
    assert (shape.width, shape.points, shape.lines, shape.valid) == (1920, 640, 3, True)
    x = np.linspace(-20, 20, 640) * np.ones((3, 1))
    z = np.linspace(70, 120, 640) * np.ones((3, 1))
    z[1, 5] = np.nan
    opened = np.array([1.25, 127.9999, 129.5])
    frame = frame_bytes(
        raw_profiles(x, z, scale_of("29xx-50"), shape), shape, np.array([0, 16777215, 16777216]), opened,
        opened + 0.0005, np.array([0, 32767, -1]),
    )  # fmt: skip
    assert len(frame) == shape.frame_bytes == 3 * 3840
    for profile in range(3):
        line = frame[profile * 3840 : (profile + 1) * 3840]
        raw_z, raw_x = struct.unpack("<640H", line[:1280]), struct.unpack("<640H", line[1280:2560])
        for point in (0, 5, 639):
            if np.isnan(z[profile, point]):
                assert raw_z[point] == 0
            else:
                assert (raw_z[point] - 32768) * 0.002 + 95 == pytest.approx(z[profile, point], abs=0.00101)
                assert (raw_x[point] - 32768) * 0.002 == pytest.approx(x[profile, point], abs=0.00101)
        counter, begin, end, encoder = stamp_of(frame, profile, 3840)
        assert counter == (0, 16777215, 0)[profile]
        assert begin == pytest.approx(opened[profile] % 128, abs=1e-7)
        assert end == pytest.approx((opened[profile] + 0.0005) % 128, abs=1e-7)
        assert encoder == (0, 32767, 32767)[profile]


def test_other_rearrangements_and_those_that_do_not_fit():
    only_z = FrameFormat(1 << 20 | container.Z | container.STAMPED | 10 << 12, 1280, 2)
    assert only_z.valid
    z = np.full((2, 1280), 250.0)
    frame = frame_bytes(
        raw_profiles(z, z, scale_of("2910-100"), only_z), only_z, np.arange(2), np.zeros(2), np.zeros(2), np.arange(2)
    )
    assert len(frame) == 2 * 2560
    assert struct.unpack(">H", frame[:2]) == (32768,), "high byte first without the bit"
    for wrong in (
        FrameFormat(only_z.rearrangement, 640, 2),
        FrameFormat(only_z.rearrangement, 1280, 0),
        FrameFormat(only_z.rearrangement | container.X, 1280, 2),
        FrameFormat(0, 1280, 2),
        FrameFormat(only_z.rearrangement | container.EMPTY_FIELD, 1281, 2),
    ):
        assert not wrong.valid
    with pytest.raises(BadRecipe, match="29xx-50"):
        scale_of("gocator")


def test_readings_out_of_range_are_clipped_not_wrapped():
    shape = default_format(160, 1)
    x, z = np.full((1, 160), -200.0), np.full((1, 160), 400.0)
    raw = raw_profiles(x, z, scale_of("29xx-50"), shape)
    assert (raw[0, 0] == 65535).all()
    assert (raw[0, 1] == 1).all()


# Registers and control


def memory():
    return Registers(Identity("127.0.0.9", serial="S9", name="front"), description("scanCONTROL 2950-50"))


def test_bootstrap_registers_hold_identity_and_address_of_the_description():
    registers = memory()
    said = gvcp.identity_of(registers.read(0, gvcp.DISCOVERY_BYTES))
    assert said["model"] == "scanCONTROL 29xx-50"
    assert (said["serial"], said["name"], said["address"]) == ("S9", "front", "127.0.0.9")
    name, at, size = registers.read(Register.FIRST_URL, 512).split(b"\0")[0].decode().split(";")
    assert name.startswith("Local:")
    text = registers.read(int(at, 16), -(-int(size, 16) // 4) * 4)[: int(size, 16)]
    assert text == description("scanCONTROL 2950-50")


def test_registers_refuse_invalid_reads_and_writes():
    registers = memory()
    for address, value, status in (
        (Register.VERSION, 1, Status.WRITE_PROTECT),
        (DeviceRegister.PAYLOAD_SIZE, 1, Status.WRITE_PROTECT),
        (0x5000, 1, Status.INVALID_ADDRESS),
        (DeviceRegister.LASER, 3, Status.INVALID_PARAMETER),
        (DeviceRegister.EXPOSURE, 0, Status.INVALID_PARAMETER),
        (DeviceRegister.EXPOSURE, 5000, Status.INVALID_PARAMETER),
        (Register.HEARTBEAT, 10, Status.INVALID_PARAMETER),
    ):
        with pytest.raises(RegisterError) as refused:
            registers.write(address, value)
        assert refused.value.status is status
    with pytest.raises(RegisterError, match="BAD_ALIGNMENT"):
        registers.read(2, 4)
    registers.streaming = True
    with pytest.raises(RegisterError, match="BUSY"):
        registers.write(DeviceRegister.SIZE, 1920 << 16 | 5)


def test_size_register_sets_the_payload_and_packet_size_its_limits():
    registers = memory()
    registers.write(DeviceRegister.SIZE, 1920 << 16 | 7)
    assert registers.value(DeviceRegister.PAYLOAD_SIZE) == 1920 * 7 * 2
    registers.write(Register.STREAM_PACKET_SIZE, gvcp.DO_NOT_FRAGMENT | gvcp.FIRE_TEST | 9003)
    assert registers.value(Register.STREAM_PACKET_SIZE) == gvcp.DO_NOT_FRAGMENT | 9000
    registers.write(Register.STREAM_PACKET_SIZE, 65535)
    assert registers.value(Register.STREAM_PACKET_SIZE) == 16404


def ask(control, sender, command, body, number=1, now=0.0):
    data = control.answer(Request(command, number, body).encode(), sender, now)
    return gvcp.decode_acknowledge(data)


def test_control_has_one_owner_and_ends_with_its_heartbeat():
    ended, asked = [], []
    control = Control(memory(), ended.append, asked.append)
    me, other = ("127.0.0.1", 5000), ("127.0.0.1", 5001)
    take = gvcp.write_register_body((Register.CONTROL, gvcp.CONTROL))
    laser = gvcp.write_register_body((DeviceRegister.LASER, 2))
    read = gvcp.register_body(Register.CONTROL)
    assert ask(control, me, Command.WRITE_REGISTER, laser).status == Status.ACCESS_DENIED
    assert ask(control, me, Command.WRITE_REGISTER, take, 2).status == 0
    assert ask(control, other, Command.WRITE_REGISTER, take, 3).status == Status.ACCESS_DENIED
    assert ask(control, other, Command.WRITE_REGISTER, laser, 4).status == Status.ACCESS_DENIED
    assert gvcp.words(ask(control, other, Command.READ_REGISTER, read, 5).body) == (gvcp.CONTROL,)
    assert ask(control, me, Command.WRITE_REGISTER, laser, 6).status == 0
    exclusive = gvcp.write_register_body((Register.CONTROL, gvcp.EXCLUSIVE))
    assert ask(control, me, Command.WRITE_REGISTER, exclusive, 7).status == 0
    assert ask(control, other, Command.READ_REGISTER, read, 8).status == Status.ACCESS_DENIED
    assert ask(control, other, Command.DISCOVERY, b"", 9).status == 0
    control.answer(Resend(5, 1, 3).request(10).encode(), me, 2.9)
    assert asked == [Resend(5, 1, 3)]
    control.expire(5.8)
    assert not ended
    control.expire(6.0)
    assert ended == [True]
    assert control.registers.value(Register.CONTROL) == 0
    ask(control, other, Command.WRITE_REGISTER, take, 11)
    ask(control, other, Command.WRITE_REGISTER, gvcp.write_register_body((Register.CONTROL, 0)), 12)
    assert ended == [True, False]


def test_repeated_write_is_done_once_and_malformed_requests_are_ignored():
    control = Control(memory(), lambda silent: None, lambda asked: None)
    me, done = ("127.0.0.1", 5000), []
    ask(control, me, Command.WRITE_REGISTER, gvcp.write_register_body((Register.CONTROL, gvcp.CONTROL)))
    control.registers.on_write[DeviceRegister.ACQUISITION_START] = done.append
    start = Request(
        Command.WRITE_REGISTER, 77, gvcp.write_register_body((DeviceRegister.ACQUISITION_START, 1))
    ).encode()
    assert control.answer(start, me, 0.0) == control.answer(start, me, 0.0)
    assert done == [1]
    for data in (b"", b"\x42", bytes(8), start[:10], b"\x42\x01\x00\x40\x00\x00\x00\x01"):
        assert control.answer(data, me, 0.0) is None
    assert ask(control, me, 0x00F0, b"").status == Status.NOT_IMPLEMENTED
    for body in (b"", bytes(8), struct.pack(">IHH", 0, 0, 2048), struct.pack(">IHH", 1, 0, 4)):
        assert ask(control, me, Command.READ_MEMORY, body).status != 0
    for body in (b"", bytes(4), bytes(12)):
        assert ask(control, me, Command.WRITE_REGISTER, body, 78).status in (Status.INVALID_PARAMETER, 0, 0x8004)
    assert ask(control, me, Command.WRITE_MEMORY, struct.pack(">II", Register.CONTROL, 0), 79).status != 0
    named = ask(control, me, Command.WRITE_MEMORY, struct.pack(">I16s", Register.USER_NAME, b"left"), 80)
    assert named.status == 0
    assert gvcp.text_at(control.registers.read(0, 248), Register.USER_NAME) == "left"


def test_the_genicam_wheel_reads_and_writes_the_description():
    genapi = pytest.importorskip("genicam.genapi", reason="needs the genicam wheel")
    registers = memory()

    class Port(genapi.AbstractPort):
        def read(self, address, length):
            return registers.read(address, length)

        def write(self, address, data):
            registers.write_memory(address, bytes(data))

        def get_access_mode(self):
            return genapi.EAccessMode.RW

    nodes, port = genapi.NodeMap(), Port()
    nodes.load_xml_from_string(description("29xx-50").decode())
    nodes.connect(port, "Device")
    numbers = (genapi.EInterfaceType.intfIInteger, genapi.EInterfaceType.intfIFloat)
    for feature in nodes.Root.features:
        if feature.node.principal_interface_type in numbers:
            assert feature.value >= 0, feature.node.name
    assert nodes.DeviceVendorName.value == "truestand (virtual)"
    assert (nodes.Width.value, nodes.Height.value, nodes.PixelFormat.value) == (1920, 20, "Mono16")
    nodes.ExposureTime.value = 50.0
    nodes.ProfileRate.value = 1000.0
    assert registers.timing == pytest.approx((50e-6, 950e-6))
    assert nodes.AcquisitionFrameRate.value == 50.0
    nodes.LaserPower.value = "Full"
    nodes.TransmissionType.value = "TypeContainer"
    nodes.Height.value = 10
    assert registers.value(DeviceRegister.LASER) == 2
    assert nodes.PayloadSize.value == 38400
    assert set(nodes.VirtualFault.symbolics) >= {"None", "LosePackets", "Frozen", "StalledTable"}
    assert nodes.VirtualMounted.symbolics == ("Shaft", "Part")


# Sources and faults


def test_simulated_source_equals_a_scan_at_the_same_angles():
    optics = Optics(noise=0.0)
    stand, simulation = paper_stand(), Simulation(optics=optics, acquisition=Acquisition(profiles=50))
    made = simulate(stand, simulation, paper_shaft())
    source = SimulatedSource(stand, simulation, paper_shaft(), Steady(SPEED), scale_of("29xx-50"))
    x, z, counts = source.readings(made.truth.angle / SPEED)
    assert np.array_equal(z, made.recording.z, equal_nan=True)
    assert np.array_equal(np.where(np.isnan(z), np.nan, x), made.recording.x, equal_nan=True)
    assert np.array_equal(counts, np.rint(made.truth.angle / (2 * np.pi) * COUNTS))
    dark, _ = source.profiles(np.arange(3.0), default_format(640, 3), lit=False)
    assert not dark.any()
    half, _ = source.profiles(np.arange(3.0), default_format(320, 3), lit=True)
    assert half.shape == (3, 3, 320)
    assert half.any()
    wide, _ = source.profiles(np.arange(3.0), default_format(1280, 3), lit=True)
    assert not wide[:, :, 640:].any()
    with pytest.raises(BadRecipe, match="no part"):
        source.mount(True)


def test_truth_and_mounted_part():
    part = VirtualTurned(Turned((Section("ring", -20.0, -10.0, 30.0),), "ring"))
    source = SimulatedSource(paper_stand(), Simulation(), paper_shaft(), Steady(SPEED), scale_of("29xx-50"), part)
    alone = source.readings(np.zeros(1))[1]
    source.mount(True)
    assert source.part_mounted
    assert not np.allclose(alone, source.readings(np.zeros(1))[1], equal_nan=True, atol=0.1)
    assert truth_record(source.truth(False))["shaft"]["eccentricity_um"] == pytest.approx(878.9)
    assert "part" not in truth_record(source.truth(False))
    assert "part" in truth_record(source.truth(True))


def test_faults_begin_and_end():
    table = TableDouble()
    faults = Faults(table)
    faults.begin(FaultKind.LOSE_PACKETS, 0.5)
    faults.begin(FaultKind.STUCK_ENCODER)
    assert FaultKind.LOSE_PACKETS in faults
    assert faults.latest is FaultKind.STUCK_ENCODER
    faults.begin(FaultKind.STALLED_TABLE)
    faults.begin(FaultKind.NONE)
    assert (faults.latest, table.commands) == (FaultKind.NONE, ["stuck", "stalled", "released"])
    with pytest.raises(BadRecipe, match="share"):
        faults.begin(FaultKind.LOSE_PACKETS, 2.0)
    with pytest.raises(BadRecipe, match="table"):
        Faults().begin(FaultKind.STALLED_TABLE)
    assert fault_at("lose-packets:0.1@5") == (FaultKind.LOSE_PACKETS, 0.1, 5.0)
    assert fault_at("unplugged@2.5") == (FaultKind.UNPLUGGED, None, 2.5)
    for wrong in ("unplug@2", "unplugged@x", "latency:much@1", ""):
        with pytest.raises(BadRecipe, match="KIND@SECONDS"):
            fault_at(wrong)


# The device, by plain sockets


class Plain:
    """A controller of few words: registers and raw packets."""

    def __init__(self, address):
        self.to = (address, gvcp.PORT)
        self.control, self.stream = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        for one in (self.control, self.stream):
            one.bind(("127.0.0.1", 0))
            one.settimeout(1.0)
        self.stream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_000_000)
        self.number = 0

    def ask(self, command, body):
        self.number += 1
        self.control.sendto(Request(command, self.number, body).encode(), self.to)
        return gvcp.decode_acknowledge(self.control.recv(2048))

    def write(self, address, value):
        return self.ask(Command.WRITE_REGISTER, gvcp.write_register_body((address, value))).status

    def read(self, address):
        return gvcp.words(self.ask(Command.READ_REGISTER, gvcp.register_body(address)).body)[0]

    def begin(self, exposure=100, idle=400):
        for address, value in (
            (Register.CONTROL, gvcp.CONTROL),
            (DeviceRegister.TRANSMISSION, 1),
            (DeviceRegister.LASER, 2),
            (DeviceRegister.MAINTENANCE, ENCODER_ACTIVE),
            (DeviceRegister.EXPOSURE, exposure),
            (DeviceRegister.IDLE, idle),
            (Register.STREAM_PACKET_SIZE, 9000),
            (Register.STREAM_ADDRESS, 0x7F000001),
            (Register.STREAM_PORT, self.stream.getsockname()[1]),
            (DeviceRegister.ACQUISITION_START, 1),
        ):
            assert self.write(address, value) == 0, hex(address)

    def packets(self, count):
        """(header, data) of the next packets."""
        found = []
        for _ in range(count):
            data = self.stream.recv(65536)
            header = gvsp.decode_header(data)
            found.append((header, data[gvsp.HEADER :]))
        return found

    def frames(self, count, packets=11):
        """Payloads of frames of which everything arrives, in order of packets."""
        payloads = {}
        for header, data in self.packets(count * packets):
            if header.kind == gvsp.PacketFormat.PAYLOAD:
                payloads.setdefault(header.block, {})[header.packet] = data
        return [b"".join(data for _, data in sorted(parts.items())) for parts in payloads.values()]

    def close(self):
        self.control.close()
        self.stream.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def test_it_streams_stamped_frames_in_time_and_stops():
    with device(1) as virtual, Plain(f"{NET}.1") as plain:
        assert gvcp.identity_of(plain.ask(Command.DISCOVERY, b"").body)["serial"] == "V123"
        began = time.monotonic()
        plain.begin(exposure=10, idle=40)  # 2,000 profiles/s, 100 frames/s
        packets = plain.packets(110)
        took = time.monotonic() - began
        assert plain.write(DeviceRegister.SIZE, 1920 << 16 | 5) == Status.BUSY
        assert plain.write(DeviceRegister.ACQUISITION_STOP, 1) == 0
        assert not virtual.registers.streaming
        first = [header for header, _ in packets[:11]]
        assert [h.kind for h in first] == [1, *[3] * 9, 2]
        assert [h.packet for h in first] == list(range(11))
        assert [h.block for h, _ in packets[::11]] == list(range(1, 11))
        leader = gvsp.decode_leader(packets[0][1])
        assert (leader.width, leader.height, leader.payload_bytes) == (1920, 20, 76800)
        payload = b"".join(data for header, data in packets if header.kind == 3)
        stamps = np.array([stamp_of(payload, k, 3840) for k in range(200)])
        assert np.array_equal(stamps[:, 0], np.arange(200))
        assert np.allclose(np.diff(stamps[:, 1]), 0.0005, atol=1e-7)
        assert np.allclose(stamps[:, 2] - stamps[:, 1], 0.0001, atol=1e-7)
        middle = stamps[:, 2] - 0.00005 - virtual._power_on
        assert np.allclose(stamps[:, 3], np.rint(SPEED * middle / (2 * np.pi) * COUNTS), atol=1)
        assert took == pytest.approx(0.1, abs=0.2)
        plain.begin()
        later = plain.frames(1)[0]
        assert stamp_of(later, 0, 3840)[0] >= 200, "the sensor's counter goes on from stream to stream"


def test_start_is_refused_with_inconsistent_settings():
    with device(2) as virtual, Plain(f"{NET}.2") as plain:
        plain.write(Register.CONTROL, gvcp.CONTROL)
        assert plain.write(DeviceRegister.ACQUISITION_START, 1) == Status.INVALID_PARAMETER, (
            "the sensor wakes up in another mode"
        )
        plain.write(DeviceRegister.TRANSMISSION, 1)
        plain.write(DeviceRegister.SIZE, 1280 << 16 | 5)
        assert plain.write(DeviceRegister.ACQUISITION_START, 1) == Status.INVALID_PARAMETER
        assert not virtual.registers.streaming
        assert plain.write(DeviceRegister.MOUNTED, 1) == 0
        assert plain.write(DeviceRegister.FAULT, 10) == Status.INVALID_PARAMETER, "no table here"
        assert plain.write(DeviceRegister.FAULT, 99) == Status.INVALID_PARAMETER
        with pytest.raises(DeviceError, match=f"{NET}.2:3956"):
            device(2).start()


def test_missing_heartbeat_ends_control_and_stream_and_switches_the_laser_off():
    with device(3) as virtual, Plain(f"{NET}.3") as plain:
        plain.begin()
        plain.write(Register.HEARTBEAT, 500)
        assert (virtual.laser, virtual.registers.streaming, virtual.controlled) == (2, True, True)
        time.sleep(0.7)
        assert (virtual.laser, virtual.registers.streaming, virtual.controlled) == (0, False, False)


def test_frozen_and_garbage_frames():
    faults = Faults()
    with device(4, faults=faults), Plain(f"{NET}.4") as plain:
        plain.begin(exposure=10, idle=40)
        faults.begin(FaultKind.FROZEN)
        plain.frames(2)
        frozen = plain.frames(3)
        assert frozen[0] == frozen[1] == frozen[2]
        faults.clear()
        plain.frames(2)
        faults.begin(FaultKind.GARBAGE)
        plain.frames(2)
        counters = [stamp_of(frame, 0, 3840)[0] for frame in plain.frames(3)]
        assert np.any(np.diff(counters) != 20)


def test_packets_out_of_order_and_twice():
    faults = Faults()
    faults.begin(FaultKind.DISORDER)
    with device(7, faults=faults), Plain(f"{NET}.7") as plain:
        plain.begin(exposure=10, idle=40)
        headers = [(h.block, h.packet) for h, _ in plain.packets(60)]
        assert headers != sorted(headers)
        assert len(set(headers)) < len(headers)


def test_latency_by_the_node():
    with device(8), Plain(f"{NET}.8") as plain:
        plain.write(Register.CONTROL, gvcp.CONTROL)
        plain.write(DeviceRegister.LATENCY, 300)
        plain.write(DeviceRegister.FAULT, FaultKind.LATENCY)
        assert plain.read(DeviceRegister.FAULT) == FaultKind.LATENCY
        plain.begin(exposure=10, idle=40)
        began = time.monotonic()
        plain.packets(1)
        assert time.monotonic() - began > 0.25


def test_unplugged_device_is_silent_and_ignored_heartbeats_end_control():
    faults = Faults()
    with device(9, faults=faults) as virtual, Plain(f"{NET}.9") as plain:
        plain.begin()
        plain.write(Register.HEARTBEAT, 1000)
        plain.control.settimeout(0.3)
        faults.begin(FaultKind.UNPLUGGED)
        with pytest.raises(TimeoutError):
            plain.read(DeviceRegister.FAULT)
        faults.clear()
        assert plain.read(DeviceRegister.LASER) == 2
        faults.begin(FaultKind.HEARTBEAT_IGNORED)
        with pytest.raises(TimeoutError):
            plain.read(DeviceRegister.FAULT)
        assert virtual.registers.streaming
        time.sleep(1.0)
        assert (virtual.registers.streaming, virtual.controlled, virtual.laser) == (False, False, 0)


def test_packets_are_sent_again_or_reported_unavailable():
    with device(5) as virtual, Plain(f"{NET}.5") as plain:
        plain.begin()
        payload = plain.frames(1)[0]
        plain.write(DeviceRegister.ACQUISITION_STOP, 1)
        plain.control.sendto(Resend(1, 2, 3).request(500).encode(), plain.to)
        again = plain.packets(2)
        assert [h.packet for h, _ in again] == [2, 3]
        size = gvsp.data_bytes(9000)
        assert again[0][1] + again[1][1] == payload[size : 3 * size]
        plain.control.sendto(Resend(1, 10, 0xFFFFFF).request(501).encode(), plain.to)
        assert [h.kind for h, _ in plain.packets(1)] == [gvsp.PacketFormat.TRAILER]
        plain.control.sendto(Resend(4000, 1, 3).request(502).encode(), plain.to)
        assert plain.packets(1)[0][0].status == Status.PACKET_UNAVAILABLE
        assert virtual.channel.resent == 3


def test_clock_waits_for_slow_profile_sources():
    class Slow(RecordedSource):
        def profiles(self, times, shape, lit):
            time.sleep(0.0025 * times.size)
            return super().profiles(times, shape, lit)

    with device(6, Slow(noise_frames(), Steady(SPEED))) as virtual, Plain(f"{NET}.6") as plain:
        plain.begin(exposure=10, idle=40)  # 100 frames/s of which 20 can be drawn
        began, shown = time.monotonic(), virtual.clock.now()
        plain.frames(10)
        assert virtual.clock.now() - shown < 0.5 * (time.monotonic() - began)
        plain.write(DeviceRegister.ACQUISITION_STOP, 1)
        shown = virtual.clock.now()
        time.sleep(0.1)
        assert virtual.clock.now() - shown > 0.09


def test_encoder_trigger_exposes_at_steps_and_waits_at_rest():
    table = Steady(0.0)
    with device(10, RecordedSource(noise_frames(), table, 720)) as virtual, Plain(f"{NET}.10") as plain:
        plain.write(Register.CONTROL, gvcp.CONTROL)
        plain.write(DeviceRegister.SIZE, 1920 << 16 | 4)
        plain.write(DeviceRegister.TRIGGER, EXTERNAL | TRIGGER_BY_ENCODER)
        plain.begin()
        plain.stream.settimeout(0.3)
        with pytest.raises(TimeoutError):
            plain.packets(1)
        table.speed = 1.0  # 115 steps a second, slower than the sensor could
        plain.stream.settimeout(1.0)
        stamps = [stamp_of(frame, k, 3840) for frame in plain.frames(5, packets=4) for k in range(4)]
        assert np.array_equal(np.diff([s[3] for s in stamps[1:]]), np.ones(18))
        assert np.allclose(np.diff([s[1] for s in stamps[1:]]), 2 * np.pi / 720, atol=5e-5)
        assert virtual.registers.streaming


# libaravis


@pytest.mark.parametrize(("last", "rate", "packet"), [(11, 200, 1500), (12, 10_000, 9000)])
def test_aravis_receives_every_frame(last, rate, packet):
    with device(last) as virtual, Client(f"{NET}.{last}") as client:
        client.text("TransmissionType", "TypeContainer")
        client.number("ExposureTime", 40.0)
        client.integer("GevSCPSPacketSize", packet)
        client.start(200)
        frames = [client.frame()]  # with the first one the library makes its socket's buffer as large as asked
        assert client.number("ProfileRate", float(rate)) == rate
        frames += [client.frame() for _ in range(rate * 2 // 20)]
        client.command("AcquisitionStop")
        assert all(frame is not None and frame[0] == 0 for frame in frames)
        assert [frame[1] for frame in frames] == list(range(1, len(frames) + 1))
        counters = [stamp_of(frame[2], k, 3840)[0] for frame in frames for k in range(20)]
        assert np.array_equal(counters, np.arange(len(counters)))
        time.sleep(0.2)
        assert client.statistics()[:3] == (virtual.channel.frames, 0, 0)


def test_aravis_reads_and_writes_nodes():
    with device(13), Client(f"{NET}.13") as client:
        assert client.text("DeviceVendorName") == "truestand (virtual)"
        assert client.text("DeviceModelName") == "scanCONTROL 29xx-50"
        assert client.text("DeviceUserID", "left") == "left"
        assert client.integer("PayloadSize") == 76800
        assert client.integer("Height", 10) == 10
        assert client.integer("PayloadSize") == 38400
        assert client.number("ExposureTime", 250.0) == 250.0
        assert client.number("ProfileRate", 500.0) == 500.0
        assert client.number("AcquisitionFrameRate") == 50.0
        assert client.text("LaserPower", "Reduced") == "Reduced"
        assert client.register(DeviceRegister.LASER) == 1
        assert client.register(DeviceRegister.EXPOSURE, 33) == 33
        assert client.number("ExposureTime") == 330.0
        assert client.text("VirtualFault") == "None"
        assert client.integer("GevSCPSPacketSize", 9000) == 9000
        assert client.call("arv_gv_device_auto_packet_size") >= 16400, "test packets are fired"
        assert client.call("arv_gv_device_get_timestamp_tick_frequency") == 1_000_000_000
        client.command("GevTimestampControlLatch")
        first = client.integer("GevTimestampValue")
        client.command("GevTimestampControlLatch")
        assert 0 < client.integer("GevTimestampValue") - first < 1_000_000_000
        with pytest.raises(AravisError):
            client.register(DeviceRegister.LASER, 7)
        with pytest.raises(AravisError, match="denied"), Client(f"{NET}.13") as second:
            second.call("arv_gv_device_take_control")


def test_aravis_gets_lost_packets_again():
    with device(14) as virtual, Client(f"{NET}.14") as client:
        client.text("TransmissionType", "TypeContainer")
        client.number("ExposureTime", 100.0)
        client.number("ProfileRate", 1000.0)
        client.text("VirtualFault", "LosePackets")
        assert virtual.faults.strength(FaultKind.LOSE_PACKETS) == 0.02
        client.start()
        frames = [client.frame() for _ in range(100)]
        client.command("AcquisitionStop")
        assert all(frame is not None and frame[0] == 0 for frame in frames)
        counters = [stamp_of(frame[2], k, 3840)[0] for frame in frames for k in range(20)]
        assert np.array_equal(counters, np.arange(len(counters)))
        assert virtual.channel.resent > 20
