"""Log lines: with priorities for the journal, readable on a terminal, bounded under repeats."""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping
from typing import TextIO

PRIORITIES = {
    logging.DEBUG: 7,
    logging.INFO: 6,
    logging.WARNING: 4,
    logging.ERROR: 3,
    logging.CRITICAL: 2,
}
"""What the journal calls the levels (sd-daemon(3))."""


class JournalFormatter(logging.Formatter):
    """Each line behind its priority; time and name are the journal's to add."""

    def format(self, record: logging.LogRecord) -> str:
        """The record, every line of it with the priority."""
        prefix = f"<{PRIORITIES.get(record.levelno, 6)}>"
        return "\n".join(prefix + line for line in super().format(record).splitlines())


def configure(level: str, environ: Mapping[str, str], stream: TextIO) -> None:
    """Send the log to ``stream``, in the form that its reader wants.

    Args:
        level: The least serious level that is written.
        environ: Tells whether the journal reads (``JOURNAL_STREAM``).
        stream: Where lines go.
    """
    handler = logging.StreamHandler(stream)
    if _is_journal(environ, stream):
        handler.setFormatter(JournalFormatter("%(message)s"))
    else:
        handler.setFormatter(
            logging.Formatter("%(asctime)s %(levelname)-7s %(message)s", datefmt="%H:%M:%S")
        )
    root = logging.getLogger("yahboomd")
    root.handlers[:] = [handler]
    root.setLevel(level.upper())
    root.propagate = False
    # asyncio reports what nobody caught; such a line must reach the same reader.
    logging.getLogger("asyncio").handlers[:] = [handler]


def _is_journal(environ: Mapping[str, str], stream: TextIO) -> bool:
    """Whether the stream is the very one that systemd connected to the journal."""
    try:
        device, inode = map(int, environ["JOURNAL_STREAM"].split(":"))
        status = os.fstat(stream.fileno())
    except (KeyError, ValueError, OSError):
        return False
    return (status.st_dev, status.st_ino) == (device, inode)
