"""A header, and a ring in memory."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from yahboomd.blackbox.box_file import (
    Header,
    ImuSettings,
    OdometerSettings,
    encode_header,
)
from yahboomd.blackbox.ring import Ring
from yahboomd.model import Kinematics, Motor

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


@pytest.fixture
def header() -> Header:
    return HEADER


@pytest.fixture
def memory() -> Callable[..., tuple[bytearray, Ring]]:
    """Makes a ring of so many segments, in bytes that can be looked at."""

    def make(segments: int = 4) -> tuple[bytearray, Ring]:
        head = encode_header(HEADER)
        buffer = bytearray(head + bytes(segments * SEGMENT_BYTES))
        return buffer, Ring(buffer, len(head), SEGMENT_BYTES)

    return make
