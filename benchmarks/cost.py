"""CPU, memory and threads of the daemon, by rate, and beside the least that a program can do.

CPU is the kernel's account of all threads over some seconds. A polled board is polled at the rate
at which pose, twist and wheels are published to a subscriber in another process. Commands come 20
times a second, each different from the last. Two bare programs run at the same time, each on a port
of the same thin board and with a subscriber of its own: a reader of the same lines, which decodes
them and puts one sample 50 times a second, and one that puts the daemon's three samples and writes
a frame for each command, with no odometry and no safety. Standing and driving alternate, and the
ratios are taken round by round: a disturbance of the machine affects all of them.
"""

from __future__ import annotations

import contextlib
import itertools
import time
from pathlib import Path
from typing import NamedTuple

from benchmarks import rig
from benchmarks.latency import command, publisher
from benchmarks.results import Section, median, method, number

COMMANDS_HZ = 20
DAEMON, READER, DRIVER = "yahboomd", "bare reader", "bare program that drives"
BARE = {READER: "", DRIVER: "-drives"}
"""The bare programs, and what follows the dialect in their names among the floors."""


class Cost(NamedTuple):
    """The use of one process.

    Attributes:
        standing: CPU as a share of one core, round by round.
        driving: The same while commands come.
        rss_mb: Resident memory in the end.
        threads: Number of threads.
    """

    standing: list[float]
    driving: list[float]
    rss_mb: float
    threads: int


def measure(
    seconds: float, rounds: int, *settings: str, dialect: str, line_us: int = 5917, bare: bool
) -> dict[str, Cost]:
    """Run a daemon on a thin board, with the bare programs if asked for."""
    names = [DAEMON, *(BARE if bare else ())]
    options = ("--dialect", dialect, "--line-us", str(line_us))
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(rig.folder())
        stack.enter_context(rig.thin_board(where, *options, ports=len(names)))
        pids, puts = {}, []
        for n, name in enumerate(names):
            endpoint = rig.free_endpoint()
            if name == DAEMON:
                process = stack.enter_context(rig.daemon(where, endpoint, *settings))
            else:
                kind, port = dialect + BARE[name], str(where / f"port{n}")
                process = rig.Process("-m", "benchmarks.floors", kind, endpoint, port)
                stack.enter_context(process).says("ready")
            pids[name] = process.pid
            session = stack.enter_context(rig.client(endpoint))
            if name == DAEMON:
                rig.Status(session).ready()
            puts.append(publisher(session).put)
            stack.enter_context(rig.Process("-m", "benchmarks.listener", endpoint)).says("ready")
        shares: dict[str, tuple[list[float], list[float]]] = {name: ([], []) for name in names}
        numbers = itertools.count()
        time.sleep(2.0)
        for _, driving in itertools.product(range(rounds), (0, 1)):
            before = {name: rig.usage(pid) for name, pid in pids.items()}
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                if driving:
                    payload = command(300 + 7 * next(numbers) % 100)
                    for put in puts:
                        put(payload)
                time.sleep(1.0 / COMMANDS_HZ)
            for name, pid in pids.items():
                share = rig.share_of_core(before[name], rig.usage(pid))
                shares[name][driving].append(share)
            if driving:
                # The daemon needs this time to stop the wheels and to see them stand.
                time.sleep(2.0)
        ends = {name: rig.usage(pid) for name, pid in pids.items()}
        return {name: Cost(*shares[name], ends[name].rss_mb, ends[name].threads) for name in names}


def bench(*, short: bool, images: Path) -> Section:  # noqa: ARG001 - draws no picture
    """Measure CPU, memory and threads."""
    section = Section(
        name="cost",
        title="CPU and memory",
        about="What the daemon costs the robot's computer, and what programs cost that do the "
        "least on the same board.",
        how=method(__doc__),
    )
    seconds, rounds = (1.0, 1) if short else (6.0, 2)
    rows = []
    for rate_hz in (50,) if short else (20, 50, 100, 200):
        rates = (f"odometry.poll_rate_hz={rate_hz}", f"odometry.publish_rate_hz={rate_hz}")
        use = measure(seconds, rounds, *rates, dialect="polled", bare=False)[DAEMON]
        rows.append([f"polled, {rate_hz} Hz", *cells(use)])
    for line_us in () if short else (5917, 3472, 2457):
        use = measure(seconds, rounds, dialect="streamed", line_us=line_us, bare=False)[DAEMON]
        name = f"streamed, {1e6 / line_us:.0f} lines a second, published at 50 Hz"
        rows.append([name, *cells(use)])
    driven = f"CPU with {COMMANDS_HZ} commands a second"
    section.table(
        "CPU in percent of one core.", ["board", "CPU", driven, "resident MB", "threads"], rows
    )
    usual = next(row for row in rows if row[0] == "polled, 50 Hz")
    section.findings.append(
        f"With a polled board and poses at 50 Hz: {usual[1]} % of a core, {usual[2]} % with "
        f"{COMMANDS_HZ} commands a second, {usual[3]} MB of memory, {usual[4]} threads."
    )
    for dialect in ("polled",) if short else ("polled", "streamed"):
        found = measure(seconds, 1 if short else 4, dialect=dialect, bare=True)
        floor = found[READER]
        times = {
            name: [ratio(use.standing, floor.standing), ratio(use.driving, floor.driving)]
            for name, use in found.items()
        }
        section.table(
            f"Beside bare programs, {dialect} board, CPU in percent of one core.",
            ["program", "CPU", driven, "resident MB", "threads", "CPU x", "driving x"],
            [[name, *cells(use), *times[name]] for name, use in found.items()],
        )
        section.findings.append(
            f"{dialect.capitalize()}: {times[DAEMON][0]} times the CPU of a bare reader standing, "
            f"{times[DAEMON][1]} times driving; a bare program that drives takes "
            f"{times[DRIVER][1]} times."
        )
    return section


def cells(use: Cost) -> list[str]:
    """CPU standing and driving, memory and threads."""
    shares = [number(100 * median(each)) for each in (use.standing, use.driving)]
    return [*shares, number(use.rss_mb), str(use.threads)]


def ratio(ours: list[float], floor: list[float]) -> str:
    """The median of the ratios, round by round."""
    return number(median([a / b for a, b in zip(ours, floor, strict=True)]))
