"""What a guard and its owner say to each other: packets, each a word and its value.

The guard imports this file; it needs the standard library alone.
"""

from __future__ import annotations

from typing import NamedTuple

MAX_BYTES = 16384

STOP_SOCKET = "stop"
"""The beginning of the name of each socket for local stops."""

PORT = b"PORT"
"""The note of the owner's port, with its descriptor if it is open."""
STOP = b"STOP"
"""Frames that stop the wheels, once the board is known: zero speed, and the surest stop."""
CLOSE = b"CLOSE"
"""The owner closes the port, or opens it, after the answer."""
PROMISE = b"PROMISE"
"""The promise lapses sooner than the guard may know; a number, which it returns in the memory."""
LISTEN = b"LISTEN"
"""A :class:`Listening`: listen for local stops there, or look whether programs find that socket."""
FACTS = b"FACTS"
"""What the socket's ``status`` returns, a line of JSON."""
ANSWERED = b"ANSWERED"
"""The number of a stop and a line of JSON, for each that asked for it or for an earlier one."""
SEEN = b"SEEN"
"""The same, once the wheels were seen to stand, or were not for too long."""
WANTED = b"WANTED"
"""The number of a device whose port another process holds: a dead owner's guard unlocks it."""

ASKED = b"ASKED"
"""From the guard: the number of a stop that a program asks for, and who it is."""
SOCKET = b"SOCKET"
"""From the guard: the path of its socket, or after a space the reason why there is none."""

CLOSED = b"closed"
"""The answer to ``CLOSE``. That to ``PORT`` is the number of the device."""

NEXT = b"next"
"""The next owner wants the device of this number: for a moment the guard of a dead one unlocks."""
HELD = b"held"
"""The next owner holds the device of this number, and has sent its stop."""


class Listening(NamedTuple):
    """Where a guard listens, and what it does in place of an owner that is gone.

    Attributes:
        name: The beginning of the socket's name.
        latch: The file of the emergency stop; empty if the owner has none.
    """

    folder: str
    name: str
    latch: str = ""
