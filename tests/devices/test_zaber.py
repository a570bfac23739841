"""The Zaber codec by bytes written out by hand and by bytes that Zaber's own library sent; and odd answers."""

import os
import random
from contextlib import suppress
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tables import listener, on_virtual_time, served, table_at
from truestand.core.errors import DeviceError
from truestand.devices.tables import TableRecipe, open_table
from truestand.devices.wire.malformed import Malformed
from truestand.devices.wire.zaber import Command, Reply, decode_command, decode_reply

SENT = [  # by zaber-motion 10.2
    (b"/0 0 00:00\n", Command("", 0, 0, 0)),
    (b"/1 0 02 get deviceid:40\n", Command("get deviceid", 1, 0, 2)),
    (b"/1 1 24 move abs 100000:8A\n", Command("move abs 100000", 1, 1, 24)),
    (b"/1 1 29 move rel -3000:A9\n", Command("move rel -3000", 1, 1, 29)),
    (b"/1 1 99 warnings clear:3C\n", Command("warnings clear", 1, 1, 99)),
]
READ = [
    (b"@01 0 OK IDLE -- 0\r\n", Reply(1)),
    (b"@01 1 24 OK BUSY WR 0:92\r\n", Reply(1, 1, 24, True, True, "WR", "0")),
    (b"@02 1 RJ IDLE -- BADDATA\r\n", Reply(2, 1, None, False, False, "--", "BADDATA")),
    (b"@01 1 05 OK IDLE WR 01 WR\r\n", Reply(1, 1, 5, True, False, "WR", "01 WR")),
    (b"!01 1 IDLE --\r\n", None),
    (b"#01 0 05 Visit www.zaber.com for help", None),
]


@pytest.mark.parametrize(("line", "command"), SENT)
def test_commands_as_zabers_library_sends_them(line, command):
    assert decode_command(line) == command
    assert command.encode() == line


@pytest.mark.parametrize(("line", "message"), READ)
def test_replies_as_the_manual_writes_them(line, message):
    assert decode_reply(line) == message


@pytest.mark.parametrize(
    ("line", "command"),
    [
        (b"/", Command()),
        (b"/get pos\r", Command("get pos")),
        (b"/1 home\n", Command("home", 1)),
        (b"/1 2 home\n", Command("home", 1, 2)),
        (b"/ 01 02 3 home\n", Command("home", 1, 2, 3)),
    ],
)
def test_optional_parts_of_a_command_may_be_left_out(line, command):
    assert decode_command(line) == command


@pytest.mark.parametrize(
    "line",
    [
        b"", b"@", b"@1 0 OK IDLE -- 0", b"@01 0 OK IDLE", b"ok", b"@01 0 IDLE -- 0", b"!01 0 OK IDLE --",
        b"@01 0 OK AWAY -- 0",
        b"@01 1 24 OK BUSY WR 0:93", b"\xff\xfe", b"<Idle|MPos:0.000>",
    ],
)  # fmt: skip
def test_what_is_no_reply_is_malformed(line):
    with pytest.raises(Malformed):
        decode_reply(line)


@pytest.mark.parametrize("line", [b"", b"home", b"/1 home:00", b"/1 h\xe9"])
def test_what_is_no_command_is_malformed(line):
    with pytest.raises(Malformed):
        decode_command(line)


WORDS = st.from_regex(r"[a-z][a-z0-9. -]{0,30}[a-z0-9]", fullmatch=True)


@given(WORDS, st.integers(0, 99), st.integers(0, 9), st.none() | st.integers(0, 99))
def test_a_command_comes_back(text, device, axis, number):
    command = Command(text, device, axis, number)
    assert decode_command(command.encode()) == command


@given(
    st.integers(0, 99), st.integers(0, 9), st.none() | st.integers(0, 99), st.booleans(), st.booleans(),
    st.sampled_from(["--", "WR", "FS"]), WORDS, st.booleans(),
)  # fmt: skip
def test_a_reply_comes_back(device, axis, number, accepted, busy, warning, data, summed):
    reply = Reply(device, axis, number, accepted, busy, warning, data)
    assert decode_reply(reply.encode(summed)) == reply


