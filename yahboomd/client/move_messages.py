"""The messages and keys of `yahboomd moves`: what a client asks for, and what it is sent."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import msgspec
from msgspec import Meta

MOST_POINTS = 5000
MOST_WAY_M = 1000.0
MOST_TURN_RAD = 700.0

Reason: TypeAlias = Literal[
    "reached",
    "cancelled",
    "client_silent",
    "client_gone",
    "taken_over",
    "estop",
    "fault",
    "board_lost",
    "daemon_lost",
    "no_pose",
    "pose_changed",
    "blocked",
    "slipping",
    "uncertain",
    "not_obeyed",
    "short",
    "service_ended",
]
"""The reasons for which a move ends."""

_Way = Annotated[float, Meta(ge=-MOST_WAY_M, le=MOST_WAY_M)]
_Turn = Annotated[float, Meta(ge=-MOST_TURN_RAD, le=MOST_TURN_RAD)]
_Cut = Annotated[float, Meta(ge=0.0, le=1000.0)]
_Limit = Annotated[float, Meta(gt=0.0, le=1000.0)]
_Point: TypeAlias = Annotated[tuple[float, ...], Meta(min_length=2, max_length=3)]


class Move(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One move. Lengths in metres, angles in radians, counter-clockwise."""

    kind: Annotated[
        Literal["straight", "turn", "arc", "go_to", "follow"],
        Meta(
            description="straight (distance_m, left_m), turn (angle_rad), arc (radius_m, "
            "angle_rad), go_to (x, y, theta) or follow (points)."
        ),
    ]
    distance_m: Annotated[
        _Way, Meta(description="straight: the way ahead; negative: backward.")
    ] = 0.0
    left_m: Annotated[
        _Way, Meta(description="straight: the way to the left, for mecanum wheels.")
    ] = 0.0
    angle_rad: Annotated[_Turn, Meta(description="turn, arc: the turn; positive: to the left.")] = (
        0.0
    )
    radius_m: Annotated[
        float,
        Meta(ge=0.0, le=MOST_WAY_M, description="arc: the radius of the way of the base's middle."),
    ] = 0.0
    x: Annotated[float | None, Meta(description="go_to: the goal, m.")] = None
    y: Annotated[float | None, Meta(description="go_to: the goal, m.")] = None
    theta: Annotated[
        float | None, Meta(description="go_to: the heading there, rad; absent: any.")
    ] = None
    points: Annotated[
        tuple[_Point, ...],
        Meta(
            max_length=MOST_POINTS,
            description="follow: points [x, y] in m, or [x, y, theta] with a heading in rad; the "
            "headings count on mecanum wheels, and the last one on every base that turns in "
            "place.",
        ),
    ] = ()
    backward: Annotated[
        bool,
        Meta(
            description="arc: drive it backward. go_to, follow: drive backward if that needs less "
            "turning."
        ),
    ] = False
    look_ahead_m: Annotated[
        _Limit | None,
        Meta(description="Over how many metres an error across the way decays; absent: 0.12."),
    ] = None
    corner_m: Annotated[
        _Cut | None,
        Meta(
            description="follow: how far a corner may be cut, m; sharper ones are driven with a "
            "stop. Absent: 0.01."
        ),
    ] = None
    speed_m_s: Annotated[
        _Limit | None,
        Meta(description="The largest speed; absent: 0.3, or the configured limit if lower."),
    ] = None
    turn_rad_s: Annotated[
        _Limit | None,
        Meta(description="The largest turning speed; absent: 1.5, or the configured limit."),
    ] = None
    acceleration_m_s2: Annotated[_Limit | None, Meta(description="Absent: 0.6, or lower.")] = None
    acceleration_rad_s2: Annotated[_Limit | None, Meta(description="Absent: 3, or lower.")] = None
    jerk_m_s3: Annotated[_Limit | None, Meta(description="Absent: 4, or lower.")] = None
    jerk_rad_s3: Annotated[_Limit | None, Meta(description="Absent: 20, or lower.")] = None
