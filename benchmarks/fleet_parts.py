"""The processes of a fleet with certificates and rules: routers, relays, thin robots and people.

    python -m benchmarks.fleet_parts router FILE
    python -m benchmarks.fleet_parts relay LISTEN TARGET DELAY_S
    python -m benchmarks.fleet_parts robots FOLDER NAMESPACE ...
    python -m benchmarks.fleet_parts stop PAPERS
    python -m benchmarks.fleet_parts look PAPERS SECONDS
    python -m benchmarks.fleet_parts read PAPERS SECONDS NAMESPACE ...
    python -m benchmarks.fleet_parts lie FOLDER NAMESPACE VICTIM

FOLDER is that of a :class:`~benchmarks.fleet_rig.Fleet`. A thin robot declares all that a daemon
was seen to declare, and gives the answers of that daemon; it publishes for those who subscribe.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import sys
import time
from collections import defaultdict
from functools import partial
from pathlib import Path
from typing import Any

import zenoh
from zenoh.handlers import Callback

from benchmarks.fleet_load import POSE_HZ, TICK_S, pose, until_terminated
from benchmarks.results import quantile
from benchmarks.rig import wait_for
from yahboomd.core.bus import keys
from yahboomd.core.bus.keys import full_key, holder_key
from yahboomd.core.bus.options import BusOptions, zenoh_config
from yahboomd.core.clock import SystemClock
from yahboomd.tools.fleet.fleet_feed import FleetFeed
from yahboomd.tools.fleet.fleet_list import read_list
from yahboomd.tools.fleet.fleet_plan import stop_key
from yahboomd.tools.fleet.fleet_stop import FleetStop
from yahboomd.tools.fleet.fleet_view import FleetView
from yahboomd.tools.fleet.stop_all import StopAll

ANSWER = json.dumps(
    {
        "success": True,
        "message": "Engaged.",
        "data": {"sent": True, "stands": True, "fastest_m_s": 0.0},
    }
)
SEEN = "seen.json"
"""What a daemon declares and answers: a file in the folder of the fleet."""

PATIENCE_S = 45.0


def router(file: str) -> None:
    """Be a router with its file."""
    with zenoh.open(zenoh.Config.from_json5(Path(file).read_text())):
        signal.pause()


def relay(listen: str, target: str, delay: str) -> None:
    """Pass bytes on, each direction later by a delay."""
    delay_s = float(delay)

    async def pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        loop = asyncio.get_running_loop()
        while data := await reader.read(65536):
            loop.call_later(delay_s, writer.write, data)
        loop.call_later(delay_s, writer.close)

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            there = await asyncio.open_connection("127.0.0.1", int(target))
            await asyncio.gather(
                pass_on(reader, there[1]), pass_on(there[0], writer), return_exceptions=True
            )
        writer.close()

    async def run() -> None:
        async with await asyncio.start_server(serve, "127.0.0.1", int(listen)) as server:
            await server.serve_forever()

    asyncio.run(run())


def joined(folder: str, namespace: str) -> zenoh.Session:
    """A session with a robot's certificate at the router of its site."""
    site, name = namespace.split("/")[1:]
    endpoint = json.loads(Path(folder, "ports.json").read_text())[site]
    file = Path(folder, "fleet", "robots", f"{name}.json5")
    options = BusOptions(connect=(f"tls/127.0.0.1:{endpoint}",), config_file=file)
    return opened(zenoh_config(options, uplink=True))


def opened(config: zenoh.Config) -> zenoh.Session:
    """Open a session; one try may be too short on a busy machine, or over a long way."""

    def once() -> zenoh.Session | None:
        with contextlib.suppress(zenoh.ZError):
            return zenoh.open(config)
        return None

    return wait_for(once, "a connection")


def ignore(_: object) -> None:
    """Take a sample, and do nothing."""


def robots(folder: str, *namespaces: str) -> None:
    """Be robots that acknowledge every stop, answer for their status, and publish poses if read."""
    seen: dict[str, Any] = json.loads(Path(folder, SEEN).read_text())
    kept: list[Any] = []
    poses = []
    done, cpu_s, start = until_terminated(), time.process_time(), time.monotonic()
    for namespace in namespaces:
        site = namespace.rpartition("/")[0]
        session = joined(folder, namespace)
        kept.append(session)

        def answer(query: zenoh.Query, own: str, key: str) -> None:
            what = key.removeprefix(f"{own}/")
            text = ANSWER if keys.ESTOP in key else seen["answers"].get(what)
            if text:
                with contextlib.suppress(zenoh.ZError):
                    query.reply(key if key.startswith(own) else stop_key(own), text)
            query.drop()

        for kind, pattern in seen["declared"]:
            key = pattern.format(robot=namespace, site=site)
            if kind == "subscriber":
                kept.append(session.declare_subscriber(key, Callback(ignore, indirect=False)))
            elif kind == "queryable":
                call = partial(answer, own=namespace, key=key)
                session.declare_queryable(key, Callback(call, indirect=False))
            elif kind == "token":
                kept.append(session.liveliness().declare_token(key))
            else:
                publisher = session.declare_publisher(
                    key, congestion_control=zenoh.CongestionControl.DROP, express=True
                )
                (poses if key.endswith(keys.POSE) else kept).append(publisher)
    took_s = time.monotonic() - start
    print("joined", took_s, time.process_time() - cpu_s, flush=True)
    # Each is to publish for its readers alone, as daemons do.
    start, count, looked_s, read = time.monotonic(), 0, -1.0, list(poses)
    while not done.is_set():
        passed_s = time.monotonic() - start
        if passed_s - looked_s >= 1.0:
            looked_s = passed_s
            read = [each for each in poses if each.matching_status.matching]
        due = int(passed_s * POSE_HZ)
        if due > count and read:
            for publisher in read:
                publisher.put(pose(due, time.time_ns()))
        count = due
        done.wait(TICK_S if read else 0.2)


