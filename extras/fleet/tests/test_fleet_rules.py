"""Every role against every robot, with the files as written, on real routers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import product

import pytest
import zenoh
from fleet_bench import LATE, ROBOTS, FleetBench, heard_of
from real_robot import wait_for
from zenoh.handlers import Callback
from zenoh_fixtures import PATIENCE_S

from yahboomd.client import AsyncRobot, connect
from yahboomd_fleet.fleet_rules import is_allowed

pytestmark = pytest.mark.realtime

STOP = {"yahboomd/estop"}
ASK = {f"yahboomd/{each}" for each in ("pose", "twist", "wheels", "imu", "battery", "status")} | {
    "yahboomd/moves"
}
DRIVE = {"yahboomd/moves/beat"}
MOVE = {f"yahboomd/moves/{each}" for each in ("start", "cancel", "pause", "resume")}
SET = {"yahboomd/estop/reset", "yahboomd/odometry/reset", "yahboomd/odometry/set_pose"}
READ = {"yahboomd/config", "yahboomd/board", "yahboomd/blackbox/save"}
OTHERS = {f"cmd_vel/{each}" for each in ("moves", "nav", "teleop", "web")} | {
    "cmd_vel",
    "odom",
    "yahboomd/alive",
}
"""Keys that are no person's."""

PUTS = {
    "viewer": STOP,
    "driver": STOP | DRIVE,
    "operator": STOP | DRIVE | SET,
    "maintainer": STOP | DRIVE | SET,
}
QUERIES = {
    "viewer": STOP | ASK,
    "driver": STOP | ASK | MOVE,
    "operator": STOP | ASK | MOVE | SET,
    "maintainer": STOP | ASK | MOVE | SET | READ,
}
OWN_SET = {f"{key}/by/" for key in SET}
OWN = {"cmd_vel/", "yahboomd/estop/by/"} | OWN_SET
"""Keys that end in a name."""
OWN_PUTS = {
    "viewer": {"yahboomd/estop/by/"},
    "driver": {"yahboomd/estop/by/", "cmd_vel/"},
    "operator": OWN,
    "maintainer": OWN,
}

PEOPLE = {
    "vera": ("viewer", {"bot1", "bot2", "bot3"}),
    "dan": ("driver", {"bot1", "bot2"}),
    "olga": ("operator", {"bot1", "bot3"}),
    "max": ("maintainer", {"bot1", "bot2", "bot3"}),
}
ALL_KEYS = STOP | ASK | DRIVE | MOVE | SET | READ | OTHERS
ALL_KEYS |= {key + who for key, who in product(OWN, PEOPLE)}
BEHIND = {"top": set(ROBOTS), "north": {"bot1", "bot2"}, "bot1": {"bot1"}}
"""The robots that each place leads to: through two routers, through one, and directly."""


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FleetBench]:
    bench = FleetBench(tmp_path_factory.mktemp("fleet"))
    try:
        bench.start()
        bench.settled()
        yield bench
    finally:
        bench.close()


def try_everything(fleet: FleetBench, file: str, where: str) -> None:
    """Send each kind of message on each key of each robot; return when they have passed."""
    with fleet.person(file, where) as session:
        zid = str(session.zid())
        for name, key in product(ROBOTS, sorted(ALL_KEYS)):
            full = f"{ROBOTS[name]}/{key}"
            session.put(full, f"put {file} {where}")
            session.get(full, Callback(lambda _: None), payload=f"get {file} {where}")
        own = f"cmd_vel/{file.rpartition(chr(47))[2]}"
        for key in ("cmd_vel", own, "yahboomd/estop/reset", "yahboomd/odometry/set_pose"):
            for wild in (f"farm/*/*/{key}", f"farm/**/{key}", "**"):
                session.put(wild, f"wild {file} {where}")
                session.get(wild, Callback(lambda _: None), payload=f"wild {file} {where}")
    fleet.gone(where, zid)
    fleet.flushed(f"flush {file} {where}", where)


@pytest.mark.cases(4)
@pytest.mark.parametrize("where", BEHIND)
@pytest.mark.parametrize("person", PEOPLE)
def test_a_person_reaches_the_keys_of_the_role_at_the_robots_of_the_role_and_no_others(
    fleet: FleetBench, person: str, where: str
) -> None:
    role, mine = PEOPLE[person]
    own = {key + person for key in OWN_PUTS[role]}
    file = f"people/{person}"
    try_everything(fleet, file, where)
    for name, robot in fleet.robots.items():
        reached = name in mine & BEHIND[where]
        # From a site to another one stops pass, and nothing else.
        far = STOP if name in mine and where == "north" else set()
        assert heard_of(robot, f"put {file} {where}") == (PUTS[role] | own if reached else far)
        assert heard_of(robot, f"get {file} {where}") == (
            QUERIES[role] | own - {f"cmd_vel/{person}"} if reached else far
        )
        assert heard_of(robot, f"wild {file} {where}") == set()


