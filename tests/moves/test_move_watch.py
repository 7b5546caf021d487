"""Blocked, slipping, lost."""

from __future__ import annotations

import pytest

from yahboomd.core.model import Pose2d, Twist2d
from yahboomd.moves.motion.leg import TURN, WAY
from yahboomd.moves.motion.move_watch import MoveWatch

STEP_NS = 20_000_000


def drive(commanded: float, driven: float, *, turn: bool = False, steps: int = 300) -> bool:
    """Whether a base that is commanded one speed and drives another counts as blocked."""
    watch = MoveWatch()
    watch.command(Twist2d(wz=commanded) if turn else Twist2d(vx=commanded))
    for step in range(steps):
        way = driven * step * STEP_NS / 1e9
        pose = Pose2d(theta=way) if turn else Pose2d(x=way)
        if watch.blocked(pose, step * STEP_NS):
            return True
    return False


@pytest.mark.parametrize("turn", [False, True])
def test_a_base_that_is_commanded_and_stands_is_blocked(turn: bool) -> None:
    assert drive(0.5, 0.0, turn=turn)
    assert drive(0.5, 0.05, turn=turn)
    # At the end of a leg.
    assert drive(TURN.creep if turn else WAY.creep, 0.0, turn=turn, steps=210)


@pytest.mark.parametrize("turn", [False, True])
def test_a_base_that_obeys_is_not(turn: bool) -> None:
    assert not drive(0.5, 0.5, turn=turn)
    assert not drive(0.5, 0.3, turn=turn)


def test_neither_is_one_that_is_not_commanded() -> None:
    assert not drive(0.0, 0.0)
    # Nor one that is for less than the time of a start.
    assert not drive(0.5, 0.0, steps=50)


def test_a_base_that_turns_to_and_fro_is_not_blocked_though_it_is_where_it_began() -> None:
    watch, theta = MoveWatch(), 0.0
    for step in range(300):
        wz = 1.5 if step % 100 < 50 else -1.5
        watch.command(Twist2d(wz=wz))
        assert not watch.blocked(Pose2d(theta=theta), step * STEP_NS)
        theta += wz * STEP_NS / 1e9


def test_a_base_that_was_only_just_commanded_is_not_blocked() -> None:
    watch = MoveWatch()
    for step in range(150):
        # It stood for 2.5 s, and its motors begin 0.4 s after their command.
        watch.command(Twist2d(wz=0.0 if step < 125 else 1.5))
        assert not watch.blocked(Pose2d(), step * STEP_NS)
    assert any(watch.blocked(Pose2d(), step * STEP_NS) for step in range(150, 300))


def test_a_pose_that_was_set_is_a_jump_and_a_fast_base_is_not() -> None:
    watch = MoveWatch()
    watch.command(Twist2d(vx=1.0, wz=3.0))
    for step in range(100):
        pose = Pose2d(x=0.02 * step, theta=0.06 * step)
        assert not watch.jumped(pose, step * STEP_NS)
        watch.blocked(pose, step * STEP_NS)
    assert watch.jumped(Pose2d(x=2.5, theta=6.0), 100 * STEP_NS)
    assert watch.jumped(Pose2d(x=2.0, theta=0.0), 100 * STEP_NS)


def test_wheels_that_turn_while_the_gyro_does_not_slip() -> None:
    watch = MoveWatch()
    assert any(watch.disagree(1.0, 0.02, step * STEP_NS) for step in range(50))
    watch = MoveWatch()
    assert not any(watch.disagree(1.0, 0.9, step * STEP_NS) for step in range(50))
    watch = MoveWatch()
    assert not any(watch.disagree(0.02, 0.0, step * STEP_NS) for step in range(500))
    # Plugs of the left and the right motors that are exchanged.
    watch = MoveWatch()
    ended = [watch.disagree(1.0, -0.9, step * STEP_NS) for step in range(50)][-1]
    assert ended is not None
    assert ended[0] == "exchanged"
    assert "turns to the left, and by the gyro to the right" in ended[1]
    # The wheels of a car do not turn it.
    watch = MoveWatch(steers=True)
    assert not any(watch.disagree(1.0, 0.02, step * STEP_NS) for step in range(50))


def test_uncertainty_counts_from_the_begin_of_the_moves() -> None:
    watch = MoveWatch()
    begun = (4.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.1)
    assert not watch.uncertain(begun, 0.5)
    assert not watch.uncertain((4.2, *begun[1:]), 0.5)
    assert watch.uncertain((4.3, *begun[1:]), 0.5)
