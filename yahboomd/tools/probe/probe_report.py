"""Collects the findings of ``yahboomd probe`` and their meaning. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import msgspec

from yahboomd.core.link.discovery import Candidate
from yahboomd.core.link.storing import Outcome
from yahboomd.core.model import Counts
from yahboomd.core.protocol.dialect import Findings
from yahboomd.core.protocol.profiles import MotorProfile
from yahboomd.core.protocol.registry import unknown_dialect
from yahboomd.core.protocol.settings import (
    VERSION,
    BoardSettings,
    SettingValue,
    StoredSetting,
    writes,
)
from yahboomd.tools.port.probing import Examination, Reopening, Survival

LOW_VOLTS = 5.5
"""Below it the motors have no supply: USB alone feeds the board."""


class SettingRow(msgspec.Struct, frozen=True, kw_only=True):
    """One stored value beside the wanted one, in the board's units.

    Attributes:
        have: The stored value; None if the board did not answer.
        want: The value to store; None leaves the board's value alone.
        differs: Whether `probe --write` would store it.
    """

    name: str
    command: str
    have: SettingValue | None
    want: SettingValue | None
    differs: bool


class StoredValue(msgspec.Struct, frozen=True, kw_only=True):
    """One value that `probe --write` tried to store.

    Attributes:
        outcome: ``stored`` (and read back), ``refused`` by the board, or ``failed``.
        took_s: Until it was read back.
    """

    command: str
    outcome: Outcome
    answer: str
    attempts: int
    took_s: float


class Report(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One probe.

    Attributes:
        port: The probed port; empty if none was found.
        device: The device behind it, if the port is a link.
        dialect: The board's dialect; None if no board answered.
        standing: Whether the wheels were seen to stand.
        reopen: Whether the counters survive closing and opening the port; None: not tried.
        settings: The stored values; empty if the board stores none.
        problems: Why the board must not be driven like this, each with its remedy.
        stored: The values that `--write` tried to store.
        yahboomd: The version of the probe.
    """

    port: str = ""
    device: str = ""
    dialect: str | None = None
    firmware: str | None = None
    volts: float | None = None
    ticks: Counts | None = None
    standing: bool | None = None
    reopen: Survival | None = None
    profile: str = ""
    settings: tuple[SettingRow, ...] = ()
    problems: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()
    yahboomd: str = ""
    error: str | None = None
    ports: tuple[Candidate, ...] = ()
    stored: tuple[StoredValue, ...] = ()

    @property
    def differing(self) -> tuple[SettingRow, ...]:
        """The values that differ from the profile."""
        return tuple(row for row in self.settings if row.differs)


def report(
    found: Examination,
    reopening: Reopening | None,
    *,
    port: str,
    device: str,
    profile: MotorProfile,
    want: BoardSettings,
    wanted_dialect: str,
) -> Report:
    """Combine a board's answers with their meaning."""
    dialect, settings = found.dialect, found.settings
    assert dialect is not None
    meant = Findings()
    rows: tuple[SettingRow, ...] = ()
    wrong: list[str] = []
    if wanted_dialect not in {"auto", dialect.name}:
        wrong.append(
            f"The configuration wants the {wanted_dialect} dialect, the board speaks "
            f'{dialect.name}. Set serial.dialect = "auto".'
        )
    if found.standing is False:
        wrong.append(
            "A wheel turns though every motor is let go: a hand, a slope, or a driver that is "
            "broken. Find out which before anything drives."
        )
    if found.readers:
        wrong.append(found.readers)
    if found.silence:
        wrong.append(f"The board answers, and sends no counters. {found.silence}")
    if settings is not None:
        differing = {write.reply_to for write in writes(dialect.settings, settings, want)}
        rows = setting_rows(dialect.settings, settings, want, differing)
        meant = dialect.findings(settings, profile)
        wrong += [*meant.unfit, *meant.wrong]
    elif dialect.read_settings:
        why = unknown_dialect(found.heard.start) or "Is the cable bad, or near the motors?"
        words = "The board does not send all of its settings, without which no wheel may turn."
        wrong.append(f"{words} {why}")
    return Report(
        port=port,
        device=device,
        dialect=dialect.name,
        firmware=None if settings is None else str(settings.get(VERSION) or "") or None,
        volts=found.volts,
        ticks=found.ticks,
        standing=found.standing,
        reopen=None if reopening is None else reopening.survival,
        profile=profile.name,
        settings=rows,
        problems=tuple(wrong),
        advice=(*meant.advice, *_advice(found, reopening)),
    )


def _advice(found: Examination, reopening: Reopening | None) -> Iterable[str]:
    if found.ticks is None and not found.silence:
        yield "No counters came: without them there is no odometry."
    if found.volts is not None and found.volts < LOW_VOLTS:
        yield (
            f"The motors' supply has {found.volts:.1f} V: is the battery connected, charged and "
            "switched on? USB alone does not turn motors."
        )
    if reopening is None:
        return
    if reopening.survival == "reset":
        yield (
            "Opening the port resets the board, so a restart of the daemon loses the "
            "travel meanwhile. The port's DTR line does that: try --set serial.dtr=false, and "
            "see that serial.hangup_on_close is false; then probe again."
        )
    elif reopening.survival == "unknown" and reopening.near_zero:
        yield (
            "The counters are near zero, so it is unknown whether opening the port resets "
            "the board: turn a wheel by hand, half a turn, and probe again."
        )


def setting_rows(
    table: Iterable[StoredSetting],
    have: BoardSettings,
    want: BoardSettings,
    differing: Collection[str],
) -> tuple[SettingRow, ...]:
    """The stored values beside the wanted ones.

    Args:
        differing: The commands of the values that differ, as the dialect compares them.
    """
    return tuple(
        SettingRow(
            name=row.label,
            command=row.command,
            have=have.get(row.field),
            want=want.get(row.field),
            differs=row.command in differing,
        )
        for row in table
    )
