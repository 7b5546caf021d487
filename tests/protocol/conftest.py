"""Bytes fed in every way, and captures with their meanings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from yahboomd.core.protocol.four_channel.framing import Frame, LineFramer, TextLine

HERE = Path(__file__).parent

Items = list[Frame | TextLine]


class Capture(msgspec.Struct, frozen=True, kw_only=True):
    sent: list[bytes]
    received: list[bytes]
    meanings: list[str]


def untimed(items: Items) -> Items:
    """The items without what depends on the chunks."""
    return [msgspec.structs.replace(item, trailing=0) for item in items]


def fed(chunks: list[bytes], make: Callable[[], Any] = LineFramer) -> Items:
    framer = make()
    return untimed([item for chunk in chunks for item in framer.feed(chunk)])


def feed_each_way(data: bytes, make: Callable[[], Any] = LineFramer) -> Items:
    """Feed whole, byte by byte, cut in two anywhere, and with bytes behind; all must agree.

    Returns the items of the data fed whole.
    """
    whole = make().feed(data)
    assert fed([bytes([byte]) for byte in data], make) == untimed(whole)
    for cut in range(len(data)):
        assert fed([data[:cut], data[cut:]], make) == untimed(whole)
    tail = b"$next" if make is LineFramer else b"\xff\xfb"
    with_tail = make().feed(data + tail)
    assert [
        msgspec.structs.replace(item, trailing=item.trailing - len(tail)) for item in with_tail
    ] == whole
    return whole


@pytest.fixture(scope="session")
def each_way() -> Callable[..., Items]:
    return feed_each_way


@pytest.fixture(scope="session")
def chunked() -> Callable[..., Items]:
    """The items of some chunks, `trailing` set to 0."""
    return fed


@pytest.fixture(scope="session")
def capture() -> Callable[[str], Capture]:
    def read(name: str) -> Capture:
        found: dict[str, list[str]] = {"#": [], ">": [], "<": [], "=": []}
        for line in (
            next(HERE.glob(f"*/captures/{name}.txt")).read_text(encoding="ascii").splitlines()
        ):
            found[line[0]].append(line[2:])
        return Capture(
            sent=[unescaped(line) for line in found[">"]],
            received=[unescaped(line) for line in found["<"]],
            meanings=[unescaped_text(line) for line in found["="]],
        )

    return read


def unescaped(line: str) -> bytes:
    return unescaped_text(line).encode("latin-1")


def unescaped_text(line: str) -> str:
    return line.encode("ascii").decode("unicode_escape")
