"""A clock that is moved by hand and a port that remembers, for the writer's rules."""

from __future__ import annotations

from collections.abc import Callable

import pytest


class HandAlarm:
    def __init__(self, callback: Callable[[], None]) -> None:
        self.callback = callback
        self.deadline_ns: int | None = None

    def set(self, deadline_ns: int | None) -> None:
        self.deadline_ns = deadline_ns

    def close(self) -> None:
        self.deadline_ns = None


class HandClock:
    """Time stands until a test moves it; alarms ring on the way."""

    def __init__(self) -> None:
        self.ns = 1_000_000_000
        self.alarms: list[HandAlarm] = []

    def now_ns(self) -> int:
        return self.ns

    def wall_ns(self) -> int:
        return self.ns

    def alarm(self, callback: Callable[[], None]) -> HandAlarm:
        alarm = HandAlarm(callback)
        self.alarms.append(alarm)
        return alarm

    def advance(self, ms: float) -> None:
        end_ns = self.ns + round(ms * 1_000_000)
        while True:
            due = [a for a in self.alarms if a.deadline_ns is not None and a.deadline_ns <= end_ns]
            if not due:
                break
            alarm = min(due, key=lambda a: a.deadline_ns or 0)
            self.ns = max(self.ns, alarm.deadline_ns or 0)
            alarm.deadline_ns = None
            alarm.callback()
        self.ns = end_ns


class RecordingPort:
    """Takes everything, and remembers when."""

    name = "/dev/remembers"
    byte_ns = 86_805

    def __init__(self, clock: HandClock) -> None:
        self._clock = clock
        self.waiting = 0
        self.sent: list[tuple[int, bytes]] = []

    def queued(self) -> int:
        return self.waiting

    def write(self, data: bytes) -> None:
        self.sent.append((self._clock.ns, data))

    @property
    def frames(self) -> list[bytes]:
        return [data for _, data in self.sent]


@pytest.fixture
def clock() -> HandClock:
    return HandClock()


@pytest.fixture
def port(clock: HandClock) -> RecordingPort:
    return RecordingPort(clock)
