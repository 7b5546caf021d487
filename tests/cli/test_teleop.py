from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.cli.teleop import FIRST_NS, MS, SHORTEST_NS, ZEROS_NS, Teleop
from yahboomd.model import STANDSTILL, Twist2d

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


def test_nothing_is_published_before_a_key_is_pressed(teleop: Teleop) -> None:
    assert teleop.command(START_NS) is None


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
    assert teleop.command(START_NS) == twist


def test_a_key_that_is_held_drives_without_a_gap(teleop: Teleop) -> None:
    now_ns = START_NS
    teleop.press("w", now_ns)
    presses = {now_ns + 660 * MS + repeat * 40 * MS for repeat in range(50)}
    while now_ns < max(presses):
        now_ns += 5 * MS
        if now_ns in presses:
            teleop.press("w", now_ns)
        assert teleop.command(now_ns) == FORWARD


def test_one_press_drives_until_repeats_must_have_come(teleop: Teleop) -> None:
    teleop.press("w", START_NS)
    assert teleop.command(START_NS + FIRST_NS - 1) == FORWARD
    assert teleop.command(START_NS + FIRST_NS) == STANDSTILL


def test_a_held_key_that_is_let_go_stops_sooner_than_the_first_press_would(
    teleop: Teleop,
) -> None:
    last_ns = hold(teleop, "w", 10)
    assert teleop.command(last_ns + SHORTEST_NS - 1) == FORWARD
    assert teleop.command(last_ns + SHORTEST_NS) == STANDSTILL
    assert SHORTEST_NS < FIRST_NS / 2


def test_slow_repeats_do_not_make_it_stutter(teleop: Teleop) -> None:
    last_ns = hold(teleop, "w", 10, gap_ns=200 * MS)
    assert teleop.command(last_ns + 399 * MS) == FORWARD


def test_zeros_follow_motion_and_then_nothing(teleop: Teleop) -> None:
    teleop.press("w", START_NS)
    ended_ns = START_NS + FIRST_NS
    assert teleop.command(ended_ns) == STANDSTILL
    assert teleop.command(ended_ns + ZEROS_NS - 1) == STANDSTILL
    assert teleop.command(ended_ns + ZEROS_NS) is None
    assert teleop.command(ended_ns + 10 * ZEROS_NS) is None


@pytest.mark.parametrize("key", [" ", "x", "escape", "e", "r", "q"])
def test_what_is_no_way_to_drive_stops_at_once(teleop: Teleop, key: str) -> None:
    last_ns = hold(teleop, "w", 5)
    teleop.press(key, last_ns + 1)
    assert teleop.command(last_ns + 1) == STANDSTILL


def test_another_direction_replaces_the_one_before(teleop: Teleop) -> None:
    last_ns = hold(teleop, "w", 5)
    teleop.press("a", last_ns + 1)
    assert teleop.command(last_ns + 1) == Twist2d(wz=1.0)
    # Its own repeats have to come first.
    assert teleop.command(last_ns + FIRST_NS) == Twist2d(wz=1.0)


def test_speeds_change_by_a_tenth_and_do_not_move_or_stop(teleop: Teleop) -> None:
    assert teleop.press("+", START_NS) == "faster"
    assert teleop.command(START_NS) is None
    teleop.press("w", START_NS)
    assert teleop.command(START_NS) == Twist2d(vx=pytest.approx(0.33))
    teleop.press("-", START_NS)
    teleop.press("-", START_NS)
    view = teleop.view(START_NS)
    assert view.twist == Twist2d(vx=pytest.approx(0.3 / 1.1))
    assert view.angular_rad_s == pytest.approx(1.0 / 1.1)


def test_speeds_stay_within_bounds(teleop: Teleop) -> None:
    for _ in range(200):
        teleop.press("+", START_NS)
    assert teleop.view(START_NS).linear_m_s == pytest.approx(3.0)
    for _ in range(400):
        teleop.press("-", START_NS)
    assert teleop.view(START_NS).linear_m_s == pytest.approx(0.015)


@given(
    st.lists(st.tuples(st.sampled_from(["w", "a", "u", " ", "+", "e", "x"]), st.integers(0, 10**9)))
)
def test_silence_always_ends_in_zeros_and_then_in_nothing(
    presses: list[tuple[str, int]],
) -> None:
    teleop = Teleop(linear_m_s=0.3, angular_rad_s=1.0)
    now_ns = START_NS
    for key, gap_ns in presses:
        now_ns += gap_ns
        teleop.press(key, now_ns)
    moving = teleop.command(now_ns) not in {None, STANDSTILL}
    now_ns += 3 * 300 * MS
    after = teleop.command(now_ns)
    assert after in {None, STANDSTILL}
    if moving:
        assert after == STANDSTILL
    assert teleop.command(now_ns + ZEROS_NS) is None
