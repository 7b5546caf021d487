from __future__ import annotations

import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import msgspec
import pytest
from ruamel.yaml import YAML

from yahboomd.core.config import Config
from yahboomd.core.config import read as read_config
from yahboomd_fleet.authority import end_of, name_in
from yahboomd_fleet.fleet_files import FleetFolder, identity_in, rules_in
from yahboomd_fleet.fleet_list import read_zenoh
from yahboomd_fleet.fleet_plan import FleetPlan, PlannedPerson, PlannedRobot, PlannedSite
from yahboomd_fleet.fleet_rules import is_allowed

NOW = datetime(2030, 1, 1, tzinfo=UTC)
PLAN = FleetPlan(
    fleet="farm",
    router="top.example:7447",
    sites={name: PlannedSite(router=f"{name}.example:7447") for name in ("north", "south")},
    robots={
        "bot1": PlannedRobot(site="north", address="192.168.1.20:7449"),
        "bot2": PlannedRobot(site="south"),
    },
    people={
        "vera": PlannedPerson(role="viewer"),
        "dan": PlannedPerson(role="driver", of=("north",)),
    },
)
ALL = {
    "router.json5",
    "routers/north.json5",
    "routers/south.json5",
    "robots/bot1.json5",
    "robots/bot2.json5",
    "robots/bot1.toml",
    "robots/bot2.toml",
    "people/vera.json5",
    "people/dan.json5",
}


def folder(path: Path, plan: FleetPlan = PLAN, now: datetime = NOW) -> FleetFolder:
    return FleetFolder(path / "fleet", plan, now)


@pytest.fixture
def made(tmp_path: Path) -> FleetFolder:
    fleet = folder(tmp_path)
    fleet.begin()
    assert names(fleet, fleet.write()) == ALL
    return fleet


def names(fleet: FleetFolder, paths: list[Path]) -> set[str]:
    return {str(each.relative_to(fleet.folder)) for each in paths}


def subjects(fleet: FleetFolder, name: str) -> set[str]:
    rules = rules_in(read_zenoh(fleet.folder / name))
    return {each["id"] for each in rules["subjects"]}


def test_every_file_is_for_its_owner_alone_and_the_authoritys_key_is_in_none_of_them(
    made: FleetFolder,
) -> None:
    key = (made.folder / "authority.key").read_text()
    for path in made.folder.rglob("*"):
        allowed = 0o700 if path.is_dir() else 0o600
        assert stat.S_IMODE(path.stat().st_mode) == allowed, path
        if path.is_file() and path.name != "authority.key":
            content = path.read_text()
            assert key not in content
    for path in made.paths().values():
        assert identity_in(read_zenoh(path)).key.decode() != key


def test_each_file_has_the_certificate_of_its_name_and_closes_links_as_it_ends(
    made: FleetFolder,
) -> None:
    for name, path in made.paths().items():
        file = read_zenoh(path)
        assert name_in(identity_in(file).certificate) == name
        assert file["transport"]["link"]["tls"]["close_link_on_expiration"] is True


def test_a_robots_settings_are_valid_and_name_its_place_and_its_router(
    made: FleetFolder,
) -> None:
    def settings(robot: str) -> Config:
        file = made.folder / "robots" / f"{robot}.toml"
        # The file of Zenoh's lies beside it here.
        place = f"zenoh.config={file.with_suffix('.json5')}"
        return read_config(file, environ={}, overrides=[place]).config

    assert settings("bot1").estop.groups == ("farm/north", "farm")
    found = settings("bot1").zenoh
    assert found.namespace == "farm/north/bot1"
    assert found.connect == ("tls/north.example:7447",)
    assert found.listen == ("tcp/127.0.0.1:7448", "tls/0.0.0.0:7449")
    assert settings("bot2").zenoh.listen == ("tcp/127.0.0.1:7448",)
    # The usual sources stay, and whoever may drive this robot has one, with the role's priority.
    usual = {key: source.priority for key, source in Config().command.sources.items()}
    for robot, own in (("bot1", {"cmd_vel/dan": 60}), ("bot2", {})):
        sources = settings(robot).command.sources
        assert {key: source.priority for key, source in sources.items()} == usual | own


