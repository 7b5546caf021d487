"""What a robot costs its computer: CPU, memory and threads, by rate and by layer.

CPU is what the kernel has counted for the process and its threads, over some seconds; a polled
board is asked and pose, twist and wheels are published at the same rate to a subscriber in
another process; a command is said 50 times a second, each other than the last. The cost of one
command is the difference of runs with and without, so it has the noise of both, and what it costs
that wheels turn: lines that repeat cost less. By layer: the loop's thread is sampled after every
few milliseconds of CPU time, at rates that the kernel's tick does not divide, else the same moments
would be met again and again; each sample belongs to the innermost function of ours.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from benchmarks import flame, pictures, rig
from benchmarks.latency import UNLIMITED, command, publisher
from benchmarks.report import Section, median, number, quantile
from benchmarks.staged import STAGES

COMMANDS_HZ = 50


class Cost(NamedTuple):
    """Of one daemon in one condition.

    Attributes:
        core: Share of one core.
        loop: Share of one core of the event loop's thread alone.
        rss_mb: Resident memory.
        threads: How many.
    """

    core: float
    loop: float
    rss_mb: float
    threads: int


def measure(
    seconds: float,
    *settings: str,
    dialect: str = "polled",
    commands: bool = False,
    loop: str = "asyncio",
    prefix: Sequence[str] = ("-m", "yahboomd"),
    line_us: int = 5917,
) -> Cost:
    """Run a daemon on a thin board and look at what it uses."""
    endpoint = rig.free_endpoint()
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(rig.folder())
        options = ("--dialect", dialect, "--line-us", str(line_us))
        stack.enter_context(rig.thin_board(where, *options))
        process = stack.enter_context(
            rig.daemon(where, endpoint, *UNLIMITED, *settings, loop=loop, prefix=prefix)
        )
        session = stack.enter_context(rig.client(endpoint))
        rig.Status(session).ready()
        listener = rig.Process("-m", "benchmarks.listener", endpoint)
        stack.enter_context(listener).says("ready")
        put = publisher(session).put
        before, loop_before = rig.usage(process.pid), main_thread_ns(process.pid)
        end = time.monotonic() + seconds
        n = 0
        while time.monotonic() < end:
            if commands:
                put(command(300 + 7 * n % 400))
                n += 1
            time.sleep(1.0 / COMMANDS_HZ)
        after, loop_after = rig.usage(process.pid), main_thread_ns(process.pid)
        return Cost(
            core=rig.share_of_core(before, after),
            loop=(loop_after - loop_before) / (after.wall_ns - before.wall_ns),
            rss_mb=after.rss_mb,
            threads=after.threads,
        )


def main_thread_ns(pid: int) -> int:
    """CPU of the event loop's thread so far."""
    return int(Path(f"/proc/{pid}/task/{pid}/schedstat").read_text().split()[0])


def rates(rate_hz: float) -> tuple[str, str]:
    """Polls and poses at one rate."""
    return f"odometry.poll_rate_hz={rate_hz}", f"odometry.publish_rate_hz={rate_hz}"


