"""Puts numbers, durations and endpoints into words. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

_DECIMAL = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*", re.ASCII)


def decimal(text: str) -> float:
    """The number that a person wrote; NaN for all else that Python reads: ``1_0``, ``1e999``."""
    value = float(text) if _DECIMAL.fullmatch(text) else math.nan
    return value if math.isfinite(value) else math.nan


def duration(s: float) -> str:
    """A duration at a glance: ``4.2 s``, ``3 min 05 s``, ``2 h 07 min``."""
    if s < 60.0:
        # 59.96 would round to 60.0 s instead of 1 min 00 s.
        return f"{min(s, 59.9):.1f} s"
    minutes, rest_s = divmod(int(s), 60)
    if minutes < 60:
        return f"{minutes} min {rest_s:02d} s"
    hours, minutes = divmod(minutes, 60)
    if hours < 48:
        return f"{hours} h {minutes:02d} min"
    return f"{hours // 24} days"


def signed(value: float, digits: int = 3, width: int = 8) -> str:
    """A number right-aligned with this many digits behind the point, without a negative zero."""
    return f"{round(value, digits) + 0.0:{width}.{digits}f}"


def degrees(theta_rad: float) -> str:
    """A heading in degrees from -180 to 180, without its whole turns."""
    wrapped = math.degrees(math.remainder(theta_rad, 2.0 * math.pi))
    return f"{round(wrapped, 1) + 0.0:.1f}°"


def rate(per_s: float | None, what: str) -> str:
    """A rate, or a dash while it is unknown."""
    return f"{'-' if per_s is None else f'{per_s:.0f}'} {what}/s"


def listed(endpoints: Sequence[str]) -> str:
    """List endpoints in a sentence."""
    return " or ".join(endpoints)
