"""The records of a black box, and their promise.

A record has a kind, a moment (monotonic nanoseconds) and a payload of bytes. Records have the
order of events in the daemon's loop.

The promise: from the first :class:`Anchor` on, unless a segment is damaged, the pure rooms
compute from the records, bit by bit, the estimates that the daemon computed. To do so:

1. Make an odometer from the header's ``odometer``, and restore the anchor's state
   (:func:`yahboomd.core.odometry.snapshot.restore`). At the anchor all earlier bytes had been used
   and no part of a frame was held: framers begin empty. ``dialect`` is that
   of the board; if it is empty no board is connected, and counts are not used.
2. Pass the records to the odometer in their order: :class:`Armed`, :class:`Renewal`,
   :class:`PoseSet` and :class:`SteerRecord` are calls of its methods.
3. :class:`Opened` begins a connection: a fresh framer, no dialect. :class:`Identified` has the
   dialect; the bytes since ``Opened`` went through its framer, and none of them to the odometer.
   From there on counts and samples of the inertial sensor do. :class:`Closed` ends it.
4. :class:`Received` is one read of the port, at the moment that the line used for it. For each item
   that the framer finds in it, counts were received at ``at_ns - item.trailing * byte_ns``, and
   sent ``item.size * byte_ns`` earlier. A sample of the inertial sensor was sent
   ``(item.trailing + item.size) * byte_ns`` before ``at_ns``, and is turned along the base by the
   header's ``imu``.
5. A :class:`ReadingRecord` behind it completes the counts with the same ``received_ns``, by the
   facts that their bytes do not show. Counts without one came by themselves, with no flag set. If
   it has ``requested_ns``, they were sent no earlier.
6. :class:`Anchor` and :class:`Posed` have the results of the daemon, to compare with.

``yahboomd replay --odometry`` does this (:mod:`yahboomd.tools.replay.replayed_poses`).

:class:`CommandRecord`, :class:`DecisionRecord` and :class:`Happened` record the decisions of people
and of the daemon; :class:`Written` has the bytes to the board.
"""

from __future__ import annotations

import math
import struct
from typing import Any, NamedTuple, TypeAlias

import msgspec

from yahboomd.core.model import Event, Matrix3, Pose2d

FORMAT = 1
"""The version of this format; a reader refuses a later one."""


class Opened(msgspec.Struct, frozen=True, kw_only=True):
    """A port was opened.

    Attributes:
        byte_ns: Nanoseconds that a byte takes on its wire.
    """

    port: str
    byte_ns: int


class Received(msgspec.Struct, frozen=True, kw_only=True):
    """One read of the port."""

    data: bytes


class Written(msgspec.Struct, frozen=True, kw_only=True):
    """One write to the port."""

    data: bytes


class Identified(msgspec.Struct, frozen=True, kw_only=True):
    """The board is known: from here on its counts are used.

    Attributes:
        settings: Its stored settings, by name; None if it cannot be asked.
    """

    dialect: str
    settings: dict[str, Any] | None = None


class Closed(msgspec.Struct, frozen=True, kw_only=True):
    """The port was closed: its bytes are of no further use."""


class ReadingRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Facts that a reading's bytes do not show; see :class:`yahboomd.core.model.EncoderReading`.

    Attributes:
        received_ns: Identifies the reading among the bytes just received.
        requested_ns: When its question was on the board.
        earliest_ns: The earliest time at which it can have been sampled.
        after_reset: The first one since the board reset itself.
        after_gap: The first one since the port was opened.
        unbroken: The board was certainly not reset in that gap.
    """

    received_ns: int
    requested_ns: int | None = None
    earliest_ns: int | None = None
    after_reset: bool = False
    after_gap: bool = False
    unbroken: bool = False


class Renewal(msgspec.Struct, frozen=True, kw_only=True):
    """The odometer's ``set_sample_period`` was called with this."""

    period_ns: int | None
    each_line: bool
    age_ns: int


class Armed(msgspec.Struct, frozen=True, kw_only=True):
    """The odometer's ``armed`` was called."""


class PoseSet(msgspec.Struct, frozen=True, kw_only=True):
    """The odometer's ``set_pose`` was called with this."""

    pose: Pose2d
    covariance: Matrix3 | None = None


class SteerRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The odometer's ``steer`` was called, with this curve and the record's moment."""

    curvature_per_m: float


class Anchor(msgspec.Struct, frozen=True, kw_only=True):
    """The whole state of the odometer, at a moment with nothing half received.

    Attributes:
        port: The port that is open; empty for none.
        byte_ns: Nanoseconds that a byte takes on its wire.
        dialect: The dialect of the board; empty if none is connected.
        state: The odometer's state (:mod:`yahboomd.core.odometry.snapshot`); empty for a fresh one,
            which any version can make.
    """

    port: str
    byte_ns: int
    dialect: str
    state: bytes


class Posed(msgspec.Struct, frozen=True, kw_only=True):
    """The pose of an estimate, a few times a second: a replay compares its own poses with these."""

    stamp_ns: int
    pose: Pose2d


class CommandRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A command that arrived.

    Attributes:
        vx: m/s forward, to seven digits, like those that follow.
        vy: m/s to the left.
        wz: rad/s.
        refused: The reason of its refusal; empty if it was accepted.
    """

    source: str
    vx: float
    vy: float
    wz: float
    refused: str = ""


class DecisionRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Who drives, or why the robot stands, when that changed.

    Attributes:
        state: In one word, as in ``yahboomd/status``.
        driver: The source that drives; empty for none.
    """

    state: str
    driver: str
    why: str


class Happened(msgspec.Struct, frozen=True, kw_only=True):
    """An event, as it was published."""

    event: Event


class WallClock(msgspec.Struct, frozen=True, kw_only=True):
    """The wall clock at the record's moment."""

    wall_ns: int


