"""The 100 Hz interrupt of the firmware: counters, and an incremental speed loop per motor.

The loop adds to its output u, every 10 ms, with the error e = target - measured:

    du = P (e - e1) + I e + D (e - 2 e1 + e2)

While the error is zero the output does not change. So a dead encoder with target 0 keeps the wheel
running, and a reversed one drives it to full speed.
"""

from __future__ import annotations

import math

import msgspec

from yahboomd.core.model import CHANNELS, Counts
from yahboomd.simulation.motors import PWM_MAX
from yahboomd.simulation.options import PLAIN_GAIN, QUICK_GAIN
from yahboomd.simulation.plant import Plant

TICK_NS = 10_000_000
"""Period of the interrupt."""

SPEED_MAX = 1000
"""Largest speed command, in mm/s."""


class LoopSettings(msgspec.Struct, frozen=True, kw_only=True):
    """The settings as the interrupt uses them.

    Attributes:
        mm_s_per_tick: Rim speed that one count in 10 ms stands for; 0 if the settings hold a zero,
            and the board measures nothing.
        dead_zone: PWM units added to the loop's output.
        most_output: The limit of the loop's output, before the dead zone is added.
        frozen: Nothing is counted or regulated, outputs stay.
        inverted: Outputs go out with the other sign, as for motors of another type.
        counts_inverted: Counts come in with the other sign, as of motors of another type.
        zero_releases: Target 0 switches the output off instead of regulating.
    """

    mm_s_per_tick: float
    p: float
    i: float
    d: float
    dead_zone: int
    most_output: int = PWM_MAX
    frozen: bool = False
    inverted: bool = False
    counts_inverted: bool = False
    zero_releases: bool = False


class SpeedLoop:
    """The loop of one motor.

    Args:
        gain: PWM units per mm/s of error and unit of gain.
    """

    def __init__(self, gain: float = QUICK_GAIN) -> None:
        self._gain = gain
        self.target_mm_s = 0
        self._output = 0.0
        self._error = 0.0
        self._error_before = 0.0

    def reset(self) -> None:
        """Clear output and errors; the target stays."""
        self._output = self._error = self._error_before = 0.0

    def next_output(self, measured_mm_s: float, tuning: LoopSettings) -> int:
        """The output of the next 10 ms, in PWM units."""
        error = self.target_mm_s - measured_mm_s
        change = (
            tuning.p * (error - self._error)
            + tuning.i * error
            + tuning.d * (error - 2.0 * self._error + self._error_before)
        )
        self._error_before, self._error = self._error, error
        most = tuning.most_output
        self._output = min(most, max(-most, self._output + self._gain * change))
        return beyond(int(self._output), tuning.dead_zone)


def beyond(output: int, dead_zone: int) -> int:
    """The output that the board gives a motor: the dead zone is added to each that is not 0."""
    if output == 0:
        return 0
    return min(PWM_MAX, output + dead_zone) if output > 0 else max(-PWM_MAX, output - dead_zone)


def wind_up_s(
    target_mm_s: float, law: LoopSettings, output: int = PWM_MAX, gain: float = PLAIN_GAIN
) -> float:
    """Time from a step of the target until a wheel that does not turn gets an output.

    Its error stays the target v. So the loop's output is (P + I + D) v at the first interrupt and
    (P + n I) v at the n-th, from the second on:

        n = ((output - dead zone) / v - P) / I

    A target that changes gives P v + I s / T, s the commanded travel since the wheel stood, T the
    period of the interrupt.

    Args:
        output: In PWM units; above the most that the loop gives, that.
        gain: As of :class:`SpeedLoop`.
    """
    most = min(output - law.dead_zone, law.most_output)
    wanted = max(1, most) / (gain * abs(target_mm_s)) if target_mm_s else math.inf
    if law.p + law.i + law.d >= wanted:
        return TICK_NS / 1e9
    # The gains are floats of 32 bits.
    ticks = (wanted - law.p) / law.i if law.i else math.inf
    return max(2, math.ceil(ticks - 1e-3)) * TICK_NS / 1e9 if math.isfinite(ticks) else math.inf