@given(
    st.binary(max_size=60), st.sampled_from([b"", b"@01 0 ", b"@01 0 05 OK IDLE -- ", b"/1 1 ", b"!01 1 ", b"#01 0 "])
)
def test_any_bytes_are_read_or_malformed(data, head):
    for decode in (decode_command, decode_reply):
        with suppress(Malformed):
            decode(head + data)


@given(st.integers(1, 40), st.integers(1, 255))
def test_a_flipped_byte_is_found_by_the_checksum(place, change):
    line = bytearray(Reply(1, 1, 24, True, True, "WR", "123456789012345").encode())
    place %= len(line) - 5
    if place == 0:
        return
    line[place] ^= change
    with pytest.raises(Malformed):
        decode_reply(bytes(line))


def answering(data, mend):
    """Well-formed replies to each command, with ``mend`` to make them odd."""
    command = decode_command(data)
    return mend(Reply(1, 1, command.id, data="00" if command.text == "warnings" else "0")).encode()


def test_late_replies_and_alerts_are_skipped():
    def answer(data):
        late = Reply(1, 1, 98, data="777").encode()
        return b"!01 1 IDLE --\r\n#01 0 hello\r\n" + late + answering(data, lambda r: r)

    with listener(answer) as port:
        table = open_table(TableRecipe(protocol="zaber", address=f"127.0.0.1:{port}"))
        assert table.state().position == 0.0 and table.state().homed
        table.close()


def test_rejection_raises_error_with_advice():
    with (
        listener(lambda d: answering(d, lambda r: replace(r, accepted=False, data="BADAXIS"))) as port,
        pytest.raises(DeviceError, match="check axis in"),
    ):
        open_table(TableRecipe(protocol="zaber", address=f"127.0.0.1:{port}"))


@pytest.mark.parametrize("position", ["nan", "1e999", "1 2", "x", ""])
def test_position_that_is_no_number_raises_error(position):
    def answer(data):
        command = decode_command(data)
        return Reply(1, 1, command.id, data="00" if command.text == "warnings" else position).encode()

    with listener(answer) as port, pytest.raises(DeviceError, match="need a number"):
        open_table(TableRecipe(protocol="zaber", address=f"127.0.0.1:{port}"))


def test_random_answers_never_raise_anything_else():
    chance = random.Random(1)
    parts = [
        b"@01 1 ",
        b"01 ",
        b"OK ",
        b"RJ ",
        b"IDLE ",
        b"BUSY ",
        b"-- ",
        b"WR ",
        b"0",
        b"nan",
        b"\xff",
        b":00",
        b"\r\n",
    ]

    with listener(lambda _: b"".join(chance.choices(parts, k=chance.randrange(1, 12)))) as port:
        recipe = TableRecipe(protocol="zaber", address=f"127.0.0.1:{port}", timeout_s=0.02)
        for _ in range(80):
            try:
                open_table(recipe).close()
            except DeviceError as told:
                assert "127.0.0.1" in str(told)


def test_the_second_axis_of_another_device():
    with table_at("zaber", tables={"device": 7, "axis": 2, "counts_per_turn": 1536000}) as (virtual, _, table):
        table.home()
        table.move_to(-2.0, 1.5)
        assert float(virtual.angle_at(virtual.clock.now())) == pytest.approx(-2.0, abs=1e-5)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")
def test_a_serial_port():
    with served("zaber", address="pty") as (virtual, server, recipe):
        assert server.address.startswith("/dev/")
        table = on_virtual_time(open_table(recipe), virtual.clock)
        table.home()
        table.move_to(1.0, 1.5)
        assert float(virtual.angle_at(virtual.clock.now())) == pytest.approx(1.0, abs=1e-5)
        table.close()
