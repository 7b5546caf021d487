"""The stored settings of boards: values by name, and the table by which they are written.

yahboomd reads them and corrects for them instead of overwriting them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import TypeAlias

import msgspec

from yahboomd.core.errors import ConfigError

SettingValue: TypeAlias = int | float | str | tuple[float, float, float]

BoardSettings: TypeAlias = dict[str, SettingValue]
"""Values by the field of their row in the dialect's table, and ``version``, the firmware's, which
cannot be written. A missing value is unknown, or not wanted; a board shows NaN for a value that it
lost. Never changed in place."""

VERSION = "version"


class SettingWrite(msgspec.Struct, frozen=True, kw_only=True):
    """One stored value to write, and the board's confirmation of it.

    Attributes:
        frame: The frame to send, alone on the line, with the wheels at rest.
        text: The same, to show.
        reply_to: The ``command`` of the :class:`Reply` that answers it.
        timeout_s: The longest wait; the board is deaf while it writes its flash.
        resets: The board restarts once the value is stored, and may give no reply: then the
            :class:`VersionLine` of its banner is the answer. Streams are off afterwards.
    """

    frame: bytes
    text: str
    reply_to: str
    timeout_s: float
    resets: bool


class StoredSetting(msgspec.Struct, frozen=True, kw_only=True):
    """One stored value of a board: a row of its dialect's table.

    Attributes:
        field: Its key in :data:`BoardSettings`, in the board's facts and in the configuration.
        command: The command that stores it, as the board's answer names it.
        label: Its name for people.
        unit: Its unit, shown behind its value.
        least: The least value that may be stored; for several numbers, the least of each.
        most: The largest, likewise.
        limits: Both, in words.
        wire: The value as the board prints it: two values differ if these do.
        frame: The frame that stores the text of ``wire``.
        shown: The value for people; None if ``wire`` will do.
        parts: The names of its numbers in the board's facts, if it has several.
        steers: The speed of the wheels depends on it. It is believed when it was read twice, or is
            the expected one, because an answer may have lost a digit.
        timeout_s: The longest time that storing takes.
        resets: The board restarts once it is stored.
        option: The help of its option of `yahboomd probe`, if no profile of motors has it.
    """

    field: str
    command: str
    label: str
    unit: str = ""
    least: float
    most: float
    limits: str
    wire: Callable[[SettingValue], str]
    frame: Callable[[str], bytes]
    shown: Callable[[SettingValue], str] | None = None
    parts: tuple[str, ...] = ()
    steers: bool = False
    timeout_s: float
    resets: bool = False
    option: str = ""

    def words(self, value: SettingValue) -> str:
        text = f"{value:g}" if isinstance(value, int | float) else self.wire(value)
        return self.shown(value) if self.shown is not None else text + self.unit

    def allows(self, value: SettingValue) -> bool:
        if isinstance(value, tuple) != bool(self.parts):
            return False
        numbers = value if isinstance(value, tuple) else (value,)
        return all(
            isinstance(number, int | float) and self.least <= number <= self.most
            for number in numbers
        )

    def named(self, value: SettingValue | None) -> dict[str, SettingValue | None]:
        if not self.parts:
            return {self.field: value}
        return dict(zip(self.parts, value, strict=True)) if isinstance(value, tuple) else {}


def is_complete(table: Iterable[StoredSetting], settings: BoardSettings) -> bool:
    """Whether every value is known: the whole answer has arrived."""
    return VERSION in settings and all(row.field in settings for row in table)


def check_storable(table: Iterable[StoredSetting], want: BoardSettings) -> None:
    """Refuse values that the board would accept with OK and then run away with.

    Raises:
        ConfigError: Naming every such value.
    """
    wrong = [
        f"{row.label} {want[row.field]}{row.unit} ({row.limits})"
        for row in table
        if row.field in want and not row.allows(want[row.field])
    ]
    if wrong:
        raise ConfigError(f"The board must not store {', '.join(wrong)}.")


def writes(
    table: Iterable[StoredSetting], have: BoardSettings, want: BoardSettings
) -> tuple[SettingWrite, ...]:
    """The writes that turn one set of stored values into another, in the order of the table.

    Args:
        have: The values that the board shows; others are not written.
        want: The values that it should store; others are left alone.

    Returns:
        One write for each value that differs, as far as the board can show it.

    Raises:
        ConfigError: If a wanted value must never be stored.
    """
    table = tuple(table)
    check_storable(table, want)
    found = []
    for row in table:
        if row.field not in have or row.field not in want:
            continue
        wanted = row.wire(want[row.field])
        if row.wire(have[row.field]) != wanted:
            found.append(
                SettingWrite(
                    frame=row.frame(wanted),
                    text=f"{row.label} {wanted}{row.unit}",
                    reply_to=row.command,
                    timeout_s=row.timeout_s,
                    resets=row.resets,
                )
            )
    return tuple(found)


def useless_gains(settings: BoardSettings) -> Iterator[str]:
    """Name gains that are lost, or all zero, with which no board of the vendor's turns a wheel."""
    gains = settings.get("pid")
    if not isinstance(gains, tuple):
        return
    if any(map(math.isnan, gains)):
        found = "The board has lost its gains P, I and D, as by a loss of power within a write"
    elif not any(gains):
        found = "The gains P, I and D are all stored as 0"
    else:
        return
    yield (
        f"{found}: no wheel would ever turn. Store the vendor's with `yahboomd probe --write --pid "
        "0.8,0.06,0.5`; after a tuning, restore the gains before it with `yahboomd tune --undo`."
    )
