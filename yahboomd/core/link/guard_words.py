"""What a guard and its owner say to each other: packets, each a word and its value.

The guard imports this file; it needs the standard library alone.
"""

from __future__ import annotations

MAX_BYTES = 16384

PORT = b"PORT"
"""The note of the owner's port, with its descriptor if it is open."""
STOP = b"STOP"
"""Frames that stop the wheels, once the board is known: zero speed, and the surest stop."""
CLOSE = b"CLOSE"
"""The owner closes the port, or opens it, after the answer."""
PROMISE = b"PROMISE"
"""The promise lapses sooner than the guard may know."""

CLOSED = b"closed"
"""The answer to ``CLOSE``. That to ``PORT`` is the number of the device."""
