"""The screen of ``yahboomd drive``: the keys, what is commanded, and why the robot stands. Pure."""

from __future__ import annotations

import textwrap

from yahboomd.cli.screens import monitor_facts as facts
from yahboomd.cli.screens.ansi import Part, paint
from yahboomd.cli.screens.teleop import TeleopView
from yahboomd.cli.screens.view import View
from yahboomd.cli.words import SEVERITIES, STATES, degrees, signed
from yahboomd.model import Twist2d

KEYS = (
    "        w ↑                  u  i  o        space       stop (as any other key)",
    "   a ←  s ↓  d →             j     l        + -         faster, slower",
    "                             m  ,  .        e           emergency stop",
    "   hold to drive,            the same,      r           release it, or a fault",
    "   let go to stop            and arcs       q           quit",
)
"""What each key does."""

_ARROWS = {
    (1, 0, 0): "↑ forward",
    (-1, 0, 0): "↓ backward",
    (0, 0, 1): "↺ turning left",
    (0, 0, -1): "↻ turning right",
    (1, 0, 1): "↖ forward, to the left",
    (1, 0, -1): "↗ forward, to the right",
    (-1, 0, -1): "↙ backward, to the left",
    (-1, 0, 1): "↘ backward, to the right",
    (0, 1, 0): "← sideways",
    (0, -1, 0): "→ sideways",
}


def screen(
    view: View,
    teleop: TeleopView,
    *,
    robot: str,
    key: str,
    heard: bool,
    why: str,
    said: Part,
    width: int,
    height: int,
    colours: bool = True,
) -> list[str]:
    """The lines of the screen.

    Args:
        view: What is known of the daemon.
        teleop: What this keyboard commands.
        robot: Whom it commands, and where that is.
        key: The bus key of the commands.
        heard: Whether anybody listens on it.
        why: Why nothing is known of the daemon yet, or any more.
        said: What the last request brought, with its style.
        width: Columns of the terminal.
        height: Its lines: what does not fit below is left out, the legend first.
        colours: Whether the terminal shows any.
    """
    lines: list[list[Part]] = [
        [(" yahboomd drive ", "bold reverse"), (f"  {robot}  on {key}", "dim")],
        [],
        *([(line, "")] for line in KEYS),
        [],
        [*_you(teleop)],
        *_robot(view, why, width),
        *_trouble(view, key, heard=heard),
        [],
        *_wrapped(("   ", ""), [], said[0], said[1], width),
    ]
    if len(lines) > height:
        # In a low window the legend goes: who made it low knows the keys.
        del lines[1 : 3 + len(KEYS)]
    return [paint(line, width, colours=colours) for line in lines[:height]]


def words(twist: Twist2d | None) -> str:
    """A command in words."""
    if twist is None:
        return "nothing commanded"
    if twist.is_zero:
        return "■ stop"
    signs = tuple((each > 0.0) - (each < 0.0) for each in (twist.vx, twist.vy, twist.wz))
    return _ARROWS.get((signs[0], signs[1], signs[2]), "moving")


def _you(teleop: TeleopView) -> list[Part]:
    style = "bold green" if teleop.twist is not None and not teleop.twist.is_zero else "bold"
    return [
        ("   you    ", "dim"),
        (f"{words(teleop.twist):<26}", style),
        (f" speeds {teleop.linear_m_s:.2f} m/s, {teleop.angular_rad_s:.2f} rad/s", ""),
    ]


def _robot(view: View, why: str, width: int) -> list[list[Part]]:
    label = "   robot  "
    status = view.status
    if status is None:
        sentence = f"waiting for the daemon … {why}"
        return _wrapped((label, "dim"), [], sentence, "yellow", width)
    if view.phase == "silent":
        sentence = f"no word from the daemon for {view.silent_s or 0.0:.0f} s. {why}"
        rows = _wrapped((label, "dim"), [("● ", "red")], sentence, "red", width)
        if remedy := facts.lost_sight(view):
            rows += _wrapped((" " * len(label), ""), [], remedy, "bold red", width)
        return rows
    colour = STATES.get(status.state, "default")
    state: Part = (f"● {status.state.upper()} ", f"bold {colour}")
    rows = _wrapped((label, "dim"), [state], status.why, "", width)
    rows.append([("   driver ", "dim"), (facts.driver(view), "")])
    pose, twist = view.pose, view.twist
    style = "dim" if view.late else ""
    if pose is not None:
        where = f"x {signed(pose.x, 2, 0)} m  y {signed(pose.y, 2, 0)} m  θ {degrees(pose.theta)}"
        if twist is not None:
            where += f"   moving {signed(twist.vx, 2, 0)} m/s, {signed(twist.wz, 2, 0)} rad/s"
        rows.append([("   pose   ", "dim"), (where, style)])
    if view.events:
        event = view.events[-1]
        fresh = event.age_s < 10.0
        colour = SEVERITIES.get(event.severity, "default") if fresh else "dim"
        rows += _wrapped(("   event  ", "dim"), [], event.message, colour, width, most=2)
    return rows


def _trouble(view: View, key: str, *, heard: bool) -> list[list[Part]]:
    """What keeps commands from being heard at all."""
    if heard or view.phase != "live":
        return []
    name = key if "/" not in key else f'"{key}"'
    return [
        [(f"          The daemon accepts no commands on {key}. Start it with:", "bold red")],
        [(f"          --set 'command.sources.{name}.priority=10'", "bold")],
    ]


def _wrapped(
    label: Part, before: list[Part], sentence: str, style: str, width: int, *, most: int = 3
) -> list[list[Part]]:
    indent = len(label[0])
    used = sum(len(text) for text, _ in before)
    wrapped = textwrap.wrap(
        sentence,
        max(20, width - indent),
        initial_indent=" " * used,
        max_lines=most,
        placeholder=" …",
    ) or [""]
    first: list[Part] = [label, *before, (wrapped[0][used:], style)]
    return [first, *([(" " * indent, ""), (line, style)] for line in wrapped[1:])]
