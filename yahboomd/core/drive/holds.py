"""Holds: reasons for which the robot stands although a source commands it, each with its own end.

A hold is data. The part of the program that knows the reason adds it; that part or time removes it.
While any is active the wheels stand.
"""

from __future__ import annotations

from collections import deque

import msgspec

from yahboomd.core.model import NS_PER_S

WAITING_FOR_BOARD = "waiting_for_board"
"""No board, or not recognised yet."""
BOARD_RESET = "board_reset"
"""The board reset itself a moment ago."""
BOARD_UNFIT = "board_unfit"
"""The board's settings would make wheels run away; ends when it is connected with better ones."""
UNGUARDED = "unguarded"
"""No guard has the port; ends once one has."""
LINE_NOISY = "line_noisy"
"""A wheel did not follow its command, on a line that damages bytes; ends by itself."""
NOT_STARTED = "not_started"
"""A wheel did not begin to turn; ends with that command, or with a faster one."""
FAULT = "fault"
"""Something is broken; only a person ends this one."""


class Hold(msgspec.Struct, frozen=True, kw_only=True):
    """One reason to stand.

    Attributes:
        kind: A stable word; one hold of each kind exists at a time.
        message: A sentence for a person.
        since_ns: When it began; monotonic nanoseconds.
        until_ns: When it ends by itself; ``None``: it does not.
    """

    kind: str
    message: str
    since_ns: int
    until_ns: int | None = None


class Holds:
    """The holds in force."""

    def __init__(self) -> None:
        self._holds: dict[str, Hold] = {}

    def add(self, hold: Hold) -> None:
        """Add a hold. It replaces one of the same kind, but keeps its beginning."""
        before = self._holds.get(hold.kind)
        if before is not None and (before.until_ns is None or before.until_ns > hold.since_ns):
            hold = msgspec.structs.replace(hold, since_ns=before.since_ns)
        self._holds[hold.kind] = hold

    def drop(self, kind: str) -> bool:
        """Remove a reason. Returns whether it was there."""
        return self._holds.pop(kind, None) is not None

    def has(self, kind: str) -> bool:
        """Whether this reason is in force, or ended since the last call."""
        return kind in self._holds

    def active(self, now_ns: int) -> tuple[Hold, ...]:
        """The holds in force at ``now_ns``, the oldest first; removes those that ended."""
        if not self._holds:
            return ()
        over = [
            kind
            for kind, hold in self._holds.items()
            if hold.until_ns is not None and hold.until_ns <= now_ns
        ]
        for kind in over:
            del self._holds[kind]
        return tuple(sorted(self._holds.values(), key=lambda hold: hold.since_ns))


STAND_NS = NS_PER_S
"""The time for which the robot stands after a reset while the wheels turned."""

MOST_RESETS = 3
WITHIN_S = 10
"""This number of resets within this time is a fault."""


class ResetWatch:
    """Finds the consequence of a board's resets: a pause after one in motion, a fault after many.

    Otherwise a board that resets itself under load (a weak battery, a loose plug) would be driven
    into the next brown-out at once, for ever.
    """

    def __init__(self) -> None:
        self._resets: deque[int] = deque(maxlen=MOST_RESETS)

    def reset(self, now_ns: int, *, in_motion: bool) -> Hold | None:
        self._resets.append(now_ns)
        if len(self._resets) == MOST_RESETS and now_ns - self._resets[0] <= WITHIN_S * NS_PER_S:
            words = (
                f"The board reset itself {len(self._resets)} times within {WITHIN_S} s: check the "
                "battery, the plugs and the motor currents."
            )
            return Hold(kind=FAULT, message=words, since_ns=now_ns)
        if not in_motion:
            return None
        words = "The board reset itself in motion; standing before anything moves again."
        until_ns = now_ns + STAND_NS
        return Hold(kind=BOARD_RESET, message=words, since_ns=now_ns, until_ns=until_ns)

    def clear(self) -> None:
        """Forget past resets, after a person looked into them."""
        self._resets.clear()
