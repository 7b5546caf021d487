"""The functions of the board's frames, the meaning of its answers, and its stored settings."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from typing import Final

from yahboomd.core.model import ImuSensor
from yahboomd.core.protocol.dialect import (
    Battery,
    Decoded,
    Findings,
    Inertial,
    Setting,
    Totals,
    Unrecognised,
    Unused,
    VersionLine,
)
from yahboomd.core.protocol.profiles import PROFILES, MotorProfile
from yahboomd.core.protocol.rosmaster.cars import CARS, M1, M1_FIRMWARE, NO_LAW, car_name
from yahboomd.core.protocol.rosmaster.packets import Item, Words, frame
from yahboomd.core.protocol.settings import (
    BoardSettings,
    SettingValue,
    StoredSetting,
    useless_gains,
)

# To the board.

AUTO_REPORT: Final = 0x01
OPEN_LOOP: Final = 0x10
CAR_RUN: Final = 0x11
MOTION: Final = 0x12
MOTOR_PID: Final = 0x13
CAR_TYPE: Final = 0x15
REQUEST: Final = 0x50
VERSION: Final = 0x51

# From the board.

SPEED: Final = 0x0A
RAW_MPU9250: Final = 0x0B
ATTITUDE: Final = 0x0C
ENCODERS: Final = 0x0D
RAW_ICM20948: Final = 0x0E

TYPE_BYTE: Final = 1
"""The board reads only its highest bit, which holds the heading: never set it."""

MOST_OUTPUT: Final = 3600
OUTPUT_OFFSET, SUNRISE_OFFSET = 1600, 2000
"""The offset that the firmware adds to every share of a motor's output, in PWM units."""

IN_FLASH: Final = 0x5F
IN_MEMORY: Final = 0x00

_STORE_S: Final = 0.25
"""A page of the flash is erased and written in 60 to 110 ms, by the figures of its data sheet."""

_RATE_MPU: Final = 500.0 / 32768.0 * 3.141592653589793 / 180.0
_FORCE_MPU: Final = 1.0 / 1671.84
_FIELD_MPU: Final = 0.15e-6

MPU9250: Final = ImuSensor(
    name="mpu9250",
    gyro_limit_rad_s=32767.0 * _RATE_MPU,
    # 0.01 degrees/s per square root of Hz, behind a filter of 20 Hz.
    gyro_noise_rad_s=0.8e-3,
    # Uniform within 3 %, by its data sheet.
    gyro_scale=0.017,
    acceleration_limit_m_s2=32767.0 * _FORCE_MPU,
    acceleration_noise_m_s2=0.013,
    # The filter, and half of the 20 ms between two samples.
    delay_ns=18_000_000,
)
ICM20948: Final = ImuSensor(
    name="icm20948",
    # Owners' captures have z at -9.87 at rest. The gyro's sign is open: the firmware sets one
    # matrix for both, the vendor's driver of the M1 negates y and z of both, the A1's not the
    # gyro's.
    axes="x -y -z",
    # In mrad/s and mm/s^2 of 16 bits: beyond them a number wraps.
    gyro_limit_rad_s=32.767,
    # An owner's X3 at rest for 40 s: 5.1 to 5.4 mrad/s, three times the data sheet's, and below
    # 0.102 to 0.135 m/s^2. Which sensor it has was not said; its z is negative.
    gyro_noise_rad_s=5.3e-3,
    # Uniform within 1.5 %.
    gyro_scale=0.009,
    acceleration_limit_m_s2=32.767,
    acceleration_noise_m_s2=0.12,
    delay_ns=10_000_000,
)


def request(function: int, parameter: int = 0) -> bytes:
    """Ask for the report of a function. Only the latest question is answered, in milliseconds."""
    return frame(REQUEST, function, parameter)


def motion(vx: int, vy: int, wz: int) -> bytes:
    """Move: mm/s, mm/s, mrad/s, each of 16 bits; for a car that steers vy is its angle, degrees."""
    numbers = (max(-0x7FFF, min(0x7FFF, each)) for each in (vx, vy, wz))
    return frame(MOTION, TYPE_BYTE, *struct.pack("<3h", *numbers))


