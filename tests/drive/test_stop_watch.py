from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.stop_watch import StopWatch

MS = 1_000_000
T0 = 7_000 * MS


@pytest.fixture
def watch() -> StopWatch:
    watch = StopWatch(("left", "right"))
    watch.begin(T0)
    return watch


def test_wheels_that_obey_are_proven_to_stand(watch: StopWatch) -> None:
    for n in range(1, 6):
        assert watch.measure(T0 + n * 20 * MS, (0.5 - 0.08 * n, 0.5 - 0.08 * n)) == "stopping"
    assert watch.measure(T0 + 120 * MS, (0.0, 0.029)) == "stopping"
    assert watch.measure(T0 + 140 * MS, (0.0, 0.0)) == "stopping"
    assert watch.measure(T0 + 160 * MS, (0.0, 0.0)) == "stopped"
    assert watch.check(T0 + 10_000 * MS) is None


def test_a_wheel_that_turns_on_is_named_and_cut_after_0_6_s(watch: StopWatch) -> None:
    for n in range(1, 30):
        watch.measure(T0 + n * 20 * MS, (0.0, -0.8))
        assert watch.check(T0 + n * 20 * MS) is None
    fault = watch.check(T0 + 600 * MS)
    assert fault is not None
    assert (fault.kind, fault.motor, fault.action) == ("stop_not_obeyed", "right", "cut")
    assert fault.measured_m_s == -0.8
    assert fault.message.startswith("right still turns at -0.80 m/s 0.6 s after the stop")
    assert watch.state == "overdue"
    assert watch.check(T0 + 620 * MS) is None


def test_a_wheel_that_turns_on_after_it_was_cut_is_reported_once_more(watch: StopWatch) -> None:
    faults = []
    for n in range(1, 300):
        watch.measure(T0 + n * 20 * MS, (0.0, -0.8))
        if fault := watch.check(T0 + n * 20 * MS):
            faults.append((n * 20, fault.motor, "switch their supply off" in fault.message))
    assert faults == [(600, "right", False), (1600, "right", True)]


def test_no_old_reading_shows_a_wheel_that_turns_on_after_it_was_cut(watch: StopWatch) -> None:
    faults = 0
    for n in range(1, 200):
        # The supply was switched off, and the board with it; or this process did not run.
        if not 34 <= n < 150:
            watch.measure(T0 + n * 20 * MS, (0.0, -0.8))
        faults += watch.check(T0 + n * 20 * MS) is not None
        assert faults == (0 if n < 30 else 1 if n < 150 else 2)


def test_a_wheel_that_rolls_out_after_it_was_cut_is_not_reported_again(watch: StopWatch) -> None:
    assert follow(watch, lambda s: 0.8 if s < 0.6 else 0.8 * 0.8 ** (s - 0.6)) == [600]


def test_a_wheel_that_gains_speed_again_after_it_was_cut_is_reported(watch: StopWatch) -> None:
    assert follow(watch, lambda s: 0.8 if s < 0.62 else 0.4 if s < 1.7 else 0.6) == [600, 2600]


def test_a_stop_that_no_reading_shows_is_overdue_and_accuses_no_wheel(watch: StopWatch) -> None:
    assert watch.check(T0 + 600 * MS) is None
    assert watch.state == "overdue"


@pytest.mark.parametrize(("last_ms", "accused"), [(299, False), (300, True)])
def test_readings_of_before_a_silence_accuse_no_wheel(
    watch: StopWatch, last_ms: int, accused: bool
) -> None:
    watch.measure(T0 + (last_ms - 20) * MS, (0.4, 0.4))
    watch.measure(T0 + last_ms * MS, (0.4, 0.4))
    assert (watch.check(T0 + 600 * MS) is not None) is accused
    assert watch.state == "overdue"


def test_a_wheel_that_turns_on_behind_a_silence_is_accused(watch: StopWatch) -> None:
    assert watch.check(T0 + 600 * MS) is None
    for ms in range(900, 1200, 20):
        watch.measure(T0 + ms * MS, (0.4, 0.0))
    fault = watch.check(T0 + 1200 * MS)
    assert fault is not None
    assert fault.motor == "left"


def test_a_single_slow_reading_is_no_standstill(watch: StopWatch) -> None:
    for n in range(1, 31):
        watch.measure(T0 + n * 20 * MS, (0.0, 0.0) if n % 2 else (0.2, -0.2))
    assert watch.state == "stopping"


