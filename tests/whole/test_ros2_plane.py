"""Signs, frames, stamps and joints as a ROS 2 node reads them while each base drives."""

from __future__ import annotations

import asyncio
import itertools
import math
from pathlib import Path
from typing import Any

import pytest
from fault_bench import TICK_M, FaultBench, Kept
from ros_oracle import Oracle

from yahboomd.core.daemon.publisher import Publisher
from yahboomd.core.daemon.stamps import WallStamps
from yahboomd.core.model import OdometryEstimate, Twist2d
from yahboomd.ros2.messages import ros2_encoders
from yahboomd.ros2.messages.ros2_names import Qos
from yahboomd.ros2.ros2_plane import topics
from yahboomd.ros2.ros2_samples import RosPublisher, Spread
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

TRACK_M = 0.15
BASE_M = 0.13
DRIVES = {
    "2wd": ("differential", ()),
    "4wd": ("skid_steer", ()),
    "mecanum": ("mecanum", (f"chassis.wheel_base_m={BASE_M}",)),
}
TWO = ["left_wheel_joint", "right_wheel_joint"]
FOUR = [
    f"{end}_{side}_wheel_joint"
    for end, side in (("front", "left"), ("rear", "left"), ("front", "right"), ("rear", "right"))
]

# The way that each wheel turns, in the order of the names; forward is positive on both sides.
MOTIONS: list[tuple[str, Twist2d, list[str], list[int]]] = [
    ("2wd", Twist2d(vx=0.25), TWO, [1, 1]),
    ("2wd", Twist2d(wz=1.0), TWO, [-1, 1]),
    ("2wd", Twist2d(vx=0.25, wz=0.5), TWO, [1, 1]),
    ("4wd", Twist2d(vx=-0.25), FOUR, [-1, -1, -1, -1]),
    ("4wd", Twist2d(wz=1.0), FOUR, [-1, -1, 1, 1]),
    ("mecanum", Twist2d(vx=0.25), FOUR, [1, 1, 1, 1]),
    ("mecanum", Twist2d(vy=0.25), FOUR, [-1, 1, 1, -1]),
    ("mecanum", Twist2d(wz=1.0), FOUR, [-1, -1, 1, 1]),
]


class GraphBench(FaultBench):
    """A bench whose estimates go to both planes, as the daemon hands them on."""

    def __init__(
        self, folder: Path, overrides: list[str], simulation: SimulationOptions | None = None
    ) -> None:
        super().__init__(folder, overrides, simulation)
        self.oracle = Oracle()
        self.kept: dict[str, tuple[str, Kept]] = {}
        publisher = Publisher(
            lambda _key: Kept(),
            encoding="json",
            stamps=WallStamps(self.clock, self.heard.event),
            period_ns=round(1e9 / self.config.odometry.publish_rate_hz),
            frame_id="odom",
            child_frame_id="base_link",
            motor_names=tuple(motor.name for motor in self.config.motors()),
        )

        def open_topic(topic: str, ros_type: str, _qos: Qos) -> Spread:
            return Spread((self.kept.setdefault(topic, (ros_type, Kept()))[1],))

        ros = RosPublisher(open_topic, topics(self.config), self.clock)
        keep = self.heard.estimate

        def estimate(estimate: OdometryEstimate, command_m_s: tuple[float, ...]) -> None:
            keep(estimate, command_m_s)
            stamp_ns = publisher.estimate(estimate, command_m_s)
            if stamp_ns is not None:
                ros.estimate(estimate, stamp_ns)

        self.heard.estimate = estimate  # type: ignore[method-assign]

    def messages(self, topic: str) -> list[Any]:
        ros_type, kept = self.kept[topic]
        return [self.oracle.decode(ros_type, payload) for payload in kept.payloads]

    async def command(self, wish: Twist2d, for_s: float) -> None:
        """As a ROS node commands: Twists, 20 a second."""
        for _ in range(round(for_s * 20)):
            self.payload(ros2_encoders.twist((wish.vx, wish.vy, 0.0, 0.0, 0.0, wish.wz)))
            await asyncio.sleep(0.05)


def bench_of(folder: Path, preset: str, *overrides: str) -> GraphBench:
    drive, more = DRIVES[preset]
    simulation = SimulationOptions(
        drive=drive,  # type: ignore[arg-type]
        wheel_separation_m=TRACK_M,
        wheel_base_m=BASE_M,
    )
    return GraphBench(folder, [f"chassis.preset={preset}", *more, *overrides], simulation)


