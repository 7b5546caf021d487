"""The voltage of the motors' supply: asked for as often as it is answered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from yahboomd.clock import Clock, nanoseconds, sleep_until
from yahboomd.link.writer import Writer
from yahboomd.model import Event
from yahboomd.protocol.dialect import Battery

ANSWER_S = 0.3
SELDOM_S = 120.0
"""A board that does not answer is asked at least so often."""
UNANSWERED = 3
"""After so many questions in a row without an answer a person should know."""


class BatteryQuestions:
    """Asks for the voltage; less and less often while no answer comes.

    Args:
        writer: Sends the question.
        clock: What tells the time.
        frame: The question.
        period_s: How often it is asked.
        port_name: For messages.
        on_event: Takes the event of a board that does not answer.
    """

    def __init__(
        self,
        writer: Writer,
        clock: Clock,
        frame: bytes,
        *,
        period_s: float,
        port_name: str,
        on_event: Callable[[Event], None],
    ) -> None:
        self._writer = writer
        self._clock = clock
        self._frame = frame
        self._period_s = period_s
        self._port_name = port_name
        self._on_event = on_event
        self._answered = False
        self.counters: Counter[str] = Counter()

    def answered(self) -> None:
        """The board said its voltage, asked or unasked, late or in time."""
        self._answered = True

    async def run(self) -> None:
        """Ask until cancelled."""
        wait_s = self._period_s
        unanswered = 0
        while True:
            await self._writer.request(
                self._frame, lambda said: isinstance(said, Battery), ANSWER_S
            )
            await sleep_until(self._clock, self._clock.now_ns() + nanoseconds(wait_s))
            # An answer that came late is one as well.
            if self._answered:
                self._answered, unanswered, wait_s = False, 0, self._period_s
                continue
            self.counters["battery_unanswered"] += 1
            unanswered += 1
            wait_s = max(self._period_s, min(2.0 * wait_s, SELDOM_S))
            if unanswered == UNANSWERED:
                self._on_event(_no_voltage(self._port_name))


def _no_voltage(port: str) -> Event:
    words = (
        f"{port}: the board left {UNANSWERED} questions for the battery voltage in a row "
        "unanswered. The voltage is unknown; yahboomd asks less often, down to once in "
        f"{SELDOM_S:.0f} s. Where the board has no voltage to tell, set "
        "board.battery_period_s = 0."
    )
    return Event(kind="battery_unanswered", severity="warning", message=words)
