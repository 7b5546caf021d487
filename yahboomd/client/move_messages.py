"""The messages and keys of `yahboomd moves`: requests of clients, and progress."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import msgspec
from msgspec import Meta

from yahboomd.core.messages.native import Stamp

SOURCE = "cmd_vel/moves"
"""The key on which the moves are commanded: any other source has precedence."""

MOVES = "yahboomd/moves"
START = "yahboomd/moves/start"
CANCEL = "yahboomd/moves/cancel"
PAUSE = "yahboomd/moves/pause"
RESUME = "yahboomd/moves/resume"
BEAT = "yahboomd/moves/beat"
HOLDER = "yahboomd/moves/holder"
"""Below it, the client that asked declares a liveliness token with the name that it gave."""

BEAT_S = 0.1
"""The client that asked for a move sends its id this often."""

SILENCE_S = 0.5
"""A move whose client is silent for this time ends."""

MOST_MOVES = 100
MOST_POINTS = 2000
MOST_WAY_M = 1000.0
MOST_TURN_RAD = 700.0
MOST_BYTES = 65_000
"""Of a request: a path has many points."""

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
    "exchanged",
    "uncertain",
    "not_obeyed",
    "short",
    "service_ended",
]
"""The reasons for which a move ends."""

_Way = Annotated[float, Meta(ge=-MOST_WAY_M, le=MOST_WAY_M)]
_Turn = Annotated[float, Meta(ge=-MOST_TURN_RAD, le=MOST_TURN_RAD)]
_Cut = Annotated[float, Meta(ge=0.0, le=1000.0)]
_Name = Annotated[str, Meta(max_length=64)]
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


class MoveRequest(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Asks for one move or several in a row. The reply's data has their id."""

    moves: Annotated[tuple[Move, ...], Meta(min_length=1, max_length=MOST_MOVES)]
    by: Annotated[_Name | None, Meta(description="Who asks, for people.")] = None
    holder: Annotated[
        _Name | None,
        Meta(
            description="The last part of a liveliness token yahboomd/moves/holder/{holder} of "
            "this client: if it goes, the moves end."
        ),
    ] = None
    uncertain_m: Annotated[
        _Limit | None,
        Meta(
            description="The moves end once the place is this uncertain (standard deviation since "
            "their begin, m). Absent: 0.5."
        ),
    ] = None


class MoveBeat(msgspec.Struct, frozen=True, kw_only=True):
    """The client that asked is there: sent ten times a second, or the moves end."""

    id: Annotated[str, Meta(description="Of the moves.")]


class MoveChoice(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Which moves to cancel, pause or resume."""

    id: Annotated[str | None, Meta(description="Their id; absent: those that are running.")] = None


class MoveSample(msgspec.Struct, frozen=True, kw_only=True):
    """The progress of the moves, and their end."""

    stamp_ns: Stamp
    id: Annotated[str, Meta(description="Of the moves, as in the reply to their start.")]
    state: Annotated[str, Meta(description="running, paused or ended.")]
    kind: Annotated[str, Meta(description="Of the move that is driven.")]
    index: Annotated[int, Meta(ge=0, description="Of the move that is driven, from 0.")]
    count: Annotated[int, Meta(ge=1, description="How many moves were asked for.")]
    done: Annotated[float, Meta(ge=0.0, le=1.0, description="The share of all moves.")]
    left_m: Annotated[float, Meta(description="The way that is left of all moves.")]
    left_rad: Annotated[float, Meta(description="The turns in place that are left of all moves.")]
    left_s: Annotated[float, Meta(description="The time that is left, at least.")]
    reason: Annotated[
        str, Meta(description="Why they ended: reached, or another word; empty before.")
    ] = ""
    message: Annotated[str, Meta(description="The same as a sentence; empty before.")] = ""
    by: Annotated[str, Meta(description="Who asked.")] = ""
