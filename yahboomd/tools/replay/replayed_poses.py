"""Computes a recording's poses and events again from its bytes, and compares them.

:mod:`yahboomd.blackbox.records` describes the records. Between two anchors the odometer runs
on by itself, and its state is compared with the next anchor's. On the recording's processor and
mathematical library both are identical to the last bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from yahboomd.blackbox.box_file import Header
from yahboomd.blackbox.records import (
    Anchor,
    Armed,
    Closed,
    Happened,
    Identified,
    Opened,
    Posed,
    PoseSet,
    ReadingRecord,
    Received,
    Record,
    Renewal,
    SteerRecord,
    WallClock,
)
from yahboomd.core.model import (
    EncoderReading,
    Event,
    EventKind,
    ImuReading,
    OdometryEstimate,
    Pose2d,
)
from yahboomd.core.odometry import snapshot
from yahboomd.core.odometry.imu_axes import Mounting
from yahboomd.core.odometry.odometer import Odometer
from yahboomd.core.protocol.dialect import Framer, Inertial, Totals, VersionLine
from yahboomd.core.protocol.registry import DIALECTS

NEAR = 1e-9
"""Poses that differ by less (metres or radians) are the same, computed on another machine."""

KINDS: frozenset[EventKind] = frozenset(
    {
        "board_clock_period",
        "board_clock_unfit",
        "gyro_fit",
        "gyro_unfit",
        "odometry_bridged",
        "odometry_discontinuity",
        "wheels_slip",
    }
)
"""The events that only the odometry finds."""


class Estimated(NamedTuple):
    """An estimate and its stamp.

    Attributes:
        wall_ns: The stamp as Unix nanoseconds.
    """

    wall_ns: int
    estimate: OdometryEstimate


class Compared(msgspec.Struct, kw_only=True):
    """The differences between the computed and the recorded poses and events.

    Attributes:
        moments: States and poses of the daemon's odometer that were compared.
        identical: Those of them that are identical to the last bit.
        largest: The largest difference of a pose, in metres or radians.
        missing: Events of the daemon that were not computed.
        unmatched: Readings of the recording that its bytes do not contain.
        restarts: How often records were missing, so that the next anchor had to be restored.
    """

    moments: int = 0
    identical: int = 0
    largest: float = 0.0
    missing: list[Event] = msgspec.field(default_factory=list)
    unmatched: int = 0
    restarts: int = 0

    @property
    def same(self) -> bool:
        """Whether poses and events equal the daemon's."""
        return self.largest <= NEAR and not self.missing and not self.unmatched


class _Counted(NamedTuple):
    totals: Totals
    received_ns: int
    sent_ns: int


_Pending = _Counted | ImuReading | VersionLine


