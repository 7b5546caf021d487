from __future__ import annotations

import math

import pytest

from benchmarks.soak.motion import MARGIN_M_S, Track, pose_excess_m, twist_excess_m_s
from benchmarks.soak.tail import Truth
from yahboomd.core.messages.native import PoseSample, TwistSample
from yahboomd.simulation.truth import TruthSample

MS = 1_000_000
WALL_NS = 1_700_000_000_000_000_000
SPEED = 0.4
SURE = (1e-8, 0.0, 0.0, 0.0, 1e-8, 0.0, 0.0, 0.0, 1e-8)


def truth(t_ns: int, vx: float = SPEED) -> TruthSample:
    way = vx * t_ns / 1e9
    return TruthSample(
        t_ns=t_ns,
        x=way,
        y=0.0,
        theta=0.0,
        vx=vx,
        vy=0.0,
        wz=0.0,
        speed_m_s=(vx, vx),
        travel_m=(way, way),
        ticks=(0, 0, 0, 0),
    )


TRUTHS = [truth(n * 10 * MS) for n in range(300)]
TRACK = Track(TRUTHS, WALL_NS)


def pose(t_ns: int, late_s: float = 0.0) -> PoseSample:
    """The place of the robot ``late_s`` before its stamp."""
    return PoseSample(
        stamp_ns=WALL_NS + t_ns,
        seq=1,
        frame_id="odom",
        child_frame_id="base_link",
        x=SPEED * (t_ns / 1e9 - late_s),
        y=0.0,
        theta=0.0,
        covariance=SURE,
    )


def twist(t_ns: int, vx: float, sigma: float = 0.001) -> TwistSample:
    return TwistSample(
        stamp_ns=WALL_NS + t_ns,
        seq=1,
        frame_id="base_link",
        vx=vx,
        vy=0.0,
        wz=0.0,
        covariance=(sigma**2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    )


def test_a_pose_may_be_late_by_50_ms_and_a_margin_and_no_more() -> None:
    poses = [pose(n * 100 * MS, late_s=0.05) for n in range(1, 29)]
    assert pose_excess_m(pose(0), TRUTHS[0], poses, TRACK) == 0.0
    poses.append(pose(2000 * MS, late_s=1.0))
    excess_m = pose_excess_m(pose(0), TRUTHS[0], poses, TRACK)
    assert excess_m == pytest.approx(SPEED * 0.95 - 0.03, abs=0.002)


def test_a_pose_outside_of_the_known_truth_is_not_judged() -> None:
    assert pose_excess_m(pose(0), TRUTHS[0], [pose(9_000 * MS, late_s=1.0)], TRACK) == 0.0
    assert Track([], WALL_NS).at(WALL_NS) is None


def test_a_twist_faster_than_the_robot_was_lately_is_found_unless_its_covariance_admits_it() -> (
    None
):
    assert twist_excess_m_s([twist(1000 * MS, SPEED + 0.9 * MARGIN_M_S)], TRACK) == 0.0
    found = twist_excess_m_s([twist(1000 * MS, 1.4)], TRACK)
    assert found == pytest.approx(1.0 - MARGIN_M_S, abs=0.01)
    assert twist_excess_m_s([twist(1000 * MS, 1.4, sigma=0.5)], TRACK) == 0.0


def test_a_twist_may_be_a_mean_over_what_the_robot_did_lately() -> None:
    braked = [*TRUTHS[:100], *(truth(n * 10 * MS, 0.0) for n in range(100, 200))]
    assert twist_excess_m_s([twist(1500 * MS, 0.2)], Track(braked, WALL_NS)) == 0.0


def test_how_far_a_wheel_ran_backward_is_measured_from_its_furthest_point() -> None:
    robot = Truth.__new__(Truth)
    ways = [0.0, 0.2, 0.5, 0.45, 0.6]
    robot.since = lambda _t_ns: [  # type: ignore[method-assign]
        TruthSample(
            t_ns=0,
            x=0.0,
            y=0.0,
            theta=0.0,
            vx=0.0,
            vy=0.0,
            wz=0.0,
            speed_m_s=(0.0, 0.0),
            travel_m=(way, 0.0),
            ticks=(0, 0, 0, 0),
        )
        for way in ways
    ]
    assert math.isclose(robot.backed_m(0), 0.05)
