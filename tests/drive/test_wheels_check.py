from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.faults import Fault
from yahboomd.core.drive.motor_watch import MotorWatch
from yahboomd.core.drive.wheels_check import WheelsCheck

MS = 1_000_000
S = 1000 * MS
METRES_PER_TICK = 2 * math.pi * 0.0335 / 1320


@pytest.mark.parametrize(("travel_ms", "owing"), [(50, False), (200, True)])
def test_a_motor_owes_what_was_commanded_since_it_last_counted(travel_ms: int, owing: bool) -> None:
    check = WheelsCheck(["left", "right"])
    check.command(0, [0.05, 0.05])
    for at_ms in range(0, travel_ms + 80, 10):
        if at_ms == travel_ms:
            check.command(at_ms * MS, [0.0, 0.0])
        check.measure(at_ms * MS, [0.05, 0.0], [3, 0])
    assert check.owing is owing
    # A sign of motion settles it; so does a new beginning.
    check.measure((travel_ms + 80) * MS, [0.0, 0.0], [0, 2])
    check.measure((travel_ms + 90) * MS, [0.0, 0.0], [0, 0])
    assert not check.owing


def drive(commanded: float, counted: dict[str, int]) -> list[Fault]:
    """Two seconds of one command to motors that count these ticks for each reading."""
    check = WheelsCheck(list(counted))
    ticks = list(counted.values())
    speeds = [count * METRES_PER_TICK / 0.02 for count in ticks]
    check.command(0, [commanded] * len(ticks))
    return [fault for n in range(100) for fault in check.measure(n * 20 * MS, speeds, ticks)]


def test_the_silent_wheel_is_named_and_the_others_are_not() -> None:
    found = drive(0.3, {"front": 38, "middle": 0, "rear": 38})
    assert [(fault.kind, fault.motor) for fault in found] == [("no_counts", "middle")]


def test_motors_that_are_all_silent_point_to_the_supply() -> None:
    found = drive(0.3, {"left": 0, "right": 0})
    assert [(fault.kind, fault.motor) for fault in found] == [("no_counts", None)]
    assert "supply" in found[0].message


def test_motors_that_are_all_silent_are_reported_once_whatever_their_speeds() -> None:
    check = WheelsCheck(["left", "right"])
    check.command(0, [0.3, 0.4])
    (found,) = [fault for n in range(50) for fault in check.measure(n * 20 * MS, [0, 0], [0, 0])]
    assert (found.motor, found.commanded_m_s) == (None, 0.4)


def started(commanded: float, starts_m: dict[str, float], steps: int = 200) -> dict[str, int]:
    """The commanded way (mm) at which each wheel was accused; those that start count from there."""
    check = WheelsCheck(list(starts_m), latency_s=0.0)
    check.command(0, [commanded] * len(starts_m))
    accused: dict[str, int] = {}
    for n in range(steps):
        way_m = commanded * n * 0.01
        turns = [way_m > start_m for start_m in starts_m.values()]
        ticks = [3 if turning else 0 for turning in turns]
        for fault in check.measure(n * 10 * MS, [commanded * turning for turning in turns], ticks):
            accused[fault.motor or "all"] = round(way_m * 1e3)
    return accused


@pytest.mark.parametrize("commanded", [0.06, 0.1])
def test_motors_stiffer_than_the_stored_dead_zone_may_all_be_slow_to_start(
    commanded: float,
) -> None:
    assert started(commanded, {"left": 0.049, "right": 0.058}) == {}
    # Long enough, and they are all without counts.
    assert set(started(commanded, {"left": 9.0, "right": 9.0})) == {"all"}
    assert 63 <= started(commanded, {"left": 9.0, "right": 9.0})["all"] <= 65


@pytest.mark.parametrize(("commanded", "accused_mm"), [(0.06, 45), (0.1, 30)])
def test_a_wheel_without_counts_has_no_longer_where_the_others_start_at_once(
    commanded: float, accused_mm: int
) -> None:
    found = started(commanded, {"left": 9.0, "right": 0.01})
    assert found == {"left": pytest.approx(accused_mm, abs=2)}


def test_stiff_motors_that_turn_round_may_take_twice_that_way() -> None:
    check = WheelsCheck(["left", "right"], latency_s=0.0)
    check.command(0, [-0.17, -0.17])
    for n in range(100):
        check.measure(n * 10 * MS, [-0.17, -0.17], [-10, -10])
    check.command(S, [0.0, 0.0])
    check.measure(1010 * MS, [0.0, 0.0], [0, 0])
    check.command(1010 * MS, [0.17, 0.17])
    silent_ms = next(
        n * 10 for n in range(1, 200) if check.measure((1010 + n * 10) * MS, [0.0] * 2, [0] * 2)
    )
    assert 126 <= 0.17 * silent_ms <= 131


