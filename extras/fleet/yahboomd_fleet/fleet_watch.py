"""Prints the robots of a fleet: once, as lines while something changes, or as a screen."""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

import msgspec

from yahboomd.core.clock import SystemClock, timeout

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import RenderableType

    from yahboomd.core.clock import Clock
    from yahboomd_fleet.fleet_feed import FleetFeed
    from yahboomd_fleet.fleet_list import FleetList
    from yahboomd_fleet.fleet_view import RobotRow

SOME_CANNOT = 1
"""The exit status if some robot cannot drive."""

REDRAW_S = 0.5

STYLES = {"": "green", "battery low": "yellow", "no board": "yellow", "not reachable": "yellow"}
"""The colour of a need; of any other red."""


async def watch(
    fleet: FleetList,
    papers: Path | None,
    *,
    within_s: float,
    endless: bool = False,
    as_json: bool = False,
) -> int:
    """Print the robots; ``endless`` until cancelled, else once all answered or the time is over.

    Returns:
        The exit status: 0 if every robot can drive; 69 if none answered.

    Raises:
        BusError: The papers cannot be used.
    """
    from yahboomd_fleet.fleet_feed import FleetFeed
    from yahboomd_fleet.fleet_view import FleetView

    clock = SystemClock()
    feed = FleetFeed(fleet, papers, FleetView(fleet.robots), clock)
    running = asyncio.create_task(feed.run(), name="fleet-feed")
    shown = asyncio.create_task(
        _endless(feed, clock, as_json=as_json) if endless else _once(feed, fleet, within_s)
    )
    try:
        await asyncio.wait((running, shown), return_when=asyncio.FIRST_COMPLETED)
        for task in (running, shown):
            if task.done():
                task.result()
    finally:
        for task in (running, shown):
            task.cancel()
        await asyncio.gather(running, shown, return_exceptions=True)
    rows = feed.view.rows(clock.now_ns())
    if not endless:
        print(as_text(rows, feed.view.left_out, as_json=as_json), flush=True)
    return status_of(rows)


def status_of(rows: Iterable[RobotRow]) -> int:
    """The exit status that these rows mean."""
    rows = tuple(rows)
    if not any(row.seen_s is not None for row in rows):
        return os.EX_UNAVAILABLE
    return os.EX_OK if all(row.can_drive for row in rows) else SOME_CANNOT


def as_text(rows: list[RobotRow], left_out: int, *, as_json: bool) -> str:
    """All rows: as a JSON array, or as a table below a summary."""
    from yahboomd_fleet.fleet_words import summary, table

    if as_json:
        return msgspec.json.encode(rows).decode()
    return "\n".join((summary(rows, left_out), *(table(rows) if rows else ())))


class Changes:
    """Finds the rows that changed in a way that concerns a person."""

    def __init__(self) -> None:
        self._printed: dict[str, tuple[object, ...]] = {}

    def of(self, rows: Iterable[RobotRow]) -> list[RobotRow]:
        """The rows whose need, state or driver differs from the last call."""
        found = []
        for row in rows:
            facts = (row.needs, row.state, row.driver)
            if self._printed.get(row.robot) != facts:
                self._printed[row.robot] = facts
                found.append(row)
        return found


def screen(rows: list[RobotRow], left_out: int, *, height: int) -> RenderableType:
    """As many rows as the height has room for: those that need somebody come first."""
    from rich.console import Group

    from yahboomd.tools.screens.drawing import QUIET, line
    from yahboomd_fleet.fleet_words import summary, table

    head, *lines = table(rows)
    room = max(1, height - 3)
    shown = [
        line((words, STYLES.get(row.needs, "red"))) for words, row in zip(lines, rows, strict=True)
    ][:room]
    hidden = rows[room:]
    if hidden:
        needy = sum(1 for row in hidden if row.needs)
        shown.append(line((f"and {len(hidden)} more, of which {needy} need somebody", QUIET)))
    return Group(line((summary(rows, left_out), "bold")), line((head, QUIET)), *shown)


async def _once(feed: FleetFeed, fleet: FleetList, within_s: float) -> None:
    with suppress(TimeoutError):
        async with timeout(within_s):
            # Without a list nobody knows who is missing.
            while not (fleet.robots and feed.is_complete()):
                feed.news.clear()
                await feed.news.wait()


async def _endless(feed: FleetFeed, clock: Clock, *, as_json: bool) -> None:
    if not as_json and sys.stdout.isatty() and os.environ.get("TERM", "dumb") != "dumb":
        await _on_screen(feed, clock)
        return
    from yahboomd_fleet.fleet_words import one_line

    changes = Changes()
    while True:
        feed.news.clear()
        for row in changes.of(feed.view.rows(clock.now_ns())):
            words = msgspec.json.encode(row).decode()
            print(words if as_json else f"{time.strftime('%H:%M:%S')} {one_line(row)}", flush=True)
        await _pause(feed.news)


async def _on_screen(feed: FleetFeed, clock: Clock) -> None:
    from yahboomd.tools.screens.drawing import Screen
    from yahboomd.tools.screens.keyboard import Keys
    from yahboomd.tools.screens.teleop import wish

    ended = asyncio.Event()

    def pressed(key: str) -> None:
        if wish(key) == "quit":
            ended.set()

    with ExitStack() as stack:
        if sys.stdin.isatty():
            # This also keeps typed keys from appearing among the rows.
            stack.enter_context(Keys(sys.stdin.fileno(), pressed, ended.set))
        drawn = stack.enter_context(Screen(sys.stdout.fileno(), ended.set))
        while not ended.is_set():
            rows = feed.view.rows(clock.now_ns())
            drawn.draw(screen(rows, feed.view.left_out, height=drawn.size[1]))
            await _pause(ended)


async def _pause(event: asyncio.Event) -> None:
    """Wait for an event, at most until the next look."""
    with suppress(TimeoutError):
        async with timeout(REDRAW_S):
            await event.wait()
