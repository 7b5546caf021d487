"""Golden samples of the events that carry data."""

from __future__ import annotations

from typing import Any

import msgspec

from make.schema_files.samples import STAMP_NS
from yahboomd.core.model import EventKind
from yahboomd.tools.schemas.event_kinds import KINDS

_EXAMPLES: dict[EventKind, tuple[str, dict[str, Any]]] = {
    "port_slow": ("The port sends 4000 bytes/s of 11520.", {"bytes_per_s": 4000}),
    "runaway_against": (
        "right turns at 0.75 m/s against its command of -0.50 m/s.",
        {"commanded_m_s": -0.5, "measured_m_s": 0.75},
    ),
    "odometry_discontinuity": (
        "Counts were missing for a while. Up to 0.50 m of each wheel's travel are unknown.",
        {
            "cause": "gap_lost",
            "gap_s": 0.25,
            "unknown_m": 0.5,
            "counted_m": 0.125,
            "unsure_m": 0.0625,
        },
    ),
    "board_clock_unfit": ("The board's counts follow no regular tick.", {"period_ms": None}),
    "clock_stepped": (
        "This machine's clock was set back by 2.5 s, and stamps follow it.",
        {"by_s": -2.5},
    ),
    "clock_offset": (
        "cmd_vel: Its clock is 0.75 s ahead of this machine's.",
        {"source": "cmd_vel"},
    ),
    "asked_by_name": (
        "anna asked for yahboomd/estop/reset: Released.",
        {"name": "anna", "key": "yahboomd/estop/reset", "done": True, "times": 1},
    ),
    "paused": ("yahboomd did not run for 1.5 s.", {"duration_s": 1.5}),
    "gyro_unfit": ("The board sends no samples of its inertial sensor.", {"problem": "silent"}),
    "wheels_slip": (
        "The wheels slip: they counted a turn of 1.50 rad, and the gyro saw 0.50 rad.",
        {"wheels_rad": 1.5, "gyro_rad": 0.5, "over_s": 1.0},
    ),
}
"""The sentence and the data of one kind for each message."""


def _sample(kind: EventKind, words: str, data: dict[str, Any]) -> msgspec.Struct:
    info = KINDS[kind]
    named = {"kind": kind, "severity": info.severities[-1], "message": words}
    wheel = {"wheel": "right"} if info.wheel else {}
    return msgspec.convert({"stamp_ns": STAMP_NS, **named, **wheel, "data": data}, info.message)


SAMPLES: dict[str, msgspec.Struct] = {
    KINDS[kind].message.__name__: _sample(kind, *example) for kind, example in _EXAMPLES.items()
}
"""An example of every message of an event with ``data``, by name."""
