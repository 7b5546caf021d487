"""The log: for the journal and for a terminal."""

from __future__ import annotations

import io
import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from yahboomd.daemon.logs import configure


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
        stream.flush()
        stream.seek(0)
        assert stream.read() == "<3>one\n<3>two\n<6>three\n"


def test_a_stream_that_is_not_the_journals_is_written_for_people(log: logging.Logger) -> None:
    stream = io.StringIO()
    configure("info", {"JOURNAL_STREAM": "1:2"}, stream)
    log.info("hello")
    assert not stream.getvalue().startswith("<")
