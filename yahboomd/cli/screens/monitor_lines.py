"""The monitor as lines of text, for logs, pipes and terminals that can do no more. Pure."""

from __future__ import annotations

import time

from yahboomd.cli.screens import monitor_facts as facts
from yahboomd.cli.screens.view import EventView, View
from yahboomd.cli.words import degrees, duration
from yahboomd.program import plain


def snapshot(view: View, *, where: str) -> str:
    """Everything, once; ends without a line break."""
    status = view.status
    if status is None:
        return f"no daemon at {where}"
    rows = [
        ("daemon", where + ("" if view.phase == "live" else f", silent for {view.silent_s:.1f} s")),
        ("state", f"{status.state} for {duration(view.state_s)}"),
        ("why", status.why),
        ("driver", facts.driver(view)),
        ("pose", _pose(view)),
        ("twist", _twist(view)),
        *(
            (
                f"{wheel.name} wheel",
                f"{wheel.ticks} ticks, {wheel.speed_m_s:+.3f} m/s of {wheel.command_m_s:+.3f}",
            )
            for wheel in view.wheels
        ),
        ("battery", "unknown" if view.volts is None else f"{view.volts:.2f} V"),
        ("board", facts.board(view)),
        ("link", f"{facts.link(view)} · {facts.counts(view.link, 'nothing lost or missed')}"),
        ("bus", f"{facts.traffic(view)} · {facts.routers(view)}"),
        ("refused", facts.counts(view.refusals, "no command")),
        *(("event", event_line(event)) for event in view.events),
    ]
    width = max(len(name) for name, _ in rows) + 2
    return "\n".join(plain(f"{name:<{width}}{text}") for name, text in rows)


def line(view: View) -> str:
    """The most important, in one line."""
    status = view.status
    if status is None:
        return "waiting"
    if view.phase == "silent":
        return f"no word from the daemon for {view.silent_s:.1f} s (it was {status.state})"
    volts = "" if view.volts is None else f"  {view.volts:.1f} V"
    late = " (old)" if view.late else ""
    return plain(
        f"{status.state:<9} {status.driver or '-':<14} {_pose(view)}  {_twist(view)}{late}"
        f"  {facts.link(view)}{volts}"
    )


def event_line(event: EventView) -> str:
    """An event, with its time of day."""
    moment = time.strftime("%H:%M:%S", time.localtime(event.stamp_ns / 1e9))
    return plain(f"{moment} {event.severity}: {event.message}")


def _pose(view: View) -> str:
    pose = view.pose
    if pose is None:
        return "unknown"
    x, y, theta = (round(each, 3) + 0.0 for each in (pose.x, pose.y, pose.theta))
    return f"x {x:.3f} m  y {y:.3f} m  theta {theta:.3f} rad ({degrees(pose.theta)})"


def _twist(view: View) -> str:
    twist = view.twist
    if twist is None:
        return "unknown"
    vx, vy, wz = (round(each, 3) + 0.0 for each in (twist.vx, twist.vy, twist.wz))
    sideways = f"  vy {vy:.3f} m/s" if vy else ""
    return f"vx {vx:.3f} m/s{sideways}  wz {wz:.3f} rad/s"
