"""A fleet whose files `yahboomd fleet init` wrote, on real routers, with robots that record.

A robot here has the sessions of a daemon, with the daemon's options, and writes down whatever
reaches it. Everything is one process's: the routers are Zenoh's own in router mode.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import daemon_samples
import msgspec
import zenoh
from real_robot import free_endpoint, wait_for
from zenoh.handlers import Callback

from yahboomd.cli.main import main
from yahboomd.core.bus.options import BusOptions, zenoh_config
from yahboomd.core.messages.codecs import encode

TOML = """
fleet = "farm"
router = "{top}"
[sites.north]
router = "{north}"
[sites.south]
router = "{south}"
[robots.bot1]
site = "north"
address = "{bot1}"
[robots.bot2]
site = "north"
[robots.bot3]
site = "south"
[robots.bot4]
site = "south"
[people.vera]
role = "viewer"
[people.dan]
role = "driver"
of = ["north"]
[people.olga]
role = "operator"
of = ["north/bot1", "south"]
[people.max]
role = "maintainer"
"""

ROUTERS = {"top": "router", "north": "routers/north", "south": "routers/south"}
ROBOTS = {"bot1": "farm/north/bot1", "bot2": "farm/north/bot2", "bot3": "farm/south/bot3"}
LATE = "farm/south/bot4"
"""A robot of the file that is not there."""

TURNS = (
    '{"success": true, "message": "Engaged.", '
    '"data": {"sent": true, "stands": false, "fastest_m_s": 0.4}}'
)
STANDS = (
    '{"success": true, "message": "Engaged.", '
    '"data": {"sent": true, "stands": true, "fastest_m_s": 0.0}}'
)


def address() -> str:
    return free_endpoint().removeprefix("tcp/")


class RecordingRobot:
    """The sessions of one daemon: what reaches it goes to ``heard``."""

    def __init__(self, bench: FleetBench, name: str) -> None:
        self.namespace = ROBOTS.get(name, LATE)
        self.heard: set[tuple[str, str]] = set()
        self.asked = 0
        self.answer = self.namespace
        """The answer to every query; empty: it keeps the query, and never answers."""
        self.wheels: list[float] = []
        """The speeds with which it answers a query for its wheels, one after the other."""
        self.answers: dict[str, bytes] = {}
        """Answers to queries that reach these keys, below its namespace, by wildcards too."""
        self.seq = 0
        self._kept: list[zenoh.Query] = []
        self._tokens: list[zenoh.LivelinessToken] = []
        toml = tomllib.loads(bench.file(f"robots/{name}", ".toml").read_text())["zenoh"]
        options = BusOptions(
            listen=tuple(each for each in toml["listen"] if each.startswith("tls/")),
            connect=tuple(toml["connect"]),
            namespace=toml["namespace"],
            config_file=bench.file(f"robots/{name}"),
        )
        assert options.namespace == self.namespace
        wanted = [zenoh_config(options, uplink=True)]
        if options.listen:
            wanted.append(zenoh_config(options))
        self.sessions = [bench.open(config) for config in wanted]
        for session in self.sessions:
            for key in (f"{self.namespace}/**", *bench.groups(name)):
                session.declare_subscriber(key, Callback(self._heard, indirect=False))
                session.declare_queryable(key, Callback(self._asked, indirect=False))

    def _heard(self, sample: zenoh.Sample) -> None:
        self.heard.add((str(sample.key_expr), sample.payload.to_string()))

    def _asked(self, query: zenoh.Query) -> None:
        payload = query.payload
        self.heard.add((str(query.key_expr), "" if payload is None else payload.to_string()))
        own = f"{self.namespace}/yahboomd/estop"
        for name, answer in self.answers.items():
            if query.key_expr.intersects(zenoh.KeyExpr(f"{self.namespace}/{name}")):
                query.reply(f"{self.namespace}/{name}", answer)
                query.drop()
                return
        if self.wheels and str(query.key_expr).endswith("/yahboomd/wheels"):
            self.seq += 1
            query.reply(str(query.key_expr), wheels(self.seq, self.wheels.pop(0)))
            query.drop()
            return
        self.asked += query.key_expr.intersects(zenoh.KeyExpr(own))
        if not self.answer:
            self._kept.append(query)
            return
        if query.key_expr.intersects(zenoh.KeyExpr(own)):
            query.reply(own, self.answer)
        elif "*" not in str(query.key_expr):
            query.reply(str(query.key_expr), self.answer)
        query.drop()

    def live(self) -> None:
        """Show the token of a daemon."""
        for session in self.sessions:
            key = f"{self.namespace}/yahboomd/alive/{session.zid()}"
            self._tokens.append(session.liveliness().declare_token(key))

    def leave(self) -> None:
        """Take the token back."""
        for token in self._tokens:
            token.undeclare()
        self._tokens.clear()


class FleetBench:
    """The routers and robots of a fleet, with the files as the command wrote them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.addresses = {name: address() for name in (*ROUTERS, "bot1")}
        self.toml = folder / "fleet.toml"
        self.toml.write_text(TOML.format(**self.addresses))
        assert main(["fleet", "init", str(self.toml)]) == 0
        self._sessions: list[zenoh.Session] = []
        self.routers: dict[str, zenoh.Session] = {}
        self.robots: dict[str, RecordingRobot] = {}

    def file(self, name: str, ending: str = ".json5") -> Path:
        path = self.folder / "fleet" / name
        return path.with_name(f"{path.name}{ending}")

    def groups(self, name: str) -> tuple[str, ...]:
        place = ROBOTS.get(name, LATE).rpartition("/")[0]
        return f"{place}/yahboomd/estop", "farm/yahboomd/estop"

    def open(self, config: zenoh.Config) -> zenoh.Session:
        session = zenoh.open(config)
        self._sessions.append(session)
        return session

    def start(self) -> None:
        """Open the routers and the robots."""
        self.open_routers()
        self.robots = {name: RecordingRobot(self, name) for name in ROBOTS}

    def open_routers(self) -> None:
        """Open the routers, the one above first."""
        for name, file in ROUTERS.items():
            self.routers[name] = self.open(zenoh.Config.from_json5(self.file(file).read_text()))

    def settled(self) -> None:
        """Wait until everything reaches every robot, through both routers."""
        with self.person("people/max", "top") as session:

            def reach() -> bool:
                session.put("farm/**/yahboomd/estop", "settled")
                return all(
                    ("farm/**/yahboomd/estop", "settled") in robot.heard
                    for robot in self.robots.values()
                )

            wait_for(reach, "all robots are reached")

    @contextmanager
    def person(self, file: str, where: str) -> Iterator[zenoh.Session]:
        """A session with the papers in a file, at a router or a robot."""
        options = BusOptions(
            mode="client",
            listen=(),
            connect=(f"tls/{self.addresses[where]}",),
            config_file=self.file(file),
            enforces=False,
        )
        session = zenoh.open(zenoh_config(options))
        try:
            yield session
        finally:
            session.close()

    def gone(self, where: str, zid: str) -> None:
        """Wait until a session that ended is unknown: all that it sent was read before."""
        at = self.routers.get(where) or self.robots[where].sessions[1]
        wait_for(
            lambda: zid not in {str(each.zid) for each in at.info.transports()}, "its end is seen"
        )

    def flushed(self, word: str, where: str) -> None:
        """Wait until all that was sent before at a place has reached the robots behind it."""
        names = ["bot1"] if where == "bot1" else list(ROBOTS)
        with self.person("people/max", where) as session:
            for name in names:
                robot = self.robots[name]
                key = f"{robot.namespace}/yahboomd/estop"
                session.put(key, word)
                wait_for(lambda: (key, word) in robot.heard, "it is flushed")  # noqa: B023

    def close(self) -> None:
        for session in reversed(self._sessions):
            session.close()


def wheels(seq: int, speed_m_s: float) -> bytes:
    found = msgspec.structs.replace(daemon_samples.wheels(), seq=seq, speed_m_s=(speed_m_s, 0.0))
    return encode(found, "json")


def heard_of(robot: RecordingRobot, word: str) -> set[str]:
    """The keys, below the robot's namespace, of all that somebody sent it."""
    return {
        key.removeprefix(f"{robot.namespace}/") for key, payload in robot.heard if payload == word
    }
