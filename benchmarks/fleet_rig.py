"""A fleet as `yahboomd fleet init` makes it, on this machine: certificates and rules everywhere.

Some robots are real daemons, each on a thin board; the others are thin. With two sites a router
stands above theirs, and everything that reaches it passes a way with delay: the operator, and each
site. With one site there is no other router, and no delay.
"""

from __future__ import annotations

import contextlib
import json
import socket
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeAlias

import zenoh

from benchmarks import rig
from benchmarks.fleet_parts import SEEN, person
from benchmarks.long_way import FAR
from yahboomd.cli.main import main as yahboomd
from yahboomd.core.bus import keys
from yahboomd.tools.fleet.fleet_list import ZenohFile, read_zenoh

FLEET = "farm"
SITES = ("north", "south")
PER_PROCESS = 100
COMMANDS_HZ = 20.0
DRIVE = b'{"vx": 0.3}'

Change: TypeAlias = Callable[[ZenohFile], object]


class Fleet:
    """The processes of a fleet of some robots.

    Args:
        robots: The number of robots in `fleet.toml`.
        real: How many of them are real daemons.
        joined: How many of them there are; the others are only listed.
        delay_s: What each direction of a way to the upper router takes.
        loss: The share of packets that are lost there; it needs a network namespace and root.
        zenohd: The program of the routers; without it they are sessions in router mode.
        change: Changes the file of a router.
        timeout_s: How long a real robot obeys a command of the operator's; None: as written.
    """

    def __init__(
        self,
        folder: Path,
        *,
        robots: int,
        real: int = 0,
        joined: int | None = None,
        sites: tuple[str, ...] = SITES,
        delay_s: float = 0.0,
        loss: float | None = None,
        zenohd: str = "",
        change: Change = lambda _: None,
        timeout_s: float | None = None,
    ) -> None:
        self.folder, self.sites, self.zenohd = folder, sites, zenohd
        self.names = [f"bot{n}" for n in range(robots)]
        self.real = self.names[:real]
        self.thin = self.names[real : robots if joined is None else joined]
        self.timeout_s = timeout_s
        self.processes: dict[str, rig.Process] = {}
        self.crowds: list[rig.Process] = []
        self.local: dict[str, str] = {}
        self._delay_s, self._loss, self._change = delay_s, loss, change
        self._stack = contextlib.ExitStack()
        self.routers = ("top", *sites) if len(sites) > 1 else sites
        ways = [f"way-{each}" for each in ("max", *sites)] if len(sites) > 1 else []
        self.ports = {
            name: int(rig.free_endpoint().rpartition(":")[2]) for name in (*self.routers, *ways)
        }
        (folder / "ports.json").write_text(json.dumps(self.ports))
        self._papers()

    def _papers(self) -> None:
        folder, tree = self.folder, len(self.sites) > 1
        self._above = "127.0.0.1" if self._loss is None else FAR
        text = f'fleet = "{FLEET}"\n'
        if tree:
            text += f'router = "{self._above}:{self.ports["top"]}"\n'
        for site in self.sites:
            text += f'[sites.{site}]\nrouter = "127.0.0.1:{self.ports[site]}"\n'
        for name in self.names:
            text += f'[robots.{name}]\nsite = "{self.site(name)}"\n'
        text += '[people.max]\nrole = "maintainer"\n[people.ann]\nrole = "viewer"\n'
        (folder / "fleet.toml").write_text(text)
        with contextlib.redirect_stdout(None):
            assert yahboomd(["fleet", "init", str(folder / "fleet.toml")]) == 0
        self.papers = folder / "max.json5"
        file = read_zenoh(folder / "fleet/people/max.json5")
        found = file["metadata"]["yahboomd_fleet"]
        if tree:
            # The way over the upper router alone, so that all passes the whole tree.
            found["ways"] = {self._way("max"): [FLEET]}
        self.papers.write_text(json.dumps(file))

    def _way(self, who: str) -> str:
        port = self.ports["top" if self._loss is not None else f"way-{who}"]
        return f"tls/{self._above}:{port}"

    def site(self, name: str) -> str:
        return self.sites[int(name.removeprefix("bot")) % len(self.sites)]

    def namespace(self, name: str) -> str:
        return f"{FLEET}/{self.site(name)}/{name}"

    def begin(self, name: str, *arguments: str) -> rig.Process:
        """Start a process of `benchmarks.fleet_parts`."""
        return self._keep(name, rig.Process("-m", "benchmarks.fleet_parts", *arguments))

    def _keep(self, name: str, process: rig.Process) -> rig.Process:
        self.processes[name] = process
        self._stack.callback(process.end)
        return process

    def router(self, name: str) -> float:
        """Start a router; returns the seconds until it listens."""
        upper = name == "top"
        content = read_zenoh(
            self.folder / "fleet" / ("router.json5" if upper else f"routers/{name}.json5")
        )
        if not upper and len(self.sites) > 1:
            content["connect"]["endpoints"] = [self._way(name)]
        self._change(content)
        file = self.folder / f"{name}.json5"
        file.write_text(json.dumps(content))
        start = time.monotonic()
        if self.zenohd:
            process = rig.Process(
                "-c", str(file), program=self.zenohd, environ={"RUST_LOG": "error"}
            )
            self._keep(name, process)
        else:
            self.begin(name, "router", str(file))
        return self._listens(self.ports[name], start)

    def _listens(self, port: int, start: float) -> float:
        def reached() -> bool:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
                return True
            return False

        rig.wait_for(reached, f"port {port} is served")
        return time.monotonic() - start

    def start_routers(self) -> dict[str, float]:
        """Start the ways and the routers; returns the seconds until each listens."""
        if len(self.sites) > 1 and self._loss is not None:
            wire = rig.Process(
                "-m", "benchmarks.long_way", str(self._delay_s * 1e3), str(self._loss)
            )
            self._keep("wire", wire).says("ready")
        took = {"top": self.router("top")} if len(self.sites) > 1 else {}
        if len(self.sites) > 1 and self._loss is None:
            for name in ("max", *self.sites):
                port = self.ports[f"way-{name}"]
                self.begin(
                    f"way-{name}", "relay", str(port), str(self.ports["top"]), str(self._delay_s)
                )
                self._listens(port, 0.0)
        return took | {site: self.router(site) for site in self.sites}

    def start(self) -> None:
        """Start everything."""
        self.start_routers()
        self.start_robots()

    def start_robots(self) -> None:
        """Start the robots; returns when each has joined its router."""
        if self.thin:
            (self.folder / SEEN).write_text(
                json.dumps(seen(self.folder, self.namespace(self.thin[0])))
            )
        for first in range(0, len(self.thin), PER_PROCESS):
            own = map(self.namespace, self.thin[first : first + PER_PROCESS])
            self.crowds.append(self.begin(f"thin-{first}", "robots", str(self.folder), *own))
        if self.real:
            self._stack.enter_context(rig.thin_board(self.folder, ports=len(self.real)))
        for number, name in enumerate(self.real):
            self.local[name] = rig.free_endpoint()
            file = self.folder / "fleet/robots" / f"{name}.json5"
            site = self.site(name)
            self.processes[name] = self._stack.enter_context(
                rig.daemon(
                    self.folder,
                    self.local[name],
                    f"zenoh.config={file}",
                    *settings(file.with_suffix(".toml"), self.timeout_s),
                    port=f"port{number}",
                    connect=[f"tls/127.0.0.1:{self.ports[site]}"],
                )
            )
        for each in self.crowds:
            each.says("joined ")
        for name in self.real:
            self.processes[name].says("Connected")

    @contextlib.contextmanager
    def driven(self) -> Iterator[zenoh.Session]:
        """Release the real robots and drive them as the operator; begins once all move."""
        session, ended = person(str(self.papers))[0], threading.Event()

        def ask(name: str, key: str) -> dict[str, Any]:
            replies = session.get(f"{self.namespace(name)}/{key}", timeout=5.0)
            found = [json.loads(each.ok.payload.to_string()) for each in replies if each.ok]
            return found[0] if found else {}

        def drive() -> None:
            while not ended.wait(1.0 / COMMANDS_HZ):
                for name in self.real:
                    session.put(
                        f"{self.namespace(name)}/cmd_vel/max",
                        DRIVE,
                        priority=zenoh.Priority.REAL_TIME,
                        express=True,
                    )

        for name in self.real:
            rig.wait_for(lambda name=name: ask(name, keys.ESTOP_RESET).get("success"), "a release")
        thread = threading.Thread(target=drive)
        thread.start()
        try:
            for name in self.real:
                moves = lambda name=name: ask(name, keys.STATUS).get("state") == "driving"  # noqa: E731
                rig.wait_for(moves, "it drives")
            yield session
        finally:
            ended.set()
            thread.join()
            session.close()

    def result(self, name: str) -> dict[str, Any]:
        """The result of a process, once it prints it."""
        line = self.processes[name].says("result ")
        found: dict[str, Any] = json.loads(line.removeprefix("result "))
        return found

    def close(self) -> None:
        self._stack.close()


