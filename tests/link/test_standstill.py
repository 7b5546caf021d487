"""Standstill, from raw counters."""

from __future__ import annotations

from yahboomd.link.standstill import StandstillWatch

MS = 1_000_000


def test_nothing_is_said_before_a_whole_window_was_seen() -> None:
    watch = StandstillWatch(190.0)
    watch.see((0, 0, 0, 0), 0)
    watch.see((0, 0, 0, 0), 40 * MS)
    assert watch.speed is None
    assert not watch.standing


def test_equal_counts_across_the_window_are_standstill() -> None:
    watch = StandstillWatch(190.0)
    for ms in range(0, 100, 10):
        watch.see((5, 5, 5, 5), ms * MS)
    assert watch.standing


def test_one_turning_wheel_is_enough_to_deny_it() -> None:
    watch = StandstillWatch(190.0)
    for ms in range(0, 100, 10):
        watch.see((5, 5, -ms, 5), ms * MS)
    assert watch.speed is not None
    assert abs(watch.speed - 1000.0) < 1.0
    assert not watch.standing


def test_a_wrap_of_the_counter_is_no_motion() -> None:
    watch = StandstillWatch(190.0)
    for ms in range(0, 100, 10):
        ticks = 2**31 - 1 if ms < 50 else -(2**31)
        watch.see((ticks, 0, 0, 0), ms * MS)
    assert watch.standing


def test_forgetting_restarts_the_window() -> None:
    watch = StandstillWatch(190.0)
    for ms in range(0, 100, 10):
        watch.see((0, 0, 0, 0), ms * MS)
    watch.forget()
    assert not watch.standing
