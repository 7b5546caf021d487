"""The numbers inside a frame, both ways. The law: a number is taken only as ``printf`` writes it.

Python's own ``int()`` and ``float()`` accept spaces, underscores, plus signs, ``nan`` and digits of
other scripts; on a wire without a checksum each of those is a corrupted byte.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Sequence
from typing import Final

from yahboomd.core.model import CHANNELS, Counts
from yahboomd.core.protocol.dialect import FourFloats, Totals

INT32_MIN: Final = -(2**31)
INT32_MAX: Final = 2**31 - 1

_INTEGER = re.compile(r"-?[0-9]{1,10}")
_FOUR_INTEGERS = re.compile(",".join([f"({_INTEGER.pattern})"] * CHANNELS))
_DECIMAL = re.compile(r"-?[0-9]{1,10}(?:\.[0-9]{1,6})?")
_SPEED = re.compile(r"-?[0-9]{1,10}\.[0-9]{2}")
_VOLTS = re.compile(r"([0-9]{1,3}\.[0-9]{1,2})V")


def integer(text: str) -> int | None:
    if _INTEGER.fullmatch(text) is None:
        return None
    value = int(text)
    return value if INT32_MIN <= value <= INT32_MAX else None


def decimal(text: str) -> float | None:
    """A plain decimal number such as ``67.000`` or ``67``, or None."""
    return float(text) if _DECIMAL.fullmatch(text) else None


def four_integers(args: str) -> Counts | None:
    """Exactly four integers of 32 bits between commas, or None."""
    match = _FOUR_INTEGERS.fullmatch(args)
    if match is None:
        return None
    a, b, c, d = map(int, match.groups())
    if min(a, b, c, d) < INT32_MIN or max(a, b, c, d) > INT32_MAX:
        return None
    return a, b, c, d


def totals(args: str) -> Totals | None:
    ticks = four_integers(args)
    return None if ticks is None else Totals(ticks=ticks)


def four_speeds(args: str) -> FourFloats | None:
    """Exactly four numbers with two decimals between commas, or None."""
    parts = args.split(",", CHANNELS)
    if len(parts) != CHANNELS or not all(map(_SPEED.fullmatch, parts)):
        return None
    a, b, c, d = map(float, parts)
    return a, b, c, d


def volts(args: str) -> float | None:
    """A voltage such as ``7.4V`` or ``12.05V``, or None."""
    match = _VOLTS.fullmatch(args)
    return float(match[1]) if match else None


def command(name: str, units: Sequence[int], limit: int) -> bytes:
    """A frame with four integers, each brought into -limit..limit.

    The board does not check: 40000 wraps to 16 bits and becomes full reverse, and fourteen numbers
    hang it with the motors running. So this is the only place that writes numbers for motors.

    Args:
        units: One integer for each position of the board.
        limit: The largest magnitude that may be sent.

    Raises:
        ValueError: On other than four numbers.
        TypeError: On a number that is not an integer.
    """
    # index() before the clamp: min(1000, nan) is 1000, and nan would become full speed.
    a, b, c, d = [max(-limit, min(limit, operator.index(unit))) for unit in units]
    return f"${name}:{a:d},{b:d},{c:d},{d:d}#".encode("ascii")
