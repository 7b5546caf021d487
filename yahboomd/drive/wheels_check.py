"""Wheels that lie: command against measurement, motor by motor.

The board closes its speed loop over the same counts that we read. A dead or reversed encoder makes
that loop run away to full speed, and a zero command does not end it, so somebody has to notice.
What one motor shows is judged by :mod:`~yahboomd.drive.motor_watch`; here is what concerns all of
them: which readings are judged at all, and whether all are silent at once.

Nothing is raised; faults are values, one for each beginning of each trouble.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from yahboomd.drive.motor_watch import GAP_NS, NS_PER_S, MotorWatch
from yahboomd.drive.witnesses import Witnesses

if TYPE_CHECKING:
    from collections.abc import Sequence

    from yahboomd.drive.faults import Fault

# From here on the loop's output no longer is the one of a wheel that follows.
OWED_M = 0.005


class WheelsCheck:
    """Watches all motors.

    Args:
        motors: Their names.
        min_speed_m_s: Below this command, missing counts prove nothing.
        latency_s: From a command's way into the link to the first reading that can show it.
        metres_per_tick: Rim travel of one count, for each motor: with it, no single reading cuts a
            motor.
    """

    def __init__(
        self,
        motors: Sequence[str],
        *,
        min_speed_m_s: float = 0.08,
        latency_s: float = 0.06,
        metres_per_tick: Sequence[float] | None = None,
    ) -> None:
        witnesses: list[Witnesses | None] = [None] * len(motors)
        if metres_per_tick is not None:
            witnesses = [Witnesses(each) for each in metres_per_tick]
        self._watches = [
            MotorWatch(name, min_speed_m_s, round(latency_s * NS_PER_S), each)
            for name, each in zip(motors, witnesses, strict=True)
        ]
        self._measured_ns: int | None = None

    def command(self, now_ns: int, speeds_m_s: Sequence[float] | None) -> None:
        """Record what was sent to the board.

        Args:
            now_ns: When; monotonic nanoseconds.
            speeds_m_s: Rim speed of each motor, as limited; ``None`` where the motors were let go:
                wheels without power may turn as they like.
        """
        for index, watch in enumerate(self._watches):
            watch.command(now_ns, None if speeds_m_s is None else speeds_m_s[index])

    def measure(
        self,
        stamp_ns: int,
        measured_m_s: Sequence[float],
        ticks: Sequence[int],
        *,
        proven_m_s: Sequence[float] | None = None,
        received_ns: int | None = None,
        held_up: bool = False,
    ) -> tuple[Fault, ...]:
        """Judge a reading.

        Args:
            stamp_ns: When the board sampled it; monotonic nanoseconds. One that is not later than
                the last is no news.
            measured_m_s: Rim speed of each motor, positive forward.
            ticks: What each motor counted since the last reading, positive forward.
            proven_m_s: The least that the speeds can be (:mod:`~yahboomd.drive.proven_speed`), for
                a board whose readings may be stamped too early or too late; none is cut for more.
            received_ns: When it arrived, where that is known besides the stamp.
            held_up: The line was held up, so that commands may not have been there yet.

        Returns:
            The troubles that began with it.
        """
        before, self._measured_ns = self._measured_ns, stamp_ns
        if before is None or stamp_ns - before > GAP_NS:
            # It is unknown what the wheels did meanwhile.
            for watch, speed in zip(self._watches, measured_m_s, strict=True):
                watch.begin(speed)
            return ()
        if stamp_ns <= before:
            self._measured_ns = before
            return ()
        for watch, count in zip(self._watches, ticks, strict=True):
            watch.hear(received_ns or stamp_ns, count)
        faults = [
            fault
            for watch, speed, count, proven in zip(
                self._watches, measured_m_s, ticks, proven_m_s or measured_m_s, strict=True
            )
            for fault in watch.measure(
                before, stamp_ns, speed, count, _nearer(speed, proven), held_up=held_up
            )
        ]
        silent = [fault for fault in faults if fault.kind == "no_counts"]
        if len(silent) == len(self._watches) > 1:
            faults = [fault for fault in faults if fault.kind != "no_counts"]
            faults.append(msgspec.structs.replace(silent[0], motor=None, message=_ALL_SILENT))
        return tuple(faults)

    def reset(self) -> None:
        """Forget what was seen: after a stop for a fault, after the board was away."""
        self._measured_ns = None

    @property
    def owing(self) -> bool:
        """Whether a motor shows no counts for its commands so far.

        The board's loop has added them up, and a commanded zero would leave its output where it is.
        """
        return any(watch.owed_m >= OWED_M for watch in self._watches)


def _nearer(speed: float, proven: float) -> float:
    """Of two opinions about a speed the one nearer to standing; that, where they contradict."""
    if speed * proven <= 0.0:
        return 0.0
    return speed if abs(speed) < abs(proven) else proven


_ALL_SILENT = (
    "All motors are commanded to turn and no encoder shows motion: check the motor supply and its "
    "switch, then that the motors sit at the configured positions."
)
