"""The article's bridge and yahboomd through the same trials on the same simulated polled board.

The bridge is rebuilt from the article's description. Its ROS calls are left out; a socket on
loopback brings its velocities (`benchmarks/article.py`). Both drive the board of
`yahboomd simulate --dialect polled` on a pseudo-terminal, paced at 115200 baud. The simulator
supplies the ground truth and the times of the bytes on the wire. Both know the simulated robot's
wheels. The trials run one driver after the other, the bridge first, each on a new board of the same
seed, and once, so the two runs of a comparison are up to a minute apart. yahboomd's limits of
acceleration are off for the latency of commands, so that one command is one frame as it is in the
bridge, and on in all other trials. The pose is compared with the truth at the end of each trial.
"""

from __future__ import annotations

import math
import random
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

from benchmarks import rig
from benchmarks.drivers import ARTICLE, DRIVERS, YAHBOOMD, frames, trial
from benchmarks.latency import UNLIMITED
from benchmarks.results import Section, method, milliseconds, number, quantile

SHORT = 0.25
"""The factor for the length of each drive in the short form."""

P50 = "command to wire, p50, ms"
POLLS = "polls a second"
SHOWN = (
    POLLS,
    P50,
    "reset in motion: drives",
    "one digit of one answer altered: pose",
    "0.2 % of bytes garbled: pose",
    "unplugged for",
    "commands end in motion",
)
"""How the rows on the results page begin."""


@dataclass
class Found:
    """The results of a trial with one driver.

    Attributes:
        figures: The figures by row.
        said: The findings, in sentences.
        compared: Whether a ratio means anything. It does not for wheels that are left turning,
            because their figures depend only on the length of the trial.
    """

    figures: dict[str, str]
    said: list[str] = field(default_factory=list)
    compared: bool = True


def polling_and_latency(name: str, pace: float) -> Found:
    """Poll rate over a minute, and the latency from command to frame."""
    count = 1000 if pace == 1.0 else 10
    chance = random.Random(3)
    sent: list[tuple[int, int]] = []
    # The bridge has no limits of acceleration, under which one command becomes several frames.
    with trial(name, settings=UNLIMITED) as run:
        run.drive(0.5, 0.2)
        begin_ns = time.monotonic_ns()
        for n in range(count):
            units = 300 + n % 100
            # Not a whole unit, because the bridge truncates.
            sent.append((time.monotonic_ns(), units))
            run.driver.say((units + 0.4) / 1000.0)
            time.sleep(chance.uniform(0.03, 0.07))
        end_ns = time.monotonic_ns()
        run.drive(0.3, 0.0)
        heard = run.heard()
        account = run.driver.account()
        faults = [line for line in run.process.lines if "ERROR" in line]
    for fault in faults:
        print(name, "logged:", fault, flush=True)
    polls = sum(each.data.count("$read#") for each in heard if begin_ns <= each.t_ns < end_ns)
    latencies = []
    lost = 0
    wire = frames(heard, begin_ns)
    for sent_ns, units in sent:
        match = next((t for t, left, _ in wire if t >= sent_ns and left == units), None)
        if match is None or match - sent_ns > 1_000_000_000:
            lost += 1
        else:
            latencies.append(match - sent_ns)
    found = Found(
        {
            POLLS: number(polls / (end_ns - begin_ns) * 1e9),
            P50: milliseconds(quantile(latencies, 0.5)),
            "command to wire, p99, ms": milliseconds(quantile(latencies, 0.99)),
            "command to wire, worst, ms": milliseconds(max(latencies, default=math.nan)),
            "commands that never reached the wire as they were": f"{lost} of {count}",
        }
    )
    if lost and account:
        found.said.append(f"Commands that never reached the wire, {name}: {account}")
    return found


def at_start(name: str, pace: float) -> Found:  # noqa: ARG001 - has one length
    """Start with counters that are not zero."""
    with trial(name, "--ticks", "123456,0,120000,0") as run:
        time.sleep(1.0)
        x, y, theta = run.pose()
    row = "start with counters at 123456 and 120000: pose, m from the origin"
    return Found(
        {row: number(math.hypot(x, y)), "the same: heading, degrees": number(math.degrees(theta))}
    )


