"""The processes of the fleet benchmark: routers, robots and an operator, all on loopback.

    python -m benchmarks.fleet_load router LISTEN [UPSTREAM HZ ROBOTS]
    python -m benchmarks.fleet_load large-router LISTEN
    python -m benchmarks.fleet_load robots ROUTER FIRST COUNT [thin]
    python -m benchmarks.fleet_load operator ROUTER COUNT SECONDS COMMANDS_HZ [FIRST]
    python -m benchmarks.fleet_load ears SECONDS ENDPOINT ...
    python -m benchmarks.fleet_load join ROUTER MODE COUNT
    python -m benchmarks.fleet_load fill ROUTER SHARED MOST

A robot here is a Zenoh client with a namespace that puts a pose of the daemon's size 50 times a
second and receives its commands, so that it looks like a daemon to the router. With HZ a router
forwards each robot's poses at most at that rate. Thin robots put a pose that was made once, except
the first ten of a process. An operator with FIRST is thin, for the robots from that number on:
Zenoh receives all their poses, and it reads those of the first ten.
"""

from __future__ import annotations

import json
import signal
import sys
import threading
import time
from collections.abc import Callable
from functools import partial

import msgspec
import zenoh
from zenoh.handlers import Callback, RingChannel

from benchmarks.results import quantile
from benchmarks.rig import client, client_config
from yahboomd.core.messages.native import PoseSample

POSE_HZ = 50
TICK_S = 0.002
PROBES = 10
"""Robots of a process with new poses, which are also the ones that a thin operator reads."""
MOST_SESSIONS = 5000


def until_terminated() -> threading.Event:
    """Make an event that is set when the process is asked to end."""
    done = threading.Event()
    signal.signal(signal.SIGTERM, lambda _number, _frame: done.set())
    return done


def router(
    listen: str, upstream: str = "", hz: str = "", count: str = "0", *, many: bool = False
) -> None:
    """Run a router: the same code as zenohd's, in a Python process that sleeps."""
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([listen]))
    config.insert_json5("scouting/multicast/enabled", "false")
    if many:
        config.insert_json5("transport/unicast/max_sessions", str(MOST_SESSIONS))
    if upstream:
        config.insert_json5("connect/endpoints", json.dumps([upstream]))
    if hz:
        # A rule has one clock for all keys that it matches, so each robot needs its own rule.
        rule = {
            "flows": ["egress"],
            "messages": ["put"],
            "rules": [
                {"key_expr": f"bot{n}/yahboomd/pose", "freq": float(hz)} for n in range(int(count))
            ],
        }
        config.insert_json5("downsampling", json.dumps([rule]))
    done = until_terminated()
    with zenoh.open(config):
        print("ready", flush=True)
        done.wait()


def pose(seq: int, sent_ns: int) -> bytes:
    """A pose sample with a monotonic stamp, because all processes of a machine share that clock."""
    sample = PoseSample(
        stamp_ns=sent_ns,
        seq=seq,
        frame_id="odom",
        child_frame_id="base_link",
        x=1.2345678901234567,
        y=-0.3456789012345678,
        theta=2.3456789012345678,
        covariance=(1.234567890123e-05,) * 9,
    )
    return msgspec.json.encode(sample)


def robots(endpoint: str, first: str, count: str, thin: str = "") -> None:
    """Run clients with namespaces, in one process, their puts spread over the period."""
    heard = [0]
    puts = []
    sessions = []
    for n in range(int(first), int(first) + int(count)):
        session = client(endpoint)

        def take(_sample: zenoh.Sample) -> None:
            heard[0] += 1

        session.declare_subscriber(f"bot{n}/cmd_vel", Callback(take, indirect=False))
        publisher = session.declare_publisher(
            f"bot{n}/yahboomd/pose",
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
        )
        puts.append(publisher.put)
        sessions.append(session)
    done = until_terminated()
    print("ready", flush=True)
    start = time.monotonic()
    sent = 0
    made = pose(0, 0)
    fresh = PROBES if thin else len(puts)
    while not done.is_set():
        due = int((time.monotonic() - start) * POSE_HZ * len(puts))
        # A late robot skips whole periods.
        sent = max(sent, due - len(puts))
        while sent < due:
            which = sent % len(puts)
            puts[which](pose(sent, time.monotonic_ns()) if which < fresh else made)
            sent += 1
        time.sleep(TICK_S)
    print("heard", heard[0], "sent", sent, flush=True)
    for session in sessions:
        session.close()


