"""The dialect ``rosmaster``: the expansion board of the X1, X3, R2 and others of that family.

The board reports by itself and takes velocities of the body. Its firmware's source, its vendor's
library and owners' measurements are the sources, not a board:
``docs/protocol.md`` lists them.
"""

from __future__ import annotations

import operator
from typing import Final

from yahboomd.core.errors import BoardError
from yahboomd.core.model import ImuSensor, Kinematics, Motor
from yahboomd.core.protocol.dialect import (
    Decoded,
    Dialect,
    Findings,
    Units,
    Unrecognised,
    VersionLine,
)
from yahboomd.core.protocol.profiles import MotorProfile
from yahboomd.core.protocol.rosmaster.cars import CARS, Body, Steered, body, steered
from yahboomd.core.protocol.rosmaster.functions import (
    AUTO_REPORT,
    CAR_RUN,
    ICM20948,
    IN_MEMORY,
    MOST_OUTPUT,
    MPU9250,
    OUTPUT_OFFSET,
    READ_SETTINGS,
    SUNRISE_OFFSET,
    TABLE,
    TYPE_BYTE,
    VERSION,
    decode,
    findings,
    motion,
    open_loop,
    request,
)
from yahboomd.core.protocol.rosmaster.packets import RESYNC, Item, PacketFramer, Words, frame
from yahboomd.core.protocol.settings import BoardSettings, StoredSetting

LEAST_V: Final = 9.6
MOST_V: Final = 13.0
SUNRISE, SUNRISE_V = 6, (6.5, 8.5)
"""The car with two cells, and its limits. The others raise no alarm in between."""

REPORT_NS: Final = 41_000_000
"""The cycle of its reports; each of the four kinds comes once."""


