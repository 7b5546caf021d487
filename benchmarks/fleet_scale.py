"""How far a fleet goes: real daemons, thin robots, rules for 2,000, and a way with loss.

    python -m benchmarks.fleet_scale [real] [thin] [rules] [wan] [--zenohd PROGRAM]

Everything has the files of `yahboomd fleet init`, on this one machine: robots, routers and the
operator share its cores, so the first limit is that of their sum. A share of a core that a process
needs for each robot carries over to machines of the same kind; a largest number does not. `wan`
needs a network namespace: ``unshare --net``, as root.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import time
from collections.abc import Iterator, Sequence
from typing import Any

import zenoh

from benchmarks import rig
from benchmarks.fleet_rig import FLEET, SITES, Change, Fleet
from benchmarks.results import Table, number
from benchmarks.stop_fifty import stop
from yahboomd.tools.fleet.fleet_list import ZenohFile

ONE = SITES[:1]
READ = 50
"""Robots whose poses are read."""


class Meter:
    """The CPU of processes since it was made or reset."""

    def __init__(self, processes: Sequence[rig.Process]) -> None:
        self._processes = processes
        self.reset()

    def reset(self) -> None:
        self._before = [rig.usage(each.pid) for each in self._processes]

    def percent(self) -> float:
        """Of a core, all of them together."""
        now = [rig.usage(each.pid) for each in self._processes]
        return 100 * sum(map(rig.share_of_core, self._before, now))

    def cpu_s(self) -> float:
        now = [rig.usage(each.pid) for each in self._processes]
        return sum(b.cpu_ns - a.cpu_ns for a, b in zip(self._before, now, strict=True)) / 1e9


@contextlib.contextmanager
def fleet_of(**options: Any) -> Iterator[Fleet]:  # noqa: ANN401 - those of Fleet
    with rig.folder() as folder:
        fleet = Fleet(folder, **options)
        try:
            yield fleet
        finally:
            fleet.close()


def routers_of(fleet: Fleet) -> list[rig.Process]:
    return [fleet.processes[name] for name in fleet.routers]


def reading(
    fleet: Fleet, names: Sequence[str], seconds: float, meters: Sequence[Meter]
) -> tuple[dict[str, Any], list[float]]:
    """Have the operator read poses; returns the result, and the CPU of the meters meanwhile."""
    robots = map(fleet.namespace, names)
    reader = fleet.begin("reader", "read", str(fleet.papers), str(seconds), *robots)
    reader.says("reads")
    for each in meters:
        each.reset()
    time.sleep(0.9 * seconds)
    shares = [each.percent() for each in meters]
    found = fleet.result("reader")
    reader.end_by_itself()
    return found, shares


def stopped(fleet: Fleet) -> tuple[str, str]:
    """Stop all; returns how many acknowledged, and the seconds until the last one did."""
    times = [each for each in stop(fleet)["times"].values() if each is not None]
    return f"{len(times)} of {len(fleet.names)}", number(max(times, default=float("nan")))


def real(zenohd: str, *, count: int, seconds: float) -> Table:
    """Real daemons under one router, and under a tree of three."""
    rows = []
    for sites in (ONE, SITES):
        with fleet_of(robots=count, real=count, sites=sites, zenohd=zenohd) as fleet:
            fleet.start()
            router = Meter(routers_of(fleet))
            daemons = Meter([fleet.processes[name] for name in fleet.real])
            time.sleep(2.0)
            router.reset()
            daemons.reset()
            time.sleep(seconds)
            rest = router.percent(), daemons.percent() / count
            with fleet.driven():
                found, busy = reading(fleet, fleet.names, seconds, (router, daemons))
                last = stopped(fleet)
        rows.append(
            ["1 router" if sites == ONE else "a tree of 3", *map(number, rest), number(busy[0]),
             number(busy[1] / count), number(found["hz"] / count), number(100 * found["lost"]),
             number(found["p50_ms"]), number(found["p99_ms"]), *last]
        )  # fmt: skip
    return Table(
        title=f"{count} real daemons on simulated boards. CPU in percent of a core: all routers "
        "together, and each daemon; at rest nobody reads, driven they obey 20 commands a second "
        "each and one operator reads every pose.",
        header=["", "routers at rest", "a daemon at rest", "routers driven", "a daemon driven",
                "poses/s of each", "lost %", "p50 ms", "p99 ms", "stopped", "last, s"],
        rows=rows,
    )  # fmt: skip


def thin(zenohd: str, *, counts: Sequence[int], seconds: float) -> Table:
    """Growing numbers of thin robots on one router."""
    rows = []
    for count in counts:
        with fleet_of(robots=count, sites=ONE, zenohd=zenohd) as fleet:
            fleet.start_routers()
            router = Meter(routers_of(fleet))
            empty_mb = rig.usage(routers_of(fleet)[0].pid).rss_mb
            fleet.start_robots()
            join_ms = 1e3 * router.cpu_s() / count
            time.sleep(3.0)
            mb = rig.usage(routers_of(fleet)[0].pid).rss_mb
            router.reset()
            time.sleep(seconds)
            rest = router.percent()
            look = fleet.begin("look", "look", str(fleet.papers), str(seconds))
            look.says("complete")
            router.reset()
            found = fleet.result("look")
            watched = router.percent()
            look.end_by_itself()
            read, busy = reading(fleet, fleet.names[:READ], seconds, (router,))
            last = stopped(fleet)
        rows.append(
            [str(count), number(join_ms), number(mb), number(1e3 * (mb - empty_mb) / count),
             number(rest), f"{found['tokens']} of {count} in {number(found['tokens_s'])}",
             number(found["status_s"]),
             number(found["status_cpu_s"]), number(100 * found["watch"]), number(watched),
             f"{found['answered']} of {count}", number(1e4 * busy[0] / read["hz"]),
             number(read["p99_ms"]), *last]
        )  # fmt: skip
        print(rows[-1], flush=True)
    return Table(
        title="Thin robots on one router, each with all declarations of a daemon. Poses: those of "
        f"{READ} robots are read, at 50 Hz each.",
        header=["robots", "router ms to join, each", "router MB", "kB each", "router at rest, %",
                "tokens, s", "`fleet status`, s", "its CPU, s", "`--watch`, %",
                "router meanwhile, %", "answered", "router µs a pose", "p99 ms", "stopped",
                "last, s"],
        rows=rows,
    )  # fmt: skip


def without_rules(content: ZenohFile) -> None:
    del content["access_control"]


def thinned(listed: int, hz: float) -> Change:
    """A rule for each of many robots, those that are read among them, on a fast limit."""

    def change(content: ZenohFile) -> None:
        content["downsampling"] = [
            {
                "flows": ["egress"],
                "messages": ["put"],
                "rules": [
                    {"key_expr": f"{FLEET}/{ONE[0]}/bot{n}/yahboomd/*", "freq": hz}
                    for n in range(listed)
                ],
            }
        ]

    return change


def rules(zenohd: str, *, many: int, few: int, seconds: float) -> Table:
    """What long lists of rules cost a router."""
    rows = []
    cases: list[tuple[str, int, Change]] = [
        ("no rules", few, without_rules),
        (f"access rules for {few}", few, lambda _: None),
        (f"access rules for {many}", many, lambda _: None),
        (f"these, and downsampling for {few}", many, thinned(few, 1000.0)),
        (f"these, and downsampling for {many}", many, thinned(many, 1000.0)),
    ]
    for name, listed, change in cases:
        options: dict[str, Any] = {"robots": listed, "joined": few, "sites": ONE}
        with fleet_of(**options, zenohd=zenohd, change=change) as fleet:
            took_s = fleet.start_routers()[ONE[0]]
            router = Meter(routers_of(fleet))
            empty_mb = rig.usage(routers_of(fleet)[0].pid).rss_mb
            size_mb = (fleet.folder / f"{ONE[0]}.json5").stat().st_size / 1e6
            fleet.start_robots()
            join_ms = 1e3 * router.cpu_s() / few
            mb = rig.usage(routers_of(fleet)[0].pid).rss_mb
            read, busy = reading(fleet, fleet.names[:few], seconds, (router,))
        rows.append(
            [name, number(size_mb), number(took_s), number(empty_mb), number(join_ms),
             number(1e3 * (mb - empty_mb) / few), number(1e4 * busy[0] / read["hz"]),
             number(read["hz"]), number(read["p50_ms"]), number(read["p99_ms"])]
        )  # fmt: skip
        print(rows[-1], flush=True)
    return Table(
        title=f"One router with {few} thin robots, whose poses one operator reads, 50 a second of "
        "each. The downsampling limits pass all.",
        header=["", "file MB", "listens after s", "MB", "ms to join, each", "kB each",
                "µs a pose", "poses/s", "p50 ms", "p99 ms"],
        rows=rows,
    )  # fmt: skip


WAYS = ((50.0, 0.0, 0.3), (50.0, 0.01, 0.3), (100.0, 0.0, 0.3), (100.0, 0.01, 0.3),
        (100.0, 0.01, 0.5), (100.0, 0.01, 1.0), (200.0, 0.01, 1.0))  # fmt: skip
"""Milliseconds of each direction, loss, and the timeout of the operator's commands."""


