from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.protocol.rosmaster.packets import (
    LINE_MOST,
    RESYNC,
    Packet,
    PacketFramer,
    Words,
    frame,
)


def received(text: str) -> bytes:
    return bytes.fromhex(text)


SPEED = received("FF FB 0A 0A C8 00 00 00 F4 01 78 49")
COUNTS = received("FF FB 13 0D 28 05 00 00 28 05 00 00 FF FF FF FF A0 86 01 00 9D")
VERSION = received("FF FB 05 51 03 05 5E")
FRAGMENTS = (
    SPEED,
    COUNTS,
    VERSION,
    COUNTS[:9],
    b"\xff",
    b"\xff\xfb",
    b"\xff\xfb\x28",
    b"\xff\xfb\x02\x00",
    b"\xff\xff\xfb",
    b"Firmware Version: V3.5.1\n",
    b"IMU Type: ICM",
    b"\r\n",
    b"\n",
    b"x" * 150,
)
streams = st.lists(st.sampled_from(FRAGMENTS) | st.binary(max_size=40), max_size=20)


def fed(*chunks: bytes) -> list[Packet | Words]:
    framer = PacketFramer()
    return [item for chunk in chunks for item in framer.feed(chunk)]


@pytest.mark.parametrize(
    ("function", "payload", "wanted"),
    [
        (0x12, (1, 0xC8, 0, 0, 0, 0xF4, 1), "FF FC 0A 12 01 C8 00 00 00 F4 01 DA"),
        (0x12, (1, 0, 0, 0, 0, 0, 0), "FF FC 0A 12 01 00 00 00 00 00 00 1D"),
        (0x15, (1, 0x5F), "FF FC 05 15 01 5F 7A"),
        (0x50, (0x51, 0), "FF FC 05 50 51 00 A6"),
        (0x01, (1, 0), "FF FC 05 01 01 00 07"),
        (0x10, (50, 206, 0, 100), "FF FC 07 10 32 CE 00 64 7B"),
        (0x0F, (0x5F,), "FF FC 04 0F 5F 72"),
    ],
)
def test_frames_to_the_board_are_those_of_its_documentation(function, payload, wanted):
    assert frame(function, *payload) == received(wanted)


def test_a_frame_and_a_line_are_found_where_they_stand():
    heard = b"\nFirmware Version: V3.5.1\r\n" + SPEED + b"IMU Type: MPU9250\n" + VERSION
    assert fed(heard) == [
        Words(text="Firmware Version: V3.5.1", size=26, trailing=len(heard) - 27),
        Packet(function=0x0A, payload=SPEED[4:-1], size=12, trailing=18 + 7),
        Words(text="IMU Type: MPU9250", size=18, trailing=7),
        Packet(function=0x51, payload=b"\x03\x05", size=7, trailing=0),
    ]


def test_a_banner_behind_half_a_frame_is_still_a_line():
    (words,) = fed(COUNTS[:7] + b"\nFirmware Version: V3.5.1\n" + bytes(10))
    assert isinstance(words, Words)
    assert words.text == "Firmware Version: V3.5.1"


@pytest.mark.parametrize("at", range(2, len(COUNTS)))
def test_a_flipped_bit_makes_no_packet_and_the_next_one_is_found(at):
    spoilt = bytearray(COUNTS)
    spoilt[at] ^= 0x10
    packets = [item for item in fed(bytes(spoilt), COUNTS, COUNTS) if isinstance(item, Packet)]
    assert packets
    assert all(packet.payload == COUNTS[4:-1] for packet in packets)


def test_a_frame_comes_out_at_its_last_byte():
    framer = PacketFramer()
    assert framer.feed(COUNTS[:-1]) == []
    assert framer.held_bytes == len(COUNTS) - 1
    assert len(framer.feed(COUNTS[-1:])) == 1


@pytest.mark.parametrize(
    ("data", "counters"),
    [
        (SPEED, {"frames": 1}),
        (SPEED[:-1] + b"\0", {"broken_frames": 1}),
        (b"\xff\xfb\x29", {"overlong": 1}),
        (b"\r\n\n", {"blank_bytes": 3}),
        (b"hello\n", {"lines": 1}),
        (b"\x00\x01", {"discarded_bytes": 2}),
    ],
)
def test_what_is_lost_is_counted(data, counters):
    framer = PacketFramer()
    framer.feed(data)
    seen = framer.counters
    for name in ("frames", "lines", "broken_frames", "overlong"):
        assert getattr(seen, name) == counters.get(name, 0), name
    assert all(getattr(seen, name) == value for name, value in counters.items())


@given(streams)
def test_every_byte_is_accounted_for_once_and_what_is_held_is_bounded(parts):
    framer = PacketFramer()
    items = [item for part in parts for item in framer.feed(part)]
    seen = framer.counters
    assert seen.bytes == sum(map(len, parts))
    whole = sum(item.size for item in items)
    assert whole + seen.blank_bytes + seen.discarded_bytes + framer.held_bytes == seen.bytes
    assert framer.held_bytes <= LINE_MOST
    assert seen.frames + seen.lines == len(items)


@given(streams)
def test_the_chunks_make_no_difference(parts):
    whole, single = PacketFramer(), PacketFramer()
    data = b"".join(parts)
    together = [(type(item), getattr(item, "payload", "")) for item in whole.feed(data)]
    apart = [
        (type(item), getattr(item, "payload", ""))
        for byte in data
        for item in single.feed(bytes([byte]))
    ]
    assert together == apart
    assert whole.counters == single.counters


@given(streams)
def test_a_frame_is_found_whatever_came_before(parts):
    # Earlier bytes may contain a start: it claims 42 bytes at most.
    last = fed(*parts, SPEED, SPEED, SPEED, SPEED, COUNTS)[-1]
    assert isinstance(last, Packet)
    assert last.payload == COUNTS[4:-1]


def test_a_resync_holds_no_start_and_is_as_long_as_the_boards_buffer():
    assert bytes(20) == RESYNC
