"""The status as diagnostics of ROS 2: a level and a sentence for each part, and its facts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from yahboomd.core.messages.native import Group, StatusSample
from yahboomd.ros2.messages.ros2_encoders import Diagnostic

OK, WARN, ERROR, STALE = 0, 1, 2, 3

_LEVELS: dict[str, int] = {
    "standing": OK,
    "driving": OK,
    "stopping": OK,
    "estopped": WARN,
    "fault": ERROR,
    # Nothing is known of the base: neither its place nor whether it stands.
    "waiting": STALE,
}

_COMMAND_TROUBLE = frozenset({"two_programs", "too_often", "too_seldom", "cannot"})
"""Causes in a status that only who commands can end."""

_LINE_TROUBLE = ("discarded_bytes", "broken_frames", "bad_bytes", "overlong")
"""Counters that stand still on a line without faults."""


class Diagnostics:
    """Makes the entries; it keeps the last counters, because only new faults are worth a warning.

    Args:
        hardware_id: Distinguishes this robot from others: its namespace.
    """

    def __init__(self, *, hardware_id: str) -> None:
        self._hardware_id = hardware_id
        self._line_trouble: dict[str, int] = {}
        self._put_errors = 0

    def of(
        self, sample: StatusSample, type_warnings: Mapping[str, str] | None = None
    ) -> list[Diagnostic]:
        """The entries for a status; call it once for each that is published.

        Args:
            type_warnings: By source: a node publishes another type than that of its topic.
        """
        commands = _commands(sample, type_warnings or {})
        facts = {name: fact for name, fact in sample.command.items() if name != "clock_warnings"}
        base = {
            "state": sample.state,
            "wheels": sample.wheels,
            "driver": sample.driver or "none",
            "since_s": round(max(0, sample.stamp_ns - sample.since_ns) / 1e9, 1),
        }
        level = ERROR if sample.wheels == "unknown" else _LEVELS[sample.state]
        broken = str(sample.command.get("pose_broken", ""))
        pose = WARN if broken else OK, broken or "The pose is continuous."
        return [
            self._entry("base", level, sample.why, base),
            self._entry("pose", *pose, {}),
            self._entry("board", *self._board(sample), {**sample.board, **sample.link}),
            self._entry("commands", *commands, facts),
            self._entry("bus", *self._bus(sample), sample.bus),
        ]

    def _entry(self, what: str, level: int, message: str, facts: Group) -> Diagnostic:
        return Diagnostic(
            level=level,
            name=f"yahboomd: {what}",
            message=message,
            hardware_id=self._hardware_id,
            values=list(_values(facts)),
        )

    def _board(self, sample: StatusSample) -> tuple[int, str]:
        counted = {name: _count(sample.link, name) for name in _LINE_TROUBLE}
        before, self._line_trouble = self._line_trouble, counted
        if not sample.board:
            return ERROR, "No board is connected."
        news = {name: count - before.get(name, 0) for name, count in counted.items()}
        worse = [f"{count} {_words(name)}" for name, count in news.items() if count > 0]
        if before and worse:
            return WARN, f"The line is disturbed: {', '.join(worse)} since the last report."
        board = sample.board
        if board.get("battery") in {"low", "empty"}:
            level = WARN if board["battery"] == "low" else ERROR
            return level, f"The battery is {board['battery']}: {board['volts_at_rest']} V at rest."
        version = f", firmware {board['version']}" if board.get("version") else ""
        return OK, f"Connected: dialect {board.get('dialect', 'unknown')}{version}."

    def _bus(self, sample: StatusSample) -> tuple[int, str]:
        errors = _count(sample.bus, "put_errors")
        lost, self._put_errors = errors - self._put_errors, errors
        if lost > 0:
            return WARN, f"{lost} samples could not be sent since the last report."
        routers = sample.bus.get("routers")
        if routers:
            return OK, f"Joined the router at {routers}."
        return OK, f"{_count(sample.bus, 'neighbours')} sessions are connected."


def levels(entries: list[Diagnostic]) -> tuple[int, ...]:
    """Facts whose change is published at once, rather than at the next beat."""
    return tuple(entry.level for entry in entries)


def _commands(sample: StatusSample, type_warnings: Mapping[str, str]) -> tuple[int, str]:
    if found := [each.text for each in sample.reasons or () if each.kind in _COMMAND_TROUBLE]:
        return WARN, " ".join([*found, *type_warnings.values()])
    clocks = sample.command.get("clock_warnings")
    warnings = [*type_warnings.items(), *(clocks.items() if isinstance(clocks, Mapping) else ())]
    if warnings:
        return WARN, " ".join(f"{source}: {words}" for source, words in warnings)
    accepted = _count(sample.command, "accepted")
    return OK, f"{accepted} commands were obeyed."


def _values(facts: Group, group: str = "") -> Iterator[tuple[str, str]]:
    for name, value in facts.items():
        # The entries of a group have names of sources and the like, not of fields.
        key = f"{group}: {name}" if group else _words(name)
        if isinstance(value, Mapping):
            yield from _values(value, key)
        else:
            yield key, _text(value)


def _text(value: object) -> str:
    match value:
        case None:
            return "unknown"
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.6g}"
        case str() | int():
            return str(value)
        case list() | tuple():
            return ", ".join(str(item) for item in value)
        case _:
            return repr(value)


def _words(name: str) -> str:
    """A field's name as people write it: ``clock_offset_s`` is "clock offset [s]"."""
    for end, unit in _UNITS.items():
        if name.endswith(end):
            return f"{name.removesuffix(end).replace('_', ' ')} [{unit}]"
    return name.replace("_", " ")


_UNITS = {"_mm": "mm", "_m_s": "m/s", "_m": "m", "_s": "s", "_ns": "ns"}


def _count(facts: Group, name: str) -> int:
    value = facts.get(name, 0)
    return value if isinstance(value, int) else 0
