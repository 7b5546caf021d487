"""Encoders of ROS 2's messages in CDR, for a robot base.

One law: every value starts at a multiple of its size, counted from the end of the four-byte header.
A layout is therefore fixed once its strings are known, and compiled once into a ``struct.Struct``;
only diagnostics, whose strings change, are written value by value. Output is little-endian. A
factory takes the configured frames and names and returns the encoder.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

from yahboomd.core.messages.cdr import HEADER_LE, SECOND_NS, put_count, put_text

_F32_MAX = 3.4028234663852886e38


class Diagnostic(NamedTuple):
    """One diagnostic_msgs/msg/DiagnosticStatus; level 0 OK, 1 WARN, 2 ERROR, 3 STALE."""

    level: int
    name: str
    message: str
    hardware_id: str
    values: Sequence[tuple[str, str]]


Numbers: TypeAlias = Sequence[float]

OdometryEncoder: TypeAlias = Callable[[int, Numbers, Numbers, Numbers, Numbers], bytes]
"""Encodes a stamp (Unix ns, as in all of these), a pose (position, quaternion: 7 numbers), its 36
covariances, a twist (6), and its 36."""

TransformsEncoder: TypeAlias = Callable[[int, Sequence[Numbers]], bytes]
"""Encodes one transform (translation, quaternion: 7 numbers) for each pair of frames."""

JointEncoder: TypeAlias = Callable[[int, Numbers, Numbers], bytes]
"""Encodes one angle and one angular speed for each joint."""

ImuEncoder: TypeAlias = Callable[[int, Numbers, Numbers, Numbers], bytes]
"""Encodes an orientation (4 numbers), a rate of turn and an acceleration (3 each), each with its 9
covariances behind it."""

BatteryEncoder: TypeAlias = Callable[[int, float, float], bytes]
"""Encodes a voltage, and the charge from 0 to 1; NaN if that is not known."""


class Layout:
    """Collects the fields of a layout, pads them as CDR requires, and compiles it.

    Strings and lengths that are known in advance become constants of the layout.
    """

    def __init__(self) -> None:
        self._formats = ["<4s"]
        self._size = 0

    def add(self, code: str, size: int, count: int = 1) -> Layout:
        """Adds ``count`` values of ``size`` bytes each, with the padding in front of them."""
        if count:
            pad = -self._size % size
            self._formats.append(f"{pad}x{count}{code}" if pad else f"{count}{code}")
            self._size += pad + size * count
        return self

    def text(self, value: bytes) -> Layout:
        """Adds a string's length and the string, which ends in a zero byte."""
        self.add("I", 4)
        self._formats.append(f"{len(value) + 1}s")
        self._size += len(value) + 1
        return self

    def packer(self) -> Callable[..., bytes]:
        """The compiled layout; its first argument is the header."""
        return struct.Struct("".join(self._formats)).pack


def stamp(stamp_ns: int) -> tuple[int, int]:
    """Unix nanoseconds as a builtin_interfaces/msg/Time: (seconds, nanoseconds).

    ROS counts seconds in 32 bits; they wrap here as they do there.
    """
    seconds, nanoseconds = divmod(stamp_ns, SECOND_NS)
    return seconds & 0xFFFFFFFF, nanoseconds


def twist(numbers: Sequence[float], *, big_endian: bool = False) -> bytes:
    """A geometry_msgs/msg/Twist: linear and angular velocity, 6 numbers. For clients and tests."""
    if big_endian:
        return bytes(4) + struct.pack(">6d", *numbers)
    return HEADER_LE + struct.pack("<6d", *numbers)


def twist_stamped(stamp_ns: int, frame_id: str, numbers: Sequence[float]) -> bytes:
    """A geometry_msgs/msg/TwistStamped. For clients and tests."""
    frame = frame_id.encode()
    pack = Layout().add("I", 4, 2).text(frame).add("d", 8, 6).packer()
    return pack(HEADER_LE, *stamp(stamp_ns), len(frame) + 1, frame, *numbers)


def odometry(frame_id: str, child_frame_id: str) -> OdometryEncoder:
    """An encoder of nav_msgs/msg/Odometry between two frames."""
    frame, child = frame_id.encode(), child_frame_id.encode()
    pack = Layout().add("I", 4, 2).text(frame).text(child).add("d", 8, 85).packer()
    constants = (len(frame) + 1, frame, len(child) + 1, child)

    def encode(
        stamp_ns: int, pose: Numbers, pose_36: Numbers, twist: Numbers, twist_36: Numbers
    ) -> bytes:
        measured = (*pose, *pose_36, *twist, *twist_36)
        return pack(HEADER_LE, *stamp(stamp_ns), *constants, *measured)

    return encode


