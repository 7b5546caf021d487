"""The button that lets a robot move: a press counts for 0.3 s, so it has to be held."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from yahboomd.core.clock import seconds

if TYPE_CHECKING:
    from collections.abc import Callable

    from yahboomd.core.clock import Clock

HOLD_NS = 300_000_000
"""So long one message counts that the button is held."""


class HeldButton:
    """One button. Once it was let go, it counts again only for the next movement.

    Args:
        clock: Of ``CLOCK_MONOTONIC``, which all processes of a machine share.
    """

    def __init__(self, clock: Clock, stop: Callable[[], None]) -> None:
        self._clock = clock
        self._stop = stop
        self._until_ns = 0
        self._let_go = True
        self._pressed = asyncio.Event()

    def offer(self) -> None:
        """The next movement may begin: what was pressed before does not count for it."""
        self._until_ns = 0
        self._let_go = False
        self._pressed.clear()

    async def pressed(self) -> None:
        """Wait until it is held."""
        await self._pressed.wait()

    def press(self, at_ns: int) -> None:
        """It was held at a moment; of older moments than 0.3 s, and future ones, nothing counts."""
        now_ns = self._clock.now_ns()
        if self._until_ns and now_ns >= self._until_ns:
            self._let_go = True
        if self._let_go or not 0 <= now_ns - at_ns < HOLD_NS:
            return
        self._until_ns = max(self._until_ns, at_ns + HOLD_NS)
        self._pressed.set()

    def release(self) -> None:
        """It was let go: the robot stops now."""
        if not self._let_go and self._until_ns:
            self._let_go = True
            self._stop()

    def left_s(self) -> float:
        """How long the robot may still move, in seconds; 0 once it was let go."""
        left_ns = self._until_ns - self._clock.now_ns()
        if left_ns <= 0:
            self._let_go = True
        return 0.0 if self._let_go else seconds(left_ns)
