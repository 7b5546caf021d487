"""``yahboomd plot``: draws a recording as one picture."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from yahboomd.cli.shared_options import check_picture
from yahboomd.core.errors import Refused
from yahboomd.core.messages.native import (
    BatterySample,
    EventSample,
    PoseSample,
    StatusSample,
    WheelsSample,
)

if TYPE_CHECKING:
    from yahboomd.tools.plot.recorded_series import Recording

DESCRIPTION = """\
Draw a recording: the path with its covariance, the speeds of the wheels as commanded and as
measured, the battery, the link, and a timeline of events.
"""

EPILOG = """\
examples:
  yahboomd plot run1                   writes run1.png
  yahboomd plot run1 --output run1.svg
  yahboomd plot run1/native_3.mcap     one part of a long recording

exit status:
  0    drawn
  1    there is no recording, or the picture cannot be written
"""

POINTS = 4000
"""The most points of a line; a picture has no more columns."""

ELLIPSES = 12
SIGMAS = 2.0

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""By Okabe and Ito, for people who see few colours."""

EVERY_S = 0.5
"""The usual time between two statuses."""

SEVERITY = {"info": "#666666", "warning": "#b36b00", "error": "#c00000"}

TROUBLE = (
    "discarded_bytes",
    "broken_frames",
    "polls_unanswered",
    "answers_missed",
    "commands_lost",
    "board_resets",
)
"""Counters of the link that do not grow on a good one."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("recording", metavar="FOLDER", type=Path, help="made by `yahboomd record`")
    parser.add_argument(
        "--output", metavar="FILE", type=Path, help=".png, .svg or .pdf (default: FOLDER.png)"
    )


def run(args: argparse.Namespace) -> int:
    """Draw."""
    # Imported first, so that a missing extra is reported before anything is read.
    import matplotlib as mpl
    import mcap.reader  # noqa: F401

    from yahboomd.tools.plot.recorded_series import read_recording

    if args.output is not None:
        check_picture(args.output)
    mpl.use("Agg")
    recording = read_recording(args.recording)
    output = args.output or Path(f"{str(args.recording).rstrip('/')}.png")
    try:
        draw(recording, title=args.recording.name).savefig(output, dpi=120)
    except (OSError, ValueError) as error:
        if output.is_file():
            # It holds half a picture.
            output.unlink()
        raise Refused(f"{output} cannot be written: {error}") from error
    if recording.is_cut:
        words = "The recording was cut off, or is damaged; the part before that is drawn."
        print(words, file=sys.stderr)
    print(output)
    return 0


def draw(recording: Recording, *, title: str) -> Any:  # noqa: ANN401 - matplotlib has no types
    """The picture as a matplotlib figure."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 9.5), layout="constrained")
    figure.suptitle(title)
    grid = figure.add_gridspec(4, 2, width_ratios=(1.0, 1.25), height_ratios=(2.2, 1.0, 1.2, 1.6))
    _path(figure.add_subplot(grid[0:3, 0]), recording)
    speeds = figure.add_subplot(grid[0, 1])
    _speeds(speeds, recording)
    battery = figure.add_subplot(grid[1, 1], sharex=speeds)
    _battery(battery, recording)
    link = figure.add_subplot(grid[2, 1], sharex=speeds)
    _link(link, recording)
    link.set_xlabel("time, s")
    _timeline(figure.add_subplot(grid[3, :]), recording)
    return figure