def wan(zenohd: str, *, count: int, seconds: float, ways: Sequence[tuple[float, ...]]) -> Table:
    """A tree whose ways to the upper router are long and lose packets."""
    rows = []
    for delay_ms, loss, timeout_s in ways:
        options: dict[str, Any] = {"robots": count, "real": 2, "timeout_s": timeout_s}
        with fleet_of(**options, delay_s=delay_ms / 1e3, loss=loss, zenohd=zenohd) as fleet:
            fleet.start()
            with fleet.driven():
                wheels = [Wheels(fleet.local[name]) for name in fleet.real]
                found, _ = reading(fleet, fleet.names, seconds, ())
                for each in wheels:
                    each.session.close()
            last = stopped(fleet)
        moved = [each for one in wheels for each in one.commanded]
        stops = sum(one.stops for one in wheels)
        minutes = len(wheels) * (seconds + 3.0) / 60
        rows.append(
            [number(delay_ms), number(100 * loss), number(timeout_s), number(found["hz"] / count),
             number(100 * found["lost"]), number(found["p50_ms"]), number(found["p99_ms"]),
             number(found["worst_ms"]), number(stops / minutes),
             number(100 * sum(moved) / max(1, len(moved))), *last]
        )  # fmt: skip
        print(rows[-1], flush=True)
    return Table(
        title=f"{count} robots at two sites, 2 of them real and driven at 20 commands a second. "
        "Every packet to and from the upper router takes the delay, and may be lost; operator and "
        "sites are both behind such a way, so a pose or a command passes two.",
        header=["ms each way", "loss %", "timeout, s", "poses/s of each", "lost %", "p50 ms",
                "p99 ms", "worst ms", "stops a minute", "drives, % of the time", "stopped",
                "last, s"],
        rows=rows,
    )  # fmt: skip


