"""Latency from a put in another process to the last byte of the speed frame on the pseudo-terminal.

Four processes receive commands, one after the other, a few milliseconds apart: the daemon, while
counters arrive and poses are published to a subscriber at 50 Hz; a bare Zenoh callback that writes
to a pseudo-terminal; one that has an event loop write it, which has nothing else to do; a bare
socket that writes it. One process stamps the bytes of all four pseudo-terminals.
"""

from __future__ import annotations

import contextlib
import random
import re
import socket
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import zenoh

from benchmarks import pictures, rig
from benchmarks.results import Section, method, milliseconds, number, quantile
from benchmarks.thin_board import BYTE_NS, read_log

DAEMON, ZENOH, LOOP, SOCKET = range(4)
SPACING_NS = {"streamed": 10_000_000, "polled": 0}
LINE_US = 3472
"""The period of lines with seven digits in each counter on a full wire."""
TICKS = 1_000_000
SPEED = re.compile(rb"\$(?:spd|speed):(-?\d+),")
UNLIMITED = tuple(
    f"limits.{axis}={{acceleration=1e6, deceleration=1e6}}" for axis in ("linear", "angular")
)
"""Without limits of acceleration every command is one frame, which shows its origin."""


class Run(NamedTuple):
    """Latencies in nanoseconds.

    Attributes:
        free: The daemon's, for commands that found the line free.
        waited: The daemon's, for commands that waited for another frame's spacing or answer.
        zenoh: The bare callback's.
        loop: The bare callback's through an event loop.
        socket: The bare socket's.
        lost: The number of commands whose frame never came.
    """

    free: list[int]
    waited: list[int]
    zenoh: list[int]
    loop: list[int]
    socket: list[int]
    lost: int


def command(units: int) -> bytes:
    """The payload of a command."""
    return b'{"vx":%d.%03d,"wz":0.0}' % divmod(units, 1000)


def measure(count: int, *, dialect: str, seed: int = 1) -> Run:
    """Send ``count`` commands to each of the four."""
    endpoints = [rig.free_endpoint() for _ in range(4)]
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(rig.folder())
        board = stack.enter_context(
            rig.thin_board(
                *(where, "--dialect", dialect, "--silent-from", "1"),
                *("--line-us", str(LINE_US), "--ticks", str(TICKS)),
                ports=4,
            )
        )
        for name, index in (("zenoh", ZENOH), ("loop", LOOP), ("socket", SOCKET)):
            port = str(where / f"port{index}")
            arguments = ("-m", "benchmarks.floors", name, endpoints[index], port)
            stack.enter_context(rig.Process(*arguments)).says("ready")
        stack.enter_context(rig.daemon(where, endpoints[DAEMON], *UNLIMITED))
        session = stack.enter_context(rig.client(endpoints[DAEMON]))
        bare, looped = (stack.enter_context(rig.client(endpoints[way])) for way in (ZENOH, LOOP))
        host, _, number_ = endpoints[SOCKET].removeprefix("tcp/").rpartition(":")
        raw = stack.enter_context(socket.create_connection((host, int(number_))))
        raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        status = rig.Status(session)
        status.ready()
        stack.enter_context(rig.Process("-m", "benchmarks.listener", endpoints[DAEMON])).says(
            "ready"
        )
        puts: list[Callable[[bytes], object]] = [
            publisher(session).put,
            publisher(bare).put,
            publisher(looped).put,
            raw.sendall,
        ]
        sent = send(puts, count, random.Random(seed))
        session.put("cmd_vel", command(0))
        time.sleep(0.2)
        board.end()
        return matched(sent, where, dialect)


def publisher(session: zenoh.Session) -> zenoh.Publisher:
    """A publisher of commands that are sent first and not batched."""
    return session.declare_publisher("cmd_vel", priority=zenoh.Priority.REAL_TIME, express=True)


Sent = list[tuple[int, int, int]]
"""(target, units, monotonic nanoseconds)."""


def send(puts: Sequence[Callable[[bytes], object]], count: int, chance: random.Random) -> Sent:
    """Send commands to each target, at times unrelated to the daemon's schedules."""
    sent: Sent = []
    for n in range(count):
        # A value returns only after its earlier frame is no longer repeated.
        units = 300 + 7 * n % 400
        frame = b"$spd:%d,0,%d,0#" % (units, units)
        for target in chance.sample(range(len(puts)), len(puts)):
            payload = command(units) if target == DAEMON else frame
            time.sleep(chance.uniform(0.006, 0.010))
            sent.append((target, units, time.monotonic_ns()))
            puts[target](payload)
    return sent


