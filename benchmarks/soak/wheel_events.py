"""Checks events about wheels against the ground truth."""

from __future__ import annotations

import math
from collections.abc import Iterable

from yahboomd.core.messages.native import EventSample
from yahboomd.core.model import STANDING_M_S
from yahboomd.simulation.truth import TruthSample

ALARMS = ("runaway_against", "runaway_fast", "no_counts")
"""Events that cut the motors until a person clears the fault."""

LATELY_NS = 300_000_000
WHEELS = ("left", "right")


def shown(event: EventSample, truth: Iterable[TruthSample], event_ns: int) -> bool:
    """Whether a wheel really moved as the event reports.

    On a noisy line the board obeys a garbled speed and misses a lost one: then a wheel does turn
    against its command, or stands.

    Args:
        event: One of :data:`ALARMS`.
        truth: The ground truth since :data:`LATELY_NS` before it.
        event_ns: When it was published, monotonic.
    """
    data = event.data or {}
    wish = float(data.get("commanded_m_s") or 0.0)
    seen = float(data.get("measured_m_s") or 0.0)
    lately = [
        speed
        for sample in truth
        if sample.t_ns <= event_ns
        for name, speed in zip(WHEELS, sample.speed_m_s, strict=True)
        if event.wheel in {None, name}
    ]
    if event.kind == "no_counts":
        return min(map(abs, lately), default=math.inf) < STANDING_M_S
    most = max((speed * math.copysign(1.0, seen) for speed in lately), default=0.0)
    against = wish * seen < 0.0 and most > STANDING_M_S
    return against or most > 1.5 * abs(wish) + 0.1
