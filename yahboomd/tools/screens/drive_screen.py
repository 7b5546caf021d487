"""The screen of ``yahboomd drive``: the keys, the command, and why the robot stands. Pure."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from yahboomd.core.model import Twist2d
from yahboomd.tools.screens import sentences
from yahboomd.tools.screens.dashboard import View
from yahboomd.tools.screens.drawing import QUIET, SEVERITIES, STATES, Part, Widest, line, sentence
from yahboomd.tools.terminal.words import degrees, signed

KEYS = """
        w ↑                  u  i  o        space       stop (as any other key)
   a ←  s ↓  d →             j     l        + -         faster, slower
                             m  ,  .        e           emergency stop
   hold to drive,            the same,      r           release it, or a fault
   let go to stop            and arcs       q           quit
"""
"""The effect of each key."""

NARROW_KEYS = """
   w s a d ↑ ↓ ← →  u i o j l m , .
          hold to drive, let go to stop
   space  stop (as any other key)
   + -    faster, slower
   e      emergency stop
   r      release it, or a fault
   q      quit
"""
"""The same for narrow terminals."""

FRESH_S = 10.0
"""An event is highlighted for this time."""

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
    command: Twist2d | None,
    speeds: tuple[float, float],
    *,
    robot: str,
    key: str,
    heard: bool,
    why: str,
    answer: Part,
) -> tuple[RenderableType, RenderableType]:
    """The screen, and the same without the legend for low terminals.

    Args:
        command: The published command, including zeros after motion; None for nothing.
        speeds: The speeds of a key, in m/s and rad/s.
        heard: Whether a daemon subscribes to the key.
        why: Why no status has come, or comes any more.
        answer: The answer to the last request, with its style.
    """
    head = line((" yahboomd drive ", "bold reverse"), (f"  {robot}  on {key}", QUIET))
    rows = Table.grid(padding=(0, 1, 0, 0))
    rows.add_column(style=QUIET, min_width=9, no_wrap=True)
    moving = command is not None and not command.is_zero
    rows.add_row(
        "   you",
        sentence(
            (f"{words(command):<26}", "bold green" if moving else "bold"),
            f" speeds {speeds[0]:.2f} m/s, {speeds[1]:.2f} rad/s",
        ),
    )
    for label, text in _robot(view, why) + _trouble(view, key, heard=heard):
        rows.add_row(f"   {label}", text)
    legend = Widest(KEYS, NARROW_KEYS)
    facts = (rows, "", Padding(sentence(answer), (0, 0, 0, 3)))
    return Group(head, legend, *facts), Group(head, *facts)


def words(twist: Twist2d | None) -> str:
    """A command in words."""
    if twist is None:
        return "nothing commanded"
    if twist.is_zero:
        return "■ stop"
    signs = tuple((each > 0.0) - (each < 0.0) for each in (twist.vx, twist.vy, twist.wz))
    return _ARROWS.get((signs[0], signs[1], signs[2]), "moving")


def _robot(view: View, why: str) -> list[tuple[str, Text]]:
    status = view.status
    if status is None:
        return [("robot", sentence((f"waiting for the daemon … {why}", "yellow")))]
    if view.phase == "silent":
        silence = f"● no status from the daemon for {view.silent_s:.0f} s. {why}"
        rows = [("robot", sentence((silence, "red")))]
        if remedy := sentences.lost_sight(view):
            rows.append(("", sentence((remedy, "bold red"))))
        return rows
    state = (f"● {status.state.upper()} ", f"bold {STATES.get(status.state, 'default')}")
    rows = [("robot", sentence(state, status.why)), ("driver", sentence(sentences.driver(view)))]
    pose, twist = view.pose, view.twist
    if pose is not None:
        where = f"x {signed(pose.x, 2, 0)} m  y {signed(pose.y, 2, 0)} m  θ {degrees(pose.theta)}"
        if twist is not None:
            where += f"   moving {signed(twist.vx, 2, 0)} m/s, {signed(twist.wz, 2, 0)} rad/s"
        rows.append(("pose", sentence((where, QUIET if view.late else ""))))
    if view.events:
        event = view.events[-1]
        colour = SEVERITIES.get(event.severity, "default") if view.event_age_s < FRESH_S else QUIET
        rows.append(("event", sentence((event.message, colour))))
    return rows


def _trouble(view: View, key: str, *, heard: bool) -> list[tuple[str, Text]]:
    """Explain why the daemon receives no commands at all."""
    if heard or view.phase != "live":
        return []
    name = key if "/" not in key else f'"{key}"'
    return [
        ("", sentence((f"The daemon accepts no commands on {key}. Start it with:", "bold red"))),
        ("", sentence((f"--set 'command.sources.{name}.priority=10'", "bold"))),
    ]
