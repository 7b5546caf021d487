"""Stores the profile on the board before a session begins, where the configuration says so.

What differs is stored as ``yahboomd probe --write`` does it: the wheels at rest, value by value,
each read back. A board that stores the profile already is written nothing.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from yahboomd.clock import Clock
from yahboomd.errors import BoardStoresNothing
from yahboomd.link.flash import Progress, Step, store
from yahboomd.link.port import Port
from yahboomd.link.session import Opener
from yahboomd.model import Event
from yahboomd.protocol.settings import BoardSettings


def storing_opener(
    opener: Opener, clock: Clock, want: BoardSettings, tell: Callable[[Event], None]
) -> Opener:
    """An opener that sees to the board's settings first.

    A value that cannot be stored ends the storing, not the session: that looks for itself whether
    the wheels may turn.

    Args:
        opener: Opens the port.
        clock: What tells the time.
        want: What the board shall store.
        tell: Hears of every value that was, or could not be, stored.
    """

    async def open_it() -> Port:
        # A board that stores nothing is sent its motors at each connection.
        with contextlib.suppress(BoardStoresNothing):
            await store(opener, clock, want, _Told(tell))
        return await opener()

    return open_it


class _Told(Progress):
    def __init__(self, tell: Callable[[Event], None]) -> None:
        self._tell = tell

    def step(self, step: Step, has: BoardSettings) -> None:  # noqa: ARG002 (the seam's shape)
        frame = step.write.frame.decode("ascii")
        if step.outcome == "stored":
            words = f"Stored {frame} in the board's flash (board.write_settings)."
            event = Event(kind="setting_stored", severity="info", message=words)
        else:
            said = f", which said {step.answer!r}" if step.answer else ""
            words = f"The board does not store {frame}{said}. Try `yahboomd probe --write`."
            event = Event(kind="setting_not_stored", severity="error", message=words)
        self._tell(event)