def operator(endpoint: str, count: str, seconds: str, commands_hz: str, first: str = "") -> None:
    """Receive every pose and command every robot; prints the result."""
    thin, numbers = bool(first), range(int(first or 0), int(first or 0) + int(count))
    rings = []
    ages: list[int] = []
    stamp = b'"stamp_ns":'

    def take(sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        at = payload.index(stamp) + len(stamp)
        ages.append(time.monotonic_ns() - int(payload[at : payload.index(b",", at)]))

    with client(endpoint) as session:
        if thin:
            # A ring runs no Python for its poses. The poses that are read share their connection,
            # so they are lost and delayed in the same way.
            for n in numbers:
                key = f"bot{n}/yahboomd/pose"
                rings.append(session.declare_subscriber(key, RingChannel(1)))
            for n in numbers[:PROBES]:
                session.declare_subscriber(f"bot{n}/yahboomd/pose", Callback(take, indirect=False))
        else:
            session.declare_subscriber("*/yahboomd/pose", Callback(take, indirect=False))
        time.sleep(1.0)
        puts = [
            session.declare_publisher(
                f"bot{n}/cmd_vel", priority=zenoh.Priority.REAL_TIME, express=True
            ).put
            for n in numbers
        ]
        rate = float(commands_hz) * len(puts)
        ages.clear()
        start = time.monotonic()
        sent = 0
        while (passed := time.monotonic() - start) < float(seconds):
            while sent < passed * rate:
                puts[sent % len(puts)](b'{"vx":0.3,"wz":0.1}')
                sent += 1
            time.sleep(TICK_S)
        took, found = time.monotonic() - start, list(ages)
        if thin:
            # Referenced until here: Zenoh undeclares a ring without a reference.
            assert all(ring.try_recv() for ring in rings[:PROBES])
    result = {
        "poses_hz": len(found) / took * (len(puts) / PROBES if thin else 1.0),
        "commands_hz": sent / took,
        "p50_ns": quantile(found, 0.5),
        "p99_ns": quantile(found, 0.99),
    }
    print("result", json.dumps(result), flush=True)


def ears(seconds: str, *endpoints: str) -> None:
    """Receive the poses of daemons, each at its own endpoint; prints their number and age."""
    ages: list[int] = []

    def take(sample: zenoh.Sample) -> None:
        ages.append(time.time_ns() - int(json.loads(sample.payload.to_bytes())["stamp_ns"]))

    sessions = [client(endpoint) for endpoint in endpoints]
    for session in sessions:
        session.declare_subscriber("yahboomd/pose", Callback(take, indirect=False))
    time.sleep(2.0)
    print("ready", flush=True)
    ages.clear()
    start = time.monotonic()
    time.sleep(float(seconds))
    took, found = time.monotonic() - start, list(ages)
    result = {
        "poses_hz": len(found) / took,
        "p50_ns": quantile(found, 0.5),
        "p99_ns": quantile(found, 0.99),
    }
    print("result", json.dumps(result), flush=True)
    for session in sessions:
        session.close()


def join(endpoint: str, mode: str, count: str) -> None:
    """Join a router with many sessions that subscribe; prints their CPU seconds."""
    sessions = []
    before = time.process_time()
    for n in range(int(count)):
        config = client_config(endpoint, mode=mode)
        config.insert_json5("listen/endpoints", "[]")
        sessions.append(zenoh.open(config))
        sessions[-1].declare_subscriber(f"bot{n}/cmd_vel", RingChannel(1))
    time.sleep(1.0)
    done = until_terminated()
    print("joined", time.process_time() - before, flush=True)
    done.wait()
    for session in sessions:
        session.close()


def fill(endpoint: str, shared: str, most: str) -> None:
    """Open idle clients until the router refuses one or there are ``most``; prints their number."""
    sessions: list[zenoh.Session] = []
    config = client_config(endpoint, shared=shared == "shared")
    # A full router refuses again; a busy one accepts the second attempt.
    refused = 0
    while len(sessions) < int(most) and refused < 3:
        try:
            sessions.append(zenoh.open(config))
        except zenoh.ZError:
            refused += 1
            time.sleep(0.2)
    done = until_terminated()
    print("taken", len(sessions), flush=True)
    done.wait()
    for session in sessions:
        session.close()


if __name__ == "__main__":
    ROLES: dict[str, Callable[..., None]] = {
        "router": router,
        "large-router": partial(router, many=True),
        "robots": robots,
        "operator": operator,
        "ears": ears,
        "join": join,
        "fill": fill,
    }
    ROLES[sys.argv[1]](*sys.argv[2:])