def bench(*, short: bool, images: Path) -> Section:
    """The section."""
    section = Section(
        name="cost",
        title="Cost: CPU, memory, threads, and where they go",
        how=__doc__.split("\n\n", 1)[1].replace("\n", " "),
    )
    seconds = 1.0 if short else 6.0
    loops = ["asyncio"]
    with contextlib.suppress(ImportError):
        __import__("uvloop")
        loops.append("uvloop")
    rows = []
    per_command: dict[str, list[float]] = {loop: [] for loop in loops}
    cores: dict[tuple[str, float], float] = {}
    curves: dict[str, list[tuple[float, float]]] = {}
    for rate_hz in (50,) if short else (20, 50, 100, 200):
        for loop in loops:
            quiet = measure(seconds, *rates(rate_hz), loop=loop)
            driven = measure(seconds, *rates(rate_hz), loop=loop, commands=True)
            cores[loop, rate_hz] = quiet.core
            per_command[loop].append(command_us(quiet, driven))
            curves.setdefault(loop, []).append((rate_hz, 100 * quiet.core))
            with_commands = f"{loop}, {COMMANDS_HZ} commands a second"
            curves.setdefault(with_commands, []).append((rate_hz, 100 * driven.core))
            rows.append([f"polled, {rate_hz} Hz", loop, *row(quiet, driven)])
    for line_us in () if short else (5917, 3472, 2457):
        for loop in loops:
            quiet = measure(seconds, dialect="streamed", loop=loop, line_us=line_us)
            driven = measure(seconds, dialect="streamed", loop=loop, line_us=line_us, commands=True)
            per_command[loop].append(command_us(quiet, driven))
            name = f"streamed, {1e6 / line_us:.0f} lines a second, published at 50 Hz"
            rows.append([name, loop, *row(quiet, driven)])
    section.table(
        "Percent of one core; then µs for a command, MB and a count.",
        ["board", "event loop", "all", "of it the loop's thread", "with 50 commands/s",
         "µs a command", "resident", "threads"],
        rows,
    )  # fmt: skip
    for loop in loops:
        if not short:
            slope = (cores[loop, 200] - cores[loop, 20]) / 180 * 1e6
            section.findings.append(
                f"{loop}: {number(slope)} µs of CPU for a poll with its three samples (from 20 to "
                f"200 Hz), and {number(median(per_command[loop]))} µs for a command (the median of "
                "the rows)."
            )
    draw(section, curves, images)
    stages(section, 2.0 if short else 20.0)
    profile(section, 2.0 if short else 40.0, images)
    return section


def command_us(quiet: Cost, driven: Cost) -> float:
    """What one command costs, µs of CPU."""
    return (driven.core - quiet.core) / COMMANDS_HZ * 1e6


def row(quiet: Cost, driven: Cost) -> list[str]:
    """The figures of a row of the table."""
    shares = [number(100 * each) for each in (quiet.core, quiet.loop, driven.core)]
    cost = number(max(0.0, command_us(quiet, driven)))
    return [*shares, cost, number(quiet.rss_mb), str(quiet.threads)]


def draw(section: Section, curves: dict[str, list[tuple[float, float]]], images: Path) -> None:
    """CPU by the rate of polls."""
    figure, axes = pictures.blank()
    for n, (name, points) in enumerate(curves.items()):
        axes.plot(*zip(*points, strict=True), "o-", color=pictures.COLOURS[n], label=name,
                  markersize=4)  # fmt: skip
    axes.set(xlabel="polls and poses a second", ylabel="% of one core")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=8, frameon=False)
    caption = "What a polled board costs, by the rate at which it is asked and published."
    pictures.keep(section, figure, images, "cost.png", caption)


def stages(section: Section, seconds: float) -> None:
    """Where a command spends its time between Zenoh's callback and the port."""
    with rig.folder() as where:
        path = where / "stages"
        prefix = ("-m", "benchmarks.staged", str(path))
        measure(seconds, dialect="streamed", commands=True, prefix=prefix)
        moments = [json.loads(line) for line in path.read_text().splitlines()]
    spans = [[b - a for a, b in pairwise(each)] for each in moments]
    rows = [
        [stage, number(median([each[n] for each in spans]) / 1e3),
         number(quantile([each[n] for each in spans], 0.9) / 1e3)]
        for n, stage in enumerate(STAGES)
    ]  # fmt: skip
    section.table(
        f"From Zenoh's callback to the port, µs, of {len(spans)} commands, 50 a second.",
        ["stage", "p50", "p90"],
        rows,
    )


def profile(section: Section, seconds: float, images: Path) -> None:
    """Where the loop's thread spends its time."""
    with rig.folder() as where:
        path = where / "stacks"
        prefix = ("-m", "benchmarks.sampled", str(path))
        measure(seconds, *rates(187), "command.rate_hz=53", commands=True, prefix=prefix)
        stacks = flame.read(path)
    total = sum(stacks.values())
    title = f"The event loop's thread at 187 polls and 50 commands a second, {total} samples"
    flame.draw(stacks, images / "flame.svg", title)
    section.images.append(("flame.svg", title + "; width is CPU time."))
    section.table(
        f"By room, % of the loop's {total} samples.",
        ["room", "%"],
        [[room, number(100.0 * n / total)] for room, n in flame.by_room(stacks).most_common()],
    )
    section.table(
        "By function, the fifteen costliest.",
        ["function", "%"],
        [
            [f"`{function}`", number(100.0 * n / total)]
            for function, n in flame.by_function(stacks).most_common(15)
        ],
    )
