"""What the robots of a fleet do, sorted by who needs somebody. Pure: it asks nobody.

Everything that a robot sends may be wrong, huge or a terminal's commands: texts are cut and
cleaned as they come in, and numbers that are none are left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from yahboomd.client.streams import STATES, reason
from yahboomd.core.clock import nanoseconds, seconds
from yahboomd.core.messages.native import DRIVABLE, StatusSample
from yahboomd.core.program import pasteable, plain
from yahboomd.tools.people.people_keys import claims_a_name

STALE_S = 6.0
"""A robot without an answer for this time is not known to do anything."""

MOST_UNLISTED = 256
"""Robots that are in no list and are shown; of more only the number is."""

MOST = 1e6
"""Numbers of robots from here on are left out."""

LONGEST_WHY = 300
LONGEST_WORD = 64
"""The most characters of a name, of a sentence."""

NEEDS = (
    "fault",
    "lost in motion",
    "unknown state",
    "does not answer",
    "battery empty",
    "emergency stop",
    "no board",
    "not reachable",
    "battery low",
)
"""Why a robot needs somebody, the most urgent first."""


class RobotRow(msgspec.Struct, frozen=True, kw_only=True):
    """One robot, as a script gets it.

    Attributes:
        robot: Its namespace.
        needs: Why it needs somebody, a word of ``NEEDS``; empty if it needs nobody.
        can_drive: Whether it would obey a command now.
        state: Its latest state; null if it never answered.
        state_s: For how long it is in this state.
        driver: The key that has control; null if none has.
        volts: The supply of its motors; null if it is not known.
        battery: good, low or empty; empty if no limit is set.
        version: The version of its daemon; empty if it is not known.
        calibrated: Whether its geometry was calibrated; null if it is not known.
        seen_s: The time since its latest answer; null if it never answered.
        claimed: Whether the name in ``why`` is one that the emergency stop's request only claims.
        listed: Whether it is in the person's list.
    """

    robot: str
    needs: str
    can_drive: bool
    state: str | None = None
    state_s: float | None = None
    why: str = ""
    driver: str | None = None
    volts: float | None = None
    battery: str = ""
    version: str = ""
    calibrated: bool | None = None
    seen_s: float | None = None
    claimed: bool = False
    listed: bool = True


class _Seen(msgspec.Struct, kw_only=True):
    """What is known of a robot; times are monotonic nanoseconds of this program."""

    listed: bool
    present: bool = False
    left_ns: int | None = None
    seen_ns: int | None = None
    daemon: str = ""
    state: str = ""
    state_s: float | None = None
    why: str = ""
    driver: str | None = None
    volts: float | None = None
    battery: str = ""
    version: str = ""
    calibrated: bool | None = None


class FleetView:
    """Collects the answers of robots.

    Args:
        robots: The namespaces of the listed robots; each has a row, seen or not.

    Attributes:
        left_out: Robots beyond the shown ones, and answers that could not be read.
    """

    def __init__(self, robots: Iterable[str] = ()) -> None:
        self.left_out = 0
        self._robots = {robot: _Seen(listed=True) for robot in robots}
        self._unlisted = 0

    def answered(self, robot: str, status: StatusSample, now_ns: int) -> None:
        """Take a robot's status; one in no list is shown from now on, if there is room."""
        if (seen := self._row(robot)) is None:
            return
        seen.seen_ns, seen.left_ns = now_ns, None
        daemon = _text(status.bus.get("zid"))
        if daemon != seen.daemon:
            # Another daemon: nothing of the old one's configuration holds.
            seen.daemon, seen.version, seen.calibrated = daemon, "", None
        seen.state = _text(status.state)
        seen.state_s = _between_s(status.since_ns, status.stamp_ns)
        seen.why = _cut(plain(reason(status)), LONGEST_WHY)
        seen.driver = None if status.driver is None else _text(status.driver)
        seen.volts = _number(status.board.get("volts"))
        seen.battery = _text(status.board.get("battery"))
        seen.version = _text(status.bus.get("version")) or seen.version

    def configured(self, robot: str, data: Mapping[str, Any]) -> None:
        """Take the answer of a robot's service ``yahboomd/config``."""
        seen = self._robots.get(robot)
        if seen is None:
            return
        seen.version = _text(data.get("version")) or seen.version
        chassis = data.get("chassis")
        if isinstance(chassis, Mapping):
            factors = chassis.get("wheel_radius_multiplier")
            found = [*factors.values()] if isinstance(factors, Mapping) else [factors]
            found += [
                chassis.get(f"{each}_multiplier") for each in ("wheel_separation", "sideways")
            ]
            known = [each for each in map(_number, found) if each is not None]
            seen.calibrated = any(each != 1.0 for each in known) if known else None

    def token(self, robot: str, now_ns: int, *, present: bool) -> None:
        """Note that a robot's daemon came, or that the last token of it went."""
        if (seen := self._row(robot)) is None:
            return
        if seen.present and not present:
            seen.left_ns = now_ns
        seen.present = present

    def unread(self) -> None:
        """Count an answer that cannot be read."""
        self.left_out += 1

    def unconfigured(self) -> dict[str, str]:
        """Robots that answered, and whose configuration is not known, each with its daemon's id."""
        return {
            name: seen.daemon
            for name, seen in self._robots.items()
            if seen.seen_ns is not None and seen.calibrated is None
        }

    def waiting(self, now_ns: int) -> list[str]:
        """Robots that have not answered lately, and may be there."""
        return [
            name
            for name, seen in self._robots.items()
            if (seen.listed or seen.present) and not _is_fresh(seen, now_ns)
        ]

    def rows(self, now_ns: int) -> list[RobotRow]:
        """A row for each robot, those that need somebody most urgently first."""
        found = [_row(name, seen, now_ns) for name, seen in self._robots.items()]
        ranks = {needs: rank for rank, needs in enumerate((*NEEDS, ""))}
        return sorted(found, key=lambda row: (ranks[row.needs], row.robot))

    def _row(self, robot: str) -> _Seen | None:
        seen = self._robots.get(robot)
        if seen is None:
            if self._unlisted >= MOST_UNLISTED:
                self.left_out += 1
                return None
            self._unlisted += 1
            seen = self._robots[robot] = _Seen(listed=False)
        return seen


