"""The number of bytes that are waited for."""

from __future__ import annotations

import random

import pytest

from yahboomd.core.link.gathering import ALIKE, LONGEST, Gathering


class Reader:
    """Hears lines in pieces, and is woken as the kernel wakes it."""

    def __init__(self, line_end: int) -> None:
        self.gathering = Gathering(line_end)
        self.line_end = line_end
        self.waiting = b""
        self.held = b""
        self.wakes = 0
        self.wakeups = 0
        self.lines = 0
        self.late: list[int] = []  # bytes of others that came before a line was heard

    def hear(self, size: int, piece: int, *, count: int | None = None) -> None:
        """A line, and a pause behind it; the pieces come in pauses as well."""
        self.lines += 1
        digits = b"%0*d" % (size - 2, self.lines if count is None else count)
        line = b"$" + digits + b"#" + b"\r\n"[: self.line_end]
        for at in range(0, len(line), piece):
            self.waiting += line[at : at + piece]
            if len(self.waiting) >= self.gathering.least:
                self._wake()

    def _wake(self) -> None:
        self.wakes += 1
        data, self.waiting = self.held + self.waiting, b""
        while b"#" in data:
            line, _, data = data.partition(b"#")
            self.late.append(len(data.removeprefix(b"\r").removeprefix(b"\n")))
            line = line.lstrip()
            self.gathering.line(len(line) + 1)
        self.held = data.lstrip()
        self.wakeups += self.gathering.adjust(len(self.held))


@pytest.mark.parametrize("line_end", [0, 2])
@pytest.mark.parametrize("piece", [1, 3, 11, 64])
def test_lines_that_are_alike_wake_the_reader_once_each_and_wait_for_nothing(
    line_end: int, piece: int
) -> None:
    reader = Reader(line_end)
    for _ in range(ALIKE + 2):
        reader.hear(22, piece)
    before = reader.wakes
    for _ in range(100):
        reader.hear(22, piece)
    assert reader.wakes - before == 100
    assert max(reader.late) == 0
    assert reader.wakeups == 1


@pytest.mark.parametrize("line_end", [0, 2])
@pytest.mark.parametrize("piece", [1, 3, 11])
def test_a_line_that_is_longer_than_those_before_waits_for_nothing(
    line_end: int, piece: int
) -> None:
    reader = Reader(line_end)
    for size in [22] * 50 + [23] * 50 + [40] * 50:
        reader.hear(size, piece)
    assert len(reader.late) == 150
    assert max(reader.late) == 0
    assert reader.gathering.least == 40 + line_end


@pytest.mark.parametrize("line_end", [0, 2])
def test_of_lines_that_become_shorter_the_first_alone_waits(line_end: int) -> None:
    reader = Reader(line_end)
    for size in [22] * 50 + [16] * 50:
        reader.hear(size, 1)
    assert len(reader.late) == 100
    assert len([each for each in reader.late if each]) == 1
    assert reader.gathering.least == 16 + line_end


def test_lines_of_all_lengths_are_heard_as_they_come() -> None:
    reader = Reader(2)
    chance = random.Random(1)
    for _ in range(2000):
        reader.hear(chance.randrange(16, 53), 7)
    assert len(reader.late) == 2000
    assert max(reader.late) < 7
    assert reader.wakeups < 10


def test_lines_longer_than_any_of_counts_are_heard_as_they_come() -> None:
    gathering = Gathering(2)
    for _ in range(2 * ALIKE):
        gathering.line(LONGEST + 1)
        gathering.adjust(0)
    assert gathering.least == 1
