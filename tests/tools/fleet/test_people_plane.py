"""The people of a fleet at a robot of the bench, without a bus."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from daemon_samples import status
from robot_bench import RobotBench

from yahboomd.core.bus import keys
from yahboomd.core.bus.services import BusQuery, Response
from yahboomd.core.clock import SystemClock
from yahboomd.core.config import Config, read
from yahboomd.core.daemon.planes import PlaneRequests
from yahboomd.core.daemon.requests import Services
from yahboomd.core.messages.native import ServiceReply
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.fleet.people_keys import NAMED, claims_a_name, own_key, own_stop
from yahboomd.tools.fleet.people_plane import DriverWatch, PeoplePlane, people_of


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
    arguments: Any = (bus, Config(), SystemClock(), requests(bench), lambda _, call: call)
    return bus, plane.start(*arguments)


def asked(bench: RobotBench) -> list[Any]:
    return [event.data for event in bench.heard.events if event.kind == "asked_by_name"]


@on_virtual_time
async def test_each_person_has_a_key_of_every_service_that_changes_something(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        bus, _ = started(bench, "anna", "ben")
        assert [*bus.handlers] == [own_key(key, who) for who in ("anna", "ben") for key in NAMED]


@on_virtual_time
async def test_a_stop_and_its_release_by_a_persons_key_record_the_name(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus, _ = started(bench, "anna", "ben")
        # Whatever the payload claims: the key has the name.
        claim = b'{"by": "ben"}'
        assert (await bus.ask(own_key(keys.ESTOP, "anna"), claim))["success"]
        await bench.until(lambda: bench.controller.state()[0] == "estopped")
        why = bench.controller.state()[1]
        assert f"engaged by {own_stop('anna')}" in why
        assert not claims_a_name(why)
        assert (await bus.ask(own_key(keys.ESTOP_RESET, "ben")))["success"]
        await bench.until(lambda: bench.controller.state()[0] == "standing")
        assert (await bus.ask(own_key(keys.ODOMETRY_SET_POSE, "ben"), b'{"x": 1}'))["success"] is (
            False
        )
        assert asked(bench) == [
            {"name": "anna", "key": keys.ESTOP, "done": True},
            {"name": "ben", "key": keys.ESTOP_RESET, "done": True},
            {"name": "ben", "key": keys.ODOMETRY_SET_POSE, "done": False},
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
            {"name": "anna", "key": "cmd_vel/anna", "done": None},
            {"name": "", "key": "cmd_vel/teleop", "done": None},
            {"name": "", "key": None, "done": None},
        ]
        assert found[0].message == "anna has control, by a key of that person's own."


def test_people_are_those_with_a_source_at_a_robot_of_a_fleet() -> None:
    sources = 'command.sources={"cmd_vel/anna" = {}, "cmd_vel/web" = {}}'
    alone = read(None, environ={}, overrides=[sources]).config
    assert people_of(alone) == ()
    fleet = read(None, environ={}, overrides=[sources, 'estop.groups=["farm"]']).config
    assert people_of(fleet) == ("anna",)
