"""Golden samples of the events that carry data."""

from __future__ import annotations

import msgspec

from yahboomd.messages.event_kinds import (
    BoardClockData,
    BoardClockEvent,
    ClockOffsetData,
    ClockOffsetEvent,
    ClockSteppedData,
    ClockSteppedEvent,
    GyroUnfitData,
    GyroUnfitEvent,
    OdometryGapData,
    OdometryGapEvent,
    PausedData,
    PausedEvent,
    PortSlowData,
    PortSlowEvent,
    WheelFaultData,
    WheelFaultEvent,
    WheelsSlipData,
    WheelsSlipEvent,
)
from yahboomd.messages.samples import STAMP_NS

_AT_FAULT = "right turns at 0.75 m/s against its command of -0.50 m/s."
_GAP = "Counts were missing for a while. Up to 0.50 m of each wheel's travel are unknown."

SAMPLES: dict[str, msgspec.Struct] = {
    type(message).__name__: message
    for message in (
        PortSlowEvent(
            stamp_ns=STAMP_NS,
            kind="port_slow",
            severity="warning",
            message="The port sends 4000 bytes/s of 11520.",
            data=PortSlowData(bytes_per_s=4000),
        ),
        WheelFaultEvent(
            stamp_ns=STAMP_NS,
            kind="runaway_against",
            severity="error",
            message=_AT_FAULT,
            wheel="right",
            data=WheelFaultData(commanded_m_s=-0.5, measured_m_s=0.75),
        ),
        OdometryGapEvent(
            stamp_ns=STAMP_NS,
            kind="odometry_discontinuity",
            severity="warning",
            message=_GAP,
            data=OdometryGapData(
                cause="gap_lost", gap_s=0.25, unknown_m=0.5, counted_m=0.125, unsure_m=0.0625
            ),
        ),
        BoardClockEvent(
            stamp_ns=STAMP_NS,
            kind="board_clock_unfit",
            severity="warning",
            message="The board's counts follow no regular tick.",
            data=BoardClockData(period_ms=None),
        ),
        ClockSteppedEvent(
            stamp_ns=STAMP_NS,
            kind="clock_stepped",
            severity="warning",
            message="This machine's clock was set back by 2.5 s, and stamps follow it.",
            data=ClockSteppedData(by_s=-2.5),
        ),
        ClockOffsetEvent(
            stamp_ns=STAMP_NS,
            kind="clock_offset",
            severity="warning",
            message="cmd_vel: Its clock is 0.75 s ahead of this machine's.",
            data=ClockOffsetData(source="cmd_vel"),
        ),
        PausedEvent(
            stamp_ns=STAMP_NS,
            kind="paused",
            severity="warning",
            message="yahboomd did not run for 1.5 s.",
            data=PausedData(duration_s=1.5),
        ),
        GyroUnfitEvent(
            stamp_ns=STAMP_NS,
            kind="gyro_unfit",
            severity="warning",
            message="The board sends no samples of its inertial sensor.",
            data=GyroUnfitData(problem="silent"),
        ),
        WheelsSlipEvent(
            stamp_ns=STAMP_NS,
            kind="wheels_slip",
            severity="info",
            message="The wheels slip: they counted a turn of 1.50 rad, and the gyro saw 0.50 rad.",
            data=WheelsSlipData(wheels_rad=1.5, gyro_rad=0.5, over_s=1.0),
        ),
    )
}
"""An example of every message of an event with ``data``, by name."""
