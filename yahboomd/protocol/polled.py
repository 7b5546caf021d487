"""The dialect ``polled``: the board as the article describes it.

That is "Building a ROS 2 Hardware Bridge for Yahboom 520 Motor Drivers", where this project comes
from. Counters are asked for; nothing is stored; there is no way to cut the power, only speed zero.
"""

from __future__ import annotations

from typing import Final

import msgspec

from yahboomd.model import Counts
from yahboomd.protocol.dialect import Decoded, SettingWrite, Totals, Unrecognised
from yahboomd.protocol.fields import command, four_integers
from yahboomd.protocol.framing import Frame, TextLine
from yahboomd.protocol.settings import BoardSettings, MotorProfile
from yahboomd.protocol.texts import decode_text

MAX_SPEED: Final = 1000

_BRAKE: Final = command("speed", (0, 0, 0, 0), MAX_SPEED)


class Polled(msgspec.Struct, frozen=True, kw_only=True):
    """The dialect as data; see :class:`~yahboomd.protocol.dialect.Dialect` for the meanings.

    Attributes:
        motor_type: Sent to the board before anything else; 1 is the 520.
    """

    motor_type: int = 1
    name: str = "polled"
    spacing_ns: int = 0
    totals_spacing_ns: int = 0
    # Not said by the article; the other dialect's limit leaves room for every frame.
    max_frame_bytes: int = 53
    line_end: bytes = b""
    sample_period_ns: int | None = None
    max_command: int = MAX_SPEED
    brake: bytes = _BRAKE
    cut: bytes | None = None
    release: bytes | None = None
    leave: tuple[bytes, ...] = (_BRAKE,)
    probe: bytes = b"$read#"
    poll: bytes | None = b"$read#"
    disarm: tuple[bytes, ...] = ()
    battery: bytes | None = None
    read_settings: bytes | None = None
    factory_reset: SettingWrite | None = None

    @property
    def arm(self) -> tuple[bytes, ...]:
        """The motor type, once."""
        return (f"$mtype:{self.motor_type:d}#".encode("ascii"),)

    def speeds(self, units: Counts) -> bytes:
        """Permille of the article's scale, about mm/s: -1000..1000."""
        return command("speed", units, self.max_command)

    def decode(self, item: Frame | TextLine) -> Decoded:
        """The counters; text as the other dialect has it, so that a wrong choice shows."""
        if isinstance(item, TextLine):
            return decode_text(item.text)
        ticks = four_integers(item.args) if item.name == "data" else None
        if ticks is None:
            return Unrecognised(text=f"${item.name}:{item.args}#")
        return Totals(ticks=ticks)

    def recognises(self, item: Frame | TextLine) -> bool:
        """An answer with counters, and nothing else."""
        return isinstance(self.decode(item), Totals)

    def write_settings(self, have: BoardSettings, want: BoardSettings) -> tuple[SettingWrite, ...]:  # noqa: ARG002
        """Nothing: the board stores nothing."""
        return ()

    def for_profile(self, profile: MotorProfile) -> Polled:
        """The dialect that arms with the profile's motor type."""
        return msgspec.structs.replace(self, motor_type=profile.motor_type)
