"""Poses by a black box alone, as the docstring of its records says."""

from __future__ import annotations

from msgspec import structs

from yahboomd.blackbox import records
from yahboomd.blackbox.box_file import Box
from yahboomd.model import EncoderReading, ImuReading, OdometryEstimate
from yahboomd.odometry import snapshot
from yahboomd.odometry.imu_axes import Mounting
from yahboomd.odometry.odometer import Odometer
from yahboomd.protocol.dialect import Framer, Inertial, Totals
from yahboomd.protocol.registry import DIALECTS


class Replay:
    """Runs the pure rooms over a box.

    Attributes:
        estimates: What the odometer computed.
        anchors: How many states of the odometer there were behind the first one; each was compared.
    """

    def __init__(self, box: Box) -> None:
        self.estimates: list[OdometryEstimate] = []
        self.anchors = 0
        self._header = box.header
        self._odometer: Odometer | None = None
        self._framers: dict[str, Framer] = {}
        self._dialect = ""
        self._byte_ns = 0
        all_records = box.records
        for at, record in enumerate(all_records):
            meaning = record.meaning
            if isinstance(meaning, records.Anchor):
                self._anchor(meaning)
            elif self._odometer is None:
                continue
            elif isinstance(meaning, records.Received):
                behind = all_records[at + 1 : at + 100]
                self._received(meaning.data, record.at_ns, behind)
            else:
                self._input(meaning, record.at_ns)

    def _anchor(self, anchor: records.Anchor) -> None:
        if self._odometer is not None:
            assert snapshot.save(self._odometer) == anchor.state
            self.anchors += 1
        self._odometer = Odometer(**structs.asdict(self._header.odometer))
        snapshot.restore(self._odometer, anchor.state)
        self._fresh_framers()
        self._dialect, self._byte_ns = anchor.dialect, anchor.byte_ns

    def _fresh_framers(self) -> None:
        self._framers = {name: dialect.framer() for name, dialect in DIALECTS.items()}

    def _input(self, meaning: records.Meaning, at_ns: int) -> None:
        odometer = self._odometer
        assert odometer is not None
        match meaning:
            case records.Opened():
                self._fresh_framers()
                self._dialect, self._byte_ns = "", meaning.byte_ns
            case records.Identified():
                self._dialect = meaning.dialect
            case records.Closed():
                self._dialect = ""
            case records.Renewal():
                odometer.set_sample_period(
                    meaning.period_ns, each_line=meaning.each_line, age_ns=meaning.age_ns
                )
            case records.Armed():
                odometer.armed()
            case records.PoseSet():
                odometer.set_pose(meaning.pose, meaning.covariance)
            case records.Steered():
                odometer.steer(meaning.curvature_per_m, at_ns)

    def _received(self, data: bytes, now_ns: int, behind: list[records.Record]) -> None:
        odometer = self._odometer
        assert odometer is not None
        notes = {}
        for record in behind:
            if isinstance(record.meaning, records.Received):
                break
            if isinstance(record.meaning, records.Reading):
                notes[record.meaning.received_ns] = record.meaning
        found = {name: framer.feed(data) for name, framer in self._framers.items()}
        if not self._dialect:
            return
        dialect = DIALECTS[self._dialect]
        imu = self._header.imu
        mounting = Mounting(imu.axes, imu.gyro_axes, gyro_factor=imu.gyro_factor)
        for item in found[self._dialect]:
            decoded = dialect.decode(item)
            received_ns = now_ns - item.trailing * self._byte_ns
            sent_ns = received_ns - item.size * self._byte_ns
            if isinstance(decoded, Inertial):
                reading = ImuReading(
                    sensor=decoded.sensor,
                    sent_ns=now_ns - (item.trailing + item.size) * self._byte_ns,
                    gyro_rad_s=decoded.gyro_rad_s,
                    acceleration_m_s2=decoded.acceleration_m_s2,
                    magnetic_t=decoded.magnetic_t,
                )
                odometer.accept(mounting.along_base(reading))
            if not isinstance(decoded, Totals):
                continue
            note = notes.get(received_ns) or records.Reading(received_ns=received_ns)
            requested_ns = note.requested_ns
            update = odometer.update(
                EncoderReading(
                    ticks=decoded.ticks,
                    received_ns=received_ns,
                    sent_ns=sent_ns if requested_ns is None else max(sent_ns, requested_ns),
                    requested_ns=requested_ns,
                    earliest_ns=note.earliest_ns,
                    after_reset=note.after_reset,
                    after_gap=note.after_gap,
                    unbroken=note.unbroken,
                )
            )
            if update.estimate is not None:
                self.estimates.append(update.estimate)