def test_readings_from_before_the_stop_prove_nothing(watch: StopWatch) -> None:
    for n in range(20, 0, -1):
        watch.measure(T0 - n * 20 * MS, (0.0, 0.0))
    assert watch.state == "stopping"


def test_a_stop_commanded_again_keeps_its_deadline(watch: StopWatch) -> None:
    watch.measure(T0 + 300 * MS, (0.5, 0.5))
    watch.begin(T0 + 500 * MS)
    watch.measure(T0 + 500 * MS, (0.5, 0.5))
    assert watch.check(T0 + 600 * MS) is not None


def test_wheels_that_stand_just_before_the_deadline_are_given_the_proof(watch: StopWatch) -> None:
    watch.measure(T0 + 590 * MS, (0.0, 0.0))
    assert watch.check(T0 + 600 * MS) is None
    assert watch.measure(T0 + 630 * MS, (0.0, 0.0)) == "stopped"


@pytest.mark.parametrize(("still_ms", "waits"), [(541, True), (540, False)])
def test_the_proof_of_a_standstill_is_waited_for_no_longer_than_60_ms(
    watch: StopWatch, still_ms: int, waits: bool
) -> None:
    watch.measure(T0 + (still_ms - 20) * MS, (0.0, 0.4))
    watch.measure(T0 + still_ms * MS, (0.0, 0.0))
    watch.check(T0 + 600 * MS)
    assert (watch.state == "stopping") is waits


def test_a_wheel_that_one_of_two_readings_shows_standing_is_not_accused(watch: StopWatch) -> None:
    for ms, speed in ((580, 0.029), (600, 0.031)):
        watch.measure(T0 + ms * MS, (speed, speed))
    assert watch.check(T0 + 600 * MS) is None
    assert watch.state == "overdue"


def test_a_reading_of_the_moment_of_the_stop_counts(watch: StopWatch) -> None:
    watch.measure(T0 - 1, (0.0, 0.0))
    assert watch.measure(T0 + 30 * MS, (0.0, 0.0)) == "stopping"
    assert watch.measure(T0 + 59 * MS, (0.0, 0.0)) == "stopping"
    again = StopWatch(("left", "right"))
    again.begin(T0)
    again.measure(T0, (0.0, 0.0))
    assert again.measure(T0 + 30 * MS, (0.0, 0.0)) == "stopped"


def test_readings_that_cease_in_standstill_are_no_proof(watch: StopWatch) -> None:
    watch.measure(T0 + 300 * MS, (0.0, 0.0))
    assert watch.check(T0 + 600 * MS) is None
    assert watch.state == "overdue"


def follow(watch: StopWatch, speed_at: Callable[[float], float]) -> list[int]:
    """The moment, in ms after the stop, at which a wheel of two that turn alike was accused."""
    accused = []
    for ms in range(10, 3000, 10):
        watch.measure(T0 + ms * MS, (speed_at(ms / 1000),) * 2)
        if watch.check(T0 + ms * MS) is not None:
            accused.append(ms)
    return accused


@pytest.mark.parametrize("lag_s", [0.3, 0.5])
def test_a_wheel_that_slows_down_is_overdue_after_0_6_s_and_never_accused(
    watch: StopWatch, lag_s: float
) -> None:
    watch.measure(T0 + 590 * MS, (0.0, 0.5 * math.exp(-0.59 / lag_s)))
    assert watch.state == "stopping"
    assert follow(watch, lambda t: 0.5 * math.exp(-t / lag_s)) == []
    assert watch.state == "stopped"


@pytest.mark.parametrize("from_m_s", [0.0, -0.05, 0.05])
def test_a_wheel_that_was_stopped_in_a_reversal_swings_and_is_not_accused(
    watch: StopWatch, from_m_s: float
) -> None:
    # A motor with a lag of 0.3 s: it gains 0.07 m/s within 0.3 s, and loses it slowly.
    def swings(t: float) -> float:
        if t < 0.3:
            return from_m_s * (1.0 - t / 0.1) if t < 0.1 else 0.35 * (t - 0.1)
        return 0.07 * math.exp((0.3 - t) / 0.95)

    assert follow(watch, swings) == []
    assert watch.state == "stopped"


@pytest.mark.parametrize(("speed", "accused"), [(0.05, [600, 1600]), (0.029, [])])
def test_a_slow_wheel_that_keeps_its_speed_is_accused_at_once(
    watch: StopWatch, speed: float, accused: list[int]
) -> None:
    assert follow(watch, lambda _: speed) == accused