def _thinned(samples: list[Any]) -> list[Any]:
    return samples[:: max(1, len(samples) // POINTS)]


def _path(axes: Any, recording: Recording) -> None:  # noqa: ANN401
    from matplotlib.patches import Ellipse

    poses = _thinned(recording.of(PoseSample))
    axes.set(title="path", xlabel="x, m", ylabel="y, m", aspect="equal")
    axes.grid(alpha=0.3)
    if not poses:
        axes.text(0.5, 0.5, "no poses", ha="center", transform=axes.transAxes)
        return
    axes.plot([each.x for each in poses], [each.y for each in poses], color=COLOURS[0], lw=1.2)
    axes.plot(poses[0].x, poses[0].y, "o", color=COLOURS[2], label="begin")
    axes.plot(poses[-1].x, poses[-1].y, "s", color=COLOURS[1], label="end")
    label: str | None = f"{SIGMAS:.0f} sigma"
    for each in poses[:: max(1, len(poses) // ELLIPSES)]:
        width, height, angle = ellipse(each.covariance)
        axes.add_patch(
            Ellipse(
                (each.x, each.y),
                width,
                height,
                angle=angle,
                fill=False,
                color="#888888",
                label=label,
            )
        )
        label = None
    axes.legend(loc="best", fontsize="small")


def ellipse(covariance: tuple[float, ...]) -> tuple[float, float, float]:
    """Both axes in metres and the angle in degrees of the ellipse of x and y, at 2 sigma."""
    xx, xy, yy = covariance[0], covariance[1], covariance[4]
    middle, half = (xx + yy) / 2.0, math.hypot((xx - yy) / 2.0, xy)
    angle = 0.5 * math.degrees(math.atan2(2.0 * xy, xx - yy))
    large, small = math.sqrt(max(0.0, middle + half)), math.sqrt(max(0.0, middle - half))
    return 2.0 * SIGMAS * large, 2.0 * SIGMAS * small, angle


def _speeds(axes: Any, recording: Recording) -> None:  # noqa: ANN401
    wheels = _thinned(recording.of(WheelsSample))
    axes.set(title="wheels", ylabel="m/s")
    axes.grid(alpha=0.3)
    times = [recording.time_s(each.stamp_ns) for each in wheels]
    for index, name in enumerate(wheels[-1].names if wheels else ()):
        colour = COLOURS[index % len(COLOURS)]
        axes.plot(times, [each.speed_m_s[index] for each in wheels], color=colour, label=name)
        commanded = [each.command_m_s[index] for each in wheels]
        axes.plot(times, commanded, color=colour, lw=0.9, ls="--")
    axes.plot([], [], color="#444444", lw=0.9, ls="--", label="commanded")
    axes.legend(loc="best", fontsize="small", ncols=3)


def _battery(axes: Any, recording: Recording) -> None:  # noqa: ANN401
    battery = recording.of(BatterySample)
    axes.set(title="battery", ylabel="V")
    axes.grid(alpha=0.3)
    times = [recording.time_s(each.stamp_ns) for each in battery]
    axes.plot(times, [each.volts for each in battery], marker=".", color=COLOURS[0])


def _link(axes: Any, recording: Recording) -> None:  # noqa: ANN401
    """Draw readings a second, and write how much each counter of trouble has grown."""
    statuses = recording.of(StatusSample)
    axes.set(title="link", ylabel="readings a second")
    axes.grid(alpha=0.3)
    times, rates = [], []
    for before, after in pairwise(statuses):
        passed = (after.stamp_ns - before.stamp_ns) * 1e-9
        # A status that came early, after a change of state, covers too little for a rate.
        if passed > EVERY_S / 2.0:
            times.append(recording.time_s(after.stamp_ns))
            rates.append((_count(after, "readings") - _count(before, "readings")) / passed)
    axes.plot(times, rates, color=COLOURS[0])
    axes.set_ylim(bottom=0.0)
    grown = [
        f"{name.replace('_', ' ')} +{_count(statuses[-1], name) - _count(statuses[0], name)}"
        for name in TROUBLE
        if statuses and _count(statuses[-1], name) > _count(statuses[0], name)
    ]
    words = ", ".join(grown) or "no errors"
    axes.text(0.01, 0.06, words, transform=axes.transAxes, fontsize="small", color="#444444")


def _count(status: StatusSample, name: str) -> int:
    link: Mapping[str, Any] = status.link
    value = link.get(name, 0)
    return value if isinstance(value, int) else 0


def _timeline(axes: Any, recording: Recording) -> None:  # noqa: ANN401
    """Draw the robot's state at each time, and every event with its message."""
    statuses = recording.of(StatusSample)
    events = recording.of(EventSample)
    axes.set(title="what happened", xlabel="time, s", yticks=[])
    for name in ("left", "right", "top"):
        axes.spines[name].set_visible(False)
    if statuses:
        ends = [*(each.stamp_ns for each in statuses[1:]), statuses[-1].stamp_ns]
        states = list(dict.fromkeys(each.state for each in statuses))
        for each, end_ns in zip(statuses, ends, strict=True):
            begin = recording.time_s(each.stamp_ns)
            colour = COLOURS[states.index(each.state) % len(COLOURS)]
            width = recording.time_s(end_ns) - begin
            axes.broken_barh([(begin, width)], (0.0, 0.5), color=colour, alpha=0.6, lw=0)
        for state in states:
            colour = COLOURS[states.index(state) % len(COLOURS)]
            axes.plot([], [], lw=6, color=colour, alpha=0.6, label=state)
    rows = 6
    for number, event in enumerate(events[: 4 * rows]):
        at, height = recording.time_s(event.stamp_ns), 0.8 + number % rows * 0.55
        colour = SEVERITY[event.severity]
        axes.plot([at, at], [0.5, height], color=colour, lw=0.8)
        axes.text(
            at, height, f" {event.kind}: {event.message[:70]}", fontsize="x-small", color=colour
        )
    if len(events) > 4 * rows:
        axes.text(
            1.0,
            0.0,
            f"and {len(events) - 4 * rows} more events",
            ha="right",
            transform=axes.transAxes,
            fontsize="x-small",
        )
    axes.set_ylim(0.0, 0.8 + rows * 0.55)
    if statuses:
        axes.legend(loc="upper right", fontsize="small", ncols=4)
