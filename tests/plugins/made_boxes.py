"""Black boxes of records that a test writes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from yahboomd.blackbox.box_file import (
    Header,
    ImuSettings,
    OdometerSettings,
    Saved,
    deflated,
    encode_header,
)
from yahboomd.blackbox.records import Meaning, encode
from yahboomd.blackbox.ring import Ring
from yahboomd.core.model import Kinematics, Motor

SEGMENT_BYTES = 4096

HEADER = Header(
    version="0.1.0",
    machine="x86_64",
    boot_id="c1f3",
    pid=17,
    started_ns=5_000_000_000,
    started_wall_ns=1_700_000_000_000_000_000,
    config={"zenoh": {"namespace": "bot1"}},
    profile="520",
    odometer=OdometerSettings(
        kinematics=Kinematics(
            name="differential",
            wheels=("left", "right"),
            inverse=((1.0, 0.0, -0.085), (1.0, 0.0, 0.085)),
            forward=((0.5, 0.5), (0.0, 0.0), (-1.0 / 0.17, 1.0 / 0.17)),
        ),
        motors=tuple(
            Motor(
                name=name,
                wheel=wheel,
                position=wheel + 1,
                radius_m=0.0335,
                ticks_per_revolution=1320.0,
            )
            for wheel, name in enumerate(("left", "right"))
        ),
        speed_max_m_s=2.0,
        noise_m=1e-5,
        fused=False,
        gyro_scale=None,
    ),
    imu=ImuSettings(axes="x y z", gyro_axes="x y z", gyro_factor=1.0),
    segment_bytes=SEGMENT_BYTES,
)

SECOND_NS = 1_000_000_000
END_NS = 1_000 * SECOND_NS
WALL_NS = 1_795_370_130_000_000_000
"""2026-11-22 17:55:30 UTC, at END_NS."""


def into(buffer: bytearray) -> Callable[[bytes, int], None]:
    """Stores to this buffer, as a ring stores to its file."""

    def store(data: bytes, at: int) -> None:
        buffer[at : at + len(data)] = data

    return store


def ring_of(*happened: tuple[float, Meaning]) -> bytes:
    """A ring with records, each at a number of seconds before the end."""
    header = msgspec.structs.replace(
        HEADER, started_ns=END_NS - 90 * SECOND_NS, started_wall_ns=WALL_NS - 90 * SECOND_NS
    )
    head = encode_header(header)
    buffer = bytearray(head + bytes(8 * SEGMENT_BYTES))
    ring = Ring(into(buffer), len(head), SEGMENT_BYTES, 8)
    for before_s, meaning in happened:
        ring.write(*encode(meaning), END_NS - round(before_s * SECOND_NS))
    return bytes(buffer)


def saved_box(
    *happened: tuple[float, Meaning],
    reasons: tuple[str, ...] = ("estop",),
    config: dict[str, Any] = HEADER.config,
) -> bytes:
    """A saved box with records, each at a number of seconds before the save."""
    ring = ring_of(*happened)
    header = msgspec.structs.replace(
        HEADER,
        started_ns=END_NS - 90 * SECOND_NS,
        started_wall_ns=WALL_NS - 90 * SECOND_NS,
        config=config,
        saved=Saved(reasons=reasons, at_ns=END_NS, wall_ns=WALL_NS),
    )
    begin = len(encode_header(msgspec.structs.replace(header, saved=None)))
    return deflated(encode_header(header) + ring[begin:])
