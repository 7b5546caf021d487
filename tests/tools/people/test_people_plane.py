"""The people of a fleet at a robot of the bench, without a bus."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from daemon_samples import status
from robot_bench import RobotBench, state_and_why

from yahboomd.core.bus import keys
from yahboomd.core.bus.keys import own_key
from yahboomd.core.bus.services import BusQuery, Response
from yahboomd.core.config import Config, read
from yahboomd.core.daemon.planes import PlaneRequests
from yahboomd.core.daemon.requests import Services
from yahboomd.core.messages.native import ServiceReply
from yahboomd.core.model import Event
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.tools.people.people_keys import claims_a_name, own_stop
from yahboomd.tools.people.people_plane import DriverWatch, PeoplePlane, RequestsByName, people_of


class Offers:
    """Takes the place of the bus, and keeps what is offered."""

    def __init__(self) -> None:
        self.handlers: dict[str, Callable[[BusQuery], Response | Awaitable[Response]]] = {}

    def serve(self, key: str, handler: Any, **_: Any) -> None:
        self.handlers[key] = handler

    async def ask(self, key: str, payload: bytes = b"", *, harmless: bool = False) -> Any:
        asked = BusQuery(
            key=key,
            selector=key,
            payload=payload,
            encoding="",
            attachment=None,
            arrived_ns=0,
            harmless=harmless,
        )
        response = self.handlers[key](asked)
        answer = response if isinstance(response, Response) else await response
        return json.loads(answer.payload)


async def saved() -> ServiceReply:
    return ServiceReply(success=True, message="Saved.")


def requests(bench: RobotBench) -> PlaneRequests:
    services = Services(
        bench.operator,
        encoding="json",
        config=dict,
        board=dict,
        newest=lambda _: None,
        save_box=saved,
    )
    return PlaneRequests(services, bench.intake.handler, lambda _: None, bench.controller.event)


def started(bench: RobotBench, *people: str) -> tuple[Offers, DriverWatch]:
    bus, plane = Offers(), PeoplePlane(people)
    arguments: Any = (bus, Config(), bench.clock, requests(bench), lambda _, call: call)
    return bus, plane.start(*arguments)


def asked(bench: RobotBench) -> list[Any]:
    return [event.data for event in bench.heard.events if event.kind == "asked_by_name"]


@on_virtual_time
async def test_a_stop_and_its_release_by_a_persons_key_record_the_name(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus, _ = started(bench, "anna", "ben")
        # Whatever the payload claims: the key has the name.
        claim = b'{"by": "ben"}'
        assert (await bus.ask(own_key(keys.ESTOP, "anna"), claim))["success"]
        await bench.until(lambda: bench.controller.state()[0] == "estopped")
        why = state_and_why(bench.controller)[1]
        assert f"engaged by {own_stop('anna')}" in why
        assert not claims_a_name(why)
        assert (await bus.ask(own_key(keys.ESTOP_RESET, "ben")))["success"]
        await bench.until(lambda: bench.controller.state()[0] == "standing")
        assert (await bus.ask(own_key(keys.ODOMETRY_SET_POSE, "ben"), b'{"x": 1}'))["success"] is (
            False
        )
        assert asked(bench) == [
            {"name": "anna", "key": keys.ESTOP, "done": True, "times": 1},
            {"name": "ben", "key": keys.ESTOP_RESET, "done": True, "times": 1},
            {"name": "ben", "key": keys.ODOMETRY_SET_POSE, "done": False, "times": 1},
        ]


@on_virtual_time
async def test_a_query_that_would_release_by_the_stops_key_engages_and_releases_nothing(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus, _ = started(bench, "anna")
        key = own_key(keys.ESTOP, "anna")
        answer = await bus.ask(key, b'{"engaged": false}', harmless=True)
        assert not answer["success"]
        assert bench.controller.state()[0] == "standing"


@on_virtual_time
async def test_each_change_of_the_driver_is_an_event_and_each_command_is_none(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        _, watch = started(bench, "anna")
        for driver in (None, "cmd_vel/anna", "cmd_vel/anna", "cmd_vel/teleop", None, None):
            watch.status(status(driver=driver))
        found = [event for event in bench.heard.events if event.kind == "driver_changed"]
        assert [event.data for event in found] == [
            {"name": "anna", "key": "cmd_vel/anna", "done": None, "times": None},
            {"name": "", "key": "cmd_vel/teleop", "done": None, "times": None},
            {"name": "", "key": None, "done": None, "times": None},
        ]
        assert found[0].message == "anna has control, by a key of that person's own."


@on_virtual_time
async def test_a_flood_of_requests_becomes_an_event_in_ten_seconds_and_each_is_counted() -> None:
    events: list[Event] = []
    record = RequestsByName(events.append, LoopClock())
    nothing: Any = None
    watch = DriverWatch(PlaneRequests(nothing, nothing, nothing, events.append), record)
    refusal = ServiceReply(success=False, message="No.")
    for second in range(20):
        for _ in range(40):
            record.note("anna", keys.ODOMETRY_SET_POSE, refusal)
        if second == 5:
            record.note("ben", keys.ODOMETRY_SET_POSE, refusal)
        await asyncio.sleep(1.0)
    # Nobody else's request waits for hers.
    data: list[Any] = [event.data for event in events]
    found = [(each["name"], each["times"]) for each in data]
    assert found == [("anna", 1), ("ben", 1), ("anna", 399)]
    asked_often = f"anna asked for {keys.ODOMETRY_SET_POSE} 399 times, the last answer: No."
    assert events[2].message == asked_often
    # The rest comes with the status, although nobody asks any more.
    watch.status(status(driver=None))
    assert events[3].data == {
        "name": "anna",
        "key": keys.ODOMETRY_SET_POSE,
        "done": False,
        "times": 400,
    }
    await asyncio.sleep(10.0)
    watch.status(status(driver=None))
    assert len(events) == 4
    record.note("anna", keys.ODOMETRY_SET_POSE, refusal)
    assert events[4].data == {**data[0], "times": 1}


def test_people_are_those_with_a_source_at_a_robot_of_a_fleet() -> None:
    sources = 'command.sources={"cmd_vel/anna" = {}, "cmd_vel/web" = {}}'
    alone = read(None, environ={}, overrides=[sources]).config
    assert people_of(alone) == ()
    fleet = read(None, environ={}, overrides=[sources, 'estop.groups=["farm"]']).config
    assert people_of(fleet) == ("anna",)
