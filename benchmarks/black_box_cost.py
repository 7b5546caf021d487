"""``make black-box``: measures the black box's cost for the daemon, in three minutes.

Two daemons run at the same time on two ports of one thin board, one with the black box and one
without, in either order. Standing and driving alternate, and the CPU of the two is compared pair by
pair. Then each command is sent to both, in turn, and the time to its frame is compared. The machine
is not quiet, but a disturbance affects both.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import os
import platform
import random
import sys
import time
import timeit
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from benchmarks import latency, rig
from benchmarks.ratios import listen, memory_mb
from benchmarks.results import median, quantile
from benchmarks.thin_board import read_log
from yahboomd.blackbox.recorder import Recorder
from yahboomd.blackbox.records import CommandRecord, encode
from yahboomd.blackbox.ring import Ring
from yahboomd.blackbox.ring_file import SEGMENT_BYTES, SEGMENTS
from yahboomd.core.model import Twist2d

Put = Callable[[bytes], object]

SETTINGS = {"with": (), "without": ("blackbox.enabled=false",)}
DRIVE_HZ = 50


def daemons(
    stack: contextlib.ExitStack, where: Path, options: tuple[str, ...], order: Sequence[str]
) -> tuple[rig.Process, list[int], list[Put]]:
    """Start the board and each daemon; returns the board, their processes, and their puts."""
    board = stack.enter_context(rig.thin_board(where, *options, ports=2))
    pids, puts = [], []
    for number, name in enumerate(order):
        settings = SETTINGS[name]
        endpoint = rig.free_endpoint()
        daemon = rig.daemon(where, endpoint, *latency.UNLIMITED, *settings, port=f"port{number}")
        pids.append(stack.enter_context(daemon).pid)
        session = stack.enter_context(rig.client(endpoint))
        rig.Status(session).ready()
        listen(stack, endpoint)
        puts.append(latency.publisher(session).put)
    return board, pids, puts


def each_record() -> None:
    """Print the cost of one record, the least of many runs, in one process."""
    file = os.memfd_create("ring")
    ring = Ring(partial(os.pwrite, file), 0, SEGMENT_BYTES, SEGMENTS)
    recorder = Recorder(ring, time.monotonic_ns, time.time_ns)
    lines = itertools.cycle([b"$MAll:%d,%d,0,0#\r\n" % (n, n) for n in range(10_000, 10_100)])
    twist = Twist2d(vx=0.3)
    works: dict[str, Callable[[], None]] = {
        "a read of the port": lambda: recorder.received(next(lines), time.monotonic_ns()),
        "a read of the same bytes": lambda: recorder.received(b"same", time.monotonic_ns()),
        "a write to it": lambda: recorder.written(b"$spd:300,0,300,0#"),
        "a command": lambda: ring.write(
            *encode(CommandRecord(source="cmd_vel", vx=twist.vx, vy=0.0, wz=0.0)),
            time.monotonic_ns(),
        ),
    }
    for name, work in works.items():
        least_s = min(timeit.repeat(work, number=10_000, repeat=30)) / 10_000
        print(f"{name}: {least_s * 1e6:.2f} us", flush=True)


def cpu_in_order(
    dialect: str,
    seconds: float,
    rounds: int,
    order: Sequence[str],
    shares: dict[str, list[tuple[float, float]]],
) -> tuple[float, float]:
    """Add the CPU of both, standing and driving; returns their memory in MB."""
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(rig.folder())
        _, pids, puts = daemons(stack, where, ("--dialect", dialect), order)
        time.sleep(3.0)
        for number in range(rounds):
            for state, found in shares.items():
                before = [rig.usage(pid) for pid in pids]
                end = time.monotonic() + seconds
                while time.monotonic() < end:
                    if state == "driving":
                        for put in puts:
                            put(latency.command(300 + number))
                    time.sleep(1.0 / DRIVE_HZ)
                after = [rig.usage(pid) for pid in pids]
                uses = dict(zip(order, map(rig.share_of_core, before, after), strict=True))
                found.append((uses["with"], uses["without"]))
            time.sleep(1.0)
        memory = {name: memory_mb(pid)[0] for name, pid in zip(order, pids, strict=True)}
        return memory["with"], memory["without"]


def cpu(dialect: str, seconds: float, rounds: int) -> None:
    """Print the CPU of both, standing and driving."""
    shares: dict[str, list[tuple[float, float]]] = {"standing": [], "driving": []}
    # The second of two processes that wake at the same time finds warm caches.
    for order in (("with", "without"), ("without", "with")):
        on_mb, off_mb = cpu_in_order(dialect, seconds, rounds // 2, order, shares)
    for state, found in shares.items():
        more = [100.0 * (on - off) for on, off in found]
        print(
            f"{dialect}, {state}: {100 * median([on for on, _ in found]):.2f} % of a core with, "
            f"{100 * median([off for _, off in found]):.2f} % without; difference by pairs: "
            f"median {median(more):+.2f}, quartiles {quantile(more, 0.25):+.2f} to "
            f"{quantile(more, 0.75):+.2f} ({len(more)} pairs of {seconds:g} s)",
            flush=True,
        )
    print(f"{dialect}: {on_mb:.1f} MB (PSS) with, {off_mb:.1f} MB without", flush=True)


def times(dialect: str, count: int) -> None:
    """Print the time from a command's put to its frame on the wire, for both."""
    chance = random.Random(1)
    sent: list[tuple[int, int, int]] = []
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(rig.folder())
        line = ("--line-us", str(latency.LINE_US), "--ticks", str(latency.TICKS))
        board, _, puts = daemons(stack, where, ("--dialect", dialect, *line), tuple(SETTINGS))
        for number in range(count):
            units = 300 + 7 * number % 400
            for target in chance.sample((0, 1), 2):
                time.sleep(chance.uniform(0.008, 0.014))
                sent.append((target, units, time.monotonic_ns()))
                puts[target](latency.command(units))
        time.sleep(0.2)
        board.end()
        heard = read_log(where).heard
    found: list[list[float]] = [[], []]
    for target in (0, 1):
        arrivals = [(t_ns, latency.units_of(data)) for port, t_ns, data in heard if port == target]
        at = 0
        for _, units, sent_ns in (each for each in sent if each[0] == target):
            while at < len(arrivals) and arrivals[at][0] < sent_ns:
                at += 1
            near = (t_ns for t_ns, shown in arrivals[at : at + 8] if units in shown)
            if (t_ns := next(near, None)) is not None:
                found[target].append((t_ns - sent_ns) * 1e-6)
    for share in (0.5, 0.9, 0.99):
        on, off = (quantile(each, share) for each in found)
        print(
            f"{dialect}, put to wire, p{100 * share:g}: {on:.3f} ms with, {off:.3f} ms without, "
            f"ratio {on / off:.3f}",
            flush=True,
        )
    print(f"{dialect}: {len(found[0])} and {len(found[1])} of {count} commands", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--seconds", type=float, default=4.0, help="of standing, and of driving")
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--commands", type=int, default=1500, help="for the latency")
    parser.add_argument("--dialects", nargs="+", default=["streamed"])
    args = parser.parse_args()
    each_record()
    for dialect in args.dialects if args.rounds else ():
        cpu(dialect, args.seconds, args.rounds)
        times(dialect, args.commands)
    print(
        f"{platform.machine()}, load average {os.getloadavg()[0]:.1f}, "
        f"Python {sys.version.split()[0]}"
    )


if __name__ == "__main__":
    main()
