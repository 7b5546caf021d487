from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs
from sticking_base import AS_SOLD, TUNED, StickingBase, believing

from yahboomd.core.drive.faults import Fault
from yahboomd.core.drive.follow_check import FollowCheck
from yahboomd.core.drive.loop_law import loop_law
from yahboomd.core.drive.wheel_follower import WheelFollower

MS = 1_000_000
S = 1000 * MS
METRES_PER_TICK = 2 * math.pi * 0.0335 / 1320


@pytest.mark.parametrize(("travel_ms", "owing"), [(50, False), (200, True)])
def test_a_motor_owes_what_was_commanded_since_it_last_counted(travel_ms: int, owing: bool) -> None:
    check = believing(["left", "right"])
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
    check = believing(list(counted))
    ticks = list(counted.values())
    speeds = [count * METRES_PER_TICK / 0.02 for count in ticks]
    check.command(0, [commanded] * len(ticks))
    return [fault for n in range(100) for fault in check.measure(n * 20 * MS, speeds, ticks)]


def test_the_silent_wheel_is_named_and_the_others_are_not() -> None:
    found = drive(0.3, {"front": 38, "middle": 0, "rear": 38})
    assert [(fault.kind, fault.motor) for fault in found] == [("not_started", "middle")]


def test_motors_that_all_stop_counting_in_motion_point_to_the_supply_once() -> None:
    check = believing(["left", "right"], latency_s=0.0)
    check.command(0, [0.3, 0.4])
    for n in range(20):
        assert not check.measure(n * 20 * MS, [0.3, 0.4], [38, 50])
    (found,) = [
        fault for n in range(20, 70) for fault in check.measure(n * 20 * MS, [0, 0], [0, 0])
    ]
    assert (found.kind, found.motor) == ("no_counts", None)
    assert "supply" in found.message


def test_the_only_motor_there_is_keeps_its_name_when_it_is_silent() -> None:
    assert [fault.motor for fault in drive(0.3, {"left": 0})] == ["left"]


def test_after_a_gap_nothing_is_concluded_from_before_it() -> None:
    check = believing(["left"])
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
    check = believing(["left"])
    check.command(0, [0.3])
    for n in range(6):
        assert check.measure(n * 20 * MS, [0.3], [38]) == ()
    found = check.measure(600 * MS + late_ns, [0.0], [0])
    assert [fault.kind for fault in found] == kinds


def test_a_reading_that_is_no_later_is_no_news() -> None:
    check = believing(["left"])
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
    check = believing(["left"])
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
    check = FollowCheck(["left"], [METRES_PER_TICK])
    check.command(0, None)
    coasting = round(2.0 * 0.02 / METRES_PER_TICK)
    for n in range(20):
        assert check.measure(n * 20 * MS, [0.0], [coasting]) == ()
    check.command(390 * MS, [0.1])
    cut = [n for n in range(20, 30) if check.measure(n * 20 * MS, [2.0], [coasting])]
    # Five of those that follow.
    assert cut == [24]


def test_readings_of_one_moment_prove_no_speed() -> None:
    check = FollowCheck(["left"], [METRES_PER_TICK])
    check.command(0, [0.1])
    for n in range(10):
        found = check.measure(S + n * 20 * MS, [5.0], [500], received_ns=S, earliest_ns=S)
        assert found == ()


