"""The dialect ``streamed``, which every known board speaks (firmware 1.5.5 to 1.7.3).

Counters are a stream that is switched on; answers are text lines; settings live in flash. The
command table and the firmware's behaviour are in ``docs/protocol.md``.
"""

from __future__ import annotations

import operator
from functools import lru_cache
from typing import Final

from yahboomd.core.protocol.dialect import (
    Battery,
    Decoded,
    Deltas,
    Findings,
    Speeds,
    Units,
    Unrecognised,
)
from yahboomd.core.protocol.four_channel.fields import (
    command,
    four_integers,
    four_speeds,
    totals,
    volts,
)
from yahboomd.core.protocol.four_channel.framing import Frame, TextLine
from yahboomd.core.protocol.four_channel.stored import (
    MAX_SPEED,
    TABLE,
    FourChannel,
    findings,
)
from yahboomd.core.protocol.four_channel.texts import Meanings, decode_item
from yahboomd.core.protocol.profiles import MotorProfile
from yahboomd.core.protocol.settings import BoardSettings, StoredSetting

MAX_PWM: Final = 3600

_STILL: Final = (0, 0, 0, 0)
_BRAKE: Final = command("spd", _STILL, MAX_SPEED)
_CUT: Final = command("pwm", _STILL, MAX_PWM)
_STREAMS_OFF: Final = b"$upload:0,0,0#"


def _deltas(args: str) -> Decoded | None:
    ticks = four_integers(args)
    return None if ticks is None else Deltas(ticks=ticks)


def _speeds(args: str) -> Decoded | None:
    mm_s = four_speeds(args)
    return None if mm_s is None else Speeds(mm_s=mm_s)


def _battery(args: str) -> Decoded | None:
    measured = volts(args)
    return None if measured is None else Battery(volts=measured)


_FRAMES: Final[Meanings] = {
    # The board sends the same counts two to four times.
    "MAll": lru_cache(maxsize=1)(totals),
    "MTEP": _deltas,
    "MSPD": _speeds,
    "Battery": _battery,
}


class Streamed(FourChannel, frozen=True, kw_only=True):
    """The board as it is sold."""

    name: str = "streamed"
    # With all streams and long numbers 10 ms lost up to 19 % of the commands, 20 ms none.
    spacing_ns: int = 20_000_000
    totals_spacing_ns: int = 10_000_000
    loop_ns: int = 10_000_000
    most_output: int = MAX_PWM
    sample_period_ns: int | None = 10_000_000
    brake: bytes = _BRAKE
    # The speed loop is incremental: with target 0 and a dead encoder it keeps its last output, so
    # only this one stops every wheel.
    cut: bytes | None = _CUT
    probe: bytes | None = b"$read_flash#"
    arm: tuple[bytes, ...] = (b"$upload:1,0,0#",)
    disarm: tuple[bytes, ...] = (_STREAMS_OFF,)
    battery: bytes | None = b"$read_vol#"
    read_settings: tuple[bytes, ...] = (b"$read_flash#",)
    settings: tuple[StoredSetting, ...] = TABLE

    def speeds(self, units: Units) -> bytes:
        """Closed loop, in mm/s by the board's settings: -1000..1000."""
        return command("spd", units, MAX_SPEED)

    def outputs(self, outputs: Units, settings: BoardSettings) -> bytes:
        """Open loop, in PWM units: -3600..3600, less the stored dead zone."""
        stored = settings.get("deadzone")
        added = stored if isinstance(stored, int) else 0
        wanted = [operator.index(each) for each in outputs]
        above = [max(0, abs(each) - added) * (1 if each > 0 else -1) for each in wanted]
        return command("pwm", above, MAX_PWM)

    def decode(self, item: Frame | TextLine) -> Decoded:
        """Interpret frames by their exact names, and lines as a whole."""
        return decode_item(item, _FRAMES)

    def recognises(self, item: Frame | TextLine) -> bool:
        """Any line or frame that has a meaning: other boards send neither."""
        return not isinstance(self.decode(item), Unrecognised)

    def findings(self, settings: BoardSettings, profile: MotorProfile) -> Findings:
        return findings(settings, profile)
