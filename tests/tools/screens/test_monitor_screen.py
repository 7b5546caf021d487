from __future__ import annotations

import daemon_samples as daemon
import pytest
from drawn_screen import lines as lines_of
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import RenderableType

from yahboomd.core.bus import keys
from yahboomd.core.messages.codecs import encode
from yahboomd.tools.screens import monitor_screen, sentences
from yahboomd.tools.screens.dashboard import Dashboard, View

S = 1_000_000_000


def screen(view: View, width: int = 80, height: int = 24) -> RenderableType:
    return monitor_screen.screen(view, where="bot1", width=width, height=height)


def drawn(view: View, width: int = 80, height: int = 24) -> list[str]:
    return lines_of(screen(view, width, height), width, height)


@pytest.mark.parametrize("encoding", ["json", "msgpack"])
@pytest.mark.parametrize("version", ["first", "newer"])
def test_a_daemon_of_another_version_is_shown(version: str, encoding: str) -> None:
    dashboard = Dashboard()
    for key, payload in daemon.of_version(version, encoding).items():
        dashboard.accept(key, payload, 0)
    view = dashboard.view(0)
    assert view.unreadable == 0
    text = "\n".join(drawn(view))
    state = "docked" if version == "newer" else "driving"
    assert f"● {state.upper()}" in text
    assert "1.500 m" in text
    assert f"{state} for" in sentences.status_text(view)
    # In a state that is not known it may move.
    assert f"It was {state}" in sentences.lost_sight(view)


def test_a_small_terminal_shows_all_there_is() -> None:
    text = "\n".join(drawn(daemon.driving(0).view(0)))
    for words in (
        "● DRIVING for 2.0 s",
        "cmd_vel has control for 3.0 s",
        "cmd_vel drives.",
        "pose in odom",
        "1.500 m    ± 0.020",
        "28.6°",
        "turning   -0.250 rad/s",
        "left        1000   0.290 of  0.300",
        "streamed 1.7.3 on /dev/ttyUSB0",
        "battery 7.4 V",
        "nothing lost, refused or missed",
        "no command refused",
        "The board reset itself.",
    ):
        assert words in text


def test_a_silent_daemon_is_named_and_its_numbers_are_marked_old() -> None:
    text = "\n".join(drawn(daemon.driving(0).view(5 * S)))
    assert "NO STATUS  from the daemon for 5.0 s" in text
    assert "it was driving" in text
    assert "run `yahboomd stop`" in text
    assert "pose in odom (old)" in text
    assert "DRIVING" not in text


@given(st.text(max_size=200), st.text(max_size=30), st.text(max_size=200))
def test_what_comes_over_the_bus_never_breaks_the_screen(why: str, name: str, said: str) -> None:
    dashboard = Dashboard()
    sample = daemon.status(why=why, driver=name)
    dashboard.accept(keys.STATUS, encode(sample, "json"), 0)
    dashboard.accept(keys.WHEELS, encode(daemon.wheels(names=(name, name)), "json"), 0)
    dashboard.accept(keys.EVENTS, encode(daemon.event(said), "json"), 0)
    lines = drawn(dashboard.view(0))
    assert len(lines) == 24
    assert all(line.isprintable() for line in lines)
    assert {cell_len(line) for line in lines} == {80}


@pytest.mark.parametrize(
    ("speed", "command", "picture"),
    [
        (0.0, 0.0, "·····┼·····"),
        (1.0, 0.0, "·····┼█████"),
        (-0.4, 0.0, "···██┼·····"),
        (0.5, 0.0, "·····┼██▌··"),
        (-0.5, 0.0, "··▐██┼·····"),
        (0.6, 1.0, "·····┼███·┃"),
        (0.0, -0.6, "··┃··┼·····"),
        (9.0, -9.0, "┃····┼█████"),
        # A command that is too small to be seen is shown all the same.
        (0.0, 0.001, "·····┼┃····"),
    ],
)
def test_bars_show_speed_and_command_around_zero(
    speed: float, command: float, picture: str
) -> None:
    assert monitor_screen.bar(speed, command, 5).plain == picture