def saturation(name: str, pace: float) -> Found:  # noqa: ARG001 - has one length
    """Command more than the limits: 0.9 m/s with 4 rad/s needs 1.2 m/s at the right wheel."""
    with trial(name) as run:

        def fastest() -> tuple[int, int, int] | None:
            run.drive(1.5, 0.9, 4.0)
            # On a busy machine the newest may be the stop at a command's end.
            frame = max(frames(run.heard()), key=lambda frame: frame[2], default=None)
            return frame if frame and frame[2] > 0 else None

        _, left, right = rig.wait_for(fastest, "a frame with motion")
    wanted = 4.0 / 0.9
    sent = (right - left) / 1000.0 / 0.15 / ((left + right) / 2000.0)
    return Found(
        {
            "0.9 m/s with 4 rad/s: frame on the wire": f"left {left}, right {right}",
            "the same: curvature off by, %": number(abs(sent / wanted - 1.0) * 100.0),
        }
    )


def plain_drive(name: str, pace: float) -> Found:
    """Drive curves for a few seconds without any fault."""
    with trial(name) as run:
        for wz in (0.0, 1.5, -1.5, 3.0):
            run.drive(2.0 * pace, 0.4, wz)
        return Found(
            {f"{3.2 * pace:g} m of curves, no fault: pose off by, m": number(run.error_m())}
        )


def reset(name: str, pace: float) -> Found:
    """Reset the board in motion."""
    with trial(name) as run:
        run.drive(3.0 * pace, 0.3)
        run.control("reset")
        run.drive(3.0 * pace, 0.3)
        drives = abs(run.speed()) > 0.2
        return Found(
            {
                f"reset in motion: drives again within {3 * pace:g} s": "yes" if drives else "no",
                "reset in motion: pose off by, m": number(run.error_m()),
                "reset in motion: largest step of the pose, m": number(run.jump_m()),
            }
        )


def one_garbled(name: str, pace: float) -> Found:
    """Alter one digit of one answer; the frame stays valid."""
    with trial(name) as run:
        run.drive(3.0 * pace, 0.3)
        run.control("garble")
        run.drive(1.0, 0.3)
        return Found(
            {
                "one digit of one answer altered: pose off by, m": number(run.error_m()),
                "one digit of one answer altered: largest step of the pose, m": number(
                    run.jump_m()
                ),
            }
        )


def noise(name: str, pace: float) -> Found:
    """Flip a bit in one byte of five hundred."""
    with trial(name, "--seed", "5") as run:
        run.drive(1.0, 0.3)
        run.control("corruption 0.002")
        run.drive(20.0 * pace, 0.3, 0.5)
        run.control("clear")
        return Found(
            {
                "0.2 % of bytes garbled: pose off by, m": number(run.error_m()),
                "0.2 % of bytes garbled: largest step of the pose, m": number(run.jump_m()),
            }
        )


def unplug(name: str, pace: float) -> Found:
    """Unplug the board for two seconds, in which it drives on."""
    out_s = 2.0 * pace
    after_s, error_m, speed = unplugged(name, out_s, 3.0 * pace, "0,0,0,0")
    row = f"unplugged for {out_s:g} s in motion: first speed frame after the plug is back, s"
    return Found(
        {
            row: "never" if math.isnan(after_s) else number(after_s),
            "the same: speed after a final command to stand, m/s": number(speed),
            "the same: pose off by, m": number(error_m),
        },
        compared=False,
    )


def unplug_far(name: str, pace: float) -> Found:
    """Unplug with counters far from zero: no reset explains them, so they show real travel."""
    _, error_m, _ = unplugged(name, 2.0 * pace, 3.0 * pace, "120000,0,120000,0")
    row = "the same, with counters at 120000 before: pose off by, m"
    return Found({row: number(error_m)}, compared=False)


