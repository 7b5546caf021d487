"""Every kind of event: its severities, when it is published, and its ``data``.

Only kinds of :data:`~yahboomd.core.model.EventKind` can be published, and each has a row here.
A kind with ``data`` has a message of its own: an event with the types of its data.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from yahboomd.core.messages.native import EventSample, Stamp
from yahboomd.core.model import EventKind, Severity


class _EventOfKind(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    stamp_ns: Stamp
    severity: Annotated[
        str, Meta(description="info, warning or error; a later version may have others.")
    ]
    message: Annotated[str, Meta(description="One sentence for people.")]
    wheel: Annotated[str | None, Meta(description="The motor concerned, by name.")] = None


class WheelFaultData(msgspec.Struct, frozen=True, kw_only=True):
    """The commanded and the measured motion of a wheel."""

    commanded_m_s: Annotated[float, Meta(description="Commanded speed of the rim, m/s.")]
    measured_m_s: Annotated[float, Meta(description="Measured speed of the rim, m/s.")]


class WheelFaultEvent(_EventOfKind, frozen=True, kw_only=True):
    """A wheel does not do what it is commanded."""

    kind: Literal[
        "runaway_against",
        "runaway_fast",
        "turns_without_command",
        "no_counts",
        "not_started",
        "off_speed",
        "stop_not_obeyed",
        "rolled",
    ]
    data: WheelFaultData


class OdometryGapData(msgspec.Struct, frozen=True, kw_only=True):
    """A gap in the readings, and what it means for the pose."""

    cause: Annotated[
        str,
        Meta(
            description="reset: the board reported a reset; reset_unseen: its counts fell to near "
            "zero; gap_kept: readings were missing and the counts went on; gap_lost: readings were "
            "missing and the counts may be lost; rebased: the counts jumped, and stayed there. A "
            "later version may have others."
        ),
    ]
    gap_s: Annotated[float, Meta(description="From the last reading before it to the next, s.")]
    unknown_m: Annotated[
        float, Meta(description="How much of each wheel's travel is unknown at most, m.")
    ]
    counted_m: Annotated[
        float, Meta(description="The farthest that a wheel was counted to roll meanwhile, m.")
    ]
    unsure_m: Annotated[
        float,
        Meta(description="How far from the pose the base may be, by the shape of its way, m."),
    ]


class OdometryGapEvent(_EventOfKind, frozen=True, kw_only=True):
    """Readings were missing, or the board was reset."""

    kind: Literal["odometry_discontinuity", "odometry_bridged"]
    data: OdometryGapData


class BoardClockData(msgspec.Struct, frozen=True, kw_only=True):
    """The board's own clock."""

    period_ms: Annotated[
        float | None, Meta(description="Period in which it renews its counts, ms; null: none fits.")
    ]


class BoardClockEvent(_EventOfKind, frozen=True, kw_only=True):
    """Another period of the board's counts was found, or none."""

    kind: Literal["board_clock_period", "board_clock_unfit"]
    data: BoardClockData


class PersonData(msgspec.Struct, frozen=True, kw_only=True):
    """A key that was used, and whose alone it is."""

    name: Annotated[str, Meta(description="The person; empty if the key is no person's.")]
    key: Annotated[
        str | None, Meta(description="The service's key, or the source; null: no source drives.")
    ]
    done: Annotated[bool | None, Meta(description="Whether the service did it; null: no service.")]
    times: Annotated[
        int | None,
        Meta(
            description="How many requests this event stands for: those that repeat one within "
            "10 s, with the same outcome, are in one event; null: no service."
        ),
    ] = None


class PersonEvent(_EventOfKind, frozen=True, kw_only=True):
    """Who did something, in a fleet."""

    kind: Literal["asked_by_name", "driver_changed"]
    data: PersonData


class ClockSteppedData(msgspec.Struct, frozen=True, kw_only=True):
    """A step of this machine's clock."""

    by_s: Annotated[float, Meta(description="How far it was set forward, s; negative: back.")]


class ClockSteppedEvent(_EventOfKind, frozen=True, kw_only=True):
    """This machine's clock was set by a second or more, and stamps follow it."""

    kind: Literal["clock_stepped"]
    data: ClockSteppedData


