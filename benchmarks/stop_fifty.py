"""How fast `yahboomd stop --all` stops fifty robots over a tree of routers, and under faults.

    python -m benchmarks.stop_fifty [--delay-ms 50] [--real 3] [--robots 50]

All files are those of `yahboomd fleet init`: mutual TLS and access rules everywhere. A router
stands above two sites. Everything that reaches it, the operator's connection and those of the
sites, passes a relay that delays each direction. Some robots are real daemons on simulated boards,
which drive; the others are sessions that answer as daemons do. The operator's file names the way
over the upper router alone, so that every stop passes the whole tree.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import zenoh
from zenoh.handlers import Callback

from benchmarks import rig
from yahboomd.cli.main import main as yahboomd
from yahboomd.core.bus.options import BusOptions, zenoh_config
from yahboomd.core.clock import SystemClock
from yahboomd.tools.fleet.fleet_list import read_list, read_zenoh
from yahboomd.tools.fleet.fleet_plan import stop_key
from yahboomd.tools.fleet.fleet_stop import FleetStop
from yahboomd.tools.fleet.stop_all import StopAll

FLEET = "farm"
SITES = ("north", "south")
FAULT_S = 3.0
DRIVE = b'{"vx": 0.3}'
ANSWER = json.dumps(
    {
        "success": True,
        "message": "Engaged.",
        "data": {"sent": True, "stands": True, "fastest_m_s": 0.0},
    }
)


def router(file: str, listen: str) -> None:
    """Be a router with its file; it listens at another port if one is named."""
    config = zenoh.Config.from_json5(Path(file).read_text())
    if listen:
        config.insert_json5("listen/endpoints", json.dumps([listen]))
    with zenoh.open(config):
        print("ready", flush=True)
        signal.pause()


def relay(listen: int, target: int, delay_s: float) -> None:
    """Pass bytes on, each direction later by a delay."""

    async def pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        loop = asyncio.get_running_loop()
        while data := await reader.read(65536):
            loop.call_later(delay_s, writer.write, data)
        loop.call_later(delay_s, writer.close)

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            there = await asyncio.open_connection("127.0.0.1", target)
            await asyncio.gather(
                pass_on(reader, there[1]), pass_on(there[0], writer), return_exceptions=True
            )
        writer.close()

    async def run() -> None:
        async with await asyncio.start_server(serve, "127.0.0.1", listen) as server:
            print("ready", flush=True)
            await server.serve_forever()

    asyncio.run(run())


def stand_ins(folder: str, names: list[str]) -> None:
    """Be robots that acknowledge every stop, and show their tokens."""
    kept: list[Any] = []
    for name in names:
        site = SITES[int(name.removeprefix("bot")) % 2]
        own = f"{FLEET}/{site}/{name}"
        file = Path(folder, "fleet", "robots", f"{name}.json5")
        options = BusOptions(connect=(read_list_router(folder, site),), config_file=file)
        session = zenoh.open(zenoh_config(options, uplink=True))

        def answer(query: zenoh.Query, key: str = stop_key(own)) -> None:
            query.reply(key, ANSWER)
            query.drop()

        session.declare_queryable(stop_key(own), Callback(answer, indirect=False))
        for group in (FLEET, f"{FLEET}/{site}"):
            session.declare_subscriber(stop_key(group), lambda _: None)
        kept += [session, session.liveliness().declare_token(f"{own}/yahboomd/alive/{name}")]
    print("ready", flush=True)
    signal.pause()


def read_list_router(folder: str, site: str) -> str:
    """The endpoint of a site's router."""
    listen: list[str] = read_zenoh(Path(folder, "fleet", "routers", f"{site}.json5"))["listen"][
        "endpoints"
    ]
    return listen[0].replace("0.0.0.0", "127.0.0.1")


def operator(file: str) -> None:
    """Stop all as the command does; print when each acknowledged, and the report."""
    papers = Path(file)
    fleet = read_list(papers)
    progress = FleetStop(fleet.robots)
    stop = StopAll(fleet, papers, progress, lambda _: None, SystemClock())
    print("begins", flush=True)
    asyncio.run(stop.run())
    times = {name: robot.acknowledged_s for name, robot in progress.robots.items()}
    print("result " + json.dumps({"times": times, "report": progress.report()}), flush=True)


