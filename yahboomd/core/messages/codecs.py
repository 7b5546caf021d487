"""Bytes to messages and back: JSON, MessagePack and CDR, distinguished by the first byte.

No payload raises: each becomes a message or a ``Refusal``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, TypeAlias

import msgspec

from yahboomd.core.messages import cdr
from yahboomd.core.messages.native import (
    INT64_MAX,
    MAX_LABEL,
    ServiceReply,
    SetPoseRequest,
    VelocityCommand,
)
from yahboomd.core.messages.set_pose import covariance_problem
from yahboomd.core.model import velocity_problem

NativeEncoding: TypeAlias = Literal["json", "msgpack"]
Encoding: TypeAlias = Literal["json", "msgpack", "cdr"]
Reason: TypeAlias = Literal[
    "no_velocity",
    "not_finite",
    "too_fast",
    "wrong_type",
    "malformed",
    "oversize",
    "unknown_encoding",
]

MAX_PAYLOAD_BYTES = 4096
"""Larger payloads are refused unread; the largest valid request has a few hundred bytes."""

MEDIA_TYPES: dict[Encoding, str] = {
    "json": "application/json",
    "msgpack": "application/msgpack",
    "cdr": "application/cdr",
}

_ENCODERS: dict[str, Callable[[Any], bytes]] = {
    "json": msgspec.json.Encoder().encode,
    "msgpack": msgspec.msgpack.Encoder().encode,
}

# What first bytes mean: a map in MessagePack, the header of CDR, a JSON object after white space.
_FIRST: dict[int, Encoding] = {
    **dict.fromkeys(range(0x80, 0x90), "msgpack"),
    0xDE: "msgpack",
    0xDF: "msgpack",
    0x00: "cdr",
    ord("{"): "json",
}
_WHITE_SPACE = b" \t\r\n"
_DETAIL_CHARACTERS = 160

# A broken payload shows in many ways: msgspec's own errors and bad UTF-8 are ValueErrors, and
# brackets nested a thousand deep end its recursion.
_BROKEN = (ValueError, RecursionError, OverflowError)


class Refusal(NamedTuple):
    """The reason why a payload is refused: a word to count by, and a sentence for people."""

    reason: Reason
    detail: str


class ReceivedCommand(VelocityCommand, frozen=True, kw_only=True):
    """A velocity command as it arrived: all numbers finite, and how it was encoded."""

    encoding: Encoding


class _Linear(msgspec.Struct):
    x: float | msgspec.UnsetType = msgspec.UNSET
    y: float | msgspec.UnsetType = msgspec.UNSET


class _Angular(msgspec.Struct):
    z: float | msgspec.UnsetType = msgspec.UNSET


class _Command(msgspec.Struct):
    """Both shapes of a command; absent fields differ from zero."""

    vx: float | msgspec.UnsetType = msgspec.UNSET
    vy: float | msgspec.UnsetType = msgspec.UNSET
    wz: float | msgspec.UnsetType = msgspec.UNSET
    linear: _Linear | None = None
    angular: _Angular | None = None
    stamp_ns: int | None = None
    source: str | None = None


_DECODE_COMMAND: dict[str, Callable[[bytes], _Command]] = {
    "json": msgspec.json.Decoder(_Command).decode,
    "msgpack": msgspec.msgpack.Decoder(_Command).decode,
}
_DECODE_SET_POSE: dict[str, Callable[[bytes], SetPoseRequest]] = {
    "json": msgspec.json.Decoder(SetPoseRequest).decode,
    "msgpack": msgspec.msgpack.Decoder(SetPoseRequest).decode,
}


_DECODE_ANY: dict[str, Callable[[bytes], Any]] = {
    "json": msgspec.json.Decoder().decode,
    "msgpack": msgspec.msgpack.Decoder().decode,
}


def encode(message: msgspec.Struct, encoding: NativeEncoding) -> bytes:
    return _ENCODERS[encoding](message)


def encoder(encoding: NativeEncoding) -> Callable[[msgspec.Struct], bytes]:
    """The same as a function of the message alone, for those that encode many."""
    return _ENCODERS[encoding]


def encode_reply(reply: ServiceReply, encoding: Encoding) -> bytes:
    """The bytes of a service's answer; in CDR that of a Trigger or SetBool, without the data."""
    if encoding == "cdr":
        return cdr.service_response(reply.success, reply.message)
    return _ENCODERS[encoding](reply)


