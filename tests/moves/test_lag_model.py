"""The model of what is under way: it predicts where wheels with a lag come to rest."""

from __future__ import annotations

import math

import pytest

from yahboomd.core.model import STANDSTILL, Pose2d, Twist2d
from yahboomd.moves.motion.lag_model import LagModel, in_base

DT_S = 0.02
WIRE_S = 0.03


class Plant:
    """A base whose velocity follows the command with a lag of the first order."""

    def __init__(self, lag_s: float) -> None:
        self.lag_s = lag_s
        self.pose = Pose2d()
        self._speed = [0.0, 0.0]
        self._wire = [(0.0, 0.0)] * round(WIRE_S / 0.001)

    def advance(self, twist: Twist2d, for_s: float) -> None:
        for _ in range(round(for_s / 0.001)):
            self._wire.append((twist.vx, twist.wz))
            for axis, wanted in enumerate(self._wire.pop(0)):
                self._speed[axis] += (wanted - self._speed[axis]) * 0.001 / self.lag_s
            vx, wz = self._speed
            theta = self.pose.theta + wz * 0.0005
            self.pose = Pose2d(
                x=self.pose.x + vx * 0.001 * math.cos(theta),
                y=self.pose.y + vx * 0.001 * math.sin(theta),
                theta=self.pose.theta + wz * 0.001,
            )


def run(model: LagModel, plant: Plant, twist: Twist2d, for_s: float) -> None:
    model.command(twist)
    for _ in range(round(for_s / DT_S)):
        plant.advance(twist, DT_S)
        model.advance(DT_S)
        model.seen(plant.pose)


def learned(lag_s: float) -> tuple[LagModel, Plant]:
    model, plant = LagModel(), Plant(lag_s)
    for vx, wz in ((0.2, 0.0), (0.3, 1.0), (0.1, -1.0), (0.3, 0.0)):
        run(model, plant, Twist2d(vx=vx, wz=wz), 0.6)
    return model, plant


@pytest.mark.parametrize("lag_s", [0.05, 0.1, 0.2, 0.3])
def test_it_learns_the_lag(lag_s: float) -> None:
    model, _ = learned(lag_s)
    assert model.lag_s == pytest.approx(lag_s + WIRE_S, rel=0.15)


@pytest.mark.parametrize("lag_s", [0.05, 0.1, 0.2, 0.3])
def test_a_base_rolls_as_far_as_predicted(lag_s: float) -> None:
    model, plant = learned(lag_s)
    predicted = model.predicted(plant.pose)
    begin = plant.pose
    run(model, plant, STANDSTILL, 3.0)
    rolled = math.hypot(plant.pose.x - begin.x, plant.pose.y - begin.y)
    expected = math.hypot(predicted.x - begin.x, predicted.y - begin.y)
    assert rolled == pytest.approx(expected, rel=0.15)


def test_at_rest_nothing_is_under_way() -> None:
    model, plant = learned(0.1)
    run(model, plant, STANDSTILL, 5.0)
    assert max(map(abs, model.under_way)) < 1e-4
    assert max(map(abs, model.swing)) < 1e-4


def test_a_step_of_the_pose_that_is_announced_teaches_nothing() -> None:
    model, plant = learned(0.1)
    before = model.lag_s
    plant.pose = Pose2d(x=5.0, y=-3.0, theta=2.0)
    model.forget_pose()
    run(model, plant, Twist2d(vx=0.3), 0.4)
    assert model.lag_s == pytest.approx(before, rel=0.1)


@pytest.mark.parametrize("late_s", [0.2, 0.4, 0.8])
def test_commands_that_a_busy_machine_held_back_teach_nothing(late_s: float) -> None:
    model, plant = learned(0.1)
    before = model.lag_s
    for vx in (0.0, 0.3):
        held = Twist2d(vx=0.3 - vx)
        model.command(Twist2d(vx=vx))
        for _ in range(round(late_s / DT_S)):
            plant.advance(held, DT_S)
            model.advance(DT_S)
            model.seen(plant.pose)
        run(model, plant, Twist2d(vx=vx), 0.6)
    assert model.lag_s == pytest.approx(before, rel=0.25)


def test_a_step_along_the_axes_of_the_base() -> None:
    ahead, left = in_base(0.0, 2.0, math.pi / 2.0)
    assert (ahead, left) == pytest.approx((2.0, 0.0))
