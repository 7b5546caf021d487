"""The polled board: the article's protocol, and nothing beyond it.

Frames are carried out one after another, unknown ones are ignored. What the article leaves open is
modelled in the simplest way: motors stand until a profile has been sent, a speed of 0 releases a
motor (there is no other way to stop one), and a reset prints nothing.
"""

from __future__ import annotations

import math
from collections import deque
from random import Random

from yahboomd.core.model import CHANNELS, Counts
from yahboomd.simulation.board import BOOT_NS, NEVER, Emit
from yahboomd.simulation.four_channel.flash import whole
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.speed_loop import SPEED_MAX, TICK_NS, LoopSettings, MotorControl
from yahboomd.simulation.wire import transfer_ns

CARRY_OUT_NS = 200_000
"""The time from the last byte of a frame to its effect."""

LONGEST_FRAME = 64
QUEUE = 16
"""Frames that wait; further ones are lost."""

PROFILES: dict[int, float] = {
    1: 100.0 * math.pi * 67.0 / 1320.0,
    2: 100.0 * math.pi * 48.0 / 1040.0,
    3: 100.0 * math.pi * 68.0 / 2340.0,
    4: 0.0,
}
"""Rim speed in mm/s that one count in 10 ms stands for, by motor type."""


class PolledBoard:
    """The polled dialect's board."""

    def __init__(
        self,
        options: SimulationOptions,
        plant: Plant,
        emit: Emit,
        random: Random,  # noqa: ARG002 (what every board is made of)
    ) -> None:
        self.emit = emit
        self._plant = plant
        self._control = MotorControl(plant, options.initial_ticks, options.loop_gain)
        self._baud = options.baud
        self._motor_type = 0
        self._tuning = _tuning(0, plant.motor_type)
        self._collected: bytearray | None = None
        self._frames: deque[bytes] = deque()
        self._tick_ns = NEVER
        self._main_ns = NEVER
        self._listens_ns = 0

    @property
    def next_ns(self) -> int:
        """The time of the next thing that happens inside."""
        return min(self._tick_ns, self._main_ns)

    @property
    def speaks_ns(self) -> int:
        """The time at which the next frame is carried out."""
        return self._main_ns

    @property
    def totals(self) -> Counts:
        """The counters, as the latest interrupt left them."""
        return self._control.totals

    def start(self, now_ns: int) -> None:
        """Start as a board that was powered long ago."""
        self._tick_ns = now_ns + TICK_NS
        self._listens_ns = now_ns

    def reset(self, now_ns: int, *, off_ns: int = 0, by_power: bool) -> None:  # noqa: ARG002
        """Lose everything and start again after ``off_ns``, without a banner."""
        self._plant.advance(now_ns)
        self._control.restart()
        self._collected = None
        self._frames.clear()
        self._motor_type = 0
        self._main_ns = NEVER
        self._listens_ns = self._tick_ns = now_ns + off_ns + BOOT_NS

    def set_tick_period(self, now_ns: int, period_ns: int, jitter_ns: int = 0) -> None:  # noqa: ARG002
        """Do nothing: this board has no tick.

        Raises:
            ValueError: Always.
        """
        raise ValueError("a polled board counts when it is asked")

    def hang(self) -> None:
        """Stop executing, with the outputs as they are."""
        self._tick_ns = self._main_ns = self._listens_ns = NEVER

    def receive(self, byte: int, now_ns: int) -> None:
        """One byte has arrived; it is lost while the board starts."""
        if now_ns < self._listens_ns:
            return
        if byte == ord("$"):
            self._collected = bytearray()
        elif self._collected is None:
            return
        elif byte == ord("#"):
            if len(self._frames) < QUEUE:
                self._frames.append(bytes(self._collected))
            self._collected = None
            if self._main_ns == NEVER:
                self._main_ns = now_ns + CARRY_OUT_NS
        else:
            self._collected.append(byte)
            if len(self._collected) > LONGEST_FRAME:
                self._collected = None

    def run_due(self, now_ns: int) -> None:
        """Do everything that is due up to ``now_ns``."""
        while True:
            if self._tick_ns <= self._main_ns:
                if (at_ns := self._tick_ns) > now_ns:
                    return
                self._tick_ns += TICK_NS
                self._control.tick(at_ns, self._tuning)
                self._control.renew_totals(at_ns, self._tuning)
            else:
                if (at_ns := self._main_ns) > now_ns:
                    return
                self._main(at_ns)

    def _main(self, now_ns: int) -> None:
        free_ns = now_ns
        if self._frames:
            name, _, args = self._frames.popleft().partition(b":")
            match name:
                case b"mtype":
                    self._set_type(whole(args))
                case b"speed":
                    self._set_speeds(args.split(b","))
                case b"read":
                    data = b"$data:%d,%d,%d,%d#" % self._control.totals
                    self.emit(data, now_ns)
                    free_ns += transfer_ns(len(data), self._baud)
        if self._frames:
            self._main_ns = free_ns + CARRY_OUT_NS
        else:
            self._main_ns = free_ns if free_ns > now_ns else NEVER

    def _set_type(self, motor_type: int) -> None:
        if motor_type in PROFILES:
            self._motor_type = motor_type
            self._tuning = _tuning(motor_type, self._plant.motor_type)

    def _set_speeds(self, parts: list[bytes]) -> None:
        if self._motor_type == 0 or len(parts) != CHANNELS:
            return
        self._control.regulate(
            tuple(max(-SPEED_MAX, min(SPEED_MAX, whole(part))) for part in parts)
        )


def _tuning(motor_type: int, true_type: int) -> LoopSettings:
    return LoopSettings(
        mm_s_per_tick=PROFILES.get(motor_type, 0.0),
        p=0.8,
        i=0.06,
        d=0.5,
        dead_zone=1600,
        frozen=motor_type == 4,
        inverted=motor_type in (2, 3) and motor_type != true_type,
        zero_releases=True,
    )