class ClockOffsetData(msgspec.Struct, frozen=True, kw_only=True):
    """A clock that is off."""

    source: Annotated[str, Meta(description="The command source, by its key.")]


class ClockOffsetEvent(_EventOfKind, frozen=True, kw_only=True):
    """The clock of a command source differs by more than 0.1 s."""

    kind: Literal["clock_offset"]
    data: ClockOffsetData


class PausedData(msgspec.Struct, frozen=True, kw_only=True):
    """A pause of yahboomd."""

    duration_s: Annotated[float, Meta(description="How long it did not run, s.")]


class PausedEvent(_EventOfKind, frozen=True, kw_only=True):
    """yahboomd did not run for a while."""

    kind: Literal["paused"]
    data: PausedData


class PortSlowData(msgspec.Struct, frozen=True, kw_only=True):
    """The output of the serial port."""

    bytes_per_s: Annotated[int, Meta(description="Its measured rate, bytes/s.")]


class PortSlowEvent(_EventOfKind, frozen=True, kw_only=True):
    """The serial port sends slower than its rate."""

    kind: Literal["port_slow"]
    data: PortSlowData


class GyroUnfitData(msgspec.Struct, frozen=True, kw_only=True):
    """The fault of the gyro."""

    problem: Annotated[
        str,
        Meta(
            description="silent: no samples come; saturated: its rate is at the limit; "
            "implausible: it is stuck, its zero jumped, or it turns against the wheels; unchecked: "
            "its sign is not known yet. A later version may have others."
        ),
    ]


class GyroUnfitEvent(_EventOfKind, frozen=True, kw_only=True):
    """The gyro cannot be believed."""

    kind: Literal["gyro_unfit"]
    data: GyroUnfitData


class WheelsSlipData(msgspec.Struct, frozen=True, kw_only=True):
    """The turns of about a second, by the wheels and by the gyro."""

    wheels_rad: Annotated[float, Meta(description="The turn that the wheels counted, rad.")]
    gyro_rad: Annotated[float, Meta(description="The turn that the gyro saw, rad.")]
    over_s: Annotated[float, Meta(description="The time in which they turned, s.")]


class WheelsSlipEvent(_EventOfKind, frozen=True, kw_only=True):
    """Wheels and gyro disagree by more than their covariance explains."""

    kind: Literal["wheels_slip"]
    data: WheelsSlipData


class KindInfo(msgspec.Struct, frozen=True):
    """One kind of event.

    Attributes:
        message: Its message; :class:`EventSample` if it has no ``data``.
        wheel: Whether it may name a motor.
    """

    severities: tuple[Severity, ...]
    when: str
    message: type[msgspec.Struct] = EventSample
    wheel: bool = False

    @property
    def data(self) -> type[msgspec.Struct] | None:
        """The type of its ``data``; None if it has none."""
        if self.message is EventSample:
            return None
        fields = {field.name: field.type for field in msgspec.structs.fields(self.message)}
        data: type[msgspec.Struct] = fields["data"]
        return data


def _wheel(when: str, severity: Severity = "error") -> KindInfo:
    return KindInfo((severity,), when, WheelFaultEvent, wheel=True)


