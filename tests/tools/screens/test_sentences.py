from __future__ import annotations

import daemon_samples as daemon
import msgspec

from yahboomd.core.bus import keys
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import StatusSample
from yahboomd.tools.screens import sentences
from yahboomd.tools.screens.dashboard import Count, Dashboard, View

S = 1_000_000_000


def test_a_driver_is_named_with_how_long_it_has_had_control() -> None:
    view = View(phase="live", status=daemon.status(), driver_s=4.0)
    assert sentences.driver(view) == "cmd_vel has control for 4.0 s"
    unknown = msgspec.structs.replace(view, driver_s=None)
    assert sentences.driver(unknown) == "cmd_vel has control"


def test_without_a_driver_no_source_has_control() -> None:
    assert (
        sentences.driver(View(phase="live", status=daemon.status(driver=None)))
        == "no source has control"
    )
    assert sentences.driver(View(phase="waiting")) == "no source has control"


def test_the_board_is_named_with_dialect_firmware_and_port() -> None:
    view = View(phase="live", status=daemon.status())
    assert sentences.board(view) == "streamed 1.7.3 on /dev/ttyUSB0"
    assert sentences.board(View(phase="waiting")) == "no board"


def test_a_battery_without_a_measurement_is_unknown() -> None:
    assert sentences.supply(View(phase="live")) == "battery unknown"
    assert sentences.supply(View(phase="live", volts=7.43)) == "battery 7.4 V"


def test_a_router_that_was_joined_is_named() -> None:
    status = daemon.status(bus={"routers": "tcp/10.0.0.1:7447", "neighbours": 3})
    joined = sentences.routers(View(phase="live", status=status))
    assert joined == "joined the router tcp/10.0.0.1:7447"
    alone = sentences.routers(View(phase="live", status=daemon.status()))
    assert alone == "joined no router · 2 connected"


def test_rates_and_counts_in_words() -> None:
    view = View(phase="live", readings_per_s=99.6, commands_per_s=20.0)
    assert sentences.readings(view) == "100 readings/s"
    assert sentences.traffic(view) == "20 commands/s · - poses/s"
    assert sentences.counts((), "nothing") == "nothing"
    assert sentences.counts((Count(name="lost", total=2, rising=True),), "nothing") == "lost 2"


def test_a_daemon_that_vanished_while_it_drove_is_a_warning() -> None:
    for state in ("driving", "stopping"):
        words = sentences.lost_sight(View(phase="silent", status=daemon.status(state)))
        assert f"It was {state}" in words
        assert "supply off" in words
    assert sentences.lost_sight(View(phase="silent", status=daemon.status("standing"))) == ""
    assert sentences.lost_sight(View(phase="waiting")) == ""


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


def test_a_snapshot_of_a_silent_daemon_says_so() -> None:
    text = sentences.snapshot(daemon.driving(0).view(5 * S), where="bot1")
    assert "bot1, silent for 5.0 s" in text


def test_a_line_has_the_most_important() -> None:
    line = sentences.line(daemon.driving(0).view(0))
    assert line.startswith("driving   cmd_vel ")
    assert "x 1.500 m" in line
    assert "(old)" not in line
    assert "7.4 V" in line
    assert "\n" not in line


def test_a_line_marks_what_is_old() -> None:
    dashboard = daemon.driving(0)
    dashboard.accept(keys.STATUS, encode(daemon.status(), "json"), 2 * S)
    assert "(old)" in sentences.line(dashboard.view(2 * S))
    assert "no status from the daemon for 7.0 s" in sentences.line(dashboard.view(9 * S))


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
        "why      cmd_vel drives.",
        "driver   cmd_vel has control for 3.0 s",
        "board    streamed 1.7.3 on /dev/ttyUSB0",
        "lost     nothing",
        "refused  no command",
    ]


def test_losses_and_refusals_are_named_and_counted() -> None:
    status = daemon.status(
        link={"broken_frames": 2, "overlong": 1}, command={"stale": 4, "lower_priority": 1}
    )
    expected = ["lost     lost 3", "refused  stale 4 · lower priority 1"]
    assert status_lines(status)[-2:] == expected


def test_a_status_cannot_command_the_terminal() -> None:
    text = status_lines(daemon.status(driver="cmd\x1b[2Jvel", why="a\x1bb"))
    assert "\x1b" not in "".join(text)
