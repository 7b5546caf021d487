"""Publishes for the control path: estimates as samples, and events.

Both are limited: samples to a rate, events to a few of a kind in a second, because a fault may
repeat faster than a person reads.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Protocol

import msgspec

from yahboomd.core.bus import keys
from yahboomd.core.clock import Clock, nanoseconds
from yahboomd.core.daemon.stamps import STEP_S, WallStamps
from yahboomd.core.messages.codecs import NativeEncoding, encoder
from yahboomd.core.messages.native import (
    BatterySample,
    EventSample,
    ImuSample,
    PoseSample,
    StatusSample,
    TwistSample,
    WheelsSample,
    event_sample,
    imu_sample,
    pose_sample,
    twist_sample,
    wheels_sample,
)
from yahboomd.core.model import Event, ImuEstimate, OdometryEstimate

log = logging.getLogger(__name__)

EVENTS_A_SECOND = 5
"""The most events of one kind: a repeated fault, or a flood, must fill neither log nor bus."""


class Outputs(Protocol):
    """The receivers of measurements and decisions."""

    def estimate(self, estimate: OdometryEstimate, command_m_s: tuple[float, ...]) -> None:
        """A new reading, and the rim speeds that were commanded."""

    def imu(self, estimate: ImuEstimate) -> None: ...

    def battery(self, volts: float) -> None: ...

    def event(self, event: Event) -> None: ...

    def changed(self) -> None:
        """Note that state, driver or reason may have changed."""


class Events:
    """Events on their way to the log and the bus.

    Args:
        counters: Count them, and those that were suppressed.
    """

    def __init__(self, clock: Clock, outputs: Outputs, counters: Counter[str]) -> None:
        self._clock = clock
        self._outputs = outputs
        self._counters = counters
        self._published: dict[str, tuple[int, int]] = {}

    def report(self, event: Event) -> None:
        """Log and publish an event; more than a few of one kind in a second are only counted."""
        now_ns = self._clock.now_ns()
        since_ns, count = self._published.get(event.kind, (now_ns, 0))
        if now_ns - since_ns >= nanoseconds(1.0):
            since_ns, count = now_ns, 0
        self._published[event.kind] = (since_ns, count + 1)
        if count >= EVENTS_A_SECOND:
            self._counters["events_suppressed"] += 1
            return
        level = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}
        log.log(level[event.severity], "%s", event.message)
        self._counters["events"] += 1
        self._outputs.event(event)
        self._outputs.changed()


class Outlet(Protocol):
    """The destinations of the samples of one key."""

    @property
    def has_subscribers(self) -> bool:
        """Whether any client would receive them."""

    def put(self, payload: bytes) -> bool:
        """Publish one sample."""


PUBLISHED: dict[str, type[msgspec.Struct]] = {
    keys.POSE: PoseSample,
    keys.TWIST: TwistSample,
    keys.WHEELS: WheelsSample,
    keys.IMU: ImuSample,
    keys.BATTERY: BatterySample,
    keys.STATUS: StatusSample,
    keys.EVENTS: EventSample,
}
"""The message that is published on each key."""

OpenOutlet = Callable[[str], Outlet]


class Pace:
    """Lets through at most one in each period, on a grid that does not drift.

    Args:
        period_ns: The shortest distance on average.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._due_ns: int | None = None

    def due(self, now_ns: int) -> bool:
        if self._due_ns is None or now_ns - self._due_ns > 4 * self._period_ns:
            self._due_ns = now_ns
        # Readings come on a grid of their own; one that is early by less than a quarter of a
        # period counts for this beat, else every second one would be left out.
        if now_ns < self._due_ns - self._period_ns // 4:
            return False
        self._due_ns += self._period_ns
        return True


