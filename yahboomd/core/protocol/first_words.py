"""Frames that stop any board before the rest of yahboomd is imported: this file imports nothing.

It repeats :func:`yahboomd.core.protocol.registry.connect_stop`; a test compares.
"""

FIRST_WORDS = {
    "streamed": b"\n" * 64 + b"$pwm:0,0,0,0#",
    "polled": b"$speed:0,0,0,0#",
    "rosmaster": b"\0" * 20 + b"\xff\xfc\x0a\x12\x01\0\0\0\0\0\0\x1d",
}
"""For each dialect a resync and its surest stop; unknown frames do a board no harm."""

SPACING_S = 0.020
"""Between the two: a board may refuse a frame that comes sooner."""
