"""Makes the monitor's screen for rich. Pure: a view in, panels out."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from itertools import groupby
from operator import itemgetter

from rich.align import Align
from rich.console import RenderableType
from rich.layout import Layout
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from yahboomd.tools.screens import sentences
from yahboomd.tools.screens.dashboard import Count, View
from yahboomd.tools.screens.drawing import QUIET, SEVERITIES, STATES, line, panel, sentence
from yahboomd.tools.screens.path_map import path_map
from yahboomd.tools.terminal.words import degrees, duration, signed

MAP_FROM = 108
"""The fewest columns with room for a map beside the numbers."""


def screen(view: View, *, where: str, width: int, height: int) -> RenderableType:
    """The whole screen.

    Args:
        where: The robot and its address, for the title.
        height: Lines of the terminal; panels without room are left out, from below.
    """
    side = min(2 * height, width - 80) if width >= MAP_FROM and view.trail else 0
    main = width - side
    half = main // 2
    whole, numbers = Layout(), Layout()
    state, state_height = _state(view, where, main)
    used = state_height + 5 + max(1, len(view.wheel_rows)) + 2 + 5
    numbers.split_column(
        Layout(state, size=state_height),
        _beside(_pose(view), _twist(view), half),
        Layout(_wheels(view, main), size=max(1, len(view.wheel_rows)) + 2),
        _beside(_board(view), _bus(view), half),
        # Two lines for its frame, and at least one in it.
        Layout(_events(view, height - used - 2), visible=height - used > 2),
    )
    if not side:
        return numbers
    whole.split_row(numbers, Layout(_map(view, side, height), size=side))
    return whole


def waiting(view: View, *, where: str, why: str) -> RenderableType:
    """The screen before the first status: the address tried, and the trouble found."""
    words = [(f"waiting for a daemon at {where} …", "bold yellow"), ("", ""), (why, "yellow")]
    if view.unreadable:
        words.append((f"{view.unreadable} samples came that cannot be read", "red"))
    words += [("", ""), ("q ends this", QUIET)]
    centred = Text("\n", justify="center").join(sentence(each) for each in words)
    box = Panel(
        Align.center(centred, vertical="middle"),
        title=line(("yahboomd monitor", "bold default")),
        title_align="left",
        border_style="yellow",
    )
    # A layout is as high as the terminal.
    return Layout(box)


def _beside(left: RenderableType, right: RenderableType, width: int) -> Layout:
    both = Layout(size=5)
    both.split_row(Layout(left, size=width), Layout(right))
    return both


def _past(view: View) -> str:
    """The style of numbers: grey if they may be old."""
    return QUIET if view.phase == "silent" or view.late else ""


def _old(view: View) -> str:
    return " (old)" if _past(view) else ""


def _state(view: View, where: str, width: int) -> tuple[Panel, int]:
    """The panel, and its height."""
    status = view.status
    assert status is not None
    if view.phase == "silent":
        colour = "red"
        why = "All this is as it was then. Waiting for the daemon to come back … "
        why += sentences.lost_sight(view)
        head = line(
            (" NO STATUS ", "bold white on red"),
            (f" from the daemon for {duration(view.silent_s)}", "bold red"),
        )
        driver = line((f"it was {status.state}", "red"))
    else:
        colour, why = STATES.get(status.state, "default"), status.why
        head = line(
            (f"● {status.state.upper()}", f"bold {colour}"), f" for {duration(view.state_s)}"
        )
        driver = line(sentences.driver(view))
    ends = Table.grid(expand=True)
    ends.add_column(no_wrap=True)
    ends.add_column(justify="right", no_wrap=True)
    ends.add_row(head, driver)
    why_lines = textwrap.wrap(why, width - 4, max_lines=3, placeholder=" …") or [""]
    return (
        panel(ends, *map(line, why_lines), title=where, note="q ends", style=colour),
        len(why_lines) + 3,
    )


def _pose(view: View) -> Panel:
    pose, bold = view.pose, f"bold {_past(view)}".rstrip()
    if pose is None:
        return panel(line(("no pose yet", "yellow")), title="pose")
    x, y, theta = (math.sqrt(max(0.0, variance)) for variance in pose.covariance[::4])
    return panel(
        line("x ", (signed(pose.x), bold), " m    ", (f"± {x:.3f}", QUIET)),
        line("y ", (signed(pose.y), bold), " m    ", (f"± {y:.3f}", QUIET)),
        line(
            *("θ ", (signed(pose.theta), bold), " rad  ", (f"± {theta:.3f}", QUIET)),
            f"  {degrees(pose.theta)}",
        ),
        title=f"pose in {pose.frame_id}{_old(view)}",
    )


def _twist(view: View) -> Panel:
    twist, bold = view.twist, f"bold {_past(view)}".rstrip()
    if twist is None:
        return panel(line(("no twist yet", "yellow")), title="twist")
    turning = f" {signed(math.degrees(twist.wz), 1, 6)}°/s"
    return panel(
        line("forward ", (signed(twist.vx), bold), " m/s"),
        line("to left ", (signed(twist.vy), bold), " m/s"),
        line("turning ", (signed(twist.wz), bold), " rad/s", turning),
        title=f"twist of {twist.frame_id}{_old(view)}",
    )


def _wheels(view: View, width: int) -> Panel:
    longest = max((len(name) for name, *_ in view.wheel_rows), default=0)
    rows = []
    for name, ticks, speed_m_s, command_m_s in view.wheel_rows:
        numbers = (
            f"{name:<{longest}} {ticks:>10} "
            f"{signed(speed_m_s, 3, 7)} of {signed(command_m_s, 3, 6)}  "
        )
        room = max(9, width - 5 - len(numbers))
        full_m_s = view.full_scale_m_s
        drawn = bar(speed_m_s / full_m_s, command_m_s / full_m_s, room // 2 - 1)
        rows.append(line(numbers) + drawn)
        if style := _past(view):
            rows[-1].stylize(style)
    return panel(
        *(rows or [line(("no wheels yet", "yellow"))]),
        title=f"wheels: ticks, m/s measured █ and commanded ┃{_old(view)}",
        note=f"a full bar is {view.full_scale_m_s:.2f} m/s",
    )


def bar(speed: float, command: float, half: int) -> Text:
    """Draw a speed beside its command, with zero in the middle.

    Args:
        speed: Drawn as a bar from the middle, by half characters; 1 reaches the end.
        command: Drawn as a mark.
        half: Characters to each side of the middle.
    """
    cells = [("·", QUIET)] * half + [("┼", QUIET)] + [("·", QUIET)] * half
    whole, rest = divmod(round(min(1.0, abs(speed)) * half * 2), 2)
    step = 1 if speed > 0.0 else -1
    for index in range(1, whole + 1):
        cells[half + step * index] = ("█", "green")
    if rest:
        cells[half + step * (whole + 1)] = ("▌" if speed > 0.0 else "▐", "green")
    if command:
        # Even the smallest command stays visible.
        place = max(1, round(min(1.0, abs(command)) * half))
        cells[half + (place if command > 0.0 else -place)] = ("┃", "bold")
    runs = groupby(cells, key=itemgetter(1))
    return Text.assemble(*(("".join(each for each, _ in run), style) for style, run in runs))


def _board(view: View) -> Panel:
    return panel(
        line(sentences.board(view)),
        line((sentences.readings(view), _past(view)), f" · {sentences.supply(view)}"),
        _troubles(view.link, "nothing lost, refused or missed"),
        title="board",
    )


def _bus(view: View) -> Panel:
    return panel(
        line((sentences.traffic(view), _past(view))),
        _troubles(view.refusals, "no command refused", "refused: "),
        line(sentences.routers(view)),
        title="bus",
    )


def _troubles(counts: Sequence[Count], nothing: str, before: str = "") -> Text:
    """Counters: first those that rise now, in red; then the others, in grey."""
    if not counts:
        return line((nothing, "green"))
    ordered = sorted(counts, key=lambda count: not count.rising)
    parts = (
        (f"{count.name} {count.total}", "bold red" if count.rising else QUIET) for count in ordered
    )
    return line(before) + line((" · ", QUIET)).join(map(line, parts))


def _events(view: View, room: int) -> Panel:
    rows = Table.grid(padding=(0, 2, 0, 0))
    for event in list(reversed(view.events))[: max(0, room)]:
        colour = SEVERITIES.get(event.severity, "default")
        form = line if rows.row_count else sentence
        rows.add_row(line((sentences.moment(event), QUIET)), form((event.message, colour)))
    nothing = line(("nothing since this monitor was started", QUIET))
    return panel(rows if view.events else nothing, title="events")


def _map(view: View, width: int, height: int) -> Panel:
    theta = 0.0 if view.pose is None else view.pose.theta
    drawn, (column, row), scale_m = path_map(
        view.trail, theta=theta, width=width - 4, height=height - 2
    )
    lines = [line((each, "cyan")) for each in drawn]
    lines[row].stylize(_past(view) or "bold yellow", column, column + 1)
    return panel(*lines, title="path, x is up", note=f"a line is {scale_m:.2f} m")
