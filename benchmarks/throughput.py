"""Use of the wire by polls and stream lines, and the precision of the schedules.

A thin board answers as fast as 115200 baud allow: question, 0.2 ms to carry it out, answer. It
waits for its moment in a busy loop, so that it is not late itself. A bare loop that asks again as
soon as it has its answer shows the limit of board and machine together. The daemon also repeats the
speed ten times a second; polls cannot use the time that its frames need on the wire. For streams,
the daemon's count of readings is compared with the board's count of lines on a full wire. Schedules
are measured from outside, by the times at which frames leave the pseudo-terminal: their deviation
from a grid of 20 ms, for the polls of one daemon, and then for the control steps of another (on a
ramp so slow that each step adds one mm/s), beside a bare process that sleeps until its time and
writes. Each is measured without and with a process that keeps one of the two cores busy. Daemon and
bare process have the niceness of the service's unit, -5, and the process that stamps the frames has
-10, if that is permitted. A frame more than half a period away counts for the next step.
"""

from __future__ import annotations

import contextlib
import math
import time
from pathlib import Path

from benchmarks import pictures, rig
from benchmarks.results import Section, median, method, milliseconds, number, quantile
from benchmarks.thin_board import BYTE_NS, CARRY_OUT_NS, read_log

TICKS = 1_000_000
ANSWER = len(b"$data:1000000,1000000,1000000,1000000#")
LINE = ANSWER + len(b"\r\n")
ROUND_NS = (len(b"$read#") + ANSWER) * BYTE_NS + CARRY_OUT_NS
POLLED = ("--dialect", "polled", "--ticks", str(TICKS))
EXACT = (*POLLED, "--spin")
STREAMED = ("--dialect", "streamed", "--ticks", str(TICKS))
NICE_SERVICE = -5
"""As in the unit of the service."""
NICE_STAMPS = -10
"""The niceness of the process that stamps the frames."""


def polls_by_floor(seconds: float) -> float:
    """Polls a second that a bare loop reaches."""
    with rig.folder() as where, rig.thin_board(where, *EXACT):
        arguments = ("-m", "benchmarks.floors", "poll", str(seconds), str(where / "port0"))
        with rig.Process(*arguments) as process:
            return float(process.says("polls ").split()[1])


def polls_by_daemon(seconds: float, rate_hz: float) -> tuple[float, float]:
    """Polls a second that the daemon reaches when configured for a rate.

    Returns:
        Those, and the polls for which the wire has room beside the repeated speed frames.
    """
    endpoint = rig.free_endpoint()
    with rig.folder() as where, rig.thin_board(where, *EXACT) as board:
        settings = (f"odometry.poll_rate_hz={rate_hz}", "odometry.publish_rate_hz=50")
        with rig.daemon(where, endpoint, *settings), rig.client(endpoint) as session:
            rig.Status(session).ready()
            begin_ns = time.monotonic_ns()
            time.sleep(seconds)
            end_ns = time.monotonic_ns()
        board.end()
        heard = [data for _, t_ns, data in read_log(where).heard if begin_ns <= t_ns < end_ns]
    asked = sum(data.count(b"$read#") for data in heard)
    other_ns = (sum(map(len, heard)) - asked * len(b"$read#")) * BYTE_NS
    return asked / seconds, (1e9 - other_ns / seconds) / ROUND_NS


def lines_read(count: int) -> tuple[int, int, float]:
    """Lines that the board sent, readings that the daemon made of them, lines a second."""
    endpoint = rig.free_endpoint()
    line_us = round(LINE * BYTE_NS / 1000)
    options = (*STREAMED, "--line-us", str(line_us), "--most", str(count))
    with rig.folder() as where, rig.thin_board(where, *options) as board:
        with rig.daemon(where, endpoint), rig.client(endpoint) as session:
            status = rig.Status(session)

            def ended() -> bool:
                # The daemon searches for the board then, and keeps its counters.
                latest = status.latest
                readings = latest.get("link", {}).get("readings", 0)
                return latest.get("state") == "waiting" and readings > 0

            rig.wait_for(ended, "the stream's end")
            time.sleep(0.6)
            readings = int(status.latest["link"]["readings"])
        board.end()
        log = read_log(where)
    return log.lines[0] - log.lost, readings, 1e6 / line_us


Deviations = list[float]


def deviations(stamps_ns: list[int], period_ns: int) -> Deviations:
    """The distance of each stamp from a grid through the median, in nanoseconds."""
    if not stamps_ns:
        return []
    first = stamps_ns[0]
    residues = []
    for stamp_ns in stamps_ns:
        offset = (stamp_ns - first) % period_ns
        residues.append(offset - period_ns if offset > period_ns / 2 else offset)
    middle = median(residues)
    return [abs(each - middle) for each in residues]


RAMP = (
    "limits.linear={velocity=1.0, acceleration=0.05, deceleration=0.05}",
    "command.timeout_s=60",
    "command.sources.cmd_vel={priority=10, timeout_s=60}",
    "board.battery_period_s=0",
)
SCHEDULES = {"polls": (POLLED, (), b"$read"), "control steps": (STREAMED, RAMP, b"$spd")}
"""By name: the board, the daemon's settings, and the first bytes of the frames."""


