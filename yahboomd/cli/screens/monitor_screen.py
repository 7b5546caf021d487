"""The monitor as a screen of its own, for rich to print. Pure: a view in, lines of text out."""

from __future__ import annotations

import math
import textwrap
import time
from collections.abc import Sequence
from itertools import groupby
from operator import itemgetter

from rich.text import Text

from yahboomd.cli.screens import monitor_facts as facts
from yahboomd.cli.screens.ansi import Part
from yahboomd.cli.screens.boxes import QUIET, beside, ends, framed, line, stacked
from yahboomd.cli.screens.trail_map import trail_map
from yahboomd.cli.screens.view import Count, EventView, View, WheelView
from yahboomd.cli.words import SEVERITIES, STATES, bar, degrees, duration, signed

MAP_FROM = 108
"""Columns from which on there is room for a map beside the numbers."""

BAR_PARTS = {"empty": QUIET, "axis": QUIET, "speed": "green", "command": "bold"}
"""How the parts of a bar are drawn."""


def screen(view: View, *, where: str, width: int, height: int) -> Text:
    """The whole screen.

    Args:
        view: What there is to show.
        where: The robot and where it is, for the title.
        width: Columns of the terminal.
        height: Its lines; boxes for which there is no room are left out, from below.
    """
    if view.status is None:
        return waiting(view, where=where, width=width, height=height)
    side = min(2 * height, width - 80) if width >= MAP_FROM and view.trail else 0
    width -= side
    half = width // 2
    lines = [
        *_state(view, where, width),
        *beside(_pose(view, half), _twist(view, width - half)),
        *_wheels(view, width),
        *beside(_board(view, half), _bus(view, width - half)),
    ]
    room = height - len(lines)
    # Two for its frame; a box without a line in it says nothing.
    if room > 2:
        lines += _events(view, width, room)
    # All of the screen is drawn, over what was there before.
    lines = (lines + [line(" " * width)] * height)[:height]
    if side:
        lines = beside(lines, _map(view, side, len(lines)))
    return stacked(lines)


