"""How long the four-channel board's main loop is busy with a text."""

from __future__ import annotations

from yahboomd.simulation.options import StreamPace
from yahboomd.simulation.wire import transfer_ns

DIGIT_NS = 36_000
"""The time that a digit takes to be printed."""

COPIES = 2
AHEAD = 2
"""Each text goes to two ports in turn, and the last bytes of one leave while the other begins."""


def printing_ns(text: bytes) -> int:
    """The time before the first byte of a text, while its numbers are printed."""
    return DIGIT_NS * sum(byte in b"0123456789" for byte in text)


def saying_ns(size: int, baud: int, pace: StreamPace) -> int:
    """The time from the first byte of an answer to the next thing that the main loop does."""
    copies = 1 if pace == "wire" else COPIES
    return copies * transfer_ns(max(0, size - AHEAD), baud)


def line_period_ns(size: int, baud: int, pace: StreamPace) -> int:
    """The time from the start of a stream line to the next thing that the main loop does.

    The rates seen on boards (407 lines a second of 16 bytes, 169 of 32, 120 of 44, 92 of 56) fit
    0.2125 ms a byte less 0.95 ms at 115200 baud: about twice the transfer time.
    """
    wire_ns = transfer_ns(size, baud)
    if pace == "wire":
        return wire_ns
    return max(wire_ns, (212_500 * size - 950_000) * 115200 // baud)
