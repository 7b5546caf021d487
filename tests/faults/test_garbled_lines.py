"""Digits that are wrong on their way: no wheel is cut for them, and the pose does not jump.

The lines have no checksum, and on virtual time a line may be as bad as one likes.
"""

from __future__ import annotations

import asyncio
import math
import random
from pathlib import Path

import pytest
from fault_bench import (
    DIALECTS,
    MS,
    FaultBench,
    assert_covariance_grows,
    assert_no_jump,
)

from yahboomd.core.model import Event
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

RUNAWAYS = {"runaway_against", "runaway_fast"}


class Witness:
    """Records each runaway event about a wheel that did not run away."""

    def __init__(self, bench: FaultBench) -> None:
        self.false: list[str] = []
        self._bench = bench
        self._event = bench.heard.event
        bench.heard.event = self._hear  # type: ignore[method-assign]

    def _hear(self, event: Event) -> None:
        self._event(event)
        if event.kind in RUNAWAYS and not self._did_so(event):
            self.false.append(event.message)

    def _did_so(self, event: Event) -> bool:
        # A command that is garbled on its way to the board is driven: then it is true.
        bench, data = self._bench, event.data or {}
        now_ns = bench.clock.now_ns()
        bench.robot.advance(now_ns)
        wheel = ["left", "right"].index(event.wheel or "left")
        wish, seen = float(data["commanded_m_s"]), float(data["measured_m_s"])
        way = math.copysign(1.0, seen)
        lately = [each for each in bench.truth[-30:] if each.t_ns >= now_ns - 300 * MS]
        most = max(each.speed_m_s[wheel] * way for each in lately)
        return most > 1.5 * abs(wish) + 0.1 or (wish * seen < 0.0 and most > 0.03)


@pytest.mark.cases(1)
@pytest.mark.parametrize("share", [0.01, 0.05])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_no_wheel_is_cut_for_digits_that_were_garbled_on_their_way(
    tmp_path: Path, dialect: str, seed: int, share: float
) -> None:
    chance = random.Random(f"{dialect} {seed} {share}")
    options = SimulationOptions(
        dialect=dialect,  # type: ignore[arg-type]
        wheel_separation_m=0.15,
        seed=seed,
        initial_ticks=(3_000_000, 0, 3_000_000, 0),
    )
    async with FaultBench(tmp_path, [], options) as bench:
        await bench.ready()
        witness = Witness(bench)
        for _ in range(5):
            bench.do(f"corruption {share}")
            for _ in range(6):
                await bench.drive(0.5, chance.uniform(-0.35, 0.5), chance.uniform(-2.0, 2.0))
            bench.do("clear")
            await asyncio.sleep(1.0)
            if bench.controller.fault:
                bench.operator.release_estop()
            await bench.drive(0.5)
        await asyncio.sleep(1.0)
        assert witness.false == []
        assert_no_jump(bench.heard.estimates)
        assert_covariance_grows(bench.heard.estimates)


SIGN, COMMA = (b"-", b""), (b"-500,0", b"-5000")


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("dialect", "lost"), [("streamed", SIGN), ("streamed", COMMA), ("polled", SIGN)]
)
@on_virtual_time
async def test_a_line_that_just_became_bad_is_blamed_for_a_command_that_lost_a_character(
    tmp_path: Path, dialect: str, lost: tuple[bytes, bytes]
) -> None:
    unlimited = ["limits.linear={}"]
    options = SimulationOptions(dialect=dialect)  # type: ignore[arg-type]
    async with FaultBench(tmp_path, unlimited, options) as bench:
        await bench.ready()
        await bench.drive(0.5, -0.5)
        port = bench.port
        assert port is not None
        # One answer loses its end; that alone does not make a line a noisy one.
        port._memory.on_data(b"$MAll:1,")
        write = port.write
        port.write = lambda data: write(data.replace(*lost))  # type: ignore[method-assign]
        driving = asyncio.create_task(bench.drive(2.0, -0.5))
        await bench.until(lambda: bench.controller.counters["cuts"], within_s=1.0)
        assert bench.controller.counters["noisy_cuts"]
        port.write = write  # type: ignore[method-assign]
        await driving
        assert bench.events("line_noisy")
        assert not bench.controller.fault
        assert max(bench.rim_speeds) < -0.4


@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", [4, 8, 83, 98])
@on_virtual_time
async def test_frames_that_lose_their_ends_do_not_melt_into_one_that_hangs_the_board(
    tmp_path: Path, seed: int
) -> None:
    options = SimulationOptions(seed=seed, initial_ticks=(10_000_000, 0, 10_000_000, 0))
    async with FaultBench(tmp_path, [], options) as bench:
        await bench.ready()
        await bench.drive(0.5, 0.3)
        bench.do("loss 0.2")
        await bench.drive(2.0, 0.3)
        await asyncio.sleep(3.0)
        bench.do("clear")
        await asyncio.sleep(3.0)
        assert bench.controller.state()[0] != "waiting"
        assert bench.standing


@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_true_runaway_on_a_noisy_line_is_cut_all_the_same(
    tmp_path: Path, dialect: str, seed: int
) -> None:
    options = SimulationOptions(dialect=dialect, seed=seed)  # type: ignore[arg-type]
    async with FaultBench(tmp_path, [], options) as bench:
        await bench.ready()
        await bench.drive(1.5, 0.2)
        bench.do("corruption 0.002")
        bench.do("encoder-reversed left")
        broken_ns = bench.clock.now_ns()
        driving = asyncio.create_task(bench.drive(6.0, 0.2))
        await bench.until(lambda: bench.controller.counters["cuts"], within_s=1.0)
        assert bench.clock.now_ns() - broken_ns < 250 * MS
        # It may have been the line, and is tried again; not often.
        await bench.until(lambda: bench.controller.fault, within_s=6.0)
        assert bench.controller.counters["noisy_cuts"] <= 4
        await driving
