"""The last words on a port."""

from __future__ import annotations

import asyncio

import pytest
from board_bench import BoardPort

from yahboomd.clock import LoopClock
from yahboomd.link.standstill import StandstillWatch
from yahboomd.link.stopping import StopReport, bring_to_rest, stop_unidentified, undisturbed
from yahboomd.protocol.registry import DIALECTS
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.virtual_time import on_virtual_time

CUT = b"$pwm:0,0,0,0#"
BRAKE = b"$spd:0,0,0,0#"


@on_virtual_time
async def test_a_board_that_nobody_knows_is_told_both_stops_after_a_resync() -> None:
    port = BoardPort(SimulatedRobot())
    await stop_unidentified(port, LoopClock())
    assert [data for _, data in port.written] == [b"\n" * 64, CUT, b"$speed:0,0,0,0#"]
    port.close()


@pytest.mark.parametrize(("let_go", "first"), [(False, BRAKE), (True, CUT)])
@on_virtual_time
async def test_motors_that_were_let_go_are_not_braked_again(let_go: bool, first: bytes) -> None:
    port = BoardPort(SimulatedRobot())
    report = await bring_to_rest(
        port, LoopClock(), DIALECTS["streamed"], StandstillWatch(190.0), let_go=let_go
    )
    assert port.frames[0] == first
    assert (BRAKE in port.frames) is not let_go
    assert port.frames[-3:] == [CUT, CUT, b"$upload:0,0,0#"]
    # Nobody passed the counters on.
    assert report.stood is None
    assert report.doubt == "no counts showed whether they stand"
    port.close()


@pytest.mark.parametrize(
    ("stood", "flushed", "doubt"),
    [
        (True, True, None),
        (True, False, "the port did not take all of it"),
        (None, True, "no counts showed whether they stand"),
        (False, True, "they still turned when the motors were let go"),
    ],
)
def test_what_was_not_seen_is_doubted(stood: bool | None, flushed: bool, doubt: str | None) -> None:
    report = StopReport(stood=stood, cut=False, flushed=flushed, took_s=0.1, brakes=1)
    assert report.doubt == doubt


@on_virtual_time
async def test_a_stop_is_finished_however_often_whoever_waits_is_cancelled() -> None:
    done = asyncio.Event()

    async def stop() -> None:
        await asyncio.sleep(1.0)
        done.set()

    waiting = asyncio.create_task(undisturbed(stop()))
    for _ in range(5):
        await asyncio.sleep(0.1)
        waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    assert done.is_set()


@on_virtual_time
async def test_a_stop_that_fails_says_so() -> None:
    async def stop() -> None:
        raise OSError("gone")

    with pytest.raises(OSError, match="gone"):
        await undisturbed(stop())
