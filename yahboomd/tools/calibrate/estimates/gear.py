"""Finds the motors that fit a wheel's counts: a wrong gear ratio is a wrong profile. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

WITHIN = 0.12
"""The accuracy with which a person sees a wheel's angle, as a share of half a turn."""

MEASURED_WITHIN = 0.05
"""The accuracy of a gear by tape: the wheels may be a little larger or smaller than configured."""

OTHER_LINES = 0.1
"""The penalty of motors with another encoder: another gear with the same one is more likely."""


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
    """Whether the counts of one turn of the wheel fit these motors."""
    return _off(ticks, own) <= within


def fitting(
    ticks: float, own: Motors, known: Iterable[Motors], *, within: float = WITHIN
) -> Motors | None:
    """The motors that fit best to the counts of one turn; None if none fits.

    Args:
        own: The configured ones: others with the same encoder are preferred.
    """

    def unlikely(motors: Motors) -> float:
        return _off(ticks, motors) + (0.0 if motors.lines == own.lines else OTHER_LINES)

    found = [each for each in known if fits(ticks, each, within=within)]
    return min(found, key=unlikely, default=None)


def another_gear(factor: float, own: Motors, known: Iterable[Motors]) -> str:
    """A sentence if the error of the wheels' size is the quotient of two gears; else empty.

    Args:
        factor: The measured size of the wheels over the configured one.
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
