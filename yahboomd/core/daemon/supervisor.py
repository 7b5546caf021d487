"""Keeps a session with the board: opens, serves, and after a fault tries again, for ever.

Nothing else reconnects. A missing port is looked for with bounded back-off; one fault is logged
once, and counted while it repeats.

With ``board.write_settings`` the profile, but for its motor or car type, is stored on the board
before each session, as ``yahboomd probe --write`` does it: the wheels at rest, value by value, each
read back. Nothing is written to a board that has the profile already.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import Counter
from collections.abc import Callable

from yahboomd.core.clock import Clock, nanoseconds, sleep_until
from yahboomd.core.errors import (
    BoardError,
    BoardStoresNothing,
    ConfigError,
    LinkError,
    PortDenied,
    YahboomdError,
)
from yahboomd.core.link.port import Opener, Port
from yahboomd.core.link.session import Session
from yahboomd.core.link.storing import Progress, StoringStep, store
from yahboomd.core.link.tap import NO_TAP, Tap
from yahboomd.core.model import Event
from yahboomd.core.protocol.settings import BoardSettings


def storing_opener(
    opener: Opener,
    clock: Clock,
    want: BoardSettings,
    publish: Callable[[Event], None],
    tap: Tap = NO_TAP,
) -> Opener:
    """An opener that stores the board's settings first.

    A value that cannot be stored ends the storing, not the session, which checks itself whether
    the wheels may turn.

    Args:
        publish: Receives an event for every value that was, or could not be, stored.
    """

    async def open_it() -> Port:
        # A board that stores nothing is sent its motors at each connection.
        with contextlib.suppress(BoardStoresNothing):
            await store(opener, clock, want, _Reported(publish), tap)
        return await opener()

    return open_it


class _Reported(Progress):
    def __init__(self, publish: Callable[[Event], None]) -> None:
        self._publish = publish

    def stored(self, step: StoringStep, has: BoardSettings) -> None:  # noqa: ARG002 (the seam's shape)
        what = step.write.text
        if step.outcome == "stored":
            words = f"Stored {what} in the board's flash (board.write_settings)."
            event = Event(kind="setting_stored", severity="info", message=words)
        else:
            said = f", which answered {step.answer!r}" if step.answer else ""
            words = f"The board does not store {what}{said}. Try `yahboomd probe --write`."
            event = Event(kind="setting_not_stored", severity="error", message=words)
        self._publish(event)


log = logging.getLogger(__name__)

BACK_OFF_S = (0.1, 0.2, 0.4, 0.8)
"""Waits between attempts. Looking for a port costs next to nothing, and wheels that turn while the
board is plugged in are stopped within a second of it, on a busy computer too."""

UNSEEN_S = 0.5
"""After a session of at least this time that left wheels not seen to stand, the port is
opened again without a wait: while it is closed no stop waits for an output that is held up, nor for
a board that is silent. It bounds the attempts to two a second."""

STEADY_S = 5.0
"""A session of this time was a good one: the next fault starts from the shortest wait."""


class Supervisor:
    """Runs sessions one after another.

    Args:
        unavailable: Called when an attempt to connect failed, or an open session ended.
    """

    def __init__(
        self,
        make_session: Callable[[], Session],
        clock: Clock,
        unavailable: Callable[[YahboomdError], None],
    ) -> None:
        self._make_session = make_session
        self._clock = clock
        self._unavailable = unavailable
        self._said: str | None = None
        self._denied = False
        self.session: Session | None = None
        self.left_standing = True
        """Whether the wheels were seen to stand at the end of the last session that moved them."""
        self.counters: Counter[str] = Counter()

    async def run(self) -> None:
        attempt = 0
        while True:
            started_ns = self._clock.now_ns()
            session = self.session = self._make_session()
            self.counters["attempts"] += 1
            try:
                await session.run()
            except (LinkError, BoardError, ConfigError) as error:
                self._unavailable(error)
                self._log_failure(error, was_connected=session.board is not None)
                if (task := asyncio.current_task()) is not None and task.cancelling():
                    # A task group that fails while it is cancelled reports only the failure.
                    raise asyncio.CancelledError from error
            finally:
                self._keep(session)
            lasted_ns = self._clock.now_ns() - started_ns
            if lasted_ns > nanoseconds(STEADY_S):
                attempt = 0
            if lasted_ns >= nanoseconds(UNSEEN_S) and not self.left_standing:
                continue
            wait_s = BACK_OFF_S[min(attempt, len(BACK_OFF_S) - 1)]
            attempt += 1
            await sleep_until(self._clock, self._clock.now_ns() + nanoseconds(wait_s))

    def status_values(self) -> dict[str, int]:
        facts = Counter(self.counters)
        if self.session is not None:
            facts.update(self.session.status_values())
        return dict(facts)

    def _keep(self, session: Session) -> None:
        self.counters.update(session.status_values())
        self.session = None
        if session.left_standing is not None:
            self.left_standing = session.left_standing
        if session.recognised:
            self.counters["sessions"] += 1

    def _log_failure(self, error: YahboomdError, *, was_connected: bool) -> None:
        words = str(error)
        # A port that was plugged in just now is root's alone until udev has set its group.
        just_there = isinstance(error, PortDenied) and not self._denied
        self._denied = isinstance(error, PortDenied)
        if just_there:
            log.debug("not yet: %s", words)
        elif was_connected:
            # `unavailable` logs that a session ended; from here on only news is logged.
            self._said = None
        elif words != self._said:
            self._said = words
            log.warning("%s yahboomd keeps trying.", words)
        else:
            self.counters["repeated_faults"] += 1
            log.debug("still: %s", words)
