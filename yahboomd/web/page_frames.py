"""The frames between page and server in JSON: the page's have one object each, ours a list."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import Meta

Role: TypeAlias = Literal["driver", "viewer"]

MAX_BYTES = 2048
"""The most bytes of a frame, and of the body of a request."""

_Place = Annotated[float, Meta(ge=-1e6, le=1e6)]
_Speed = Annotated[float, Meta(gt=0.0, le=1000.0)]
_Number = Annotated[int, Meta(ge=0, le=1 << 53)]


class Drive(msgspec.Struct, frozen=True, tag="drive"):
    """A velocity, in m/s and rad/s, and the last beat that the page received."""

    beat: _Number
    vx: float
    vy: float
    wz: float


class Go(msgspec.Struct, frozen=True, tag="go"):
    """A place of the map is held: the robot goes there, or turns to look there.

    Attributes:
        x: Metres, in the odometry frame.
        y: Metres.
        speed_m_s: The fastest that the page's speed limit allows.
        turn_rad_s: The same for turning.
    """

    beat: _Number
    x: _Place
    y: _Place
    turn: bool
    speed_m_s: _Speed
    turn_rad_s: _Speed


class Control(msgspec.Struct, frozen=True, tag="control"):
    """The page wants control, or gives it back.

    Attributes:
        if_free: It came with a touch: control is not taken from another page.
    """

    want: bool
    if_free: bool = False


class RequestFrame(msgspec.Struct, frozen=True, tag="request"):
    """A request of the page, which is answered."""

    id: _Number
    do: str
    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0


class StopFrame(msgspec.Struct, frozen=True, tag="estop"):
    """The page engages the emergency stop."""

    id: _Number = 0


class Seen(msgspec.Struct, frozen=True, tag="seen"):
    """The last beat that a page without commands received."""

    beat: _Number


class Tool(msgspec.Struct, frozen=True, tag="tool"):
    """The page uses a tool, such as the calibration; it is answered."""

    id: _Number
    do: str
    args: dict[str, Any] = {}


class HoldFrame(msgspec.Struct, frozen=True, tag="hold"):
    """The button of a calibration is held, for the movement of this question."""

    beat: _Number
    question: str


class LetGo(msgspec.Struct, frozen=True, tag="let_go"):
    """The button of a calibration was let go."""


PageFrame: TypeAlias = (
    Drive | Go | Control | RequestFrame | StopFrame | Seen | Tool | HoldFrame | LetGo
)

_decoder: msgspec.json.Decoder[PageFrame] = msgspec.json.Decoder(PageFrame)
_encoder = msgspec.json.Encoder()


def read_frame(text: str) -> PageFrame | None:
    """Decode a page's frame; None if it is not a valid one."""
    try:
        return _decoder.decode(text)
    except (ValueError, RecursionError):
        return None


def part(kind: str, **fields: object) -> bytes:
    """One object of a frame to pages."""
    return _encoder.encode({"type": kind, **fields})


def sample_part(kind: str, sample: msgspec.Struct) -> bytes:
    """A sample as an object of a frame to pages."""
    return _encoder.encode({"type": kind, "sample": sample})
