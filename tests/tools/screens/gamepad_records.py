"""Records of a gamepad, as a program reads them from the kernel."""

from __future__ import annotations

import struct


def records(*events: tuple[int, int, int]) -> bytes:
    """Records of (type, code, value), each with the end of its report."""
    return b"".join(
        struct.pack("llHHi", 1_700_000_000, 0, *event) + struct.pack("llHHi", 0, 0, 0, 0, 0)
        for event in events
    )


def button(code: int, value: int) -> bytes:
    """1 for pressed, 0 for let go, 2 for a repeat."""
    return records((1, code, value))


def axis(code: int, value: int) -> bytes:
    """An axis at a value."""
    return records((3, code, value))