def yaw_of(quaternion: dict[str, float]) -> float:
    return 2.0 * math.atan2(quaternion["z"], quaternion["w"])


def sign(value: float) -> int:
    return (value > 0.0) - (value < 0.0)


def stamp_ns(message: Any) -> int:
    stamp = message["header"]["stamp"]
    return int(stamp["sec"]) * 1_000_000_000 + int(stamp["nanosec"])


@pytest.mark.cases(3)
@pytest.mark.parametrize(("preset", "wish", "names", "turning"), MOTIONS)
@on_virtual_time
async def test_x_is_forward_y_is_left_and_turns_are_counter_clockwise_on_every_base(
    tmp_path: Path, preset: str, wish: Twist2d, names: list[str], turning: list[int]
) -> None:
    async with bench_of(tmp_path, preset) as bench:
        await bench.ready()
        await bench.command(wish, 2.0)
        moving, joints = bench.messages("odom")[-1], bench.messages("joint_states")[-1]
        linear, angular = moving["twist"]["twist"]["linear"], moving["twist"]["twist"]["angular"]
        assert linear["x"] == pytest.approx(wish.vx, abs=0.03)
        assert linear["y"] == pytest.approx(wish.vy, abs=0.03)
        assert angular["z"] == pytest.approx(wish.wz, abs=0.3)
        assert joints["name"] == names
        assert [sign(speed) for speed in joints["velocity"]] == turning
        await asyncio.sleep(1.5)
        bench.robot.advance(bench.clock.now_ns())
        truth, there = bench.truth[-1], bench.messages("odom")[-1]["pose"]["pose"]
        position = there["position"]
        assert math.hypot(position["x"] - truth.x, position["y"] - truth.y) < 0.008
        off = math.remainder(yaw_of(there["orientation"]) - truth.theta, math.tau)
        assert abs(off) <= 2 * TICK_M / TRACK_M
        joints = bench.messages("joint_states")[-1]
        assert [sign(angle) for angle in joints["position"]] == turning
        rolled = [
            angle * motor.radius_m
            for angle, motor in zip(joints["position"], bench.config.motors(), strict=True)
        ]
        assert rolled == pytest.approx(list(truth.travel_m), abs=2 * TICK_M)


@on_virtual_time
async def test_each_reading_is_one_pose_and_one_transform_of_one_stamp(tmp_path: Path) -> None:
    async with bench_of(tmp_path, "2wd", "ros2.frame_prefix=bot1/") as bench:
        await bench.ready()
        await bench.command(Twist2d(vx=0.25, wz=1.0), 3.0)
        await asyncio.sleep(2.0)
        odometry = bench.messages("odom")
        transforms = [transform for (transform,) in (m["transforms"] for m in bench.messages("tf"))]
        assert len(odometry) > 200
        assert [stamp_ns(each) for each in transforms] == [stamp_ns(each) for each in odometry]
        assert all(stamp_ns(a) < stamp_ns(b) for a, b in itertools.pairwise(transforms))
        for odom, transform in zip(odometry, transforms, strict=True):
            assert odom["header"]["frame_id"] == transform["header"]["frame_id"] == "bot1/odom"
            assert odom["child_frame_id"] == transform["child_frame_id"] == "bot1/base_link"
            pose, placed = odom["pose"]["pose"], transform["transform"]
            assert pose["position"] == placed["translation"]
            assert pose["orientation"] == placed["rotation"]
            norm = math.hypot(*pose["orientation"].values())
            assert norm == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(
    ("off", "gone"),
    [("odom", "odom"), ("publish_tf", "tf"), ("joint_states", "joint_states")],
)
@on_virtual_time
async def test_each_of_them_is_switched_off_alone(tmp_path: Path, off: str, gone: str) -> None:
    async with bench_of(tmp_path, "2wd", f"ros2.{off}=false") as bench:
        await bench.ready()
        await bench.command(Twist2d(vx=0.25), 0.5)
        heard = {topic for topic, (_, kept) in bench.kept.items() if kept.payloads}
        assert heard == {"odom", "tf", "joint_states"} - {gone}
        assert gone not in bench.kept