def unplugged(name: str, out_s: float, then_s: float, ticks: str) -> tuple[float, float, float]:
    """Drive with the plug out for a while, and end with a command to stand.

    Returns:
        Seconds from the replug to the first speed frame (NaN: none came), the error of the pose,
        and the speed, the latter two 1.4 s after the command.
    """
    with trial(name, "--ticks", ticks) as run:
        run.drive(0.5, 0.0)
        # Another trial measures the pose that the counters cause at the start.
        origin = run.pose()
        run.drive(1.5, 0.3)
        run.control(f"unplug {out_s}")
        back_ns = time.monotonic_ns() + round(out_s * 1e9)
        run.drive(out_s + then_s, 0.3)
        after = [t_ns for t_ns, *_ in frames(run.heard(), back_ns)]
        error_m = run.error_m(origin)
        return (after[0] - back_ns) / 1e9 if after else math.nan, error_m, run.speed()


def silence(name: str, pace: float) -> Found:
    """Stop sending in motion."""
    watched_s = 3.0 * pace
    with trial(name) as run:
        run.drive(1.5, 0.3)
        silent_ns = time.monotonic_ns()
        time.sleep(watched_s)
        stops = [t_ns for t_ns, left, right in frames(run.heard(), silent_ns) if left == right == 0]
        return Found(
            {
                "commands end in motion: first stop on the wire after, s": (
                    number((stops[0] - silent_ns) / 1e9)
                    if stops
                    else f"never ({watched_s:g} s watched)"
                ),
                f"commands end in motion: speed {watched_s:g} s later, m/s": number(run.speed()),
            },
            compared=False,
        )


TRIALS: tuple[Callable[[str, float], Found], ...] = (
    polling_and_latency,
    at_start,
    saturation,
    plain_drive,
    reset,
    one_garbled,
    noise,
    unplug,
    unplug_far,
    silence,
)


def factor(row: str, article: str, ours: str) -> str:
    """The factor by which yahboomd is better; ``-`` if a figure is not a positive number.

    More polls are better; of everything else, less is better.
    """
    try:
        better, worse = float(ours), float(article)
    except ValueError:
        return "-"
    if not (better > 0.0 and worse > 0.0):
        return "-"
    return number(better / worse if row == POLLS else worse / better)


def bench(*, short: bool, images: Path) -> Section:  # noqa: ARG001 - draws no picture
    """Run all trials with both drivers."""
    section = Section(
        name="baseline",
        title="Compared with the article's bridge",
        about="The bridge of an article (*Building a ROS 2 Hardware Bridge for Yahboom 520 Motor "
        "Drivers*), rebuilt from its description, and yahboomd drive the same simulated polled "
        "board through the same trials, one after the other.",
        how=method(__doc__),
    )
    turns = list(product(TRIALS, DRIVERS))
    # The short form proves nothing: its trials may disturb each other.
    with ThreadPoolExecutor(4 if short else 1) as pool:
        found = list(pool.map(lambda turn: turn[0](turn[1], SHORT if short else 1.0), turns))
    columns: dict[str, dict[str, str]] = {name: {} for name in DRIVERS}
    for (_, name), each in zip(turns, found, strict=True):
        columns[name] |= each.figures
    article, ours = columns[ARTICLE], columns[YAHBOOMD]
    ratios = {
        row: factor(row, article[row], ours[row]) if each.compared else "-"
        for each in found
        for row in each.figures
    }
    section.table(
        "All figures of the same trials. The last column says how many times better yahboomd is, "
        "where a ratio means something (more polls are better; of everything else, less).",
        ["trial", "the article's bridge", "yahboomd", "times better"],
        [[row, article[row], ours[row], ratios[row]] for row in article],
    )
    section.findings.append(
        f"A command reaches the wire {ratios[P50]} times sooner at the median, although it comes "
        "over Zenoh, and the bridge's over a bare socket."
    )
    section.findings.append(
        "After a replug with counters near zero, the board may have been reset meanwhile. yahboomd "
        "then holds the pose, and an event gives the unknown distance. Counters near 120000 cannot "
        "follow a reset, so the pose includes what the robot drove with the plug out."
    )
    section.findings += [said for each in found for said in each.said]
    section.table(
        "Some of the figures.",
        ["trial", "the article's bridge", "yahboomd"],
        [[row, article[row], ours[row]] for row in article if row.startswith(SHOWN)],
        result=True,
    )
    return section
