from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.core.errors import ConfigError
from yahboomd_fleet.fleet_plan import read_plan, stop_key

FARM = """
fleet = "farm"
router = "top.example:7447"
[sites.north]
router = "north.example:7447"
[sites.south]
router = "[fd00::1]:7447"
[robots.bot1]
site = "north"
address = "192.168.1.20:7449"
[robots.bot2]
site = "south"
[people.vera]
role = "viewer"
[people.olga]
role = "operator"
of = ["south", "north/bot1"]
[people.dan]
role = "driver"
of = ["north"]
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "fleet.toml"
    path.write_text(FARM)
    return path


def test_a_robots_place_gives_its_namespace_and_the_groups_that_stop_it(file: Path) -> None:
    plan = read_plan(file)
    assert plan.namespace("bot2") == "farm/south/bot2"
    assert plan.groups("bot2") == ("farm/south", "farm")
    assert [stop_key(each) for each in plan.groups("bot2")] == [
        "farm/south/yahboomd/estop",
        "farm/yahboomd/estop",
    ]
    assert plan.robots_at("north") == ["bot1"]


def test_a_role_extends_to_all_robots_or_to_the_named_sites_and_robots(file: Path) -> None:
    plan = read_plan(file)
    reached = {
        person: [robot for robot in plan.robots if plan.reaches(person, robot)]
        for person in plan.people
    }
    assert reached == {"vera": ["bot1", "bot2"], "olga": ["bot1", "bot2"], "dan": ["bot1"]}
    assert plan.places("vera") == ["farm"]
    assert plan.places("olga") == ["farm/south", "farm/north/bot1"]


def test_every_certificate_has_a_name_of_its_kind_and_the_hosts_at_which_it_is_reached(
    file: Path,
) -> None:
    assert read_plan(file).identities() == {
        "person.vera": (),
        "person.olga": (),
        "person.dan": (),
        "robot.bot1": ("192.168.1.20",),
        "robot.bot2": (),
        "router.north": ("north.example",),
        "router.south": ("fd00::1",),
        "router": ("top.example",),
    }


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('fleet = "farm"', "", "missing required field `fleet`"),
        ('role = "viewer"', 'role = "king"', "Invalid enum value 'king' - at `$.people"),
        ('role = "viewer"', 'rule = "viewer"', "unknown field `rule`"),
        ('fleet = "farm"', 'fleet = "Farm/1"', "'Farm/1' cannot be a name here"),
        ("[people.vera]", "[people.yahboomd]", "'yahboomd' cannot be a name here"),
        ("[people.vera]", "[people.web]", "people.web has the name of a source of every robot"),
        ('router = "top.example:7447"', "", "with several sites `router` has to name"),
        ('"north.example:7447"', '"north.example"', "sites.north.router = 'north.example' is not"),
        ('site = "south"', 'site = "west"', "robots.bot2 is at the site 'west'"),
        ("192.168.1.20:7449", "192.168.1.20:7448", "robots.bot1.address has the port 7448"),
        ('of = ["north"]', 'of = ["bot1"]', "people.dan.of has 'bot1', which is neither"),
        ("[people.vera]", "page = 'javascript:1'\n[people.vera]", "page is no address such as"),
        ('of = ["north"]', "of = []", "Expected `array` of length >= 1 - at `$.people"),
        ("[people.vera]", f"[people.{'v' * 51}]", "cannot be a name here: up to 50"),
        ("north.example:7447", "bücher.example:7447", "is not host:port"),
        ("north.example:7447", "north.example:7447#a=b", "is not host:port"),
        ("north.example:7447", "north.example:65536", "is not host:port"),
        ("192.168.1.20:7449", "192.168.1.20:07448", "robots.bot1.address has the port 7448"),
        ("north.example:7447", "TOP.example:7447", "is the address of router already"),
        ("[sites.north]", "[sites.north", "Expected ']'"),
    ],
)
def test_a_mistake_is_named_with_its_place(file: Path, old: str, new: str, words: str) -> None:
    assert FARM.count(old) == 1
    file.write_text(FARM.replace(old, new))
    with pytest.raises(ConfigError) as raised:
        read_plan(file)
    assert str(file) in str(raised.value)
    assert words in str(raised.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="No such file"):
        read_plan(tmp_path / "none.toml")
