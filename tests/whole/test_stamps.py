"""The stamp of a published sample is the moment when the board took its reading."""

from __future__ import annotations

import asyncio
import bisect
import itertools
from pathlib import Path

import msgspec
import pytest
from fault_bench import FaultBench, Kept

from yahboomd.core.daemon.publisher import Publisher
from yahboomd.core.daemon.stamps import WallStamps
from yahboomd.core.messages.native import PoseSample
from yahboomd.simulation.options import ImpairmentOptions, SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

LINES = {
    "wire": ImpairmentOptions(),
    "usb": ImpairmentOptions(jitter_s=0.004),
    "timer": ImpairmentOptions(chunk_s=0.016),
}


class Published(FaultBench):
    """A bench whose estimates go through the daemon's publisher."""

    def __init__(
        self, folder: Path, overrides: list[str], simulation: SimulationOptions | None = None
    ) -> None:
        super().__init__(folder, overrides, simulation)
        self.outlets: dict[str, Kept] = {}
        self.publisher = Publisher(
            lambda key: self.outlets.setdefault(key, Kept()),
            encoding="json",
            stamps=WallStamps(self.clock, self.heard.event),
            period_ns=round(1e9 / self.config.odometry.publish_rate_hz),
            frame_id="odom",
            child_frame_id="base_link",
            motor_names=("left", "right"),
        )
        keep = self.heard.estimate

        def estimate(estimate: object, command_m_s: object) -> None:
            keep(estimate, command_m_s)  # type: ignore[arg-type]
            self.publisher.estimate(estimate, command_m_s)  # type: ignore[arg-type]

        self.heard.estimate = estimate  # type: ignore[method-assign, assignment]

    @property
    def poses(self) -> list[PoseSample]:
        payloads = self.outlets["yahboomd/pose"].payloads
        return [msgspec.json.decode(each, type=PoseSample) for each in payloads]


def true_x(bench: FaultBench, at_ns: int) -> float:
    """The place of the robot, between the truth's samples of every 10 ms."""
    times = [each.t_ns for each in bench.truth]
    after = bisect.bisect_right(times, at_ns)
    a, b = bench.truth[after - 1], bench.truth[after]
    return a.x + (b.x - a.x) * (at_ns - a.t_ns) / (b.t_ns - a.t_ns)


async def late_ms(bench: Published) -> list[float]:
    """The delays of a steady run's poses behind their stamps, sorted."""
    await bench.ready()
    # Once it moves the board's clock can be seen; ten seconds later a steady run is judged.
    await bench.drive(12.0, 0.4)
    begin = len(bench.poses)
    await bench.drive(3.0, 0.4)
    offset_ns = bench.clock.wall_ns() - bench.clock.now_ns()
    bench.robot.advance(bench.clock.now_ns())
    speed = bench.truth[-1].vx
    poses = bench.poses[begin:-2]
    assert len(poses) > 100
    return sorted(
        1e3 * (true_x(bench, pose.stamp_ns - offset_ns) - pose.x) / speed for pose in poses
    )


@pytest.mark.cases(1)
@pytest.mark.parametrize("line", [each for each in LINES if each != "usb"])
@on_virtual_time
async def test_a_streamed_pose_belongs_to_its_stamp_whatever_the_line_adds(
    tmp_path: Path, line: str
) -> None:
    async with Published(tmp_path, [], SimulationOptions(impairments=LINES[line])) as bench:
        late = await late_ms(bench)
        assert abs(late[len(late) // 2]) < 0.5
        assert max(abs(late[0]), abs(late[-1])) < 1.0


@pytest.mark.nightly
@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", range(6))
@on_virtual_time
async def test_a_streamed_pose_behind_a_line_with_jitter_belongs_to_its_stamp_within_about_1_ms(
    tmp_path: Path, seed: int
) -> None:
    # 4 ms of jitter: by how much the earliest lines were delayed is chance, 0.1 to 1.0 ms.
    simulation = SimulationOptions(impairments=LINES["usb"], seed=seed)
    async with Published(tmp_path, [], simulation) as bench:
        late = await late_ms(bench)
        assert abs(late[len(late) // 2]) < 1.1
        assert max(abs(late[0]), abs(late[-1])) < 2.0


@pytest.mark.cases(1)
@pytest.mark.parametrize("line", list(LINES))
@on_virtual_time
async def test_a_polled_pose_is_no_older_than_the_counters_of_its_answer(
    tmp_path: Path, line: str
) -> None:
    simulation = SimulationOptions(dialect="polled", impairments=LINES[line])
    async with Published(tmp_path, [], simulation) as bench:
        late = await late_ms(bench)
        # The board renews them every 10 ms, and nothing on the wire tells when.
        way_ms = 1e3 * (LINES[line].delay_s + LINES[line].jitter_s)
        assert late[0] > -1.0 - way_ms
        assert late[-1] < 10.0 + 1.0 + way_ms


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@pytest.mark.parametrize("wanted_hz", [None, 20.0])
@on_virtual_time
async def test_samples_go_out_fifty_times_a_second_by_default(
    tmp_path: Path, dialect: str, wanted_hz: float | None
) -> None:
    overrides = [] if wanted_hz is None else [f"odometry.publish_rate_hz={wanted_hz}"]
    simulation = SimulationOptions(dialect=dialect)  # type: ignore[arg-type]
    async with Published(tmp_path, overrides, simulation) as bench:
        await bench.ready()
        before = len(bench.poses)
        await bench.drive(4.0, 0.3)
        await asyncio.sleep(6.0)
        count = len(bench.poses) - before
        assert count == pytest.approx(10.0 * (wanted_hz or 50.0), abs=2)
        for a, b in itertools.pairwise(bench.poses):
            assert (b.seq, b.stamp_ns > a.stamp_ns) == (a.seq + 1, True)
