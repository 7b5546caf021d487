"""Records the history of a daemon in its ring: the part that runs in the daemon's loop.

Nothing here waits, and nothing is written to a disk. The costs are those of a read of the port:
about a microsecond. Once in each segment, every five seconds or more, the state of the odometer is
written as well.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from yahboomd.blackbox import records
from yahboomd.blackbox.records import WRITTEN, encode
from yahboomd.blackbox.ring import Ring
from yahboomd.core.model import (
    NS_PER_S,
    STANDSTILL,
    EncoderReading,
    Event,
    Matrix3,
    OdometryEstimate,
    Pose2d,
    Twist2d,
)

POSES_EVERY_NS = 200_000_000

COMMANDS_A_SECOND = 100
"""More are counted only: a flood of commands must not push the last minute out of the ring."""


class Recorder:
    """Writes the records of one daemon; a tap on its line.

    Args:
        ring: The ring of the records.
        now_ns: Monotonic time.
        wall_ns: Unix time.

    Attributes:
        odometer_state: Returns the state of the odometer, for anchors.
        received: Records the bytes of one read, and its moment.
        due: An anchor is to be written at the next possible moment.
    """

    def __init__(self, ring: Ring, now_ns: Callable[[], int], wall_ns: Callable[[], int]) -> None:
        self._ring = ring
        self._now_ns = now_ns
        self._wall_ns = wall_ns
        self._port = self._dialect = ""
        self._byte_ns = 0
        self._decision: records.DecisionRecord | None = None
        self._second_ns = 0
        self._commands = 0
        self._posed_ns = 0
        self.odometer_state: Callable[[], bytes] | None = None
        # Reads of the port are the most frequent records: no call in between.
        self.received = ring.write_read
        self.due = False
        ring.on_turned = self._look

    def record(self, meaning: records.Meaning) -> None:
        kind, payload = encode(meaning)
        self._ring.write(kind, payload, self._now_ns())

    # The tap.

    def _look(self) -> None:
        self.due = self._ring.turned and bool(self._dialect)

    def opened(self, port: str, byte_ns: int) -> None:
        self._port, self._byte_ns = port, byte_ns
        self._dialect = ""
        self.due = False
        if self._ring.turned:
            self.settled()
        self.record(records.Opened(port=port, byte_ns=byte_ns))

    def settled(self) -> None:
        """Write an anchor, and the other records that make a segment readable by itself."""
        if self.odometer_state is None:
            return
        self._ring.turned = self.due = False
        self.record(records.WallClock(wall_ns=self._wall_ns()))
        if self._decision is not None:
            self.record(self._decision)
        self.record(
            records.Anchor(
                port=self._port,
                byte_ns=self._byte_ns,
                dialect=self._dialect,
                state=self.odometer_state(),
            )
        )

    def written(self, data: bytes) -> None:
        self._ring.write(WRITTEN, data, self._now_ns())

    def identified(self, dialect: str, settings: dict[str, Any] | None) -> None:
        self._dialect = dialect
        self._look()
        self.record(records.Identified(dialect=dialect, settings=settings))

    def closed(self) -> None:
        self._port = self._dialect = ""
        self.due = False
        self.record(records.Closed())

    # The odometer's other inputs.

    def noted(self, reading: EncoderReading) -> None:
        """Record the facts of a reading that its bytes do not show."""
        self.record(
            records.ReadingRecord(
                received_ns=reading.received_ns,
                requested_ns=reading.requested_ns,
                earliest_ns=reading.earliest_ns,
                after_reset=reading.after_reset,
                after_gap=reading.after_gap,
                unbroken=reading.unbroken,
            )
        )

    def estimate(self, estimate: OdometryEstimate) -> None:
        """Record the pose of an estimate, five times a second at most."""
        if estimate.stamp_ns - self._posed_ns >= POSES_EVERY_NS:
            self._posed_ns = estimate.stamp_ns
            self.record(records.Posed(stamp_ns=estimate.stamp_ns, pose=estimate.pose))

    def renewal(self, period_ns: int | None, *, each_line: bool, age_ns: int) -> None:
        self.record(records.Renewal(period_ns=period_ns, each_line=each_line, age_ns=age_ns))

    def armed(self) -> None:
        self.record(records.Armed())

    def pose_set(self, pose: Pose2d, covariance: Matrix3 | None) -> None:
        self.record(records.PoseSet(pose=pose, covariance=covariance))

    def steered(self, curvature_per_m: float, now_ns: int) -> None:
        kind, payload = encode(records.SteerRecord(curvature_per_m=curvature_per_m))
        self._ring.write(kind, payload, now_ns)

    # Commands and decisions.

    def command(self, source: str, twist: Twist2d = STANDSTILL, refused: str = "") -> None:
        """Record an accepted or refused command; an unreadable one has no twist."""
        now_ns = self._now_ns()
        if now_ns - self._second_ns >= NS_PER_S:
            self._count_lost()
            self._second_ns, self._commands = now_ns, 0
        self._commands += 1
        if self._commands > COMMANDS_A_SECOND:
            return
        self.record(
            records.CommandRecord(
                source=source, vx=twist.vx, vy=twist.vy, wz=twist.wz, refused=refused
            )
        )

    def _count_lost(self) -> None:
        if (lost := self._commands - COMMANDS_A_SECOND) > 0:
            self.record(records.Lost(what="commands", count=lost))

    def decision(self, state: str, driver: str, why: str) -> None:
        """Record who drives, and why the robot stands, when that changes."""
        decision = records.DecisionRecord(state=state, driver=driver, why=why)
        if decision != self._decision:
            self._decision = decision
            self.record(decision)

    def event(self, event: Event) -> None:
        if event.kind == "clock_stepped":
            self.record(records.WallClock(wall_ns=self._wall_ns()))
        self.record(records.Happened(event=event))
