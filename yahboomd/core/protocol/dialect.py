"""The interface of a board: the meanings of its bytes, and the operations of a dialect.

A dialect is a pure value: it writes and reads bytes, does no I/O and keeps no state. It owns
everything that is particular to its board; the rest of yahboomd knows this file alone.

A board with another protocol is a folder with a :class:`Dialect`, and a row in
:mod:`yahboomd.core.protocol.registry`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Protocol, Self, TypeAlias

import msgspec

from yahboomd.core.model import Counts, ImuSensor, Kinematics, Motor, Vector3
from yahboomd.core.protocol.profiles import MotorProfile
from yahboomd.core.protocol.settings import BoardSettings, SettingValue, StoredSetting

FourFloats: TypeAlias = tuple[float, float, float, float]


Units: TypeAlias = tuple[int, ...]
"""A motion in the board's own units: four motors, or a body's velocity."""


class Item(Protocol):
    """A complete frame or line of text that a framer found."""

    @property
    def size(self) -> int:
        """Bytes on the wire."""

    @property
    def trailing(self) -> int:
        """Bytes of the same chunk behind it: they arrived later."""


class FramerCounters(msgspec.Struct, kw_only=True):
    """The counters of a framer.

    Every byte is counted once: ``bytes`` is the sum of the sizes of all items, ``blank_bytes``,
    ``discarded_bytes`` and the held bytes.

    Attributes:
        bytes: All received bytes.
        blank_bytes: Line ends behind frames, and empty lines.
        discarded_bytes: Bytes that belong to no complete item.
        broken_frames: Frames without their end, or with a wrong checksum.
        overlong: Frames or lines discarded because they were longer than any true one.
        bad_bytes: In a dialect of text, bytes that are not text.
    """

    bytes: int = 0
    frames: int = 0
    lines: int = 0
    blank_bytes: int = 0
    discarded_bytes: int = 0
    broken_frames: int = 0
    overlong: int = 0
    bad_bytes: int = 0


class Framer(Protocol):
    """Cuts received bytes into items; each connection has its own.

    The items depend on the bytes, not on how they were cut into chunks. No input raises, and the
    buffer is bounded.
    """

    counters: FramerCounters

    @property
    def held_bytes(self) -> int:
        """Bytes of an incomplete item."""

    def feed(self, data: bytes) -> Sequence[Item]:
        """Take a chunk as received; return the items that it completes, in order."""


class Totals(msgspec.Struct, frozen=True, kw_only=True):
    """The counters since the board started.

    Attributes:
        ticks: Raw int32 counts that wrap, positions 1 to 4.
    """

    ticks: Counts


class Deltas(msgspec.Struct, frozen=True, kw_only=True):
    """The counts of the latest 10 ms. They repeat and skip: never integrate them."""

    ticks: Counts


class Speeds(msgspec.Struct, frozen=True, kw_only=True):
    """The rim speeds that the board measures, by its own settings."""

    mm_s: FourFloats


class Battery(msgspec.Struct, frozen=True, kw_only=True):
    """The supply voltage of the motors."""

    volts: float


class Inertial(msgspec.Struct, frozen=True, kw_only=True):
    """A sample of the board's inertial sensor, along the sensor's own axes."""

    sensor: ImuSensor
    gyro_rad_s: Vector3
    acceleration_m_s2: Vector3
    magnetic_t: Vector3 | None = None


class Reply(msgspec.Struct, frozen=True, kw_only=True):
    """The board's answer to a command.

    Attributes:
        command: The command's name as it is sent, or ``""`` for a refusal that names none.
        ok: Whether it was accepted. A value that the board accepts may still be nonsense.
        settings_follow: The stored settings follow, the firmware's version among them.
    """

    command: str
    ok: bool
    text: str
    settings_follow: bool = False


class Setting(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the stored settings.

    Attributes:
        name: The field of the dialect's table of settings that it fills.
        value: In the board's units.
        last: The answer ends with it, even if other lines were lost.
    """

    name: str
    value: SettingValue
    last: bool = False