def schedule(name: str, seconds: float, *, busy: bool) -> tuple[Deviations, Deviations]:
    """Deviations of a schedule of one daemon, and of a bare process beside it."""
    endpoint = rig.free_endpoint()
    period_ns = 20_000_000
    options, settings, frame = SCHEDULES[name]
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(rig.folder())
        board = rig.thin_board(where, *options, "--silent-from", "1", ports=2, nice=NICE_STAMPS)
        stack.enter_context(board)
        if busy:
            stack.enter_context(rig.busy_core(0))
        bare = ("-m", "benchmarks.floors", "timer", "50", str(where / "port1"))
        stack.enter_context(rig.Process(*bare, nice=NICE_SERVICE)).says("ready")
        stack.enter_context(rig.daemon(where, endpoint, *settings, nice=NICE_SERVICE))
        session = stack.enter_context(rig.client(endpoint))
        rig.Status(session).ready()
        begin_ns = time.monotonic_ns()
        # 20 s to the top of the ramp; then back.
        for n in range(max(1, round(seconds / 18.0))):
            if settings:
                session.put("cmd_vel", b'{"vx":%.1f}' % (0.95 if n % 2 == 0 else -0.95))
            time.sleep(min(18.0, seconds))
        end_ns = time.monotonic_ns()
        session.put("cmd_vel", b'{"vx":0}')
        board.end()
        log = read_log(where).heard

    def found(port: int, words: bytes) -> Deviations:
        # In the first quarter second frames follow the command, not the schedule.
        stamps = [
            t_ns
            for which, t_ns, data in log
            if which == port and data.startswith(words) and begin_ns + 250_000_000 < t_ns < end_ns
        ]
        return deviations(stamps, period_ns)

    return found(0, frame), found(1, b"$read")


def bench(*, short: bool, images: Path) -> Section:
    """Measure throughput and schedules."""
    section = Section(
        name="throughput",
        title="Throughput and schedules",
        about="How much of the serial line yahboomd uses, and how exactly it keeps its 20 ms "
        "schedules.",
        how=method(__doc__),
    )
    seconds = 1.0 if short else 6.0
    wire = 1e9 / ROUND_NS
    floors, rows = [], []
    best = most = 0.0
    for rate_hz in (300,) if short else (50, 100, 200, 250, 300, 300):
        floors.append(polls_by_floor(seconds))
        polls, room = polls_by_daemon(seconds, rate_hz)
        best, most = max(best, polls / room), max(most, polls / wire)
        rows.append(
            [f"{rate_hz}", number(polls), number(100.0 * polls / min(rate_hz, room)),
             number(room), number(100.0 * polls / room), number(floors[-1]),
             number(100.0 * floors[-1] / wire)]
        )  # fmt: skip
    section.table(
        f"Polls a second; the wire allows {number(wire)} (6 + {ANSWER} bytes and 0.2 ms).",
        ["configured", "reached", "% of the smaller of configured and room",
         "room beside the speed frames", "% of the room", "bare loop before it", "% of the wire"],
        rows,
    )  # fmt: skip
    share = 100.0 * best
    section.findings.append(
        f"Polls use {number(share)} % of the wire that speed frames leave free. Goal 95 %: "
        f"{'reached' if share >= 95.0 else 'missed'}. That is {number(100.0 * most)} % of the "
        "whole wire; a bare loop without speed frames reaches "
        f"{number(100.0 * median(floors) / wire)} %."
    )
    sent, read, rate = lines_read(300 if short else 6000)
    section.findings.append(
        f"Stream lines read: {read} of {sent}, at {number(rate)} lines a second, a full wire. Goal "
        f"all: {'reached' if sent == read else 'missed'}."
    )
    rows = []
    late: dict[str, Deviations] = {}
    for busy in (False, True):
        for name in SCHEDULES:
            ours, bare = schedule(name, 1.0 if short else 36.0, busy=busy)
            for which, values in ((f"bare process beside {name}", bare), (name, ours)):
                quantiles = [quantile(values, share) for share in (0.5, 0.99)]
                rows.append(
                    [which, "one core busy" if busy else "none of ours", str(len(values)),
                     *map(milliseconds, quantiles),
                     milliseconds(max(values, default=math.nan))]
                )  # fmt: skip
            if busy:
                late |= {f"bare process beside {name}": bare, name: ours}
                late_ns, floor_ns = quantile(ours, 0.99), quantile(bare, 0.99)
                verdict = "reached" if late_ns < 1e6 else "missed"
                section.findings.append(
                    f"With one core busy, {name} at 50 Hz are {milliseconds(late_ns)} ms off their "
                    f"schedule at p99. Goal 1 ms: {verdict}. A bare process beside them: "
                    f"{milliseconds(floor_ns)} ms."
                )
    section.table(
        "Deviation from the 20 ms grid, milliseconds.",
        ["schedule", "other load", "frames", "p50", "p99", "worst"],
        rows,
    )
    figure, axes = pictures.blank()
    # A logarithmic axis has no zero; stamps are precise to a microsecond.
    pictures.shares(
        axes, {name: [max(ns, 1e3) / 1e6 for ns in found] for name, found in late.items()}
    )
    axes.set(xlabel="off the 20 ms grid, ms", ylabel="share of the frames")
    caption = "Deviation from the schedule with one of two cores busy."
    pictures.keep(section, figure, images, "schedule.png", caption)
    return section
