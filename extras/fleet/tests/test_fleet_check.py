from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest

from yahboomd.core.errors import ConfigError
from yahboomd_fleet.fleet_check import check, full_name
from yahboomd_fleet.fleet_files import FleetFolder
from yahboomd_fleet.fleet_plan import FleetPlan, PlannedPerson, PlannedRobot, PlannedSite

PLAN = FleetPlan(
    fleet="farm",
    router="top.example:7447",
    sites={"north": PlannedSite(router="north.example:7447")},
    robots={
        "bot1": PlannedRobot(site="north", address="192.168.1.20:7449"),
        "north": PlannedRobot(site="north"),
    },
    people={"vera": PlannedPerson(role="viewer"), "dan": PlannedPerson(role="driver", of=())},
)
WATCHES = ("watch", "ask", "stop")
DRIVES = (*WATCHES, "drive", "move", "hold a move")


@pytest.fixture
def folder(tmp_path: Path) -> FleetFolder:
    made = FleetFolder(tmp_path / "fleet", PLAN, datetime(2030, 1, 1, tzinfo=UTC))
    made.begin()
    made.write()
    return made


def test_rights_are_read_from_the_files_on_each_way(folder: FleetFolder) -> None:
    ways = {"by the router above", "by the site's router"}
    for name, rights in (("person.vera", WATCHES), ("person.dan", DRIVES)):
        found = check(folder, PLAN, folder.paths()[name])
        assert found.name == name
        assert found.by_way == {
            "bot1": dict.fromkeys({*ways, "directly"}, rights),
            "north": dict.fromkeys(ways, rights),
        }


def test_a_robots_certificate_has_no_right_at_another_robot(folder: FleetFolder) -> None:
    found = check(folder, PLAN, folder.paths()["robot.bot1"])
    assert set(found.by_way["north"].values()) == {()}
    assert "drive" in found.by_way["bot1"]["by the site's router"]


def test_a_rule_that_a_person_took_out_of_a_file_is_missed(folder: FleetFolder) -> None:
    path = folder.paths()["router.north"]
    path.write_text(path.read_text().replace('"cmd_vel', '"cmd').replace("/cmd_vel", "/cmd"))
    found = check(folder, PLAN, folder.paths()["person.dan"]).by_way["bot1"]
    assert "drive" not in found["by the site's router"]
    assert "drive" in found["directly"]


def test_a_name_is_completed_if_one_certificate_has_it(folder: FleetFolder) -> None:
    assert full_name(PLAN, "vera") == "person.vera"
    assert full_name(PLAN, "router") == "router"
    assert full_name(PLAN, "router.north") == "router.north"
    with pytest.raises(ConfigError, match=r"Name one: robot\.north, router\.north"):
        full_name(PLAN, "north")
    with pytest.raises(ConfigError, match="Nobody in this fleet is called 'eve'"):
        full_name(PLAN, "eve")
