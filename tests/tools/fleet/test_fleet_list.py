from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest

pytest.importorskip("cryptography")

from yahboomd.core.errors import ConfigError
from yahboomd.tools.fleet.fleet_files import FleetFolder
from yahboomd.tools.fleet.fleet_list import FleetList, read_list
from yahboomd.tools.fleet.fleet_plan import FleetPlan, PlannedPerson, PlannedRobot, PlannedSite

PLAN = FleetPlan(
    fleet="farm",
    router="top:1",
    sites={name: PlannedSite(router=f"{name}:1") for name in ("north", "south")},
    robots={
        "bot1": PlannedRobot(site="north"),
        "bot2": PlannedRobot(site="north"),
        "bot3": PlannedRobot(site="south"),
    },
    people={
        "vera": PlannedPerson(role="viewer"),
        "dan": PlannedPerson(role="driver", of=("south", "north/bot1")),
    },
)


@pytest.fixture
def folder(tmp_path: Path) -> FleetFolder:
    made = FleetFolder(tmp_path / "fleet", PLAN, datetime(2030, 1, 1, tzinfo=UTC))
    made.begin()
    made.write()
    return made


def test_a_persons_list_has_the_robots_of_the_role_and_every_way_to_them(
    folder: FleetFolder,
) -> None:
    assert read_list(folder.paths()["person.vera"]) == FleetList(
        person="vera",
        role="viewer",
        ways={"tls/top:1": ["farm"], "tls/north:1": ["farm/north"], "tls/south:1": ["farm/south"]},
        robots=["farm/north/bot1", "farm/north/bot2", "farm/south/bot3"],
    )
    assert read_list(folder.paths()["person.dan"]) == FleetList(
        person="dan",
        role="driver",
        ways={
            "tls/top:1": ["farm/south", "farm/north/bot1"],
            "tls/north:1": ["farm/north/bot1"],
            "tls/south:1": ["farm/south"],
        },
        robots=["farm/north/bot1", "farm/south/bot3"],
    )


def test_a_file_without_a_list_is_refused(folder: FleetFolder, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="lists no robots"):
        read_list(folder.paths()["robot.bot1"])
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        read_list(tmp_path / "none.json5")
    (tmp_path / "other.json5").write_text("{ mode: 'client' }")
    with pytest.raises(ConfigError, match="is no file of `yahboomd fleet`"):
        read_list(tmp_path / "other.json5")
