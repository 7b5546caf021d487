"""The settings of the streamed board, as its firmware reads, stores and reports them.

The firmware checks next to nothing: zeros are stored, whole numbers are cut and wrap at 16 bits,
and an empty argument stores 0.
"""

from __future__ import annotations

import math
import re
import struct
from decimal import Decimal

import msgspec

from yahboomd.simulation.speed_loop import LoopSettings


class FlashContent(msgspec.Struct, frozen=True, kw_only=True):
    """The settings that the streamed board keeps over a reset, with the vendor's defaults.

    Attributes:
        motor_type: 1 to 4: 520, 310, TT with encoder, TT without.
        dead_zone: PWM units that the speed loop adds to its output.
        lines: Encoder lines per turn of the motor.
        ratio: Gear ratio, whole.
        wheel_diameter_mm: The diameter that the board assumes.
    """

    motor_type: int = 1
    dead_zone: int = 1600
    lines: int = 11
    ratio: int = 30
    wheel_diameter_mm: float = 67.0
    p: float = 0.8
    i: float = 0.06
    d: float = 0.5


LONGEST_DEAD_ZONE = 3600

LOOP_LIMIT = 2000
"""The most that the speed loop gives by itself, in PWM units: the dead zone comes on top."""

_ERASED = FlashContent(
    motor_type=0xFF,
    dead_zone=0xFFFF,
    lines=0xFFFF,
    ratio=0xFFFF,
    wheel_diameter_mm=math.nan,
    p=math.nan,
    i=math.nan,
    d=math.nan,
)
"""Erased flash holds ones: the largest whole number, and NaN as a decimal one."""

_NO_NUMBER = "-680564693277057680000000000000000000000.000"
"""The text that the firmware prints for NaN."""

_WHOLE = re.compile(rb"\s*([+-]?\d+)")
_DECIMAL = re.compile(rb"\s*([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)")
_SEPARATORS = re.compile(rb"[, ]+")


def whole(text: bytes) -> int:
    """C's ``atoi``: leading digits count, anything else is 0, 32 bits saturate."""
    match = _WHOLE.match(text)
    if match is None:
        return 0
    return max(-0x8000_0000, min(0x7FFF_FFFF, int(match[1])))


def decimal(text: bytes) -> float:
    """C's ``atof``."""
    match = _DECIMAL.match(text)
    # Adding 0 leaves no negative zero.
    return float(match[1]) + 0.0 if match else 0.0


def fields(args: bytes) -> list[bytes]:
    """The numbers of a command that takes several; an empty one is skipped, not read as 0."""
    return [field for field in _SEPARATORS.split(args) if field]


def short(value: int) -> int:
    """Wrap a number to 16 bits, signed, as the firmware does."""
    return (value + 0x8000) % 0x1_0000 - 0x8000


def single(value: float) -> float:
    """The nearest number that 32 bits hold, as the firmware stores it and regulates with it."""
    try:
        (held,) = struct.unpack("f", struct.pack("f", value))
    except OverflowError:
        return math.copysign(math.inf, value)
    return float(held)


class SettingRefused(msgspec.Struct, frozen=True):
    """A setting that the firmware does not take."""

    answer: bytes


def changed(content: FlashContent, name: bytes, args: bytes) -> FlashContent | SettingRefused:
    """The flash after ``$name:args#``, for the settings that a command stores one by one."""
    replace = msgspec.structs.replace
    number = whole(args) % 0x1_0000
    match name:
        case b"mtype":
            if not 1 <= number <= 4:
                return SettingRefused(b"fail,type error!")
            return replace(content, motor_type=number)
        case b"deadzone":
            if number > LONGEST_DEAD_ZONE:
                return SettingRefused(b"fail,deadzone error!")
            return replace(content, dead_zone=number)
        case b"mline":
            return replace(content, lines=number)
        case b"mphase":
            return replace(content, ratio=number)
        case b"wdiameter":
            if not _storable(diameter_mm := decimal(args)):
                return SettingRefused(b"fail,wdiameter error!")
            return replace(content, wheel_diameter_mm=_kept(content.wheel_diameter_mm, diameter_mm))
        case b"MPID":
            gains = [decimal(field) for field in (fields(args) + [b""] * 3)[:3]]
            if not all(map(_storable, gains)):
                return SettingRefused(b"fail,MPID error!")
            p, i, d = map(_kept, (content.p, content.i, content.d), gains)
            return replace(content, p=p, i=i, d=d)
        case _:
            raise KeyError(name)


