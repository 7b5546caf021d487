"""How numbers and moments are said on a terminal. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

STATES = {
    "driving": "green",
    "standing": "cyan",
    "stopping": "yellow",
    "waiting": "yellow",
    "estopped": "red",
    "fault": "red",
}
"""The colour of each state of the daemon."""

SEVERITIES = {"info": "blue", "warning": "yellow", "error": "red"}
"""The colour of each severity of an event."""


def duration(s: float) -> str:
    """A duration that a person takes in at a glance: ``4.2 s``, ``3 min 05 s``, ``2 h 07 min``."""
    if s < 60.0:
        # 59.96 would be rounded to a minute, which is not written like that.
        return f"{min(s, 59.9):.1f} s"
    minutes, rest_s = divmod(int(s), 60)
    if minutes < 60:
        return f"{minutes} min {rest_s:02d} s"
    hours, minutes = divmod(minutes, 60)
    if hours < 48:
        return f"{hours} h {minutes:02d} min"
    return f"{hours // 24} days"


def signed(value: float, digits: int = 3, width: int = 8) -> str:
    """A number right-aligned with so many digits behind the point, and never a negative zero."""
    return f"{round(value, digits) + 0.0:{width}.{digits}f}"


def degrees(theta_rad: float) -> str:
    """A heading in degrees from -180 to 180, whatever turns are in it."""
    wrapped = math.degrees(math.remainder(theta_rad, 2.0 * math.pi))
    return f"{round(wrapped, 1) + 0.0:.1f}°"


def rate(per_s: float | None, what: str) -> str:
    """A rate, or a dash while it is unknown."""
    return f"{'-' if per_s is None else f'{per_s:.0f}'} {what}/s"


def listed(endpoints: Sequence[str]) -> str:
    """Endpoints in a sentence."""
    return " or ".join(endpoints)


def bar(speed: float, command: float, *, full_scale: float, width: int) -> list[tuple[str, str]]:
    """A speed beside what was commanded, as characters with zero in the middle.

    Args:
        speed: Drawn as a bar from the middle.
        command: Drawn as a mark.
        full_scale: What reaches the end; larger values stay there.
        width: Characters; an odd number has a middle.

    Returns:
        Each character with its part: ``empty``, ``axis``, ``speed``, or ``command``.
    """
    half = width // 2
    cells: list[tuple[str, str]] = [("·", "empty")] * width
    cells[half] = ("┼", "axis")

    def share(value: float) -> float:
        return min(1.0, abs(value) / full_scale) if full_scale > 0.0 else 0.0

    # Twice the resolution, by half blocks.
    filled = round(share(speed) * half * 2)
    step = 1 if speed > 0.0 else -1
    for index in range(1, filled // 2 + 1):
        cells[half + step * index] = ("█", "speed")
    if filled % 2:
        cells[half + step * (filled // 2 + 1)] = ("▌" if speed > 0.0 else "▐", "speed")
    if command != 0.0:
        place = max(1, round(share(command) * half))
        cells[half + (place if command > 0.0 else -place)] = ("┃", "command")
    return cells
