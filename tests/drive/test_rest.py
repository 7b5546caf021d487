"""What becomes of wheels that stand: held, let go, or let go and held if they roll."""

from __future__ import annotations

import pytest

from yahboomd.core.drive.rest import AtRest, Rest

MS = 1_000_000
TICK_M = 0.001


def make(mode: AtRest = "auto") -> Rest:
    return Rest(mode, ("left", "right"), (TICK_M, TICK_M))


def stand(rest: Rest, from_ms: int, to_ms: int, ticks: tuple[int, int] = (0, 0)) -> None:
    for ms in range(from_ms, to_ms + 1, 10):
        assert rest.measure(ms * MS, ticks, stand=True) is None


def let_go(mode: AtRest = "auto") -> Rest:
    rest = make(mode)
    stand(rest, 0, 2000)
    rest.let_go()
    stand(rest, 2010, 2020)
    return rest


def test_wheels_are_let_go_once_they_stood_for_two_seconds() -> None:
    rest = make()
    stand(rest, 0, 1990)
    assert not rest.lets_go
    stand(rest, 2000, 2000)
    assert rest.lets_go


def test_held_wheels_that_hunt_by_two_millimetres_stand() -> None:
    rest = make()
    for ms in range(0, 2001, 10):
        rest.measure(ms * MS, (ms // 10 % 3, 0), stand=True)
    assert rest.lets_go


def test_a_wheel_that_creeps_is_not_let_go() -> None:
    rest = make()
    for ms in range(0, 10_000, 10):
        rest.measure(ms * MS, (0, -ms // 600), stand=True)
        assert not rest.lets_go


@pytest.mark.parametrize(("ticks", "motor"), [((6, 0), "left"), ((3, -6), "right")])
def test_a_wheel_that_rolls_by_more_than_5_mm_is_named_and_held(
    ticks: tuple[int, int], motor: str
) -> None:
    rest = let_go()
    assert rest.free
    assert rest.measure(2030 * MS, (5, -5), stand=True) is None
    fault = rest.measure(2040 * MS, ticks, stand=True)
    assert fault is not None
    assert (fault.kind, fault.motor, fault.action) == ("rolled", motor, "report")
    assert "6 mm" in fault.message
    assert not rest.free


def test_what_rolled_once_is_held_until_the_next_drive() -> None:
    rest = let_go()
    assert rest.measure(2030 * MS, (9, 9), stand=True) is not None
    stand(rest, 2040, 9000, (9, 9))
    assert not rest.lets_go
    rest.let_go()
    assert not rest.free
    rest.drive()
    stand(rest, 9010, 11_010, (9, 9))
    assert rest.lets_go


def test_wheels_that_are_let_go_in_motion_may_roll_out_for_a_third_of_a_second() -> None:
    rest = make()
    rest.measure(0, (0, 0), stand=False)
    rest.let_go(rolling_m_s=0.2)
    assert rest.measure(10 * MS, (100, 100), stand=False) is None
    assert rest.measure(400 * MS, (165, 165), stand=False) is None
    assert rest.measure(410 * MS, (166, 165), stand=False) is not None


def test_once_they_rolled_out_5_mm_are_too_much_again() -> None:
    rest = make()
    rest.let_go(rolling_m_s=0.2)
    rest.measure(10 * MS, (0, 0), stand=False)
    assert rest.measure(400 * MS, (30, 30), stand=True) is None
    assert rest.measure(500 * MS, (35, 30), stand=True) is None
    assert rest.measure(510 * MS, (36, 30), stand=True) is not None


@pytest.mark.parametrize("mode", ["hold", "release"])
def test_hold_and_release_are_what_they_say(mode: AtRest) -> None:
    rest = let_go(mode)
    assert rest.lets_go == (mode == "release")
    assert not rest.free
    assert rest.measure(2100 * MS, (99, 0), stand=True) is None
