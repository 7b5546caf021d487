"""The tools on the vendor's firmware 1.7.3: `probe`, a whole `setup`, and rest for `tape`."""

from __future__ import annotations

import asyncio
import itertools
from pathlib import Path

import pytest
from board_bench import LinkBench
from robot_bench import RobotBench
from simulated_person import FOUR, connected, set_up, true_wiring
from vendor_firmware import KINDS, MOTORS, ON_THE_FIRMWARE, STICKING, kinds, of_all

from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.simulation.options import FOUR_WHEELS, SimulationOptions, at_plug
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.calibrate.shapes import Sides
from yahboomd.tools.port.probing import examine

pytestmark = ON_THE_FIRMWARE


@on_virtual_time
async def test_probe_reads_all_that_the_board_knows_and_writes_nothing() -> None:
    board = LinkBench()
    found = await examine(board.open, board.clock, PROFILES["520"].settings)
    assert found.dialect is not None
    assert found.dialect.name == "streamed"
    assert found.settings is not None
    assert found.settings["version"] == "1.7.3"
    assert found.settings["pid"] == pytest.approx((0.8, 0.06, 0.5))
    assert found.volts == pytest.approx(7.4, abs=0.2)
    assert found.standing is True
    commands = {frame.split(b":")[0].strip(b"$#") for frame in board.frames}
    assert not commands & {b"mtype", b"deadzone", b"mline", b"mphase", b"wdiameter", b"MPID"}


@pytest.mark.parametrize("motor", kinds(6, 5))
@on_virtual_time
async def test_a_whole_setup_finds_four_wheels_however_they_are_connected(motor: str) -> None:
    plugs = (3, -1, -4, 2)
    wiring = tuple(at_plug(wire, plug) for wire, plug in zip(FOUR_WHEELS, plugs, strict=True))
    bench = LinkBench(drive="skid_steer", wiring=wiring, **KINDS[motor])
    found = await set_up(bench, FOUR)
    assert connected(found) == true_wiring(bench)
    assert found.wiring.faults == ()


@pytest.mark.parametrize(
    ("motor", "at_rest"),
    [
        *of_all(itertools.product(MOTORS, ["auto", "hold"]), every=7),
        *itertools.product(STICKING, ["auto"]),
    ],
)
@on_virtual_time
async def test_tape_sees_the_wheels_come_to_rest(tmp_path: Path, motor: str, at_rest: str) -> None:
    overrides = [f"command.at_rest={at_rest}"]
    async with RobotBench(tmp_path, overrides, SimulationOptions(**KINDS[motor])) as bench:
        await bench.ready()
        await bench.drive(1.5, 0.3)
        bench.command(0.0)
        await asyncio.sleep(1.5)
        sides = Sides(bench.config, [each.name for each in bench.config.motors()])
        first = bench.heard.estimates[-1].motor_ticks
        since = len(bench.heard.estimates)
        await asyncio.sleep(2.0)
        assert len(bench.heard.estimates) > since
        for estimate in bench.heard.estimates[since:]:
            assert not sides.moved(first, estimate.motor_ticks)
