"""--undo stores the saved values, once, and only on their own board."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import msgspec
import pytest
from tuning_bench import TuningBench

from yahboomd.core.errors import Refused
from yahboomd.core.link.storing import store
from yahboomd.core.protocol.settings import VERSION, BoardSettings
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.tune.saved import SavedSettings, read_saved, save
from yahboomd.tools.tune.undo import undo

WAS = SavedSettings(
    made="2026-05-04 10:00:00",
    port="/dev/simulated",
    dialect="streamed",
    settings={"pid": (0.5, 0.05, 0.0), "deadzone": 1234},
)


async def stored(bench: TuningBench) -> BoardSettings:
    found = await store(bench.link.open, bench.link.clock, {})
    return {name: value for name, value in found.has.items() if name != VERSION}


@on_virtual_time
async def test_the_board_has_what_was_saved_and_no_wheel_turned(tmp_path, capsys) -> None:
    bench, path = TuningBench(), tmp_path / "board.json"
    save(path, WAS)
    assert await undo(bench.link.open, bench.link.clock, path, as_json=False) == 0
    flash = bench.link.robot.board.flash
    assert (flash.p, flash.i, flash.d, flash.dead_zone) == (0.5, 0.05, 0.0, 1234)
    assert "Values written: 2." in capsys.readouterr().out
    assert read_saved(path) is None
    assert not any(motor.travel_m for motor in bench.link.robot.plant.motors)


@pytest.mark.cases(3)
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("want", [{"pid": (0.9, 0.1, 0.0)}, {"deadzone": 1900}])
@on_virtual_time
async def test_all_that_a_loss_of_power_within_a_write_took_is_restored(
    tmp_path, capsys, want, seed
) -> None:
    bench, path = TuningBench(options={"seed": seed}), tmp_path / "board.json"
    board = bench.link.robot.board
    # An erased page leaves what the board was sold with.
    before = board.flash = msgspec.structs.replace(board.flash, p=0.7)
    save(path, msgspec.structs.replace(WAS, settings=await stored(bench)))
    board.cut_writes = 1
    # As of a tuning that was killed at this moment.
    writing = asyncio.create_task(store(bench.link.open, bench.link.clock, want))
    while board.cut_writes:
        await asyncio.sleep(0.001)
    writing.cancel()
    with suppress(asyncio.CancelledError):
        await writing
    await asyncio.sleep(1.0)
    assert before != board.flash
    assert await undo(bench.link.open, bench.link.clock, path, as_json=False) == 0
    assert board.flash == before
    assert read_saved(path) is None
    assert "gains" not in capsys.readouterr().out


@on_virtual_time
async def test_what_was_stored_otherwise_since_then_is_left_alone(tmp_path) -> None:
    bench, path = TuningBench(), tmp_path / "board.json"
    save(path, msgspec.structs.replace(WAS, settings=await stored(bench)))
    await store(bench.link.open, bench.link.clock, {"lines": 13, "deadzone": 1900})
    assert await undo(bench.link.open, bench.link.clock, path, as_json=False) == 0
    assert await stored(bench) == {**await stored(TuningBench()), "lines": 13}


@on_virtual_time
async def test_another_kind_of_board_is_refused_and_the_file_stays(tmp_path) -> None:
    bench, path = TuningBench("x1"), tmp_path / "board.json"
    bench.link.robot.start(bench.link.clock.now_ns())
    save(path, WAS)
    with pytest.raises(Refused, match="are those of a streamed board"):
        await undo(bench.link.open, bench.link.clock, path, as_json=False)
    assert read_saved(path) == WAS
