"""Reports of a stop wait until the stop has left this machine, or cannot.

A stop may wait for the distance between two frames, 20 ms at most, and on a port that takes no
output for as long as that lasts. A process that is killed meanwhile sends nothing any more, so
no answer, event or state shows the stop before.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import NamedTuple

from yahboomd.core.clock import Clock, nanoseconds

WITHIN_S = 0.5
"""The longest that a report waits, while this process runs."""

LOOK_NS = 1_000_000
LATE_NS = 50_000_000
"""If a look comes later, this process did not run, and could not send either."""


class _Report(NamedTuple):
    until_ns: int
    tell: Callable[[str], None]
    news: bool


class StopReports:
    """Reports that wait for a stop.

    Args:
        outcome: Empty once the latest stop has left this machine; the reason why it cannot be
            sent, as a clause after "because"; None while it may still be sent.
    """

    def __init__(self, clock: Clock, outcome: Callable[[], str | None]) -> None:
        self._clock = clock
        self._outcome = outcome
        self._reports: list[_Report] = []
        self._looked_ns = 0
        self._alarm = clock.alarm(self._settle)

    @property
    def waiting(self) -> bool:
        return any(report.news for report in self._reports)

    def announce(self, tell: Callable[[str], None], *, news: bool = True) -> None:
        """Call ``tell`` when the stop was sent, or cannot be; at once if that is known now.

        Args:
            tell: Takes a sentence on why the stop was not sent; empty if it was.
            news: The robot was not stopped before.
        """
        self._settle()
        self._reports.append(_Report(self._looked_ns + nanoseconds(WITHIN_S), tell, news))
        self._settle()

    async def sent(self) -> str:
        """Wait for the stop; return an empty text if it was sent, else a sentence on the reason."""
        outcome: asyncio.Future[str] = asyncio.get_running_loop().create_future()

        def tell(problem: str) -> None:
            if not outcome.done():
                outcome.set_result(problem)

        self.announce(tell, news=False)
        return await outcome

    def close(self) -> None:
        """Settle all reports with the present outcome, and release the timer."""
        self._settle(ends=True)
        self._alarm.close()

    def _settle(self, *, ends: bool = False) -> None:
        outcome, now_ns = self._outcome(), self._clock.now_ns()
        late_ns, self._looked_ns = now_ns - self._looked_ns - LATE_NS, now_ns
        if late_ns > 0:
            self._reports = [e._replace(until_ns=e.until_ns + late_ns) for e in self._reports]
        if outcome is None:
            outcome = f"the port has not taken it within {WITHIN_S:g} s"
            due = [each for each in self._reports if ends or now_ns >= each.until_ns]
        else:
            due = self._reports
        self._reports = [] if due is self._reports else [e for e in self._reports if e not in due]
        self._alarm.set(now_ns + LOOK_NS if self._reports else None)
        problem = f"It could not be sent, because {outcome.rstrip('.')}." if outcome else ""
        for report in due:
            report.tell(problem)
