"""The options of a simulated robot, in plain values."""

from __future__ import annotations

from typing import Literal, TypeAlias, assert_never

import msgspec

from yahboomd.core.errors import ConfigError
from yahboomd.core.model import CHANNELS, Counts
from yahboomd.simulation.motors import PWM_MAX

DriveName: TypeAlias = Literal["differential", "skid_steer", "mecanum", "ackermann"]
Corner: TypeAlias = Literal["left", "right", "front_left", "rear_left", "front_right", "rear_right"]
StreamPace: TypeAlias = Literal["measured", "wire"]

DIALECT = "streamed"
"""The default board: most robots have it."""

QUICK_GAIN = 4.0
"""PWM units per mm/s of error and unit of gain: the default gains settle within 0.1 to 0.3 s."""

PLAIN_GAIN = 1.0
"""The law as it stands: from 0.5 m/s the default gains need more than 0.6 s to a standstill, as the
vendor's firmware does."""

SMOOTH: dict[str, tuple[float, ...]] = {"friction_scales": (1.0,), "sticks": (1.0,)}
"""Options of motors that are equal and do not stick."""


class Wiring(msgspec.Struct, frozen=True, kw_only=True):
    """One motor: its place and its connection.

    A motor that is mounted the other way round has both signs at -1. Signs that differ make the
    board's own speed loop run away, as a wrongly wired motor does.

    Attributes:
        name: Its name in the ground truth and the console.
        position: Its plug on the board, 1 to 4.
        corner: Where its wheel is.
        command_sign: -1 if a positive output turns the wheel backward.
        encoder_sign: -1 if the counts fall while the wheel rolls forward.
        radius_scale: The true radius of its wheel as a multiple of the nominal one.
    """

    name: str
    position: int
    corner: Corner
    command_sign: int = 1
    encoder_sign: int = 1
    radius_scale: float = 1.0


TWO_WHEELS: tuple[Wiring, ...] = (
    Wiring(name="left", position=1, corner="left"),
    Wiring(name="right", position=3, corner="right"),
)
"""The article's robot: motor A left, motor C right, B and D free."""

FOUR_WHEELS: tuple[Wiring, ...] = (
    Wiring(name="front_left", position=1, corner="front_left"),
    Wiring(name="rear_left", position=2, corner="rear_left"),
    Wiring(name="front_right", position=3, corner="front_right"),
    Wiring(name="rear_right", position=4, corner="rear_right"),
)
"""The vendor's robots with four wheels: M1 to M4."""

REAR_WHEELS: tuple[Wiring, ...] = (
    Wiring(name="left", position=2, corner="left"),
    Wiring(name="right", position=4, corner="right"),
)
"""The vendor's car that steers: M2 and M4."""

WIRINGS: dict[DriveName, tuple[Wiring, ...]] = {
    "differential": TWO_WHEELS,
    "skid_steer": FOUR_WHEELS,
    "mecanum": FOUR_WHEELS,
    "ackermann": REAR_WHEELS,
}


def at_plug(wire: Wiring, plug: int) -> Wiring:
    """The same motor in another plug; negative: mounted the other way round too."""
    sign = 1 if plug > 0 else -1
    return msgspec.structs.replace(wire, position=abs(plug), command_sign=sign, encoder_sign=sign)


class ImpairmentOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Faults of the line at the start; all of them can be changed at run time.

    Attributes:
        loss: Share of bytes that vanish, 0 to 1, each way.
        corruption: Share of bytes that arrive with one bit flipped, 0 to 1, each way.
        delay_s: The delay of every chunk besides the wire, each way.
        jitter_s: The largest extra delay, at random; the order is kept.
        chunk_s: Bytes for the host arrive in chunks of this period, as USB brings them; 0 brings
            every byte alone.
        flush_when_idle: Deliver the bytes as soon as the line falls silent, rather than at the
            next chunk.
    """

    loss: float = 0.0
    corruption: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    chunk_s: float = 0.001
    flush_when_idle: bool = True


class SimulationOptions(msgspec.Struct, frozen=True, kw_only=True):
    """A robot, its board and its line.

    Attributes:
        dialect: Which board it is: a row of :data:`yahboomd.simulation.boards.BOARDS`.
        wiring: The motors; None takes the usual ones of the drive.
        motor_type: The true type of the motors (1: 520), independent of the board's setting.
        lines: Encoder lines per turn of the motor.
        ratio: The true gear ratio, which need not be whole.
        wheel_radius_m: The true radius of the wheels.
        wheel_separation_m: The true (effective) track.
        wheel_base_m: Distance between the axles, for mecanum and ackermann.
        sideways: The true way to the side for each metre that the wheels roll, for mecanum.
            Negative: its rollers are mounted mirrored.
        max_speed_m_s: Rim speed at full output.
        motor_dead_zone: Friction of motors that turn: the output that it takes at the rated
            supply, in PWM units. Below it they do not turn.
        friction_scales: The friction of each motor as a multiple of that, in the order of the
            motors, and again from the first.
        sticks: Static friction as a multiple of the moving one, for each motor likewise. A motor
            at rest begins to turn above ``motor_dead_zone * friction_scale * stick``; 1: none.
        time_constant_s: Lag of a driven motor.
        battery_volts: The battery at rest.
        rated_volts: The supply at which full output gives ``max_speed_m_s``.
        loop_gain: PWM units per mm/s of error and unit of gain, of the firmware's speed loop.
        flash: The board's stored settings, in its own terms; None: the factory settings.
        firmware: The version that it reports; empty for the one that is modelled.
        start_up_s: The silence after a reset, of a board that sets up an inertial sensor then.
        initial_ticks: The counters at the start, as of a board that has run for a while.
        baud: Speed of the line, 8N1.
        stream_pace: ``measured`` sends stream lines at the rates seen on boards, ``wire`` one
            right after the other.
        tick_period_s: How often a board that sends them by itself renews its totals; 0 renews them
            with every line.
        tick_jitter_s: The most by which each of these periods is longer, at random.
        seed: Of every random thing.
        impairments: The initial faults of the line.
    """

    dialect: str = DIALECT
    drive: DriveName = "differential"
    wiring: tuple[Wiring, ...] | None = None
    motor_type: int = 1
    lines: int = 11
    ratio: float = 30.0
    wheel_radius_m: float = 0.0335
    wheel_separation_m: float = 0.15
    wheel_base_m: float = 0.15
    sideways: float = 1.0
    max_speed_m_s: float = 1.15
    motor_dead_zone: int = 1950
    friction_scales: tuple[float, ...] = (1.0, 1.03, 0.98, 1.02)
    sticks: tuple[float, ...] = (1.1,)
    time_constant_s: float = 0.06
    battery_volts: float = 7.4
    rated_volts: float = 7.4
    loop_gain: float = QUICK_GAIN
    flash: msgspec.Struct | None = None
    firmware: str = ""
    start_up_s: float = 10.5
    initial_ticks: Counts = (0, 0, 0, 0)
    baud: int = 115200
    stream_pace: StreamPace = "measured"
    tick_period_s: float = 0.01
    tick_jitter_s: float = 0.0
    seed: int = 0
    impairments: ImpairmentOptions = ImpairmentOptions()

    @property
    def motors(self) -> tuple[Wiring, ...]:
        """The motors; the usual ones of the drive unless they are given."""
        return WIRINGS[self.drive] if self.wiring is None else self.wiring

    @property
    def ticks_per_revolution(self) -> float:
        """Counts of one turn of a wheel: lines x ratio x 4 edges."""
        return self.lines * self.ratio * 4.0


MOST = 1e9
"""The greatest length, period or ratio."""

_POSITIVE = (
    *("lines", "ratio", "wheel_radius_m", "wheel_separation_m", "wheel_base_m"),
    *("max_speed_m_s", "time_constant_s", "rated_volts", "loop_gain", "baud"),
)


def check(options: SimulationOptions) -> None:
    """Refuse impossible options.

    Raises:
        ConfigError: Naming everything that is impossible.
    """
    mistakes = [
        f"{name} must be positive, up to {MOST:g}, not {value}"
        for name in _POSITIVE
        if not 0.0 < (value := getattr(options, name)) <= MOST
    ]
    mistakes += _wiring_mistakes(options)
    if not 0.0 < abs(options.sideways) <= MOST:
        mistakes.append(f"sideways must not be {options.sideways}")
    for name, values, least in (
        ("friction_scales", options.friction_scales, 0.0),
        ("sticks", options.sticks, 1.0),
    ):
        if not values or not all(least <= each <= MOST for each in values):
            mistakes.append(f"{name} has numbers from {least:g}, not {values}")
    if not all(0.0 <= options.motor_dead_zone * each < PWM_MAX for each in options.friction_scales):
        mistakes.append(f"the friction of a motor is below its full output of {PWM_MAX}")
    line = options.impairments
    for name, share in (("loss", line.loss), ("corruption", line.corruption)):
        if not 0.0 <= share <= 1.0:
            mistakes.append(f"{name} is a share from 0 to 1, not {share}")
    for of, names in (
        (line, ("delay_s", "jitter_s", "chunk_s")),
        (options, ("tick_period_s", "tick_jitter_s", "start_up_s")),
    ):
        mistakes += [
            f"{name} cannot be {seconds}"
            for name in names
            if not 0.0 <= (seconds := getattr(of, name)) <= MOST
        ]
    if mistakes:
        raise ConfigError(f"This robot cannot be simulated: {'; '.join(mistakes)}.")


def _wiring_mistakes(options: SimulationOptions) -> list[str]:
    mistakes = []
    positions = [wire.position for wire in options.motors]
    if any(not 1 <= position <= CHANNELS for position in positions):
        mistakes.append(f"positions go from 1 to {CHANNELS}")
    if len(set(positions)) != len(positions):
        mistakes.append("two motors share a position")
    if any({wire.command_sign, wire.encoder_sign} - {1, -1} for wire in options.motors):
        mistakes.append("signs are 1 or -1")
    corners = {wire.corner for wire in options.motors}
    match options.drive:
        case "mecanum":
            if corners != {wire.corner for wire in FOUR_WHEELS}:
                mistakes.append("mecanum needs a motor at each corner")
        case "differential" | "skid_steer" | "ackermann":
            if not all(any(side in corner for corner in corners) for side in ("left", "right")):
                mistakes.append("a motor is needed on each side")
        case _:
            assert_never(options.drive)
    return mistakes
