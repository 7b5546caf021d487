"""The number of robots that one machine and one router carry, and the cost of a message.

Robots on one machine: a growing number of pairs of `yahboomd simulate` and `yahboomd run`,
streamed, which publish at 50 Hz to a subscriber, until poses are lost or late. One router: clients
with a namespace each put a 360-byte pose 50 times a second through one router process (a Python
session in router mode, which runs the same code as zenohd); an operator receives all of them and
sends 10 commands a second to each. Robots, router and operator share the machine's two cores, so
the CPU of each shows which one saturates first. It is the operator, whose Python reads each pose.
Therefore larger numbers are measured with thin robots, and one thin operator for each 200 of them:
poses are made once, and only ten robots in each 200 stamp theirs, which alone are read; all poses
go through the router and are received. Everything stays on loopback and ends after some seconds.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks import pictures, rig
from benchmarks.results import Section, median, method, milliseconds, number

PER_PROCESS = 100
PER_OPERATOR = 200
"""Thin robots on one operator, because one connection carries no more."""
POSE_HZ = 50
COMMANDS_HZ = 10


class Load(NamedTuple):
    """The result of one number of robots.

    Attributes:
        offered_hz: Poses a second that the robots should send.
        result: The operators' measurements.
        router: The router's CPU, as a share of a core.
        robots: The same for all robots' processes.
        operator: The same for the operators.
        rss_mb: The router's resident memory.
    """

    offered_hz: float
    result: dict[str, float]
    router: float
    robots: float
    operator: float
    rss_mb: float

    def received(self) -> float:
        """The share of the poses that the operators received."""
        return self.result["poses_hz"] / self.offered_hz


def routed(count: int, seconds: float, *, listened: bool = True, thin: bool = False) -> Load:
    """Measure robots on one router.

    Args:
        count: Number of robots.
        seconds: Duration.
        listened: Whether an operator subscribes to them and commands them.
        thin: Robots and operator spend next to no Python on a pose.
    """
    how = ("thin",) if thin else ()
    firsts = range(0, count, PER_OPERATOR) if thin else range(1)
    endpoint = rig.free_endpoint()
    load = ("-m", "benchmarks.fleet_load")
    with contextlib.ExitStack() as stack:
        router = stack.enter_context(rig.Process(*load, "large-router", endpoint))
        router.says("ready")
        crowds = [
            stack.enter_context(
                rig.Process(
                    *(*load, "robots", endpoint),
                    *(str(first), str(min(PER_PROCESS, count - first)), *how),
                )
            )
            for first in range(0, count, PER_PROCESS)
        ]
        for crowd in crowds:
            crowd.says("ready")
        operators: list[rig.Process] = []
        for first in firsts if listened else ():
            robots = min(PER_OPERATOR, count - first) if thin else count
            options = (str(robots), str(seconds + 1.0), str(COMMANDS_HZ))
            which = (str(first),) if thin else ()
            process = rig.Process(*load, "operator", endpoint, *options, *which)
            operators.append(stack.enter_context(process))
        if operators:
            time.sleep(2.0)
        meters = [router, *crowds, *operators]
        before = [rig.usage(each.pid) for each in meters]
        time.sleep(seconds - 0.5)
        after = [rig.usage(each.pid) for each in meters]
        shares = [rig.share_of_core(a, b) for a, b in zip(before, after, strict=True)]
        results = [json.loads(each.says("result ").split(" ", 1)[1]) for each in operators]
        return Load(
            offered_hz=count * POSE_HZ,
            result=together(results),
            router=shares[0],
            robots=sum(shares[1 : 1 + len(crowds)]),
            operator=sum(shares[1 + len(crowds) :]),
            rss_mb=after[0].rss_mb,
        )


def together(results: Sequence[dict[str, float]]) -> dict[str, float]:
    """The sum of all operators' results; the median of their medians, and the largest p99."""
    if not results:
        return {}
    return {
        "poses_hz": sum(each["poses_hz"] for each in results),
        "commands_hz": sum(each["commands_hz"] for each in results),
        "p50_ns": median([each["p50_ns"] for each in results]),
        "p99_ns": max(each["p99_ns"] for each in results),
    }


