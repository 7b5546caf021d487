"""The dialect ``polled``: the board as the article describes it.

That is "Building a ROS 2 Hardware Bridge for Yahboom 520 Motor Drivers", where this project comes
from. Counters must be requested; nothing is stored; the power cannot be cut, only speed zero sent.
"""

from __future__ import annotations

from typing import Final

import msgspec

from yahboomd.core.protocol.dialect import Decoded, Totals, Units
from yahboomd.core.protocol.four_channel.fields import command, totals
from yahboomd.core.protocol.four_channel.framing import Frame, TextLine
from yahboomd.core.protocol.four_channel.stored import MAX_SPEED, FourChannel
from yahboomd.core.protocol.four_channel.texts import Meanings, decode_item
from yahboomd.core.protocol.profiles import MotorProfile

ARM_REPEATS: Final = 3
"""A command without an answer may get lost on a noisy line; it is sent this often."""

_FRAMES: Final[Meanings] = {"data": totals}
_BRAKE: Final = command("speed", (0, 0, 0, 0), MAX_SPEED)


class Polled(FourChannel, frozen=True, kw_only=True):
    """The board of the article."""

    name: str = "polled"
    spacing_ns: int = 0
    totals_spacing_ns: int = 0
    brake: bytes = _BRAKE
    probe: bytes | None = b"$read#"
    poll: bytes | None = b"$read#"
    # With an answer of 30 bytes and a speed frame of 21.
    poll_bytes: int = 57
    # A 520. If it is lost, only wheels that do not turn show it.
    arm: tuple[bytes, ...] = (b"$mtype:1#",) * ARM_REPEATS

    def speeds(self, units: Units) -> bytes:
        """Permille of the article's scale, about mm/s: -1000..1000."""
        return command("speed", units, MAX_SPEED)

    def decode(self, item: Frame | TextLine) -> Decoded:
        """Decode the counters, and text as in the other dialect, so that a wrong choice shows."""
        return decode_item(item, _FRAMES)

    def recognises(self, item: Frame | TextLine) -> bool:
        return isinstance(self.decode(item), Totals)

    def for_profile(self, profile: MotorProfile) -> Polled:
        if (motor_type := profile.stored.get("motor_type")) is None:
            return self
        frame = f"$mtype:{motor_type:d}#".encode("ascii")
        return msgspec.structs.replace(self, arm=(frame,) * ARM_REPEATS)