class Fleet:
    """The processes of a fleet of some robots."""

    def __init__(self, folder: Path, *, robots: int, real: int, delay_s: float) -> None:
        self.folder = folder
        self.names = [f"bot{n}" for n in range(robots)]
        self.real = self.names[:real]
        self.delay_s = delay_s
        self.ports = {
            name: rig.free_endpoint().rpartition(":")[2] for name in ("top", "relay", *SITES)
        }
        self.processes: dict[str, rig.Process] = {}
        self._stack = contextlib.ExitStack()
        text = f'fleet = "{FLEET}"\nrouter = "127.0.0.1:{self.ports["relay"]}"\n'
        for site in SITES:
            text += f'[sites.{site}]\nrouter = "127.0.0.1:{self.ports[site]}"\n'
        for name in self.names:
            text += f'[robots.{name}]\nsite = "{self.site(name)}"\n'
        text += '[people.max]\nrole = "maintainer"\n'
        (folder / "fleet.toml").write_text(text)
        assert yahboomd(["fleet", "init", str(folder / "fleet.toml")]) == 0
        self.papers = folder / "max.json5"
        file = read_zenoh(folder / "fleet/people/max.json5")
        ways = file["metadata"]["yahboomd_fleet"]["ways"]
        over = f"tls/127.0.0.1:{self.ports['relay']}"
        file["metadata"]["yahboomd_fleet"]["ways"] = {over: ways[over]}
        self.papers.write_text(json.dumps(file))

    def site(self, name: str) -> str:
        return SITES[int(name.removeprefix("bot")) % 2]

    def namespace(self, name: str) -> str:
        return f"{FLEET}/{self.site(name)}/{name}"

    def begin(self, name: str, *arguments: str) -> rig.Process:
        self.processes[name] = rig.Process("-m", "benchmarks.stop_fifty", *arguments)
        self._stack.callback(self.processes[name].end)
        return self.processes[name]

    def router(self, name: str) -> rig.Process:
        """Start a router."""
        upper = name == "top"
        file = self.folder / "fleet" / ("router.json5" if upper else f"routers/{name}.json5")
        listen = f"tls/127.0.0.1:{self.ports['top']}" if upper else ""
        process = self.begin(name, "router", str(file), listen)
        process.says("ready")
        return process

    def start(self) -> None:
        ports = self.ports
        self.begin("relay", "relay", ports["relay"], ports["top"], str(self.delay_s)).says("ready")
        for name in ("top", *SITES):
            self.router(name)
        thin = [name for name in self.names if name not in self.real]
        self.begin("stand-ins", "stand-ins", str(self.folder), *thin).says("ready")
        for name in self.real:
            file = self.folder / "fleet/robots" / f"{name}.json5"
            self._stack.enter_context(rig.simulator(self.folder, name=name))
            daemon = rig.daemon(
                self.folder,
                rig.free_endpoint(),
                f"zenoh.config={file}",
                f'zenoh.namespace="{self.namespace(name)}"',
                'command.sources={"cmd_vel/max" = {}}',
                f"estop.groups={json.dumps([f'{FLEET}/{self.site(name)}', FLEET])}",
                port=name,
                connect=[f"tls/127.0.0.1:{ports[self.site(name)]}"],
            )
            self.processes[name] = self._stack.enter_context(daemon)
            daemon.says("Connected")

    @contextlib.contextmanager
    def driven(self) -> Iterator[zenoh.Session]:
        """Release the real robots and drive them; begins once all move."""
        options = BusOptions(
            mode="client",
            listen=(),
            connect=(f"tls/127.0.0.1:{self.ports['relay']}",),
            config_file=self.papers,
            enforces=False,
        )
        session, ended = zenoh.open(zenoh_config(options)), threading.Event()

        def ask(name: str, key: str) -> dict[str, Any]:
            replies = session.get(f"{self.namespace(name)}/yahboomd/{key}", timeout=5.0)
            found = [json.loads(each.ok.payload.to_string()) for each in replies if each.ok]
            return found[0] if found else {}

        def drive() -> None:
            while not ended.wait(0.05):
                for name in self.real:
                    session.put(f"{self.namespace(name)}/cmd_vel/max", DRIVE)

        for name in self.real:
            rig.wait_for(lambda name=name: ask(name, "estop/reset").get("success"), "a release")
        thread = threading.Thread(target=drive)
        thread.start()
        try:
            for name in self.real:
                moves = lambda name=name: ask(name, "status").get("state") == "driving"  # noqa: E731
                rig.wait_for(moves, "it drives")
            yield session
        finally:
            ended.set()
            thread.join()
            session.close()

    def stop(self, fault: str = "") -> dict[str, Any]:
        """Stop all while a fault lasts for some seconds; returns the operator's result."""
        process = self.begin("operator", "operator", str(self.papers))
        process.says("begins")
        if fault == "router":
            self.processes["north"].process.kill()
            time.sleep(FAULT_S)
            self.router("north")
        elif fault == "frozen":
            time.sleep(FAULT_S)
            os.kill(self.processes[self.real[0]].pid, signal.SIGCONT)
        line = process.says("result ")
        found: dict[str, Any] = json.loads(line.removeprefix("result "))
        return found

    def close(self) -> None:
        self._stack.close()


def main() -> None:
    if len(sys.argv) > 1 and sys.argv[1] in {"router", "relay", "stand-ins", "operator"}:
        part, *rest = sys.argv[1:]
        if part == "router":
            router(*rest)
        elif part == "relay":
            relay(int(rest[0]), int(rest[1]), float(rest[2]))
        elif part == "stand-ins":
            stand_ins(rest[0], rest[1:])
        else:
            operator(rest[0])
        return
    parser = argparse.ArgumentParser(prog="benchmarks.stop_fifty")
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--real", type=int, default=3)
    parser.add_argument("--delay-ms", type=float, default=50.0)
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    with rig.folder() as folder:
        fleet = Fleet(folder, robots=args.robots, real=args.real, delay_s=args.delay_ms / 1e3)
        try:
            fleet.start()
            for fault in [*[""] * args.runs, "frozen", "router"]:
                with fleet.driven():
                    if fault == "frozen":
                        os.kill(fleet.processes[fleet.real[0]].pid, signal.SIGSTOP)
                    found = fleet.stop(fault)
                times = found["times"]
                known = sorted(each for each in times.values() if each is not None)
                print(
                    f"{fault or 'no fault'}: {len(known)} of {len(times)}, first {known[0]:.2f} s, "
                    f"median {known[len(known) // 2]:.2f} s, within a second of the first "
                    f"{sum(each - known[0] <= 1.0 for each in known)}, last {known[-1]:.2f} s; "
                    f"{' '.join(found['report'])}",
                    flush=True,
                )
        finally:
            fleet.close()


if __name__ == "__main__":
    main()
