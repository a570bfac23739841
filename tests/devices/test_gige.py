"""Frames out of packets, by bytes: what is lost, late, twice, out of order or garbage never makes a wrong frame."""

from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truestand.devices.gige.assembly import (
    FRAME_END_TIMEOUT_S,
    GAP_TIMEOUT_S,
    GAP_TIMEOUT_WITHOUT_RESEND_S,
    MAX_OPEN_FRAMES,
    RESEND_DELAY_S,
    Assembler,
)
from truestand.devices.wire import grbl, gvcp, gvsp, zaber
from truestand.devices.wire.gvsp import Header, Leader, PacketFormat, PixelFormat
from truestand.devices.wire.malformed import Malformed

PACKET_SIZE = 136  # 100 bytes of data in a packet with standard ids
WIDTH, ROWS = 60, 4
PAYLOAD = 2 * WIDTH * ROWS  # 480 bytes: 4 packets of 100 and one of 80


def content(block):
    return bytes((block * 7 + i * 13) % 251 + 1 for i in range(PAYLOAD))


def packets(block, extended=False, data=None):
    """Leader, data, trailer of one frame."""
    data = content(block) if data is None else data
    chunk = gvsp.data_bytes(PACKET_SIZE, extended)
    pieces = [data[i : i + chunk] for i in range(0, len(data), chunk)]

    def packet(number, kind, body):
        return Header(block, number, kind, extended=extended).encode() + body

    leader = packet(0, PacketFormat.LEADER, Leader(1, PixelFormat.MONO16, WIDTH, ROWS).encode())
    middle = [packet(i, PacketFormat.PAYLOAD, piece) for i, piece in enumerate(pieces, 1)]
    return [leader, *middle, packet(len(pieces) + 1, PacketFormat.TRAILER, gvsp.encode_trailer(ROWS))]


class Bench:
    """An assembler that is fed by hand, with a clock of its own."""

    def __init__(self, **options):
        self.assembler = Assembler(PAYLOAD, PACKET_SIZE, **{"row": 2 * WIDTH, **options})
        self.now = 0.0
        self.frames, self.requests = [], []

    def feed(self, *sent):
        for packet in sent:
            self.assembler.packet[: len(packet)] = packet
            self.assembler.take(len(packet), self.now)
        self._collect()
        return self

    def wait(self, seconds):
        end = self.now + seconds
        while self.now < end:
            self.now += 0.002
            self.requests += self.assembler.tick(self.now)
        self._collect()
        return self

    def _collect(self):
        self.frames += self.assembler.frames
        self.assembler.frames.clear()

    @property
    def numbers(self):
        return [frame.number for frame in self.frames]

    @property
    def statistics(self):
        return self.assembler.statistics()


@pytest.mark.parametrize("extended", [False, True])
def test_frames_come_out_as_they_were_sent(extended):
    bench = Bench()
    for block in (1, 2, 3):
        bench.feed(*packets(block, extended))
    assert [frame.payload for frame in bench.frames] == [content(b) for b in (1, 2, 3)]
    assert bench.numbers == [0, 1, 2] and all(not frame.missing for frame in bench.frames)
    found = bench.statistics
    assert (found.frames, found.lost, found.incomplete, found.duplicates, found.malformed) == (3, 0, 0, 0, 0)


def test_lost_packet_is_requested_again_and_its_frame_waits():
    leader, *data, trailer = packets(1)
    bench = Bench().feed(leader, data[0], *data[2:4], data[4], trailer, *packets(2))
    assert not bench.frames
    bench.wait(2 * RESEND_DELAY_S)
    assert [(r.block, r.first, r.last) for r in bench.requests] == [(1, 2, 2)]
    bench.feed(data[1])
    assert bench.numbers == [0, 1] and bench.frames[0].payload == content(1)
    assert bench.statistics.resent == 1 and bench.statistics.incomplete == 0


def test_missing_packets_are_reported_and_their_profiles_are_zeroed():
    leader, *data, trailer = packets(1)
    bench = Bench().feed(leader, data[0], *data[2:], trailer, *packets(2)).wait(2 * GAP_TIMEOUT_S)
    first, second = bench.frames
    row = 2 * WIDTH
    assert first.missing == 100 and not second.missing
    assert first.payload == bytes(2 * row) + content(1)[2 * row :], "packet 2 touches the profiles 1 and 2"
    assert bench.statistics.incomplete == 1 and len(bench.requests) > 2, "asked again and again"


def test_lost_frames_leave_gaps_in_the_numbers():
    bench = Bench().feed(*packets(1), *packets(4)).wait(2 * GAP_TIMEOUT_S)
    assert bench.numbers == [0, 3] and bench.statistics.lost == 2
    assert {(r.block, r.first, r.last) for r in bench.requests} == {(2, 1, 5), (3, 1, 5)}, "they too are asked for"
    bench.feed(*packets(5))
    assert bench.numbers == [0, 3, 4]


def test_many_lost_frames_are_counted_without_waiting_for_all():
    bench = Bench().feed(*packets(1), *packets(1001)).wait(2 * GAP_TIMEOUT_S)
    assert bench.numbers == [0, 1000] and bench.statistics.lost == 999
    assert len({r.block for r in bench.requests}) < MAX_OPEN_FRAMES


