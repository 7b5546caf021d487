"""The article's node in ROS 2 itself, beside yahboomd through the bridge and natively.

The node is written from the article's description (`benchmarks/ros_article.py`) and runs on `rclpy`
of ROS 2 Jazzy. A second node, the same for all ways, publishes `/cmd_vel` and subscribes to
`/odom`, with queues of ten as usual. The article's node and the bridge's side are on
`rmw_fastrtps_cpp`, ROS 2's default; natively that node is on `rmw_zenoh_cpp`, built by hand from
its sources as no wheel brings it, and connects to yahboomd's own port. Each drives the board of
`yahboomd simulate --dialect polled`, paced at 115200 baud, each trial on a new one. Figures of time
come from rounds in which the ways take turns, each on a board and in processes of its own; the
table has the median of the rounds, and the ratios are medians of each round's ratio. A command's
way ends as its frame leaves the host; one that a newer one replaces before counts as never on the
wire. A sample's way begins as the board answers with those counts, found by the counts that the
pose is made of. CPU and memory are those of all processes that have to run but the commanding node.
The faults happen once with each way. `kill -9` is followed by what the service manager runs after
it: nothing, or `yahboomd stop --direct`. yahboomd's limits of acceleration are off for the times,
so that one command is one frame as it is in the node, and on for the faults. For the article's own
work yahboomd polls 18 times a second, and has `/cmd_vel` and `/odom` alone, with 20 commands a
second; natively a Zenoh program with rmw_zenoh's keys and CDR commands it, as its own CPU does not
count.
"""

from __future__ import annotations

import json
import math
import os
import random
import signal
import time
from bisect import bisect_left
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path

from benchmarks import baseline, rig, ros_ways
from benchmarks.article import TICKS_PER_REV, WHEEL_RADIUS_M
from benchmarks.drivers import Trial, frames, trial
from benchmarks.latency import UNLIMITED
from benchmarks.results import Section, median, method, number, quantile

ROUNDS = 4
RATES = {10: 100, 20: 200}
"""Commands a second, and how many of them in a round."""

M_PER_COUNT = 2.0 * math.pi * WHEEL_RADIUS_M / TICKS_PER_REV

POLLS = "polls a second"
ODOM_P50, ODOM_P95 = "sample to `/odom` callback, p50, ms", "sample to `/odom` callback, p95, ms"
CPU, MEMORY = "CPU of all that has to run, % of a core", "memory of all that has to run, MB"

OWN_WORK_S = 30.0
OWN_POLLS, OWN_CPU = "its polls a second", "its CPU, % of a core"

NODE_WAITS = (
    "The article's node has one thread, which waits 50 ms in each poll, so it takes about as many "
    "commands a second as it polls. When more come, its queue of ten fills: they wait, or are lost."
)


def wire(rate: int, share: str) -> str:
    """The name of the row for a rate of commands."""
    return f"{rate} commands a second: publish to wire, {share}, ms"


def lost(rate: int) -> str:
    """The name of the row for a rate of commands."""
    return f"{rate} commands a second: never on the wire"


RATED = (
    POLLS,
    *(wire(rate, share) for rate in RATES for share in ("p50", "p95")),
    *(ODOM_P50, ODOM_P95, CPU, MEMORY),
)
"""Rows that have ratios."""


def times(way: str, pace: float, seed: int) -> dict[str, float]:
    """One round: commands at random moments while the robot drives straight on."""
    chance = random.Random(seed)
    with trial(way, settings=UNLIMITED) as run:
        driver = run.driver
        assert isinstance(driver, ros_ways.RosDriver)
        run.control(f"answers {run.where / 'answers'}")
        run.drive(1.0, 0.3)
        before = [rig.usage(process.pid) for process in run.needed]
        begin_ns = time.monotonic_ns()
        ends_ns = {}
        for rate, count in RATES.items():
            for n in range(_least(count * pace)):
                # Not a whole unit, because the node truncates.
                driver.say((300 + n % 100 + 0.4) / 1000.0)
                time.sleep(chance.uniform(0.6, 1.4) / rate)
            ends_ns[rate] = time.monotonic_ns()
        after = [rig.usage(process.pid) for process in run.needed]
        run.drive(1.0, 0.29)
        heard = run.heard()
        sent, arrivals = driver.sent(), driver.arrivals()
        answers = recorded(run.where / "answers")
    pairs = list(zip(before, after, strict=True))
    end_ns = max(ends_ns.values())
    polls = sum(each.data.count("$read#") for each in heard if begin_ns <= each.t_ns < end_ns)
    figures = {
        POLLS: polls / (end_ns - begin_ns) * 1e9,
        CPU: sum(100.0 * rig.share_of_core(*pair) for pair in pairs),
        MEMORY: sum(usage.rss_mb for usage in after),
    }
    for rate, until_ns in ends_ns.items():
        said = [each for each in sent if begin_ns <= each[0] < until_ns]
        took = command_times(said, frames(heard, begin_ns))
        figures[wire(rate, "p50")] = quantile(took, 0.5) / 1e6
        figures[wire(rate, "p95")] = quantile(took, 0.95) / 1e6
        figures[lost(rate)] = float(len(said) - len(took))
        begin_ns = until_ns
    took = sample_times(answers, [each for each in arrivals if each[0] < end_ns])
    figures[ODOM_P50], figures[ODOM_P95] = (quantile(took, share) / 1e6 for share in (0.5, 0.95))
    return figures