def encoding_name(message: type[msgspec.Struct] | str, encoding: Encoding) -> str:
    """The Zenoh Encoding of a sample, such as ``application/json;PoseSample``.

    Args:
        message: A native message, or the name of any, such as ``nav_msgs/msg/Odometry``.
    """
    name = message if isinstance(message, str) else message.__name__
    return f"{MEDIA_TYPES[encoding]};{name}"


def encoding_of(payload: bytes) -> Encoding | None:
    """The encoding that the first byte indicates; none for an empty or unknown payload."""
    if not payload:
        return None
    first = payload[0]
    if first in _WHITE_SPACE:
        text = payload[:MAX_PAYLOAD_BYTES].lstrip(_WHITE_SPACE)
        return "json" if text.startswith(b"{") else None
    return _FIRST.get(first)


def decode_command(payload: bytes) -> ReceivedCommand | Refusal:
    """Reads a velocity command in any of the three encodings and either shape.

    JSON and MessagePack hold ``{vx, vy, wz, stamp_ns?, source?}``, or the shape of a ROS Twist,
    ``{linear: {x, y}, angular: {z}}``; if both are present the first counts. CDR holds a
    geometry_msgs/msg/Twist or TwistStamped. Unknown fields are ignored; of a
    repeated field the last counts; a stamp of zero means none.

    Args:
        payload: Any bytes.
    """
    encoding = _admit(payload)
    if isinstance(encoding, Refusal):
        return encoding
    if encoding == "cdr":
        return _from_cdr(payload)
    try:
        command = _DECODE_COMMAND[encoding](payload)
    except _BROKEN as error:
        return _why(error, payload, encoding)
    return _from_map(command, encoding)


def decode_set_pose(payload: bytes) -> SetPoseRequest | Refusal:
    encoding = _admit(payload)
    if isinstance(encoding, Refusal):
        return encoding
    if encoding == "cdr":
        return Refusal("unknown_encoding", "set_pose takes JSON or MessagePack, not CDR")
    try:
        request = _DECODE_SET_POSE[encoding](payload)
    except _BROKEN as error:
        return _why(error, payload, encoding)
    covariance = request.covariance
    if not all(map(math.isfinite, (request.x, request.y, request.theta, *(covariance or ())))):
        return Refusal("not_finite", "a number that is not finite")
    if covariance is not None and (problem := covariance_problem(covariance)):
        return Refusal("wrong_type", problem)
    return request


def is_release_attempt(payload: bytes, *, query: bool = False) -> bool:
    """Whether an e-stop payload requests a release, which is refused; every other one engages.

    Args:
        payload: The bytes on the e-stop's key.
        query: It came as a query: then CDR is the request of a SetBool, as ROS 2 calls services,
            and its false requests a release. In a sample it does not: :func:`is_not_pressed`.
    """
    encoding = _admit(payload)
    if isinstance(encoding, Refusal):
        return False
    if encoding == "cdr":
        return query and cdr.decode_bool(payload) is False
    try:
        # The whole payload is decoded: one that is malformed anywhere does not release.
        value = _DECODE_ANY[encoding](payload)
    except _BROKEN:
        return False
    return isinstance(value, dict) and value.get("engaged") is False


def is_not_pressed(payload: bytes) -> bool:
    """Whether an e-stop sample is a std_msgs/msg/Bool that is false: neither stop nor release.

    ROS 2 buttons publish false all the time while they are not pressed.
    """
    return cdr.decode_bool(payload) is False