def _is_fresh(seen: _Seen, now_ns: int) -> bool:
    return (
        seen.seen_ns is not None
        and seen.left_ns is None
        and now_ns - seen.seen_ns < nanoseconds(STALE_S)
    )


def _row(name: str, seen: _Seen, now_ns: int) -> RobotRow:
    fresh, answered = _is_fresh(seen, now_ns), seen.seen_ns is not None
    age_s = None if seen.seen_ns is None else seconds(now_ns - seen.seen_ns)
    state_s = None if seen.state_s is None or age_s is None else seen.state_s + age_s
    return RobotRow(
        robot=name,
        needs=_needs(seen, fresh=fresh),
        can_drive=fresh and seen.state in DRIVABLE,
        state=seen.state if answered else None,
        state_s=state_s,
        why=seen.why,
        driver=seen.driver,
        volts=seen.volts,
        battery=seen.battery,
        version=seen.version,
        calibrated=seen.calibrated,
        seen_s=age_s,
        claimed=claims_a_name(seen.why),
        listed=seen.listed,
    )


def _needs(seen: _Seen, *, fresh: bool) -> str:
    if not fresh:
        if seen.state in {"driving", "stopping"}:
            return "lost in motion"
        return "does not answer" if seen.present else "not reachable"
    if seen.state not in STATES:
        return "unknown state"
    if seen.battery == "empty" and seen.state in DRIVABLE:
        return "battery empty"
    by_state = {"fault": "fault", "estopped": "emergency stop", "waiting": "no board"}
    return by_state.get(seen.state, "battery low" if seen.battery in {"low", "empty"} else "")


def _text(value: object) -> str:
    return _cut(plain(value), LONGEST_WORD) if isinstance(value, str) else ""


def _cut(text: str, longest: int) -> str:
    return pasteable(text if len(text) <= longest else f"{text[: longest - 1]}…")


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    # Beyond this, and NaN, it is neither a voltage nor a factor, and has no place in a column.
    return float(value) if abs(value) < MOST else None


def _between_s(since_ns: int, now_ns: int) -> float | None:
    """Seconds between two stamps of one robot; None if its numbers are no times."""
    found_s = (now_ns - since_ns) // 1_000_000 / 1000 if abs(now_ns - since_ns) < 1 << 63 else None
    return None if found_s is None else max(0.0, found_s)
