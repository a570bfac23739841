"""Raw scanCONTROL profiles: known bytes to known numbers, and counters that start again."""

import struct

import numpy as np
import pytest

from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.files.scans.scancontrol import (
    RANGES,
    decode_container,
    profile_bytes,
    scale_of,
    unwrap_counter,
    unwrap_encoder,
    unwrap_time,
)


def profile(z, x, *, counter=0, opened=0, closed=0, encoder=0):
    stamp = struct.pack(">II HH I", counter, opened, 2 * encoder, 0, closed)
    return struct.pack(f"<{len(z)}H{len(x)}H", *z, *x) + bytes(2 * len(z) - 16) + stamp


def test_known_bytes_give_the_decimal_numbers_that_they_stand_for():
    z, x = [32768, 32768, 0, 1, 65535, 32769, 7, 8], [0, 32768, 5, 1, 65535, 32769, 7, 8]
    bytes_ = profile(z, x, counter=0xC0_123456, opened=3 << 25 | 4000 << 12 | 1536, closed=127 << 25, encoder=32767)
    got = decode_container(bytes_ * 2, 8, "29xx-50")
    assert got.z.shape == got.x.shape == (2, 8)
    assert got.z[1, [0, 1]].tolist() == [95.0, 95.0]
    assert np.isnan(got.z[0, 2])
    assert np.isnan(got.x[0, 2])
    assert got.z[0, 3:].tolist() == [29.466, 160.534, 95.002, 29.478, 29.48]
    assert got.x[0, 3:].tolist() == [-65.534, 65.534, 0.002, -65.522, -65.52]
    assert got.stamps.counter.tolist() == [0x123456] * 2
    assert got.stamps.opened.tolist() == [3.5 + 1536 / 24.576e6] * 2
    assert got.stamps.closed.tolist() == [127.0] * 2
    assert got.stamps.encoder.tolist() == [32767] * 2


@pytest.mark.parametrize("model", RANGES)
def test_every_count_is_its_decimal_number_to_the_last_bit(model):
    raw = np.arange(1, 65536, dtype=np.uint16)[:65528].reshape(-1, 8)
    rows = np.concatenate([raw, raw, np.zeros_like(raw)], axis=1)
    got = decode_container(rows.astype("<u2").tobytes(), 8, model)
    scale = RANGES[model]
    assert got.z.ravel()[::97].tolist() == [
        float(f"{(int(r) - 32768) * scale.step + scale.offset:.4f}") for r in raw.ravel()[::97]
    ]
    assert got.x.ravel()[::97].tolist() == [float(f"{(int(r) - 32768) * scale.step:.4f}") for r in raw.ravel()[::97]]


def test_no_bytes_are_no_profiles():
    got = decode_container(b"", 640, "29xx-50")
    assert got.z.shape == (0, 640)
    assert (
        unwrap_counter(got.stamps.counter).size
        == unwrap_time(got.stamps.opened).size
        == unwrap_encoder(got.stamps.encoder).size
        == 0
    )


@pytest.mark.parametrize("name", ["29xx-50", "2950-50", "LLT2900-50/BL", "scanCONTROL 2910-50", "llt29xx-50"])
def test_a_type_may_be_written_as_the_type_plate_has_it(name):
    assert scale_of(name) == RANGES["29xx-50"]


@pytest.mark.parametrize("name", ["", "29xx", "29xx-30", "2900", "28xx-25", "29xx-50x"])
def test_an_unknown_type_is_refused_with_the_known_ones(name):
    with pytest.raises(BadRecipe, match="29xx-50"):
        scale_of(name)


def test_a_cut_container_names_the_place_and_an_impossible_number_of_points_is_refused():
    with pytest.raises(UnreadableFile, match=r"1 profiles of 8 points .* 47 bytes from byte 48"):
        decode_container(bytes(95), 8, "29xx-50")
    for points in (0, 7, 4097, -1):
        with pytest.raises(BadRecipe, match="points"):
            profile_bytes(points)


def test_counts_that_start_again_go_on():
    true = np.array([2**24 - 2, 2**24 - 1, 2**24, 2**24 + 5, 2**25 + 7])
    assert unwrap_counter(true[:4] % 2**24).tolist() == true[:4].tolist()
    counts = np.array([32000, 32767, 32768, 40000, 32760, 20000, 10000, -5])
    assert unwrap_encoder(counts % 2**15).tolist() == counts.tolist()
    times = np.array([126.5, 127.75, 128.25, 200.0, 257.0])
    assert unwrap_time(times % 128).tolist() == times.tolist()


@pytest.mark.parametrize("cut", range(1, 5))
def test_a_stream_in_pieces_goes_on_like_the_whole(cut):
    numbers = np.array([2**24 - 2, 2**24, 2**24 + 1, 2**24 + 9, 2**24 + 10])
    for unwrap, modulus, true in (
        (unwrap_counter, 2**24, numbers),
        (unwrap_encoder, 2**15, np.array([32000, 32768, 45000, 30000, 65536 - 21000])),
        (unwrap_time, 128.0, np.array([100.0, 129.0, 250.0, 256.0, 383.5])),
    ):
        raw = true % modulus
        first = unwrap(raw[:cut])
        assert np.concatenate([first, unwrap(raw[cut:], first[-1])]).tolist() == unwrap(raw).tolist() == true.tolist()