class MotorControl:
    """Counters, modes and outputs of the four positions."""

    def __init__(
        self, plant: Plant, totals: Counts = (0, 0, 0, 0), gain: float = QUICK_GAIN
    ) -> None:
        self._plant = plant
        self.totals: Counts = totals
        self.deltas: Counts = (0, 0, 0, 0)
        # None: the encoders' timers start at the next interrupt.
        self._seen: Counts | None = plant.ticks
        self._renewed: Counts | None = plant.ticks
        self._loops = [SpeedLoop(gain) for _ in range(CHANNELS)]
        self.regulates = False

    def restart(self) -> None:
        """Reset as the MCU does: release the motors, count from zero."""
        self.release()
        self.totals = (0, 0, 0, 0)
        self.deltas = (0, 0, 0, 0)
        self._seen = self._renewed = None

    def count_from_now(self, now_ns: int) -> None:
        """Start the encoders' timers, not at the next interrupt but at once."""
        self._plant.advance(now_ns)
        self._seen = self._renewed = self._plant.ticks

    def release(self) -> None:
        """Outputs off, no regulation."""
        self.regulates = False
        self._reset_loops()
        self._plant.set_outputs((0,) * CHANNELS)

    def regulate(self, targets_mm_s: tuple[int, ...]) -> None:
        """Regulate to these rim speeds from the next interrupt on."""
        self.regulates = True
        for loop, target in zip(self._loops, targets_mm_s, strict=True):
            loop.target_mm_s = target

    def drive(self, pwm: tuple[int, ...], *, inverted: bool = False) -> None:
        """Set the outputs, open loop, at once."""
        self.regulates = False
        self._reset_loops()
        self._plant.set_outputs(tuple(-value if inverted else value for value in pwm))

    def override(self, pwm: tuple[int, ...]) -> None:
        """Set the outputs at once; loops that run set them again at the next interrupt."""
        self._plant.set_outputs(pwm)

    def tick(self, now_ns: int, tuning: LoopSettings) -> None:
        """One interrupt: read the encoders, then regulate."""
        self._plant.advance(now_ns)
        if tuning.frozen:
            return
        ticks = self._plant.ticks
        seen = ticks if self._seen is None else self._seen
        way = -1 if tuning.counts_inverted else 1
        # The encoders' timers have 16 bits.
        a, b, c, d = (way * _signed(new - old, 16) for new, old in zip(ticks, seen, strict=True))
        self._seen = ticks
        self.deltas = (a, b, c, d)
        if self.regulates:
            self._plant.set_outputs(tuple(self._outputs(tuning)))

    def renew_totals(self, now_ns: int, tuning: LoopSettings) -> None:
        """Add the encoders' latest counts to the totals."""
        self._plant.advance(now_ns)
        if tuning.frozen:
            return
        ticks = self._plant.ticks
        before = ticks if self._renewed is None else self._renewed
        self._renewed = ticks
        if ticks != before:
            way = -1 if tuning.counts_inverted else 1
            a, b, c, d = (
                _signed(total + way * _signed(new - old, 16), 32)
                for total, new, old in zip(self.totals, ticks, before, strict=True)
            )
            self.totals = (a, b, c, d)

    def speeds_mm_s(self, tuning: LoopSettings) -> tuple[float, ...]:
        """Rim speeds over the latest 10 ms, as the board believes."""
        return tuple(delta * tuning.mm_s_per_tick for delta in self.deltas)

    def _outputs(self, tuning: LoopSettings) -> list[int]:
        outputs = []
        for loop, measured in zip(self._loops, self.speeds_mm_s(tuning), strict=True):
            if tuning.zero_releases and loop.target_mm_s == 0:
                loop.reset()
                outputs.append(0)
                continue
            output = loop.next_output(measured, tuning)
            outputs.append(-output if tuning.inverted else output)
        return outputs

    def _reset_loops(self) -> None:
        for loop in self._loops:
            loop.target_mm_s = 0
            loop.reset()


def _signed(value: int, bits: int) -> int:
    """Wrap a whole number to a signed integer of this many bits."""
    half = 1 << (bits - 1)
    return (value + half) % (2 * half) - half
