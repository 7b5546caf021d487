"""Judges whether the battery is too low to go on, by its voltage at rest.

Motors pull the voltage down, so only readings of a resting robot count, and the median of 30 s of
rest is judged. Several short rests are judged together.
"""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import Literal, TypeAlias

from yahboomd.core.model import NS_PER_S, Event

Level: TypeAlias = Literal["", "good", "low", "empty"]
"""Empty text: not known."""

REST_NS = 30 * NS_PER_S
RECOVERS_NS = 2 * NS_PER_S
"""For this time after motion a battery's voltage rises."""

BETWEEN_READINGS_NS = NS_PER_S

LEAST_READINGS = 3

NO_BATTERY_V = 1.0
"""Less comes from no battery: the supply is switched off, or being exchanged."""

BETTER = 1.03
"""The voltage rises by this factor above a limit before the battery counts as better again."""

CRAWL_M_S = 0.1
"""The speed at which a person may drive on an empty battery."""


class BatteryWatch:
    """Judges the voltage.

    Args:
        low_v: Below it the battery is low; None for never.
        stop_v: Below it the battery is empty, and programs begin no motion; None for never.
    """

    def __init__(self, low_v: float | None = None, stop_v: float | None = None) -> None:
        self._low_v = low_v
        self._stop_v = stop_v
        self._used_ns = 0
        self.forget()

    def forget(self) -> None:
        """Forget everything, because the board may come back with another battery."""
        self.level: Level = ""
        self.median_v: float | None = None
        self._readings: deque[tuple[int, float]] = deque()
        self._rested_ns = 0
        self._resting_since_ns: int | None = None

    def moves(self, now_ns: int) -> None:
        self._resting_since_ns = now_ns + RECOVERS_NS

    def read(self, volts: float, now_ns: int) -> Event | None:
        """Judge a reading; returns the event that follows from it."""
        if self._low_v is None and self._stop_v is None:
            return None
        since_ns = self._resting_since_ns
        if since_ns is None:
            self._resting_since_ns = now_ns
        elif now_ns > since_ns:
            self._rested_ns += now_ns - since_ns
            self._resting_since_ns = now_ns
        else:
            return None
        readings, used_ns = self._readings, self._used_ns
        if volts < NO_BATTERY_V or (readings and now_ns - used_ns < BETWEEN_READINGS_NS):
            return None
        self._used_ns = now_ns
        readings.append((self._rested_ns, volts))
        while len(readings) > LEAST_READINGS and readings[0][0] < self._rested_ns - REST_NS:
            readings.popleft()
        if self._rested_ns < REST_NS or len(readings) < LEAST_READINGS:
            return None
        self.median_v = median(volts for _, volts in readings)
        before, self.level = self.level, self._judged(self.median_v)
        return self._event(before)

    def refuses(self, source: str, persons: tuple[str, ...]) -> str:
        """The reason why a source begins no motion; empty if it may."""
        return "" if source in persons else self.words

    @property
    def words(self) -> str:
        """The state in a sentence; empty unless the battery is empty."""
        if self.level != "empty":
            return ""
        return (
            f"The battery is empty: {self.median_v:.1f} V at rest, less than board.battery_stop_v "
            f"= {self._stop_v:g}. Programs begin no motion; by keyboard or page it drives at "
            f"{CRAWL_M_S:g} m/s."
        )

    def _judged(self, volts: float) -> Level:
        """The level, with a margin against changing back and forth."""
        for level, limit, was in (
            ("empty", self._stop_v, self.level == "empty"),
            ("low", self._low_v, self.level in ("empty", "low")),
        ):
            if limit is not None and volts < (limit * BETTER if was else limit):
                return "empty" if level == "empty" else "low"
        return "good"

    def _event(self, before: Level) -> Event | None:
        volts = f"{self.median_v:.1f} V at rest"
        match self.level:
            case level if level == before:
                return None
            case "empty":
                return Event(kind="battery_empty", severity="error", message=self.words)
            case "low":
                words = f"The battery is low: {volts}, limit {self._low_v:g} V. Charge it soon."
                return Event(kind="battery_low", severity="warning", message=words)
        if not before:
            return None
        words = f"The battery is good again: {volts}."
        return Event(kind="battery_good", severity="info", message=words)
