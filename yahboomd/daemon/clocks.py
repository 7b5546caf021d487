"""Tells once that the clock of a source of commands is off: no one looks at counters until then."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from yahboomd.clock import nanoseconds
from yahboomd.model import Event

QUIET_S = 60.0
"""A clock that was right for so long, and is off again, is news. One that hovers is not."""


class ClockWatch:
    """Makes events of the warnings that hold.

    Args:
        warnings: What holds at a moment, by source.
        tell: Takes the events.
    """

    def __init__(
        self, warnings: Callable[[int], Mapping[str, str]], tell: Callable[[Event], None]
    ) -> None:
        self._warnings = warnings
        self._tell = tell
        self._seen_ns: dict[str, int] = {}

    def look(self, now_ns: int) -> None:
        """Look at the warnings of this moment; called now and then."""
        for source, words in self._warnings(now_ns).items():
            seen_ns = self._seen_ns.get(source)
            self._seen_ns[source] = now_ns
            if seen_ns is None or now_ns - seen_ns > nanoseconds(QUIET_S):
                event = Event(
                    kind="clock_offset",
                    severity="warning",
                    message=f"{source}: {words}",
                    data={"source": source},
                )
                self._tell(event)