def waiting(view: View, *, where: str, width: int, height: int, why: str = "") -> Text:
    """The screen before any status came: where the daemon is looked for, and what was found."""
    inside = width - 4
    sentences: list[Part] = [(f"waiting for a daemon at {where} …", "bold yellow"), ("", "")]
    sentences += [(each, "yellow") for each in textwrap.wrap(why, inside)]
    if view.unreadable:
        sentences.append((f"{view.unreadable} samples came that cannot be read", "red"))
    sentences += [("", ""), ("q ends this", QUIET)]
    lines = [line((words.center(inside), style)) for words, style in sentences]
    above = max(0, (height - 2 - len(lines)) // 2)
    return stacked(
        framed(
            [line()] * above + lines,
            width=width,
            height=height,
            title="yahboomd monitor",
            style="yellow",
        )
    )


def _past(view: View) -> str:
    """The style of numbers: grey where they may tell the past."""
    return QUIET if view.phase == "silent" or view.late else ""


def _old(view: View) -> str:
    return " (old)" if _past(view) else ""


def _state(view: View, where: str, width: int) -> list[Text]:
    status = view.status
    assert status is not None
    if view.phase == "silent":
        colour = "red"
        why = "All this is as it was then. Waiting for the daemon to come back … "
        why += facts.lost_sight(view)
        head = line(
            (" NO WORD ", "bold white on red"),
            (f" from the daemon for {duration(view.silent_s or 0.0)}", "bold red"),
        )
        driver = line((f"it was {status.state}", "red"))
    else:
        colour, why = STATES.get(status.state, "default"), status.why
        head = line(
            (f"● {status.state.upper()}", f"bold {colour}"), f" for {duration(view.state_s)}"
        )
        driver = line(facts.driver(view))
    inside = width - 4
    sentences = textwrap.wrap(why, inside, max_lines=3, placeholder=" …") or [""]
    return framed(
        [ends(head, driver, inside), *map(line, sentences)],
        width=width,
        title=where,
        note="q ends",
        style=colour,
    )


def _pose(view: View, width: int) -> list[Text]:
    pose, bold = view.pose, f"bold {_past(view)}".rstrip()
    if pose is None:
        return framed([line(("no pose yet", "yellow"))], width=width, height=5, title="pose")
    x, y, theta = view.sigma or (0.0, 0.0, 0.0)
    heading = f"  {degrees(pose.theta)}"
    lines = [
        line("x ", (signed(pose.x), bold), " m    ", (f"± {x:.3f}", QUIET)),
        line("y ", (signed(pose.y), bold), " m    ", (f"± {y:.3f}", QUIET)),
        line("θ ", (signed(pose.theta), bold), " rad  ", (f"± {theta:.3f}", QUIET), heading),
    ]
    return framed(lines, width=width, title=f"pose in {pose.frame_id}{_old(view)}")


def _twist(view: View, width: int) -> list[Text]:
    twist, bold = view.twist, f"bold {_past(view)}".rstrip()
    if twist is None:
        return framed([line(("no twist yet", "yellow"))], width=width, height=5, title="twist")
    turning = f" {signed(math.degrees(twist.wz), 1, 6)}°/s"
    lines = [
        line("forward ", (signed(twist.vx), bold), " m/s"),
        line("to left ", (signed(twist.vy), bold), " m/s"),
        line("turning ", (signed(twist.wz), bold), " rad/s", turning),
    ]
    return framed(lines, width=width, title=f"twist of {twist.frame_id}{_old(view)}")


def _wheels(view: View, width: int) -> list[Text]:
    longest = max((len(wheel.name) for wheel in view.wheels), default=0)
    return framed(
        [_wheel(wheel, view, longest, width - 4) for wheel in view.wheels]
        or [line(("no wheels yet", "yellow"))],
        width=width,
        title=f"wheels: ticks, m/s measured █ and commanded ┃{_old(view)}",
        note=f"a full bar is {view.full_scale_m_s:.2f} m/s",
    )


def _wheel(wheel: WheelView, view: View, longest: int, room: int) -> Text:
    style = _past(view)
    numbers = (
        f"{wheel.name:<{longest}} {wheel.ticks:>10} "
        f"{signed(wheel.speed_m_s, 3, 7)} of {signed(wheel.command_m_s, 3, 6)}  "
    )
    # An odd number has a middle.
    width = max(9, room - len(numbers) - 1) // 2 * 2 - 1
    cells = bar(wheel.speed_m_s, wheel.command_m_s, full_scale=view.full_scale_m_s, width=width)
    runs = [
        ("".join(each for each, _ in run), style or BAR_PARTS[part])
        for part, run in groupby(cells, key=itemgetter(1))
    ]
    return line((numbers, style), *runs)


def _board(view: View, width: int) -> list[Text]:
    lines = [
        line(facts.board(view)),
        line((facts.link(view), _past(view)), f" · {facts.supply(view)}"),
        _troubles(view.link, "nothing lost, refused or missed"),
    ]
    return framed(lines, width=width, title="board")


def _bus(view: View, width: int) -> list[Text]:
    lines = [
        line((facts.traffic(view), _past(view))),
        _troubles(view.refusals, "no command refused", "refused: "),
        line(facts.routers(view)),
    ]
    return framed(lines, width=width, title="bus")


def _troubles(counts: Sequence[Count], nothing: str, before: str = "") -> Text:
    """Counters: those that rise now in red and first, history in grey."""
    if not counts:
        return line((nothing, "green"))
    ordered = sorted(counts, key=lambda count: not count.rising)
    parts: list[str | Part] = [before]
    for index, count in enumerate(ordered):
        style = "bold red" if count.rising else QUIET
        parts.append((f"{' · ' if index else ''}{count.name} {count.total}", style))
    return line(*parts)


def _events(view: View, width: int, height: int) -> list[Text]:
    lines: list[Text] = []
    room = height - 2
    for event in reversed(view.events):
        if len(lines) == room:
            break
        # The newest is shown in full, the older ones in a line each.
        lines += _event(event, width - 4, 1 if lines else min(3, room))
    lines = lines or [line(("nothing since this monitor was started", QUIET))]
    return framed(lines, width=width, height=height, title="events")


def _event(event: EventView, width: int, most: int) -> list[Text]:
    moment = time.strftime("%H:%M:%S  ", time.localtime(event.stamp_ns / 1e9))
    sentences = textwrap.wrap(
        event.message, max(10, width - len(moment)), max_lines=most, placeholder=" …"
    )
    colour = SEVERITIES.get(event.severity, "default")
    return [
        line((" " * len(moment) if index else moment, QUIET), (words, colour))
        for index, words in enumerate(sentences or [""])
    ]


def _map(view: View, width: int, height: int) -> list[Text]:
    theta = 0.0 if view.pose is None else view.pose.theta
    drawn, (column, row), scale_m = trail_map(
        view.trail, theta=theta, width=width - 4, height=height - 2
    )
    lines = [line((each, "cyan")) for each in drawn]
    lines[row].stylize(_past(view) or "bold yellow", column, column + 1)
    note = f"a line is {scale_m:.2f} m"
    return framed(lines, width=width, height=height, title="path, x is up", note=note)
