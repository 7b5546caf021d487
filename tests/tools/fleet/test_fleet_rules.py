"""Every role against every robot, with the files as written, on real routers."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from itertools import product
from pathlib import Path

import pytest
import zenoh
from zenoh.handlers import Callback

pytest.importorskip("cryptography")

from fleet_bench import LATE, ROBOTS, FleetBench, heard_of
from real_robot import free_endpoint, wait_for
from zenoh_fixtures import PATIENCE_S, eventually

from yahboomd.client import AsyncRobot, StatusSample, connect
from yahboomd.client.questions import ask
from yahboomd.core.bus import keys
from yahboomd.core.bus.keys import own_key
from yahboomd.core.config import Config, read
from yahboomd.core.daemon.black_box import NoBlackBox
from yahboomd.core.daemon.service import Daemon
from yahboomd.core.model import Event
from yahboomd.simulation.memory import MemoryPort
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.tools.fleet.fleet_rules import is_allowed
from yahboomd.tools.fleet.people_keys import own_stop
from yahboomd.tools.fleet.people_plane import PeoplePlane, people_of
from yahboomd.tools.stop.stop_client import BusStop, engage

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


@pytest.mark.parametrize("where", BEHIND)
def test_a_robots_certificate_reaches_no_other_robot(fleet: FleetBench, where: str) -> None:
    try_everything(fleet, "robots/bot2", where)
    for name, robot in fleet.robots.items():
        if name == "bot2" and where == "north":
            continue
        for how in ("put", "get", "wild"):
            assert heard_of(robot, f"{how} robots/bot2 {where}") == set()


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


def test_a_person_of_one_site_stops_neither_the_fleet_nor_another_site(fleet: FleetBench) -> None:
    with fleet.person("people/dan", "top") as session:
        for key in ("farm/yahboomd/estop", "farm/south/yahboomd/estop", "farm/**/yahboomd/estop"):
            session.put(key, "dan's stop")
        session.put("farm/north/yahboomd/estop", "dan's own")
        own = ("farm/north/yahboomd/estop", "dan's own")
        wait_for(lambda: own in fleet.robots["bot2"].heard, "his own site stops")
    fleet.flushed("flush dan", "top")
    assert not any(heard_of(robot, "dan's stop") for robot in fleet.robots.values())


def test_poses_reach_the_people_of_the_robot_and_no_others(fleet: FleetBench) -> None:
    heard: dict[str, list[str]] = {"dan": [], "max": []}
    dan, olga = fleet.person("people/dan", "top"), fleet.person("people/max", "top")
    with dan as his, olga as hers:
        for name, session in (("dan", his), ("max", hers)):
            for namespace in ROBOTS.values():
                session.declare_subscriber(
                    f"{namespace}/yahboomd/pose",
                    lambda sample, name=name: heard[name].append(str(sample.key_expr)),
                )

        def passed() -> bool:
            for name in ("bot3", "bot1"):
                fleet.robots[name].sessions[0].put(f"{ROBOTS[name]}/yahboomd/pose", b"{}")
            return f"{ROBOTS['bot1']}/yahboomd/pose" in heard["dan"] and len(set(heard["max"])) == 2

        wait_for(passed, "his robot's poses")
    assert set(heard["dan"]) == {f"{ROBOTS['bot1']}/yahboomd/pose"}


def test_a_liar_with_a_robots_certificate_answers_publishes_and_lives_for_no_other_robot(
    fleet: FleetBench,
) -> None:
    """A robot of another site, and the neighbour at the same router."""
    truth = ROBOTS["bot1"]
    with (
        fleet.person("robots/bot2", "north") as near,
        fleet.person("robots/bot3", "top") as far,
        fleet.person("people/max", "top") as max_,
    ):
        heard: list[str] = []
        max_.declare_subscriber(f"{truth}/**", lambda sample: heard.append(str(sample.payload)))
        tokens: list[str] = []
        max_.liveliness().declare_subscriber(
            "farm/**", lambda sample: tokens.append(str(sample.key_expr)), history=True
        )
        for liar in (near, far):
            for key in (f"{truth}/yahboomd/estop", "farm/**", f"{truth}/**"):
                liar.declare_queryable(
                    key, Callback(lambda query: query.reply(f"{truth}/yahboomd/estop", "a lie"))
                )
            liar.liveliness().declare_token(f"{truth}/yahboomd/alive/1")
            liar.put(f"{truth}/yahboomd/status", "a lie")
        # Each of these comes after the lies, on the same connection.
        kept = [near.liveliness().declare_token(f"{ROBOTS['bot2']}/yahboomd/alive/2")]
        wait_for(lambda: f"{ROBOTS['bot2']}/yahboomd/alive/2" in tokens, "an honest token")
        for _ in range(3):
            for selector in (f"{truth}/yahboomd/estop", "farm/yahboomd/estop"):
                replies = max_.get(selector, accept_replies=zenoh.ReplyKeyExpr.ANY)
                words = [reply.ok.payload.to_string() for reply in replies if reply.ok]
                assert "a lie" not in words
        assert words_of(max_, f"{truth}/yahboomd/estop") == [truth]
        del kept
    assert heard == []
    assert f"{truth}/yahboomd/alive/1" not in tokens


def words_of(session: zenoh.Session, key: str) -> list[str]:
    return [reply.ok.payload.to_string() for reply in session.get(key) if reply.ok]


def test_no_file_lets_a_certificate_in_that_another_authority_signed(
    fleet: FleetBench, tmp_path_factory: pytest.TempPathFactory
) -> None:
    forger = FleetBench(tmp_path_factory.mktemp("forger"))
    forger.addresses = fleet.addresses
    with pytest.raises(zenoh.ZError), forger.person("people/max", "north"):
        pass


class Told:
    """What a daemon tells a plane: its status, and who did what by a person's key."""

    name = "a test"

    def __init__(self) -> None:
        self.named: list[tuple[str, object, object]] = []
        self.statuses: list[StatusSample] = []

    def start(self, *_: object) -> Told:
        return self

    def event(self, event: Event, _stamp_ns: int) -> None:
        if event.kind in {"driver_changed", "asked_by_name"}:
            self.named.append((event.kind, event.data["name"], event.data["key"]))

    def status(self, sample: StatusSample) -> None:
        self.statuses.append(sample)

    def estimate(self, *_: object) -> None:
        """Nothing."""

    imu = battery = estimate

    async def next_status(self) -> StatusSample:
        """The next status that the daemon publishes."""
        count = len(self.statuses)
        await eventually(lambda: len(self.statuses) > count)
        return self.statuses[count]


