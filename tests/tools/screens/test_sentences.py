from __future__ import annotations

import daemon_samples as daemon

from yahboomd.core.bus import keys
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import StatusSample
from yahboomd.tools.screens import sentences
from yahboomd.tools.screens.dashboard import Dashboard, View


def test_a_daemon_that_vanished_while_it_drove_is_a_warning() -> None:
    for state in ("driving", "stopping"):
        words = sentences.lost_sight(View(phase="silent", status=daemon.status(state)))
        assert f"It was {state}" in words
        assert "supply off" in words
    assert sentences.lost_sight(View(phase="silent", status=daemon.status("standing"))) == ""
    assert sentences.lost_sight(View(phase="waiting")) == ""
    waiting = daemon.status("waiting", wheels="unknown")
    assert "supply off" in sentences.lost_sight(View(phase="silent", status=waiting))
    assert "wheels   unknown" in sentences.status_text(View(phase="live", status=waiting))


def test_a_snapshot_holds_everything() -> None:
    text = sentences.snapshot(daemon.driving(0).view(0), where="bot1 at tcp/127.0.0.1:7448")
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


def test_what_comes_over_the_bus_stays_on_its_line_and_commands_no_terminal() -> None:
    dashboard = Dashboard()
    evil = daemon.status(why="\x1b[2J\nx", driver="\x1b]0;owned\x07")
    dashboard.accept(keys.STATUS, encode(evil, "json"), 0)
    dashboard.accept(keys.EVENTS, encode(daemon.event("\x1b[31m\n\n"), "json"), 0)
    view = dashboard.view(0)
    for text in (sentences.line(view), *sentences.snapshot(view, where="x").splitlines()):
        assert text.isprintable()
    assert sentences.event_line(view.events[0]).isprintable()


def status_lines(status: StatusSample) -> list[str]:
    dashboard = Dashboard()
    dashboard.accept(keys.STATUS, encode(status, "json"), 0)
    return sentences.status_text(dashboard.view(0)).splitlines()


def test_a_status_is_printed_with_state_reason_driver_and_board() -> None:
    assert status_lines(daemon.status(since_s=2.0, driver_s=3.0)) == [
        "state    driving for 2.0 s",
        "wheels   not known yet",
        "why      cmd_vel drives.",
        "driver   cmd_vel has control for 3.0 s",
        "board    streamed 1.7.3 on /dev/ttyUSB0, battery unknown",
        "lost     nothing",
        "refused  no command",
    ]
