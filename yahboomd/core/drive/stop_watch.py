"""Whether a stop was obeyed: commanded is not stopped.

After a zero command the wheels have to be measured standing within 0.6 s; where they are not, the
stop is overdue and the motors are cut. A wheel that slows down obeys, however long the board's own
loop or its momentum take: it is cut, and not accused. One that was accused and turns on although it
was cut is reported once more: nothing that can be sent ends that. One reading proves neither a
standstill, as a wheel that swings through zero shows a slow one, too, nor motion: a digit may be
garbled.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Literal, TypeAlias

from yahboomd.core.counts import slowest
from yahboomd.core.drive.faults import Fault
from yahboomd.core.drive.standing import STANDING_M_S, turning
from yahboomd.core.model import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Sequence

StopState: TypeAlias = Literal["idle", "stopping", "stopped", "overdue"]

WITHIN_NS = 600_000_000
"""So long the wheels may take."""

# Two readings at the slowest poll worth running, several at the usual ones.
SETTLED_NS = 30_000_000
# Under the board's loop a wheel that obeys has lost far more than this of its speed within 0.6 s.
SLOWED = 0.7
# A wheel that was let go rolls out by its friction alone.
ROLLS_OUT = 0.9
ROLLS_NS = 1_000_000_000
"""From the cut of a wheel that did not obey to the next look at it."""
SILENT_NS = 300_000_000
"""Readings that stay away for so long show nothing of a stop."""
FRESH_NS = 500_000_000
"""Older readings do not show what a wheel does now: boards are asked five times a second or more
often."""


class StopWatch:
    """Follows one stop from the command to the proof.

    Attributes:
        state: ``idle`` where no stop is under way; ``stopping``; ``stopped``: measured;
            ``overdue``: not standing in time. Wheels that stand at last are ``stopped``, however
            late.
    """

    def __init__(self, motors: Sequence[str]) -> None:
        self.state: StopState = "idle"
        self._motors = tuple(motors)
        self._begun_ns = 0
        self._judged_ns: int | None = 0
        self._still_ns: int | None = None
        self._cut_ns: int | None = None
        self._measured_ns = 0
        self._latest: deque[tuple[float, ...]] = deque(maxlen=2)
        self._fastest: tuple[float, ...] = ()

    def begin(self, now_ns: int) -> None:
        """Begin: zero was commanded at ``now_ns``. A stop under way keeps its own deadline."""
        if self.state in {"stopping", "overdue"}:
            return
        self.state = "stopping"
        self._begun_ns = self._judged_ns = now_ns
        self._still_ns = self._cut_ns = None
        self._latest.clear()
        self._fastest = (0.0,) * len(self._motors)

    def restart(self, now_ns: int) -> None:
        """Restart the deadline of a stop that is under way: no reading came meanwhile."""
        if self.state == "stopping":
            self.state = "idle"
            self.begin(now_ns)

    def cancel(self) -> None:
        """End the watch: motion is commanded again."""
        self.state = "idle"

    def measure(self, stamp_ns: int, measured_m_s: Sequence[float]) -> StopState:
        """Check a reading: rim speed of each motor, sampled at ``stamp_ns``.

        Readings from before the stop prove nothing and are passed over.
        """
        if self.state not in {"stopping", "overdue"} or stamp_ns < self._begun_ns:
            return self.state
        self._latest.append(tuple(measured_m_s))
        self._measured_ns = stamp_ns
        self._fastest = tuple(map(max, self._fastest, map(abs, measured_m_s)))
        if turning(measured_m_s):
            self._still_ns = None
        elif self._still_ns is None:
            self._still_ns = stamp_ns
        elif stamp_ns - self._still_ns >= SETTLED_NS:
            self.state = "stopped"
        return self.state

    def check(self, now_ns: int, *, noisy: bool = False) -> Fault | None:
        """Judge a stop that is due; :attr:`state` is ``overdue`` from then on.

        Args:
            noisy: The stop may not have arrived, so that nothing is said of the wheels before the
                cut was sent for as long.

        Returns:
            The fault of a wheel that did not obey, once readings show it, and once more where it
            turns on although it was cut; ``None`` as long as every wheel that turns
            slows down.
        """
        if self.state not in {"stopping", "overdue"}:
            return None
        if self._judged_ns is None:
            return self._after_cut(now_ns)
        if now_ns - self._judged_ns < WITHIN_NS:
            return None
        if self._still_ns is not None and now_ns - self._still_ns < 2 * SETTLED_NS:
            # They stand; the reading that proves it is on its way.
            return None
        again = self.state == "overdue"
        slowed = ROLLS_OUT if again else SLOWED
        self.state = "overdue"
        silent = len(self._latest) < 2 or now_ns - self._measured_ns > SILENT_NS
        if silent or self._still_ns is not None or (noisy and not again):
            # What the wheels did before proves nothing. A board that stays silent, as in a dip of
            # its supply, is noticed by others.
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
        """The fault of a wheel that was accused and cut, and turns on; once."""
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
        """The speed and the name of the wheel that slowed down least; 0 where all did so.

        Args:
            slowed: A wheel below that share of its fastest speed slows down.
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
