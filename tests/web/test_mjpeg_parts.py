"""A stream is cut into pictures, however it arrives, and the buffer is bounded."""

from __future__ import annotations

from itertools import pairwise

import pytest
from camera_upstream import BOUNDARY, jpeg, part
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.web.mjpeg_parts import (
    MAX_HEAD_BYTES,
    MAX_PICTURE_BYTES,
    MAX_PIXELS,
    CameraRefusal,
    MjpegParts,
    is_shown,
)

PICTURES = [jpeg(bytes([n]) * 300 * n) for n in range(1, 6)]


def stream(*, length: bool) -> bytes:
    return f"--{BOUNDARY}\r\n".encode() + b"".join(part(each, length=length) for each in PICTURES)


@pytest.mark.parametrize("length", [True, False])
@given(cuts=st.lists(st.integers(0, 5000), max_size=20))
def test_pictures_come_whole_however_their_bytes_arrive(length: bool, cuts: list[int]) -> None:
    data = stream(length=length)
    edges = [0, *sorted(min(each, len(data)) for each in cuts), len(data)]
    parts = MjpegParts(BOUNDARY)
    found = [picture for begin, end in pairwise(edges) for picture in parts.feed(data[begin:end])]
    assert [picture.removesuffix(b"\r\n") for picture in found] == PICTURES
    assert parts.unusable == 0


@pytest.mark.parametrize("named", ["--mine", "mine"])
def test_a_boundary_whose_dashes_stand_in_the_type_too_is_understood(named: str) -> None:
    parts = MjpegParts(named)
    body = b"--mine\nContent-type:image/jpeg\nContent-length:  %d\n\n" % len(PICTURES[0])
    assert parts.feed(body + PICTURES[0]) == [PICTURES[0]]


@pytest.mark.parametrize(
    ("data", "cause"),
    [
        pytest.param(b"x" * (MAX_HEAD_BYTES + 1), "no_boundary", id="no-boundary"),
        pytest.param(b"--frame\r\nX: " + b"x" * MAX_HEAD_BYTES, "endless_header", id="header"),
        pytest.param(b"--frame\r\nContent-Length: 999999999\r\n\r\n", "large", id="announced"),
        pytest.param(b"--frame\r\n\r\n" + b"x" * (MAX_PICTURE_BYTES * 2), "large", id="endless"),
    ],
)
def test_what_would_fill_the_memory_is_refused_by_its_cause(data: bytes, cause: str) -> None:
    parts = MjpegParts(BOUNDARY)
    fed: list[int] = []

    def feed() -> None:
        for at in range(0, len(data), 1000):
            fed.append(at)
            parts.feed(data[at : at + 1000])

    with pytest.raises(CameraRefusal) as refused:
        feed()
    assert refused.value.cause == cause
    assert fed[-1] <= MAX_PICTURE_BYTES + MAX_HEAD_BYTES + 1000


@given(st.lists(st.binary(max_size=200), max_size=20))
def test_no_bytes_raise_anything_else(pieces: list[bytes]) -> None:
    parts = MjpegParts(BOUNDARY)
    parts.feed(b"--frame\r\n")
    for piece in pieces:
        parts.feed(piece + b"\r\n\r\n--frame")


@pytest.mark.parametrize(
    "picture",
    [
        b"",
        b"<html>",
        b"\x89PNG\r\n\x1a\n",
        b"\xff\xd8",
        b"\xff\xd8\xff",
        b"\xff\xd8\xff\xe0\x00\x00" * 100,
        b"\xff\xd8" + b"\xff\xe0\x00\x02" * 100,
        jpeg(width=65535, height=65535),
        jpeg(width=3841, height=2160),
        jpeg(width=0),
        jpeg()[:12],
    ],
)
def test_a_part_that_no_browser_can_show_is_counted_and_left_out(picture: bytes) -> None:
    assert not is_shown(picture)
    parts = MjpegParts(BOUNDARY)
    body = f"--{BOUNDARY}\r\n".encode() + part(picture) + part(PICTURES[0])
    assert parts.feed(body) == [PICTURES[0]]
    assert parts.unusable == 1


def test_the_largest_picture_is_shown() -> None:
    assert is_shown(jpeg(width=3840, height=MAX_PIXELS // 3840))
