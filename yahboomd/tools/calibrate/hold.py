"""The button that lets a robot move: a press counts for 0.3 s, so it has to be held."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from yahboomd.core.clock import seconds

if TYPE_CHECKING:
    from collections.abc import Callable

    from yahboomd.core.clock import Clock

HOLD_NS = 300_000_000
"""How long one message counts as a held button."""


class HeldButton:
    """One button. Once released, it counts again only for the next movement.

    Args:
        clock: A ``CLOCK_MONOTONIC`` clock, which all processes of a machine share.
    """

    def __init__(self, clock: Clock, stop: Callable[[], None]) -> None:
        self._clock = clock
        self._stop = stop
        self._until_ns = 0
        self._let_go = True
        self._pressed = asyncio.Event()

    def offer(self) -> None:
        """Offer the next movement; earlier presses do not count for it."""
        self._until_ns = 0
        self._let_go = False
        self._pressed.clear()

    async def pressed(self) -> None:
        """Wait until it is held."""
        await self._pressed.wait()

    def press(self, at_ns: int) -> None:
        """The button was held at this moment; ignored if older than 0.3 s, or in the future."""
        now_ns = self._clock.now_ns()
        if self._until_ns and now_ns >= self._until_ns:
            self._let_go = True
        if self._let_go or not 0 <= now_ns - at_ns < HOLD_NS:
            return
        self._until_ns = max(self._until_ns, at_ns + HOLD_NS)
        self._pressed.set()

    def release(self) -> None:
        """The button was released: stop the robot now."""
        if not self._let_go and self._until_ns:
            self._let_go = True
            self._stop()

    def left_s(self) -> float:
        """How long the robot may still move, in seconds; 0 once the button was released."""
        left_ns = self._until_ns - self._clock.now_ns()
        if left_ns <= 0:
            self._let_go = True
        return 0.0 if self._let_go else seconds(left_ns)