class Wheels:
    """What a robot's wheels are commanded to, as read on the robot itself."""

    def __init__(self, endpoint: str) -> None:
        self.commanded: list[bool] = []
        self.stops = 0
        self.session = rig.client(endpoint)
        self.session.declare_subscriber(f"{FLEET}/*/*/yahboomd/wheels", self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        drives = any(json.loads(sample.payload.to_bytes())["command_m_s"])
        if not drives and self.commanded and self.commanded[-1]:
            self.stops += 1
        self.commanded.append(drives)


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.fleet_scale")
    names = ("real", "thin", "rules", "wan")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(names)}")
    parser.add_argument("--zenohd", default="", help="the routers' program")
    parser.add_argument(
        "--short", action="store_true", help="few robots: only to see that it works"
    )
    args = parser.parse_args()
    short, chosen = args.short, args.names or names
    seconds = 2.0 if short else 8.0
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores", flush=True)
    tables = {
        "real": lambda: real(args.zenohd, count=2 if short else 20, seconds=seconds),
        "thin": lambda: thin(
            args.zenohd, counts=(5,) if short else (50, 100, 200, 500, 1000), seconds=seconds
        ),
        "rules": lambda: rules(
            args.zenohd, many=20 if short else 2000, few=5 if short else 20, seconds=seconds
        ),
        "wan": lambda: wan(
            args.zenohd, count=4 if short else 20, seconds=3.0 if short else 60.0,
            ways=WAYS[1:2] if short else WAYS,
        ),
    }  # fmt: skip
    for name in chosen:
        print(f"\n{tables[name]().markdown()}\n", flush=True)
        print(f"load {os.getloadavg()[0]:.1f}", flush=True)


if __name__ == "__main__":
    main()
