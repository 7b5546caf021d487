"""Who hears what comes of the control path, and how much of it.

Estimates go straight to their readers; events pass a gate, for a fault may repeat faster than a
person reads.
"""

from __future__ import annotations

import logging
from collections import Counter
from typing import Protocol

from yahboomd.clock import Clock, nanoseconds
from yahboomd.model import Event, OdometryEstimate

log = logging.getLogger(__name__)

EVENTS_A_SECOND = 5
"""Of one kind; a fault that repeats, or a flood on purpose, must drown neither log nor bus."""


class Outputs(Protocol):
    """Who hears what comes of it."""

    def estimate(self, estimate: OdometryEstimate, command_m_s: tuple[float, ...]) -> None:
        """A new reading, and the rim speeds that were commanded."""
        ...

    def battery(self, volts: float) -> None:
        """The voltage of the motors' supply."""
        ...

    def event(self, event: Event) -> None:
        """Something happened."""
        ...

    def changed(self) -> None:
        """State, driver or reason may have changed."""
        ...


class Events:
    """Events on their way to the log and the bus.

    Args:
        clock: What tells the time.
        outputs: Hear them.
        counters: Where they are counted, and those that were kept back.
    """

    def __init__(self, clock: Clock, outputs: Outputs, counters: Counter[str]) -> None:
        self._clock = clock
        self._outputs = outputs
        self._counters = counters
        self._told: dict[str, tuple[int, int]] = {}

    def tell(self, event: Event) -> None:
        """Log and publish; of one kind not more than a few in a second, the rest is counted."""
        now_ns = self._clock.now_ns()
        since_ns, count = self._told.get(event.kind, (now_ns, 0))
        if now_ns - since_ns >= nanoseconds(1.0):
            since_ns, count = now_ns, 0
        self._told[event.kind] = (since_ns, count + 1)
        if count >= EVENTS_A_SECOND:
            self._counters["events_suppressed"] += 1
            return
        level = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}
        log.log(level[event.severity], "%s", event.message)
        self._counters["events"] += 1
        self._outputs.event(event)
        self._outputs.changed()
