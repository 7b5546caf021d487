"""The verdict on every way to connect four motors, and on faults, alone and together."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.tools.calibrate.estimates.wiring import (
    HandTurn,
    MotorTurn,
    judge,
    judge_by_hand,
    plain,
)

WHEELS = ("front_left", "rear_left", "front_right", "rear_right")
TICKS = 1320.0


class Robot(msgspec.Struct, kw_only=True):
    """The true wiring of a robot, as a person and the counters see it.

    Attributes:
        plugs: For each wheel its motor's plug.
        signs: For each wheel -1 for a motor that is mounted the other way round.
        encoder_at: For each plug, the plug at which its motor's encoder arrives.
        swapped: Plugs whose encoder counts the other way.
        dead_encoders: Plugs whose encoder does not count.
        dead_motors: Plugs whose motor does not turn.
    """

    plugs: Mapping[str, int]
    signs: Mapping[str, int]
    encoder_at: Mapping[int, int] = {}
    swapped: frozenset[int] = frozenset()
    dead_encoders: frozenset[int] = frozenset()
    dead_motors: frozenset[int] = frozenset()

    def counts(self, position: int, turned: int) -> tuple[int, int, int, int]:
        counts = [1, -2, 0, 1]
        if position not in self.dead_encoders:
            way = turned * (-1 if position in self.swapped else 1)
            counts[self.encoder_at.get(position, position) - 1] += way * 300
        first, second, third, fourth = counts
        return first, second, third, fourth

    def turns(self, positions: Iterable[int] = (1, 2, 3, 4)) -> list[MotorTurn]:
        wheel_of = {plug: wheel for wheel, plug in self.plugs.items()}
        found = []
        for position in positions:
            wheel = "" if position in self.dead_motors else wheel_of.get(position, "")
            if not wheel:
                found.append(MotorTurn(position=position, counts=(1, 0, -1, 2)))
                continue
            # The output is positive: the motor's own idea of forward, and of its counts.
            found.append(
                MotorTurn(
                    position=position,
                    counts=self.counts(position, 1),
                    wheel=wheel,
                    forward=self.signs[wheel] > 0,
                )
            )
        return found


def robots() -> list[Robot]:
    return [
        Robot(
            plugs=dict(zip(WHEELS, plugs, strict=True)),
            signs=dict(zip(WHEELS, signs, strict=True)),
        )
        for plugs in itertools.permutations((1, 2, 3, 4))
        for signs in itertools.product((1, -1), repeat=4)
    ]


def as_found(robot: Robot, wheels: Iterable[str] = WHEELS) -> list[tuple[str, int, int]]:
    return [(wheel, robot.plugs[wheel], robot.signs[wheel]) for wheel in wheels]


def motors(verdict: object) -> list[tuple[str, int, int]]:
    return [(each.wheel, each.position, each.sign) for each in verdict.motors]


def kinds(verdict: object) -> set[tuple[str, int | None]]:
    return {(fault.kind, fault.position) for fault in verdict.faults}


def test_every_permutation_and_every_sign_of_four_motors_is_found() -> None:
    every = robots()
    assert len(every) == 384
    for robot in every:
        verdict = judge(robot.turns(), WHEELS, TICKS)
        assert motors(verdict) == as_found(robot)
        assert (verdict.faults, verdict.missing, verdict.doubts) == ((), (), ())


def test_every_permutation_is_found_by_hand() -> None:
    for robot in robots():
        turns = [
            HandTurn(wheel=wheel, counts=robot.counts(robot.plugs[wheel], robot.signs[wheel]))
            for wheel in WHEELS
        ]
        verdict = judge_by_hand(turns, TICKS)
        assert motors(verdict) == as_found(robot)
        assert (verdict.faults, verdict.missing, verdict.doubts) == ((), (), ())


@given(
    st.sampled_from(robots()),
    st.permutations((1, 2, 3, 4)),
    st.frozensets(st.integers(1, 4)),
    st.frozensets(st.integers(1, 4)),
    st.frozensets(st.integers(1, 4), max_size=1),
)
def test_faults_together_are_each_found(
    robot, arrives, swapped, dead_encoders, dead_motors
) -> None:
    robot = msgspec.structs.replace(
        robot,
        encoder_at=dict(zip((1, 2, 3, 4), arrives, strict=True)),
        swapped=swapped,
        dead_encoders=dead_encoders,
        dead_motors=dead_motors,
    )
    verdict = judge(robot.turns(), WHEELS, TICKS)
    turning = [wheel for wheel in WHEELS if robot.plugs[wheel] not in dead_motors]
    assert motors(verdict) == as_found(robot, turning)
    assert set(verdict.missing) == set(WHEELS) - set(turning)
    assert verdict.doubts == ()
    found = kinds(verdict)
    assert {at for kind, at in found if kind == "motor_dead"} == dead_motors
    assert {at for kind, at in found if kind == "encoder_dead"} == dead_encoders - dead_motors
    counted = {1, 2, 3, 4} - dead_motors - dead_encoders
    assert {at for kind, at in found if kind == "encoder_swapped"} == swapped & counted
    crossed = {at for at in counted if robot.encoder_at[at] != at}
    named = {at for kind, at in found if kind == "encoder_crossed"}
    # Of a pair that is crossed, one sentence names both.
    pairs = {at for at in crossed if robot.encoder_at.get(robot.encoder_at[at]) == at}
    pairs &= {robot.encoder_at[at] for at in crossed}
    assert crossed - pairs <= named <= crossed
    assert all(robot.encoder_at[at] in named or at in named for at in pairs)


def two_crossed(one: int, other: int, **more: object) -> Robot:
    plugs = dict(zip(WHEELS, (1, 2, 3, 4), strict=True))
    crossed = {one: other, other: one}
    return Robot(plugs=plugs, signs=dict.fromkeys(WHEELS, 1), encoder_at=crossed, **more)


def test_a_crossed_pair_is_one_sentence_that_names_both_plugs() -> None:
    verdict = judge(two_crossed(2, 4).turns(), WHEELS, TICKS)
    (fault,) = verdict.faults
    assert fault.words == "The encoder plugs of M2 and M4 are crossed: exchange them."
    assert (fault.kind, fault.position, fault.arrives) == ("encoder_crossed", 2, 4)


def test_a_crossed_plug_whose_encoder_counts_backward_too_is_named_for_both() -> None:
    verdict = judge(two_crossed(1, 2, swapped=frozenset({2})).turns(), WHEELS, TICKS)
    assert kinds(verdict) == {("encoder_crossed", 1), ("encoder_swapped", 2)}
    assert "at the plug of M2" in verdict.faults[-1].words


def test_three_plugs_in_a_ring_are_named_one_by_one() -> None:
    robot = msgspec.structs.replace(two_crossed(1, 2), encoder_at={1: 2, 2: 3, 3: 1})
    verdict = judge(robot.turns(), WHEELS, TICKS)
    assert [fault.words.split("Plug ")[1] for fault in verdict.faults] == [
        "its encoder into M1.",
        "its encoder into M2.",
        "its encoder into M3.",
    ]


def test_where_every_encoder_counts_backward_the_motor_type_is_suspected() -> None:
    robot = robots()[0]
    robot = msgspec.structs.replace(robot, swapped=frozenset({1, 2, 3, 4}))
    assert "motor type" in judge(robot.turns(), WHEELS, TICKS).hint
    robot = msgspec.structs.replace(robot, swapped=frozenset({1, 2, 3}))
    assert judge(robot.turns(), WHEELS, TICKS).hint == ""


def test_two_wheels_leave_the_free_plugs_alone() -> None:
    robot = Robot(plugs={"left": 4, "right": 2}, signs={"left": -1, "right": 1})
    verdict = judge(robot.turns(), ("left", "right"), TICKS)
    assert motors(verdict) == [("left", 4, -1), ("right", 2, 1)]
    assert verdict.faults == ()


def test_a_dead_motor_is_where_the_person_says_or_where_alone_it_can_be() -> None:
    robot = Robot(
        plugs={"left": 4, "right": 2},
        signs={"left": 1, "right": 1},
        dead_motors=frozenset({4}),
    )
    wheels = ("left", "right")
    (unknown,) = judge(robot.turns(), wheels, TICKS).faults
    assert (unknown.kind, unknown.position, unknown.wheel) == ("motor_dead", None, "left")
    assert unknown.words.startswith("Left: the motor did not turn.")
    (named,) = judge(robot.turns(), wheels, TICKS, {"left": 4}).faults
    assert named.position == 4
    (only,) = judge(robot.turns((2, 4)), wheels, TICKS).faults
    assert only.position == 4


@pytest.mark.parametrize(
    ("by_hand", "volts", "words", "broken"),
    [
        ({}, 12.4, "whether the wheel is blocked", False),
        ({"left": True}, 10.5, "It is stiff, or the battery is low (10.5 V). Charge", False),
        ({"left": True}, 7.4, "the battery is low (7.4 V)", False),
        ({"left": True}, None, "the battery is low. Charge", False),
        ({"left": True}, 12.4, "Look at the motor's two wires", True),
        ({"left": True}, 8.1, "Look at the motor's two wires", True),
        ({"left": False}, 12.4, "no counter moved when you turned the wheel", False),
    ],
)
def test_a_motor_is_called_broken_with_a_full_battery_and_an_encoder_that_counts(
    by_hand: dict[str, bool], volts: float | None, words: str, broken: bool
) -> None:
    turns = [MotorTurn(position=1, counts=(0, 0, 0, 0))]
    (fault,) = judge(turns, ("left",), TICKS, by_hand=by_hand, volts=volts).faults
    assert words in fault.words
    assert ("broken" in fault.words) == broken


@pytest.mark.parametrize(
    ("change", "again", "words"),
    [
        ({"wheel": "front_left"}, (1, 2), "M1 and M2 both turned front left"),
        ({"counts": (300, 0, 0, 0)}, (1, 2), "moved the same counter, that of M1"),
        ({"wheel": ""}, (2,), "M2 moved a counter, and you saw no wheel turn"),
    ],
)
def test_answers_that_contradict_each_other_are_asked_again(change, again, words) -> None:
    turns = robots()[0].turns()
    turns[1] = msgspec.structs.replace(turns[1], **change)
    verdict = judge(turns, WHEELS, TICKS)
    assert verdict.again == again
    assert words in " ".join(verdict.doubts)


def test_wheels_that_are_coupled_count_at_their_own_plug() -> None:
    turns = robots()[0].turns()
    turns[0] = msgspec.structs.replace(turns[0], counts=(200, 310, 0, 0))
    assert judge(turns, WHEELS, TICKS).faults == ()


def test_by_hand_a_wheel_that_is_not_counted_is_missing() -> None:
    turns = [
        HandTurn(wheel="left", counts=(0, 1, 0, 0)),
        HandTurn(wheel="right", counts=(0, 0, -400, 0)),
    ]
    verdict = judge_by_hand(turns, TICKS)
    assert motors(verdict) == [("right", 3, -1)]
    assert verdict.missing == ("left",)
    assert verdict.faults[0].words.startswith("Left: no counter moved")


def test_by_hand_two_wheels_on_one_counter_are_asked_again() -> None:
    turns = [HandTurn(wheel=wheel, counts=(400, 0, 0, 0)) for wheel in ("left", "right")]
    assert "turn one wheel at a time" in judge_by_hand(turns, TICKS).doubts[0]


def test_wheels_have_plain_names() -> None:
    assert plain("front_left") == "front left"
