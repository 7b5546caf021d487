"""The bytes between a simulated robot and its daemon, as the records of a black box."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

from board_bench import BoardPort
from fault_bench import FaultBench
from made_boxes import into

from yahboomd import __version__
from yahboomd.blackbox.box_file import (
    Header,
    ImuSettings,
    OdometerSettings,
    deflated,
    encode_header,
)
from yahboomd.blackbox.records import (
    Anchor,
    Armed,
    Closed,
    Happened,
    Identified,
    Meaning,
    Opened,
    PoseSet,
    ReadingRecord,
    Received,
    Record,
    Renewal,
    Written,
    encode,
)
from yahboomd.blackbox.ring import Ring
from yahboomd.core.model import EncoderReading
from yahboomd.core.odometry import snapshot
from yahboomd.core.odometry.odometer import Odometer
from yahboomd.simulation.options import SimulationOptions


class TappedOdometer:
    """An odometer some of whose methods are replaced by others."""

    def __init__(self, odometer: Odometer, **methods: Callable[..., object]) -> None:
        self.odometer = odometer
        vars(self).update(methods)

    def __getattr__(self, name: str) -> object:
        return getattr(self.odometer, name)


class WireBench(FaultBench):
    """A daemon without its bus, whose bytes are kept.

    Attributes:
        records: Them.
        readings: Of the counters, as the daemon had them.
    """

    def __init__(self, folder: Path, dialect: str, *overrides: str, **simulation: object) -> None:
        options = SimulationOptions(**{"dialect": dialect, **simulation})  # type: ignore[arg-type]
        super().__init__(folder, overrides, options)
        self.records: list[Record] = []
        self.readings: list[EncoderReading] = []
        reading, connected = self.controller.reading, self.controller.connected

        def keep(each: EncoderReading) -> None:
            self.readings.append(each)
            reading(each)

        def identified(board, identity) -> None:
            self.note(Identified(dialect=identity.dialect.name, settings=identity.settings))
            connected(board, identity)

        self._tap_odometer()
        event = self.heard.event

        def happened(each) -> None:
            self.note(Happened(event=each))
            event(each)

        self.heard.event = happened  # type: ignore[method-assign]
        self.controller.reading = keep  # type: ignore[method-assign]
        self.controller.connected = identified  # type: ignore[method-assign]

    def _tap_odometer(self) -> None:
        odometer = self.controller._odometer
        update, armed, set_pose = odometer.update, odometer.armed, odometer.set_pose
        set_period = odometer.set_sample_period

        def updated(each: EncoderReading):
            if each.requested_ns or each.after_gap or each.after_reset or each.unbroken:
                names = ReadingRecord.__struct_fields__
                self.note(ReadingRecord(**{name: getattr(each, name) for name in names}))
            return update(each)

        def was_armed() -> None:
            self.note(Armed())
            armed()

        def was_set(pose, covariance=None) -> None:
            self.note(PoseSet(pose=pose, covariance=covariance))
            set_pose(pose, covariance)

        def renewed(period_ns, *, each_line=False, age_ns=0) -> None:
            self.note(Renewal(period_ns=period_ns, each_line=each_line, age_ns=age_ns))
            set_period(period_ns, each_line=each_line, age_ns=age_ns)

        self.controller._odometer = TappedOdometer(  # type: ignore[assignment]
            odometer,
            update=updated,
            armed=was_armed,
            set_pose=was_set,
            set_sample_period=renewed,
        )

    def anchor(self, dialect: str) -> None:
        """The state of the odometer, between two reads."""
        state, port = snapshot.save(self.controller._odometer.odometer), self.port  # type: ignore[attr-defined]
        self.note(Anchor(port=port.name, byte_ns=port.byte_ns, dialect=dialect, state=state))

    def note(self, meaning: Meaning) -> None:
        self.records.append(Record(self.clock.now_ns(), meaning))

    async def _open(self) -> BoardPort:
        port = await super()._open()
        if not self.records:
            self.anchor("")
        self.note(Opened(port=port.name, byte_ns=port.byte_ns))
        listen, write, close = port.listen, port.write, port.close

        def hear(data: bytes, on_data: Callable[[bytes], None]) -> None:
            self.note(Received(data=data))
            on_data(data)

        def written(data: bytes) -> None:
            self.note(Written(data=data))
            write(data)

        def closed() -> None:
            self.note(Closed())
            close()

        port.listen = lambda on_data, on_lost: listen(lambda data: hear(data, on_data), on_lost)  # type: ignore[method-assign]
        port.write = written  # type: ignore[method-assign]
        port.close = closed  # type: ignore[method-assign]
        return port


SIZE = 1 << 20


def header_of(bench: WireBench) -> Header:
    """What belongs to all records."""
    config = bench.config
    return Header(
        version=__version__,
        machine="simulated",
        boot_id="",
        pid=1,
        started_ns=bench.records[0].at_ns,
        started_wall_ns=1_700_000_000_000_000_000,
        config=config.as_data(),
        profile=config.board.profile,
        odometer=OdometerSettings(
            kinematics=config.kinematics(),
            motors=config.motors(),
            speed_max_m_s=config.odometry.max_wheel_speed_m_s,
            noise_m=config.odometry.noise_m,
            fused=config.odometry.heading == "fused",
            gyro_scale=None,
        ),
        imu=ImuSettings(axes="x y z", gyro_axes="x y z", gyro_factor=1.0),
        segment_bytes=SIZE,
    )


def save(path: Path, bench: WireBench) -> None:
    """The bytes as a saved box, of one segment."""
    head = encode_header(header_of(bench))
    buffer = bytearray(head + bytes(SIZE))
    ring = Ring(into(buffer), len(head), SIZE, 1)
    for at_ns, meaning in bench.records:
        ring.write(*encode(meaning), at_ns)
    path.write_bytes(deflated(bytes(buffer)))


async def drive_about(bench: WireBench) -> None:
    """A short drive with a curve, and rest before and after it."""
    await bench.ready()
    await asyncio.sleep(0.5)
    await bench.drive(1.5, 0.3, 0.6)
    await bench.drive(1.0, -0.2)
    await asyncio.sleep(1.0)
