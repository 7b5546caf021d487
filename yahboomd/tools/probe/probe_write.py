"""Asks and informs the person while ``yahboomd probe --write`` stores settings."""

from __future__ import annotations

import sys

from yahboomd.core.link import storing
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.settings import BoardSettings, SettingWrite, StoredSetting
from yahboomd.tools.probe.probe_report import StoredValue, setting_rows
from yahboomd.tools.probe.probe_text import shown


def agreed(count: int) -> bool:
    """Ask the person at the terminal whether to store; without a terminal the answer is yes."""
    if not sys.stdin.isatty():
        return True
    values = "this value" if count == 1 else f"these {count} values"
    print(f"\nStore {values} in the board's flash? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in {"y", "yes"}


class Printed(storing.Progress):
    """Prints each value as it is stored."""

    def __init__(self) -> None:
        self._table: tuple[StoredSetting, ...] = ()
        self._had: BoardSettings = {}

    def begins(
        self, dialect: Dialect, writes: tuple[SettingWrite, ...], had: BoardSettings
    ) -> None:
        self._table, self._had = dialect.settings, had
        print(f"storing {len(writes)} of the board's values, one at a time, the wheels at rest:")

    def stored(self, step: storing.StoringStep, has: BoardSettings) -> None:
        name = step.write.reply_to
        rows = setting_rows(self._table, self._had, has, ())
        row = next(each for each in rows if each.command == name)
        before, now = shown(row, self._table)
        notes: list[str] = [step.outcome]
        if step.outcome == "refused":
            notes.append(f"the board answered {step.answer!r}")
        elif not step.answer:
            read_back = ", but read back" if step.outcome == "stored" else ""
            notes.append(f"no answer heard{read_back}")
        if step.attempts > 1:
            notes.append(f"{step.attempts} attempts")
        print(f"  {row.name:<16}{before} -> {now}   {', '.join(notes)}", flush=True)


def stored_value(step: storing.StoringStep) -> StoredValue:
    """The outcome of storing a value, for the report."""
    return StoredValue(
        command=step.write.reply_to,
        outcome=step.outcome,
        answer=step.answer,
        attempts=step.attempts,
        took_s=round(step.took_s, 3),
    )
