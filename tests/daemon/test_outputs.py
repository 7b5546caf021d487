"""Events on their way out, on virtual time."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from pathlib import Path

import pytest
from robot_bench import Heard, RobotBench

from yahboomd.clock import LoopClock
from yahboomd.daemon.outputs import EVENTS_A_SECOND, Events
from yahboomd.messages.event_kinds import KINDS
from yahboomd.model import Event, EventKind
from yahboomd.simulation.virtual_time import on_virtual_time


def event(kind: EventKind = "board_reset") -> Event:
    return Event(kind=kind, severity=KINDS[kind].severities[0], message=f"{kind} it is.")


class Gate:
    """The gate, and what came through."""

    def __init__(self) -> None:
        self.heard = Heard()
        self.counters: Counter[str] = Counter()
        self.events = Events(LoopClock(), self.heard, self.counters)


@on_virtual_time
async def test_a_flood_of_one_kind_of_event_is_bounded_and_counted(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        for _ in range(1000):
            bench.operator.refuse_release("a flood")
        await asyncio.sleep(1.1)
        bench.operator.refuse_release("a flood")
        assert bench.heard.kinds.count("estop_release_refused") == 6
        assert bench.controller.counters["events_suppressed"] == 995


@on_virtual_time
async def test_a_flood_of_one_kind_keeps_no_other_kind_back() -> None:
    gate = Gate()
    for _ in range(100):
        gate.events.tell(event("board_reset"))
    gate.events.tell(event("disconnected"))
    assert gate.heard.kinds == ["board_reset"] * EVENTS_A_SECOND + ["disconnected"]
    assert gate.counters == {"events": 6, "events_suppressed": 95}


@on_virtual_time
async def test_after_a_second_a_kind_is_told_again() -> None:
    gate = Gate()
    for _ in range(EVENTS_A_SECOND + 1):
        gate.events.tell(event())
    await asyncio.sleep(0.9)
    gate.events.tell(event())
    assert len(gate.heard.events) == EVENTS_A_SECOND
    await asyncio.sleep(0.2)
    gate.events.tell(event())
    assert len(gate.heard.events) == EVENTS_A_SECOND + 1


@on_virtual_time
async def test_an_event_is_logged_as_grave_as_it_is(caplog: pytest.LogCaptureFixture) -> None:
    gate = Gate()
    with caplog.at_level(logging.INFO):
        for kind in ("connected", "board_reset", "disconnected"):
            gate.events.tell(event(kind))
    assert [record.levelname for record in caplog.records] == ["INFO", "WARNING", "ERROR"]
    assert caplog.records[0].getMessage() == "connected it is."
    assert gate.heard.changes == 3
