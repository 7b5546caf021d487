"""Whether a stop was obeyed: commanded is not stopped.

After a zero command the wheels have to be measured standing within 0.6 s; where they do not, the
motors are cut. A single slow reading is no standstill: a wheel that swings through zero shows one,
too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

from yahboomd.drive.faults import Fault
from yahboomd.drive.standing import STANDING_M_S

if TYPE_CHECKING:
    from collections.abc import Sequence

StopState: TypeAlias = Literal["idle", "stopping", "stopped", "overdue"]

NS_PER_S = 1_000_000_000
# Two readings at the slowest poll worth running, several at the usual ones.
SETTLED_NS = 30_000_000


class StopWatch:
    """Follows one stop from the command to the proof.

    Args:
        motors: The names of the motors.
        within_s: How long the wheels may take.

    Attributes:
        state: ``idle`` where no stop is under way; ``stopping``; ``stopped``: measured;
            ``overdue``: not obeyed in time. Wheels that stand at last are ``stopped``, however
            late.
    """

    def __init__(self, motors: Sequence[str], *, within_s: float = 0.6) -> None:
        self.state: StopState = "idle"
        self._motors = tuple(motors)
        self._within_ns = round(within_s * NS_PER_S)
        self._begun_ns = 0
        self._still_ns: int | None = None
        self._latest: tuple[float, ...] | None = None

    @property
    def deadline_ns(self) -> int | None:
        """When the wheels have to stand: check again then at the latest; ``None``: no matter."""
        return self._begun_ns + self._within_ns if self.state == "stopping" else None

    def begin(self, now_ns: int) -> None:
        """Zero was commanded at ``now_ns``. A stop that is under way keeps its own deadline."""
        if self.state in {"stopping", "overdue"}:
            return
        self.state = "stopping"
        self._begun_ns = now_ns
        self._still_ns = None
        self._latest = None

    def cancel(self) -> None:
        """Motion is commanded again."""
        self.state = "idle"

    def measure(self, stamp_ns: int, measured_m_s: Sequence[float]) -> StopState:
        """Take in a reading: rim speed of each motor, sampled at ``stamp_ns``.

        Readings from before the stop prove nothing and are passed over.
        """
        if self.state not in {"stopping", "overdue"} or stamp_ns < self._begun_ns:
            return self.state
        self._latest = tuple(measured_m_s)
        if any(abs(speed) >= STANDING_M_S for speed in measured_m_s):
            self._still_ns = None
        elif self._still_ns is None:
            self._still_ns = stamp_ns
        elif stamp_ns - self._still_ns >= SETTLED_NS:
            self.state = "stopped"
        return self.state

    def check(self, now_ns: int) -> Fault | None:
        """The fault of a stop that is overdue, once, whether readings arrive or not."""
        if self.state != "stopping" or now_ns - self._begun_ns < self._within_ns:
            return None
        if self._still_ns is not None and now_ns - self._still_ns < 2 * SETTLED_NS:
            # They stand; the reading that proves it is on its way.
            return None
        self.state = "overdue"
        after_s = self._within_ns / NS_PER_S
        if self._latest is None or self._still_ns is not None:
            return Fault(
                kind="stop_not_obeyed",
                motor=None,
                message=(
                    f"No reading shows whether the wheels stand {after_s:g} s after the stop: the "
                    "motors are cut. Check the cable and the board."
                ),
                action="cut",
            )
        speed, name = max(
            zip(self._latest, self._motors, strict=True), key=lambda pair: abs(pair[0])
        )
        return Fault(
            kind="stop_not_obeyed",
            motor=name,
            message=(
                f"{name} still turns at {speed:.2f} m/s {after_s:g} s after the stop: the motors "
                "are cut. Check this wheel's encoder and its plug."
            ),
            action="cut",
            measured_m_s=speed,
        )
