"""A fault that comes again and again is logged some times, then counted.

A board whose supply sags resets every second, for hours; each reset has three lines to say. The
journal of a robot lies on an SD card.
"""

from __future__ import annotations

import logging
import re
from collections import OrderedDict

WRITTEN = 5
"""So many lines of a kind are written within a window."""

WINDOW_S = 60.0

KINDS = 200
"""So many kinds are remembered; the one that was longest away is forgotten first."""

_NUMBER = re.compile(r"\d+(?:\.\d+)?")


class RepeatFilter(logging.Filter):
    """Lets some lines of a kind through in each minute, and says how many it did not.

    Lines are of a kind when they differ in their numbers only. Time is the record's own; DEBUG is
    for a person who wants every line.
    """

    def __init__(self) -> None:
        super().__init__()
        self._kinds: OrderedDict[str, _Kind] = OrderedDict()

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the line is written; one that stands for others says so."""
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
