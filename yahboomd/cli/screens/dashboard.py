"""What a person who watches a daemon wants to know, put together from its samples.

Pure: samples and times in, a :class:`~yahboomd.cli.screens.view.View` out. How it is drawn is the
matter of other files.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

import msgspec

from yahboomd.bus import keys
from yahboomd.cli.screens.rates import Rate, Rise, Scale
from yahboomd.cli.screens.view import LINK_COUNTS, REFUSALS, Count, EventView, View, WheelView
from yahboomd.client.streams import read_sample
from yahboomd.messages.native import (
    BatterySample,
    EventSample,
    PoseSample,
    StatusSample,
    TwistSample,
    WheelsSample,
)

Message = TypeVar("Message", bound=msgspec.Struct)

NS_PER_S = 1_000_000_000

STALE_NS = 2 * NS_PER_S
"""A daemon tells its status twice a second; after four of them it is gone, or stuck."""

LATE_NS = NS_PER_S
"""Pose, twist and wheels come for every reading; older than this they are no present any more."""

MAX_EVENTS = 200
MAX_TRAIL = 4096


class Dashboard:
    """Takes samples as they arrive, and tells what they amount to.

    All times are monotonic nanoseconds of the watching program, except for the stamps of samples,
    which are compared with each other alone: the daemon's clock may be another machine's.
    """

    def __init__(self) -> None:
        self._pose: PoseSample | None = None
        self._pose_ns = 0
        self._twist: TwistSample | None = None
        self._wheels: WheelsSample | None = None
        self._volts: float | None = None
        self._status: StatusSample | None = None
        self._status_ns = 0
        self._driver_since_ns = 0
        self._driver_seen_to_begin = False
        self._events: deque[tuple[EventSample, int]] = deque(maxlen=MAX_EVENTS)
        self._new_events: deque[tuple[EventSample, int]] = deque(maxlen=MAX_EVENTS)
        self._trail: deque[tuple[float, float]] = deque(maxlen=MAX_TRAIL)
        self._scale = Scale(smallest=0.1)
        self._poses = Rate()
        self._readings = Rate()
        self._commands = Rate()
        self._rises: dict[str, Rise] = {}
        self._unreadable = 0

    def take(self, key: str, payload: bytes, now_ns: int) -> None:
        """A sample arrived on ``key``; samples of other keys are ignored.

        Of pose, twist and wheels some may be left out: their numbers tell how many there were.
        """
        if key == keys.STATUS:
            self._take_status(payload, now_ns)
        elif key == keys.EVENTS:
            if (event := self._read(payload, EventSample)) is not None:
                self._events.append((event, now_ns))
                self._new_events.append((event, now_ns))
        elif key == keys.POSE:
            pose = self._read(payload, PoseSample)
            if pose is not None and self._finite(pose.x, pose.y, pose.theta, *pose.covariance):
                self._take_pose(pose, now_ns)
        elif key == keys.TWIST:
            twist = self._read(payload, TwistSample)
            if twist is not None and self._finite(twist.vx, twist.vy, twist.wz):
                self._twist = twist
        elif key == keys.WHEELS:
            wheels = self._read(payload, WheelsSample)
            if wheels is not None and self._finite(*wheels.speed_m_s, *wheels.command_m_s):
                self._wheels = wheels
                self._scale.see(*wheels.speed_m_s, *wheels.command_m_s, now_ns=now_ns)
        elif key == keys.BATTERY and (battery := self._read(payload, BatterySample)) is not None:
            self._volts = battery.volts

    def view(self, now_ns: int, *, connected: bool = True) -> View:
        """How things look at ``now_ns``.

        Args:
            now_ns: Monotonic nanoseconds of the watching program.
            connected: Whether there is a connection that samples could come over.
        """
        events = _event_views(self._events, now_ns)
        status = self._status
        if status is None:
            return View(phase="waiting", events=events, unreadable=self._unreadable)
        silent_ns = now_ns - self._status_ns
        pose = self._pose
        # In between two of them, the status ages with the watcher's clock.
        state_ns = status.stamp_ns - status.since_ns + silent_ns
        return View(
            phase="live" if connected and silent_ns <= STALE_NS else "silent",
            silent_s=silent_ns / NS_PER_S,
            status=status,
            state_s=max(0, state_ns) / NS_PER_S,
            driver_s=(now_ns - self._driver_since_ns) / NS_PER_S,
            driver_at_least=not self._driver_seen_to_begin,
            pose=pose,
            sigma=None if pose is None else _sigma(pose),
            twist=self._twist,
            wheels=self._wheel_views(),
            late=pose is not None and now_ns - self._pose_ns > LATE_NS,
            poses_per_s=self._poses.per_s(now_ns),
            full_scale_m_s=self._scale.full,
            volts=self._volts,
            readings_per_s=self._readings.per_s(now_ns),
            commands_per_s=self._commands.per_s(now_ns),
            link=self._counts(LINK_COUNTS, {**status.command, **status.link}, now_ns),
            refusals=self._counts(
                {words: (reason,) for reason, words in REFUSALS.items()}, status.command, now_ns
            ),
            events=events,
            trail=tuple(self._trail),
            unreadable=self._unreadable,
        )

    def new_events(self, now_ns: int) -> tuple[EventView, ...]:
        """What happened since this was asked before."""
        events = _event_views(self._new_events, now_ns)
        self._new_events.clear()
        return events

    def _take_status(self, payload: bytes, now_ns: int) -> None:
        status = self._read(payload, StatusSample)
        if status is None:
            return
        before = self._status
        if before is None or before.driver != status.driver:
            self._driver_since_ns = now_ns
            self._driver_seen_to_begin = before is not None
        self._status, self._status_ns = status, now_ns
        self._readings.total(_number(status.link, "readings"), now_ns)
        self._commands.total(_number(status.command, "received") or 0, now_ns)
        facts = {**status.command, **status.link}
        for name in {*REFUSALS, *(each for names in LINK_COUNTS.values() for each in names)}:
            value = _number(facts, name) or 0
            # What was counted before anybody looked is history.
            self._rises.setdefault(name, Rise(value)).see(value, now_ns)
        if isinstance(volts := status.board.get("volts"), int | float):
            self._volts = float(volts)

    def _take_pose(self, pose: PoseSample, arrived_ns: int) -> None:
        if self._pose is not None and pose.seq < self._pose.seq:
            # A daemon that was restarted: it was never on that path.
            self._trail.clear()
        self._poses.total(pose.seq, arrived_ns)
        self._pose, self._pose_ns = pose, arrived_ns
        last = self._trail[-1] if self._trail else None
        # A centimetre is less than a dot on any terminal.
        if last is None or math.dist(last, (pose.x, pose.y)) > 0.01:
            self._trail.append((pose.x, pose.y))

    def _wheel_views(self) -> tuple[WheelView, ...]:
        wheels = self._wheels
        if wheels is None:
            return ()
        rows = zip(
            wheels.names,
            wheels.ticks,
            wheels.position_rad,
            wheels.speed_m_s,
            wheels.command_m_s,
            strict=False,
        )
        return tuple(
            WheelView(
                name=name, ticks=ticks, position_rad=angle, speed_m_s=speed, command_m_s=command
            )
            for name, ticks, angle, speed, command in rows
        )

    def _counts(
        self, groups: Mapping[str, tuple[str, ...]], facts: Mapping[str, Any], now_ns: int
    ) -> tuple[Count, ...]:
        """The counters that ever counted something."""
        found = []
        for words, names in groups.items():
            total = sum(_number(facts, name) or 0 for name in names)
            rising = any(self._rises[name].rising(now_ns) for name in names if name in self._rises)
            if total:
                found.append(Count(name=words, total=total, rising=rising))
        return tuple(found)

    def _read(self, payload: bytes, message: type[Message]) -> Message | None:
        sample = read_sample(payload, message)
        if sample is None:
            self._unreadable += 1
        return sample

    def _finite(self, *numbers: float) -> bool:
        """Whether these can be drawn: MessagePack carries infinities and what is no number."""
        finite = all(map(math.isfinite, numbers))
        if not finite:
            self._unreadable += 1
        return finite


def _event_views(events: Iterable[tuple[EventSample, int]], now_ns: int) -> tuple[EventView, ...]:
    return tuple(
        EventView(
            age_s=(now_ns - arrived_ns) / NS_PER_S,
            stamp_ns=event.stamp_ns,
            severity=event.severity,
            message=event.message,
        )
        for event, arrived_ns in events
    )


def _number(facts: Mapping[str, Any], name: str) -> int | None:
    value = facts.get(name)
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _sigma(pose: PoseSample) -> tuple[float, float, float]:
    x, y, theta = (math.sqrt(max(0.0, variance)) for variance in pose.covariance[::4])
    return x, y, theta
