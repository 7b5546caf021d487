"""CPU, memory and threads of the daemon, by rate and by layer.

CPU is the kernel's account of the process and its threads over some seconds. A polled board is
polled at the rate at which pose, twist and wheels are published to a subscriber in another process.
Commands come 50 times a second, each different from the last. The cost of one command is the
difference of runs with and without, so it has the noise of both. It includes that wheels turn:
lines that repeat cost less. By layer: the event loop's thread is sampled after every few
milliseconds of CPU time, at rates that are no multiple of the kernel's tick, because else the same
moments would be sampled again and again. Each sample counts for the innermost function of yahboomd.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks import flame, pictures, rig
from benchmarks.latency import UNLIMITED, command, publisher
from benchmarks.results import Section, median, method, number, quantile
from benchmarks.staged import STAGES, spans

COMMANDS_HZ = 50


class Cost(NamedTuple):
    """The use of one daemon in one condition.

    Attributes:
        core: CPU as a share of one core.
        loop: The same for the event loop's thread alone.
        rss_mb: Resident memory.
        threads: Number of threads.
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
    """Run a daemon on a thin board and measure its use of the machine."""
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
    """CPU time of the event loop's thread since its start."""
    return int(Path(f"/proc/{pid}/task/{pid}/schedstat").read_text().split()[0])


def rates(rate_hz: float) -> tuple[str, str]:
    """Settings for polls and poses at one rate."""
    return f"odometry.poll_rate_hz={rate_hz}", f"odometry.publish_rate_hz={rate_hz}"


def bench(*, short: bool, images: Path) -> Section:
    """Measure CPU, memory and threads."""
    section = Section(
        name="cost",
        title="CPU and memory",
        about="What the daemon costs the robot's computer, on asyncio's own event loop and on "
        "uvloop.",
        how=method(__doc__),
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
        "CPU in percent of one core.",
        ["board", "event loop", "CPU", "of it the loop's thread", "CPU with 50 commands/s",
         "µs a command", "resident MB", "threads"],
        rows,
    )  # fmt: skip
    usual = next(each for each in rows if each[:2] == ["polled, 50 Hz", "asyncio"])
    section.findings.append(
        f"With a polled board and poses at 50 Hz: {usual[2]} % of a core, {usual[4]} % with "
        f"{COMMANDS_HZ} commands a second, {usual[6]} MB of memory, {usual[7]} threads."
    )
    for loop in loops:
        if not short:
            slope = (cores[loop, 200] - cores[loop, 20]) / 180 * 1e6
            section.findings.append(
                f"{loop}: {number(slope)} µs of CPU for a poll with its three samples, and "
                f"{number(median(per_command[loop]))} µs for a command."
            )
    draw(section, curves, images)
    stages(section, 2.0 if short else 20.0, least=0.05 if short else 0.5)
    profile(section, 2.0 if short else 40.0, images)
    return section


def command_us(quiet: Cost, driven: Cost) -> float:
    """CPU of one command in µs."""
    return (driven.core - quiet.core) / COMMANDS_HZ * 1e6


def row(quiet: Cost, driven: Cost) -> list[str]:
    """The figures of a row of the table, behind its names."""
    shares = [number(100 * each) for each in (quiet.core, quiet.loop, driven.core)]
    cost = number(max(0.0, command_us(quiet, driven)))
    return [*shares, cost, number(quiet.rss_mb), str(quiet.threads)]


def draw(section: Section, curves: dict[str, list[tuple[float, float]]], images: Path) -> None:
    """Draw CPU by poll rate."""
    figure, axes = pictures.blank()
    for n, (name, points) in enumerate(curves.items()):
        axes.plot(*zip(*points, strict=True), "o-", color=pictures.COLOURS[n], label=name,
                  markersize=4)  # fmt: skip
    axes.set(xlabel="polls and poses a second", ylabel="% of one core")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=8, frameon=False)
    caption = "CPU with a polled board, by the rate of polls and poses."
    pictures.keep(section, figure, images, "cost.png", caption)


def staged(seconds: float) -> list[list[int]]:
    """Trace each command between Zenoh's callback and the port; returns its moments."""
    with rig.folder() as where:
        path = where / "stages"
        path.touch()
        prefix = ("-m", "benchmarks.staged", str(path))
        measure(seconds, dialect="streamed", commands=True, prefix=prefix)
        return [json.loads(line) for line in path.read_text().splitlines()]


def stages(section: Section, seconds: float, least: float) -> None:
    """The time of each stage of a command between Zenoh's callback and the port."""
    found = spans(staged(seconds), round(seconds * COMMANDS_HZ), least)
    rows = [
        [stage, number(median([each[n] for each in found]) / 1e3),
         number(quantile([each[n] for each in found], 0.9) / 1e3)]
        for n, stage in enumerate(STAGES)
    ]  # fmt: skip
    section.table(
        f"Stages of a command from Zenoh's callback to the port, in µs: {len(found)} commands, 50 "
        "a second.",
        ["stage", "p50", "p90"],
        rows,
    )


def profile(section: Section, seconds: float, images: Path) -> None:
    """The share of each room and function in the time of the event loop's thread."""
    with rig.folder() as where:
        path = where / "stacks"
        prefix = ("-m", "benchmarks.sampled", str(path))
        measure(seconds, *rates(187), "command.rate_hz=53", commands=True, prefix=prefix)
        stacks = flame.read(path)
    if not (total := sum(stacks.values())):
        raise ValueError("no sample is below the event loop's turn: asyncio has renamed it")
    title = f"The event loop's thread at 187 polls and 50 commands a second, {total} samples"
    flame.draw(stacks, images / "flame.svg", title)
    section.images.append(("flame.svg", title + "; width is CPU time."))
    section.table(
        f"By room, % of the loop's {total} samples.",
        ["room", "%"],
        [[room, number(100.0 * n / total)] for room, n in flame.by_room(stacks).most_common()],
    )
    section.table(
        "The fifteen costliest functions.",
        ["function", "%"],
        [
            [f"`{function}`", number(100.0 * n / total)]
            for function, n in flame.by_function(stacks).most_common(15)
        ],
    )