def transforms(frames: Sequence[tuple[str, str]]) -> TransformsEncoder:
    """An encoder of tf2_msgs/msg/TFMessage: a transform for each pair (parent, child) of frames.

    All transforms of a message carry the same stamp.
    """
    layout = Layout().add("I", 4)
    names: list[tuple[int, bytes, int, bytes]] = []
    for parent, child in frames:
        one, two = parent.encode(), child.encode()
        layout.add("I", 4, 2).text(one).text(two).add("d", 8, 7)
        names.append((len(one) + 1, one, len(two) + 1, two))
    pack = layout.packer()

    def encode(stamp_ns: int, transforms: Sequence[Numbers]) -> bytes:
        time = stamp(stamp_ns)
        values: list[int | bytes | float] = []
        for constants, transform in zip(names, transforms, strict=True):
            values += (*time, *constants, *transform)
        return pack(HEADER_LE, len(names), *values)

    return encode


def joint_state(frame_id: str, names: Sequence[str]) -> JointEncoder:
    """An encoder of sensor_msgs/msg/JointState of these joints, without efforts."""
    count, frame = len(names), frame_id.encode()
    layout = Layout().add("I", 4, 2).text(frame).add("I", 4)
    constants: list[int | bytes] = [len(frame) + 1, frame, count]
    for name in names:
        joint = name.encode()
        layout.text(joint)
        constants += (len(joint) + 1, joint)
    layout.add("I", 4).add("d", 8, count).add("I", 4).add("d", 8, count).add("I", 4)
    pack = layout.packer()

    def encode(stamp_ns: int, position_rad: Numbers, velocity_rad_s: Numbers) -> bytes:
        measured = (count, *position_rad, count, *velocity_rad_s, 0)
        return pack(HEADER_LE, *stamp(stamp_ns), *constants, *measured)

    return encode


def imu(frame_id: str) -> ImuEncoder:
    frame = frame_id.encode()
    pack = Layout().add("I", 4, 2).text(frame).add("d", 8, 37).packer()

    def encode(stamp_ns: int, orientation: Numbers, turn: Numbers, acceleration: Numbers) -> bytes:
        measured = (*orientation, *turn, *acceleration)
        return pack(HEADER_LE, *stamp(stamp_ns), len(frame) + 1, frame, *measured)

    return encode


def battery_state(frame_id: str) -> BatteryEncoder:
    """An encoder of sensor_msgs/msg/BatteryState of a battery that is there.

    All other fields are NaN or "unknown", as the message prescribes for unmeasured ones.
    """
    frame = frame_id.encode()
    layout = Layout().add("I", 4, 2).text(frame).add("f", 4, 7).add("B", 1, 3).add("?", 1)
    pack = layout.add("I", 4, 2).text(b"").text(b"").packer()

    def encode(stamp_ns: int, volts: float, charge: float) -> bytes:
        unknown = (math.nan,) * 5  # temperature to design capacity
        measured = (_float32(volts), *unknown, _float32(charge))
        cells_and_names = (0, 0, 1, b"", 1, b"")
        status = (0, 0, 0, True, *cells_and_names)
        return pack(HEADER_LE, *stamp(stamp_ns), len(frame) + 1, frame, *measured, *status)

    return encode


def diagnostics(stamp_ns: int, frame_id: str, status: Sequence[Diagnostic]) -> bytes:
    out = bytearray(struct.pack("<4s2I", HEADER_LE, *stamp(stamp_ns)))
    put_text(out, frame_id)
    put_count(out, len(status))
    for one in status:
        out.append(one.level)
        for text in (one.name, one.message, one.hardware_id):
            put_text(out, text)
        put_count(out, len(one.values))
        for key, value in one.values:
            put_text(out, key)
            put_text(out, value)
    return bytes(out)


def boolean(data: bool) -> bytes:
    """A std_msgs/msg/Bool; the request of a std_srvs/srv/SetBool has the same layout."""
    return HEADER_LE + bytes((data,))


def trigger_request() -> bytes:
    """The request of a std_srvs/srv/Trigger: empty, which in ROS 2 is one zero byte."""
    return HEADER_LE + b"\x00"


def _float32(value: float) -> float:
    """A 32-bit float; larger numbers become infinite, where ``struct`` would raise."""
    return value if not abs(value) > _F32_MAX else math.copysign(math.inf, value)
