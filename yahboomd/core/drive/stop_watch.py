"""Watches whether a stop is obeyed: a commanded stop is not yet a stop.

After a zero command the wheels must be measured standing within 0.6 s. If they are not, the stop is
overdue and the motors are cut. A wheel that slows down obeys, however slow the board's loop or its
momentum make it: it is cut, but not accused. A wheel that was accused and turns on after the cut is
reported once more, because no frame can stop it. One reading proves neither standstill (a wheel
that swings through zero also shows a slow one) nor motion (a digit may be garbled).
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Literal, TypeAlias

from yahboomd.core.counts import slowest
from yahboomd.core.drive.faults import Fault
from yahboomd.core.model import NS_PER_S
from yahboomd.core.standstill import PROVEN_NS, STAND_WITHIN_S, STANDING_M_S, Standstill, turning

if TYPE_CHECKING:
    from collections.abc import Sequence

StopState: TypeAlias = Literal["idle", "stopping", "stopped", "overdue"]

STAND_WITHIN_NS = round(STAND_WITHIN_S * NS_PER_S)

# Under the board's loop an obedient wheel has lost far more than this of its speed within 0.6 s.
SLOWED = 0.7
# A wheel that was let go is slowed by its friction alone.
ROLLS_OUT = 0.9
ROLLS_NS = 1_000_000_000
"""From the cut of a disobedient wheel to the next look at it."""
SILENT_NS = 300_000_000
"""After this time without readings, a stop cannot be judged."""
FRESH_NS = 500_000_000
"""Older readings do not show the present motion: boards are asked at least five times a second."""


class StopWatch:
    """Follows one stop from the command to the proof.

    Attributes:
        state: ``idle`` if no stop is under way; ``stopping``; ``stopped``: measured; ``overdue``:
            not standing in time. Wheels that stand later are ``stopped`` too.
    """

    def __init__(self, motors: Sequence[str]) -> None:
        self.state: StopState = "idle"
        self._motors = tuple(motors)
        self._begun_ns = 0
        self._judged_ns: int | None = 0
        self._standstill = Standstill()
        self._cut_ns: int | None = None
        self._measured_ns = 0
        self._latest: deque[tuple[float, ...]] = deque(maxlen=2)
        self._fastest: tuple[float, ...] = ()

    def begin(self, now_ns: int) -> None:
        """Begin at a zero command at ``now_ns``. A stop under way keeps its own deadline."""
        if self.state in {"stopping", "overdue"}:
            return
        self.state = "stopping"
        self._begun_ns = self._judged_ns = now_ns
        self._standstill.since_ns = self._cut_ns = None
        self._latest.clear()
        self._fastest = (0.0,) * len(self._motors)

    def restart(self, now_ns: int) -> None:
        """Restart the deadline of a stop under way: no reading came, or it is sent once more."""
        if self.state == "stopping":
            self.state = "idle"
            self.begin(now_ns)
        elif self.state == "overdue" and self._judged_ns is not None:
            self._judge_later(now_ns)

    def cancel(self) -> None:
        self.state = "idle"

    def measure(self, stamp_ns: int, measured_m_s: Sequence[float]) -> StopState:
        """Check a reading: rim speed of each motor, sampled at ``stamp_ns``.

        Readings from before the stop prove nothing and are ignored.
        """
        if self.state not in {"stopping", "overdue"} or stamp_ns < self._begun_ns:
            return self.state
        self._latest.append(tuple(measured_m_s))
        self._measured_ns = stamp_ns
        # A wheel that two readings saw stand since the stop swings: the next look judges it. One
        # with a lag of 0.3 s that is stopped in the middle of a reversal gains 0.07 m/s first.
        stopping = self.state == "stopping" and len(self._latest) > 1
        self._fastest = tuple(
            math.inf if stopping and not turning(speeds) else max(fastest, abs(speeds[-1]))
            for fastest, speeds in zip(self._fastest, zip(*self._latest, strict=True), strict=True)
        )
        if self._standstill.measure(stamp_ns, measured_m_s):
            self.state = "stopped"
        return self.state

    def check(self, now_ns: int, *, noisy: bool = False) -> Fault | None:
        """Judge a stop that is due; :attr:`state` is ``overdue`` from then on.

        Args:
            noisy: The stop may not have arrived, so no wheel is judged before the cut has been
                sent for as long.

        Returns:
            The fault of a disobedient wheel, once readings show it, and once more if it turns on
            after the cut; ``None`` while every turning wheel slows down.
        """
        if self.state not in {"stopping", "overdue"}:
            return None
        if self._judged_ns is None:
            return self._after_cut(now_ns)
        if now_ns - self._judged_ns < STAND_WITHIN_NS:
            return None
        still_ns = self._standstill.since_ns
        if still_ns is not None and now_ns - still_ns < 2 * PROVEN_NS:
            # They stand, and the reading that proves it is on its way.
            return None
        again = self.state == "overdue"
        slowed = ROLLS_OUT if again else SLOWED
        self.state = "overdue"
        silent = len(self._latest) < 2 or now_ns - self._measured_ns > SILENT_NS
        if silent or still_ns is not None or (noisy and not again):
            # Earlier motion proves nothing. Others notice a board that stays silent, as in a dip of
            # its supply.
            self._judge_later(now_ns)
            return None
        after_s = (now_ns - self._begun_ns) / NS_PER_S
        speed, name = self._turning_on(slowed)
        self._judge_later(now_ns)
        if not speed:
            return None
        self._judged_ns, self._cut_ns = None, now_ns
        return Fault(
            kind="stop_not_obeyed",
            motor=name,
            message=(
                f"{name} still turns at {speed:.2f} m/s {after_s:.1f} s after the stop and does "
                "not slow down: the motors are cut. Check this wheel's encoder and its plug, and "
                "whether something else turns it."
            ),
            action="cut",
            measured_m_s=speed,
        )

    def _after_cut(self, now_ns: int) -> Fault | None:
        cut_ns = self._cut_ns
        if cut_ns is None or now_ns - cut_ns < ROLLS_NS or len(self._latest) < 2:
            return None
        if now_ns - self._measured_ns > FRESH_NS:
            return None
        speed, name = self._turning_on(ROLLS_OUT)
        self._judge_later(now_ns)
        self._judged_ns, self._cut_ns = None, None if speed else now_ns
        if not speed:
            return None
        return Fault(
            kind="stop_not_obeyed",
            motor=name,
            message=(
                f"{name} still turns at {speed:.2f} m/s although the motors were cut, and no "
                "command ends that: switch their supply off. Unless a hand or a slope turns it, "
                "the board receives nothing, or its motor driver is broken."
            ),
            action="cut",
            measured_m_s=speed,
            certain=True,
        )

    def _turning_on(self, slowed: float) -> tuple[float, str]:
        """The speed and the name of the wheel that slowed down least; 0 if all slowed down.

        Args:
            slowed: A wheel below this share of its fastest speed slows down.
        """
        speed, name, fastest = max(
            zip(map(slowest, *self._latest), self._motors, self._fastest, strict=True),
            key=lambda wheel: abs(wheel[0]) - slowed * wheel[2],
        )
        return (speed if abs(speed) > max(slowed * fastest, STANDING_M_S) else 0.0), name

    def _judge_later(self, now_ns: int) -> None:
        self._judged_ns = now_ns
        self._fastest = (
            tuple(map(abs, self._latest[-1])) if self._latest else (0.0,) * len(self._motors)
        )
        self._latest.clear()