def own_work(way: str, pace: float) -> dict[str, float]:
    """CPU and polls of one round of the article's own work, with 20 commands a second."""
    with trial(way, settings=(*UNLIMITED, *ros_ways.OWN_WORK)) as run:
        run.drive(2.0, 0.3)
        begin_ns, before = time.monotonic_ns(), [rig.usage(each.pid) for each in run.needed]
        run.drive(OWN_WORK_S * pace, 0.3)
        end_ns, after = time.monotonic_ns(), [rig.usage(each.pid) for each in run.needed]
        heard = run.heard()
    polls = sum(each.data.count("$read#") for each in heard if begin_ns <= each.t_ns < end_ns)
    pairs = zip(before, after, strict=True)
    return {
        OWN_POLLS: polls / (end_ns - begin_ns) * 1e9,
        OWN_CPU: sum(100.0 * rig.share_of_core(*pair) for pair in pairs),
    }


def _least(count: float) -> int:
    return max(10, round(count))


def command_times(
    sent: Sequence[tuple[int, float]], written: Sequence[tuple[int, int, int]]
) -> list[int]:
    """Nanoseconds from each command to its frame; commands without one are left out."""
    found = []
    for sent_ns, vx in sent:
        units = int(vx * 1000.0)
        match = next((t for t, left, _ in written if t >= sent_ns and left == units), None)
        if match is not None and match - sent_ns < 1_000_000_000:
            found.append(match - sent_ns)
    return found


def recorded(path: Path) -> list[tuple[int, int]]:
    """The time of each answer, and the counts of both wheels together."""
    found = []
    for line in path.read_text().splitlines():
        t_ns, text = json.loads(line)
        a, _, c, _ = (int(part) for part in text.removeprefix("$data:").rstrip("#").split(","))
        found.append((t_ns, a + c))
    return found


def sample_times(
    answers: Sequence[tuple[int, int]], arrivals: Sequence[tuple[int, float]]
) -> list[int]:
    """Nanoseconds from each answer to the callback with the pose that is made of its counts.

    On a straight way the pose is half the sum of the counts. Each count occurs once, as the robot
    never stands.
    """
    counts = [count for _, count in answers]
    found = []
    for arrived_ns, x in arrivals:
        wanted = 2.0 * x / M_PER_COUNT
        at = bisect_left(counts, wanted - 1.0)
        if at < len(counts) and abs(counts[at] - wanted) <= 1.0 and answers[at][0] <= arrived_ns:
            found.append(arrived_ns - answers[at][0])
    return found


def killed(way: str, pace: float) -> dict[str, str]:
    """The process that holds the port is killed while the robot drives."""
    watched_s = 3.0 * pace
    with trial(way) as run:
        run.drive(1.5, 0.3)
        os.kill(run.process.pid, signal.SIGKILL)
        killed_ns = time.monotonic_ns()
        if way != ros_ways.NODE:
            # As the unit's ExecStopPost does.
            stop = ("-m", "yahboomd", "stop", "--direct", "--port", str(run.where / "board"))
            with rig.Process(*stop) as process:
                rig.wait_for(lambda: not process.alive, "the stop has ended")
        time.sleep(max(0.0, watched_s - (time.monotonic_ns() - killed_ns) / 1e9))
        return _stopped(run, "kill -9 in motion", killed_ns, watched_s)


def left_alone(way: str, pace: float) -> dict[str, str]:
    """The commanding node ends in motion."""
    watched_s = 3.0 * pace
    with trial(way) as run:
        run.drive(1.5, 0.3)
        silent_ns = time.monotonic_ns()
        time.sleep(watched_s)
        return _stopped(run, "commands end in motion", silent_ns, watched_s)


def _stopped(run: Trial, what: str, since_ns: int, watched_s: float) -> dict[str, str]:
    stops = [t_ns for t_ns, left, right in frames(run.heard(), since_ns) if left == right == 0]
    first = number((stops[0] - since_ns) / 1e9) if stops else f"never ({watched_s:g} s watched)"
    return {
        f"{what}: first stop on the wire after, s": first,
        f"{what}: speed {watched_s:g} s later, m/s": number(run.speed()),
    }


def unplugged(way: str, pace: float) -> dict[str, str]:
    """As in the baseline."""
    return baseline.unplug(way, pace).figures


