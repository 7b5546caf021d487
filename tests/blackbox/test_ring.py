"""The ring: what it keeps, and that it is readable at every moment."""

from __future__ import annotations

import random

from yahboomd.blackbox.box_file import read_box
from yahboomd.blackbox.records import COMMAND, RECEIVED, Received, encode

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


class Watched(bytearray):
    """Bytes that keep what they were before every store."""

    def __setitem__(self, key, value):
        self.history.append(bytes(self))
        super().__setitem__(key, value)


def test_killed_between_any_two_stores_the_newest_record_alone_is_missing(memory):
    """The stores of a killed process are in the file up to some moment, in their order."""
    plain, ring = memory(segments=2)
    buffer = Watched(plain)
    buffer.history = []
    ring._buffer = buffer  # type: ignore[assignment]
    sent = lines(150)
    whole = []
    for number, line in enumerate(sent):
        before = len(buffer.history)
        ring.write(RECEIVED, line, 1000 + number)
        whole += [number] * (len(buffer.history) - before)
    for number, image in zip(whole, buffer.history, strict=True):
        kept = [record.meaning.data for record in read_box(image).records]
        # What was written last is there, but for the record in the making.
        assert kept == sent[number - len(kept) : number]
        if number > 60:
            # A segment is cleared before it is used again.
            assert len(kept) > 20


def test_a_torn_record_is_not_there_however_far_it_was_written(memory):
    """The payload and the length are copied byte by byte."""
    buffer, ring = memory()
    ring.write(RECEIVED, b"first", 1)
    before = bytes(buffer)
    ring.write(RECEIVED, b"second", 2)
    after = bytes(buffer)
    changed = [at for at in range(len(before)) if before[at] != after[at]]
    kind_at = changed[0]
    for torn_at in range(kind_at + 1, changed[-1] + 2):
        torn = bytearray(before)
        torn[kind_at + 1 : torn_at] = after[kind_at + 1 : torn_at]
        assert [each.meaning for each in read_box(bytes(torn)).records] == [Received(data=b"first")]


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
    from yahboomd.blackbox.records import Command

    return encode(Command(source="cmd_vel", vx=0.0, vy=0.0, wz=0.0))[1]
