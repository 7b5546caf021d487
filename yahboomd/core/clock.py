"""Clocks, alarms and schedules: the only file that reads the time.

Intervals and deadlines are integer monotonic nanoseconds (``CLOCK_MONOTONIC``); wall time is only
for outgoing samples. Everything that waits takes a :class:`Clock`, so that tests run on
virtual time.
"""

from __future__ import annotations

import asyncio
import ctypes
import os
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import NoReturn, Protocol

from yahboomd.core.model import NS_PER_S

if sys.version_info >= (3, 11):
    from asyncio import timeout as timeout  # noqa: PLC0414 - for others
else:
    import async_timeout

    @asynccontextmanager
    async def timeout(within_s: float | None) -> AsyncIterator[None]:
        """As ``asyncio.timeout`` of Python 3.11, for clients on 3.10: a built-in TimeoutError."""
        try:
            async with async_timeout.timeout(within_s):
                yield
        except asyncio.TimeoutError:
            raise TimeoutError from None


PAUSE_NS = 300_000_000
"""A gap this long means that the process did not run: no control loop is that late by itself."""

_TFD_TIMER_ABSTIME = 1


def seconds(ns: int) -> float:
    return ns / NS_PER_S


def nanoseconds(s: float) -> int:
    return round(s * NS_PER_S)


class Alarm(Protocol):
    """One deadline that calls back once; setting it again replaces it."""

    def set(self, deadline_ns: int | None) -> None:
        """Call back at ``deadline_ns`` (at once when that has passed); ``None``: not at all."""

    def put_off(self, deadline_ns: int) -> None:
        """Set a later deadline; for an alarm that is put off nearly every time before it rings."""

    def close(self) -> None:
        """Release the alarm's resources."""


class Clock(Protocol):
    """The time as the edges and the wiring see it."""

    def now_ns(self) -> int:
        """Monotonic nanoseconds."""

    def wall_ns(self) -> int:
        """Unix nanoseconds, for outgoing samples."""

    def suspended_ns(self) -> int:
        """Nanoseconds that the machine was suspended since its boot, which monotonic time omits."""

    def alarm(self, callback: Callable[[], None]) -> Alarm:
        """An alarm on the running loop that calls ``callback``."""


@dataclass(frozen=True, kw_only=True)
class Pause:
    """A time in which this process did not run.

    Attributes:
        since_ns: The latest moment when it was seen to run; monotonic nanoseconds.
        until_ns: The first moment when it was seen to run again.
        suspended_ns: How long the machine was suspended in between, which monotonic time omits.
    """

    since_ns: int
    until_ns: int
    suspended_ns: int

    @property
    def duration_s(self) -> float:
        return seconds(self.until_ns - self.since_ns + self.suspended_ns)


_HELD_UP_NS = 50_000_000
"""Two clocks cannot be read at once; shorter suspends are ignored."""


class PauseWatch:
    """Detects that this process did not run: stopped, frozen, starved, or suspended.

    All threads stand still then, so that those of a network library stamp data that waited in the
    kernel as if it had arrived just now. Only a gap between two moments at which the loop ran shows
    it. Call :meth:`detect` before handling anything that may have waited.

    Args:
        shortest_ns: A gap this long is a pause; the loop must run more often than that. May be
            changed.
    """

    def __init__(self, clock: Clock, shortest_ns: int = PAUSE_NS) -> None:
        self._clock = clock
        self.shortest_ns = shortest_ns
        self._ran_ns: int | None = None
        self._suspended_ns = 0

    def detect(self) -> Pause | None:
        """The pause that ended just now, returned once; ``None`` without one."""
        now_ns, suspended_ns = self._clock.now_ns(), self._clock.suspended_ns()
        before_ns, self._ran_ns = self._ran_ns, now_ns
        if before_ns is None:
            self._suspended_ns = suspended_ns
            return None
        # A reading can be too small if the process was held up between two clocks.
        grown_ns = max(0, suspended_ns - self._suspended_ns)
        self._suspended_ns += grown_ns
        if grown_ns < _HELD_UP_NS:
            grown_ns = 0
        if now_ns - before_ns + grown_ns < self.shortest_ns:
            return None
        return Pause(since_ns=before_ns, until_ns=now_ns, suspended_ns=grown_ns)


