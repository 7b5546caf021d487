"""Received samples: commands go to the arbiter, poses are set, wrong clocks reported."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.clock import Clock, nanoseconds
from yahboomd.core.daemon.black_box import CommandRecorder
from yahboomd.core.daemon.requests import Operator
from yahboomd.core.drive.arbiter import Arbiter
from yahboomd.core.messages import cdr
from yahboomd.core.messages.codecs import Refusal, decode_command, decode_set_pose
from yahboomd.core.messages.native import SetPoseRequest
from yahboomd.core.messages.set_pose import decode_pose
from yahboomd.core.messages.status_fields import REFUSALS, ZEROS
from yahboomd.core.model import STANDSTILL, Event, Pose2d, Twist2d

SentAt: TypeAlias = Callable[[Arrival], int | None]
"""Reads the time of sending (Unix ns) that a sample carries beside its message, if there is one."""


class CommandIntake:
    """Decodes commands, offers them to the arbiter, and runs one control step for all of them.

    Args:
        clock: For the wall time that absolute stamps are compared with.
        holonomic: Whether the base can move sideways.
        notice_pause: Detects whether this process stood still; called before anything is offered.
        step: Runs a control step; called once for all that arrived together.
        refusal: The reason why a source begins no motion now, if there is one.
    """

    def __init__(
        self,
        arbiter: Arbiter,
        clock: Clock,
        *,
        holonomic: bool,
        notice_pause: Callable[[], None],
        step: Callable[[], None],
        refusal: Callable[[str], str] | None = None,
        recorder: CommandRecorder | None = None,
    ) -> None:
        self._arbiter = arbiter
        self._clock = clock
        self._holonomic = holonomic
        self._notice_pause = notice_pause
        self._step = step
        self._refusal = refusal
        self._recorder = recorder
        self.counters: Counter[str] = Counter()
        self._by_source: dict[str, Counter[str]] = {}
        self._refused_by_source: dict[str, Counter[str]] = {}
        self.last_refusal = ""

    def handler(
        self, source: str, sent_at: SentAt = lambda _: None
    ) -> Callable[[list[Arrival]], None]:
        """The subscription for a source's key. The key is the authority, not the payload.

        Args:
            sent_at: The time of sending, for messages without a stamp of their own.
        """
        self._by_source.setdefault(source, Counter(ZEROS["sources"]))
        self._refused_by_source.setdefault(source, Counter(dict.fromkeys(REFUSALS, 0)))

        def take(arrivals: list[Arrival]) -> None:
            self._notice_pause()
            for arrival in arrivals:
                self._take(source, arrival, sent_at(arrival))
            self._step()

        return take

    def status_values(self) -> dict[str, Any]:
        """Counters of all samples, the reason of the latest refusal, and clocks."""
        now_ns = self._clock.now_ns()
        facts: dict[str, Any] = dict(self.counters)
        facts.update(self._arbiter.counters)
        facts["last_refusal"] = self.last_refusal
        facts["sources"] = {
            source: {**counters, "refused": dict(self._refused_by_source[source])}
            for source, counters in self._by_source.items()
        }
        if offsets_s := self._arbiter.clock_offsets_s(now_ns):
            facts["clock_offset_s"] = offsets_s
        if warnings := self._arbiter.clock_warnings(now_ns):
            facts["clock_warnings"] = warnings
        return facts

    def _take(self, source: str, arrival: Arrival, carried_ns: int | None) -> None:
        self._count(source, "received", 1 + arrival.dropped)
        if arrival.dropped:
            self._count(source, "overrun", arrival.dropped)
            # Samples that were lost unread were probably commands like the others.
            self._arbiter.note_motion(source, arrival.arrived_ns)
        if arrival.oversize:
            self._refuse(source, "oversize", "the payload has more bytes than a command may")
            return
        command = decode_command(arrival.payload)
        if isinstance(command, Refusal):
            self._refuse(source, command.reason, command.detail)
            return
        vy = command.vy if self._holonomic else 0.0
        if vy != command.vy:
            self._count(source, "vy_ignored")
        sent_ns = command.stamp_ns or carried_ns
        twist = Twist2d(vx=command.vx, vy=vy, wz=command.wz)
        if self._refusal is not None and not twist.is_zero and (why := self._refusal(source)):
            self._refuse(source, "battery_empty", why, twist)
            return
        # In this order: if this process is held up in between, a command seems no younger.
        waited_ns = self._clock.now_ns() - arrival.arrived_ns
        verdict = self._arbiter.offer(
            source,
            twist,
            arrival.arrived_ns,
            sent_ns or arrival.stamp_ns,
            sent_ns is not None,
            wall_ns=self._clock.wall_ns() - waited_ns,
            arrivals=1 + arrival.dropped,
            sender=command.source or "",
        )
        if verdict is None:
            # The arbiter itself counts the total.
            self._by_source[source]["accepted"] += 1
            if self._recorder is not None:
                moves_end = f" ({command.source})" if "moves of " in (command.source or "") else ""
                self._recorder.command(source + moves_end, twist)
        else:
            self._refused(source, verdict.reason, verdict.detail, twist)

    def _refuse(self, source: str, reason: str, detail: str, twist: Twist2d = STANDSTILL) -> None:
        # An unreadable payload was meant as a command, and the next one may be readable.
        self._arbiter.note_motion(source, self._clock.now_ns())
        self.counters[reason] += 1
        self._arbiter.note_refusal(self._clock.now_ns(), reason)
        self._refused(source, reason, detail, twist)

    def _refused(self, source: str, reason: str, detail: str, twist: Twist2d = STANDSTILL) -> None:
        self.counters["refused"] += 1
        self._refused_by_source[source][reason] += 1
        self.last_refusal = f"{source}: {reason}: {detail}"
        if self._recorder is not None:
            self._recorder.command(source, twist, reason)

    def _count(self, source: str, what: str, times: int = 1) -> None:
        self.counters[what] += times
        self._by_source[source][what] += times


QUIET_S = 60.0
"""A clock that was right for this time, and is off again, is reported; one that hovers is not."""


class ClockWatch:
    """Publishes an event for each new warning about a clock.

    Args:
        warnings: Returns the warnings at a moment, by source.
    """

    def __init__(
        self, warnings: Callable[[int], Mapping[str, str]], publish: Callable[[Event], None]
    ) -> None:
        self._warnings = warnings
        self._publish = publish
        self._seen_ns: dict[str, int] = {}

    def report(self, now_ns: int) -> None:
        """Publish an event for each new warning; called periodically."""
        for source, words in self._warnings(now_ns).items():
            seen_ns = self._seen_ns.get(source)
            self._seen_ns[source] = now_ns
            if seen_ns is None or now_ns - seen_ns > nanoseconds(QUIET_S):
                event = Event(
                    kind="clock_offset",
                    severity="warning",
                    message=f"{source}: {words}",
                    data={"source": source},
                )
                self._publish(event)


class PoseIntake:
    """Sets the pose by samples.

    Args:
        frame_id: The frame that a ROS 2 message has to name: the odometry's, prefix included.
    """

    def __init__(self, operator: Operator, frame_id: str) -> None:
        self._operator = operator
        self._frame_id = frame_id

    def accept(self, arrivals: list[Arrival]) -> None:
        for arrival in arrivals:
            wanted = self._decode(arrival.payload)
            if isinstance(wanted, str):
                self._operator.refuse_pose(wanted)
            else:
                pose = Pose2d(x=wanted.x, y=wanted.y, theta=wanted.theta)
                self._operator.set_pose(pose, wanted.covariance)

    def _decode(self, payload: bytes) -> SetPoseRequest | str:
        if cdr.is_cdr(payload):
            return decode_pose(payload, self._frame_id)
        wanted = decode_set_pose(payload)
        return f"{wanted.reason}: {wanted.detail}" if isinstance(wanted, Refusal) else wanted
