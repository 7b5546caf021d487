"""Finds wheels that do not follow their setpoints: compares setpoints with counts.

The board closes its speed loop over the same counts. A dead or reversed encoder makes that loop run
away to full speed, and a zero command does not end it.
:mod:`~yahboomd.core.drive.wheel_follower` judges one wheel. This file decides which readings are
judged at all, what several wheels show together, and whether a wheel or the line is to blame.

Nothing is raised; faults are values, one for the beginning of each trouble.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import msgspec

from yahboomd.core.counts import SELDOM, SELDOM_NS, CountHistory, slowest
from yahboomd.core.drive.faults import Fault
from yahboomd.core.drive.loop_law import LoopLaw, loop_law
from yahboomd.core.drive.wheel_follower import GAP_NS, SILENCE, Step, WheelFollower
from yahboomd.core.model import NS_PER_S
from yahboomd.core.standstill import STANDING_M_S

RESTING = 20
"""After this number of readings without a count, earlier ones no longer matter."""

# From here on the loop's output differs from that of a wheel that follows.
OWED_M = 0.005

PROVEN_NS = 40_000_000
"""The least span of a proven speed, which makes the duration of an answer matter little."""

AGAIN, NO_COUNTS_AGAIN, ALL_SILENT_AGAIN = 5, 8, 16
"""The repetitions in a row that a bad line cannot have caused. Losing one speed in two or three
silences a start, and silences all wheels at once."""

FORGOTTEN_NS = 5_000_000_000
"""Two troubles with this time between them are not in a row."""

FOLLOWED_NS = 1_000_000_000
"""Wheels that are driven for this time without trouble follow their setpoints. A broken wheel shows
its fault within half of it."""


class FollowCheck:
    """Watches all wheels.

    Args:
        metres_per_tick: Rim travel of one count, for each motor.
        min_speed_m_s: Below this setpoint, missing counts of a wheel that rolled prove nothing.
        latency_s: From sending a setpoint to the first reading that can show it.

    Attributes:
        law: How the board's speed loop winds up.
        volts: The supply, if it is known.
    """

    def __init__(
        self,
        motors: Sequence[str],
        metres_per_tick: Sequence[float],
        *,
        min_speed_m_s: float = 0.08,
        latency_s: float = 0.06,
    ) -> None:
        self.law: LoopLaw = loop_law({})
        self.volts: float | None = None
        self._min_speed_m_s = min_speed_m_s
        self._metres_per_tick = metres_per_tick
        self._history = CountHistory(SELDOM_NS, SELDOM)
        self._totals = (0,) * len(motors)
        self._begun_ns: int | None = None
        latency_ns = round(latency_s * NS_PER_S)
        self._wheels = [
            WheelFollower(name, min_speed_m_s, latency_ns, metre, partial(self._witnessed, motor))
            for motor, (name, metre) in enumerate(zip(motors, metres_per_tick, strict=True))
        ]
        self._commanded: Sequence[float] | None = None
        self._measured_ns: int | None = None
        self._stood = 0
        self._troubles = self._followed_ns = 0
        self._latest_ns = -FORGOTTEN_NS
        self._blamed = False

    def command(self, now_ns: int, speeds_m_s: Sequence[float] | None) -> None:
        """Record the setpoints that were sent to the board.

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
        for index, wheel in enumerate(self._wheels):
            wheel.command(now_ns, None if speeds_m_s is None else speeds_m_s[index])

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
            held_up: The line was held up, so setpoints may not have arrived.

        Returns:
            The troubles that began with this reading.
        """
        before = self._measured_ns
        if before is not None and stamp_ns <= before:
            return ()
        self._measured_ns = stamp_ns
        if any(ticks):
            self._totals = tuple(map(sum, zip(self._totals, ticks, strict=True)))
        self._history.add(received_ns or stamp_ns, self._totals, earliest_ns)
        if before is None or stamp_ns - before > GAP_NS:
            # The motion meanwhile is unknown.
            self._begun_ns = self._history.latest_ns
            for wheel, speed in zip(self._wheels, measured_m_s, strict=True):
                wheel.begin(speed)
            return ()
        self._stood = 0 if held_up or any(ticks) or any(measured_m_s) else self._stood + 1
        if self._stood > RESTING and all(wheel.rests for wheel in self._wheels):
            return ()
        fastest_m_s = max(map(abs, self._commanded or (0.0,)))
        self._followed_ns += stamp_ns - before if fastest_m_s >= self._min_speed_m_s else 0
        proven_m_s = measured_m_s if earliest_ns is None else self._proven_m_s()
        starts = [wheel.starts_at or 0.0 for wheel in self._wheels if wheel.started]
        step = Step(
            before_ns=before,
            now_ns=stamp_ns,
            law=self.law,
            farthest_m=max(map(abs, measured_m_s)) * (stamp_ns - before) / NS_PER_S,
            starts_at=min(starts, default=0.0),
        )
        faults = list[Fault]()
        shown = zip(self._wheels, measured_m_s, ticks, proven_m_s, strict=True)
        for wheel, speed, count, proven in shown:
            faults += wheel.measure(step, speed, count, slowest(speed, proven), held_up=held_up)
        return self._together(faults)

    def _together(self, faults: list[Fault]) -> tuple[Fault, ...]:
        """What several wheels show together, and what this board's owner can do."""
        wheels = self._wheels
        silent = [fault for fault in faults if fault.kind in SILENCE]
        everyone = len(wheels) > 1 and all(wheel.silent for wheel in wheels)
        if silent and (everyone or (len(silent) > 1 and silent[0].kind == "not_started")):
            fault, words = silent[0], _ALL_SILENT
            for wheel in wheels if everyone else ():
                wheel.give_up()
            if fault.kind == "not_started":
                names = "The wheels" if everyone else " and ".join(str(f.motor) for f in silent)
                words = _SEVERAL_STAND.format(names, abs(fault.commanded_m_s))
            faults = [fault for fault in faults if fault not in silent]
            faults.append(msgspec.structs.replace(fault, motor=None, message=words))
        return tuple([self._advised(fault) for fault in faults])

    def _advised(self, fault: Fault) -> Fault:
        words = fault.message
        shown = "" if self.volts is None else f" ({self.volts:.1f} V)"
        if fault.kind == "no_counts" and fault.certain:
            words += f" A low battery{shown} on a floor with much static friction looks the same."
        elif fault.kind == "not_started":
            tune = ", or store its dead zone with `yahboomd tune`" if self.law.dead_zone else ""
            words += f", or charge the battery{shown}{tune}. The next command drives again."
        elif fault.kind == "runaway_against":
            way = math.copysign(1.0, fault.commanded_m_s)
            others = [
                (way * wheel.measured_m_s, wheel.name)
                for wheel in self._wheels
                if way * (wheel.commanded_m_s or 0.0) < 0.0
            ]
            speed_m_s, other = max(others, default=(0.0, ""))
            if speed_m_s >= STANDING_M_S:
                words = _CROSSED.format(fault.motor, other)
        return msgspec.structs.replace(fault, message=words)

    def reset(self) -> None:
        """Discard past readings: after a stop for a fault, or after the board was away."""
        self._measured_ns = None
        self._stood = 0
        self._history.clear()

    def _proven_m_s(self) -> tuple[float, ...]:
        """The least speeds that counts prove over some 40 ms; zero without earlier counts."""
        span_ns, deltas = self._history.since(PROVEN_NS) or (1, (0,) * len(self._wheels))
        paired = zip(deltas, self._metres_per_tick, strict=True)
        return tuple([delta * metre * NS_PER_S / span_ns for delta, metre in paired])

    def _witnessed(self, motor: int) -> float | None:
        agreed = self._history.witnessed(motor, self._begun_ns)
        return None if agreed is None else agreed * self._metres_per_tick[motor]

    @property
    def owing(self) -> bool:
        """Whether a motor has not counted for its latest setpoints.

        The board's loop has added them up, and a commanded zero would keep its output.
        """
        return any(wheel.owed_m >= OWED_M for wheel in self._wheels)

    def blame(self, now_ns: int, fault: Fault, *, damages: int) -> bool:
        """Decide whether a wheel or the line to the board is to blame for a trouble.

        Lines have no checksum. If bytes are lost, a speed arrives with a digit less or not at all,
        and a healthy wheel obeys the damaged speed. A wheel is blamed only if the line is clean, or
        if the same trouble repeats whenever the wheel is driven, which chance does not do. Each
        recent damage excuses one trouble, because a line that just became bad has shown few.
        Troubles of several wheels at the same moment count as one.

        Args:
            damages: How often the line recently damaged bytes.

        Returns:
            Whether the wheel is to blame, not the line.
        """
        if now_ns != self._latest_ns:
            over = self._followed_ns >= FOLLOWED_NS or now_ns - self._latest_ns >= FORGOTTEN_NS
            self._troubles = 1 if over or self._blamed else self._troubles + 1
            self._latest_ns, self._followed_ns, self._blamed = now_ns, 0, False
        most = AGAIN
        if fault.kind == "no_counts":
            most = ALL_SILENT_AGAIN if fault.motor is None else NO_COUNTS_AGAIN
        blamed = fault.certain or self._troubles >= min(damages + 1, most)
        self._blamed = self._blamed or blamed
        return blamed


_SEVERAL_STAND = "{} do not begin to turn at {:.2f} m/s: drive faster"
_ALL_SILENT = (
    "All motors are commanded to turn and no encoder shows motion: check the motor supply and its "
    "switch, then that the motors sit at the configured positions."
)
_CROSSED = (
    "The encoders of {0} and {1} seem to be crossed: each wheel turns as the other is commanded. "
    "Exchange these two encoder plugs, or check command_sign and encoder_sign of both positions."
)
