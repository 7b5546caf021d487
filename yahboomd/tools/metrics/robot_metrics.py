"""Turns samples of robots into metrics, and makes the page for scrapers.

Every number of the status is a metric: its name, kind, unit and meaning come from
:data:`~yahboomd.core.messages.status_fields.FIELDS`. Numbers that FIELDS does not list (from a
daemon of another version) are left out and counted. Texts are left out, except those that describe
the board.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice
from typing import TypeVar, get_args

import msgspec

from yahboomd.core.messages.native import State, StatusSample, TwistSample, WheelsSample
from yahboomd.core.messages.status_fields import FIELDS, StatusField
from yahboomd.core.model import NS_PER_S
from yahboomd.tools.metrics.exposition import Exposition, Kind

MAX_SERIES = 64
"""The most sources, wheels and reasons taken from one sample: any program may have written it."""

FRESH_NS = 2_000_000_000
"""A twist or wheels sample this much older than the status is left out as outdated."""


# By the unit that FIELDS names: the ending of the field, its base unit, and the factor to that.
_UNITS: Mapping[str, tuple[str, str, float]] = {
    "": ("", "", 1),
    "s": ("_s", "seconds", 1),
    "ns": ("_ns", "seconds", 1e-9),
    "mm": ("_mm", "meters", 1e-3),
    "rad/s": ("_rad_s", "radians_per_second", 1),
    "V": ("volts", "volts", 1),
    "bytes": ("bytes", "bytes", 1),
}
# A letter at the end of a name would be taken for a unit (d: days).
_SPELLED = {"p": "proportional_gain", "i": "integral_gain", "d": "derivative_gain"}
_FIELDS: Mapping[tuple[str, str], StatusField] = {
    (field.group, field.name): field for field in FIELDS
}
# The longest first: the name of a metric ends in its unit.
_BASE_UNITS = sorted(
    {"meters_per_second", *(unit for _, unit, _ in _UNITS.values() if unit)}, key=len, reverse=True
)
PREFIX = "yahboomd_"

Item = TypeVar("Item")


class RobotFacts(msgspec.Struct, frozen=True, kw_only=True):
    """The newest samples of one robot.

    Attributes:
        name: Its namespace, or ``yahboomd``.
        status: The newest status; None unless its daemon is alive.
        status_age_s: Seconds since the newest status arrived; None before the first.
        events: Events since this process began to listen, by kind and severity.
        unreadable: Statuses, answers and events that could not be decoded.
    """

    name: str
    status: StatusSample | None = None
    status_age_s: float | None = None
    twist: TwistSample | None = None
    wheels: WheelsSample | None = None
    events: Mapping[tuple[str, str], int] = {}
    unreadable: int = 0


def metric_name(field: StatusField) -> str:
    """The name of a field's metric, without the suffix of its kind."""
    ending, unit, _ = _UNITS[field.unit]
    stem = _SPELLED.get(field.name, field.name.removesuffix(ending).rstrip("_"))
    group = "source" if field.group == "sources" else field.group
    return PREFIX + "_".join(part for part in (group, stem, unit) if part)


def add_robot(exposition: Exposition, robot: RobotFacts) -> None:
    """Add the series of one robot.

    For a daemon that is not alive it adds ``yahboomd_up 0``, the age of the last status and this
    process's own counts. It leaves old numbers out, because they would look current.
    """
    _RobotMetrics(exposition, robot).add()


