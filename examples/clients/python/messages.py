"""The messages that the programs here read, the robot's keys, and how a program fails."""

import os
import sys
from typing import Annotated, Any, NoReturn

import msgspec

ROBOT = os.environ.get("ROBOT", "tcp/127.0.0.1:7448")
NAMESPACE = os.environ.get("NAMESPACE", "")

# Anything else, a state of a later version too, is one in which the robot may not drive.
DRIVABLE = {"waiting", "standing", "driving", "stopping"}

Stamp = Annotated[int, msgspec.Meta(ge=0)]


class PoseSample(msgspec.Struct):
    stamp_ns: Stamp
    seq: Stamp
    frame_id: str
    child_frame_id: str
    x: float
    y: float
    theta: float
    covariance: Annotated[list[float], msgspec.Meta(min_length=9, max_length=9)]


class StatusSample(msgspec.Struct):
    stamp_ns: Stamp
    state: str  # A later version may have others than this one.
    driver: str | None
    since_ns: int
    why: str
    board: dict[str, Any]
    link: dict[str, Any]
    command: dict[str, Any]
    bus: dict[str, Any]
    driver_since_ns: int | None = None
    wheels: str | None = None
    wheels_since_ns: int | None = None


class ServiceReply(msgspec.Struct):
    success: bool
    message: str
    data: dict[str, Any] = {}


class MoveSample(msgspec.Struct):
    stamp_ns: Stamp
    id: str
    state: str
    done: float
    left_m: float
    left_rad: float
    left_s: float
    reason: str = ""
    message: str = ""


def key(name: str) -> str:
    return f"{NAMESPACE}/{name}" if NAMESPACE else name


def fail(code: int, words: str) -> NoReturn:
    print(words, file=sys.stderr)
    sys.exit(code)