class PoseReplay:
    """Computes the poses of a recording.

    Attributes:
        compared: The comparison with the daemon's poses and events.
    """

    def __init__(self, header: Header) -> None:
        self._header = header
        imu = header.imu
        self._mounting = Mounting(imu.axes, imu.gyro_axes, gyro_factor=imu.gyro_factor)
        self._odometer: Odometer | None = None
        self._framer: Framer | None = None
        self._dialect = ""
        self._byte_ns = 0
        self._unread: list[bytes] = []
        self._pending: list[_Pending] = []
        self._wall_less_monotonic_ns = header.started_wall_ns - header.started_ns
        self._recorded: list[Event] = []
        self._posed: list[Posed] = []
        self._damaged = False
        self.estimates: list[Estimated] = []
        self.events: list[Event] = []
        self.compared = Compared()

    def run(self, records: Sequence[Record], *, damaged: bool = False) -> None:
        """Compute everything.

        Args:
            damaged: Records are missing somewhere: after poses that differ, go on from the anchor.

        Raises:
            NotAState: The state of an anchor comes from another version of yahboomd.
        """
        self._damaged = damaged
        for at_ns, meaning in records:
            if isinstance(meaning, ReadingRecord):
                self._complete(meaning)
            elif isinstance(meaning, Armed):
                self._up_to_a_cause()
                if self._odometer is not None:
                    self._odometer.armed()
            elif isinstance(meaning, Happened):
                if meaning.event.kind in KINDS and self._odometer is not None:
                    self._recorded.append(meaning.event)
            elif isinstance(meaning, Posed):
                if self._odometer is not None:
                    self._posed.append(meaning)
            elif isinstance(meaning, WallClock):
                self._wall_less_monotonic_ns = meaning.wall_ns - at_ns
            elif isinstance(
                meaning,
                Anchor | Opened | Identified | Closed | Received | Renewal | PoseSet | SteerRecord,
            ):
                self._use(list(self._pending))
                self._take(at_ns, meaning)
        self._use(list(self._pending))
        if not damaged:
            self._compare_poses()
            self._compare_events()

    def _take(
        self,
        at_ns: int,
        meaning: Anchor | Opened | Identified | Closed | Received | Renewal | PoseSet | SteerRecord,
    ) -> None:
        odometer = self._odometer
        if isinstance(meaning, Anchor):
            self._anchor(meaning)
        elif isinstance(meaning, Opened | Closed):
            self._framer, self._dialect = None, ""
            self._unread.clear()
            if isinstance(meaning, Opened):
                self._byte_ns = meaning.byte_ns
        elif isinstance(meaning, Identified):
            self._identify(meaning.dialect)
        elif isinstance(meaning, Received):
            self._receive(meaning.data, at_ns)
        elif odometer is None:
            pass
        elif isinstance(meaning, Renewal):
            odometer.set_sample_period(
                meaning.period_ns, each_line=meaning.each_line, age_ns=meaning.age_ns
            )
        elif isinstance(meaning, PoseSet):
            odometer.set_pose(meaning.pose, meaning.covariance)
        else:
            odometer.steer(meaning.curvature_per_m, at_ns)

    def _fresh(self, state: bytes) -> Odometer:
        made = self._header.odometer
        odometer = Odometer(
            made.kinematics,
            made.motors,
            speed_max_m_s=made.speed_max_m_s,
            noise_m=made.noise_m,
            fused=made.fused,
            gyro_scale=made.gyro_scale,
        )
        if state:
            snapshot.restore(odometer, state)
        return odometer

    def _anchor(self, anchor: Anchor) -> None:
        own = self._odometer
        if own is not None:
            compared = self.compared
            compared.moments += 1
            if snapshot.save(own) == anchor.state:
                compared.identical += 1
                return
            recorded = self._fresh(anchor.state)
            apart = _apart(own.pose, recorded.pose)
            if apart <= NEAR:
                compared.largest = max(compared.largest, apart)
                return
            if self._damaged:
                compared.moments -= 1
                compared.restarts += 1
            else:
                compared.largest = max(compared.largest, apart)
        self._odometer = self._fresh(anchor.state)
        self._framer = None
        self._byte_ns = anchor.byte_ns
        self._unread.clear()
        self._identify(anchor.dialect)

    def _identify(self, dialect: str) -> None:
        self._dialect = dialect
        if dialect:
            self._framer = DIALECTS[dialect].framer()
            for data in self._unread:
                self._framer.feed(data)
        self._unread.clear()

    def _receive(self, data: bytes, at_ns: int) -> None:
        framer, byte_ns = self._framer, self._byte_ns
        if framer is None:
            self._unread.append(data)
            return
        for item in framer.feed(data):
            decoded = DIALECTS[self._dialect].decode(item)
            received_ns = at_ns - item.trailing * byte_ns
            sent_ns = received_ns - item.size * byte_ns
            if isinstance(decoded, Totals):
                self._pending.append(_Counted(decoded, received_ns, sent_ns))
            elif isinstance(decoded, VersionLine):
                self._pending.append(decoded)
            elif isinstance(decoded, Inertial):
                self._pending.append(
                    ImuReading(
                        sensor=decoded.sensor,
                        sent_ns=at_ns - (item.trailing + item.size) * byte_ns,
                        gyro_rad_s=decoded.gyro_rad_s,
                        acceleration_m_s2=decoded.acceleration_m_s2,
                        magnetic_t=decoded.magnetic_t,
                    )
                )

    def _complete(self, reading: ReadingRecord) -> None:
        """Use everything before these counts, then the counts with their recorded facts."""
        for index, each in enumerate(self._pending):
            if isinstance(each, _Counted) and each.received_ns == reading.received_ns:
                before = self._pending[:index]
                del self._pending[index]
                self._use(before)
                sent_ns = each.sent_ns
                if reading.requested_ns is not None:
                    sent_ns = max(sent_ns, reading.requested_ns)
                self._update(
                    EncoderReading(
                        ticks=each.totals.ticks,
                        received_ns=each.received_ns,
                        sent_ns=sent_ns,
                        requested_ns=reading.requested_ns,
                        earliest_ns=reading.earliest_ns,
                        after_reset=reading.after_reset,
                        after_gap=reading.after_gap,
                        unbroken=reading.unbroken,
                    )
                )
                return
        if self._odometer is not None and not self._damaged:
            self.compared.unmatched += 1

    def _up_to_a_cause(self) -> None:
        """Use items up to a start or a break: arming in the middle of a chunk has that cause."""
        while self._pending:
            first = self._pending[0]
            events = len(self.events)
            self._use([first])
            if isinstance(first, VersionLine) or len(self.events) > events:
                return

    def _use(self, items: list[_Pending]) -> None:
        del self._pending[: len(items)]
        for each in items:
            if isinstance(each, _Counted):
                self._update(
                    EncoderReading(
                        ticks=each.totals.ticks,
                        received_ns=each.received_ns,
                        sent_ns=each.sent_ns,
                    )
                )
            elif isinstance(each, ImuReading) and self._odometer is not None:
                self._odometer.accept(self._mounting.along_base(each))

    def _update(self, reading: EncoderReading) -> None:
        if self._odometer is None:
            return
        update = self._odometer.update(reading)
        self.events += update.events
        if update.estimate is not None:
            wall_ns = update.estimate.stamp_ns + self._wall_less_monotonic_ns
            self.estimates.append(Estimated(wall_ns, update.estimate))

    def _compare_poses(self) -> None:
        compared = self.compared
        poses = {each.estimate.stamp_ns: each.estimate.pose for each in self.estimates}
        for posed in self._posed:
            own = poses.get(posed.stamp_ns)
            if own is None:
                compared.unmatched += 1
                continue
            compared.moments += 1
            compared.identical += own == posed.pose
            compared.largest = max(compared.largest, _apart(own, posed.pose))

    def _compare_events(self) -> None:
        """Check that the computed events contain each recorded one, in the recorded order.

        A daemon publishes only a few events of one kind in a second, so more may be computed. Its
        version may have other words for an event: its kind, wheel and data count.
        """
        facts = [_wordless(event) for event in self.events]
        computed = iter(facts)
        for event in self._recorded:
            if _wordless(event) not in computed:
                self.compared.missing.append(event)
                computed = iter(facts)


def _wordless(event: Event) -> Event:
    return msgspec.structs.replace(event, message="")


def _apart(one: Pose2d, other: Pose2d) -> float:
    return max(abs(one.x - other.x), abs(one.y - other.y), abs(one.theta - other.theta))
