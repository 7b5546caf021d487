"""Lines that come late, and boards with another tick: stamps and speeds stay honest.

On virtual time, against the ground truth of the simulated robot.
"""

from __future__ import annotations

import asyncio
import bisect
import itertools
import math
import random
from pathlib import Path
from typing import Any

import pytest
from board_bench import BoardPort
from fault_bench import DIALECTS, FaultBench, assert_no_jump

from yahboomd.core.model import Counts, EncoderReading, OdometryEstimate
from yahboomd.core.odometry.odometer import Odometer, Update
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.truth import TruthSample
from yahboomd.simulation.virtual_time import VirtualTimeLoop, on_virtual_time

FAR = (60_000, 0, 60_000, 0)
NEAR = (0, 0, 0, 0)
KERNEL_BYTES = 4096
"""The size of a Linux terminal's buffer for its reader."""

READ_BYTES = 1024
"""pyserial-asyncio takes so many at once."""

BOARDS = [*((dialect, "measured") for dialect in DIALECTS), ("streamed", "wire")]
"""Each, and one that fills the wire with its lines."""

ALARMS = {"runaway_fast", "runaway_against", "no_counts", "off_speed"}


class LateBench(FaultBench):
    """Keeps by how much each stamp lies before the arrival of its line."""

    def __init__(self, folder: Path, **simulation: object) -> None:
        options = {"initial_ticks": FAR, **simulation}
        super().__init__(folder, [], SimulationOptions(**options))  # type: ignore[arg-type]
        self.room_ns: list[int] = []
        room_ns = self.room_ns

        class Keeping(Odometer):
            __slots__ = ()

            def update(self, reading: EncoderReading) -> Update:
                result = super().update(reading)
                if result.estimate is not None:
                    room_ns.append(reading.received_ns - result.estimate.stamp_ns)
                return result

        self.controller._odometer.__class__ = Keeping

    def true_at(self, estimate: OdometryEstimate) -> TruthSample:
        return self.true_at_ns(estimate.stamp_ns)

    def true_at_ns(self, at_ns: int) -> TruthSample:
        index = bisect.bisect_right(self.truth, at_ns, key=lambda each: each.t_ns)
        return self.truth[min(index, len(self.truth) - 1)]

    def off_m_s(self, estimate: OdometryEstimate) -> float:
        """By how much a twist is too fast."""
        return abs(estimate.twist.vx) - abs(self.true_at(estimate).vx)

    def beyond_m_s(self, estimate: OdometryEstimate, window_ns: int, *, early_ns: int = 0) -> float:
        """By how much a twist is slower or faster than anything in the window before its stamp.

        Args:
            early_ns: How much earlier than its counts the stamp may be.
        """
        end_ns = estimate.stamp_ns + early_ns
        times = range(estimate.stamp_ns - window_ns, end_ns + 1, 10_000_000)
        true = [self.true_at_ns(at_ns).vx for at_ns in times]
        return max(estimate.twist.vx - max(true), min(true) - estimate.twist.vx)


def freeze(for_s: float) -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop.freeze(for_s)


@pytest.mark.nightly
@pytest.mark.parametrize("held_s", [0.1, 0.3, 0.6, 0.9, 1.2, 1.9])
@on_virtual_time
async def test_lines_that_arrive_in_one_burst_are_never_stamped_in_the_future(
    tmp_path: Path, held_s: float
) -> None:
    async with LateBench(tmp_path) as bench:
        await bench.ready()
        await bench.drive(2.5, 0.3)
        before = len(bench.heard.estimates)
        bench.do(f"hold {held_s}")
        await bench.drive(held_s + 2.0, 0.3)
        bench.robot.advance(bench.clock.now_ns())
        assert min(bench.room_ns) >= 0
        for a, b in itertools.pairwise(bench.heard.estimates):
            assert b.stamp_ns > a.stamp_ns
        assert_no_jump(bench.heard.estimates)
        assert max(map(bench.off_m_s, bench.heard.estimates[before:])) < 0.12
        assert not ALARMS & set(bench.heard.kinds)


