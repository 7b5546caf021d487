"""Finds wheels that do not obey: compares commands with measurements, motor by motor.

The board closes its speed loop over the same counts. A dead or reversed encoder makes that loop run
away to full speed, and a zero command does not end it.
:mod:`~yahboomd.core.drive.motor_watch` judges one motor. This file decides which readings are
judged at all, and whether all motors are silent at once.

Nothing is raised; faults are values, one for the beginning of each trouble.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import msgspec

from yahboomd.core.counts import SELDOM, SELDOM_NS, CountHistory, slowest
from yahboomd.core.drive.motor_watch import GAP_NS, MotorWatch
from yahboomd.core.model import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from yahboomd.core.drive.faults import Fault

RESTING = 20
"""After this number of readings without a count, earlier ones no longer matter."""

# From here on the loop's output differs from that of a wheel that follows.
OWED_M = 0.005

PROVEN_NS = 40_000_000
"""The least span of a proven speed, which makes the duration of an answer matter little."""


class WheelsCheck:
    """Watches all motors.

    Args:
        min_speed_m_s: Below this command, missing counts prove nothing.
        latency_s: From sending a command to the first reading that can show it.
        metres_per_tick: Rim travel of one count, for each motor; with it, no single reading cuts a
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
        self._metres_per_tick = metres_per_tick
        self._history = CountHistory(SELDOM_NS, SELDOM)
        self._totals = (0,) * len(motors)
        self._begun_ns: int | None = None
        self._watches = [
            MotorWatch(
                name,
                min_speed_m_s,
                round(latency_s * NS_PER_S),
                partial(self._witnessed_m_s, motor) if metres_per_tick is not None else None,
            )
            for motor, name in enumerate(motors)
        ]
        self._commanded: Sequence[float] | None = None
        self._measured_ns: int | None = None
        self._stood = 0
        self._resting = False

    def command(self, now_ns: int, speeds_m_s: Sequence[float] | None) -> None:
        """Record the speeds that were sent to the board.

        Args:
            speeds_m_s: Rim speed of each motor, as limited; ``None`` if the motors were let go:
                wheels without power may turn as they like.
        """
        if speeds_m_s == self._commanded:
            return
        if self._commanded is None:
            self._begun_ns = self._history.latest_ns
        self._commanded = speeds_m_s
        self._stood = 0
        for index, watch in enumerate(self._watches):
            watch.command(now_ns, None if speeds_m_s is None else speeds_m_s[index])

    def measure(
        self,
        stamp_ns: int,
        measured_m_s: Sequence[float],
        ticks: Sequence[int],
        *,
        received_ns: int | None = None,
        earliest_ns: int | None = None,
        held_up: bool = False,
    ) -> tuple[Fault, ...]:
        """Judge a reading.

        Args:
            stamp_ns: When the board sampled it; monotonic nanoseconds. A reading that is not later
                than the last is ignored.
            measured_m_s: Rim speed of each motor, positive forward.
            ticks: The counts of each motor since the last reading, positive forward.
            received_ns: When it arrived, if that is known as well as the stamp.
            earliest_ns: The earliest moment of its sampling, if the stamp may be wrong. On a busy
                machine an answer may take a while, and a wrong guess of the moment multiplies the
                speed; so no motor is cut for more than its counts prove.
            held_up: The line was held up, so commands may not have arrived.

        Returns:
            The troubles that began with this reading.
        """
        before, self._measured_ns = self._measured_ns, stamp_ns
        if before is None or stamp_ns - before > GAP_NS:
            # The motion meanwhile is unknown.
            self._see(received_ns or stamp_ns, ticks, earliest_ns)
            self._begun_ns = self._history.latest_ns
            for watch, speed in zip(self._watches, measured_m_s, strict=True):
                watch.begin(speed)
            return ()
        if stamp_ns <= before:
            self._measured_ns = before
            return ()
        self._see(received_ns or stamp_ns, ticks, earliest_ns)
        if held_up or any(ticks) or any(measured_m_s):
            self._stood = 0
        elif self._resting and self._stood >= RESTING:
            return ()
        else:
            self._stood += 1
        proven_m_s = measured_m_s if earliest_ns is None else self._proven_m_s()
        slow_start = len(self._watches) > 1 and all(watch.slow_to_start for watch in self._watches)
        faults = [
            fault
            for watch, speed, count, proven in zip(
                self._watches, measured_m_s, ticks, proven_m_s, strict=True
            )
            for fault in watch.measure(
                before,
                stamp_ns,
                speed,
                count,
                slowest(speed, proven),
                held_up=held_up,
                slow_start=slow_start,
            )
        ]
        self._resting = all(watch.rests for watch in self._watches)
        silent = [fault for fault in faults if fault.kind == "no_counts"]
        if silent and len(self._watches) > 1 and all(watch.silent for watch in self._watches):
            for watch in self._watches:
                watch.accused()
            faults = [fault for fault in faults if fault.kind != "no_counts"]
            faults.append(msgspec.structs.replace(silent[0], motor=None, message=_ALL_SILENT))
        return tuple(faults)

    def reset(self) -> None:
        """Discard past readings: after a stop for a fault, or after the board was away."""
        self._measured_ns = None
        self._stood = 0
        self._history.clear()

    def _see(self, received_ns: int, ticks: Sequence[int], earliest_ns: int | None) -> None:
        if any(ticks):
            self._totals = tuple(map(sum, zip(self._totals, ticks, strict=True)))
        self._history.add(received_ns, self._totals, earliest_ns)

    def _proven_m_s(self) -> tuple[float, ...]:
        """The least speeds that counts prove over some 40 ms; zero without earlier counts."""
        found = self._history.since(PROVEN_NS)
        if found is None or self._metres_per_tick is None:
            return (0.0,) * len(self._watches)
        span_ns, deltas = found
        return tuple(
            [
                delta * metres * NS_PER_S / span_ns
                for delta, metres in zip(deltas, self._metres_per_tick, strict=True)
            ]
        )

    def _witnessed_m_s(self, motor: int) -> float | None:
        assert self._metres_per_tick is not None
        agreed = self._history.witnessed(motor, self._begun_ns)
        return None if agreed is None else agreed * self._metres_per_tick[motor]

    @property
    def owing(self) -> bool:
        """Whether a motor has not counted for its latest commands.

        The board's loop has added them up, and a commanded zero would keep its output.
        """
        return any(watch.owed_m >= OWED_M for watch in self._watches)


_ALL_SILENT = (
    "All motors are commanded to turn and no encoder shows motion: check the motor supply and its "
    "switch, then that the motors sit at the configured positions."
)