def _storable(value: float) -> bool:
    return 0.0 <= single(value) < math.inf


def _kept(before: float, value: float) -> float:
    """The value, unless 32 bits cannot tell it from the one before."""
    return before if single(before) == single(value) else value


SETTINGS = (b"mtype", b"deadzone", b"mline", b"mphase", b"wdiameter", b"MPID")
"""The commands that :func:`changed` knows."""


def cut_short(content: FlashContent, written: int) -> FlashContent:
    """The flash after a loss of power within a write: its page was erased, and filled in part.

    Args:
        content: The content to store.
        written: The number of values that were written.
    """
    lost = msgspec.structs.asdict(_ERASED)
    names = FlashContent.__struct_fields__[written:]
    return msgspec.structs.replace(content, **{name: lost[name] for name in names})


def is_erased(content: FlashContent, name: str) -> bool:
    """Whether the flash of a value is erased, so that a new value needs no erasure."""
    value, erased = getattr(content, name), getattr(_ERASED, name)
    return bool(value == erased or (math.isnan(value) and math.isnan(erased)))


def report(content: FlashContent, version: str) -> bytes:
    """The answer to ``$read_flash#``: text lines, not frames."""
    lines = (
        "read_flash:OK!",
        f"Motor_Version:{version}",
        f"Motor_type:{content.motor_type}",
        f"Dead_Zone:{content.dead_zone}",
        f"Pulse_Line:{content.lines}",
        f"Pulse_Phase:{content.ratio}",
        f"wheel_diameter:{_printed(content.wheel_diameter_mm)}",
        f"P:{_printed(content.p)}\t I:{_printed(content.i)}\t D:{_printed(content.d)}\t ",
    )
    return "".join(f"{line}\r\n" for line in lines).encode()


def _printed(value: float) -> str:
    """Three decimals of the stored number, of which 17 digits are printed and zeros follow."""
    held = single(value)
    return f"{Decimal(f'{held:.16e}'):.3f}" if math.isfinite(held) else _NO_NUMBER


def mm_s_per_tick(content: FlashContent) -> float:
    """Rim speed that one count in 10 ms stands for: 15.946 mm/s with the defaults.

    A zero among lines, ratio and diameter makes the board measure nothing.
    """
    ticks_per_revolution = content.lines * content.ratio * 4
    if ticks_per_revolution == 0:
        return 0.0
    return 100.0 * math.pi * content.wheel_diameter_mm / ticks_per_revolution


def tuning(content: FlashContent, wired_type: int) -> LoopSettings:
    """The settings as the 100 Hz interrupt uses them.

    Args:
        content: The settings.
        wired_type: The true type of the motors.
    """
    return LoopSettings(
        mm_s_per_tick=_number(mm_s_per_tick(content)),
        p=_number(content.p),
        i=_number(content.i),
        d=_number(content.d),
        dead_zone=short(content.dead_zone),
        most_output=LOOP_LIMIT,
        # TT motors without encoder are not regulated.
        frozen=content.motor_type == 4,
        # The types differ in how their wires are arranged.
        inverted=(content.motor_type in _POWER_CROSSED) != (wired_type in _POWER_CROSSED),
        counts_inverted=(content.motor_type in _PHASES_CROSSED) != (wired_type in _PHASES_CROSSED),
    )


def _number(value: float) -> float:
    """Replace NaN by zero, as the processor's conversion to whole numbers does."""
    return 0.0 if math.isnan(value) else value


_POWER_CROSSED = (3,)
_PHASES_CROSSED = (2, 3)
"""Types whose motor wires, or encoder phases, run the other way than a 520's. A 520 on a board set
for a 310 runs away; a TT motor on a board set for a 520 turns backward, and counts forward."""


def confirmation(name: bytes, version: str) -> bytes:
    """The answer to a stored setting; 1.6.5 and older send none for the dead zone."""
    numbers = tuple(whole(part.encode()) for part in version.split("."))
    if name == b"deadzone" and numbers <= (1, 6, 5):
        return b""
    return b"Set " + name + b":OK!\r\n"
