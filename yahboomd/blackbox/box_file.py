r"""The file of a black box: a header, then segments of records. The ring and saved files are alike.

::

    "YBXBOX1\n" | u32 bytes before the segments | u32 bytes of the header | header, JSON | zeros
    u8 1, or 0 while it is empty | u64 number of the segment | records | zeros
    u8 1 ...

All segments have the size that the header gives, and are reused in turn: their numbers give
their order. In a segment records follow each other until a kind of 0 or its end. A record that was
cut short by a kill has no kind, and does not count. A saved file
is compressed (gzip) and has ``saved`` in its header.
"""

from __future__ import annotations

import re
import struct
import zlib
from itertools import pairwise
from typing import Any

import msgspec

from yahboomd.blackbox.records import (
    BASE,
    FORMAT,
    HEAD,
    MOMENT,
    RECEIVED,
    REPEATED,
    Received,
    Record,
    decode,
)
from yahboomd.core.errors import YahboomdError
from yahboomd.core.odometry.odometer import OdometerSettings

MAGIC = b"YBXBOX1\n"
GZIP = b"\x1f\x8b"
PREFIX = struct.Struct("<8sII")
SEGMENT = struct.Struct("<BQ")
ALIGN = 4096
INFLATED_MOST = 16 << 20
"""The largest box: a larger file does not exhaust a reader's memory."""
HEADER_MOST = 1 << 18
"""The largest header."""


class NotABox(YahboomdError):
    """A file is no black box, or one of a later version."""


class ImuSettings(msgspec.Struct, frozen=True, kw_only=True):
    """The arguments of :class:`yahboomd.core.odometry.imu_axes.Mounting`, by their names."""

    axes: str
    gyro_axes: str
    gyro_factor: float


class Saved(msgspec.Struct, frozen=True, kw_only=True):
    """Why and when a ring was saved.

    Attributes:
        reasons: Such as ``estop``, in the order of time.
        at_ns: When it was copied; monotonic nanoseconds. 0 if its daemon was killed.
        wall_ns: The same as Unix nanoseconds.
    """

    reasons: tuple[str, ...]
    at_ns: int
    wall_ns: int


class Header(msgspec.Struct, frozen=True, kw_only=True):
    """The facts about all records of a box.

    Attributes:
        machine: The kind of processor, such as ``aarch64``: poses are the same to the last bit on
            the same kind, with the same mathematical library.
        boot_id: The boot of the machine, which the monotonic clock counts from.
        started_ns: When it started; monotonic nanoseconds.
        started_wall_ns: The same as Unix nanoseconds.
        config: The configuration in effect, without credentials.
        odometer: The arguments of the odometer.
        imu: How samples of the inertial sensor are turned along the base.
        saved: Why it was saved; None in a ring.
    """

    format: int = FORMAT
    version: str
    machine: str
    boot_id: str
    pid: int
    started_ns: int
    started_wall_ns: int
    config: dict[str, Any]
    profile: str
    odometer: OdometerSettings
    imu: ImuSettings
    segment_bytes: int
    saved: Saved | None = None


class Box(msgspec.Struct, frozen=True, kw_only=True):
    """A black box that was read.

    Attributes:
        damaged: Places at which records are missing: those behind the damage in a segment, or
            whole segments.
        cut: Whether the end of the saved file is missing.
    """

    header: Header
    records: list[Record]
    damaged: int = 0
    cut: bool = False


def settings_of(header: Header, section: str) -> dict[str, Any]:
    """One section of the configuration in a header; empty if it has none."""
    found = header.config.get(section)
    return found if isinstance(found, dict) else {}


def robot_slug(header: Header) -> str:
    """The robot's namespace and port, as in the names of files; empty for neither."""
    namespace = str(settings_of(header, "zenoh").get("namespace", ""))
    port = str(settings_of(header, "serial").get("port", "")).rpartition("/")[2]
    return "-".join(re.sub("[^A-Za-z0-9]+", "-", each)[:20] for each in (namespace, port) if each)


