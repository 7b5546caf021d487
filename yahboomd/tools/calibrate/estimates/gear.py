"""Finds the gear that fits a wheel's counts. Pure.

A profile is suggested only if it has the stored type of the configured one. With another type the
board would believe that it drives another car, with other signs of its encoders and other limits of
its battery; then ``chassis.ticks_per_revolution`` is suggested instead.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
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


def another_gear(
    factor: float, own: Motors, alike: Sequence[Motors], known: Iterable[Motors]
) -> str:
    """A sentence if the error of the wheels' size is the quotient of two gears; else empty.

    Args:
        factor: The measured size of the wheels over the configured one.
        alike: The motors with the same stored type.
    """
    ticks = own.ticks_per_revolution / factor
    found = fitting(ticks, own, alike, within=MEASURED_WITHIN)
    found = found or fitting(ticks, own, known, within=MEASURED_WITHIN)
    if found is None or found.ticks_per_revolution == own.ticks_per_revolution:
        return ""
    quotient = f"{own.ratio:g}/{found.ratio:g}"
    if found.lines != own.lines:
        quotient = f"({own.lines} x {own.ratio:g})/({found.lines} x {found.ratio:g})"
    words = (
        f"{factor:.3f} is {quotient}: the gear is likely 1:{found.ratio:g}, not 1:{own.ratio:g} as "
        f"the profile {own.name} has it."
    )
    if found in alike:
        return f'{words} The profile {found.name} fits: board.profile = "{found.name}".'
    return f"{words} {counts_instead(own, found)}"


def counts_instead(own: Motors, found: Motors) -> str:
    """What to set if the gear fits motors that no profile of the same stored type has."""
    ticks, share = found.ticks_per_revolution, found.ticks_per_revolution / own.ticks_per_revolution
    return (
        f"Set chassis.ticks_per_revolution = {ticks:g}, and leave board.profile and the type that "
        f"the board stores: they say which car it is. The board goes on counting "
        f"{own.ticks_per_revolution:g} to a turn, so yahboomd commands {share:.2f} of each speed, "
        f"and the wheels turn as commanded; a remote control or another program drives them "
        f"{1.0 / share:.2f} times as fast as it says."
    )


def _off(ticks: float, motors: Motors) -> float:
    return abs(math.log(ticks / motors.ticks_per_revolution))