def pairs(count: int, seconds: float) -> dict[str, float]:
    """Measure pairs of simulated board and daemon on this machine."""
    endpoints = [rig.free_endpoint() for _ in range(count)]
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(rig.folder())
        boards, daemons = [], []
        for n, endpoint in enumerate(endpoints):
            boards.append(stack.enter_context(rig.simulator(where, name=f"board{n}")))
            daemons.append(stack.enter_context(rig.daemon(where, endpoint, port=f"board{n}")))
        ears = rig.Process("-m", "benchmarks.fleet_load", "ears", str(seconds), *endpoints)
        stack.enter_context(ears)
        ears.says("ready")
        before = [rig.usage(each.pid) for each in (*boards, *daemons)]
        found: dict[str, float] = json.loads(ears.says("result ").split(" ", 1)[1])
        after = [rig.usage(each.pid) for each in (*boards, *daemons)]
        shares = [rig.share_of_core(a, b) for a, b in zip(before, after, strict=True)]
        found["board"] = sum(shares[:count]) / count
        found["daemon"] = sum(shares[count:]) / count
        found["rss_mb"] = sum(each.rss_mb for each in after[count:]) / count
        return found


def edge(seconds: float) -> tuple[float, float, float]:
    """Measure twenty robots behind an edge router that passes on two poses a second of each.

    Returns:
        Poses a second that they send, poses a second that an operator at the upper router
        receives, and the upper router's CPU as a share of a core.
    """
    upper, lower = rig.free_endpoint(), rig.free_endpoint()
    load = ("-m", "benchmarks.fleet_load")
    with contextlib.ExitStack() as stack:
        top = stack.enter_context(rig.Process(*load, "router", upper))
        top.says("ready")
        stack.enter_context(rig.Process(*load, "router", lower, upper, "2", "20")).says("ready")
        stack.enter_context(rig.Process(*load, "robots", lower, "0", "20")).says("ready")
        time.sleep(1.0)
        operator = rig.Process(*load, "operator", upper, "20", str(seconds), "1")
        stack.enter_context(operator)
        time.sleep(1.5)
        before = rig.usage(top.pid)
        time.sleep(seconds - 1.0)
        share = rig.share_of_core(before, rig.usage(top.pid))
        result = json.loads(operator.says("result ").split(" ", 1)[1])
        return 20.0 * POSE_HZ, float(result["poses_hz"]), share


def joined(mode: str, count: int) -> tuple[float, float, float]:
    """Measure sessions that join one router.

    Returns:
        CPU seconds of the sessions, CPU seconds of the router, and the router's MB.
    """
    endpoint = rig.free_endpoint()
    load = ("-m", "benchmarks.fleet_load")
    with rig.Process(*load, "router", endpoint) as router:
        router.says("ready")
        before = rig.usage(router.pid)
        with rig.Process(*load, "join", endpoint, mode, str(count)) as crowd:
            took = float(crowd.says("joined ").split()[1])
            after = rig.usage(router.pid)
    return took, (after.cpu_ns - before.cpu_ns) * 1e-9, after.rss_mb


def taken(*, shared: bool, most: int) -> int:
    """Count the idle clients that a router with its defaults accepts, of ``most``."""
    endpoint = rig.free_endpoint()
    load = ("-m", "benchmarks.fleet_load")
    with rig.Process(*load, "router", endpoint) as router:
        router.says("ready")
        words = ("shared" if shared else "apart", str(most))
        with rig.Process(*load, "fill", endpoint, *words) as crowd:
            return int(crowd.says("taken ").split()[1])


ROUTED = (
    "robots", "poses/s sent", "poses/s received", "commands/s", "p50 ms", "p99 ms", "router CPU",
    "router µs a message", "robots CPU", "operator CPU", "router MB",
)  # fmt: skip


def crowd(
    section: Section, title: str, counts: Sequence[int], seconds: float, *, thin: bool
) -> list[tuple[int, Load]]:
    """Measure growing numbers of robots, until a tenth of their poses is lost."""
    rows, found = [], []
    for count in counts:
        try:
            load = routed(count, seconds, thin=thin)
        except (TimeoutError, ChildProcessError) as error:
            section.findings.append(f"{count} robots were not served within a minute ({error}).")
            break
        result = load.result
        messages = result["poses_hz"] + result["commands_hz"]
        found.append((count, load))
        rows.append(
            [str(count), number(load.offered_hz), number(result["poses_hz"]),
             number(result["commands_hz"]), milliseconds(result["p50_ns"]),
             milliseconds(result["p99_ns"]), number(100 * load.router),
             number(load.router / messages * 1e6), number(100 * load.robots),
             number(100 * load.operator), number(load.rss_mb)]
        )  # fmt: skip
        if load.received() < 0.9:
            break
    section.table(title, ROUTED, rows)
    return found