class ReadingPort(BoardPort):
    """Delivers bytes as a serial port does: at most this many in one read, which takes a while.

    Bytes for a full kernel buffer are lost, in the middle of a line too: the oldest bytes stay.
    """

    def listen(self, on_data: Any, on_lost: Any) -> None:
        self._hear, self._waiting, self._busy = on_data, bytearray(), False
        super().listen(self._arrived, on_lost)

    def _arrived(self, data: bytes) -> None:
        self._waiting += data[: max(0, KERNEL_BYTES - len(self._waiting))]
        if not self._busy:
            self._busy = True
            # The kernel wakes the reader, which does not run at once.
            asyncio.get_running_loop().call_soon(self._read)

    def drop_input(self) -> None:
        super().drop_input()
        self._waiting.clear()

    def _read(self) -> None:
        data = bytes(self._waiting[:READ_BYTES])
        del self._waiting[:READ_BYTES]
        self._busy = bool(data)
        if data:
            took_s = 0.0015 * len(data) / READ_BYTES
            asyncio.get_running_loop().call_later(took_s, self._read)
            self._hear(data)


class ReadingBench(LateBench):
    """Such a port."""

    async def _open(self) -> BoardPort:
        if self.robot.started:
            self.robot.advance(self.clock.now_ns())
        self.ports.append(ReadingPort(self.robot))
        return self.ports[-1]


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("for_s", [0.35, 0.5, 0.8, 1.1, 1.4, 1.8])
@on_virtual_time
async def test_what_is_read_bit_by_bit_after_a_freeze_has_the_speed_of_its_time(
    tmp_path: Path, for_s: float, dialect: str
) -> None:
    async with ReadingBench(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(3.0, 0.3)
        before = len(bench.heard.estimates)
        freeze(for_s)
        await bench.drive(1.0, 0.3)
        bench.robot.advance(bench.clock.now_ns())
        assert min(bench.room_ns) >= 0
        for estimate in bench.heard.estimates[before:-2]:
            # A speed belongs to its window, and lies between the slowest and the fastest in it.
            off = bench.beyond_m_s(estimate, 130_000_000)
            assert off < 0.03 + 3.0 * math.sqrt(estimate.twist_covariance[0])


def pose_off_m(bench: LateBench) -> float:
    """How far the latest pose is from the truth of its moment."""
    pose, true = bench.heard.estimates[-1].pose, bench.true_at(bench.heard.estimates[-1])
    return math.hypot(pose.x - true.x, pose.y - true.y)


@pytest.mark.cases(1)
@pytest.mark.parametrize("ticks", [NEAR, FAR], ids=["near", "far"])
@pytest.mark.parametrize(("dialect", "pace"), BOARDS)
@pytest.mark.parametrize("for_s", [0.5, 0.9, 1.5, 3.0, 10.0])
@on_virtual_time
async def test_a_pause_costs_no_travel_though_the_kernel_dropped_the_newest_lines(
    tmp_path: Path, for_s: float, dialect: str, pace: str, ticks: Counts
) -> None:
    async with ReadingBench(
        tmp_path, dialect=dialect, stream_pace=pace, initial_ticks=ticks
    ) as bench:
        await bench.ready()
        # A curve; the last part of the pause is driven straight, as its first part is.
        await bench.drive(1.5, 0.3, 0.3)
        await bench.drive(1.5, 0.3)
        before = len(bench.heard.estimates)
        freeze(for_s)
        await bench.drive(1.5, 0.3)
        bench.robot.advance(bench.clock.now_ns())
        assert pose_off_m(bench) < 0.015
        assert "odometry_bridged" in bench.heard.kinds
        assert "odometry_discontinuity" not in bench.heard.kinds
        assert not ALARMS & set(bench.heard.kinds)
        for estimate in bench.heard.estimates[before:-2]:
            # The first stamps behind a pause may be two ticks early, and wheels brake hard then.
            off = bench.beyond_m_s(estimate, 130_000_000, early_ns=20_000_000)
            assert off < 0.03 + 3.0 * math.sqrt(estimate.twist_covariance[0])


@pytest.mark.cases(1)
@pytest.mark.parametrize("pace", ["measured", "wire"])
@pytest.mark.parametrize("for_s", [0.5, 0.9, 1.5, 10.0])
@on_virtual_time
async def test_after_a_pause_a_stream_that_ran_on_shows_that_nothing_is_unknown(
    tmp_path: Path, for_s: float, pace: str
) -> None:
    async with ReadingBench(tmp_path, stream_pace=pace, initial_ticks=NEAR) as bench:
        await bench.ready()
        # Counters that stand at zero would be there after a reset, too.
        await asyncio.sleep(2.0)
        freeze(for_s)
        await asyncio.sleep(1.0)
        assert "paused" in bench.heard.kinds
        assert "odometry_discontinuity" not in bench.heard.kinds
        await bench.drive(1.0, 0.3)
        bench.robot.advance(bench.clock.now_ns())
        assert pose_off_m(bench) < 0.015
        assert math.sqrt(bench.heard.estimates[-1].pose_covariance[0]) < 0.05


@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("command", ["freeze", "hold"])
@pytest.mark.parametrize("for_s", [0.2, 0.3, 0.35, 0.5, 0.7, 0.9])
@on_virtual_time
async def test_a_stall_of_a_board_that_fills_the_wire_publishes_no_speed_that_is_too_high(
    tmp_path: Path, for_s: float, command: str, seed: int
) -> None:
    async with ReadingBench(tmp_path, stream_pace="wire", seed=seed) as bench:
        await bench.ready()
        await bench.drive(3.0, 0.3)
        await asyncio.sleep(0.003 * seed)
        before = len(bench.heard.estimates)
        if command == "freeze":
            freeze(for_s)
        else:
            bench.do(f"hold {for_s}")
            await bench.drive(for_s, 0.3)
        await bench.drive(1.5, 0.3)
        bench.robot.advance(bench.clock.now_ns())
        assert pose_off_m(bench) < 0.015
        for estimate in bench.heard.estimates[before:-2]:
            # Behind a hole the window is as long as that.
            off = bench.beyond_m_s(estimate, 250_000_000)
            assert off < 0.03 + 3.0 * math.sqrt(estimate.twist_covariance[0])


@pytest.mark.cases(1)
@pytest.mark.parametrize("towards_zero", [False, True])
@pytest.mark.parametrize(("dialect", "pace"), BOARDS)
@pytest.mark.parametrize("after_s", [0.1, 0.6, 1.2])
@on_virtual_time
async def test_a_reset_during_a_pause_is_noticed_and_is_no_travel(
    tmp_path: Path, after_s: float, dialect: str, pace: str, towards_zero: bool
) -> None:
    async with ReadingBench(
        tmp_path, dialect=dialect, stream_pace=pace, initial_ticks=NEAR
    ) as bench:
        await bench.ready()
        if towards_zero:
            # Without the reset the counters were at zero after the pause, too.
            await bench.drive(2.5, -0.3)
            await bench.drive(0.7, 0.3)
        else:
            await bench.drive(2.0, 0.3)
        bench.robot.after(bench.clock.now_ns() + round(after_s * 1e9), bench.robot.reset)
        freeze(1.5)
        await bench.drive(2.0, 0.3)
        bench.robot.advance(bench.clock.now_ns())
        breaks = [each for each in bench.heard.events if each.kind == "odometry_discontinuity"]
        assert breaks
        unknown_m = sum((each.data or {})["unknown_m"] for each in breaks)
        assert pose_off_m(bench) <= unknown_m
        # Its motors were let go, and it drives again.
        assert min(bench.rim_speeds) > 0.2


@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("stall_s", [0.1, 0.2, 0.28, 0.4, 0.7, 0.95])
@on_virtual_time
async def test_answers_to_questions_that_queued_have_a_speed_as_sure_as_it_says(
    tmp_path: Path, stall_s: float, seed: int
) -> None:
    chance = random.Random(seed)
    async with ReadingBench(tmp_path, dialect="polled", seed=seed) as bench:
        await bench.ready()
        await bench.drive(3.0 + chance.uniform(0.0, 0.1), 0.45)
        before = len(bench.heard.estimates)
        bench.do(f"stall {stall_s}")
        for _ in range(round((stall_s + 1.0) / 0.1)):
            await bench.drive(0.1, chance.uniform(0.2, 0.5))
        bench.robot.advance(bench.clock.now_ns())
        for estimate in bench.heard.estimates[before:-2]:
            off = bench.beyond_m_s(estimate, 400_000_000)
            assert off < 0.05 + 3.0 * math.sqrt(estimate.twist_covariance[0])


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("tick_s", "jitter_s", "event", "bound_m_s"),
    [
        (0.01, 0.0, None, 0.02),
        (0.005, 0.0, "board_clock_period", 0.02),
        (0.02, 0.0, "board_clock_period", 0.02),
        (0.04, 0.0, "board_clock_period", 0.02),
        (0.0, 0.0, "board_clock_unfit", 0.03),
        (0.008, 0.006, "board_clock_unfit", 0.1),
        (0.02, 0.01, "board_clock_unfit", 0.1),
    ],
)
@on_virtual_time
async def test_whatever_the_tick_of_the_board_the_twist_is_true_and_the_pose_is_fresh(
    tmp_path: Path, tick_s: float, jitter_s: float, event: str | None, bound_m_s: float
) -> None:
    async with LateBench(tmp_path, tick_period_s=tick_s, tick_jitter_s=jitter_s) as bench:
        await bench.ready()
        await bench.drive(6.0, 0.3)
        settled = len(bench.heard.estimates)
        # To and fro, so that a lag that grows has time to, and digits stay.
        for way in (1, -1):
            await bench.drive(5.0, 0.3 * way)
            late_ns = bench.clock.now_ns() - bench.heard.estimates[-1].stamp_ns
            assert late_ns < 60_000_000 + 1e9 * tick_s
        bench.robot.advance(bench.clock.now_ns())
        steady = [
            estimate
            for estimate in bench.heard.estimates[settled:-20]
            if abs(abs(bench.true_at(estimate).vx) - 0.3) < 0.003
        ]
        assert len(steady) > 150
        # A turn of direction takes longer than the window is long: only steady runs are judged.
        worst = sorted(abs(abs(each.twist.vx) - 0.3) for each in steady)
        assert worst[len(worst) * 98 // 100] < bound_m_s
        assert set(bench.heard.kinds) == {"connected"} | ({event} if event else set())


@pytest.mark.nightly
@on_virtual_time
async def test_a_tick_that_changes_while_the_board_runs_is_noticed(tmp_path: Path) -> None:
    async with LateBench(tmp_path) as bench:
        await bench.ready()
        await bench.drive(3.0, 0.3)
        for words, tick_ns in (("0.005", 5_000_000), ("0", None), ("0.02", 20_000_000)):
            bench.do(f"tick-period {words}")
            await bench.drive(6.0, 0.3)
            assert bench.controller._odometer.tick_period_ns == tick_ns
        await asyncio.sleep(1.0)
        kinds = ["connected", "board_clock_period", "board_clock_unfit", "board_clock_period"]
        assert bench.heard.kinds == kinds


@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@on_virtual_time
async def test_starts_behind_a_line_that_stands_still_both_ways_accuse_no_wheel(
    tmp_path: Path, dialect: str, seed: int
) -> None:
    chance = random.Random(seed)
    async with LateBench(tmp_path, dialect=dialect, seed=seed) as bench:
        await bench.ready()

        async def starve() -> None:
            while True:
                held_s = chance.choice([0.03, 0.08, 0.15, 0.2, 0.28])
                bench.do(f"hold {held_s}")
                bench.do(f"stall {held_s}")
                await asyncio.sleep(held_s + chance.choice([0.004, 0.011, 0.03]))

        starving = asyncio.create_task(starve())
        for _ in range(6):
            await bench.drive(1.2, chance.choice([0.5, -0.5, 0.25]))
            await bench.drive(0.8, 0.0)
        starving.cancel()
        assert not ALARMS & set(bench.heard.kinds), bench.heard.kinds