def test_one_slow_reading_of_a_wheel_that_turns_on_is_no_swing(watch: StopWatch) -> None:
    assert follow(watch, lambda t: 0.0 if 0.295 < t < 0.305 else 0.5) == [600, 1600]


def test_a_wheel_that_begins_to_turn_after_the_stop_is_accused_600_ms_after_the_cut(
    watch: StopWatch,
) -> None:
    assert follow(watch, lambda t: min(0.5, t)) == [1200, 2200]


def test_a_wheel_that_slowed_down_and_then_turns_on_is_accused_600_ms_after_the_cut(
    watch: StopWatch,
) -> None:
    assert follow(watch, lambda t: max(0.2, 0.5 - t)) == [1200, 2200]


def test_a_wheel_that_grows_faster_is_accused_at_once(watch: StopWatch) -> None:
    assert follow(watch, lambda t: 0.3 + t) == [600, 1600]


def test_on_a_noisy_line_a_wheel_is_accused_only_after_the_cut_had_as_long(
    watch: StopWatch,
) -> None:
    accused = []
    for ms in range(10, 3000, 10):
        watch.measure(T0 + ms * MS, (0.0, 0.4))
        if watch.check(T0 + ms * MS, noisy=True) is not None:
            accused.append(ms)
        assert (watch.state == "overdue") == (ms >= 600)
    assert accused == [1200, 2200]


def judged_on_a_noisy_line(watch: StopWatch, readings: dict[int, float]) -> list[int]:
    """The moment, in ms after the stop, of an accusation by the readings that arrived."""
    accused = []
    for ms in range(10, 3000, 10):
        if ms in readings:
            watch.measure(T0 + ms * MS, (0.0, readings[ms]))
        if watch.check(T0 + ms * MS, noisy=True) is not None:
            accused.append(ms)
    assert watch.state == "overdue"
    return accused


@pytest.mark.parametrize(
    "readings",
    [
        {},
        {300: 0.5, 1100: 0.02},
        {300: 0.5, 900: 0.6},
        {300: 0.5, 900: 0.6, 1100: -0.6},
        {300: 0.5, 900: 0.6, 1100: 0.01, 1120: 0.6},
    ],
    ids=["none", "one that stands", "one that turns", "contradicting", "garbled between"],
)
def test_on_a_noisy_line_too_few_readings_accuse_no_wheel(
    watch: StopWatch, readings: dict[int, float]
) -> None:
    assert judged_on_a_noisy_line(watch, readings) == []


def test_on_a_noisy_line_two_readings_that_agree_accuse_a_wheel(watch: StopWatch) -> None:
    assert judged_on_a_noisy_line(watch, {300: 0.6, 900: 0.6, 1100: 0.58}) == [1200]


def test_wheels_that_stand_at_last_are_stopped_however_late(watch: StopWatch) -> None:
    watch.measure(T0 + 570 * MS, (0.5, 0.5))
    watch.measure(T0 + 590 * MS, (0.5, 0.5))
    assert watch.check(T0 + 600 * MS) is not None
    watch.measure(T0 + 2000 * MS, (0.0, 0.0))
    assert watch.measure(T0 + 2040 * MS, (0.0, 0.0)) == "stopped"


def test_a_stop_that_could_not_be_watched_has_its_time_again(watch: StopWatch) -> None:
    watch.measure(T0 + 100 * MS, (0.4, 0.0))
    watch.restart(T0 + 2000 * MS)
    for ms in (2400, 2500):
        watch.measure(T0 + ms * MS, (0.4, 0.0))
    assert watch.check(T0 + 2599 * MS) is None
    fault = watch.check(T0 + 2600 * MS)
    assert fault is not None
    assert fault.kind == "stop_not_obeyed"


def test_a_stop_called_off_is_none(watch: StopWatch) -> None:
    watch.cancel()
    assert watch.check(T0 + 10_000 * MS) is None
    assert watch.state == "idle"


@given(st.lists(st.tuples(st.integers(0, 100 * MS), st.floats(-1.0, 1.0)), max_size=60))
def test_no_stop_stays_undecided_beyond_its_deadline(readings: list[tuple[int, float]]) -> None:
    watch = StopWatch(("left", "right"))
    watch.begin(T0)
    now_ns = T0
    for step_ns, speed in readings:
        now_ns += step_ns
        watch.measure(now_ns, (speed, 0.0))
        watch.check(now_ns)
        if now_ns - T0 >= 660 * MS:
            assert watch.state in {"stopped", "overdue"}
