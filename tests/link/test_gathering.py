"""The number of bytes that are waited for."""

from __future__ import annotations

import random

import pytest

from yahboomd.core.link.gathering import ALIKE, UNCHANGED, Gathering


class Reader:
    """Hears lines in pieces, and is woken as the kernel wakes it."""

    def __init__(self, line_end: int) -> None:
        self.gathering = Gathering(line_end)
        self.line_end = line_end
        self.waiting = b""
        self.held = b""
        self.wakes = 0
        self.wakeups = 0
        self.now_ns = self.lines = 0
        self.last = b""
        self.late: list[int] = []  # bytes of others that came before a line was heard

    def hear(self, size: int, piece: int, *, count: int | None = None) -> None:
        """A line, and a pause behind it; the pieces come in pauses as well."""
        self.now_ns += 6_000_000
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
            self.gathering.line(len(line) + 1, unchanged=line == self.last, now_ns=self.now_ns)
            self.last = line
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


@pytest.mark.parametrize(("apart_ns", "together"), [(5, 4), (6, 3), (10, 2), (11, 1), (16, 1)])
def test_counts_that_stand_wake_the_reader_so_seldom_that_no_byte_waits_for_20_ms(
    apart_ns: int, together: int
) -> None:
    gathering = Gathering(2)
    for number in range(UNCHANGED + 1):
        now_ns = number * apart_ns * 1_000_000
        gathering.line(22, unchanged=number > 0, now_ns=now_ns)
        gathering.adjust(0)
    assert gathering.least == together * 24


@pytest.mark.parametrize("before", [UNCHANGED + 1, UNCHANGED + 30, 2 * UNCHANGED - 1])
def test_the_pace_of_lines_after_a_start_is_that_of_the_lines_since(before: int) -> None:
    gathering = Gathering(2)
    for number in range(before + UNCHANGED + 2):
        if number == before:
            gathering.stir()
            gathering.adjust(0)
        gathering.line(22, unchanged=number > 0, now_ns=number * 6_000_000)
        gathering.adjust(0)
    assert gathering.lines == 3
    assert gathering.apart_ns == 6_000_000


@pytest.mark.parametrize("before", [10, UNCHANGED + 30, 2 * UNCHANGED])
def test_a_pause_of_the_stream_does_not_count_for_its_pace(before: int) -> None:
    gathering, paces = Gathering(2), set[int]()
    for number in range(before + 3 * UNCHANGED):
        now_ns = number * 6_000_000 + (150_000_000 if number >= before else 0)
        gathering.line(22, unchanged=number > 0, now_ns=now_ns)
        gathering.adjust(0)
        if gathering.lines > 1:
            paces.add(gathering.apart_ns)
    assert gathering.lines == 3
    assert paces == {6_000_000}


@pytest.mark.parametrize(("wanted_ms", "together"), [(5, 1), (10, 1), (13, 2), (20, 3), (100, 3)])
def test_readings_come_as_often_as_they_are_wanted(wanted_ms: int, together: int) -> None:
    gathering = Gathering(2, wanted_ns=wanted_ms * 1_000_000)
    for number in range(UNCHANGED + 2):
        gathering.line(22, unchanged=number > 0, now_ns=number * 6_000_000)
        gathering.adjust(0)
    assert gathering.lines == together


def test_the_kernel_is_asked_for_no_more_than_it_can() -> None:
    gathering = Gathering(2)
    for number in range(UNCHANGED + 1):
        gathering.line(60, unchanged=number > 0, now_ns=number)
        gathering.adjust(0)
    assert gathering.least == 4 * 62


@pytest.mark.parametrize("piece", [3, 64])
def test_of_counts_that_change_after_a_rest_those_of_one_reading_alone_waited(piece: int) -> None:
    reader = Reader(2)
    for _ in range(100):
        reader.hear(22, piece, count=1)
    assert reader.gathering.least == 3 * 24
    for number in range(2, 5):
        reader.hear(22, piece, count=number)
    assert reader.gathering.least <= 24
    reader.late.clear()
    for number in range(5, 80):
        reader.hear(22, piece, count=number)
        assert reader.last == b"$%020d" % number
    assert max(reader.late) == 0


@pytest.mark.parametrize(("asked_ms", "fetched"), [(9, False), (10, True), (20, True), (21, False)])
def test_the_answers_of_a_board_that_is_asked_often_and_stands_are_fetched(
    asked_ms: int, *, fetched: bool
) -> None:
    gathering = Gathering(0, asked_ms * 1_000_000)
    for number in range(UNCHANGED + 1):
        assert not gathering.fetched
        gathering.line(30, unchanged=number > 0, now_ns=number * asked_ms * 1_000_000)
        gathering.adjust(0)
    assert gathering.fetched is fetched
    assert gathering.lines == 1
    assert gathering.least == (255 if fetched else 30)
    # One that differs, and a command to turn, end it.
    gathering.stir()
    gathering.adjust(0)
    assert (gathering.fetched, gathering.least) == (False, 30)
