"""Box files: read as far as they are whole, and refused with a reason."""

from __future__ import annotations

import contextlib
import random

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_boxes import HEADER, ring_of, saved_box

from yahboomd.blackbox.box_file import (
    MAGIC,
    PREFIX,
    NotABox,
    deflated,
    encode_header,
    read_box,
    read_header,
    robot_slug,
    segments_of,
)
from yahboomd.blackbox.records import RECEIVED, REPEATED, Ended, Received


def filled(memory, count=300):
    buffer, ring = memory()
    for number in range(count):
        ring.write(RECEIVED, b"%d" % number, number)
    return bytes(buffer)


def test_a_header_is_read_as_it_was_written(memory, header):
    assert read_box(filled(memory)).header == header


def test_a_compressed_file_is_the_same_box(memory):
    image = filled(memory)
    small = deflated(image)
    assert read_box(small) == read_box(image)
    assert len(small) < len(image) / 4


def test_a_repeated_read_has_the_bytes_of_the_one_before(memory):
    buffer, ring = memory()
    ring.write(RECEIVED, b"$MAll:0,0,0,0#\r\n", 1)
    ring.write(REPEATED, b"", 2)
    ring.write(REPEATED, b"", 3)
    found = read_box(bytes(buffer)).records
    assert [record.meaning for record in found] == [Received(data=b"$MAll:0,0,0,0#\r\n")] * 3
    assert [record.at_ns for record in found] == [1, 2, 3]


def test_a_file_that_was_cut_is_read_up_to_there(memory):
    image = filled(memory, count=200)
    whole = len(read_box(image).records)
    assert 0 < len(read_box(image[: 4096 + 1000]).records) < whole
    small = deflated(image)
    cut = read_box(small[: len(small) // 2])
    assert 0 < len(cut.records) <= whole
    assert cut.cut
    assert not read_box(small).cut


@pytest.mark.parametrize(
    "data", [b"", b"YB", b"not a box at all, by far" * 9, MAGIC, b"\x1f\x8b\x08 nor this"]
)
def test_what_is_no_box_is_refused(data):
    with pytest.raises(NotABox):
        read_box(data)


def test_a_later_format_is_refused_with_a_remedy(memory, header):
    image = filled(memory)
    with pytest.raises(NotABox, match="later version"):
        read_box(b"YBXBOX2\n" + image[8:])
    later = encode_header(msgspec.structs.replace(header, format=2))
    with pytest.raises(NotABox, match="format 2"):
        read_box(later + image[len(later) :])


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32), damages=st.integers(1, 30))
def test_no_damage_raises_anything_else(memory, seed, damages):
    chance = random.Random(seed)
    image = bytearray(filled(memory))
    for _ in range(damages):
        image[chance.randrange(len(image))] = chance.randrange(256)
    try:
        found = read_box(bytes(image))
    except NotABox:
        return
    assert len(found.records) <= 3000


def test_damage_inside_a_segment_is_counted(memory):
    image = bytearray(filled(memory, count=2000))
    at = image.index(b"1990") - 7
    image[at] = 99
    found = read_box(bytes(image))
    assert found.damaged == 1
    assert found.records[-1].meaning == Received(data=b"1989")


def test_segments_that_are_missing_in_the_middle_are_counted(memory):
    image = filled(memory, count=5000)
    whole = read_box(image)
    assert whole.damaged == 0
    head = len(image) - 4 * 4096
    # The ring has gone round, so the cut lies between the oldest and the newest.
    newest = max(range(4), key=lambda at: image[head + 4096 * at + 1 : head + 4096 * at + 9][::-1])
    moved = [(newest + 2 + each) % 4 for each in range(4)]
    segments = [image[head + 4096 * at : head + 4096 * (at + 1)] for at in moved]
    cut = read_box(image[:head] + b"".join(segments[:1] + segments[2:]))
    assert cut.damaged == 1
    assert len(cut.records) < len(whole.records)


def test_a_name_of_a_file_has_namespace_and_port_as_far_as_they_are_known() -> None:
    def slug(**config: object) -> str:
        return robot_slug(msgspec.structs.replace(HEADER, config=config))

    assert slug(zenoh={"namespace": "fleet/bot 1"}, serial={"port": "/dev/my_board"}) == (
        "fleet-bot-1-my-board"
    )
    assert slug(serial={"port": "/dev/ttyUSB0"}) == "ttyUSB0"
    assert slug(zenoh=[], serial={}) == ""


def test_the_header_is_read_without_the_records() -> None:
    data = saved_box()
    assert read_header(data) == read_box(data).header
    assert read_header(data[:-20]) == read_box(data).header
    with pytest.raises(NotABox):
        read_header(b"text")


def test_a_header_with_any_flipped_bit_is_read_or_refused() -> None:
    """The next daemon's writer meets the leftovers of this one, and must survive them."""
    data = ring_of((1.0, Received(data=b"$MAll:1,2,3,4#")), (0.5, Ended(reasons=("crash",))))
    words = PREFIX.size + PREFIX.unpack_from(data)[2]
    for at in range(words):
        for bit in (at % 8, (at + 5) % 8):
            flipped = bytearray(data)
            flipped[at] ^= 1 << bit
            with contextlib.suppress(NotABox):
                read_box(bytes(flipped))
                segments_of(bytes(flipped))


def test_segments_with_flipped_bits_are_read_as_far_as_they_are_whole() -> None:
    data = ring_of((1.0, Received(data=b"$MAll:1,2,3,4#")), (0.5, Ended(reasons=("crash",))))
    begin = PREFIX.unpack_from(data)[1]
    for at in range(begin, begin + 120):
        for bit in (at % 8, (at + 5) % 8):
            flipped = bytearray(data)
            flipped[at] ^= 1 << bit
            read_box(bytes(flipped))