KINDS: dict[EventKind, KindInfo] = {
    "asked_by_name": KindInfo(
        ("info",),
        "In a fleet: somebody used a service by a key that is one person's alone.",
        PersonEvent,
    ),
    "driver_changed": KindInfo(
        ("info",), "In a fleet: another source has control, or none any more.", PersonEvent
    ),
    "connected": KindInfo(("info",), "A board was recognised."),
    "disconnected": KindInfo(("error",), "A connected board was lost."),
    "board_unfit": KindInfo(
        ("error",), "The board's settings do not fit the configuration: the robot does not drive."
    ),
    "unguarded": KindInfo(
        ("error",),
        "The guard has ended, does not answer or did not start: the robot does not drive until one "
        "has the port. `yahboomd run` starts another one.",
    ),
    "board_reset": KindInfo(
        ("warning",), "The board reset itself, by its own report or by its counts."
    ),
    "reset_loop": KindInfo(("error",), "The board reset itself three times in 10 s: a fault."),
    "setting_stored": KindInfo(
        ("info",), "A setting was stored on the board (`board.write_settings`)."
    ),
    "setting_not_stored": KindInfo(("error",), "The board did not store a setting."),
    "stop_not_seen": KindInfo(
        ("error",), "A connection ended, and the wheels were not seen to stand."
    ),
    "battery_low": KindInfo(("warning",), "The battery is low at rest (`board.battery_low_v`)."),
    "battery_empty": KindInfo(
        ("error",),
        "The battery is empty at rest (`board.battery_stop_v`): programs begin no motion.",
    ),
    "battery_good": KindInfo(("info",), "The battery is neither low nor empty any more."),
    "battery_unanswered": KindInfo(
        ("warning",), "The board left three questions for the voltage in a row unanswered."
    ),
    "latency_timer": KindInfo(
        ("warning",), "The USB adapter holds bytes back for longer than it needs to."
    ),
    "port_shared": KindInfo(
        ("warning",), "Another process has the board's port open, and takes some of its answers."
    ),
    "port_slow": KindInfo(
        ("warning",),
        "The port sends slower than its rate, once for each connection.",
        PortSlowEvent,
    ),
    "line_noisy": KindInfo(
        ("warning",),
        "The line damages bytes and a wheel did not follow its command: cut for a moment.",
        wheel=True,
    ),
    "runaway_against": _wheel("A wheel turns against its command."),
    "runaway_fast": _wheel("A wheel turns much faster than commanded."),
    "turns_without_command": _wheel("A wheel turns without a command."),
    "no_counts": _wheel("A wheel is commanded, and its encoder shows no motion."),
    "not_started": _wheel(
        "A wheel does not begin to turn: let go, and driven again by the next command.", "warning"
    ),
    "off_speed": _wheel("A wheel turns at another speed than commanded.", "warning"),
    "stop_not_obeyed": _wheel("The wheels do not obey a stop: the motors are cut."),
    "rolled": _wheel("A wheel that was let go rolled: held until the next drive.", "warning"),
    "odometry_discontinuity": KindInfo(
        ("warning",), "A part of the way was not counted; the pose may be off.", OdometryGapEvent
    ),
    "odometry_bridged": KindInfo(
        ("info",), "Readings were missing, and nothing was lost.", OdometryGapEvent
    ),
    "board_clock_period": KindInfo(
        ("info",), "A period of the board's counts was found.", BoardClockEvent
    ),
    "board_clock_unfit": KindInfo(
        ("warning",), "The board's counts follow no regular period.", BoardClockEvent
    ),
    "gyro_unfit": KindInfo(
        ("warning",),
        "The gyro is silent, saturated, implausible or unchecked: the wheels have the heading.",
        GyroUnfitEvent,
    ),
    "gyro_fit": KindInfo(("info",), "The gyro behaved for a second, or turned with the wheels."),
    "wheels_slip": KindInfo(
        ("info",),
        "The turn of the wheels and that of the gyro differ by more than 0.1 rad in a second.",
        WheelsSlipEvent,
    ),
    "clock_stepped": KindInfo(
        ("info", "warning"),
        "This machine's clock was set by a second or more; a warning if it was set back.",
        ClockSteppedEvent,
    ),
    "clock_offset": KindInfo(
        ("warning",),
        "A command source's clock differs by more than 0.1 s, at most once in a minute.",
        ClockOffsetEvent,
    ),
    "paused": KindInfo(("warning",), "yahboomd did not run for 0.3 s or more.", PausedEvent),
    "estop": KindInfo(("warning",), "The emergency stop was engaged."),
    "estop_released": KindInfo(("info",), "The emergency stop was released, or a fault cleared."),
    "estop_release_refused": KindInfo(
        ("warning",), "A release was sent to `yahboomd/estop`, which only engages."
    ),
    "pose_refused": KindInfo(
        ("warning",), "A sample was to set the pose, and is in another frame or is no pose."
    ),
    "pose_set": KindInfo(("info",), "A client set the pose."),
    "second_daemon": KindInfo(("warning",), "Another yahboomd uses the same namespace."),
    "router_joined": KindInfo(("warning",), "A Zenoh router was joined: others may drive."),
    "router_lost": KindInfo(("info",), "A Zenoh router is gone."),
}
"""Every kind of event."""

EVENTS: dict[str, type[msgspec.Struct]] = {
    info.message.__name__: info.message
    for info in KINDS.values()
    if info.message is not EventSample
}
"""The messages of the kinds that have ``data``, by name."""
