"""Collects a daemon's samples into a view of the robot.

Pure: samples and times in, a :class:`View` out. Other files draw it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Any, Literal, TypeAlias, TypeVar

import msgspec

from yahboomd.client.streams import read_sample
from yahboomd.core.bus import keys
from yahboomd.core.messages.native import (
    BatterySample,
    EventSample,
    PoseSample,
    StatusSample,
    TwistSample,
    WheelsSample,
)
from yahboomd.core.messages.status_fields import REFUSALS
from yahboomd.core.model import NS_PER_S
from yahboomd.tools.screens.rates import Counter

Message = TypeVar("Message", bound=msgspec.Struct)

STALE_NS = 2 * NS_PER_S
"""A daemon publishes its status twice a second; after four missing ones it is gone or stuck."""

LATE_NS = NS_PER_S
"""Pose, twist and wheels come with every reading; older ones are shown as old."""

RATE_NS = 2 * NS_PER_S
"""The window over which rates are averaged."""

NEWS_NS = 10 * NS_PER_S
"""For this time a risen counter is highlighted, and a speed counts for the scale of the bars."""

SMALLEST_M_S = 0.1
"""The smallest scale of the bars."""

SHOWN_M_S = 0.005
"""Slower speeds hardly show in the numbers of a screen."""

MAX_EVENTS = 200
MAX_TRAIL = 4096

LINK_COUNTS: dict[str, tuple[str, ...]] = {
    "lost": ("broken_frames", "overlong", "unrecognised"),
    "discarded bytes": ("discarded_bytes",),
    "refused": ("refusals",),
    "commands lost": ("commands_lost",),
    "missed polls": ("polls_unanswered", "polls_skipped"),
    "missed answers": ("answers_missed",),
    "board resets": ("board_resets",),
    "reconnects": ("disconnected",),
    "late beats": ("polls_late", "beats_missed"),
}
"""The troubles shown, by their names, each with its counters in ``status.link`` or ``.command``."""

Phase: TypeAlias = Literal["waiting", "live", "silent"]


class Count(msgspec.Struct, frozen=True, kw_only=True):
    """A counter of something that should not happen; ``rising`` while it happens."""

    name: str
    total: int
    rising: bool


class View(msgspec.Struct, frozen=True, kw_only=True):
    """Everything to show at one moment.

    Attributes:
        phase: ``waiting`` until a status came; ``silent`` when they stopped coming.
        silent_s: Time since the latest status.
        status: The latest status, pose, twist and wheels; None before the first.
        state_s: Time in this state.
        driver_s: Time for which the driver has had control; None if there is no driver.
        late: Pose, twist and wheels are old.
        poses_per_s: By their sequence numbers, so poses that did not arrive here count too.
        full_scale_m_s: The fastest recent speed or command of any wheel.
        readings_per_s: Readings of the board's counters, as the daemon counts them.
        commands_per_s: Commands that the daemon received from any source.
        link: Troubles of the line.
        refusals: Commands refused, by reason.
        events: The newest last.
        event_age_s: Time since the newest event came.
        trail: The robot's path, (x, y) in metres, the newest last.
    """

    phase: Phase
    silent_s: float = 0.0
    status: StatusSample | None = None
    state_s: float = 0.0
    driver_s: float | None = None
    pose: PoseSample | None = None
    twist: TwistSample | None = None
    wheels: WheelsSample | None = None
    late: bool = False
    poses_per_s: float | None = None
    full_scale_m_s: float = SMALLEST_M_S
    volts: float | None = None
    readings_per_s: float | None = None
    commands_per_s: float | None = None
    link: tuple[Count, ...] = ()
    refusals: tuple[Count, ...] = ()
    events: tuple[EventSample, ...] = ()
    event_age_s: float = math.inf
    trail: tuple[tuple[float, float], ...] = ()
    unreadable: int = 0

    @property
    def moving(self) -> bool:
        """Whether a wheel moves, by command or by measurement."""
        return not self.late and any(
            command_m_s != 0.0 or abs(speed_m_s) > SHOWN_M_S
            for _, _, speed_m_s, command_m_s in self.wheel_rows
        )

    @property
    def wheel_rows(self) -> tuple[tuple[str, int, float, float], ...]:
        """The name, ticks, measured and commanded speed (m/s) of each wheel."""
        wheels = self.wheels
        if wheels is None:
            return ()
        columns = (wheels.names, wheels.ticks, wheels.speed_m_s, wheels.command_m_s)
        return tuple(zip(*columns, strict=False))


class Dashboard:
    """Accepts samples as they arrive, and makes views of them.

    All times are monotonic nanoseconds of the watching program. Stamps of samples are compared only
    with each other, because the daemon's clock may be another machine's.
    """

    def __init__(self) -> None:
        self._pose: PoseSample | None = None
        self._pose_ns = 0
        self._twist: TwistSample | None = None
        self._wheels: WheelsSample | None = None
        self._volts: float | None = None
        self._status: StatusSample | None = None
        self._status_ns = 0
        self._events: deque[EventSample] = deque(maxlen=MAX_EVENTS)
        self._new_events: deque[EventSample] = deque(maxlen=MAX_EVENTS)
        self._event_ns = 0
        self._trail: deque[tuple[float, float]] = deque(maxlen=MAX_TRAIL)
        self._peaks: deque[tuple[int, float]] = deque(maxlen=MAX_EVENTS)
        self._poses = Counter(RATE_NS)
        self._readings = Counter(RATE_NS)
        self._commands = Counter(RATE_NS)
        self._troubles: dict[str, Counter] = {}
        self._unreadable = 0

    def accept(self, key: str, payload: bytes, now_ns: int) -> None:
        """Take a sample that arrived on ``key``; samples of other keys are ignored.

        Poses, twists and wheels may be left out: their sequence numbers count them.
        """
        if key == keys.STATUS and (status := self._read(payload, StatusSample)) is not None:
            self._accept_status(status, now_ns)
        elif key == keys.EVENTS and (event := self._read(payload, EventSample)) is not None:
            self._events.append(event)
            self._new_events.append(event)
            self._event_ns = now_ns
        elif key == keys.POSE and (pose := self._read(payload, PoseSample)) is not None:
            if self._finite(pose.x, pose.y, pose.theta, *pose.covariance):
                self._accept_pose(pose, now_ns)
        elif key == keys.TWIST and (twist := self._read(payload, TwistSample)) is not None:
            if self._finite(twist.vx, twist.vy, twist.wz):
                self._twist = twist
        elif key == keys.WHEELS and (wheels := self._read(payload, WheelsSample)) is not None:
            if self._finite(*wheels.speed_m_s, *wheels.command_m_s):
                self._wheels = wheels
                speeds_m_s = (*wheels.speed_m_s, *wheels.command_m_s, SMALLEST_M_S)
                self._peaks.append((now_ns, max(map(abs, speeds_m_s))))
        elif key == keys.BATTERY and (battery := self._read(payload, BatterySample)) is not None:
            self._volts = battery.volts

    def view(self, now_ns: int, *, connected: bool = True) -> View:
        """The view of the robot at ``now_ns``.

        Args:
            connected: Whether there is a connection over which samples could come.
        """
        events, status = tuple(self._events), self._status
        if status is None:
            return View(phase="waiting", events=events, unreadable=self._unreadable)
        silent_ns = now_ns - self._status_ns
        # Between two statuses, the latest one ages by the watcher's clock.
        status_ns, since_ns = status.stamp_ns + silent_ns, status.driver_since_ns
        return View(
            phase="live" if connected and silent_ns <= STALE_NS else "silent",
            silent_s=silent_ns / NS_PER_S,
            status=status,
            state_s=max(0, status_ns - status.since_ns) / NS_PER_S,
            driver_s=None if since_ns is None else max(0, status_ns - since_ns) / NS_PER_S,
            pose=self._pose,
            twist=self._twist,
            wheels=self._wheels,
            late=self._pose is not None and now_ns - self._pose_ns > LATE_NS,
            poses_per_s=self._poses.per_s(now_ns),
            full_scale_m_s=self._full_scale_m_s(),
            volts=self._volts,
            readings_per_s=self._readings.per_s(now_ns),
            commands_per_s=self._commands.per_s(now_ns),
            link=self._counts(LINK_COUNTS, {**status.command, **status.link}, now_ns),
            refusals=self._counts(
                {name.replace("_", " "): (name,) for name in REFUSALS}, status.command, now_ns
            ),
            events=events,
            event_age_s=(now_ns - self._event_ns) / NS_PER_S if events else math.inf,
            trail=tuple(self._trail),
            unreadable=self._unreadable,
        )

    def new_events(self) -> tuple[EventSample, ...]:
        """The events since the last call."""
        events = tuple(self._new_events)
        self._new_events.clear()
        return events

    def _accept_status(self, status: StatusSample, now_ns: int) -> None:
        self._status, self._status_ns = status, now_ns
        if (readings := _number(status.link, "readings")) is not None:
            self._readings.add(readings, now_ns)
        self._commands.add(_number(status.command, "received") or 0, now_ns)
        facts = {**status.command, **status.link}
        for name in {*REFUSALS, *(each for names in LINK_COUNTS.values() for each in names)}:
            # Counts from before this program began are history, not news.
            self._troubles.setdefault(name, Counter(NEWS_NS)).add(_number(facts, name) or 0, now_ns)
        if isinstance(volts := status.board.get("volts"), int | float):
            self._volts = float(volts)

    def _accept_pose(self, pose: PoseSample, arrived_ns: int) -> None:
        if self._pose is not None and pose.seq < self._pose.seq:
            # The daemon was restarted: the old path is not its own.
            self._trail.clear()
        self._poses.add(pose.seq, arrived_ns)
        self._pose, self._pose_ns = pose, arrived_ns
        # A centimetre is less than a dot on any terminal.
        if not self._trail or math.dist(self._trail[-1], (pose.x, pose.y)) > 0.01:
            self._trail.append((pose.x, pose.y))

    def _full_scale_m_s(self) -> float:
        newest_ns = self._peaks[-1][0] if self._peaks else 0
        lately = (peak for at_ns, peak in self._peaks if newest_ns - at_ns <= NEWS_NS)
        return max(lately, default=SMALLEST_M_S)

    def _counts(
        self, groups: Mapping[str, tuple[str, ...]], facts: Mapping[str, Any], now_ns: int
    ) -> tuple[Count, ...]:
        """The counters above zero."""
        found = []
        for words, names in groups.items():
            total = sum(_number(facts, name) or 0 for name in names)
            rising = any(self._troubles[name].rising(now_ns) for name in names)
            if total:
                found.append(Count(name=words, total=total, rising=rising))
        return tuple(found)

    def _read(self, payload: bytes, message: type[Message]) -> Message | None:
        sample = read_sample(payload, message)
        if sample is None:
            self._unreadable += 1
        return sample

    def _finite(self, *numbers: float) -> bool:
        """Whether all are finite: infinities and NaN cannot be drawn."""
        finite = all(map(math.isfinite, numbers))
        if not finite:
            self._unreadable += 1
        return finite


def _number(facts: Mapping[str, Any], name: str) -> int | None:
    value = facts.get(name)
    return value if isinstance(value, int) and not isinstance(value, bool) else None
