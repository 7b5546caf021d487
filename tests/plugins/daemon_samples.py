"""Samples as a daemon publishes them, for what shows them: a robot with two wheels that drives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from make.schema_files import samples
from yahboomd.core.bus import keys
from yahboomd.core.messages.codecs import NativeEncoding, encode
from yahboomd.core.messages.native import (
    BatterySample,
    EventSample,
    PoseSample,
    StatusSample,
    TwistSample,
    WheelsSample,
)
from yahboomd.tools.screens.dashboard import Dashboard

STAMP_NS = 1_700_000_000_000_000_000
NS_PER_S = 1_000_000_000


def status(
    state: str = "driving",
    *,
    driver: str | None = "cmd_vel",
    why: str = "cmd_vel drives.",
    since_s: float = 2.0,
    driver_s: float | None = 3.0,
    wheels: str | None = None,
    link: Mapping[str, Any] | None = None,
    command: Mapping[str, Any] | None = None,
    bus: Mapping[str, Any] | None = None,
) -> StatusSample:
    """A status; every group as given."""
    return StatusSample(
        stamp_ns=STAMP_NS,
        state=state,  # type: ignore[arg-type]
        driver=driver,
        since_ns=STAMP_NS - round(since_s * NS_PER_S),
        driver_since_ns=None if driver_s is None else STAMP_NS - round(driver_s * NS_PER_S),
        why=why,
        wheels=wheels,
        board={"port": "/dev/ttyUSB0", "dialect": "streamed", "version": "1.7.3"},
        link=link or {"readings": 100},
        command=command or {"received": 40, "accepted": 40},
        bus=bus or {"routers": "", "neighbours": 2},
    )


def pose(x: float = 1.5, y: float = -0.25, theta: float = 0.5, *, seq: int = 7) -> PoseSample:
    """A pose."""
    return PoseSample(
        stamp_ns=STAMP_NS,
        seq=seq,
        frame_id="odom",
        child_frame_id="base_link",
        x=x,
        y=y,
        theta=theta,
        covariance=(4e-4, 0.0, 0.0, 0.0, 9e-4, 0.0, 0.0, 0.0, 1.6e-3),
    )


def twist(vx: float = 0.3, wz: float = -0.25) -> TwistSample:
    """A twist."""
    return TwistSample(
        stamp_ns=STAMP_NS,
        seq=7,
        frame_id="base_link",
        vx=vx,
        vy=0.0,
        wz=wz,
        covariance=(0.0,) * 9,
    )


def wheels(
    speeds: tuple[float, ...] = (0.29, 0.31),
    commands: tuple[float, ...] = (0.3, 0.3),
    names: tuple[str, ...] = ("left", "right"),
) -> WheelsSample:
    """The wheels."""
    return WheelsSample(
        stamp_ns=STAMP_NS,
        seq=7,
        names=names,
        ticks=tuple(1000 * (index + 1) for index in range(len(names))),
        position_rad=(1.0,) * len(names),
        speed_m_s=speeds,
        command_m_s=commands,
    )


def event(message: str = "The board reset itself.", severity: str = "warning") -> EventSample:
    """Something that happened."""
    return EventSample(
        stamp_ns=STAMP_NS,
        kind="board_reset",
        severity=severity,  # type: ignore[arg-type]
        message=message,
    )


def battery(volts: float = 7.4) -> BatterySample:
    """The battery."""
    return BatterySample(stamp_ns=STAMP_NS, volts=volts)


def all_samples(encoding: NativeEncoding = "json") -> dict[str, bytes]:
    """A sample of each key, as bytes."""
    return {
        keys.STATUS: encode(status(), encoding),
        keys.POSE: encode(pose(), encoding),
        keys.TWIST: encode(twist(), encoding),
        keys.WHEELS: encode(wheels(), encoding),
        keys.IMU: encode(samples.NATIVE["ImuSample"], encoding),
        keys.BATTERY: encode(battery(), encoding),
        keys.EVENTS: encode(event(), encoding),
    }


def of_version(version: str, encoding: NativeEncoding = "json") -> dict[str, bytes]:
    """A sample of each key from a daemon that is ``newer``, or as old as the ``first`` one."""
    unknown = {"numbers": [1, 2.5], "deep": {"a": {"b": {"c": {"d": 1}}}}, "none": None}
    encoded: dict[str, bytes] = {}
    for key, payload in all_samples().items():
        fields = msgspec.json.decode(payload)
        groups = [name for name, value in fields.items() if isinstance(value, dict)]
        if version == "first":
            absent = {"driver_since_ns", "magnetic_t"}
            fields = {name: value for name, value in fields.items() if name not in absent}
            fields.update({name: {} for name in groups})
        else:
            fields.update({name: {**fields[name], **unknown} for name in groups})
            words = {"state": "docked", "severity": "notice", "kind": "docked", "data": unknown}
            fields.update({name: words[name] for name in words if name in fields})
            fields["later"] = unknown
            if key == keys.EVENTS:
                fields["data"] = unknown
        encoded[key] = (msgspec.json if encoding == "json" else msgspec.msgpack).encode(fields)
    return encoded


def driving(now_ns: int = 0) -> Dashboard:
    """A dashboard that has seen one of each."""
    dashboard = Dashboard()
    for key, payload in all_samples().items():
        dashboard.accept(key, payload, now_ns)
    return dashboard