def matched(sent: Sent, where: Path, dialect: str) -> Run:
    """Find the frame of each command among the bytes that the board received."""
    heard = read_log(where).heard
    run = Run(free=[], waited=[], zenoh=[], loop=[], socket=[], lost=0)
    lost = 0
    ways = (ZENOH, run.zenoh), (LOOP, run.loop), (SOCKET, run.socket), (DAEMON, run.waited)
    for target, taken in ways:
        arrivals = [(t_ns, data) for port, t_ns, data in heard if port == target]
        position = 0
        for _, units, sent_ns in (each for each in sent if each[0] == target):
            while position < len(arrivals) and arrivals[position][0] < sent_ns:
                position += 1
            found = next(
                (n for n in range(position, min(position + 8, len(arrivals)))
                 if units in units_of(arrivals[n][1])),
                None,
            )  # fmt: skip
            if found is None:
                lost += 1
                continue
            latency_ns = arrivals[found][0] - sent_ns
            if target == DAEMON and found == position:
                free_ns = busy_until_ns(arrivals[position - 1], dialect) if position else 0
                (run.free if sent_ns >= free_ns else run.waited).append(latency_ns)
            else:
                taken.append(latency_ns)
    return run._replace(lost=lost)


def units_of(data: bytes) -> list[int]:
    """The left wheel's speed in the speed frames of a read."""
    return [int(found) for found in SPEED.findall(data)]


def busy_until_ns(arrival: tuple[int, bytes], dialect: str) -> int:
    """The time at which the line is free after a frame: its bytes, its spacing, and any answer."""
    t_ns, data = arrival
    end_ns = t_ns + len(data) * BYTE_NS + SPACING_NS[dialect]
    if b"read" in data:
        # Until the board has written the answer and the daemon has read it.
        end_ns += 4_000_000 if dialect == "polled" else 5_000_000
    return end_ns


def bench(*, short: bool, images: Path) -> Section:
    """Measure latency on both boards."""
    count = 200 if short else 10_000
    section = Section(
        name="latency",
        title="Latency of commands",
        about="The time from a put in another process to the last byte of the frame on the wire, "
        "beside a bare Zenoh callback and a bare socket that do nothing but write.",
        how=method(__doc__)
        + " The streamed board sends as many lines as the wire carries (288 a second); the polled "
        "one is polled 50 times a second. The line is free for a command when the frame before it "
        "is out and the spacing that the board needs is over. Commands come 24 to 40 ms apart. The "
        "limits of acceleration are off, so that every command is one frame.",
    )
    rows = []
    for dialect, many in (("streamed", count), ("polled", count // 6)):
        run = measure(many, dialect=dialect)
        rows += rows_of(run, dialect)
        section.findings += findings(run, dialect)
        if dialect == "streamed":
            draw(section, run, images)
    section.table(
        "Milliseconds; the last two columns are ratios to the bare Zenoh callback in the same run.",
        ["board", "way", "commands", "p50", "p99", "worst", "p50 x", "p99 x"],
        rows,
    )
    return section


def rows_of(run: Run, name: str) -> list[list[str]]:
    """The rows of the table."""
    floor = [quantile(run.zenoh, share) for share in (0.5, 0.99)]
    rows = []
    for way, values in (
        ("raw socket", run.socket),
        ("bare Zenoh callback", run.zenoh),
        ("the same by way of an event loop", run.loop),
        ("daemon, line free", run.free),
        ("daemon, line busy", run.waited),
        ("daemon, all", run.free + run.waited),
    ):
        if not values:
            continue
        p50, p99 = quantile(values, 0.5), quantile(values, 0.99)
        ratios = [number(p50 / floor[0]), number(p99 / floor[1])]
        times = [milliseconds(each) for each in (p50, p99, max(values))]
        rows.append([name, way, str(len(values)), *times, *ratios])
    return rows


def draw(section: Section, run: Run, images: Path) -> None:
    """Draw the share of the commands that reached the wire within a time."""
    figure, axes = pictures.blank()
    ways = {
        "raw socket": run.socket,
        "bare Zenoh callback": run.zenoh,
        "daemon, line free": run.free,
        "daemon, all": run.free + run.waited,
    }
    pictures.shares(
        axes, {way: [ns / 1e6 for ns in found] for way, found in ways.items()},
        lines=("-", "-", "-", "--"),
    )  # fmt: skip
    axes.set(xlabel="from the put to the last byte on the wire, ms", ylabel="share of the commands")
    caption = f"Latency of {len(run.zenoh)} commands each way, while lines arrive on a full wire."
    pictures.keep(section, figure, images, "latency.png", caption)


def findings(run: Run, dialect: str) -> list[str]:
    """State each goal, and how far it was reached."""
    sentences = []
    for share, name in ((0.5, "p50"), (0.99, "p99")):
        ours, bare = quantile(run.free, share), quantile(run.zenoh, share)
        verdict = "reached" if ours / bare <= 1.5 else "missed"
        sentences.append(
            f"A {dialect} board with a free line: {milliseconds(ours)} ms at {name}, "
            f"{number(ours / bare)} times the bare Zenoh callback. Goal 1.5: {verdict}."
        )
    total = len(run.free) + len(run.waited)
    sentences.append(
        f"{len(run.free)} of {total} commands to the {dialect} board found the line free. Frames "
        f"that never came, on all four ways: {run.lost}."
    )
    return sentences