def segments_of(data: bytes) -> bytes:
    return data[PREFIX.unpack_from(data)[1] :]


def encode_header(header: Header) -> bytes:
    words = msgspec.json.encode(header)
    size = -(-(PREFIX.size + len(words)) // ALIGN) * ALIGN
    return (PREFIX.pack(MAGIC, size, len(words)) + words).ljust(size, b"\0")


def read_box(data: bytes) -> Box:
    """Read a ring or a saved file, as far as it is whole.

    Args:
        data: The file's bytes; one that was cut is read up to the cut.

    Raises:
        NotABox: It is no black box, or one of a later version.
    """
    data, cut = _inflated(data)
    header, begin = _header(data)
    found: list[tuple[int, list[Record], bool]] = []
    for start in range(begin, len(data) - SEGMENT.size, header.segment_bytes):
        used, number = SEGMENT.unpack_from(data, start)
        if used:
            segment = data[start + SEGMENT.size : start + header.segment_bytes]
            found.append((number, *_records(segment)))
    found.sort(key=lambda each: each[0])
    records = [record for _, some, _ in found for record in some]
    damaged = sum(damaged for *_, damaged in found)
    # A file that was cut after the ring had wrapped lacks some in the middle.
    missing = sum(after[0] - before[0] > 1 for before, after in pairwise(found))
    return Box(header=header, records=records, damaged=damaged + missing, cut=cut)


def read_header(data: bytes) -> Header:
    """Read the header of a ring or a saved file alone.

    Raises:
        NotABox: As :func:`read_box`.
    """
    return _header(_inflated(data, HEADER_MOST)[0])[0]


def _header(data: bytes) -> tuple[Header, int]:
    if len(data) < PREFIX.size or not data.startswith(MAGIC[:6]):
        raise NotABox("This is no black box of yahboomd.")
    magic, begin, length = PREFIX.unpack_from(data)
    if magic != MAGIC:
        raise NotABox(
            "This black box was written by a later version of yahboomd.",
            remedy="Read it with that version.",
        )
    try:
        words = data[PREFIX.size : PREFIX.size + length]
        header = msgspec.json.decode(words, type=Header)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise NotABox(f"The header of this black box is damaged: {error}.") from error
    if header.format != FORMAT or header.segment_bytes <= SEGMENT.size:
        raise NotABox(f"The format {header.format} of this black box is not known.")
    return header, begin


def _inflated(data: bytes, most: int = INFLATED_MOST) -> tuple[bytes, bool]:
    if not data.startswith(GZIP):
        return data, False
    inflate = zlib.decompressobj(16 + zlib.MAX_WBITS)
    try:
        return inflate.decompress(data, most), not inflate.eof
    except zlib.error as error:
        raise NotABox(f"This file is damaged: {error}.") from error


def deflated(data: bytes) -> bytes:
    deflate = zlib.compressobj(4, wbits=16 + zlib.MAX_WBITS)
    return deflate.compress(data) + deflate.flush()


def _records(segment: bytes) -> tuple[list[Record], bool]:
    records: list[Record] = []
    at, end = 0, len(segment)
    base_ns, received = 0, Received(data=b"")
    while at + HEAD.size <= end:
        kind, length, since_ns = HEAD.unpack_from(segment, at)
        if not kind:
            return records, False
        begin = at + HEAD.size
        at = begin + length
        if at > end:
            return records, True
        if kind == BASE and length == MOMENT.size:
            (base_ns,) = MOMENT.unpack_from(segment, begin)
            continue
        meaning = received if kind == REPEATED else decode(kind, segment[begin:at])
        if meaning is None:
            return records, True
        if kind == RECEIVED and isinstance(meaning, Received):
            received = meaning
        records.append(Record(base_ns + since_ns, meaning))
    return records, False