def lie(folder: str, namespace: str, victim: str) -> None:
    """With a robot's certificate, acknowledge stops for another one, and for all."""
    session = joined(folder, namespace)

    def answer(query: zenoh.Query) -> None:
        for key in (stop_key(victim), str(query.key_expr)):
            with contextlib.suppress(zenoh.ZError):
                query.reply(key, ANSWER)
        query.drop()

    places = (victim, victim.rpartition("/")[0], f"{victim.partition('/')[0]}/*/*")
    for key in map(stop_key, places):
        session.declare_queryable(key, Callback(answer, indirect=False))
    print("lies", flush=True)
    signal.pause()


def stop(file: str) -> None:
    """Stop all as the command does; print when each acknowledged, and the report."""
    papers = Path(file)
    fleet = read_list(papers)
    progress = FleetStop(fleet.robots)
    work = StopAll(fleet, papers, progress, lambda _: None, SystemClock())
    print("begins", flush=True)
    asyncio.run(work.run())
    times = {name: robot.acknowledged_s for name, robot in progress.robots.items()}
    print("result " + json.dumps({"times": times, "report": progress.report()}), flush=True)


def person(papers: str) -> tuple[zenoh.Session, list[str]]:
    """A person's session at the first router of the file, and the robots of the list."""
    fleet = read_list(Path(papers))
    options = BusOptions(
        mode="client",
        listen=(),
        connect=(next(iter(fleet.ways)),),
        config_file=Path(papers),
        enforces=False,
    )
    return opened(zenoh_config(options)), fleet.robots


def tokens(papers: str) -> dict[str, float]:
    """How many robots' tokens are seen, and after how many seconds from opening a connection."""
    start, found = time.monotonic(), set[str]()
    session, listed = person(papers)

    def arrived(sample: zenoh.Sample) -> None:
        found.add(str(sample.key_expr).rpartition(f"/{keys.ALIVE}/")[0])

    with session:
        pattern = holder_key(full_key(f"{listed[0].partition('/')[0]}/*/*", keys.ALIVE), "*")
        session.liveliness().declare_subscriber(
            pattern, Callback(arrived, indirect=False), history=True
        )
        while found < set(listed) and time.monotonic() - start < PATIENCE_S:
            time.sleep(0.002)
    return {"tokens": len(found), "tokens_s": time.monotonic() - start}


async def looked(papers: Path, seconds: float) -> dict[str, float]:
    """Times and CPU of `fleet status`, and CPU of `fleet status --watch` after it."""
    fleet, clock = read_list(papers), SystemClock()
    feed = FleetFeed(fleet, papers, FleetView(fleet.robots), clock)
    start, cpu_s = time.monotonic(), time.process_time()
    running = asyncio.create_task(feed.run())
    while not feed.is_complete() and time.monotonic() - start < PATIENCE_S:
        feed.news.clear()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(feed.news.wait(), 1.0)
    status_s, status_cpu_s = time.monotonic() - start, time.process_time() - cpu_s
    print("complete", flush=True)
    start, cpu_s = time.monotonic(), time.process_time()
    while time.monotonic() - start < seconds:
        await asyncio.sleep(0.5)
        feed.view.rows(clock.now_ns())
    watch = (time.process_time() - cpu_s) / (time.monotonic() - start)
    rows = feed.view.rows(clock.now_ns())
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    return {
        "status_s": status_s,
        "status_cpu_s": status_cpu_s,
        "watch": watch,
        "answered": sum(row.seen_s is not None and row.seen_s < 5.0 for row in rows),
    }


def look(papers: str, seconds: str) -> None:
    """Wait for all tokens, ask all robots as `fleet status` does, and go on as its `--watch`."""
    result = tokens(papers)
    result |= asyncio.run(looked(Path(papers), float(seconds)))
    print("result " + json.dumps(result), flush=True)


def read(papers: str, seconds: str, *namespaces: str) -> None:
    """Receive the poses of some robots; prints their rate, losses and ages."""
    ages: list[int] = []
    numbers = defaultdict[str, list[int]](list)
    session, _ = person(papers)

    def take(sample: zenoh.Sample, robot: str) -> None:
        found = json.loads(sample.payload.to_bytes())
        ages.append(time.time_ns() - found["stamp_ns"])
        numbers[robot].append(found["seq"])

    with session:
        for each in namespaces:
            call = Callback(partial(take, robot=each), indirect=False)
            session.declare_subscriber(full_key(each, keys.POSE), call)
        time.sleep(3.0)
        print("reads", flush=True)
        ages.clear()
        numbers.clear()
        start = time.monotonic()
        time.sleep(float(seconds))
        took_s, found = time.monotonic() - start, list(ages)
    sent = sum(max(each) - min(each) + 1 for each in numbers.values())
    result = {
        "hz": len(found) / took_s,
        "lost": 1.0 - sum(map(len, numbers.values())) / max(1, sent),
        "p50_ms": quantile(found, 0.5) / 1e6,
        "p99_ms": quantile(found, 0.99) / 1e6,
        "worst_ms": max(found, default=0) / 1e6,
    }
    print("result " + json.dumps(result), flush=True)


if __name__ == "__main__":
    ROLES = {each.__name__: each for each in (router, relay, robots, lie, stop, look, read)}
    ROLES[sys.argv[1]](*sys.argv[2:])
