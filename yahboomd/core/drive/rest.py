"""Whether wheels that stand are held by the board's speed loop, or let go.

A board that holds wheels keeps the last output of its loop: a motor that needs less than the stored
dead zone hunts, one that needs more is fed half the output for ever. Wheels that are let go may
roll.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

from yahboomd.core.drive.faults import Fault
from yahboomd.core.standstill import HUNTS_M

if TYPE_CHECKING:
    from collections.abc import Sequence

AtRest: TypeAlias = Literal["auto", "hold", "release"]

STOOD_NS = 2_000_000_000
ROLLED_M = 0.005
ROLLS_OUT_S = 0.3
"""Wheels that are let go in motion roll no farther than their speed takes them in this time."""


class Rest:
    """The wheels from one drive to the next.

    Attributes:
        lets_go: They stood long enough to be let go.
        free: They are let go because they obeyed a stop, and held again if they roll.

    Args:
        mode: ``auto``: let go after 2 s, and held until the next drive if one rolls; ``hold``:
            never let go; ``release``: let go at once, and never held.
    """

    def __init__(
        self, mode: AtRest, motors: Sequence[str], metres_per_tick: Sequence[float]
    ) -> None:
        self._mode, self._motors, self._metres_per_tick = mode, motors, metres_per_tick
        self.drive()

    def drive(self) -> None:
        """Begin again: the wheels are to turn, or nothing is known of them."""
        self.lets_go, self.free, self._rolled = self._mode == "release", False, False
        self._since_ns, self._from, self._way_m = 0, list[int](), ROLLED_M

    def let_go(self, rolling_m_s: float = 0.0) -> None:
        """They are let go from now on, and may roll out from this speed."""
        self.free = self._mode == "auto" and not self._rolled
        self._from, self._way_m = [], ROLLED_M + ROLLS_OUT_S * rolling_m_s

    def measure(self, stamp_ns: int, ticks: Sequence[int], *, stand: bool) -> Fault | None:
        """Follow wheels that stand, or roll out.

        Args:
            ticks: The travelled counts of each motor.
            stand: They were seen to stand since their stop.

        Returns:
            The report on a wheel that rolled: they are to be held then.
        """
        if self._mode != "auto" or self._rolled:
            return None
        if stand and self._way_m > ROLLED_M:
            self.let_go()
        farthest_m, motor = max(
            (abs(now - before) * metres, name)
            for now, before, metres, name in zip(
                ticks, self._from or ticks, self._metres_per_tick, self._motors, strict=True
            )
        )
        if not self._from or (farthest_m > HUNTS_M and not self.free):
            self._since_ns, self._from = stamp_ns, list(ticks)
            self.lets_go = False
        elif not self.free:
            self.lets_go = stamp_ns - self._since_ns >= STOOD_NS
        elif farthest_m > self._way_m:
            self.free, self.lets_go, self._rolled = False, False, True
            words = (
                f"{motor} rolled {farthest_m * 1e3:.0f} mm without a command after the wheels were "
                "let go at rest: they are held until the next drive. On a slope that is as it "
                "should be; command.at_rest sets what wheels do at rest."
            )
            return Fault(kind="rolled", motor=motor, message=words, action="report")
        return None