def test_the_inventory_lists_robots_by_site_and_routers_with_their_files_and_no_revoked_one(
    made: FleetFolder,
) -> None:
    def listed() -> Any:
        file = made.folder / "inventory.yml"
        return YAML(typ="safe").load(file.read_text())["all"]["children"]

    assert listed()["robots"]["children"] == {
        "site_north": {"hosts": {"bot1": {"ansible_host": "192.168.1.20"}}},
        "site_south": {"hosts": {"bot2": {}}},
    }
    routers = listed()["routers"]["hosts"]
    assert routers["router.north"] == {
        "ansible_host": "north.example",
        "zenohd_from": "routers/north.json5",
        "zenohd_port": 7447,
    }
    assert set(routers) == {"router.north", "router.south", "above.router"}
    assert all((made.folder / each["zenohd_from"]).exists() for each in routers.values())
    made.revoke("robot.bot1")
    made.revoke("router.south")
    made.write()
    assert set(listed()["robots"]["children"]) == {"site_south"}
    assert set(listed()["routers"]["hosts"]) == {"router.north", "above.router"}


def test_adding_writes_the_files_that_are_new_or_whose_rules_changed(
    made: FleetFolder, tmp_path: Path
) -> None:
    assert made.write() == []
    more = msgspec.structs.replace(
        PLAN, people={**PLAN.people, "olga": PlannedPerson(role="operator", of=("north",))}
    )
    grown = folder(tmp_path, more)
    # The router of the other site and its robot do not know her. A source of her own is new.
    assert names(grown, grown.write()) == {
        "robots/bot1.toml",
        "people/olga.json5",
        "router.json5",
        "routers/north.json5",
        "robots/bot1.json5",
    }


def test_a_renewed_certificate_is_new_and_changes_no_other_file(
    made: FleetFolder, tmp_path: Path
) -> None:
    later = folder(tmp_path, now=NOW + timedelta(days=70))
    assert set(later.ending(timedelta(days=19))) == set()
    assert set(later.ending(timedelta(days=21))) == set(made.paths())
    before = identity_in(read_zenoh(made.folder / "robots/bot1.json5"))
    assert names(later, later.write(renewed=["robot.bot1"])) == {"robots/bot1.json5"}
    after = identity_in(read_zenoh(made.folder / "robots/bot1.json5"))
    assert end_of(after.certificate) - end_of(before.certificate) == timedelta(days=70)
    assert after.key != before.key


def test_a_revoked_certificate_is_in_no_rule_and_the_files_that_had_it_are_listed(
    made: FleetFolder,
) -> None:
    files = ("router.json5", "routers/north.json5", "robots/bot1.json5")
    assert all("person.dan" in subjects(made, name) for name in files)
    revoked = made.revoke("person.dan")
    assert revoked.until == NOW + timedelta(days=90)
    assert names(made, made.write()) == set(files)
    for path in made.folder.rglob("*.json5"):
        assert "person.dan" not in path.read_text(), path
    assert not (made.folder / "people/dan.json5").exists()
    assert made.write() == []


def test_a_site_called_all_gives_its_people_no_right_at_another_site(tmp_path: Path) -> None:
    fleet = folder(
        tmp_path,
        msgspec.structs.replace(
            PLAN,
            sites={"all": PLAN.sites["north"], "south": PLAN.sites["south"]},
            robots={"bot1": PlannedRobot(site="all"), "bot2": PlannedRobot(site="south")},
            people={
                "vera": PlannedPerson(role="driver"),
                "dan": PlannedPerson(role="driver", of=("all",)),
            },
        ),
    )
    fleet.begin()
    fleet.write()
    rules = rules_in(read_zenoh(fleet.folder / "router.json5"))
    for name, allowed in (("vera", True), ("dan", False)):
        who, key = f"person.{name}", f"cmd_vel/{name}"
        assert is_allowed(rules, who, "put", f"farm/south/bot2/{key}", "ingress") is allowed
        assert is_allowed(rules, who, "put", f"farm/all/bot1/{key}", "ingress")


def test_an_interrupted_run_is_made_whole_by_a_second_one(tmp_path: Path) -> None:
    fleet = folder(tmp_path)
    fleet.begin()
    # As if the power went between the authority's two files.
    (fleet.folder / "authority.key").unlink()
    fleet.begin()

    def interrupt(path: Path) -> None:
        told.append(path)
        if len(told) == 2:
            raise KeyboardInterrupt

    told: list[Path] = []
    with pytest.raises(KeyboardInterrupt):
        fleet.write(tell=interrupt)
    assert names(fleet, told[:1] + fleet.write()) == ALL
    first, told = fleet.revoke("person.dan"), []
    with pytest.raises(KeyboardInterrupt):
        fleet.write(tell=interrupt)
    assert fleet.revoke("person.dan") == first
    assert fleet.revoked() == [first]
    assert names(fleet, told[:1] + fleet.write()) == {
        "router.json5",
        "routers/north.json5",
        "robots/bot1.json5",
    }