class Schedule:
    """Wakes at ``start + n * period``, without drift; missed beats are skipped."""

    def __init__(self, clock: Clock, period_ns: int) -> None:
        self._clock = clock
        self._period_ns = period_ns
        self._ringing: asyncio.Future[None] | None = None
        self._alarm = clock.alarm(self._ring)
        self._next_ns = clock.now_ns() + period_ns
        self._on_beat: Callable[[int], None] | None = None
        self._resting = False
        self.missed = 0
        self.late_ns = 0

    async def beat(self) -> int:
        """Wait for the next beat and return the time it was due; ``late_ns`` is its delay."""
        # A future costs half of what an asyncio.Event does, some hundred times a second.
        ringing = self._ringing = asyncio.get_running_loop().create_future()
        self._alarm.set(self._next_ns)
        await ringing
        return self._counted()

    async def run(self, on_beat: Callable[[int], None]) -> NoReturn:
        """Call back at each beat with the time it was due, until cancelled; then close.

        The callback runs in the loop's iteration that the timer woke; a coroutine that waits for
        :meth:`beat` continues in the next one.

        Raises:
            Exception: Any exception of the callback.
        """
        self._on_beat = on_beat
        self._ringing = asyncio.get_running_loop().create_future()
        self._alarm.set(self._next_ns)
        try:
            await self._ringing
        finally:
            self.close()
        raise AssertionError

    def rest(self, until_ns: int) -> None:
        """Skip the beats before that moment; called in a beat."""
        beats = max(0, -((self._next_ns - until_ns) // self._period_ns))
        self._next_ns += beats * self._period_ns
        self._resting = beats > 0

    def wake(self) -> None:
        """End a rest: the next beat is the next one of the schedule."""
        if self._resting:
            self._resting = False
            beats = max(0, (self._next_ns - self._clock.now_ns()) // self._period_ns)
            self._next_ns -= beats * self._period_ns
            self._alarm.set(self._next_ns)

    def advance(self, now_ns: int) -> None:
        if self._on_beat is not None:
            self._resting = False
            self._next_ns = now_ns + self._period_ns
            self._on_beat(now_ns)
            self._alarm.put_off(self._next_ns)

    def close(self) -> None:
        self._alarm.close()

    def _counted(self) -> int:
        due_ns, self._resting = self._next_ns, False
        self.late_ns = self._clock.now_ns() - due_ns
        skipped = max(0, self.late_ns // self._period_ns)
        self.missed += skipped
        self._next_ns = due_ns + (skipped + 1) * self._period_ns
        return due_ns

    def _ring(self) -> None:
        ringing, on_beat = self._ringing, self._on_beat
        if ringing is None or ringing.done():
            return
        if on_beat is None:
            ringing.set_result(None)
            return
        try:
            on_beat(self._counted())
        except Exception as error:  # noqa: BLE001 - raised again by the await
            ringing.set_exception(error)
        else:
            self._alarm.set(self._next_ns)


async def sleep_until(clock: Clock, deadline_ns: int) -> None:
    """Return at ``deadline_ns``, or in the loop's next iteration if that has passed."""
    event = asyncio.Event()
    alarm = clock.alarm(event.set)
    try:
        alarm.set(deadline_ns)
        await event.wait()
    finally:
        alarm.close()


class LoopAlarm:
    """An alarm on the timers of the running event loop."""

    def __init__(self, callback: Callable[[], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._callback = callback
        self._handle: asyncio.TimerHandle | None = None

    def set(self, deadline_ns: int | None) -> None:
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None
        if deadline_ns is not None:
            self._handle = self._loop.call_at(deadline_ns / NS_PER_S, self._callback)

    def put_off(self, deadline_ns: int) -> None:
        self.set(deadline_ns)

    def close(self) -> None:
        self.set(None)


class _ITimerSpec(ctypes.Structure):
    _fields_ = (
        ("interval_s", ctypes.c_long),
        ("interval_ns", ctypes.c_long),
        ("value_s", ctypes.c_long),
        ("value_ns", ctypes.c_long),
    )


class _KernelAlarm:
    """A timerfd: the event loop's own timers wait in whole milliseconds.

    Error from the deadline at the median: 0.65 ms with ``call_at``, 0.07 ms here. (Python has
    ``os.timerfd_create`` from 3.13 on; the oldest that we run on is 3.11, hence ctypes.)
    """

    def __init__(self, libc: ctypes.CDLL, callback: Callable[[], None]) -> None:
        self._callback = callback
        self._loop = asyncio.get_running_loop()
        self._fd = libc.timerfd_create(time.CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC)
        if self._fd < 0:
            raise OSError(ctypes.get_errno(), "timerfd_create failed")
        self._loop.add_reader(self._fd, self._ring)
        self._settime = libc.timerfd_settime
        self._spec = _ITimerSpec(0, 0, 0, 0)
        self._spec_reference = ctypes.byref(self._spec)
        self._armed_ns: int | None = None
        self._deadline_ns: int | None = None

    def set(self, deadline_ns: int | None) -> None:
        # Most deadlines are put off before they come: the kernel need not know of it.
        self._deadline_ns = deadline_ns
        if deadline_ns is not None and (self._armed_ns is None or deadline_ns < self._armed_ns):
            self._arm(deadline_ns)

    def put_off(self, deadline_ns: int) -> None:
        # Setting the timer costs a twentieth of what a needless wake-up does.
        self._deadline_ns = deadline_ns
        self._arm(deadline_ns)

    def _arm(self, deadline_ns: int) -> None:
        self._armed_ns = deadline_ns
        # A deadline in the past rings at once; zero would disarm.
        self._spec.value_s, self._spec.value_ns = divmod(max(1, deadline_ns), NS_PER_S)
        self._settime(self._fd, _TFD_TIMER_ABSTIME, self._spec_reference, None)

    def _ring(self) -> None:
        try:
            os.read(self._fd, 8)
        except BlockingIOError:
            return  # it was set again since the kernel's report
        self._armed_ns = None
        deadline_ns = self._deadline_ns
        if deadline_ns is None:
            return
        if deadline_ns > time.monotonic_ns():
            self._arm(deadline_ns)
            return
        self._deadline_ns = None
        self._callback()

    def close(self) -> None:
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            os.close(self._fd)
            self._fd = -1


class SystemClock:
    """The machine's clocks, and alarms of the kernel's: of Linux, elsewhere of the event loop."""

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True) if hasattr(time, "CLOCK_BOOTTIME") else None

    now_ns = staticmethod(time.monotonic_ns)
    """Nanoseconds of CLOCK_MONOTONIC."""

    wall_ns = staticmethod(time.time_ns)
    """Unix nanoseconds."""

    def suspended_ns(self) -> int:
        """CLOCK_BOOTTIME less CLOCK_MONOTONIC, which stops in a suspend; never too large."""
        # On macOS CLOCK_MONOTONIC goes on and Python's monotonic time stops; on Windows both go on.
        on = getattr(time, "CLOCK_BOOTTIME", getattr(time, "CLOCK_MONOTONIC", None))
        return 0 if on is None else time.clock_gettime_ns(on) - time.monotonic_ns()

    def alarm(self, callback: Callable[[], None]) -> Alarm:
        """A timerfd that calls back; without a free descriptor, a timer of the loop."""
        if self._libc is not None:
            with suppress(OSError):
                return _KernelAlarm(self._libc, callback)
        # It waits in whole milliseconds, which is better than no control of the wheels.
        return LoopAlarm(callback)