def limits(section: Section, full: list[tuple[int, Load]], thin: list[tuple[int, Load]]) -> None:
    """Report the largest numbers, and their limit."""
    for name, found in (("robots and an operator in Python", full), ("thin robots", thin)):
        served = [each for each in found if each[1].received() > 0.99]
        for count, load in dict((*served[-1:], *found[-1:])).items():
            section.findings.append(
                f"{count} {name} on one router: {number(100 * load.received())} % of the poses "
                f"arrive, {milliseconds(load.result['p50_ns'])} ms old at the median. CPU: router "
                f"{number(100 * load.router)} % of a core, robots {number(100 * load.robots)} %, "
                f"operators {number(100 * load.operator)} %, on {os.cpu_count()} cores."
            )


def draw(
    section: Section, full: list[tuple[int, Load]], thin: list[tuple[int, Load]], images: Path
) -> None:
    """Draw CPU by number of robots."""
    figure, axes = pictures.blank()
    for found, line, kind in ((full, "-", ""), (thin, "--", ", thin")):
        counts = [count for count, _ in found]
        for n, (name, shares) in enumerate(
            (
                ("router", [each.router for _, each in found]),
                ("robots", [each.robots for _, each in found]),
                ("operator", [each.operator for _, each in found]),
            )
        ):
            values = [100 * share for share in shares]
            axes.plot(counts, values, "o" + line, color=pictures.COLOURS[n], label=name + kind,
                      markersize=4)  # fmt: skip
    axes.set(xlabel="robots on one router, 50 poses a second each", ylabel="% of one core")
    axes.legend(fontsize=8, frameon=False)
    caption = "CPU of router, robots and operators, all on one machine of two cores."
    pictures.keep(section, figure, images, "fleet.png", caption)


def bench(*, short: bool, images: Path) -> Section:
    """Measure pairs on one machine, robots on one router, joining and thinning."""
    section = Section(
        name="fleet",
        title="Fleet",
        about="How many robots one machine and one Zenoh router carry. [A fleet](fleet.md) says "
        "what to do with these figures.",
        how=method(__doc__),
    )
    seconds = 2.0 if short else 6.0
    rows = []
    for count in (1,) if short else (1, 4, 8, 12, 16, 20, 24, 28):
        found = pairs(count, seconds)
        share = found["poses_hz"] / (count * POSE_HZ)
        rows.append(
            [str(count), number(found["poses_hz"]), number(100 * share),
             milliseconds(found["p50_ns"]), milliseconds(found["p99_ns"]),
             number(100 * found["daemon"]), number(100 * found["board"]),
             number(found["rss_mb"])]
        )  # fmt: skip
        if share < 0.9:
            break
    section.table(
        "Pairs of simulator and daemon on this machine. Age is the time from the board's sampling "
        "to the subscriber; CPU is percent of a core for each process.",
        ["pairs", "poses/s", "% of 50 Hz each", "age p50 ms", "age p99 ms", "daemon CPU",
         "simulator CPU", "daemon MB"],
        rows,
    )  # fmt: skip
    full = crowd(
        section,
        "One router. A message is one pose or command, in and out. CPU in percent of a core.",
        (10,) if short else (25, 50, 100, 200, 300, 400),
        seconds,
        thin=False,
    )
    thin = crowd(
        section,
        "The same with thin robots and a thin operator for each 200. Poses received are estimated "
        "from those that are read.",
        (20,) if short else (100, 200, 400, 600, 800, 1000, 1200),
        seconds,
        thin=True,
    )
    limits(section, full, thin)
    draw(section, full, thin, images)
    count = 10 if short else 200
    alone = routed(count, seconds, listened=False)
    section.findings.append(
        f"{count} robots without a subscriber cost the router {number(100 * alone.router)} % of a "
        "core: Zenoh sends nothing while there is no subscriber."
    )
    most = 20 if short else 1100
    apart, shared = taken(shared=False, most=most), taken(shared=True, most=most)
    section.findings.append(
        f"A router with default settings accepts {apart} of {most} idle clients (the limit is "
        f"`transport/unicast/max_sessions`), but only {shared} on its own machine if they use "
        "shared memory, which is Zenoh's default and which the daemon turns off."
    )
    rows = []
    for mode in ("client", "router"):
        for many in (5,) if short else (10, 20, 40):
            took, cost, rss_mb = joined(mode, many)
            rows.append([mode, str(many), number(1000 * took / many), number(1000 * cost / many),
                         number(rss_mb)])  # fmt: skip
    section.table(
        "Joining a router, as a client or as another router.",
        ["mode", "sessions", "CPU ms each", "CPU ms of the router each", "router MB"],
        rows,
    )
    offered, got, share = edge(3.0 if short else 6.0)
    section.findings.append(
        f"An edge router that thins poses to 2 Hz passes on {number(got)} of {number(offered)} "
        f"poses a second; the router above uses {number(100 * share)} % of a core."
    )
    return section
