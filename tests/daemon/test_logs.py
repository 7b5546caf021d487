"""The log: for the journal and for a terminal; faults that repeat."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from yahboomd.core.daemon.logs import (
    KINDS,
    LINES,
    WINDOW_S,
    WRITTEN,
    PatientHandler,
    RepeatFilter,
    configure,
    flush,
    status_values,
)


@pytest.fixture
def log() -> Iterator[logging.Logger]:
    logger = logging.getLogger("yahboomd")
    before = (logger.handlers[:], logger.level, logger.propagate)
    yield logging.getLogger("yahboomd.test")
    logger.handlers[:], logger.level, logger.propagate = before
    logging.getLogger("asyncio").handlers.clear()


def test_on_a_terminal_a_line_has_time_level_and_words(log: logging.Logger) -> None:
    stream = io.StringIO()
    configure("info", {}, stream)
    log.warning("the port is gone")
    log.debug("not this")
    flush()
    line = stream.getvalue()
    assert line.endswith("WARNING the port is gone\n")
    assert line[2] == ":"
    assert "not this" not in line


def test_for_the_journal_every_line_has_its_priority(log: logging.Logger, tmp_path: Path) -> None:
    with (tmp_path / "journal").open("w+") as stream:
        status = os.fstat(stream.fileno())
        configure("info", {"JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino}"}, stream)
        log.error("one\ntwo")
        log.info("three")
        flush()
        stream.seek(0)
        assert stream.read() == "<3>one\n<3>two\n<6>three\n"


def test_a_stream_that_is_not_the_journals_is_written_for_people(log: logging.Logger) -> None:
    stream = io.StringIO()
    configure("info", {"JOURNAL_STREAM": "1:2"}, stream)
    log.info("hello")
    flush()
    assert stream.getvalue()
    assert not stream.getvalue().startswith("<")


def test_a_reader_that_stopped_reading_is_not_waited_for(log: logging.Logger) -> None:
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writing, b"." * 4096)
    os.set_blocking(writing, True)
    with os.fdopen(writing, "w") as stream:
        configure("debug", {}, stream)
        # As many again as are kept, and each returns at once.
        for number in range(2 * LINES):
            log.debug("line %d", number)
        os.set_blocking(reading, False)
        text = b""
        while b"more" not in text:
            with contextlib.suppress(BlockingIOError):
                text = (text + os.read(reading, 1 << 16)).lstrip(b".")
            log.debug("more")
        # The thread that writes may be stuck with a line; this lets it go.
        os.close(reading)
        flush()
    # The first line after the gap reports it.
    before, gap, after = text.partition(b" lines were lost here: they were not read)\n")
    assert gap
    assert b" line 0\n" in before
    assert b" line " not in after


def test_a_reader_that_is_gone_does_no_harm(log: logging.Logger) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as stream:
        configure("info", {}, stream)
        log.info("unread")
        flush()


@pytest.mark.parametrize("journal", [False, True])
def test_no_line_can_command_a_terminal(log: logging.Logger, tmp_path: Path, journal: bool) -> None:
    with (tmp_path / "log").open("w+") as stream:
        status = os.fstat(stream.fileno())
        device = f"{status.st_dev}:{status.st_ino}"
        configure("info", {"JOURNAL_STREAM": device} if journal else {}, stream)
        log.warning("neighbour %s joined\nand %s", "\x1b[2J", "\x9bleft\x07")
        flush()
        stream.seek(0)
        lines = stream.read().splitlines()
    assert len(lines) == 2
    assert all(line.isprintable() for line in lines)
    assert lines[0].endswith("neighbour ?[2J joined")


class Log:
    """The lines that are written, of those logged at given times."""

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
    # The last minute's suppressed lines are not reported yet.
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


def test_another_fault_is_logged_while_one_is_only_counted() -> None:
    log = Log()
    for second in range(20):
        log.say(second, "the board reset itself")
    log.say(20, "the port went away")
    assert log.written[-1] == "the port went away"


def test_every_line_is_written_at_level_debug() -> None:
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


def test_a_line_that_cannot_be_written_raises_nothing_and_the_next_ones_are(
    tmp_path: Path,
) -> None:
    with (tmp_path / "log").open("w") as stream:
        handler = PatientHandler(stream)
        handler.addFilter(RepeatFilter())
        wrong = logging.LogRecord("x", logging.INFO, "f", 1, "%d wheels", ("four",), None)
        right = logging.LogRecord("x", logging.INFO, "f", 1, "%d wheels", (4,), None)
        handler.writer.start()
        handler.handle(wrong)
        handler.handle(right)
        handler.flush()
    assert handler.broken == 1
    lines = (tmp_path / "log").read_text().splitlines()
    assert "%d wheels" in lines[0]
    assert lines[1] == "4 wheels"


def test_without_room_for_its_thread_a_line_raises_nothing_and_is_counted(
    log: logging.Logger, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(_self: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refused)
    configure("debug", {}, io.StringIO())
    for number in range(LINES + 3):
        log.debug("line %d", number)
    assert status_values()["log_lines_lost"] == 3