class Lost(msgspec.Struct, frozen=True, kw_only=True):
    """Records that were omitted here, as in a flood of commands."""

    what: str
    count: int


class Ended(msgspec.Struct, frozen=True, kw_only=True):
    """The daemon ended, and this ring was not saved yet.

    Attributes:
        error: The fault of the daemon, in short; empty if it ended normally.
    """

    reasons: tuple[str, ...]
    error: str = ""


Meaning: TypeAlias = (
    Opened
    | Received
    | Written
    | Identified
    | Closed
    | ReadingRecord
    | Renewal
    | Armed
    | PoseSet
    | SteerRecord
    | Anchor
    | Posed
    | CommandRecord
    | DecisionRecord
    | Happened
    | WallClock
    | Lost
    | Ended
)


class Record(NamedTuple):
    """One record.

    Attributes:
        at_ns: When it was made; monotonic nanoseconds.
    """

    at_ns: int
    meaning: Meaning


HEAD = struct.Struct("<BHI")
"""In a file: kind, length of the payload, nanoseconds since the latest BASE."""

BASE, RECEIVED, REPEATED, WRITTEN, READING, STEERED, COMMAND, WALL_CLOCK = range(1, 9)
"""The kinds that come often have a payload of their own; that of the others is MessagePack.

BASE is the moment from which those behind it are counted; each segment begins with one. REPEATED is
a read of the same bytes as the one before it, typical of a standing robot.
"""

MOMENT = struct.Struct("<q")
"""The payload of BASE and of WALL_CLOCK."""
READING_PAYLOAD = struct.Struct("<qqqB")
STEERED_PAYLOAD = struct.Struct("<d")
COMMAND_PAYLOAD = struct.Struct("<fffB")
_SINGLE_MOST = 3.4028234663852886e38
NEVER_NS = -1
AFTER_RESET, AFTER_GAP, UNBROKEN = 1, 2, 4

_PACKED: dict[int, type[msgspec.Struct]] = {
    16: Opened,
    17: Identified,
    18: Closed,
    19: Renewal,
    20: Armed,
    21: PoseSet,
    22: Anchor,
    23: DecisionRecord,
    24: Happened,
    25: Lost,
    26: Ended,
    27: Posed,
}
_KINDS = {meaning: kind for kind, meaning in _PACKED.items()}


def encode(meaning: Meaning) -> tuple[int, bytes]:
    if isinstance(meaning, Received):
        return RECEIVED, meaning.data
    if isinstance(meaning, Written):
        return WRITTEN, meaning.data
    if isinstance(meaning, ReadingRecord):
        flags = (
            AFTER_RESET * meaning.after_reset
            | AFTER_GAP * meaning.after_gap
            | UNBROKEN * meaning.unbroken
        )
        requested_ns, earliest_ns = meaning.requested_ns, meaning.earliest_ns
        return READING, READING_PAYLOAD.pack(
            meaning.received_ns,
            NEVER_NS if requested_ns is None else requested_ns,
            NEVER_NS if earliest_ns is None else earliest_ns,
            flags,
        )
    if isinstance(meaning, SteerRecord):
        return STEERED, STEERED_PAYLOAD.pack(meaning.curvature_per_m)
    if isinstance(meaning, CommandRecord):
        source = meaning.source.encode()[:255]
        numbers = COMMAND_PAYLOAD.pack(
            _single(meaning.vx), _single(meaning.vy), _single(meaning.wz), len(source)
        )
        return COMMAND, numbers + source + meaning.refused.encode()
    if isinstance(meaning, WallClock):
        return WALL_CLOCK, MOMENT.pack(meaning.wall_ns)
    return _KINDS[type(meaning)], msgspec.msgpack.encode(meaning)


def _single(value: float) -> float:
    """The number, or an infinity for one that single precision does not hold."""
    return math.copysign(math.inf, value) if abs(value) > _SINGLE_MOST else value


def decode(kind: int, payload: bytes) -> Meaning | None:
    """Decode a record's payload; None if it is damaged or of an unknown kind."""
    try:
        return _decode(kind, payload)
    except (msgspec.DecodeError, struct.error, ValueError, RecursionError):
        return None


def _decode(kind: int, payload: bytes) -> Meaning | None:
    if kind == RECEIVED:
        return Received(data=payload)
    if kind == WRITTEN:
        return Written(data=payload)
    if kind == READING:
        received_ns, requested_ns, earliest_ns, flags = READING_PAYLOAD.unpack(payload)
        return ReadingRecord(
            received_ns=received_ns,
            requested_ns=None if requested_ns == NEVER_NS else requested_ns,
            earliest_ns=None if earliest_ns == NEVER_NS else earliest_ns,
            after_reset=bool(flags & AFTER_RESET),
            after_gap=bool(flags & AFTER_GAP),
            unbroken=bool(flags & UNBROKEN),
        )
    if kind == STEERED:
        (curvature_per_m,) = STEERED_PAYLOAD.unpack(payload)
        return SteerRecord(curvature_per_m=curvature_per_m)
    if kind == COMMAND:
        vx, vy, wz, length = COMMAND_PAYLOAD.unpack_from(payload)
        words = payload[COMMAND_PAYLOAD.size :]
        source, refused = words[:length].decode(errors="replace"), words[length:].decode()
        return CommandRecord(source=source, vx=vx, vy=vy, wz=wz, refused=refused)
    if kind == WALL_CLOCK:
        (wall_ns,) = MOMENT.unpack(payload)
        return WallClock(wall_ns=wall_ns)
    packed = _PACKED.get(kind)
    if packed is None:
        return None
    return msgspec.msgpack.decode(payload, type=packed)  # type: ignore[return-value]