def silent_way(first_m: float, *, through_zero: bool) -> int:
    """The commanded way (mm) at which a wheel without counts is accused, behind a straight.

    Args:
        first_m: The commanded way after which both wheels began to count at their first start.
        through_zero: Whether the wheels stand between the straight and a turn on the spot.
    """
    check = WheelsCheck(["left", "right"], latency_s=0.0)
    steps = itertools.count(1)

    def measure(ticks: int, right: int) -> bool:
        now_ns = next(steps) * 10 * MS
        return bool(check.measure(now_ns, [0.002 * ticks * 10, 0.002 * right * 10], [ticks, right]))

    check.command(0, [0.1, 0.1])
    for n in range(200):
        turning = 3 if 0.001 * n > first_m else 0
        assert not measure(turning, turning)
    if through_zero:
        check.command(2 * S, [0.0, 0.0])
        for _ in range(50):
            measure(0, 0)
    check.command((next(steps) - 1) * 10 * MS, [-0.1, 0.1])
    # The right wheel goes on where its loop still is; the left one never counts.
    return next(n for n in range(1, 300) if measure(0, 3))


@pytest.mark.parametrize("through_zero", [True, False])
def test_a_wheel_that_goes_on_as_it_rolled_does_not_show_whether_the_motors_are_stiff(
    through_zero: bool,
) -> None:
    assert silent_way(0.049, through_zero=through_zero) == pytest.approx(126, abs=3)
    assert silent_way(0.005, through_zero=through_zero) == pytest.approx(60, abs=3)


def test_a_wheel_that_counted_before_is_not_slow_to_start() -> None:
    check = WheelsCheck(["left", "right"], latency_s=0.0)
    check.command(0, [0.1, 0.1])
    for n in range(100):
        check.measure(n * 10 * MS, [0.1, 0.1], [6, 6])
    silent_ms = next(
        n * 10 for n in range(1, 100) if check.measure((990 + n * 10) * MS, [0.0] * 2, [0] * 2)
    )
    assert 300 <= silent_ms <= 340


def test_the_only_motor_there_is_keeps_its_name_when_it_is_silent() -> None:
    assert [fault.motor for fault in drive(0.3, {"left": 0})] == ["left"]


def test_after_a_gap_nothing_is_concluded_from_before_it() -> None:
    check = WheelsCheck(["left"])
    check.command(0, [0.0])
    assert check.measure(0, [0.0], [0]) == ()
    assert check.measure(S, [1.0], [0]) == ()
    # Rolling out from there is plausible; rolling on is not.
    kinds = [
        fault.kind for n in range(1, 50) for fault in check.measure(S + n * 20 * MS, [1.0], [100])
    ]
    assert kinds == ["runaway_fast"]


@pytest.mark.parametrize(("late_ns", "kinds"), [(0, ["no_counts"]), (1, [])])
def test_a_gap_is_longer_than_half_a_second(late_ns: int, kinds: list[str]) -> None:
    check = WheelsCheck(["left"])
    check.command(0, [0.3])
    for n in range(6):
        assert check.measure(n * 20 * MS, [0.0], [0]) == ()
    found = check.measure(600 * MS + late_ns, [0.0], [0])
    assert [fault.kind for fault in found] == kinds


def test_a_reading_that_is_no_later_is_no_news() -> None:
    check = WheelsCheck(["left"])
    check.command(0, [0.3])
    for _ in range(100):
        assert check.measure(S, [5.0], [500]) == ()


FLOATS = st.floats(-3.0, 3.0)
EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just("command"), st.integers(0, S), st.none() | FLOATS),
        st.tuples(st.just("measure"), st.integers(-S, S), FLOATS),
        st.tuples(st.just("reset"), st.just(0), st.just(0.0)),
    ),
    max_size=60,
)


@given(EVENTS)
def test_nothing_is_raised_whatever_the_wheels_do(
    events: list[tuple[str, int, float | None]],
) -> None:
    check = WheelsCheck(["left"])
    now_ns = 0
    for what, step_ns, value in events:
        now_ns += step_ns
        if what == "command":
            check.command(now_ns, None if value is None else [value])
        elif what == "reset":
            check.reset()
        else:
            for fault in check.measure(now_ns, [value or 0.0], [round((value or 0.0) * 10)]):
                assert fault.motor == "left"
                assert "{" not in fault.message


