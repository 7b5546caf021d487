"""The article's bridge as a node of ROS 2 itself, as `make bench` measures it."""

import math
import time

import pytest
from ros_peers import until

from benchmarks import ros_ways
from benchmarks.drivers import frames, trial
from benchmarks.results import NotHere

pytestmark = [pytest.mark.realtime, pytest.mark.nightly]


def test_it_drives_publishes_a_pose_and_stops_the_wheels_when_it_ends() -> None:
    try:
        ros_ways.ways()
    except NotHere as reason:
        pytest.skip(str(reason))
    with trial(ros_ways.NODE) as run:

        def moved() -> bool:
            run.driver.say(0.3)
            poses = run.driver.poses()
            return bool(poses) and math.hypot(*poses[-1][:2]) > 0.1

        until(moved, "the pose to show 0.1 m")
        assert (300, 300) in {(left, right) for _, left, right in frames(run.heard())}
        ended_ns = time.monotonic_ns()
        run.process.end()
        # Its last output is read and noted a moment later.
        until(
            lambda: (0, 0) in [frame[1:] for frame in frames(run.heard(), ended_ns)[-1:]],
            "a stop as its last frame",
        )