class Rosmaster(Dialect, frozen=True, kw_only=True):
    """The board of the cars."""

    name: str = "rosmaster"
    title: str = "Yahboom Rosmaster expansion board"
    plugs: str = (
        "M1 to M4 are the numbers in this board's frames. Two owners found its plugs printed the "
        "other way round: M1 is the plug M4, M2 the plug M3, M3 the plug M2, and M4 the plug M1. "
        "Follow the cable of the wheel, not the print."
    )
    baudrate: int = 115_200
    # Not 1a86:7522: that is the voice module of the same car.
    usb_ids: tuple[str, ...] = ("1a86:7523",)
    resync: bytes = RESYNC
    listen_ns: int = 100_000_000
    starts_within_s: float = 12.0
    probe: bytes | None = request(VERSION)
    # It looks for a frame once a millisecond, and keeps no two: closer ones are lost.
    spacing_ns: int = 5_000_000
    totals_spacing_ns: int = 5_000_000
    question_spacing_ns: int = 5_000_000
    answer_spacing_ns: int = 5_000_000
    # Either one ends the board's speed loops: the brake shorts the motors, the cut opens them. A
    # board that stores an unknown car type ignores the cut.
    brake: bytes = motion(0, 0, 0)
    cut: bytes | None = frame(CAR_RUN, TYPE_BYTE, 0, 0, 0)
    sample_period_ns: int | None = REPORT_NS
    renews_with_each_line: bool = True
    # It reads its encoders every 10 ms, by another clock than its reports.
    age_ns: int = 10_000_000
    arm: tuple[bytes, ...] = (frame(AUTO_REPORT, 1, IN_MEMORY),)
    battery: bytes | None = request(AUTO_REPORT)
    read_settings: tuple[bytes, ...] = READ_SETTINGS
    settings: tuple[StoredSetting, ...] = TABLE
    sensors: tuple[ImuSensor, ...] = (MPU9250, ICM20948)
    loop_ns: int = 10_000_000
    most_output: int = MOST_OUTPUT
    fastest_m_s: float = max(car.fastest_mm_s for car in CARS.values()) / 1000.0

    @property
    def surest_stop(self) -> bytes:
        """The brake: each car type obeys it, and it stops the wheels in a sixth of the time."""
        return self.brake

    def framer(self) -> PacketFramer:
        return PacketFramer()

    def decode(self, item: Item) -> Decoded:
        return decode(item)

    def recognises(self, item: Item) -> bool:
        decoded = self.decode(item)
        if isinstance(item, Words):
            return isinstance(decoded, VersionLine)
        return not isinstance(decoded, Unrecognised)

    def silence(self, volts: float | None, settings: BoardSettings) -> str:
        """The reason why it reports nothing although it answers."""
        car, restart = settings.get("car_type"), "then switch the board off and on."
        least, most = SUNRISE_V if car == SUNRISE else (LEAST_V, MOST_V)
        if volts is None or not self.brakes_until_reset(volts, settings):
            shown = "" if volts is None else f" Its supply has {volts:.1f} V now."
            return (
                "The alarm of its battery may have gone off, which only a reset ends (it beeps)."
                f"{shown} Charge or replace the battery, {restart}"
            )
        cure = "Charge or replace the battery"
        if volts > (most if car else SUNRISE_V[1]):
            cure = "Use the car's own battery" if car else "Use the car's own battery, charged"
        other = f", on a Sunrise below {SUNRISE_V[0]} V or above {SUNRISE_V[1]} V"
        if car == SUNRISE and LEAST_V <= volts <= MOST_V:
            cure = (
                "The board is set to a Sunrise, and that is the battery of another car. If it is "
                "another car, set board.profile to it and store its type with `yahboomd probe "
                "--write`, which works while the alarm is on and restarts the board (or hold its "
                "KEY1 for 10 s: a factory reset, which stores an X3). On a Sunrise use its own "
                "battery"
            )
        # Its answers keep the voltage that raised the alarm.
        return (
            f"Its supply had {volts:.1f} V at the alarm. Below {least} V or above {most:.1f} V for "
            f"2 s{'' if car else other}, it brakes, beeps, and neither counts nor reports until it "
            f"is reset, whatever the voltage becomes. {cure}, {restart}"
        )

    def brakes_until_reset(self, volts: float | None, settings: BoardSettings) -> bool:
        """Whether its battery's alarm has latched: its answers keep the voltage at the alarm."""
        if volts is None or SUNRISE_V[0] <= volts <= SUNRISE_V[1]:
            return False
        least, most = SUNRISE_V if settings.get("car_type") == SUNRISE else (LEAST_V, MOST_V)
        return not least <= volts <= most

    def findings(self, settings: BoardSettings, profile: MotorProfile) -> Findings:
        return findings(settings, profile)

    def motion(
        self,
        kinematics: Kinematics,
        motors: tuple[Motor, ...],
        settings: BoardSettings | None,
        *,
        scale: float,
    ) -> Body | Steered:
        """The velocity of the body that turns the wheels, by the law of the stored car type."""
        number = (settings or {}).get("car_type")
        car = CARS.get(number) if isinstance(number, int) else None
        if car is None:
            raise BoardError(f"The board is set to car type {number}, which is not known.")
        steers = kinematics.least_radius_m > 0.0
        if steers != (car.wheelbase_mm is not None):
            verb = "steers" if car.wheelbase_mm is not None else "does not steer"
            raise BoardError(
                f"The board is set to the car {car.name}, which {verb}, and the base is "
                f"{kinematics.name}.",
                remedy='A car that steers has chassis.preset = "ackermann". Otherwise set '
                "board.profile to the car, and store its type with `yahboomd probe --write`.",
            )
        if steers:
            return steered(car, kinematics, motors, scale=scale)
        return body(car, kinematics, motors, scale=scale)

    def speeds(self, units: Units) -> bytes:
        """Velocity of the body: mm/s, mm/s, mrad/s; of a car that steers mm/s, degrees, 0."""
        vx, vy, wz = map(operator.index, units)
        return motion(vx, vy, wz)

    def outputs(self, outputs: Units, settings: BoardSettings) -> bytes:
        """Open loop, in percent of the range above the board's own dead zone."""
        offset = SUNRISE_OFFSET if settings.get("car_type") == SUNRISE else OUTPUT_OFFSET
        return open_loop(tuple(map(operator.index, outputs)), offset)
