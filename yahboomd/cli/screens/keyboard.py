"""From a terminal's bytes to keys, and from keys to what they ask for. Pure.

A terminal tells no releases: a key that is held comes again and again, the first time after a
delay. What follows from that for a robot is in :mod:`yahboomd.cli.screens.teleop`.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

ESCAPE = "escape"
UNKNOWN = "unknown"

_ESC = 0x1B
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_LONGEST = 32
"""Bytes of an escape sequence; no key of any terminal has more."""

Wish: TypeAlias = Literal["move", "stop", "faster", "slower", "estop", "release", "quit"]

MOVES: dict[str, tuple[int, int, int]] = {
    **dict.fromkeys(("up", "w", "i"), (1, 0, 0)),
    **dict.fromkeys(("down", "s", ","), (-1, 0, 0)),
    **dict.fromkeys(("left", "a", "j"), (0, 0, 1)),
    **dict.fromkeys(("right", "d", "l"), (0, 0, -1)),
    "u": (1, 0, 1),
    "o": (1, 0, -1),
    "m": (-1, 0, -1),
    ".": (-1, 0, 1),
    # As in ROS's keyboard teleoperation: shift, for bases that can move sideways.
    "J": (0, 1, 0),
    "L": (0, -1, 0),
}
"""The keys that move, with the signs of vx, vy and wz."""

_WISHES: dict[str, Wish] = {
    **dict.fromkeys("+=", "faster"),
    **dict.fromkeys("-_", "slower"),
    **dict.fromkeys("eE", "estop"),
    **dict.fromkeys("rR", "release"),
    # Ctrl-C and Ctrl-D too, where the terminal hands them over.
    **dict.fromkeys("qQ\x03\x04", "quit"),
}


def direction(key: str) -> tuple[int, int, int] | None:
    """Where a key moves the base; None where it does not."""
    # With caps lock on, W is still forward.
    return MOVES.get(key) or MOVES.get(key.lower())


def wish(key: str) -> Wish:
    """What a key asks for. Every key that means nothing else stops."""
    if direction(key) is not None:
        return "move"
    return _WISHES.get(key, "stop")


class KeyParser:
    """Cuts what a terminal sends into keys, however it was chopped on the way.

    Were an arrow's ``ESC [ A`` taken apart at a read's end, its ``A`` would be a key of its own,
    and the robot would turn.
    """

    def __init__(self) -> None:
        self._held = bytearray()

    @property
    def pending(self) -> bool:
        """Whether a key has begun and not ended: if nothing follows soon, it is the escape key."""
        return bool(self._held)

    def feed(self, data: bytes) -> list[str]:
        """Take bytes; returns the keys that they complete, as characters or names."""
        self._held += data
        keys = list[str]()
        while self._held:
            size, key = _first(bytes(self._held))
            if not size:
                break
            del self._held[:size]
            keys.append(key)
        return keys

    def flush(self) -> list[str]:
        """Nothing followed: what is held is a key by itself."""
        if not self._held:
            return []
        key = ESCAPE if bytes(self._held) == bytes([_ESC]) else UNKNOWN
        self._held.clear()
        return [key]


def _first(data: bytes) -> tuple[int, str]:
    """Size and name of the first key; size 0 while it is not all there."""
    if data[0] == _ESC:
        return _escape(data)
    if data[0] < 0x80:
        return 1, chr(data[0])
    # UTF-8: the first byte tells how many follow.
    size = 2 if data[0] < 0xE0 else 3 if data[0] < 0xF0 else 4
    if len(data) < size and all(0x80 <= byte < 0xC0 for byte in data[1:]):
        return 0, ""
    try:
        return size, data[:size].decode("utf-8")
    except UnicodeDecodeError:
        return 1, UNKNOWN


def _escape(data: bytes) -> tuple[int, str]:
    if len(data) == 1:
        return 0, ""
    if data[1] == _ESC:
        return 1, ESCAPE
    if data[1] not in b"[O":
        # Alt and a key.
        return 2, UNKNOWN
    for index in range(2, min(len(data), _LONGEST)):
        # Parameters come before the byte that ends a sequence and names it.
        if data[1] == ord("O") or 0x40 <= data[index] <= 0x7E:
            return index + 1, _ARROWS.get(chr(data[index]), UNKNOWN)
        if not 0x20 <= data[index] <= 0x3F:
            return index, UNKNOWN
    if len(data) < _LONGEST:
        return 0, ""
    return _LONGEST, UNKNOWN