class _RobotMetrics:
    """Adds one robot to an exposition."""

    def __init__(self, exposition: Exposition, robot: RobotFacts) -> None:
        self._exposition = exposition
        self._robot = robot
        self._unknown = 0

    def add(self) -> None:
        robot, status = self._robot, self._robot.status
        self._gauge("up", "1 while the daemon answers, else 0", int(status is not None))
        if robot.status_age_s is not None:
            self._gauge(
                "status_age_seconds", "for how long no new status has come", robot.status_age_s
            )
        for (kind, severity), count in robot.events.items():
            labels = {"kind": kind, "severity": severity}
            self._set("counter", "events", "events that were received", count, labels)
        if status is not None:
            self._status(status)
            self._motion(status)
        self._gauge(
            "unknown_status_fields",
            "numbers of the status that are left out: this version does not know them",
            self._unknown,
        )
        words = "statuses, answers and events that could not be read"
        self._set("counter", "unreadable_samples", words, robot.unreadable, {})

    def _status(self, status: StatusSample) -> None:
        self._gauge(
            "status_timestamp_seconds",
            "when the status was made, by the robot's clock, Unix time",
            status.stamp_ns / NS_PER_S,
        )
        for state in dict.fromkeys((*get_args(State), status.state)):
            words = "1 for the state that the robot is in, 0 for the others"
            self._gauge("state", words, int(state == status.state), state=state)
        self._gauge(
            "state_timestamp_seconds",
            "since when it is in this state, by the robot's clock, Unix time",
            status.since_ns / NS_PER_S,
        )
        stopped = int(status.state == "estopped")
        self._gauge("estop_engaged", "1 while the emergency stop is engaged", stopped)
        accounts = status.command.get("sources")
        sources = dict(accounts) if isinstance(accounts, Mapping) else {}
        if status.driver is not None:
            sources.setdefault(status.driver, {})
        for source, account in _some(sources.items()):
            words = "1 for the source of commands that has control"
            self._gauge("source_in_control", words, int(source == status.driver), source=source)
            if isinstance(account, Mapping):
                self._group("sources", account, {"source": source})
        for group in ("board", "link", "command", "bus"):
            self._group(group, getattr(status, group), {})
        board = {name: str(text) for name, text in status.board.items() if _is_text("board", name)}
        if board:
            self._set("info", "board", "the board", 1, board)

    def _group(self, group: str, values: Mapping[str, object], labels: Mapping[str, str]) -> None:
        """Every number of a group of the status."""
        for name, value in values.items():
            field = _FIELDS.get((group, name))
            if field is None:
                self._unknown += isinstance(value, int | float)
            elif field.kind == "text":
                continue
            elif isinstance(value, Mapping) and field.per:
                for key, each in _some(value.items()):
                    self._field(field, each, {**labels, field.per: key})
            else:
                self._field(field, value, labels)

    def _field(self, field: StatusField, value: object, labels: Mapping[str, str]) -> None:
        if not isinstance(value, int | float) or field.kind == "text":
            return
        _, _, factor = _UNITS[field.unit]
        name = metric_name(field).removeprefix(PREFIX)
        self._set(field.kind, name, field.meaning, value * factor, labels)

    def _motion(self, status: StatusSample) -> None:
        twist, wheels = self._robot.twist, self._robot.wheels
        if twist is not None and status.stamp_ns - twist.stamp_ns < FRESH_NS:
            for axis, value in (("x", twist.vx), ("y", twist.vy)):
                self._gauge(
                    "twist_linear_meters_per_second",
                    "measured velocity of the base: x forward, y to the left",
                    value,
                    axis=axis,
                )
            words = "measured turning of the base, counter-clockwise"
            self._gauge("twist_angular_radians_per_second", words, twist.wz, axis="z")
        if wheels is not None and status.stamp_ns - wheels.stamp_ns < FRESH_NS:
            for name, meaning, speeds in (
                ("wheel_speed_meters_per_second", "measured", wheels.speed_m_s),
                ("wheel_command_meters_per_second", "commanded", wheels.command_m_s),
            ):
                for wheel, speed in _some(zip(wheels.names, speeds, strict=False)):
                    self._gauge(name, f"{meaning} speed of the rim", speed, wheel=wheel)

    def _gauge(self, name: str, meaning: str, value: float, **labels: str) -> None:
        self._set("gauge", name, meaning, value, labels)

    def _set(
        self, kind: Kind, name: str, meaning: str, value: float, labels: Mapping[str, str]
    ) -> None:
        unit = next((unit for unit in _BASE_UNITS if name.endswith(f"_{unit}")), "")
        family = self._exposition.family(f"{PREFIX}{name}", kind, meaning, unit)
        family.set(value, {"robot": self._robot.name, **labels})


def _is_text(group: str, name: str) -> bool:
    field = _FIELDS.get((group, name))
    return field is not None and field.kind == "text"


def _some(items: Iterable[Item]) -> Iterable[Item]:
    return islice(items, MAX_SERIES)


PAGE_KEPT_NS = 500_000_000
"""The time for which a page is reused, so that a flood of scrapes computes nothing."""


class Page:
    """Makes the page, at most once in half a second for each format."""

    def __init__(
        self, now_ns: Callable[[], int], robots: Callable[[], Sequence[RobotFacts]], *, version: str
    ) -> None:
        self.connections: Mapping[str, int] = {}
        self._now_ns = now_ns
        self._robots = robots
        self._version = version
        self._kept: dict[bool, tuple[int, str]] = {}

    def text(self, openmetrics: bool) -> str:
        """The page in OpenMetrics, or in Prometheus' older format."""
        now_ns = self._now_ns()
        made_ns, text = self._kept.get(openmetrics, (None, ""))
        if made_ns is None or now_ns - made_ns >= PAGE_KEPT_NS:
            text = self._make().text(openmetrics=openmetrics)
            self._kept[openmetrics] = (now_ns, text)
        return text

    def _make(self) -> Exposition:
        exposition = Exposition()
        for robot in self._robots():
            add_robot(exposition, robot)
        exposition.family("yahboomd_metrics", "info", "this exporter").set(
            1, {"version": self._version}
        )
        connections = exposition.family(
            "yahboomd_metrics_connections", "counter", "connections of scrapers, by outcome"
        )
        for outcome, count in self.connections.items():
            connections.set(count, {"outcome": outcome})
        return exposition
