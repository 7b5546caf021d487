"""A status in words. Pure."""

from __future__ import annotations

from yahboomd.bus import keys
from yahboomd.cli.screens import monitor_facts as facts
from yahboomd.cli.screens.dashboard import Dashboard
from yahboomd.cli.words import duration
from yahboomd.client import StatusSample
from yahboomd.messages.codecs import encode
from yahboomd.program import plain

NS_PER_S = 1e9


def text(status: StatusSample) -> str:
    """The status, a fact in each line; ends without a line break."""
    dashboard = Dashboard()
    dashboard.take(keys.STATUS, encode(status, "json"), 0)
    view = dashboard.view(0)
    volts = "" if view.volts is None else f", battery {view.volts:.1f} V"
    rows = (
        ("state", f"{status.state} for {duration(view.state_s)}"),
        ("why", status.why),
        ("driver", _driver(status)),
        ("board", f"{facts.board(view)}{volts}"),
        ("lost", facts.counts(view.link, "nothing")),
        ("refused", facts.counts(view.refusals, "no command")),
    )
    return "\n".join(plain(f"{name:<9}{words}") for name, words in rows)


def _driver(status: StatusSample) -> str:
    if status.driver is None:
        return "no source has control"
    since_ns = status.driver_since_ns
    if since_ns is None:
        return f"{status.driver} has control"
    held_s = max(0.0, (status.stamp_ns - since_ns) / NS_PER_S)
    return f"{status.driver} has had control for {duration(held_s)}"
