"""Log lines: with priorities for the journal, readable on a terminal, and never waited for.

A pipe without a reader and a terminal that was stopped (Ctrl-S) accept no more bytes, and a write
to them blocks. That must not be the loop that stops wheels: a thread writes.

A fault that repeats is written a few times, then counted: a board whose supply sags resets every
second, for hours, and the journal of a robot lies on an SD card.
"""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import re
from collections import OrderedDict
from collections.abc import Mapping
from logging.handlers import QueueHandler, QueueListener
from typing import TextIO

from yahboomd.core.program import pasteable, readable

PRIORITIES = {
    logging.DEBUG: 7,
    logging.INFO: 6,
    logging.WARNING: 4,
    logging.ERROR: 3,
    logging.CRITICAL: 2,
}
"""The journal's numbers of the log levels (sd-daemon(3))."""


LINES = 1000
"""The most lines that wait for a slow reader; further ones are lost, and counted."""

FLUSH_S = 1.0
"""The longest that the end of the process waits for a reader."""


class PatientHandler(QueueHandler):
    """Hands its lines to a thread.

    Args:
        stream: The stream of the log.
    """

    queue: queue.Queue[logging.LogRecord]

    def __init__(self, stream: TextIO) -> None:
        super().__init__(queue.Queue(LINES))
        self.writer = LineWriter(self.queue, stream)
        self.lost = 0
        self.broken = 0
        self._reported = 0

    def handle(self, record: logging.LogRecord) -> bool:
        """Take a line; never raises, because its caller may be about to stop wheels.

        A line that cannot be written as it is (its arguments do not fit its words) is counted, and
        its words are written.
        """
        try:
            return super().handle(record)
        except Exception as error:  # noqa: BLE001 - a line is worth less than what logs it
            self.broken += 1
            words = f"(a line was lost: {type(error).__name__}) {record.msg!r:.200}"
            self.enqueue(logging.makeLogRecord({"msg": words}))
            return False

    def emit(self, record: logging.LogRecord) -> None:
        # QueueHandler's own would write what fails to stderr, and wait for its reader.
        self.enqueue(self.prepare(record))

    def enqueue(self, record: logging.LogRecord) -> None:
        """Queue a formatted line; the first one after a gap reports the gap."""
        if missing := self.lost - self._reported:
            record.msg = f"({missing} lines were lost here: they were not read)\n{record.msg}"
        try:
            self.queue.put_nowait(record)
            self._reported = self.lost
        except queue.Full:
            self.lost += 1

    def flush(self) -> None:
        """Wait until all is written, a second at most."""
        written = self.queue.all_tasks_done
        with written:
            written.wait_for(lambda: not self.queue.unfinished_tasks, FLUSH_S)


class LineWriter(QueueListener):
    """Writes lines in a thread, which may have to wait for their reader.

    Args:
        stream: One with a descriptor is written past Python's buffer, whose lock a waiting thread
            would hold at the interpreter's end.
    """

    def __init__(self, lines: queue.Queue[logging.LogRecord], stream: TextIO) -> None:
        super().__init__(lines)
        self._stream = stream

    def handle(self, record: logging.LogRecord) -> None:
        line = f"{record.msg}\n"
        # A reader that is gone cannot be warned.
        with contextlib.suppress(OSError, ValueError):
            try:
                fd = self._stream.fileno()
            except OSError:
                self._stream.write(line)
                return
            data = line.encode(errors="backslashreplace")
            while data:
                data = data[os.write(fd, data) :]


class TerminalFormatter(logging.Formatter):
    """Lines for a person, with commands as this terminal knows them."""

    def format(self, record: logging.LogRecord) -> str:
        return pasteable(readable(super().format(record)))


class JournalFormatter(logging.Formatter):
    """Each line behind its priority; time and name are the journal's to add."""

    def format(self, record: logging.LogRecord) -> str:
        prefix = f"<{PRIORITIES.get(record.levelno, 6)}>"
        return "\n".join(prefix + line for line in readable(super().format(record)).splitlines())