def open_loop(outputs: tuple[int, ...], offset: int) -> bytes:
    """Drive the four motors without regulation from now on; outputs in PWM units.

    The board takes a share of 100, and adds it to a dead zone that cannot be omitted: an
    output up to it, which is ``offset``, turns nothing. A zero releases the motor.
    """
    shares = (
        max(0, min(100, 100 * (abs(each) - offset) // (MOST_OUTPUT - offset)))
        * (1 if each > 0 else -1)
        for each in outputs
    )
    return frame(OPEN_LOOP, *(share & 0xFF for share in shares))


# From the board: meanings.


def decode(item: Item) -> Decoded:
    """Interpret an item; never raises. A frame of another length than its function's has none."""
    if isinstance(item, Words):
        return _words(item.text)
    form, meaning = _MEANINGS.get(item.function, (None, None))
    if form is not None and meaning is not None and form.size == len(item.payload):
        return meaning(*form.unpack(item.payload))
    return Unrecognised(text=f"{item.function:02x} {item.payload.hex(' ')}".rstrip())


_BANNER = re.compile(r"Firmware Version: ?V([0-9]{1,3}(?:\.[0-9]{1,3}){1,2})\s*$")
_WORDS = re.compile(r"[ -~]{4,}")


def _words(text: str) -> Decoded:
    if banner := _BANNER.search(text):
        return VersionLine(version=banner[1], after_reset=True)
    # Its lines about sensors, flash and tasks differ with its firmware.
    return Unused(text=text) if _WORDS.fullmatch(text) else Unrecognised(text=text)


def _mpu9250(*raw: int) -> Decoded:
    p, q, r, x, y, z, a, b, c = raw
    return Inertial(
        sensor=MPU9250,
        gyro_rad_s=(p * _RATE_MPU, q * _RATE_MPU, r * _RATE_MPU),
        acceleration_m_s2=(x * _FORCE_MPU, y * _FORCE_MPU, z * _FORCE_MPU),
        magnetic_t=(a * _FIELD_MPU, b * _FIELD_MPU, c * _FIELD_MPU),
    )


def _icm20948(*raw: int) -> Decoded:
    p, q, r, x, y, z, a, b, c = (each / 1000.0 for each in raw)
    return Inertial(
        sensor=ICM20948,
        gyro_rad_s=(p, q, r),
        acceleration_m_s2=(x, y, z),
        magnetic_t=(a * 1e-6, b * 1e-6, c * 1e-6),
    )


def _gains(_motor: int, p: int, i: int, d: int) -> Decoded:
    return Setting(name="pid", value=(p / 1000.0, i / 1000.0, d / 1000.0), last=True)


_MEANINGS: Final[dict[int, tuple[struct.Struct, Callable[..., Decoded]]]] = {
    # The velocity is the board's own estimate over 10 ms: the counts are better.
    SPEED: (
        struct.Struct("<3hB"),
        # 0 means that nothing was measured yet.
        lambda _vx, _vy, _wz, tenths: (
            Battery(volts=tenths / 10.0) if tenths else Unused(text="0 V")
        ),
    ),
    RAW_MPU9250: (struct.Struct("<9h"), _mpu9250),
    RAW_ICM20948: (struct.Struct("<9h"), _icm20948),
    ATTITUDE: (struct.Struct("<3h"), lambda *angles: Unused(text=" ".join(map(str, angles)))),
    ENCODERS: (struct.Struct("<4i"), lambda *ticks: Totals(ticks=ticks)),
    MOTOR_PID: (struct.Struct("<B3H"), _gains),
    CAR_TYPE: (
        struct.Struct("<2B"),
        lambda number, _: Setting(name="car_type", value=number, last=True),
    ),
    VERSION: (
        struct.Struct("<2B"),
        lambda major, minor: VersionLine(version=f"{major}.{minor}", after_reset=False, last=True),
    ),
}
"""For each function its payload, and the meaning of that."""


# Stored settings.


def _number(value: SettingValue) -> int:
    assert isinstance(value, int | float)
    return round(value)


def _car_shown(value: SettingValue) -> str:
    return f"{value} ({car_name(_number(value))})"


def _kept(thousandths: int) -> int:
    """The thousandths of a gain that the board keeps for good after it was sent these.

    At each start it divides and multiplies them as a float of 32 bits, and truncates: 251 becomes
    250.
    """
    kept = int(_float(_float(thousandths / 1000.0) * 1000.0))
    return kept if kept == thousandths else _kept(kept)


def _float(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def _three(value: SettingValue) -> str:
    assert isinstance(value, tuple)
    return ",".join(f"{gain:.3f}" for gain in value)


def _as_kept(value: SettingValue) -> str:
    assert isinstance(value, tuple)
    p, i, d = (_kept(round(1000.0 * gain)) / 1000.0 for gain in value)
    return _three((p, i, d))


def _store_gains(text: str) -> bytes:
    thousandths = (round(1000.0 * float(gain)) for gain in text.split(","))
    return frame(MOTOR_PID, *struct.pack("<3H", *thousandths), IN_FLASH)


TABLE: Final = (
    StoredSetting(
        field="car_type",
        command="car_type",
        label="car type",
        least=1,
        most=max(CARS),
        limits=f"one of {', '.join(map(str, CARS))}",
        wire=lambda value: str(_number(value)),
        frame=lambda text: frame(CAR_TYPE, int(text), IN_FLASH),
        shown=_car_shown,
        steers=True,
        timeout_s=_STORE_S,
    ),
    StoredSetting(
        field="pid",
        command="pid",
        label="gains P, I, D",
        least=0.0,
        most=10.0,
        limits="0 to 10",
        wire=_as_kept,
        frame=_store_gains,
        shown=lambda value: _three(value).replace(",", ", "),
        parts=("p", "i", "d"),
        timeout_s=_STORE_S,
        option="with --write: the gains of the board's speed loops, too (the vendor's: "
        "0.8,0.06,0.5)",
    ),
)
"""The stored settings."""

READ_SETTINGS: Final = (request(VERSION), request(CAR_TYPE), request(MOTOR_PID, 1))


def findings(settings: BoardSettings, profile: MotorProfile) -> Findings:
    return Findings(
        unfit=tuple(_unfit(settings, profile)),
        wrong=tuple(useless_gains(settings)),
        advice=tuple(_advice(settings, profile)),
    )


def _unfit(settings: BoardSettings, profile: MotorProfile) -> Iterator[str]:
    number, wanted = settings.get("car_type"), profile.stored.get("car_type")
    known = ", ".join(f"{each} ({car_name(each)})" for each in CARS)
    if not isinstance(number, int):
        yield "The board did not show its car type; read its settings again."
    elif number in NO_LAW:
        yield (
            f"The board is set to car type {_car_shown(number)}, which yahboomd cannot drive yet: "
            "the circumference of its wheels, their counts a turn, its track, its wheelbase and "
            "the limit of its speed are not published. If you have the "
            f"{car_name(number)}, measure them and send them with the file of `yahboomd report`, "
            "with the form 'It works here'. If it is another car, set board.profile to it and "
            "store its type with `yahboomd probe --write`."
        )
    elif number not in CARS:
        yield (
            f"The board is set to car type {number}, by which it divides a motion among its "
            f"wheels, and yahboomd does not know that type: no wheel may turn. It knows {known}. "
            "Set board.profile to your car, then store its type with `yahboomd probe --write`."
        )
    elif wanted is not None and number != wanted:
        yield (
            f"The board is set to car type {_car_shown(number)}, the profile {profile.name} needs "
            f"{_car_shown(wanted)}. The type sets how the wheels turn, the signs of the encoders "
            "and the limits of the battery: with a wrong one wheels run away. If the car is the "
            f'{car_name(number)}, set board.profile = "{_profile_of(number)}". Only if it is the '
            f"{car_name(_number(wanted))}, store its type with `yahboomd probe --write`."
        )
    if wanted == M1 and _firmware(settings) < M1_FIRMWARE:
        yield (
            f"The board's firmware is {settings.get('version')}, and it ignores the type of an M1: "
            "that needs 3.6 or later, by the vendor's flashing tool."
        )


def _profile_of(number: int) -> str:
    return next(name for name, each in PROFILES.items() if each.stored.get("car_type") == number)


def _firmware(settings: BoardSettings) -> tuple[int, ...]:
    """Major and minor; of a version that is not known, the newest."""
    parts = str(settings.get("version") or "").split(".")
    return tuple(map(int, parts[:2])) if all(map(str.isdigit, parts[:2])) else M1_FIRMWARE


def _advice(settings: BoardSettings, profile: MotorProfile) -> Iterator[str]:
    number = settings.get("car_type")
    car = CARS.get(number) if isinstance(number, int) else None
    if car is not None and "car_type" not in profile.stored:
        yield (
            f"The board is set to the car {car.name}, whose wheels have "
            f"{car.turn_mm / 3.141592653589793:.1f} mm and {car.turn_counts} counts a turn; the "
            f"profile {profile.name} has {profile.wheel_diameter_mm:g} mm and "
            f"{profile.ticks_per_revolution:g}. If it is that car, set board.profile to it."
        )
    if number == M1 == profile.stored.get("car_type"):
        yield (
            "Whether the counts of an M1 rise while it drives ahead was not published. Watch the "
            "first drive, with the wheels off the ground: yahboomd cuts wheels that turn against "
            "their command. If it does, please send the file of `yahboomd report`."
        )