def settings(file: Path, timeout_s: float | None = None) -> list[str]:
    """The settings of a robot, as its file has them; the operator's own timeout may differ."""
    found = tomllib.loads(file.read_text())
    sources = found["command"]["sources"]
    if timeout_s is not None:
        sources["cmd_vel/max"]["timeout_s"] = timeout_s
    inline = ", ".join(
        f'"{key}" = {{{", ".join(f"{name} = {value}" for name, value in each.items())}}}'
        for key, each in sources.items()
    )
    return [
        f'zenoh.namespace="{found["zenoh"]["namespace"]}"',
        f"command.sources={{{inline}}}",
        f"estop.groups={json.dumps(found['estop']['groups'])}",
    ]


def seen(folder: Path, namespace: str) -> dict[str, Any]:
    """What a router sees a daemon with a robot's file declare, and its answers to who looks."""
    endpoint, name = rig.free_endpoint(), namespace.rpartition("/")[2]
    config = rig.client_config(endpoint, mode="router")
    config.insert_json5("connect/endpoints", "[]")
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("adminspace/enabled", "true")
    where = folder / "model"
    where.mkdir()
    with (
        zenoh.open(config) as router,
        rig.thin_board(where),
        rig.daemon(
            where,
            rig.free_endpoint(),
            *settings(folder / "fleet/robots" / f"{name}.toml"),
            connect=[endpoint],
        ) as daemon,
    ):
        daemon.says("Connected")

        def answer(key: str) -> str:
            replies = router.get(f"{namespace}/{key}", timeout=5.0)
            return next((each.ok.payload.to_string() for each in replies if each.ok), "")

        answers = {key: rig.wait_for(lambda key=key: answer(key), key) for key in ANSWERED}
        prefix = f"@/{router.zid()}/router"
        declared = [
            (kind, str(reply.ok.key_expr).removeprefix(f"{prefix}/{kind}/"))
            for kind in ("subscriber", "queryable", "publisher", "token")
            for reply in router.get(f"{prefix}/{kind}/{FLEET}/**")
            if reply.ok
        ]
    site = namespace.rpartition("/")[0]
    patterns = [
        (kind, key.replace(namespace, "{robot}").replace(site, "{site}")) for kind, key in declared
    ]
    return {"declared": patterns, "answers": answers}


ANSWERED = (keys.STATUS, keys.CONFIG)
