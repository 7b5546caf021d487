from __future__ import annotations

import daemon_samples as daemon
import pytest
from drawn_screen import lines as lines_of
from drawn_screen import style_of
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import RenderableType

from yahboomd.core.bus import keys
from yahboomd.core.messages.codecs import encode
from yahboomd.tools.screens import monitor_screen, sentences
from yahboomd.tools.screens.dashboard import Count, Dashboard, View

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


@pytest.mark.parametrize(("width", "height"), [(80, 24), (81, 25), (108, 30), (200, 60), (40, 10)])
@pytest.mark.parametrize("motors", [1, 2, 4])
def test_a_screen_fills_its_terminal_exactly(width: int, height: int, motors: int) -> None:
    dashboard = daemon.driving(0)
    names = tuple(f"wheel_{index}" for index in range(motors))
    sample = daemon.wheels((0.1,) * motors, (0.2,) * motors, names)
    dashboard.accept(keys.WHEELS, encode(sample, "json"), 0)
    lines = drawn(dashboard.view(0), width, height)
    assert len(lines) == height
    assert {len(line) for line in lines} == {width}


def test_four_wheels_fit_into_a_small_terminal_with_an_event() -> None:
    dashboard = daemon.driving(0)
    names = ("front_left", "front_right", "rear_left", "rear_right")
    sample = daemon.wheels((0.1,) * 4, (0.2,) * 4, names)
    dashboard.accept(keys.WHEELS, encode(sample, "json"), 0)
    text = "\n".join(drawn(dashboard.view(0)))
    assert all(name in text for name in names)
    assert "The board reset itself." in text


def test_a_wide_terminal_shows_the_path() -> None:
    dashboard = daemon.driving(0)
    assert "path" not in "\n".join(drawn(dashboard.view(0), 107, 30))
    text = "\n".join(drawn(dashboard.view(0), 120, 30))
    assert "path, x is up" in text
    assert "a line is" in text


def test_a_long_reason_is_shown_over_several_lines() -> None:
    dashboard = daemon.driving(0)
    why = "The board is gone. " * 6 + "Plug it in."
    dashboard.accept(keys.STATUS, encode(daemon.status("waiting", why=why), "json"), 0)
    lines = drawn(dashboard.view(0))
    assert "Plug it in." in "\n".join(lines)
    assert len(lines) == 24


@pytest.mark.parametrize("height", [21, 22, 23, 24, 30])
def test_the_newest_event_is_shown_however_long_it_is(height: int) -> None:
    dashboard = daemon.driving(0)
    dashboard.accept(keys.EVENTS, encode(daemon.event("The wheel is blocked. " * 20), "json"), 0)
    assert "The wheel is blocked." in "\n".join(drawn(dashboard.view(0), 80, height))


def test_a_silent_daemon_is_named_and_its_numbers_are_marked_old() -> None:
    text = "\n".join(drawn(daemon.driving(0).view(5 * S)))
    assert "NO STATUS  from the daemon for 5.0 s" in text
    assert "it was driving" in text
    assert "run `yahboomd stop`" in text
    assert "pose in odom (old)" in text
    assert "DRIVING" not in text


@pytest.mark.parametrize(
    ("state", "colour"),
    [("driving", "green"), ("standing", "cyan"), ("estopped", "red"), ("fault", "red")],
)
def test_the_state_has_its_colour(state: str, colour: str) -> None:
    view = View(phase="live", status=daemon.status(state))
    assert colour in style_of(f"● {state.upper()}", screen(view))


def test_a_counter_that_rises_comes_first_and_in_red() -> None:
    counts = (
        Count(name="lost", total=7, rising=False),
        Count(name="missed polls", total=2, rising=True),
    )
    view = View(phase="live", status=daemon.status(), link=counts)
    assert "missed polls 2 · lost 7" in "\n".join(drawn(view))
    assert "red" in style_of("missed polls 2", screen(view))
    assert "red" not in style_of("lost 7", screen(view))


def test_while_it_waits_it_says_where_and_why() -> None:
    view = View(phase="waiting", unreadable=3)
    waiting = monitor_screen.waiting(view, where="tcp/[::1]:7448", why="No router answers.")
    text = lines_of(waiting)
    for words in (
        "waiting for a daemon at tcp/[::1]:7448",
        "No router answers.",
        "3 samples came that cannot be read",
        "q ends this",
    ):
        assert any(words in line for line in text)
    assert {len(line) for line in text} == {80}
    assert (text[0][0], text[-1][0]) == ("╭", "╰")
    assert not text[1].strip("│ ")


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


@given(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9), st.integers(1, 40))
def test_bars_keep_their_width(speed: float, command: float, half: int) -> None:
    assert monitor_screen.bar(speed, command, half).cell_len == 2 * half + 1
