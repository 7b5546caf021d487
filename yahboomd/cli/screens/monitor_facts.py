"""Sentences about a daemon that both forms of the monitor say. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from yahboomd.cli.screens.view import Count, View
from yahboomd.cli.words import duration, rate
from yahboomd.program import pasteable


def driver(view: View) -> str:
    """Who drives, and since when."""
    status = view.status
    if status is None or status.driver is None:
        return "no source has control"
    over = "over " if view.driver_at_least else ""
    return f"{status.driver} has control for {over}{duration(view.driver_s)}"


def lost_sight(view: View) -> str:
    """What a person may have to do when the daemon falls silent; empty where nothing moved."""
    if view.status is None or view.status.state not in {"driving", "stopping"}:
        return ""
    return pasteable(
        f"It was {view.status.state}: if the wheels still turn, run `yahboomd stop` on the robot, "
        "or switch the motors' supply off."
    )


def board(view: View) -> str:
    """Which board is connected, and where."""
    facts: Mapping[str, Any] = {} if view.status is None else view.status.board
    if "dialect" not in facts:
        return "no board"
    version = facts.get("version")
    firmware = f" {version}" if version else ""
    return f"{facts['dialect']}{firmware} on {facts.get('port', '?')}"


def supply(view: View) -> str:
    """The battery."""
    return "battery unknown" if view.volts is None else f"battery {view.volts:.1f} V"


def link(view: View) -> str:
    """How often the board is heard."""
    return rate(view.readings_per_s, "readings")


def traffic(view: View) -> str:
    """What goes over the bus, in and out."""
    return f"{rate(view.commands_per_s, 'commands')} · {rate(view.poses_per_s, 'poses')}"


def routers(view: View) -> str:
    """Whom the daemon is connected to."""
    facts: Mapping[str, Any] = {} if view.status is None else view.status.bus
    joined = facts.get("routers")
    if joined:
        names = joined if isinstance(joined, str) else ", ".join(joined)
        return f"joined the router {names}"
    count = facts.get("neighbours")
    return "joined no router" + (f" · {count} connected" if isinstance(count, int) else "")


def counts(found: Sequence[Count], nothing: str) -> str:
    """Troubles that were counted, or that there are none."""
    return " · ".join(f"{count.name} {count.total}" for count in found) or nothing
