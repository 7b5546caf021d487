from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable

import msgspec
import pytest
from drawn_screen import lines, style_of
from fake_daemon import FakeDaemon
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.cli.main import main
from yahboomd_fleet.fleet_list import FleetList
from yahboomd_fleet.fleet_view import RobotRow
from yahboomd_fleet.fleet_watch import Changes, screen, status_of, watch

pytestmark = pytest.mark.realtime


def row(robot: str, needs: str = "", *, can_drive: bool = True, seen: bool = True) -> RobotRow:
    seen_s = 1.0 if seen else None
    return RobotRow(
        robot=robot, needs=needs, can_drive=can_drive, state="standing", why="", seen_s=seen_s
    )


GOOD, LOW = row("bot1"), row("bot2", "battery low")
STOPPED = row("bot3", "emergency stop", can_drive=False)
AWAY = row("bot4", "not reachable", can_drive=False, seen=False)


def test_the_exit_status_tells_whether_every_robot_can_drive() -> None:
    assert status_of([GOOD, LOW]) == os.EX_OK
    assert status_of([GOOD, STOPPED]) == 1
    assert status_of([GOOD, AWAY]) == 1
    assert status_of([AWAY]) == os.EX_UNAVAILABLE
    assert status_of([]) == os.EX_UNAVAILABLE


def test_a_change_of_need_state_or_driver_is_one_and_an_age_is_none() -> None:
    changes = Changes()
    assert changes.of([GOOD, STOPPED]) == [GOOD, STOPPED]
    older = msgspec.structs.replace(GOOD, seen_s=9.0, volts=11.0)
    assert changes.of([older, STOPPED]) == []
    for changed in (
        msgspec.structs.replace(GOOD, driver="cmd_vel"),
        msgspec.structs.replace(GOOD, driver="cmd_vel", state="driving"),
        msgspec.structs.replace(GOOD, driver="cmd_vel", state="driving", needs="battery low"),
    ):
        assert changes.of([changed]) == [changed]


def test_a_screen_shows_those_that_need_somebody_and_how_many_it_has_no_room_for() -> None:
    many = [STOPPED, AWAY, *(row(f"good{number:02}") for number in range(50))]
    drawn = screen(many, 0, height=10)
    shown = lines(drawn, width=120, height=10)
    assert shown[0].startswith("52 robots; 2 need somebody: 1 emergency stop, 1 not reachable.")
    assert shown[2].startswith("bot3")
    assert shown[9].strip() == "and 45 more, of which 0 need somebody"
    assert "red" in style_of("bot3", drawn)
    assert "green" in style_of("good00", drawn)


async def test_it_prints_a_line_for_each_change_until_it_is_ended(
    fake_daemon: Callable[..., Awaitable[FakeDaemon]], capsys: pytest.CaptureFixture[str]
) -> None:
    daemon = await fake_daemon(namespace="bot1")
    fleet = FleetList(person="", role="viewer", ways={daemon.endpoint: [""]}, robots=[])
    task = asyncio.create_task(watch(fleet, None, within_s=0.0, endless=True, as_json=True))
    printed = ""

    def came(word: str) -> bool:
        nonlocal printed
        printed += capsys.readouterr().out
        return word in printed

    await eventually(lambda: came('"state":"standing"'))
    daemon.status = msgspec.structs.replace(daemon.status, state="fault", why="A wheel.")
    await eventually(lambda: came('"needs":"fault"'))
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert all(msgspec.json.decode(each)["robot"] == "bot1" for each in printed.splitlines())


def test_without_any_robot_the_command_ends_with_69(capsys: pytest.CaptureFixture[str]) -> None:
    nowhere = free_endpoint()
    assert main(["fleet", "status", "--connect", nowhere, "--timeout", "0.1"]) == 69
    assert capsys.readouterr().out == "No robot.\n"
