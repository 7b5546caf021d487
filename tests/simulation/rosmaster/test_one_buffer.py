from __future__ import annotations

import pytest

from yahboomd.simulation.rosmaster.one_buffer import OneBuffer

MOTION = bytes.fromhex("FF FC 0A 12 01 C8 00 00 00 F4 01 DA")
STOP = bytes.fromhex("FF FC 0A 12 01 00 00 00 00 00 00 1D")


def fed(data: bytes, buffer: OneBuffer | None = None) -> OneBuffer:
    buffer = buffer or OneBuffer()
    for byte in data:
        buffer.receive(byte)
    return buffer


def test_a_frame_is_taken_once() -> None:
    buffer = fed(MOTION)
    found = buffer.take()
    assert found is not None
    assert (found[0], found[1][:7]) == (0x12, MOTION[4:11])
    assert buffer.take() is None


def test_of_two_frames_that_come_before_it_looks_the_second_is_kept() -> None:
    found = fed(MOTION + STOP).take()
    assert found is not None
    assert found[1][:7] == STOP[4:11]


def test_a_frame_that_is_cut_short_by_a_look_is_executed_without_its_payload() -> None:
    buffer = fed(MOTION + MOTION[:3])
    first = buffer.take()
    assert first is not None
    assert first[1][:7] == MOTION[4:11]
    # Its function comes, and the look that follows has no length to sum up: a motion of zeros.
    found = fed(MOTION[3:4], buffer).take()
    assert found == (0x12, bytes(16))


def test_a_length_beyond_the_buffer_leaves_the_frame_that_waits_without_one() -> None:
    found = fed(STOP + b"\xff\xfc\x12").take()
    assert found is not None
    assert (found[0], found[1][0]) == (0x12, 1)


def test_a_frame_leaves_zeros_behind_it() -> None:
    buffer = fed(MOTION)
    buffer.take()
    found = fed(bytes.fromhex("FF FC 03 12 15"), buffer).take()
    assert found == (0x12, b"\x15" + bytes(15))


def test_a_frame_that_waits_is_spoilt_by_the_beginning_of_the_next() -> None:
    assert fed(MOTION + STOP[:6]).take() is None


@pytest.mark.parametrize("cut", range(1, len(MOTION)))
def test_half_a_frame_swallows_the_next_one_and_20_zeros_end_it(cut: int) -> None:
    if cut >= 3:
        assert fed(MOTION[:cut] + STOP).take() is None
    buffer = fed(MOTION[:cut] + bytes(20))
    buffer.take()
    found = fed(STOP, buffer).take()
    assert found is not None
    assert found[1][:7] == STOP[4:11]


@pytest.mark.parametrize(
    "data",
    [
        b"\xff" + MOTION,
        MOTION[:-1] + b"\0",
        b"\xff\xfc\x12" + bytes(17) + b"\x12",
        b"$spd:300,0,300,0#",
        b"\xff\xfc\x00\x00",
    ],
)
def test_what_the_firmware_loses_is_lost(data: bytes) -> None:
    assert fed(data).take() is None


def test_a_reset_forgets_what_waits() -> None:
    buffer = fed(MOTION)
    buffer.clear()
    assert not buffer.waits
    assert buffer.take() is None
