from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.model import Twist2d
from yahboomd.tools.screens.keyboard import ESCAPE, UNKNOWN
from yahboomd.tools.screens.teleop import FIRST_NS, MS, SHORTEST_NS, Teleop, direction, wish

START_NS = 10**12
FORWARD = Twist2d(vx=0.3)


@pytest.fixture
def teleop() -> Teleop:
    return Teleop(linear_m_s=0.3, angular_rad_s=1.0)


def hold(teleop: Teleop, key: str, presses: int, *, gap_ns: int = 33 * MS) -> int:
    """A key held: a press, the pause of a terminal, repeats. When the last came."""
    now_ns = START_NS
    teleop.press(key, now_ns)
    now_ns += 500 * MS
    for _ in range(presses):
        teleop.press(key, now_ns)
        now_ns += gap_ns
    return now_ns - gap_ns


def command(teleop: Teleop, now_ns: int) -> Twist2d | None:
    motion = teleop.motion(now_ns)
    if motion is None:
        return None
    twist, until_ns = motion
    assert until_ns > now_ns
    return twist


@pytest.mark.parametrize(
    ("key", "twist"),
    [
        ("up", FORWARD),
        ("s", Twist2d(vx=-0.3)),
        ("a", Twist2d(wz=1.0)),
        ("o", Twist2d(vx=0.3, wz=-1.0)),
        ("J", Twist2d(vy=0.3)),
    ],
)
def test_a_key_commands_its_velocity(teleop: Teleop, key: str, twist: Twist2d) -> None:
    assert teleop.press(key, START_NS) == "move"
    assert command(teleop, START_NS) == twist


def test_a_key_that_is_held_drives_without_a_gap(teleop: Teleop) -> None:
    now_ns = START_NS
    teleop.press("w", now_ns)
    presses = {now_ns + 660 * MS + repeat * 40 * MS for repeat in range(50)}
    while now_ns < max(presses):
        now_ns += 5 * MS
        if now_ns in presses:
            teleop.press("w", now_ns)
        assert command(teleop, now_ns) == FORWARD


def test_one_press_drives_until_repeats_must_have_come(teleop: Teleop) -> None:
    teleop.press("w", START_NS)
    assert command(teleop, START_NS + FIRST_NS - 1) == FORWARD
    assert command(teleop, START_NS + FIRST_NS) is None


def test_a_held_key_that_is_let_go_stops_sooner_than_the_first_press_would(
    teleop: Teleop,
) -> None:
    last_ns = hold(teleop, "w", 10)
    assert command(teleop, last_ns + SHORTEST_NS - 1) == FORWARD
    assert command(teleop, last_ns + SHORTEST_NS) is None
    assert SHORTEST_NS < FIRST_NS / 2


@pytest.mark.parametrize("key", [" ", "x", "escape", "e", "r", "q"])
def test_what_is_no_way_to_drive_stops_at_once(teleop: Teleop, key: str) -> None:
    last_ns = hold(teleop, "w", 5)
    teleop.press(key, last_ns + 1)
    assert command(teleop, last_ns + 1) is None


def test_speeds_change_by_a_tenth_and_do_not_move_or_stop(teleop: Teleop) -> None:
    assert teleop.press("+", START_NS) == "faster"
    assert command(teleop, START_NS) is None
    teleop.press("w", START_NS)
    assert command(teleop, START_NS) == Twist2d(vx=pytest.approx(0.33))
    teleop.press("-", START_NS)
    teleop.press("-", START_NS)
    assert command(teleop, START_NS) == Twist2d(vx=pytest.approx(0.3 / 1.1))
    assert teleop.angular_rad_s == pytest.approx(1.0 / 1.1)


@given(
    st.lists(st.tuples(st.sampled_from(["w", "a", "u", " ", "+", "e", "x"]), st.integers(0, 10**9)))
)
def test_silence_always_ends_the_motion(presses: list[tuple[str, int]]) -> None:
    teleop = Teleop(linear_m_s=0.3, angular_rad_s=1.0)
    now_ns = START_NS
    for key, gap_ns in presses:
        now_ns += gap_ns
        teleop.press(key, now_ns)
    assert command(teleop, now_ns + 3 * 300 * MS) is None


@pytest.mark.parametrize(
    ("key", "signs"),
    [
        ("w", (1, 0, 0)),
        ("W", (1, 0, 0)),
        ("up", (1, 0, 0)),
        ("i", (1, 0, 0)),
        ("s", (-1, 0, 0)),
        (",", (-1, 0, 0)),
        ("a", (0, 0, 1)),
        ("left", (0, 0, 1)),
        ("d", (0, 0, -1)),
        ("l", (0, 0, -1)),
        ("u", (1, 0, 1)),
        ("o", (1, 0, -1)),
        ("J", (0, 1, 0)),
        ("L", (0, -1, 0)),
        ("k", None),
        (" ", None),
    ],
)
def test_keys_that_move(key: str, signs: tuple[int, int, int] | None) -> None:
    assert direction(key) == signs


@pytest.mark.parametrize("key", [" ", "k", "x", "\r", ESCAPE, UNKNOWN, "\x1a", "é", "1"])
def test_every_other_key_stops(key: str) -> None:
    assert wish(key) == "stop"
