"""A header, and a ring in memory."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from made_boxes import HEADER, SEGMENT_BYTES, into

from yahboomd.blackbox.box_file import Header, encode_header
from yahboomd.blackbox.ring import Ring


@pytest.fixture
def header() -> Header:
    return HEADER


@pytest.fixture
def memory() -> Callable[..., tuple[bytearray, Ring]]:
    """Makes a ring with a number of segments, in bytes that a test can look at."""

    def make(segments: int = 4) -> tuple[bytearray, Ring]:
        head = encode_header(HEADER)
        buffer = bytearray(head + bytes(segments * SEGMENT_BYTES))
        return buffer, Ring(into(buffer), len(head), SEGMENT_BYTES, segments)

    return make