def configure(level: str, environ: Mapping[str, str], stream: TextIO) -> None:
    """Send the log to ``stream``, in the form that its reader wants.

    Args:
        environ: Shows whether the journal reads (``JOURNAL_STREAM``).
    """
    handler = PatientHandler(stream)
    handler.addFilter(RepeatFilter())
    if _is_journal(environ, stream):
        handler.setFormatter(JournalFormatter("%(message)s"))
    else:
        handler.setFormatter(
            TerminalFormatter("%(asctime)s %(levelname)-7s %(message)s", datefmt="%H:%M:%S")
        )
    root = logging.getLogger("yahboomd")
    root.handlers[:] = [handler]
    root.setLevel(level.upper())
    root.propagate = False
    # asyncio reports uncaught errors; such a line must reach the same reader.
    logging.getLogger("asyncio").handlers[:] = [handler]
    # Without room for a thread, lines are lost and counted; the process checks its limits itself.
    with contextlib.suppress(RuntimeError):
        handler.writer.start()


def status_values() -> dict[str, int]:
    """Lines that were lost, and lines that could not be written as they were."""
    handlers = logging.getLogger("yahboomd").handlers
    ours = [each for each in handlers if isinstance(each, PatientHandler)]
    return {
        "log_lines_lost": sum(each.lost for each in ours),
        "log_lines_broken": sum(each.broken for each in ours),
    }


def flush() -> None:
    """Wait until the log is written, a second at most."""
    for handler in logging.getLogger("yahboomd").handlers:
        handler.flush()


def _is_journal(environ: Mapping[str, str], stream: TextIO) -> bool:
    """Whether the stream is the very one that systemd connected to the journal."""
    try:
        device, inode = map(int, environ["JOURNAL_STREAM"].split(":"))
        status = os.fstat(stream.fileno())
    except (KeyError, ValueError, OSError):
        return False
    return (status.st_dev, status.st_ino) == (device, inode)


WRITTEN = 5
"""The most lines of a kind that are written within a window."""

WINDOW_S = 60.0

KINDS = 200
"""The most kinds that are remembered; the one that was longest away goes first."""

_NUMBER = re.compile(r"\d+(?:\.\d+)?")


class RepeatFilter(logging.Filter):
    """Lets some lines of a kind through in each minute, and logs how many it dropped.

    Lines are of a kind when they differ in their numbers only. Time is the record's own; DEBUG is
    for a person who wants every line.
    """

    def __init__(self) -> None:
        super().__init__()
        self._kinds: OrderedDict[str, _Kind] = OrderedDict()

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether the line is written; one that stands for others gets a note."""
        if record.levelno <= logging.DEBUG:
            return True
        message = record.getMessage()
        name = _NUMBER.sub("#", message)
        kind = self._kinds.setdefault(name, _Kind(record.created))
        self._kinds.move_to_end(name)
        while len(self._kinds) > KINDS:
            self._kinds.popitem(last=False)
        # A clock that was set back begins a window, too.
        if not 0.0 <= record.created - kind.since_s < WINDOW_S:
            unwritten, kind.unwritten = kind.unwritten, 0
            kind.since_s, kind.written = record.created, 0
            if unwritten:
                _say(record, message, f"({unwritten} more like it before)")
        elif kind.written == WRITTEN:
            kind.unwritten += 1
            return False
        kind.written += 1
        if kind.written == WRITTEN:
            _say(record, record.getMessage(), "(more like it within a minute are only counted)")
        return True


class _Kind:
    __slots__ = ("since_s", "unwritten", "written")

    def __init__(self, since_s: float) -> None:
        self.since_s = since_s
        self.written = 0
        self.unwritten = 0


def _say(record: logging.LogRecord, message: str, more: str) -> None:
    record.msg, record.args = f"{message} {more}", None
