"""Reads a gamepad's input records; a button has to be held to drive. Pure.

The records and codes: Documentation/input/event-codes.rst and gamepad.rst of Linux, linux/input.h.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Literal, TypeAlias

import msgspec

RECORD = struct.Struct("llHHi")
"""Seconds, microseconds, type, code, value."""

EV_SYN, EV_KEY, EV_ABS = 0, 1, 3
SYN_DROPPED = 3

STICK_X, STICK_Y, RIGHT_X, HAT_Y = 0x00, 0x01, 0x03, 0x11
AXES = (STICK_X, STICK_Y, RIGHT_X)

SOUTH, EAST, LEFT_SHOULDER, RIGHT_SHOULDER, START = 0x130, 0x131, 0x136, 0x137, 0x13B
HOLDS = frozenset({LEFT_SHOULDER, RIGHT_SHOULDER})

DEAD = 0.1
"""The share of an axis within which it is at rest: sticks do not return to their middle."""

PadWish: TypeAlias = Literal["let_go", "estop", "release", "faster", "slower"]


class AxisRange(msgspec.Struct, frozen=True):
    """The least and the greatest value of an axis; by default those of most pads."""

    least: int = -32768
    most: int = 32767

    def share(self, value: int) -> float:
        """The place of a value: -1 to 1, and 0 around the middle."""
        half = (self.most - self.least) / 2.0
        if half <= 0.0:
            return 0.0
        share = min(max((value - self.least) / half - 1.0, -1.0), 1.0)
        reach = max(0.0, (abs(share) - DEAD) / (1.0 - DEAD))
        return reach if share > 0.0 else -reach


class Gamepad:
    """One pad, from the moment when it was opened.

    A button counts as held only if it is pressed from then on, not if it is down already.
    """

    def __init__(self, ranges: Mapping[int, AxisRange] | None = None) -> None:
        self._ranges = ranges or {}
        self._shares = dict.fromkeys(AXES, 0.0)
        self._holds = set[int]()
        self._rest = b""

    def feed(self, data: bytes) -> list[PadWish]:
        """Process records, which reads may split anywhere.

        Returns:
            The wishes besides driving, in order.
        """
        data = self._rest + data
        whole = len(data) - len(data) % RECORD.size
        self._rest = data[whole:]
        wishes: list[PadWish] = []
        for _, _, kind, code, value in RECORD.iter_unpack(data[:whole]):
            if (found := self._take(kind, code, value)) is not None:
                wishes.append(found)
        return wishes

    def _take(self, kind: int, code: int, value: int) -> PadWish | None:
        if (kind, code) == (EV_SYN, SYN_DROPPED):
            # A release may be among the lost ones.
            return self.let_go()
        if kind == EV_ABS and code in self._shares:
            self._shares[code] = self._ranges.get(code, AxisRange()).share(value)
        elif (kind, code) == (EV_ABS, HAT_Y) and value:
            return "faster" if value < 0 else "slower"
        elif kind == EV_KEY and code in HOLDS:
            if value == 0:
                return self.let_go()
            # 2 is a repeat of one that is down.
            if value == 1:
                self._holds.add(code)
        elif kind == EV_KEY and value == 1 and code in {EAST, START}:
            self.let_go()
            return "estop" if code == EAST else "release"
        return None

    def let_go(self) -> PadWish:
        """No button counts as held any more, until one is pressed again."""
        self._holds.clear()
        return "let_go"

    @property
    def held(self) -> bool:
        """Whether a button is held that lets the sticks drive."""
        return bool(self._holds)

    @property
    def shares(self) -> tuple[float, float, float]:
        """Forward, to the left and turning left, each from -1 to 1 of the speed."""
        x, y, right_x = (self._shares[axis] for axis in AXES)
        return -y or 0.0, -right_x or 0.0, -x or 0.0
