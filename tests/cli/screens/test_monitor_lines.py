from __future__ import annotations

import daemon_samples as daemon

from yahboomd.bus import keys
from yahboomd.cli.screens import monitor_lines
from yahboomd.cli.screens.dashboard import Dashboard
from yahboomd.messages.codecs import encode

S = 1_000_000_000


def test_a_snapshot_holds_everything() -> None:
    text = monitor_lines.snapshot(daemon.driving(0).view(0), where="bot1 at tcp/127.0.0.1:7448")
    rows = dict(line.split(maxsplit=1) for line in text.splitlines())
    assert rows["daemon"] == "bot1 at tcp/127.0.0.1:7448"
    assert rows["state"] == "driving for 2.0 s"
    assert rows["why"] == "cmd_vel drives."
    assert rows["pose"] == "x 1.500 m  y -0.250 m  theta 0.500 rad (28.6°)"
    assert rows["twist"] == "vx 0.300 m/s  wz -0.250 rad/s"
    assert rows["left"] == "wheel   1000 ticks, +0.290 m/s of +0.300"
    assert rows["battery"] == "7.40 V"
    assert rows["board"] == "streamed 1.7.3 on /dev/ttyUSB0"
    assert rows["refused"] == "no command"
    assert rows["event"].endswith("warning: The board reset itself.")


def test_a_snapshot_of_a_silent_daemon_says_so() -> None:
    text = monitor_lines.snapshot(daemon.driving(0).view(5 * S), where="bot1")
    assert "bot1, silent for 5.0 s" in text


def test_a_line_tells_the_most_important() -> None:
    line = monitor_lines.line(daemon.driving(0).view(0))
    assert line.startswith("driving   cmd_vel ")
    assert "x 1.500 m" in line
    assert "(old)" not in line
    assert "7.4 V" in line
    assert "\n" not in line


def test_a_line_marks_what_is_old() -> None:
    dashboard = daemon.driving(0)
    dashboard.take(keys.STATUS, encode(daemon.status(), "json"), 2 * S)
    assert "(old)" in monitor_lines.line(dashboard.view(2 * S))
    assert "no word from the daemon for 7.0 s" in monitor_lines.line(dashboard.view(9 * S))


def test_what_comes_over_the_bus_stays_on_its_line_and_commands_no_terminal() -> None:
    dashboard = Dashboard()
    evil = daemon.status(why="\x1b[2J\nx", driver="\x1b]0;owned\x07")
    dashboard.take(keys.STATUS, encode(evil, "json"), 0)
    dashboard.take(keys.EVENTS, encode(daemon.event("\x1b[31m\n\n"), "json"), 0)
    view = dashboard.view(0)
    for text in (monitor_lines.line(view), *monitor_lines.snapshot(view, where="x").splitlines()):
        assert text.isprintable()
    assert monitor_lines.event_line(view.events[0]).isprintable()