def test_readings_of_before_the_wheels_were_commanded_are_no_witnesses() -> None:
    check = WheelsCheck(["left"], metres_per_tick=[METRES_PER_TICK])
    check.command(0, None)
    coasting = round(2.0 * 0.02 / METRES_PER_TICK)
    for n in range(20):
        assert check.measure(n * 20 * MS, [0.0], [coasting]) == ()
    check.command(390 * MS, [0.1])
    cut = [n for n in range(20, 30) if check.measure(n * 20 * MS, [2.0], [coasting])]
    # Five of those that follow.
    assert cut == [24]


def test_readings_of_one_moment_prove_no_speed() -> None:
    check = WheelsCheck(["left"], metres_per_tick=[METRES_PER_TICK])
    check.command(0, [0.1])
    for n in range(10):
        found = check.measure(S + n * 20 * MS, [5.0], [500], received_ns=S, earliest_ns=S)
        assert found == ()


def test_a_speed_is_proven_by_the_counts_of_40_ms() -> None:
    check = WheelsCheck(["left"], metres_per_tick=[METRES_PER_TICK])
    check.command(0, [0.2])
    speeds = [0.2] * 30 + [0.2 + 0.1 * n for n in range(1, 20)]
    for n, speed in enumerate(speeds):
        ticks = round(speed * 0.02 / METRES_PER_TICK)
        found = check.measure(n * 20 * MS, [speed], [ticks], earliest_ns=n * 20 * MS)
        if found:
            assert found[0].measured_m_s == pytest.approx(speed - 0.05, abs=0.01)
            return
    pytest.fail("nothing was found")


@pytest.mark.parametrize(("late_ms", "cut"), [(0, True), (100, False)])
def test_a_wheel_is_cut_only_for_a_speed_that_is_proven(late_ms: int, cut: bool) -> None:
    check = WheelsCheck(["left"], metres_per_tick=[METRES_PER_TICK])
    check.command(0, [0.3])
    ticks = round(0.02 / METRES_PER_TICK)
    found = [
        fault.kind
        for at_ms in range(0, 1000, 20)
        for fault in check.measure(
            at_ms * MS,
            [1.0],
            [ticks if at_ms >= 800 else 0],
            received_ns=at_ms * MS,
            # Up to 120 ms may have passed since the reading before.
            earliest_ns=(at_ms - late_ms) * MS,
        )
        if fault.kind != "no_counts"
    ]
    assert found == (["runaway_fast"] if cut else [])


@given(st.data())
def test_a_check_that_rests_finds_what_one_that_never_rests_does(data: st.DataObject) -> None:
    """The motors stand for long, may flicker by a count, and then do something."""
    resting, awake = (
        WheelsCheck(["left", "right"], metres_per_tick=[METRES_PER_TICK] * 2) for _ in range(2)
    )
    found: list[list[object]] = [[], []]
    counts = data.draw(st.lists(st.sampled_from([0, 0, 0, 0, 0, 1, -1]), max_size=30))
    counts += [0] * 60 + data.draw(st.lists(st.integers(-40, 40), min_size=1, max_size=40))
    commands = data.draw(st.dictionaries(st.integers(0, 120), st.sampled_from([None, 0.0, 0.2])))
    with pytest.MonkeyPatch.context() as patch:
        for n, count in enumerate(counts):
            for check, kept, rests in zip((resting, awake), found, (20, 10**9), strict=True):
                patch.setattr("yahboomd.core.drive.wheels_check.RESTING", rests)
                if n == 0 or n in commands:
                    speed = commands.get(n, 0.0)
                    check.command(n * 20 * MS, None if speed is None else [speed, speed])
                speed_m_s = count * METRES_PER_TICK / 0.02
                kept.extend(check.measure(n * 20 * MS, [speed_m_s, 0.0], [count, 0]))
    assert found[0] == found[1]


def test_a_check_of_wheels_that_stand_rests(monkeypatch: pytest.MonkeyPatch) -> None:
    check = WheelsCheck(["left", "right"], metres_per_tick=[METRES_PER_TICK] * 2)
    check.command(0, [0.0, 0.0])
    for n in range(40):
        check.measure(n * 20 * MS, [0.0, 0.0], [0, 0])
    monkeypatch.setattr(MotorWatch, "measure", None)
    assert check.measure(800 * MS, [0.0, 0.0], [0, 0]) == ()
    # The same command again is none; another one is.
    check.command(810 * MS, [0.0, 0.0])
    assert check.measure(820 * MS, [0.0, 0.0], [0, 0]) == ()
    check.command(830 * MS, [0.1, 0.1])
    with pytest.raises(TypeError):
        check.measure(840 * MS, [0.0, 0.0], [0, 0])
