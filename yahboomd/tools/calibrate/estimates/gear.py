"""Which motors fit what was seen of a wheel: a wrong gear ratio is a wrong profile. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

WITHIN = 0.12
"""A person sees the angle of a wheel so exactly, as a share of half a turn."""

MEASURED_WITHIN = 0.05
"""A tape shows a gear so exactly: the wheels may be a little larger or smaller than configured."""

OTHER_LINES = 0.1
"""Motors with other encoders are less likely than another gear before the same one."""


class Motors(Protocol):
    """Motors with their gear."""

    @property
    def name(self) -> str:
        """Of the profile."""

    @property
    def lines(self) -> int:
        """Encoder lines of one turn of the motor."""

    @property
    def ratio(self) -> float:
        """Turns of the motor in one of the wheel."""

    @property
    def ticks_per_revolution(self) -> float:
        """Counts of one turn of the wheel."""


def fits(ticks: float, own: Motors, *, within: float = WITHIN) -> bool:
    """Whether a turn of the wheel has the counts that these motors have."""
    return _off(ticks, own) <= within


def fitting(
    ticks: float, own: Motors, known: Iterable[Motors], *, within: float = WITHIN
) -> Motors | None:
    """The motors that fit so many counts of one turn best; None if none does.

    Args:
        own: The configured ones: others with the same encoder are preferred.
    """

    def unlikely(motors: Motors) -> float:
        return _off(ticks, motors) + (0.0 if motors.lines == own.lines else OTHER_LINES)

    found = [each for each in known if fits(ticks, each, within=within)]
    return min(found, key=unlikely, default=None)


def another_gear(factor: float, own: Motors, known: Iterable[Motors]) -> str:
    """A sentence on wheels whose size would be off by the quotient of two gears; else empty.

    Args:
        factor: The size of the wheels that was found, over the configured one.
    """
    found = fitting(own.ticks_per_revolution / factor, own, known, within=MEASURED_WITHIN)
    if found is None or found.ticks_per_revolution == own.ticks_per_revolution:
        return ""
    quotient = f"{own.ratio:g}/{found.ratio:g}"
    if found.lines != own.lines:
        quotient = f"({own.lines} x {own.ratio:g})/({found.lines} x {found.ratio:g})"
    return (
        f"{factor:.3f} is {quotient}: the gear is likely 1:{found.ratio:g}, not 1:{own.ratio:g} as "
        f'the profile {own.name} has it. The profile {found.name} fits: board.profile = "'
        f'{found.name}".'
    )


def _off(ticks: float, motors: Motors) -> float:
    return abs(math.log(ticks / motors.ticks_per_revolution))
