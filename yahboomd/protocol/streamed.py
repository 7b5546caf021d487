"""The dialect ``streamed``: what every board seen in the wild speaks (firmware 1.5.5 to 1.7.3).

Counters are a stream that is switched on; answers are text lines; settings live in flash. The
command table and the firmware's habits are in ``docs/protocol.md``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import msgspec

from yahboomd.model import Counts
from yahboomd.protocol.dialect import (
    Battery,
    Decoded,
    Deltas,
    SettingWrite,
    Speeds,
    Totals,
    Unrecognised,
)
from yahboomd.protocol.fields import command, four_integers, four_speeds, volts
from yahboomd.protocol.framing import Frame, TextLine
from yahboomd.protocol.settings import BoardSettings, MotorProfile, check_storable
from yahboomd.protocol.texts import decode_text

MAX_SPEED: Final = 1000
MAX_PWM: Final = 3600

_STILL: Final = (0, 0, 0, 0)
_BRAKE: Final = command("spd", _STILL, MAX_SPEED)
_CUT: Final = command("pwm", _STILL, MAX_PWM)
_STREAMS_OFF: Final = b"$upload:0,0,0#"

_STORE_S: Final = 0.4
"""A changed value takes 65 to 116 ms, deaf for most of it; a tight wait loses answers."""
_RESET_S: Final = 1.0
"""New gains take up to 350 ms, a factory reset up to 1 s, each with a restart."""


def _totals(args: str) -> Decoded | None:
    ticks = four_integers(args)
    return None if ticks is None else Totals(ticks=ticks)


def _deltas(args: str) -> Decoded | None:
    ticks = four_integers(args)
    return None if ticks is None else Deltas(ticks=ticks)


def _speeds(args: str) -> Decoded | None:
    mm_s = four_speeds(args)
    return None if mm_s is None else Speeds(mm_s=mm_s)


def _battery(args: str) -> Decoded | None:
    measured = volts(args)
    return None if measured is None else Battery(volts=measured)


_FRAMES: Final[dict[str, Callable[[str], Decoded | None]]] = {
    "MAll": _totals,
    "MTEP": _deltas,
    "MSPD": _speeds,
    "Battery": _battery,
}


class Streamed(msgspec.Struct, frozen=True, kw_only=True):
    """The dialect as data; see :class:`~yahboomd.protocol.dialect.Dialect` for the meanings."""

    name: str = "streamed"
    # With all streams and long numbers 10 ms lost up to 19 % of the commands, 20 ms none.
    spacing_ns: int = 20_000_000
    totals_spacing_ns: int = 10_000_000
    # 51 characters between "$" and "#".
    max_frame_bytes: int = 53
    line_end: bytes = b"\r\n"
    sample_period_ns: int | None = 10_000_000
    max_command: int = MAX_SPEED
    max_pwm: int = MAX_PWM
    brake: bytes = _BRAKE
    # The speed loop is incremental: with target 0 and a dead encoder it keeps its last output, so
    # only this one stops every wheel.
    cut: bytes | None = _CUT
    release: bytes | None = _CUT
    leave: tuple[bytes, ...] = (_BRAKE, _CUT, _STREAMS_OFF)
    probe: bytes = b"$read_flash#"
    poll: bytes | None = None
    arm: tuple[bytes, ...] = (b"$upload:1,0,0#",)
    disarm: tuple[bytes, ...] = (_STREAMS_OFF,)
    battery: bytes | None = b"$read_vol#"
    read_settings: bytes | None = b"$read_flash#"
    factory_reset: SettingWrite | None = SettingWrite(
        frame=b"$flash_reset#", reply_to="flash_reset", timeout_s=_RESET_S, resets=True
    )

    def speeds(self, units: Counts) -> bytes:
        """Closed loop, in mm/s as the board believes: -1000..1000."""
        return command("spd", units, self.max_command)

    def pwm(self, units: Counts) -> bytes:
        """Open loop, in PWM units: -3600..3600."""
        return command("pwm", units, self.max_pwm)

    def decode(self, item: Frame | TextLine) -> Decoded:
        """Frames by their exact names, lines as a whole."""
        if isinstance(item, TextLine):
            return decode_text(item.text)
        parse = _FRAMES.get(item.name)
        decoded = None if parse is None else parse(item.args)
        return Unrecognised(text=f"${item.name}:{item.args}#") if decoded is None else decoded

    def recognises(self, item: Frame | TextLine) -> bool:
        """Any line or frame that has a meaning: other boards send neither."""
        return not isinstance(self.decode(item), Unrecognised)

    def write_settings(self, have: BoardSettings, want: BoardSettings) -> tuple[SettingWrite, ...]:
        """One write for each value that the board shows to differ; the gains, which reset, last."""
        check_storable(want)
        return tuple(
            SettingWrite(
                frame=f"${name}:{wanted}#".encode("ascii"),
                reply_to=name,
                timeout_s=_RESET_S if name == "MPID" else _STORE_S,
                resets=name == "MPID",
            )
            for name, stored, wanted in (
                ("mtype", _whole(have.motor_type), _whole(want.motor_type)),
                ("deadzone", _whole(have.deadzone), _whole(want.deadzone)),
                ("mline", _whole(have.lines), _whole(want.lines)),
                ("mphase", _whole(have.ratio), _whole(want.ratio)),
                ("wdiameter", _milli(have.wheel_diameter_mm), _milli(want.wheel_diameter_mm)),
                ("MPID", _gains(have.pid), _gains(want.pid)),
            )
            if stored is not None and wanted is not None and stored != wanted
        )

    def for_profile(self, profile: MotorProfile) -> Streamed:  # noqa: ARG002 (the seam's shape)
        """Itself: the motor type lives in the board's flash."""
        return self


# Two values differ when they differ as the board prints them: whole, or with three decimals.


def _whole(value: float | None) -> str | None:
    return None if value is None else str(round(value))


def _milli(value: float | None) -> str | None:
    return None if value is None else f"{value:.3f}"


def _gains(pid: tuple[float, float, float] | None) -> str | None:
    return None if pid is None else ",".join(f"{gain:.3f}" for gain in pid)
