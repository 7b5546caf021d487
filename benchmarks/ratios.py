"""``make ratios``: compares the daemon's cost with the least possible, in two minutes.

All processes run at the same time: the daemon; a bare asyncio reader of the same lines, which
decodes them and puts one sample 50 times a second; one that puts nothing; and one that puts the
daemon's three samples and drives as commanded, with no odometry and no safety. Each has its own
port of one thin board, and its own subscriber. Standing and driving alternate, and the ratios are
taken pair by pair: the machine is not quiet, but a disturbance affects all of them. CPU is the
kernel's account; wakeups are voluntary switches of the event loop's thread. ``--beside`` runs the
daemon of another checkout in the same run.
"""

from __future__ import annotations

import argparse
import compileall
import contextlib
import itertools
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks import latency, rig
from benchmarks.results import ROOT, median, number

DRIVE_HZ = 20

RUN = "import sys; sys.path[0] = {tree!r}; from yahboomd.cli.main import main; sys.exit(main())"


class Use(NamedTuple):
    """The use of a process while the robot stands or drives.

    Attributes:
        core: CPU as a share of one core.
        wakeups_hz: How often the event loop's thread woke.
    """

    core: float
    wakeups_hz: float


def switches(pid: int) -> int:
    """The number of times that the main thread has waited."""
    status = Path(f"/proc/{pid}/task/{pid}/status").read_text()
    line = next(each for each in status.splitlines() if each.startswith("voluntary"))
    return int(line.split()[1])


def costs(
    dialect: str, trees: Sequence[Path], seconds: float, rounds: int
) -> tuple[dict[str, list[Use]], dict[str, list[Use]], dict[str, tuple[float, float]]]:
    """Use at rest and while driving, round by round, and memory (PSS and RSS in MB)."""
    names = [f"daemon of {tree.name}" for tree in trees]
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(rig.folder())
        options = ("--dialect", dialect)
        stack.enter_context(rig.thin_board(where, *options, ports=len(trees) + 3))
        pids, puts = {}, []
        for n, (name, tree) in enumerate(zip(names, trees, strict=True)):
            endpoint = rig.free_endpoint()
            prefix = ("-c", RUN.format(tree=str(tree)))
            process = rig.daemon(where, endpoint, port=f"port{n}", prefix=prefix)
            pids[name] = stack.enter_context(process).pid
            session = stack.enter_context(rig.client(endpoint))
            rig.Status(session).ready()
            puts.append(latency.publisher(session).put)
            listen(stack, endpoint)
        for n, (name, kind, endpoint) in enumerate(
            (
                ("bare reader that puts", dialect, rig.free_endpoint()),
                ("bare reader", dialect, "-"),
                ("bare program that drives", f"{dialect}-drives", rig.free_endpoint()),
            ),
            len(trees),
        ):
            port = str(where / f"port{n}")
            process = rig.Process("-m", "benchmarks.floors", kind, endpoint, port)
            stack.enter_context(process).says("ready")
            pids[name] = process.pid
            if endpoint != "-":
                listen(stack, endpoint)
            if kind != dialect:
                session = stack.enter_context(rig.client(endpoint))
                puts.append(latency.publisher(session).put)
        rest: dict[str, list[Use]] = {name: [] for name in pids}
        driving: dict[str, list[Use]] = {name: [] for name in pids}
        numbers = itertools.count()
        time.sleep(2.0)
        for _ in range(rounds):
            for uses, commands in ((rest, False), (driving, True)):
                before = {name: (rig.usage(pid), switches(pid)) for name, pid in pids.items()}
                end = time.monotonic() + seconds
                while (now := time.monotonic()) < end:
                    if commands:
                        payload = latency.command(300 + 7 * next(numbers) % 100)
                        for put in puts:
                            put(payload)
                        time.sleep(1.0 / DRIVE_HZ)
                    else:
                        time.sleep(end - now)
                for name, pid in pids.items():
                    (use, count), (now_use, now_count) = (
                        before[name],
                        (rig.usage(pid), switches(pid)),
                    )
                    took_s = (now_use.wall_ns - use.wall_ns) * 1e-9
                    uses[name].append(
                        Use(rig.share_of_core(use, now_use), (now_count - count) / took_s)
                    )
            # The daemon needs this time to stop the wheels and to see them stand.
            time.sleep(2.0)
        return rest, driving, {name: memory_mb(pid) for name, pid in pids.items()}


def listen(stack: contextlib.ExitStack, endpoint: str) -> None:
    """Start a process that receives every sample."""
    listener = rig.Process("-m", "benchmarks.listener", endpoint)
    stack.enter_context(listener).says("ready")


def memory_mb(pid: int) -> tuple[float, float]:
    """Proportional and resident memory of a process."""
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    sizes = {line.split()[0]: int(line.split()[1]) for line in rollup[1:]}
    return sizes["Pss:"] * 1024 / 1e6, sizes["Rss:"] * 1024 / 1e6


def show(title: str, uses: dict[str, list[Use]], floor: str) -> None:
    """Print the medians and ratios."""
    print(f"\n{title}\n")
    print("| process | CPU, % of a core | x bare reader that puts | wakeups a second |")
    print("|---|---|---|---|")
    for name, found in uses.items():
        ratio = median([a.core / b.core for a, b in zip(found, uses[floor], strict=True)])
        core, wakeups = (median([each[n] for each in found]) for n in (0, 1))
        print(f"| {name} | {number(100 * core)} | {number(ratio)} | {wakeups:.0f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--beside", type=Path, action="append", default=[], metavar="TREE")
    parser.add_argument("--seconds", type=float, default=4.0, help="of standing, and of driving")
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--commands", type=int, default=800, help="for the latency; 0 for none")
    parser.add_argument("--dialects", nargs="+", default=["polled", "streamed"])
    args = parser.parse_args()
    floor = "bare reader that puts"
    for tree in (ROOT, *args.beside):
        # Compiled before, as an installation is: compiling at the start leaves its memory behind.
        compileall.compile_dir(tree / "yahboomd", quiet=1)
    for dialect in args.dialects:
        rest, driving, memory = costs(dialect, [ROOT, *args.beside], args.seconds, args.rounds)
        show(f"{dialect} board, standing", rest, floor)
        show(f"{dialect} board, driving with {DRIVE_HZ} commands a second", driving, floor)
        print("\n| process | PSS, MB | RSS, MB |\n|---|---|---|")
        for name, (pss, rss) in memory.items():
            print(f"| {name} | {pss:.1f} | {rss:.1f} |")
    for dialect in args.dialects if args.commands else ():
        run = latency.measure(args.commands, dialect=dialect)
        print(f"\n{dialect} board, put to wire, ms (p50, p99; x bare Zenoh callback)\n")
        for row in latency.rows_of(run, dialect):
            print("|", " | ".join(row), "|")
    print(f"\nload average {os.getloadavg()[0]:.1f}, Python {sys.version.split()[0]}")


if __name__ == "__main__":
    main()