@pytest.mark.cases(1)
@pytest.mark.parametrize("where", BEHIND)
def test_a_robots_certificate_reaches_no_other_robot(fleet: FleetBench, where: str) -> None:
    try_everything(fleet, "robots/bot2", where)
    for name, robot in fleet.robots.items():
        if name == "bot2" and where == "north":
            continue
        for how in ("put", "get", "wild"):
            assert heard_of(robot, f"{how} robots/bot2 {where}") == set()


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("key", "stopped"),
    [
        ("farm/yahboomd/estop", {"bot1", "bot2", "bot3"}),
        ("farm/north/yahboomd/estop", {"bot1", "bot2"}),
        ("farm/*/*/yahboomd/estop", {"bot1", "bot2", "bot3"}),
        ("farm/**/yahboomd/estop", {"bot1", "bot2", "bot3"}),
        ("farm/north/*/yahboomd/estop", {"bot1", "bot2"}),
    ],
)
def test_everybodys_stop_of_a_group_reaches_its_robots_as_a_sample_and_as_a_query(
    fleet: FleetBench, key: str, stopped: set[str]
) -> None:
    for how in ("put", "get"):
        word = f"group {how} {key}"
        with fleet.person("people/vera", "top") as session:
            if how == "put":
                session.put(key, word)
            else:
                session.get(key, Callback(lambda _: None), payload=word)
            wait_for(
                lambda: all((key, word) in fleet.robots[name].heard for name in stopped),  # noqa: B023
                "they are stopped",
            )
        fleet.flushed(f"flush {word}", "top")
        assert {name for name, robot in fleet.robots.items() if (key, word) in robot.heard} == (
            stopped
        )


@pytest.mark.nightly
def test_a_person_of_one_site_stops_neither_the_fleet_nor_another_site(fleet: FleetBench) -> None:
    with fleet.person("people/dan", "top") as session:
        for key in ("farm/yahboomd/estop", "farm/south/yahboomd/estop", "farm/**/yahboomd/estop"):
            session.put(key, "dan's stop")
        session.put("farm/north/yahboomd/estop", "dan's own")
        own = ("farm/north/yahboomd/estop", "dan's own")
        wait_for(lambda: own in fleet.robots["bot2"].heard, "his own site stops")
    fleet.flushed("flush dan", "top")
    assert not any(heard_of(robot, "dan's stop") for robot in fleet.robots.values())


@pytest.mark.nightly
def test_no_file_lets_a_certificate_in_that_another_authority_signed(
    fleet: FleetBench, tmp_path_factory: pytest.TempPathFactory
) -> None:
    forger = FleetBench(tmp_path_factory.mktemp("forger"))
    forger.addresses = fleet.addresses
    with pytest.raises(zenoh.ZError), forger.person("people/max", "north"):
        pass


def by(fleet: FleetBench, person: str) -> AsyncRobot:
    """A person at the router above the sites, as a client of that daemon."""
    return connect(
        f"tls/{fleet.addresses['top']}",
        namespace=LATE,
        wait_s=PATIENCE_S,
        zenoh_file=fleet.file(f"people/{person}"),
    )


def test_rules_are_read_as_zenoh_reads_them(fleet: FleetBench) -> None:
    file = fleet.file("routers/north").read_text().partition("\n")[2]
    rules = json.loads(file)["access_control"]
    for who, key, allowed in (
        ("person.dan", "farm/north/bot1/cmd_vel/dan", True),
        ("person.dan", "farm/north/bot1/cmd_vel/max", False),
        ("person.dan", "farm/north/bot1/cmd_vel", False),
        ("person.dan", "farm/north/*/cmd_vel/dan", False),
        ("person.dan", "farm/south/bot3/cmd_vel/dan", False),
        ("person.vera", "farm/north/bot1/cmd_vel/vera", False),
        ("robot.bot2", "farm/north/bot1/cmd_vel", False),
        ("robot.bot1", "farm/north/bot1/cmd_vel", True),
        ("nobody", "farm/north/bot1/cmd_vel", False),
    ):
        assert is_allowed(rules, who, "put", key, "ingress") is allowed, (who, key)