class VersionLine(msgspec.Struct, frozen=True, kw_only=True):
    """The firmware's version: part of the stored settings, or the banner of a board that starts.

    Attributes:
        version: Such as ``1.7.3``.
        after_reset: Whether the board has just reset: its counters run from zero again. None if
            the words do not show it; then it is a banner unless the settings were asked for.
        last: The answer ends with it.
    """

    version: str
    after_reset: bool | None = None
    last: bool = False


class CommandLost(msgspec.Struct, frozen=True, kw_only=True):
    """The board did not execute a command: it does not know it, or it has lost it.

    The answer is the same for both, and does not name the command; sending again shows which.
    """

    text: str


class Unused(msgspec.Struct, frozen=True, kw_only=True):
    """A complete item that yahboomd knows and does not use."""

    text: str


class Unrecognised(msgspec.Struct, frozen=True, kw_only=True):
    """A complete item without a meaning in this dialect: corrupted, or new to us."""

    text: str


Decoded: TypeAlias = (
    Totals
    | Deltas
    | Speeds
    | Battery
    | Inertial
    | Reply
    | Setting
    | VersionLine
    | CommandLost
    | Unused
    | Unrecognised
)
"""All meanings of a frame or a line."""


class Motion(Protocol):
    """The commands that turn the wheels of one robot."""

    @property
    def wheel_limits(self) -> tuple[float, ...]:
        """The fastest that each wheel of the geometry can be commanded to turn, m/s."""

    def units(self, speeds: Sequence[float]) -> Units:
        """Convert the speeds of the geometry's wheels to the board's units.

        Args:
            speeds: Rim speed of each wheel, m/s.

        Raises:
            ValueError: A speed is not a finite number. No message of the bus leads here; a mistake
                in the program must end in a stop, not in a number that the board misreads.
        """


class Findings(msgspec.Struct, frozen=True, kw_only=True):
    """The meaning of a board's stored settings for the configured motors, a sentence each.

    Attributes:
        unfit: Why its wheels must not turn, with the remedy.
        wrong: What keeps it from driving well, with the remedy.
        advice: Other hints.
    """

    unfit: tuple[str, ...] = ()
    wrong: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()


