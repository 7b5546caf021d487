"""The board's bare text lines. The law: a whole line or nothing, except for the banner of a reset.

Only the version is searched anywhere in a line: a software reset cuts off the line end of
``Reset MCU``, and a reset in the middle of sending appends the banner to the bytes before it.
Every other line must match from end to end, because on a wire without a checksum a piece of an
answer can look like another answer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

from yahboomd.core.protocol.dialect import (
    CommandLost,
    Decoded,
    Reply,
    Setting,
    Unrecognised,
    VersionLine,
)
from yahboomd.core.protocol.four_channel.fields import decimal, integer
from yahboomd.core.protocol.four_channel.framing import Frame, TextLine
from yahboomd.core.protocol.settings import SettingValue

VERSION_LABEL: Final = "Motor_Version:"
RESET_NOTICE: Final = "Reset MCU"

# The answer does not name the command. A frame is too long only when two have run together, so this
# too means that a command was lost.
_LOST: Final = frozenset({"fail,Command not found!", "fail,command is long!"})
_TYPE_REFUSED: Final = "fail,type error!"
_REFUSED = re.compile(r"fail,[ -~]+!")
_ACCEPTED = re.compile(r"(?:Set )?([A-Za-z_]+):OK!")
# The firmware's own spelling.
_SPELLING: Final = {"falsh_reset": "flash_reset"}

# The firmware prints a decimal number whose flash was erased as -6.8e38, and stores none below 0.
# One object, so that an answer equals the one before.
_NO_NUMBER: Final = math.nan


def _stored(text: str) -> float | None:
    return _NO_NUMBER if text.startswith("-") or text == "nan" else decimal(text)


_LABELLED = re.compile(r"([A-Za-z_]+):(\S+)")
_LABELS: Final[dict[str, tuple[str, Callable[[str], int | float | None]]]] = {
    "Motor_type": ("motor_type", integer),
    "Dead_Zone": ("deadzone", integer),
    "Pulse_Line": ("lines", integer),
    "Pulse_Phase": ("ratio", integer),
    "wheel_diameter": ("wheel_diameter_mm", _stored),
}
_PID = re.compile(r"P:(\S+)\s+I:(\S+)\s+D:(\S+)")


Meanings: TypeAlias = Mapping[str, Callable[[str], Decoded | None]]
"""For each frame of a dialect the meaning of its arguments, or None if they have none."""


def decode_item(item: Frame | TextLine, frames: Meanings) -> Decoded:
    """Interpret a frame, by its exact name, or a line; never raises."""
    if isinstance(item, TextLine):
        return decode_text(item.text)
    parse = frames.get(item.name)
    decoded = None if parse is None else parse(item.args)
    return Unrecognised(text=f"${item.name}:{item.args}#") if decoded is None else decoded


def decode_text(text: str) -> Decoded:
    """Interpret a text line; never raises.

    Args:
        text: The line without its line end.
    """
    before, label, version = text.partition(VERSION_LABEL)
    if label:
        return VersionLine(version=version.strip(), after_reset=RESET_NOTICE in before or None)
    line = text.strip()
    if line in _LOST:
        return CommandLost(text=line)
    if line == _TYPE_REFUSED:
        return Reply(command="mtype", ok=False, text=line)
    if accepted := _ACCEPTED.fullmatch(line):
        command = _SPELLING.get(accepted[1], accepted[1])
        follow = command == "read_flash"
        return Reply(command=command, ok=True, text=line, settings_follow=follow)
    if _REFUSED.fullmatch(line):
        return Reply(command="", ok=False, text=line)
    return _setting(line) or Unrecognised(text=text)


def _setting(line: str) -> Setting | None:
    value: SettingValue | None
    if pid := _PID.fullmatch(line):
        p, i, d = map(_stored, pid.groups())
        if p is None or i is None or d is None:
            return None
        return Setting(name="pid", value=(p, i, d), last=True)
    labelled = _LABELLED.fullmatch(line)
    if labelled is None or labelled[1] not in _LABELS:
        return None
    name, parse = _LABELS[labelled[1]]
    value = parse(labelled[2])
    return None if value is None else Setting(name=name, value=value)
