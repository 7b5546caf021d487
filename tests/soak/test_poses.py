from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.soak.poses import PoseWatch, error, way_covariance
from yahboomd.core.messages.native import PoseSample

UNSURE = ((0.04, 0.001, -0.002), (0.001, 0.03, 0.004), (-0.002, 0.004, 0.02))


def flat(matrix: np.ndarray) -> tuple[float, ...]:
    return tuple(float(each) for each in matrix.reshape(9))


def test_how_unsure_a_way_is_does_not_depend_on_what_was_unsure_before_it() -> None:
    then, now = (1.0, 2.0, 0.3), (4.0, -1.0, 0.9)
    dx, dy = now[0] - then[0], now[1] - then[1]
    swing = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    before = np.array(UNSURE)
    grown = np.diag([0.002, 0.003, 0.0004])
    after = swing @ before @ swing.T + grown
    found = way_covariance(then, flat(before), now, flat(after))  # type: ignore[arg-type]
    assert found == pytest.approx((0.002, 0.003, 0.0004))


def test_a_way_is_compared_from_where_it_began() -> None:
    metres, radians = error((5.0, 5.0, math.pi / 2), (5.0, 6.0, math.pi / 2), (0, 0, 0), (1, 0, 0))
    assert metres == pytest.approx(0.0)
    assert radians == pytest.approx(0.0)


def sample(seq: int, x: float, variance: float = 1e-6) -> PoseSample:
    return PoseSample(
        stamp_ns=1_000_000_000 + seq * 20_000_000,
        seq=seq,
        frame_id="odom",
        child_frame_id="base_link",
        x=x,
        y=0.0,
        theta=0.0,
        covariance=(variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance),
    )


def test_a_jump_and_a_covariance_that_shrinks_are_found() -> None:
    watch = PoseWatch()
    watch.see(sample(1, 0.0))
    watch.see(sample(2, 0.04))
    assert watch.found == []
    watch.see(sample(3, 0.09))
    watch.see(sample(4, 0.09, 1e-7))
    assert [jump.kind for jump in watch.found] == ["position", "covariance"]


def test_a_pose_that_somebody_sets_is_no_jump_and_the_next_one_is_watched_again() -> None:
    watch = PoseWatch()
    watch.see(sample(1, 3.0))
    watch.pause()
    watch.see(sample(2, 0.0, 1e-9))
    watch.resume()
    watch.see(sample(3, 0.0, 1e-9))
    assert watch.found == []
    watch.see(sample(4, 1.0))
    assert [jump.kind for jump in watch.found] == ["position"]


def test_a_stamp_in_the_future_is_found() -> None:
    watch = PoseWatch()
    first, second = sample(1, 0.0), sample(2, 0.0)
    watch.see(first, first.stamp_ns + 1_000_000)
    watch.see(second, second.stamp_ns - 1_000_000)
    assert watch.found == []
    third = sample(3, 0.0)
    watch.see(third, third.stamp_ns - 30_000_000)
    assert [(jump.kind, jump.step) for jump in watch.found] == [("future", 0.03)]