def test_a_speed_is_proven_by_the_counts_of_40_ms() -> None:
    check = FollowCheck(["left"], [METRES_PER_TICK])
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
    check = FollowCheck(["left"], [METRES_PER_TICK])
    check.command(0, [0.3])
    ticks = round(0.02 / METRES_PER_TICK)
    found = [
        fault.kind
        for at_ms in range(0, 1000, 20)
        for fault in check.measure(
            at_ms * MS,
            [1.0],
            [ticks if at_ms >= 800 else 4],
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
    resting, awake = (FollowCheck(["left", "right"], [METRES_PER_TICK] * 2) for _ in range(2))
    found: list[list[object]] = [[], []]
    counts = data.draw(st.lists(st.sampled_from([0, 0, 0, 0, 0, 1, -1]), max_size=30))
    counts += [0] * 60 + data.draw(st.lists(st.integers(-40, 40), min_size=1, max_size=40))
    commands = data.draw(st.dictionaries(st.integers(0, 120), st.sampled_from([None, 0.0, 0.2])))
    with pytest.MonkeyPatch.context() as patch:
        for n, count in enumerate(counts):
            for check, kept, rests in zip((resting, awake), found, (20, 10**9), strict=True):
                patch.setattr("yahboomd.core.drive.follow_check.RESTING", rests)
                if n == 0 or n in commands:
                    speed = commands.get(n, 0.0)
                    check.command(n * 20 * MS, None if speed is None else [speed, speed])
                speed_m_s = count * METRES_PER_TICK / 0.02
                kept.extend(check.measure(n * 20 * MS, [speed_m_s, 0.0], [count, 0]))
    assert found[0] == found[1]


def test_a_check_of_wheels_that_stand_rests(monkeypatch: pytest.MonkeyPatch) -> None:
    check = FollowCheck(["left", "right"], [METRES_PER_TICK] * 2)
    check.command(0, [0.0, 0.0])
    for n in range(40):
        check.measure(n * 20 * MS, [0.0, 0.0], [0, 0])
    monkeypatch.setattr(WheelFollower, "measure", None)
    assert check.measure(800 * MS, [0.0, 0.0], [0, 0]) == ()
    # The same command again is none; another one is.
    check.command(810 * MS, [0.0, 0.0])
    assert check.measure(820 * MS, [0.0, 0.0], [0, 0]) == ()
    check.command(830 * MS, [0.1, 0.1])
    with pytest.raises(TypeError):
        check.measure(840 * MS, [0.0, 0.0], [0, 0])


# Floors that hold wheels.

X3 = (1.0, 1.024, 0.929, 0.952)
"""The friction of each wheel of a real X3, as a multiple of the first one's."""

LEVELS = (0.34, 0.37, 0.40, 0.42, 0.44, 0.47, 0.50)
MOTIONS = {
    "yaw 0.12": (-0.0197, -0.0197, 0.0197, 0.0197),
    "yaw 0.30": (-0.049, -0.049, 0.049, 0.049),
    "yaw 0.50": (-0.082, -0.082, 0.082, 0.082),
    "0.12 m/s": (0.12,) * 4,
    "0.03 m/s": (0.03,) * 4,
}


@pytest.mark.parametrize("period_ms", [20, 40])
@pytest.mark.parametrize("motion", MOTIONS)
def test_a_healthy_car_on_a_floor_that_holds_it_is_never_at_fault(
    motion: str, period_ms: int
) -> None:
    """Each level is held for 8 s: it drives, or is let go for one try; none is a fault."""
    gave_up = 0
    for level in LEVELS:
        base = StickingBase([level * share for share in X3], period_ms=period_ms)
        found = base.drive(MOTIONS[motion], 8.0)
        assert {fault.kind for fault in found} <= {"not_started"}
        gave_up += bool(found)
        assert bool(found) == (min(map(abs, base.travels_m)) < 0.1)
    # As the real one, which turned at 0.50 rad/s, and drove at 0.12 m/s.
    assert gave_up <= {"yaw 0.12": 6, "0.03 m/s": 3, "yaw 0.30": 1}.get(motion, 0)


def test_wheels_that_turn_give_no_less_time_to_one_that_sticks() -> None:
    base = StickingBase([0.40, 0.44, 0.38, 0.41], stick=1.3, supply=1.0)
    assert base.drive(0.1, 4.0) == []
    assert min(base.travels_m) > 0.3


def test_a_wheel_that_does_not_begin_to_turn_is_named_with_its_setpoint_and_what_helps() -> None:
    base = StickingBase([0.40, 0.70, 0.40, 0.40])
    base.check.volts = 10.4
    (found,) = base.drive(0.05, 8.0)
    assert (found.kind, found.action, found.motor) == ("not_started", "let_go", "rear_left")
    assert found.message == (
        "rear_left does not begin to turn at 0.05 m/s: drive faster, or charge the battery "
        "(10.4 V), or store its dead zone with `yahboomd tune`. The next command drives again."
    )
    # Such a board has no dead zone to store, and this one no voltage.
    base.check.law, base.check.volts = loop_law({"pid": AS_SOLD}), None
    (found,) = base.drive(0.05, 8.0)
    assert "drive faster, or charge the battery. The next" in found.message


def test_several_that_do_not_begin_are_named_together_and_all_are_the_wheels() -> None:
    (found,) = StickingBase([0.7] * 4).drive(0.05, 30.0)
    assert found.motor is None
    assert found.message.startswith("The wheels do not begin to turn at 0.05 m/s: drive faster")
    (found,) = StickingBase([0.7, 0.7, 0.3, 0.3]).drive(0.05, 30.0)
    assert found.message.startswith("front_left and rear_left do not begin to turn at 0.05 m/s")


@pytest.mark.parametrize("gains", [AS_SOLD, TUNED])
@pytest.mark.parametrize("stick", [1.0, 1.3])
@pytest.mark.parametrize("friction", [0.44, 0.54])
@pytest.mark.parametrize("speed", [0.02, 0.05, 0.1, 0.3, 0.6])
def test_a_dead_encoder_from_a_standstill_turns_a_wheel_072_m_in_its_three_tries(
    speed: float, friction: float, stick: float, gains: tuple[float, float, float]
) -> None:
    base = StickingBase([friction] * 2, stick=stick, supply=1.0, gains=gains)
    base.break_wheel(0, encoder_dead=True)
    kinds = [fault.kind for _ in range(3) for fault in base.drive(speed, 30.0)]
    assert kinds == ["not_started", "not_started", "no_counts"]
    assert base.travels_m[0] < 0.72
    assert base.travels_m[1] < 0.32


def test_encoders_that_are_all_dead_are_a_fault_of_all_the_third_time() -> None:
    base = StickingBase([0.44] * 2, stick=1.0, supply=1.0)
    base.check.volts = 8.2
    for index in range(2):
        base.break_wheel(index, encoder_dead=True)
    found = [fault for _ in range(3) for fault in base.drive(0.1, 30.0)]
    assert [(fault.kind, fault.motor) for fault in found] == [
        ("not_started", None),
        ("not_started", None),
        ("no_counts", None),
    ]
    assert "check the motor supply" in found[-1].message
    assert "A low battery (8.2 V) on a floor with" in found[-1].message
    assert max(base.travels_m) < 1.1


def test_what_a_wheel_needs_to_start_is_learned_from_rest_alone() -> None:
    base = StickingBase([0.42, 0.43], stick=1.3)
    assert base.drive(0.3, 3.0) == []
    needs = [wheel.starts_at for wheel in base.check._wheels]
    # (0.42 * 1.3 / 0.875 * 3600 - 1600) / 2000, and a little for what it takes to count.
    assert needs == [pytest.approx(0.35, abs=0.08)] * 2
    assert base.drive(-0.3, 3.0) == []
    assert base.travels_m[0] < 0.9
    assert [wheel.starts_at for wheel in base.check._wheels] == needs


def test_a_wheel_that_counts_once_has_three_tries_again() -> None:
    base = StickingBase([0.40, 0.70])
    tries = [fault.kind for _ in range(2) for fault in base.drive(0.05, 8.0)]
    base.break_wheel(1, turning_m_s=0.1)
    base.drive(0.1, 1.0)
    base.break_wheel(1)
    base.let_go()
    tries += [fault.kind for _ in range(2) for fault in base.drive(0.05, 8.0)]
    assert tries == ["not_started"] * 4
    assert [fault.kind for fault in base.drive(0.05, 8.0)] == ["no_counts"]


@pytest.mark.cases(1)
@pytest.mark.parametrize("speed", [0.02, 0.04, 0.06])
def test_slow_wheels_that_stick_and_slip_are_never_at_fault(speed: float) -> None:
    base = StickingBase([0.40, 0.42], stick=1.4, supply=1.0)
    for _ in range(60):
        assert {fault.kind for fault in base.drive(speed, 10.0)} <= {"not_started"}


@pytest.mark.parametrize("gains", [AS_SOLD, TUNED])
@pytest.mark.parametrize("fault", ["encoder_dead", "stalled", "unplugged"])
@pytest.mark.parametrize(("speed", "after_s"), [(0.1, 0.3), (0.3, 0.15), (0.6, 0.15)])
def test_a_wheel_that_rolled_on_a_sticky_floor_is_at_fault_within_150_ms_or_30_mm(
    speed: float, after_s: float, fault: str, gains: tuple[float, float, float]
) -> None:
    base = StickingBase([0.42, 0.43], gains=gains)
    assert base.drive(speed, 3.0) == []
    base.break_wheel(1, **{fault: True})
    at_ms = base.now_ms
    (found,) = base.drive(speed, 2.0)
    assert (found.kind, found.motor) == ("no_counts", "rear_left")
    # The base rolls out for 0.6 s.
    assert base.now_ms - 600 - at_ms <= 1e3 * after_s + 40


def test_a_wheel_that_is_slowed_down_to_a_stop_has_the_time_of_one_that_stands() -> None:
    base = StickingBase([0.42, 0.42])
    assert base.drive(0.2, 3.0) == []
    # Something soft holds it.
    for friction in (0.7, 0.9, 0.99):
        base.wheels[0].law = structs.replace(base.wheels[0].law, dead_zone=round(3600 * friction))
        found = base.drive(0.2, 0.2)
    at_ms = base.now_ms
    found += base.drive(0.2, 4.0)
    assert [fault.kind for fault in found] == ["not_started"]
    assert base.now_ms - at_ms - 600 > 300


@pytest.mark.parametrize("speed", [0.05, 0.2])
def test_crossed_encoders_are_named_with_both_wheels(speed: float) -> None:
    base = StickingBase([0.40] * 4, stick=1.0, supply=1.0, order=(2, 1, 0, 3))
    assert base.drive(0.2, 1.0) == []
    found = base.drive([-speed, -speed, speed, speed], 4.0)[0]
    assert (found.kind, found.action) == ("runaway_against", "cut")
    assert {"front_left", "front_right"} <= {*found.message.replace(" and", "").split()}
    assert "seem to be crossed" in found.message
    assert "rear" not in found.message


def test_a_single_reversed_encoder_is_not_called_crossed() -> None:
    base = StickingBase([0.40] * 2, stick=1.0, supply=1.0)
    base.break_wheel(0, encoder_reversed=True)
    found = base.drive([-0.2, 0.2], 4.0)[0]
    assert found.kind == "runaway_against"
    assert "phases are not swapped" in found.message


def test_the_encoder_of_a_wheel_commanded_to_stand_is_not_called_crossed() -> None:
    check = believing(["left", "right"])
    check.command(0, [-0.2, 0.0])
    found = [f for n in range(20) for f in check.measure(n * 20 * MS, [0.3, -0.3], [28, -28])]
    assert {fault.kind for fault in found} == {"runaway_against", "runaway_fast"}
    assert not any("crossed" in fault.message for fault in found)


# A wheel or the line.

RUNAWAY = Fault(kind="runaway_fast", motor="left", message="It runs.", action="cut")
SILENT = Fault(kind="no_counts", motor="left", message="It does not.", action="policy")
ALL_SILENT = structs.replace(SILENT, motor=None)


def test_on_a_clean_line_a_wheel_is_blamed_at_once() -> None:
    assert believing(["left"]).blame(0, RUNAWAY, damages=0)


def test_what_lost_commands_do_not_explain_is_blamed_at_once() -> None:
    assert believing(["left"]).blame(0, structs.replace(SILENT, certain=True), damages=16)


@pytest.mark.parametrize(("fault", "often"), [(RUNAWAY, 5), (SILENT, 8), (ALL_SILENT, 16)])
def test_on_a_noisy_line_a_wheel_is_blamed_for_what_happens_often_in_a_row(
    fault: Fault, often: int
) -> None:
    check = believing(["left"])
    blamed = [check.blame(n * 600 * MS, fault, damages=16) for n in range(2 * often)]
    assert blamed == [*[False] * (often - 1), True] * 2


@pytest.mark.parametrize(("damages", "often"), [(0, 1), (1, 2), (3, 4), (4, 5), (9, 5)])
def test_each_damage_of_the_line_excuses_one_trouble_up_to_four(damages: int, often: int) -> None:
    check = believing(["left"])
    blamed = [check.blame(n * 600 * MS, RUNAWAY, damages=damages) for n in range(often)]
    assert blamed == [*[False] * (often - 1), True]


@pytest.mark.parametrize(("damages", "blamed"), [(0, [True, True]), (1, [False, False])])
def test_troubles_of_two_wheels_at_the_same_moment_are_one(
    damages: int, blamed: list[bool]
) -> None:
    check = believing(["left"])
    other = structs.replace(RUNAWAY, motor="right")
    assert [check.blame(0, each, damages=damages) for each in (RUNAWAY, other)] == blamed
    assert check.blame(600 * MS, RUNAWAY, damages=damages)


@pytest.mark.parametrize(
    ("driven_ms", "speed", "blamed"), [(1000, 0.08, False), (500, 0.08, True), (1000, 0.07, True)]
)
def test_wheels_that_follow_for_a_second_begin_from_nothing(
    driven_ms: int, speed: float, blamed: bool
) -> None:
    # The base turns about its right wheel.
    check, now_ms, found = believing(["left", "right"], latency_s=0.0), 0, []
    check.command(0, [speed, 0.0])
    check.measure(0, [speed, 0.0], [10, 0])
    for _ in range(5):
        for _ in range(driven_ms // 20):
            now_ms += 20
            check.measure(now_ms * MS, [speed, 0.0], [10, 0])
        found.append(check.blame(now_ms * MS, RUNAWAY, damages=16))
    assert any(found) is blamed


def test_what_happens_now_and_then_is_not_in_a_row() -> None:
    check = believing(["left"])
    assert not any(check.blame(n * 5000 * MS, RUNAWAY, damages=16) for n in range(20))