def reset(way: str, pace: float) -> dict[str, str]:
    """As in the baseline."""
    return baseline.reset(way, pace).figures


FAULTS: tuple[Callable[[str, float], dict[str, str]], ...] = (unplugged, reset, killed, left_alone)


def bench(*, short: bool, images: Path) -> Section:  # noqa: ARG001 - draws no picture
    """Measure every way that can be had."""
    ways = ros_ways.ways()
    section = Section(
        name="ros",
        title="The article's node in ROS 2",
        about="The article's bridge as a real ROS 2 node, and yahboomd through "
        "`zenoh-bridge-ros2dds` and natively, driven and heard by the same node.",
        how=method(__doc__),
    )
    rounds = [
        {way: times(way, 0.1 if short else 1.0, seed) for way in ways}
        for seed in range(1 if short else ROUNDS)
    ]
    rows = {
        what: [number(median([each[way][what] for each in rounds])) for way in ways]
        for what in RATED
    }
    for rate, count in RATES.items():
        total = (1 if short else ROUNDS) * (_least(count * 0.1) if short else count)
        rows[lost(rate)] = [
            f"{sum(each[way][lost(rate)] for each in rounds):.0f} of {total}" for way in ways
        ]
    faults: dict[str, dict[str, str]] = {}
    for fault, way in product(FAULTS, ways):
        for what, figure in fault(way, baseline.SHORT if short else 1.0).items():
            faults.setdefault(what, {})[way] = figure
    for what, figures in faults.items():
        rows[what] = [figures[way] for way in ways]
    section.table(
        "All that was measured. Middleware: FastDDS for the first two, rmw_zenoh natively.",
        ["", *ways],
        [[what, *cells] for what, cells in rows.items()],
        result=True,
    )
    section.table(
        "The article's node over yahboomd: median, least and greatest of the rounds' ratios. For "
        "polls more is better; of everything else, less.",
        ["", *ways[1:]],
        [[what, *(_ratios(rounds, what, way) for way in ways[1:])] for what in RATED],
    )
    section.table(
        "Each round.",
        ["", "round", *ways],
        [
            [what, str(n), *(number(each[way][what]) for way in ways)]
            for what in RATED
            for n, each in enumerate(rounds, start=1)
        ],
    )
    _own_work(section, short=short)
    section.findings += _findings(rounds, ways)
    return section


def _own_work(section: Section, *, short: bool) -> None:
    ways = (ros_ways.NODE, ros_ways.BRIDGE, ros_ways.BY_KEYS)
    rounds = [
        {way: own_work(way, 0.1 if short else 1.0) for way in ways}
        for _ in range(1 if short else ROUNDS)
    ]
    rows = [
        [what, *(number(median([each[way][what] for each in rounds])) for way in ways)]
        for what in (OWN_POLLS, OWN_CPU)
    ]
    times_the_node = [
        [each[way][OWN_CPU] / each[ros_ways.NODE][OWN_CPU] for each in rounds] for way in ways[1:]
    ]
    rows.append(
        ["its CPU, times the node's: median, least and greatest of the rounds", "1"]
        + [f"{number(median(x))} ({number(min(x))} to {number(max(x))})" for x in times_the_node]
    )
    section.table("The article's own work.", ["", *ways], rows, result=True)


def _ratios(rounds: Sequence[dict[str, dict[str, float]]], what: str, way: str) -> str:
    found = [each[ros_ways.NODE][what] / each[way][what] for each in rounds]
    return f"{number(median(found))} ({number(min(found))} to {number(max(found))})"


def _findings(rounds: Sequence[dict[str, dict[str, float]]], ways: Sequence[str]) -> list[str]:
    def ratio(what: str, way: str) -> float:
        return median([each[ros_ways.NODE][what] / each[way][what] for each in rounds])

    found = [NODE_WAITS]
    for way in ways[1:]:
        name = way.removeprefix("yahboomd, ")
        found.append(
            f"{name[0].upper()}{name[1:]}, at 10 commands a second one reaches the wire "
            f"{number(ratio(wire(10, 'p50'), way))} times sooner than with the article's node at "
            f"the median, at 20 {number(ratio(wire(20, 'p50'), way))} times; a sample reaches the "
            f"callback {number(ratio(ODOM_P50, way))} times sooner. With "
            f"{number(1.0 / ratio(POLLS, way))} times the polls it takes "
            f"{number(1.0 / ratio(CPU, way))} times the CPU and "
            f"{number(1.0 / ratio(MEMORY, way))} times the memory."
        )
    if ros_ways.NATIVE not in ways:
        found.append(
            "Natively was not measured: there is no rmw_zenoh_cpp among the wheels, and "
            "YAHBOOMD_RMW_ZENOH_PYTHON names no interpreter that has it."
        )
    return found
