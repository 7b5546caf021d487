from __future__ import annotations

import daemon_samples as daemon
import msgspec

from yahboomd.cli.screens import monitor_facts as facts
from yahboomd.cli.screens.view import Count, View


def test_the_driver_is_shown_with_the_known_time_of_control() -> None:
    view = View(phase="live", status=daemon.status(), driver_s=4.0, driver_at_least=True)
    assert facts.driver(view) == "cmd_vel has control for over 4.0 s"
    begun = msgspec.structs.replace(view, driver_at_least=False)
    assert facts.driver(begun) == "cmd_vel has control for 4.0 s"


def test_without_a_driver_none_is_shown() -> None:
    assert (
        facts.driver(View(phase="live", status=daemon.status(driver=None)))
        == "no source has control"
    )
    assert facts.driver(View(phase="waiting")) == "no source has control"


def test_the_board_is_named_with_dialect_firmware_and_port() -> None:
    view = View(phase="live", status=daemon.status())
    assert facts.board(view) == "streamed 1.7.3 on /dev/ttyUSB0"
    assert facts.board(View(phase="waiting")) == "no board"


def test_a_battery_that_was_not_measured_is_unknown() -> None:
    assert facts.supply(View(phase="live")) == "battery unknown"
    assert facts.supply(View(phase="live", volts=7.43)) == "battery 7.4 V"


def test_a_router_that_was_joined_is_named() -> None:
    status = daemon.status(bus={"routers": "tcp/10.0.0.1:7447", "neighbours": 3})
    joined = facts.routers(View(phase="live", status=status))
    assert joined == "joined the router tcp/10.0.0.1:7447"
    alone = facts.routers(View(phase="live", status=daemon.status()))
    assert alone == "joined no router · 2 connected"


def test_rates_and_counts_in_words() -> None:
    view = View(phase="live", readings_per_s=99.6, commands_per_s=20.0)
    assert facts.link(view) == "100 readings/s"
    assert facts.traffic(view) == "20 commands/s · - poses/s"
    assert facts.counts((), "nothing") == "nothing"
    assert facts.counts((Count(name="lost", total=2, rising=True),), "nothing") == "lost 2"


def test_a_daemon_that_vanished_while_it_drove_is_a_warning() -> None:
    for state in ("driving", "stopping"):
        words = facts.lost_sight(View(phase="silent", status=daemon.status(state)))
        assert f"It was {state}" in words
        assert "supply off" in words
    assert facts.lost_sight(View(phase="silent", status=daemon.status("standing"))) == ""
    assert facts.lost_sight(View(phase="waiting")) == ""
