"""Puts a view into words: for both screens, and as lines for logs, pipes and scripts. Pure."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from yahboomd.core.messages.native import EventSample, StatusSample
from yahboomd.core.names import source_words
from yahboomd.core.program import pasteable, plain
from yahboomd.tools.screens.dashboard import Count, View
from yahboomd.tools.terminal.words import degrees, duration, rate


def driver(view: View) -> str:
    """The source that has control, and for how long."""
    if view.status is None or view.status.driver is None:
        return "no source has control"
    since = "" if view.driver_s is None else f" for {duration(view.driver_s)}"
    return f"{source_words(view.status.driver)} has control{since}"


STANDING = frozenset({"standing", "estopped", "fault", "waiting", "at_rest"})
"""Wheels at rest; of a daemon that does not know its wheels, states in which nothing moves."""


def lost_sight(view: View) -> str:
    """Advice for a person whose daemon falls silent; empty if nothing moved."""
    if view.status is None or (view.status.wheels or view.status.state) in STANDING:
        return ""
    return pasteable(
        f"It was {view.status.state}: if the wheels still turn, run `yahboomd stop` on the robot, "
        "or switch the motors' supply off."
    )


def board(view: View) -> str:
    """The board that is connected, and its port."""
    facts: Mapping[str, Any] = {} if view.status is None else view.status.board
    if "dialect" not in facts:
        return "no board"
    named = [str(facts[each]) for each in ("dialect", "version") if facts.get(each)]
    return f"{' '.join(named)} on {facts.get('port', '?')}"


def supply(view: View) -> str:
    """The battery's voltage and charge."""
    return "battery unknown" if view.volts is None else f"battery {view.volts:.1f} V{_charge(view)}"


def _charge(view: View) -> str:
    level = None if view.status is None else view.status.board.get("battery")
    return f", {level}" if level in {"low", "empty"} else ""


def readings(view: View) -> str:
    """The rate at which the board's counters are read."""
    return rate(view.readings_per_s, "readings")


def traffic(view: View) -> str:
    """The rates of received commands and published poses."""
    return f"{rate(view.commands_per_s, 'commands')} · {rate(view.poses_per_s, 'poses')}"


def routers(view: View) -> str:
    """The routers that the daemon is connected to."""
    facts: Mapping[str, Any] = {} if view.status is None else view.status.bus
    if joined := facts.get("routers"):
        names = joined if isinstance(joined, str) else ", ".join(joined)
        return f"joined the router {names}"
    count = facts.get("neighbours")
    return "joined no router" + (f" · {count} connected" if isinstance(count, int) else "")


def counts(found: Sequence[Count], nothing: str) -> str:
    """The troubles that were counted; ``nothing`` if there are none."""
    return " · ".join(f"{count.name} {count.total}" for count in found) or nothing


def status_text(view: View) -> str:
    """The status alone, a fact in each line; ends without a line break."""
    assert view.status is not None
    return _table(
        (
            *_state(view, view.status),
            ("board", f"{board(view)}, {supply(view)}"),
            ("lost", counts(view.link, "nothing")),
            ("refused", counts(view.refusals, "no command")),
        )
    )


def snapshot(view: View, *, where: str) -> str:
    """The whole view; ends without a line break."""
    assert view.status is not None
    silent = "" if view.phase == "live" else f", silent for {view.silent_s:.1f} s"
    return _table(
        (
            ("daemon", where + silent),
            *_state(view, view.status),
            ("pose", _pose(view)),
            ("twist", _twist(view)),
            *(
                (f"{name} wheel", f"{ticks} ticks, {speed:+.3f} m/s of {command:+.3f}")
                for name, ticks, speed, command in view.wheel_rows
            ),
            ("battery", "unknown" if view.volts is None else f"{view.volts:.2f} V{_charge(view)}"),
            ("board", board(view)),
            ("link", f"{readings(view)} · {counts(view.link, 'nothing lost or missed')}"),
            ("bus", f"{traffic(view)} · {routers(view)}"),
            ("refused", counts(view.refusals, "no command")),
            *(("event", event_line(event)) for event in view.events),
        )
    )


def line(view: View) -> str:
    """The most important facts, in one line."""
    assert view.status is not None
    if view.phase == "silent":
        return f"no status from the daemon for {view.silent_s:.1f} s (it was {view.status.state})"
    volts = "" if view.volts is None else f"  {view.volts:.1f} V"
    late = " (old)" if view.late else ""
    return plain(
        f"{view.status.state:<9} {view.status.driver or '-':<14} {_pose(view)}  {_twist(view)}"
        f"{late}  {readings(view)}{volts}"
    )


def event_line(event: EventSample) -> str:
    """An event, with its time of day."""
    return plain(f"{moment(event)} {event.severity}: {event.message}")


def moment(event: EventSample) -> str:
    """The time of day of an event."""
    return time.strftime("%H:%M:%S", time.localtime(event.stamp_ns / 1e9))


def _table(rows: Iterable[tuple[str, str]]) -> str:
    rows = tuple(rows)
    width = max(len(name) for name, _ in rows) + 2
    return "\n".join(plain(f"{name:<{width}}{words}") for name, words in rows)


def _state(view: View, status: StatusSample) -> tuple[tuple[str, str], ...]:
    return (
        ("state", f"{status.state} for {duration(view.state_s)}"),
        ("wheels", (status.wheels or "not known yet").replace("_", " ")),
        ("why", status.why),
        ("driver", driver(view)),
    )


def _pose(view: View) -> str:
    pose = view.pose
    if pose is None:
        return "unknown"
    x, y, theta = (round(each, 3) + 0.0 for each in (pose.x, pose.y, pose.theta))
    return f"x {x:.3f} m  y {y:.3f} m  theta {theta:.3f} rad ({degrees(pose.theta)})"


def _twist(view: View) -> str:
    twist = view.twist
    if twist is None:
        return "unknown"
    vx, vy, wz = (round(each, 3) + 0.0 for each in (twist.vx, twist.vy, twist.wz))
    sideways = f"  vy {vy:.3f} m/s" if vy else ""
    return f"vx {vx:.3f} m/s{sideways}  wz {wz:.3f} rad/s"