def estop_by(payload: bytes) -> str:
    """The name of the person or program that engages the emergency stop; empty if there is none."""
    encoding = _admit(payload)
    if isinstance(encoding, Refusal) or encoding == "cdr":
        return ""
    try:
        value = _DECODE_ANY[encoding](payload)
    except _BROKEN:
        return ""
    by = value.get("by") if isinstance(value, dict) else None
    return by[:MAX_LABEL] if isinstance(by, str) and by.isprintable() else ""


def _admit(payload: bytes) -> Encoding | Refusal:
    size = len(payload)
    if size > MAX_PAYLOAD_BYTES:
        return Refusal("oversize", f"{size} bytes, {MAX_PAYLOAD_BYTES} at most")
    encoding = encoding_of(payload)
    if encoding is None:
        if not payload:
            return Refusal("malformed", "empty")
        return Refusal("unknown_encoding", f"starts with {payload[:4].hex()}")
    return encoding


def _from_cdr(payload: bytes) -> ReceivedCommand | Refusal:
    velocity = cdr.decode_velocity(payload)
    if isinstance(velocity, str):
        return Refusal("malformed", velocity)
    if not velocity.finite:
        return Refusal("not_finite", "a velocity that is not finite")
    if (problem := velocity_problem(velocity.vx, velocity.vy, velocity.wz)) is not None:
        return Refusal(*problem)
    return ReceivedCommand(
        vx=velocity.vx,
        vy=velocity.vy,
        wz=velocity.wz,
        stamp_ns=velocity.stamp_ns,
        encoding="cdr",
    )


def _from_map(command: _Command, encoding: Encoding) -> ReceivedCommand | Refusal:
    unset = msgspec.UNSET
    vx, vy, wz = command.vx, command.vy, command.wz
    if vx is unset and vy is unset and wz is unset:
        if command.linear is not None:
            vx, vy = command.linear.x, command.linear.y
        if command.angular is not None:
            wz = command.angular.z
        if vx is unset and vy is unset and wz is unset:
            return Refusal("no_velocity", "none of vx, vy, wz (or linear.x, linear.y, angular.z)")
    # An absent velocity is zero; written so that the type checker can follow.
    vx = 0.0 if isinstance(vx, msgspec.UnsetType) else vx
    vy = 0.0 if isinstance(vy, msgspec.UnsetType) else vy
    wz = 0.0 if isinstance(wz, msgspec.UnsetType) else wz
    if (problem := velocity_problem(vx, vy, wz)) is not None:
        return Refusal(*problem)
    stamp_ns, source = command.stamp_ns, command.source
    if stamp_ns is not None and not 0 <= stamp_ns <= INT64_MAX:
        return Refusal("wrong_type", "stamp_ns is no Unix time in nanoseconds")
    if source is not None and not (source.isprintable() and len(source) <= MAX_LABEL):
        source = "".join(c if c.isprintable() else "?" for c in source[:MAX_LABEL])
    return ReceivedCommand(
        vx=vx, vy=vy, wz=wz, stamp_ns=stamp_ns or None, source=source, encoding=encoding
    )


def _why(error: Exception, payload: bytes, encoding: Encoding) -> Refusal:
    """The kind of error: a number that is no velocity, a wrong type, or malformed bytes."""
    detail = str(error)[:_DETAIL_CHARACTERS]
    if encoding == "json" and _holds_infinite(payload):
        return Refusal("not_finite", "a number that is not finite")
    if isinstance(error, msgspec.ValidationError):
        return Refusal("wrong_type", detail)
    return Refusal("malformed", detail)


def _holds_infinite(payload: bytes) -> bool:
    """Whether this is JSON except for a NaN, an Infinity, or a number too large for a double.

    msgspec rejects these, because they are not JSON; many libraries write them.
    """
    found: list[str] = []

    def number(text: str) -> float:
        value = float(text)
        if not math.isfinite(value):
            found.append(text)
        return value

    try:
        json.loads(payload, parse_constant=number, parse_float=number, parse_int=number)
    except _BROKEN:
        return False
    return bool(found)
