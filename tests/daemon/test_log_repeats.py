"""A fault that comes again and again is told some times, then counted."""

from __future__ import annotations

import logging

from yahboomd.daemon.log_repeats import KINDS, WINDOW_S, WRITTEN, RepeatFilter


class Log:
    """What is written of lines that are said at given times."""

    def __init__(self) -> None:
        self.written: list[str] = []
        self._filter = RepeatFilter()

    def say(self, at_s: float, words: str, *values: object, level: int = logging.WARNING) -> None:
        record = logging.LogRecord("yahboomd", level, "file", 1, words, values, None)
        record.created = at_s
        if self._filter.filter(record):
            self.written.append(record.getMessage())


def test_a_few_lines_of_a_kind_are_written_as_they_are() -> None:
    log = Log()
    for second in range(WRITTEN - 1):
        log.say(second, "the board reset itself")
    assert log.written == ["the board reset itself"] * (WRITTEN - 1)


def test_of_a_fault_each_second_for_an_hour_few_lines_are_written_and_none_is_unaccounted() -> None:
    log = Log()
    for second in range(3600):
        log.say(float(second), "the board reset itself")
    assert len(log.written) <= WRITTEN * 3600 / WINDOW_S
    counted = sum(
        int(line.partition("(")[2].split()[0]) for line in log.written if " before)" in line
    )
    # What the last minute kept back is not told yet.
    assert len(log.written) + counted == 3600 - (WINDOW_S - WRITTEN)


def test_the_last_line_that_is_written_says_that_more_are_only_counted() -> None:
    log = Log()
    for second in range(20):
        log.say(second, "the board reset itself")
    assert log.written[-1] == (
        "the board reset itself (more like it within a minute are only counted)"
    )


def test_lines_that_differ_in_numbers_only_are_of_a_kind() -> None:
    log = Log()
    for second in range(100):
        log.say(second / 10, "%s: up to %.2f m are unknown", "/dev/ttyUSB0", second / 7)
    assert len(log.written) == WRITTEN


def test_another_fault_is_told_while_one_is_only_counted() -> None:
    log = Log()
    for second in range(20):
        log.say(second, "the board reset itself")
    log.say(20, "the port went away")
    assert log.written[-1] == "the port went away"


def test_every_line_is_written_for_whoever_debugs() -> None:
    log = Log()
    for _ in range(100):
        log.say(0.0, "$spd:0,0,0,0#", level=logging.DEBUG)
    assert len(log.written) == 100


def test_a_clock_that_is_set_back_silences_nothing() -> None:
    log = Log()
    for _ in range(20):
        log.say(1e9, "the board reset itself")
    log.say(1e6, "the board reset itself")
    assert log.written[-1] == f"the board reset itself ({20 - WRITTEN} more like it before)"


def test_memory_does_not_grow_with_ever_new_lines() -> None:
    log = Log()
    for number in range(5 * KINDS):
        log.say(0.0, f"kind {'x' * number}")
    assert len(log._filter._kinds) == KINDS
