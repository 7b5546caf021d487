"""Everything that the board drives and senses: motors, chassis and battery, on given time."""

from __future__ import annotations

import math
from itertools import cycle
from random import Random

from yahboomd.core.model import CHANNELS, Counts
from yahboomd.simulation.chassis import ChassisTruth, shares
from yahboomd.simulation.motors import PWM_MAX, MotorLaw, MotorState
from yahboomd.simulation.options import SimulationOptions, Wiring

STEP_NS = 1_000_000
"""Longest step of the integration: far below every time constant of the motors."""

SERVO_DEG_S = 350.0
"""How fast a servo turns the front wheels: 60 degrees in 0.17 s, as such servos are sold."""

GRAVITY_M_S2 = 9.81

SAG_V = 0.15
"""The drop of the battery's voltage for one motor at full output."""


class Plant:
    """Motors by their position on the board, the chassis under them, and the battery."""

    def __init__(self, options: SimulationOptions, random: Random) -> None:
        self.wiring: tuple[Wiring, ...] = options.motors
        self.motor_type = options.motor_type
        self.motors = [
            MotorState(_law(options, wire, friction_scale, stick), phase=random.random())
            for wire, friction_scale, stick in zip(
                self.wiring, cycle(options.friction_scales), cycle(options.sticks), strict=False
            )
        ]
        self.chassis = ChassisTruth(
            shares(
                options.drive,
                self.wiring,
                wheel_separation_m=options.wheel_separation_m,
                wheel_base_m=options.wheel_base_m,
                sideways=options.sideways,
            )
        )
        self._axles_m = options.wheel_base_m if options.drive == "ackermann" else None
        self._steered_deg = self._steer_to_deg = 0.0
        self._by_position: list[MotorState | None] = [None] * CHANNELS
        for wire, motor in zip(self.wiring, self.motors, strict=True):
            self._by_position[wire.position - 1] = motor
        # The motor whose encoder each position reads, and an offset that keeps counts continuous
        # when plugs are swapped.
        self._encoders = list(self._by_position)
        self._offsets = [0] * CHANNELS
        self._rated_volts = options.rated_volts
        self.battery_volts = options.battery_volts
        self._now_ns = 0
        self._started = False

    @property
    def battery_volts(self) -> float:
        """The battery at rest. Full output turns the motors as fast as it allows."""
        return self._battery_volts

    @battery_volts.setter
    def battery_volts(self, volts: float) -> None:
        self._battery_volts = volts
        for motor in self.motors:
            motor.supply = volts / self._rated_volts

    def stand_on(self, slope: float) -> None:
        """Stand on a slope from now on: its fall for each metre ahead."""
        for motor in self.motors:
            motor.pull_m_s2 = GRAVITY_M_S2 * math.sin(math.atan(slope))

    def start(self, now_ns: int) -> None:
        """Begin at ``now_ns``."""
        self._now_ns = now_ns
        self._started = True

    def set_outputs(self, pwm: tuple[int, ...]) -> None:
        """Outputs of the four positions from now on, in PWM units."""
        for motor, value in zip(self._by_position, pwm, strict=True):
            if motor is not None:
                motor.pwm = value

    @property
    def ticks(self) -> Counts:
        """The counts of the encoders since the beginning, positions 1 to 4."""
        first, second, third, fourth = (
            offset + (motor.ticks if motor else 0)
            for motor, offset in zip(self._encoders, self._offsets, strict=True)
        )
        return first, second, third, fourth

    def steer(self, angle_deg: float) -> None:
        """Have the servo turn the front wheels of a car that steers there, + left.

        A base that has none keeps turning by its rims.
        """
        self._steer_to_deg = angle_deg
        if self.chassis.turn_per_m is None:
            self._turn_servo(math.inf)

    def _turn_servo(self, dt_s: float) -> None:
        if self._axles_m is not None:
            most = SERVO_DEG_S * dt_s
            self._steered_deg += max(-most, min(most, self._steer_to_deg - self._steered_deg))
            self.chassis.turn_per_m = math.tan(math.radians(self._steered_deg)) / self._axles_m

    def cross_encoders(self, one: int, other: int) -> None:
        """Swap the encoder plugs of two positions, 1 to 4."""
        before = self.ticks
        encoders = self._encoders
        encoders[one - 1], encoders[other - 1] = encoders[other - 1], encoders[one - 1]
        self._offsets = [
            offset + old - new
            for offset, old, new in zip(self._offsets, before, self.ticks, strict=True)
        ]

    @property
    def volts(self) -> float:
        """The battery under its present load."""
        load = sum(abs(motor.pwm) for motor in self.motors) / PWM_MAX
        return self.battery_volts - SAG_V * load

    def advance(self, now_ns: int) -> None:
        """Turn the motors and move the chassis up to ``now_ns``."""
        assert self._started, "a plant needs a start time"
        elapsed_ns = now_ns - self._now_ns
        if elapsed_ns <= 0:
            return
        self._now_ns = now_ns
        if all(motor.at_rest for motor in self.motors):
            self._turn_servo(elapsed_ns / 1e9)
            return
        steps = -(-elapsed_ns // STEP_NS)
        dt_s = elapsed_ns / steps / 1e9
        ways = [motor.advance(dt_s, steps) for motor in self.motors]
        for travels in zip(*ways, strict=True):
            if self._steered_deg != self._steer_to_deg:
                self._turn_servo(dt_s)
            self.chassis.advance(travels)


def _law(options: SimulationOptions, wire: Wiring, friction_scale: float, stick: float) -> MotorLaw:
    circumference_m = 2.0 * math.pi * options.wheel_radius_m * wire.radius_scale
    return MotorLaw(
        # Full output is a rate of turning: a larger wheel runs faster.
        max_speed_m_s=options.max_speed_m_s * wire.radius_scale,
        dead_zone=round(options.motor_dead_zone * friction_scale),
        time_constant_s=options.time_constant_s,
        ticks_per_metre=options.ticks_per_revolution / circumference_m,
        command_sign=wire.command_sign,
        encoder_sign=wire.encoder_sign,
        stick=stick,
    )
