"""Puts the findings of ``yahboomd probe`` into lines for a person. Pure."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence

from yahboomd.core.link.discovery import Candidate
from yahboomd.core.program import pasteable
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.settings import StoredSetting
from yahboomd.tools.port.probing import Survival
from yahboomd.tools.probe.probe_report import Report, SettingRow

REOPEN: dict[Survival, str] = {
    "kept": "the counters survive closing and opening the port",
    "reset": "the board restarts when its port is opened: the counters are lost",
    "unknown": "not known yet whether the counters survive it",
}
DIFFERS = "differs"
READY = "Ready to drive."
NOT_READY = "Not to be driven like this."

_COLOURS = {
    re.escape(READY): "1;32",
    re.escape(NOT_READY): "1;31",
    rf"{DIFFERS}$": "33",
    r"^stored value .*": "1",
    r"^(?:port|board|supply|counters|wheels|reopening|settings)\b(?=  )": "1",
}


def text(found: Report) -> list[str]:
    """A report for people, in lines, without the verdict."""
    device = f" -> {found.device}" if found.device not in {"", found.port} else ""
    firmware = f", firmware {found.firmware}" if found.firmware else ""
    dialect = DIALECTS[found.dialect or ""]
    facts = {
        "port": f"{found.port}{device}",
        "board": f"{dialect.title}, {found.dialect} dialect{firmware}",
    }
    if found.volts is not None:
        facts["supply"] = f"{found.volts:.1f} V"
    if found.ticks is not None:
        counts = enumerate(found.ticks, start=1)
        facts["counters"] = "   ".join(f"M{position} {ticks}" for position, ticks in counts)
    if found.standing is not None:
        facts["wheels"] = "standing" if found.standing else "turning"
    if found.reopen is not None:
        facts["reopening"] = REOPEN[found.reopen]
    if not found.settings and not found.problems:
        facts["settings"] = "none: a board of this dialect stores nothing"
    lines = [f"{name:<12}{fact}" for name, fact in facts.items()]
    if found.settings:
        lines += ["", *table(found.settings, dialect.settings, f"profile {found.profile}")]
    return lines


def table(
    rows: Sequence[SettingRow], settings: Sequence[StoredSetting], want_title: str
) -> list[str]:
    """Stored and wanted values in columns."""
    cells: list[tuple[str, ...]] = [("stored value", "board", want_title, "")]
    cells += [(row.name, *shown(row, settings), DIFFERS if row.differs else "") for row in rows]
    return columns(cells)


def columns(cells: Sequence[Sequence[str]]) -> list[str]:
    """Rows as lines, each column as wide as its widest cell."""
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        "   ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in cells
    ]


def verdict(found: Report, width: int = 100) -> list[str]:
    """Whether the board may be driven, then its problems and advice, in lines."""
    points = [*found.problems, *found.advice]
    count = len(found.differing)
    if count and not found.problems:
        values = "1 value differs" if count == 1 else f"{count} values differ"
        points.append(
            f"{values} from the profile, which does no harm: the daemon takes the board's own "
            "into account. To store the profile: yahboomd probe --write"
        )
    lines = [NOT_READY if found.problems else READY]
    for point in points:
        # The lines after the first are commands to paste: never wrap them.
        sentence, *verbatim = pasteable(point).splitlines()
        lines += textwrap.wrap(
            sentence,
            width,
            initial_indent="  - ",
            subsequent_indent="    ",
            break_long_words=False,
            break_on_hyphens=False,
        )
        lines += [f"    {line}" for line in verbatim]
    return lines


def painted(lines: Sequence[str]) -> list[str]:
    """The lines in the colours of a terminal."""
    found = list(lines)
    for pattern, code in _COLOURS.items():
        found = [re.sub(pattern, f"\x1b[{code}m\\g<0>\x1b[0m", line) for line in found]
    return found


def listing(found: Sequence[Candidate], udev_name: str, target: str) -> list[str]:
    """The serial ports of this machine, in lines.

    Args:
        found: The ports on USB, and those of the computer itself.
        udev_name: The name that the udev rule gives the board.
        target: The device that this name links to; empty if it does not exist.
    """
    rows = [
        (
            each.path,
            f"CH340 {each.usb}, as the board has it" if each.is_ch340 else each.description,
            name,
        )
        for each in found
        for name in (udev_name if each.path == target else each.by_path or "",)
    ]
    if not rows:
        return ["No serial port is on USB, nor on the computer itself."]
    return columns([("port", "device", "a name that stays"), *rows])


def shown(row: SettingRow, settings: Sequence[StoredSetting]) -> tuple[str, str]:
    """The value that the board stores, and the wanted one, in words."""
    setting = next(each for each in settings if each.command == row.command)
    have = "not known" if row.have is None else setting.words(row.have)
    want = "left as it is" if row.want is None else setting.words(row.want)
    return have, want
