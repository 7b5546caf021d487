"""The seam: what a frame can mean, and what the rest of the house asks of a dialect.

A dialect is a pure value: it writes and reads bytes, it does no I/O and keeps no state.

A board that speaks otherwise is one more file that fulfils :class:`Dialect`, and one more row in
:mod:`yahboomd.protocol.registry`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, TypeAlias

import msgspec

from yahboomd.model import Counts
from yahboomd.protocol.fields import FourFloats

if TYPE_CHECKING:
    from yahboomd.protocol.framing import Frame, TextLine
    from yahboomd.protocol.settings import BoardSettings, MotorProfile

SettingValue: TypeAlias = int | float | tuple[float, float, float]


class Totals(msgspec.Struct, frozen=True, kw_only=True):
    """The counters since the board started.

    Attributes:
        ticks: Raw int32 counts that wrap, positions 1 to 4.
    """

    ticks: Counts


class Deltas(msgspec.Struct, frozen=True, kw_only=True):
    """The counts of the latest 10 ms. They repeat and skip: never integrate them.

    Attributes:
        ticks: Positions 1 to 4.
    """

    ticks: Counts


class Speeds(msgspec.Struct, frozen=True, kw_only=True):
    """The rim speeds that the board itself believes.

    Attributes:
        mm_s: Millimetres per second, positions 1 to 4.
    """

    mm_s: FourFloats


class Battery(msgspec.Struct, frozen=True, kw_only=True):
    """The supply voltage of the motors.

    Attributes:
        volts: As measured by the board.
    """

    volts: float


class Reply(msgspec.Struct, frozen=True, kw_only=True):
    """The board's answer to a command.

    Attributes:
        command: The command's name as it is sent (``mtype``, ``flash_reset``), or ``""`` for a
            refusal that names none.
        ok: Whether it was accepted. A value that the board accepts may still be nonsense.
        text: The answer, word for word.
    """

    command: str
    ok: bool
    text: str


class Setting(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the stored settings.

    Attributes:
        name: The field of :class:`~yahboomd.protocol.settings.BoardSettings` that it fills.
        value: In the board's units.
    """

    name: str
    value: SettingValue


class VersionLine(msgspec.Struct, frozen=True, kw_only=True):
    """The firmware's version: part of the stored settings, or the banner of a board that starts.

    Where the settings were not asked for it is a banner, and the counters run from zero again.

    Attributes:
        version: Such as ``1.7.3``.
        after_reset: The line says itself that the board has reset (``Reset MCU`` before it).
    """

    version: str
    after_reset: bool


class CommandLost(msgspec.Struct, frozen=True, kw_only=True):
    """The board did not carry out a command: it does not know it, or it has lost it.

    It says the same for both, and does not say which command; sending again tells.

    Attributes:
        text: The complaint, word for word.
    """

    text: str


class Unrecognised(msgspec.Struct, frozen=True, kw_only=True):
    """Something whole that means nothing in this dialect: corrupted, or new to us.

    Attributes:
        text: The line, or the frame with its ``$`` and ``#``.
    """

    text: str


Decoded: TypeAlias = (
    Totals | Deltas | Speeds | Battery | Reply | Setting | VersionLine | CommandLost | Unrecognised
)
"""All that a frame or a line can mean."""


class SettingWrite(msgspec.Struct, frozen=True, kw_only=True):
    """One stored value to write, and how to know that it was taken.

    Attributes:
        frame: What to send, alone on the line, with the wheels at rest.
        reply_to: The ``command`` of the :class:`Reply` that answers it.
        timeout_s: How long to wait; the board is deaf while it writes its flash.
        resets: The board restarts once the value is stored, and may give no reply: then the
            :class:`VersionLine` of its banner is the answer. Streams are off afterwards.
    """

    frame: bytes
    reply_to: str
    timeout_s: float
    resets: bool


class Dialect(Protocol):
    """What the rest asks of a dialect. All of it is data, but for the encoders and the decoder."""

    @property
    def name(self) -> str:
        """The row of the registry, and the word in the configuration."""
        ...

    @property
    def spacing_ns(self) -> int:
        """The least gap from ``#`` to the next ``$`` behind a command that gets no answer."""
        ...

    @property
    def totals_spacing_ns(self) -> int:
        """The same gap, enough while the board streams its totals alone, or nothing."""
        ...

    @property
    def max_frame_bytes(self) -> int:
        """The longest frame that the board takes, ``$`` and ``#`` included."""
        ...

    @property
    def line_end(self) -> bytes:
        """What the board sends behind the ``#`` of a frame; nothing, where it need not."""
        ...

    @property
    def sample_period_ns(self) -> int | None:
        """How often the board renews its counters; None where an answer is always fresh."""
        ...

    @property
    def max_command(self) -> int:
        """The largest magnitude of a speed command, in command units."""
        ...

    @property
    def brake(self) -> bytes:
        """Speed zero: the board brakes, and may hold. No proof against a runaway wheel."""
        ...

    @property
    def cut(self) -> bytes | None:
        """Power off, whatever the speed loop does: the wheels coast. None where there is none."""
        ...

    @property
    def release(self) -> bytes | None:
        """What lets the wheels turn freely once they stand; None where nothing does."""
        ...

    @property
    def leave(self) -> tuple[bytes, ...]:
        """The last frames before the port closes, in order, ``spacing_ns`` apart."""
        ...

    @property
    def probe(self) -> bytes:
        """A harmless question that only a board of this dialect answers with sense."""
        ...

    @property
    def poll(self) -> bytes | None:
        """Asks for the counters once; None where they come by themselves."""
        ...

    @property
    def arm(self) -> tuple[bytes, ...]:
        """Makes the board ready to hand out counters; after each of its resets, again."""
        ...

    @property
    def disarm(self) -> tuple[bytes, ...]:
        """Undoes ``arm``."""
        ...

    @property
    def battery(self) -> bytes | None:
        """Asks for the voltage; None where the board does not tell it."""
        ...

    @property
    def read_settings(self) -> bytes | None:
        """Asks for the stored settings; None where there are none to read."""
        ...

    @property
    def factory_reset(self) -> SettingWrite | None:
        """Restores the settings that the board was sold with; None where nothing does."""
        ...

    def speeds(self, units: Counts) -> bytes:
        """Command the speeds of the four positions.

        Args:
            units: Command units, clamped to ``max_command``; positive is forward.
        """
        ...

    def decode(self, item: Frame | TextLine) -> Decoded:
        """Say what a frame or a line means; never raises."""
        ...

    def recognises(self, item: Frame | TextLine) -> bool:
        """Whether only a board of this dialect says that."""
        ...

    def write_settings(self, have: BoardSettings, want: BoardSettings) -> tuple[SettingWrite, ...]:
        """The writes that turn one set of stored values into another, in order.

        Args:
            have: What the board shows. A value that it did not show is not written.
            want: What it should store; None leaves a value alone.

        Returns:
            One write for each value that differs, as far as the board can show it.

        Raises:
            ConfigError: If a wanted value must never be stored.
        """
        ...

    def for_profile(self, profile: MotorProfile) -> Dialect:
        """The same dialect, for boards that must be sent the motor type at each start."""
        ...
