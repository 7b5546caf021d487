"""CDR, the encoding of ROS 2: reads commands in either byte order, and writes answers to services.

One law: every value starts at a multiple of its size, counted from the end of the four-byte header.
"""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

HEADER_LE = b"\x00\x01\x00\x00"
"""Representation CDR_LE, and two bytes of options, zero."""

TWIST_BYTES = 52
"""The header and six doubles: a stamped message is longer."""

SECOND_NS = 1_000_000_000

_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}
_TWISTS = {order: struct.Struct(f"{order}6d") for order in "<>"}
_STAMPS = {order: struct.Struct(f"{order}iII") for order in "<>"}


class Velocity(NamedTuple):
    """The planar part of a Twist, and the stamp of a TwistStamped (none, or Unix ns)."""

    vx: float
    vy: float
    wz: float
    stamp_ns: int | None
    finite: bool


def decode_velocity(payload: bytes) -> Velocity | str:
    """Reads a geometry_msgs/msg/Twist or TwistStamped, distinguished by their length.

    Args:
        payload: Header and body, in either byte order.

    Returns:
        The velocity, or the problem with the bytes. A stamp of zero counts as none.
    """
    order = _ORDERS.get(payload[:2])
    if order is None:
        return f"representation {payload[:2].hex()}: neither 0000 nor 0001"
    size = len(payload)
    stamp_ns: int | None = None
    offset = 4
    if size != TWIST_BYTES:
        if size < 4 + 12:
            return f"{size} bytes: neither a Twist nor a TwistStamped"
        seconds, nanoseconds, length = _STAMPS[order].unpack_from(payload, 4)
        # Doubles start at a multiple of eight behind the header, wherever the frame's name ends.
        offset = 4 + ((12 + length + 7) & ~7)
        if size != offset + 48:
            return f"{size} bytes: neither a Twist nor a TwistStamped"
        if not length or payload[15 + length]:
            return "the frame's name does not end in a zero byte"
        if seconds < 0 or nanoseconds >= SECOND_NS:
            return "a stamp that is no time"
        stamp_ns = seconds * SECOND_NS + nanoseconds or None
    vx, vy, vz, wx, wy, wz = _TWISTS[order].unpack_from(payload, offset)
    # A sum is finite if all its terms are, unless they are too large to matter.
    return Velocity(vx, vy, wz, stamp_ns, math.isfinite(vx + vy + vz + wx + wy + wz))


def is_cdr(payload: bytes) -> bool:
    """Whether these bytes start with the header of plain CDR, in either byte order."""
    return len(payload) >= 4 and payload[:2] in _ORDERS


def decode_bool(payload: bytes) -> bool | str:
    """Reads a std_msgs/msg/Bool or the request of a std_srvs/srv/SetBool.

    Up to three bytes may follow: some middleware pads to a multiple of four.

    Returns:
        The flag, or the problem.
    """
    if not is_cdr(payload):
        return "no CDR header"
    if not 5 <= len(payload) <= 8 or payload[4] > 1:
        return "neither a Bool nor the request of a SetBool"
    return payload[4] == 1


def service_response(success: bool, message: str) -> bytes:
    """The response of a std_srvs/srv/Trigger, and of a SetBool: they have the same layout."""
    out = bytearray((*HEADER_LE, success))
    put_text(out, message)
    return bytes(out)


def put_count(out: bytearray, count: int) -> None:
    """Appends the length of a sequence or a text to a message, aligned."""
    out += bytes(-len(out) % 4)  # the header's four bytes do not change a multiple of four
    out += count.to_bytes(4, "little")


def put_text(out: bytearray, text: str) -> None:
    data = text.encode(errors="replace")
    put_count(out, len(data) + 1)
    out += data
    out.append(0)