@asynccontextmanager
async def driven(fleet: FleetBench, folder: Path) -> AsyncIterator[Told]:
    """A whole daemon, with its two files of the fleet, that drives a simulated board."""
    overrides = [
        f'zenoh.listen=["{free_endpoint()}"]',
        f'zenoh.config="{fleet.file("robots/bot4")}"',
        f"estop.latch_file={folder / 'estop'}",
    ]
    path = fleet.file("robots/bot4", ".toml")
    config = read(path, environ={}, overrides=overrides).config
    board, told = SimulatedRobot(), Told()

    async def opened() -> MemoryPort:
        port = MemoryPort(board)
        port.open()
        return port

    daemon = Daemon(
        config,
        environ={"RUNTIME_DIRECTORY": str(folder / "run")},
        black_box=lambda *_: NoBlackBox(),
        planes=[PeoplePlane(people_of(config)), told],
        opener=opened,
    )
    task = asyncio.create_task(daemon.run())
    try:
        yield told
    finally:
        daemon.stop("the test's end")
        await task


def by(fleet: FleetBench, person: str) -> AsyncRobot:
    """A person at the router above the sites, as a client of that daemon."""
    return connect(
        f"tls/{fleet.addresses['top']}",
        namespace=LATE,
        wait_s=PATIENCE_S,
        zenoh_file=fleet.file(f"people/{person}"),
    )


@pytest.mark.usefixtures("patience")
async def test_who_drives_and_stops_through_the_routers_is_named_and_nobody_else_can_use_the_name(
    fleet: FleetBench, tmp_path: Path
) -> None:
    his = ("asked_by_name", "max", keys.ODOMETRY_RESET)
    drives = ("driver_changed", "olga", "cmd_vel/olga")
    stops = ("asked_by_name", "olga", keys.ESTOP)
    async with (
        driven(fleet, tmp_path) as told,
        by(fleet, "olga") as olga,
        by(fleet, "max") as thief,
    ):
        while (await told.next_status()).state != "standing":
            pass
        # The maintainer, who may do more than she, under her name; then a question of his own.
        session = thief.bus.session
        session.put(f"{LATE}/cmd_vel/olga", b'{"vx": 0.2}')
        for key in (keys.ESTOP, keys.ODOMETRY_RESET):
            in_full = f"{LATE}/{own_key(key, 'olga')}"
            session.put(in_full, b"{}")
            await ask(session, in_full, timeout_s=0.1)
        await thief.reset_odometry()
        status = await told.next_status()
        assert (status.state, status.command["received"]) == ("standing", 0)
        assert told.named == [his]

        def driving() -> bool:
            # A machine that holds this process up for too long ends a command.
            olga.drive(0.2, for_s=math.inf)
            return drives in told.named

        await eventually(driving)
        assert (await stopped_by(fleet, "olga")).stood
        status = await told.next_status()
        assert status.why.startswith(f"Emergency stop, engaged by {own_stop('olga')}")
    assert {each for each in told.named if each[0] == "asked_by_name"} == {his, stops}


async def stopped_by(fleet: FleetBench, person: str) -> BusStop:
    """The outcome of `yahboomd stop` with a person's file; repeated if no answer comes in time."""
    settings = {"namespace": LATE, "config": str(fleet.file(f"people/{person}"))}
    endpoints = (f"tls/{fleet.addresses['top']}",)
    async with asyncio.timeout(PATIENCE_S):
        while True:
            found = await engage(endpoints, Config.of({"zenoh": settings}), within_s=PATIENCE_S)
            if found is not None:
                return found


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
