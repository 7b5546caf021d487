"""The dialect ``polled``: the board as the article describes it.

That is "Building a ROS 2 Hardware Bridge for Yahboom 520 Motor Drivers", where this project comes
from. Counters are asked for; nothing is stored; there is no way to cut the power, only speed zero.
"""

from __future__ import annotations

from typing import Final

import msgspec

from yahboomd.model import Kinematics, Motor
from yahboomd.protocol.dialect import (
    Decoded,
    Findings,
    Totals,
    Units,
)
from yahboomd.protocol.four_channel.fields import command, totals
from yahboomd.protocol.four_channel.framing import RESYNC, Frame, Framer, TextLine
from yahboomd.protocol.four_channel.stored import (
    AFTER_ANSWER_NS,
    BAUDRATE,
    MAILBOX_NS,
    MAX_M_S,
    TITLE,
    motion,
)
from yahboomd.protocol.four_channel.texts import Meanings, decode_item
from yahboomd.protocol.per_motor import PerMotor
from yahboomd.protocol.profiles import MotorProfile
from yahboomd.protocol.settings import BoardSettings, StoredSetting

MAX_SPEED: Final = 1000

ARM_REPEATS: Final = 3
"""A command without an answer, which a noisy line may lose, is sent so often."""

_FRAMES: Final[Meanings] = {"data": totals}
_BRAKE: Final = command("speed", (0, 0, 0, 0), MAX_SPEED)


class Polled(msgspec.Struct, frozen=True, kw_only=True):
    """The dialect as data; see :class:`~yahboomd.protocol.dialect.Dialect` for the meanings.

    Attributes:
        motor_type: Sent to the board before anything else; 1 is the 520.
    """

    motor_type: int = 1
    name: str = "polled"
    title: str = TITLE
    resync: bytes = RESYNC
    spacing_ns: int = 0
    totals_spacing_ns: int = 0
    question_spacing_ns: int = MAILBOX_NS
    answer_spacing_ns: int = AFTER_ANSWER_NS
    baudrate: int = BAUDRATE
    fastest_m_s: float = MAX_M_S
    loop_ns: int = 0
    most_output: int = 0
    line_end: bytes = b""
    listen_ns: int = 0
    starts_within_s: float = 0.0
    sample_period_ns: int | None = None
    renews_with_each_line: bool = False
    age_ns: int = 0
    brake: bytes = _BRAKE
    cut: bytes | None = None
    probe: bytes | None = b"$read#"
    poll: bytes | None = b"$read#"
    # With an answer of 30 bytes and a speed frame of 21.
    poll_bytes: int = 57
    disarm: tuple[bytes, ...] = ()
    battery: bytes | None = None
    read_settings: tuple[bytes, ...] = ()
    settings: tuple[StoredSetting, ...] = ()

    @property
    def arm(self) -> tuple[bytes, ...]:
        """The motor type. If it is lost, nothing shows it but wheels that do not turn."""
        return (f"$mtype:{self.motor_type:d}#".encode("ascii"),) * ARM_REPEATS

    def framer(self) -> Framer:
        """Return a framer for frames and text lines."""
        return Framer()

    def speeds(self, units: Units) -> bytes:
        """Permille of the article's scale, about mm/s: -1000..1000."""
        return command("speed", units, MAX_SPEED)

    def outputs(self, outputs: Units) -> bytes:  # noqa: ARG002 (the seam's shape)
        """Return nothing: it regulates always."""
        return b""

    def decode(self, item: Frame | TextLine) -> Decoded:
        """The counters; text as the other dialect has it, so that a wrong choice shows."""
        return decode_item(item, _FRAMES)

    def recognises(self, item: Frame | TextLine) -> bool:
        """An answer with counters, and nothing else."""
        return isinstance(self.decode(item), Totals)

    def silence(self, volts: float | None) -> str:  # noqa: ARG002 (the seam's shape)
        """Nothing: it reports because it is asked to."""
        return ""

    def findings(self, settings: BoardSettings, profile: MotorProfile) -> Findings:  # noqa: ARG002
        """Return nothing: the board stores no settings."""
        return Findings()

    def motion(
        self,
        kinematics: Kinematics,
        motors: tuple[Motor, ...],
        settings: BoardSettings | None,
        *,
        scale: float,
    ) -> PerMotor:
        """A speed for each motor."""
        return motion(kinematics, motors, settings, scale=scale, max_command=MAX_SPEED)

    def for_profile(self, profile: MotorProfile) -> Polled:
        """The dialect that arms with the profile's motor type."""
        motor_type = profile.stored.get("motor_type", self.motor_type)
        return msgspec.structs.replace(self, motor_type=motor_type)