class Dialect(msgspec.Struct, frozen=True, kw_only=True):
    """A dialect: data, encoders, and a decoder. A board states what it has beyond the defaults."""

    name: str
    """The row of the registry, and the word in the configuration."""

    title: str
    """The name under which the board is sold."""

    plugs: str = ""
    """How its motor plugs are printed, if not as its frames number them."""

    # Bytes and their meaning.

    resync: bytes
    """Brings the *board's* parser back to the start of a frame from any state.

    The next command may follow at once.
    """

    @abstractmethod
    def framer(self) -> Framer:
        """A new framer, for one connection."""

    @abstractmethod
    def decode(self, item: Any) -> Decoded:  # noqa: ANN401 - whatever its framer finds
        """Interpret an item of this dialect's framer; never raises."""

    @abstractmethod
    def recognises(self, item: Any) -> bool:  # noqa: ANN401 - whatever its framer finds
        """Whether only a board of this dialect sends such an item."""

    # Who is there?

    usb_ids: tuple[str, ...] = ()
    """Vendor and product of its USB chip, as lsusb shows them, the likeliest first."""

    listen_ns: int = 0
    """How long to listen for a board that reports unasked before asking any; 0 for not at all."""

    starts_within_s: float = 0.0
    """The silence after it was switched on or reset; 0 for a moment."""

    probe: bytes | None = None
    """A question that only a board of this dialect answers with sense, and that harms none.

    None if listening is enough.
    """

    def silence(self, volts: float | None, settings: BoardSettings) -> str:  # noqa: ARG002
        """The reason why a board that reports unasked only answers, and the remedy.

        Args:
            volts: The supply of its motors, if it answered with that.
            settings: The stored values that it answered with.
        """
        return ""

    def brakes_until_reset(self, volts: float | None, settings: BoardSettings) -> bool:  # noqa: ARG002
        """Whether a board that answers and reports no counts holds its wheels by an alarm.

        Then settings may be stored although no counts show that the wheels stand.

        Args:
            volts: The supply of its motors, if it answered with that.
            settings: The stored values that it answered with.
        """
        return False

    # Timing on the line.

    spacing_ns: int
    """The least gap from frame to frame after a command that gets no answer."""

    totals_spacing_ns: int
    """The same gap while the board sends only its totals, or nothing."""

    question_spacing_ns: int
    """The gap from a question to a motion, unless an answer came before."""

    answer_spacing_ns: int
    """The gap from the end of an answer to the next frame."""

    baudrate: int
    """The only bits per second that it supports."""

    # Stopping.

    brake: bytes
    """Speed zero: the board brakes, and may hold. It may not stop a runaway wheel."""

    cut: bytes | None = None
    """Power off, independent of the speed loop: the wheels coast. None if it has none."""

    @property
    def surest_stop(self) -> bytes:
        """The stop that ends every motion, in any state of the board."""
        return self.cut or self.brake

    # The counters.

    sample_period_ns: int | None = None
    """The period at which the board renews its counters; None for one that is asked."""

    renews_with_each_line: bool = False
    """The counters are new with each line, which comes by itself every ``sample_period_ns``."""

    age_ns: int = 0
    """How old they may be when such a line leaves; 0 if they are read for it."""

    poll: bytes | None = None
    """Asks for the counters once; None if they come by themselves."""

    poll_bytes: int = 0
    """Bytes on the wire of a poll, its answer and a command; 0 if nothing is asked."""

    arm: tuple[bytes, ...] = ()
    """Makes the board send its counters; lost with its reset. May be empty.

    Each frame is listed as often as it is to be sent.
    """

    disarm: tuple[bytes, ...] = ()
    """Undoes ``arm``."""

    # The supply, and the stored settings.

    battery: bytes | None = None
    """Asks for the voltage; None if the board does not report it, or reports it unasked."""

    read_settings: tuple[bytes, ...] = ()
    """The questions for the stored settings, in order; empty if none are stored."""

    settings: tuple[StoredSetting, ...] = ()
    """The table of the stored settings, in the order in which they are written."""

    def findings(self, settings: BoardSettings, profile: MotorProfile) -> Findings:  # noqa: ARG002
        return Findings()

    # Motion.

    fastest_m_s: float
    """The fastest rim speed that any of its boards takes."""

    @abstractmethod
    def motion(
        self,
        kinematics: Kinematics,
        motors: tuple[Motor, ...],
        settings: BoardSettings | None,
        *,
        scale: float,
    ) -> Motion:
        """The commands with which this board turns these wheels.

        Args:
            settings: The stored settings; None if the board stores nothing.
            scale: The calibration multiplier of commands.

        Raises:
            BoardError: The stored settings do not determine the speed of the wheels.
        """

    @abstractmethod
    def speeds(self, units: Units) -> bytes:
        """Command a motion.

        Args:
            units: The result of :meth:`Motion.units`; clamped to the board's range.
        """

    sensors: tuple[ImuSensor, ...] = ()
    """The inertial sensors that its boards may have."""

    loop_ns: int = 0
    """The period of the board's speed loops; 0 if unknown."""

    most_output: int = 0
    """The largest of :meth:`outputs`; 0 if motors cannot be driven without regulation."""

    def outputs(self, outputs: Units, settings: BoardSettings) -> bytes:  # noqa: ARG002
        """Drive the motors without regulation: they turn even if no encoder works.

        The board adds its dead zone to each, so an output up to there is zero.

        Args:
            outputs: One for each position, in the unit of the dead zone; clamped.
            settings: The stored settings.
        """
        return b""

    def for_profile(self, profile: MotorProfile) -> Self:  # noqa: ARG002
        """The same dialect, for boards that must be sent the motor type at each start."""
        return self