def test_last_packets_of_the_newest_frame_are_requested_after_a_timeout():
    leader, *data, _ = packets(1)
    bench = Bench().feed(leader, *data[:3]).wait(FRAME_END_TIMEOUT_S / 2)
    assert not bench.requests
    bench.wait(FRAME_END_TIMEOUT_S)
    assert (bench.requests[0].first, bench.requests[0].last) == (4, 5)
    bench.wait(GAP_TIMEOUT_S)
    assert bench.frames[0].missing == 180


def test_unavailable_packet_ends_the_wait():
    leader, *data, trailer = packets(1)
    bench = Bench().feed(leader, *data[1:], trailer).wait(2 * RESEND_DELAY_S)
    bench.feed(Header(1, 1, PacketFormat.PAYLOAD, status=0x800C).encode()).wait(RESEND_DELAY_S)
    assert bench.frames[0].missing == 100 and bench.now < GAP_TIMEOUT_S


def test_without_resend_no_packet_is_requested_and_the_wait_is_short():
    leader, *data, trailer = packets(1)
    bench = Bench(resend=False).feed(leader, *data[1:], trailer).wait(2 * GAP_TIMEOUT_WITHOUT_RESEND_S)
    assert not bench.requests and bench.frames[0].missing == 100


def test_duplicates_and_late_packets_are_counted_and_harmless():
    leader, *data, trailer = packets(1)
    bench = Bench().feed(leader, data[0], data[0], *data[1:], trailer, data[3], *packets(2))
    assert bench.numbers == [0, 1] and bench.statistics.duplicates == 2


@pytest.mark.parametrize("order", [[6, 5, 4, 3, 2, 1, 0], [0, 2, 1, 4, 3, 5, 6], [3, 0, 5, 1, 6, 2, 4]])
def test_the_order_within_a_frame_does_not_matter(order):
    sent = packets(1)
    bench = Bench().feed(*(sent[i] for i in order))
    assert bench.frames[0].payload == content(1) and bench.statistics.malformed == 0


@pytest.mark.parametrize(("last", "wires"), [(65535, [65534, 65535, 1, 2]), (65536, [65534, 65535, 0, 1, 2])])
def test_block_ids_start_again_and_the_number_goes_on(last, wires):
    bench = Bench()
    for wire in wires:
        bench.feed(*packets(wire))
    assert bench.numbers == list(range(len(wires)))


def test_loss_across_the_wrap_of_block_ids_is_counted():
    bench = Bench().feed(*packets(65534), *packets(2)).wait(2 * GAP_TIMEOUT_S)
    assert bench.numbers == [0, 3] and bench.statistics.lost == 2
    assert {r.block for r in bench.requests} == {65535, 1}


def test_garbage_and_frames_of_another_size_are_counted_and_not_used():
    bench = Bench().feed(*packets(1)[:3])
    leader = Header(2, 0, PacketFormat.LEADER).encode() + Leader(1, PixelFormat.MONO16, WIDTH, 2 * ROWS).encode()
    wrong = (
        b"", b"\x00" * 7, b"\xff" * 300, leader, packets(1)[4][:-1], packets(1)[4] + b"x", packets(1, extended=True)[3],
        Header(1, 9, PacketFormat.PAYLOAD).encode() + bytes(100), Header(1, 3, 5).encode() + bytes(100),
        Header(2, 0, PacketFormat.LEADER).encode() + bytes(12),
    )  # fmt: skip
    bench.feed(*wrong, *packets(1)[3:])
    assert bench.frames[0].payload == content(1) and bench.numbers == [0]
    assert bench.statistics.malformed == len(wrong)


DECODERS = (gvcp.decode_acknowledge, gvcp.decode_request, gvsp.decode_header, zaber.decode_reply, grbl.decode_line)


@pytest.mark.parametrize("decode", DECODERS)
def test_what_is_no_message_is_malformed_in_every_protocol(decode):
    with pytest.raises(Malformed):
        decode(b"<")


def test_flush_closes_incomplete_frames():
    bench = Bench().feed(*packets(1), *packets(2)[:3])
    bench.assembler.flush(bench.now)
    bench.feed()
    assert [frame.missing for frame in bench.frames] == [0, 280]


sent_packets = st.lists(
    st.tuples(st.integers(1, 6), st.integers(0, 6)) | st.binary(min_size=0, max_size=140) | st.just("tick"),
    min_size=0,
    max_size=120,
)


@given(sent_packets, st.booleans())
@settings(max_examples=300, deadline=None)
def test_frame_called_complete_equals_the_one_sent(arriving, extended):
    """Any order, loss, repetition, with garbage between."""
    wires = {i: (65533 + i - 1) % 65535 + 1 for i in range(1, 7)}
    frames = {i: packets(wires[i], extended) for i in wires}
    bench = Bench().feed(frames[1][0])
    for item in arriving:
        if item == "tick":
            bench.wait(0.03)
        elif isinstance(item, bytes):
            bench.feed(item)
        else:
            sent = frames[item[0]]
            bench.feed(sent[item[1] % len(sent)])
    bench.assembler.flush(bench.now)
    bench.feed()
    assert bench.numbers == sorted(set(bench.numbers))
    sendable = Counter(content(wire) for wire in wires.values())
    for frame in bench.frames:
        assert len(frame.payload) == PAYLOAD
        assert (frame.payload in sendable) == (frame.missing == 0)
    if bench.frames:
        steps = bench.numbers[-1] + 1 - len(bench.numbers)
        assert bench.statistics.lost >= steps, "what was lost is never less than what the numbers say"
        assert bench.statistics.frames == len(bench.frames)
