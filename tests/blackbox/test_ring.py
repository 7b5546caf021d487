"""The ring keeps its newest records, and is readable at every moment."""

from __future__ import annotations

import random

from made_boxes import HEADER
from msgspec import structs

from yahboomd.blackbox.box_file import encode_header, read_box
from yahboomd.blackbox.records import COMMAND, RECEIVED, encode
from yahboomd.blackbox.ring import Ring

SECOND_NS = 1_000_000_000


def lines(count: int, seed: int = 1) -> list[bytes]:
    chance = random.Random(seed)
    return [b"%d:" % number + bytes(chance.randrange(1, 80)) for number in range(count)]


def test_the_newest_records_are_kept_in_their_order(memory):
    buffer, ring = memory(segments=4)
    sent = lines(2000)
    for number, line in enumerate(sent):
        ring.write(RECEIVED, line, 10 * SECOND_NS + number)
    found = read_box(bytes(buffer))
    kept = [record.meaning.data for record in found.records]
    assert kept == sent[-len(kept) :]
    # Three segments at least are full.
    assert sum(map(len, kept)) + 7 * len(kept) > 3 * 0.95 * 4096
    assert [record.at_ns for record in found.records] == [
        10 * SECOND_NS + number for number in range(2000 - len(kept), 2000)
    ]
    assert found.damaged == 0


def test_moments_are_exact_however_far_apart_they_are(memory):
    buffer, ring = memory()
    moments = [0, 5, 4 * SECOND_NS, 100 * SECOND_NS + 3, 100 * SECOND_NS + 1, 10**18]
    for at_ns in moments:
        ring.write(RECEIVED, b"x", at_ns)
    assert [record.at_ns for record in read_box(bytes(buffer)).records] == moments


def test_what_is_larger_than_a_segment_is_left_out_and_counted(memory):
    buffer, ring = memory()
    ring.write(RECEIVED, b"before", 1)
    ring.write(RECEIVED, bytes(4096), 2)
    ring.write(RECEIVED, b"behind", 3)
    found = [record.meaning.data for record in read_box(bytes(buffer)).records]
    assert found == [b"before", b"behind"]
    assert ring.left_out == 1


def test_killed_between_any_two_stores_every_record_is_there(memory):
    """The stores of a killed process are in the file up to some moment, in their order."""
    buffer, ring = memory(segments=2)
    images: list[bytes] = []
    store = ring._store

    def kept(data: bytes, at: int) -> None:
        images.append(bytes(buffer))
        store(data, at)

    ring._store = kept
    sent = lines(150)
    whole = []
    for number, line in enumerate(sent):
        before = len(images)
        ring.write(RECEIVED, line, 1000 + number)
        whole += [number] * (len(images) - before)
    for number, image in zip(whole, images, strict=True):
        found = [record.meaning.data for record in read_box(image).records]
        assert found == sent[number - len(found) : number]
        if number > 60:
            # A segment is cleared before it is used again.
            assert len(found) > 20


def test_a_record_on_two_pages_is_not_there_until_all_of_it_is(memory):
    """The kernel may be ended between two pages of one write."""
    head = len(encode_header(HEADER))
    buffer = bytearray(head + 2 * 8192)
    stores: list[tuple[int, bytes]] = []

    def store(data: bytes, at: int) -> None:
        stores.append((at, data))
        buffer[at : at + len(data)] = data

    ring = Ring(store, head, 8192, 2)
    for number in range(100):
        stores.clear()
        before = bytes(buffer)
        ring.write(RECEIVED, b"x" * 97, number)
        if len(stores) == 2 and number:
            break
    (at, rest), (kind_at, kind) = stores
    assert (kind_at, len(kind), at) == (at - 1, 1, kind_at + 1)
    torn = bytearray(before)
    torn[at : at + len(rest)] = rest
    header = structs.replace(HEADER, segment_bytes=8192)
    image = encode_header(header)
    torn[:head] = buffer[:head] = image
    assert len(read_box(bytes(torn)).records) == number
    assert len(read_box(bytes(buffer)).records) == number + 1


def test_a_segment_says_that_it_was_begun(memory):
    _, ring = memory()
    assert not ring.turned
    ring.write(COMMAND, encode_command(), 1)
    assert ring.turned
    ring.turned = False
    for number in range(10):
        ring.write(COMMAND, encode_command(), number)
    assert not ring.turned


def encode_command() -> bytes:
    from yahboomd.blackbox.records import CommandRecord

    return encode(CommandRecord(source="cmd_vel", vx=0.0, vy=0.0, wz=0.0))[1]