class Publisher:
    """The native plane.

    Args:
        outlet: Opens the outlet of a key.
        period_ns: The shortest distance between two poses.
        motor_names: In the order of the estimates.
    """

    def __init__(
        self,
        outlet: OpenOutlet,
        *,
        encoding: NativeEncoding,
        stamps: WallStamps,
        period_ns: int,
        frame_id: str,
        child_frame_id: str,
        motor_names: tuple[str, ...],
        imu_frame_id: str = "imu_link",
    ) -> None:
        self._encode = encoder(encoding)
        self._stamps = stamps
        self._pace = Pace(period_ns)
        self._motor_names = motor_names
        self._of_reading: dict[str, Callable[..., msgspec.Struct]] = {
            keys.POSE: partial(pose_sample, frame_id=frame_id, child_frame_id=child_frame_id),
            keys.TWIST: partial(twist_sample, frame_id=child_frame_id),
            keys.WHEELS: self._wheels_of,
        }
        self._reading_outlets = tuple(
            [(outlet(key), make) for key, make in self._of_reading.items()]
        )
        self._latest: tuple[OdometryEstimate, int] | None = None
        self._command_m_s: tuple[float, ...] = ()
        self._imu = outlet(keys.IMU)
        self._imu_frame_id = imu_frame_id
        self._imu_seq = self._imu_ns = 0
        self._battery = outlet(keys.BATTERY)
        self._status = outlet(keys.STATUS)
        self._events = outlet(keys.EVENTS)
        self._seq = 0
        # Made when a client asks: at 50 Hz few of them are ever asked for.
        self._newest: dict[str, Callable[[], msgspec.Struct]] = {}

    def status_values(self) -> dict[str, int]:
        """Readings that went out, stamps that were held back, and steps of the wall clock."""
        return {
            "published": self._seq,
            "stamps_held_back": self._stamps.held_back,
            "clock_steps": self._stamps.steps,
        }

    def estimate(self, estimate: OdometryEstimate, command_m_s: tuple[float, ...]) -> int | None:
        """Publish one reading's pose, twist and wheels, if it is due.

        Returns:
            Its stamp; ``None`` if it was left out.
        """
        if not self._pace.due(estimate.stamp_ns):
            return None
        stamp_ns = self._stamps.of(estimate.stamp_ns)
        self._seq += 1
        self._command_m_s = command_m_s
        self._latest = (estimate, stamp_ns)
        # Put one right after the other, they leave in one batch more often.
        samples = [
            (outlet, self._encode(make(estimate, stamp_ns=stamp_ns, seq=self._seq)))
            for outlet, make in self._reading_outlets
            if outlet.has_subscribers
        ]
        for outlet, payload in samples:
            outlet.put(payload)
        return stamp_ns

    def imu(self, estimate: ImuEstimate) -> int:
        stamp_ns = estimate.stamp_ns + self._stamps.follow()
        if 0 <= self._imu_ns - stamp_ns < nanoseconds(STEP_S):
            stamp_ns = self._imu_ns + 1
        self._imu_ns = stamp_ns
        self._imu_seq += 1
        make = partial(
            imu_sample,
            estimate,
            stamp_ns=stamp_ns,
            seq=self._imu_seq,
            frame_id=self._imu_frame_id,
        )
        self._newest[keys.IMU] = make
        if self._imu.has_subscribers:
            self._imu.put(self._encode(make()))
        return stamp_ns

    def battery(self, volts: float) -> int:
        stamp_ns = self._stamps.now()
        sample = BatterySample(stamp_ns=stamp_ns, volts=volts)
        self._newest[keys.BATTERY] = lambda: sample
        if self._battery.has_subscribers:
            self._battery.put(self._encode(sample))
        return stamp_ns

    def status(self, sample: StatusSample) -> None:
        self._newest[keys.STATUS] = lambda: sample
        self._status.put(self._encode(sample))

    def newest(self, key: str) -> msgspec.Struct | None:
        """The newest sample of a key, whether it had subscribers or not; None before the first."""
        if key in self._of_reading:
            if self._latest is None:
                return None
            estimate, stamp_ns = self._latest
            return self._of_reading[key](estimate, stamp_ns=stamp_ns, seq=self._seq)
        make = self._newest.get(key)
        return None if make is None else make()

    def event(self, event: Event) -> int:
        stamp_ns = self._stamps.now()
        self._events.put(self._encode(event_sample(event, stamp_ns=stamp_ns)))
        return stamp_ns

    def _wheels_of(self, estimate: OdometryEstimate, *, stamp_ns: int, seq: int) -> WheelsSample:
        return wheels_sample(
            estimate,
            stamp_ns=stamp_ns,
            seq=seq,
            names=self._motor_names,
            command_m_s=self._command_m_s,
        )
