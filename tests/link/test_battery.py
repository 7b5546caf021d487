"""The voltage is asked for as often as it is answered."""

from __future__ import annotations

import asyncio
import itertools

from board_bench import Bench, BoardPort

from yahboomd.link.session import SessionOptions
from yahboomd.simulation.options import ImpairmentOptions, SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time


@on_virtual_time
async def test_the_voltage_is_asked_for() -> None:
    async with Bench(options=SessionOptions(battery_period_s=1.0)) as board:
        await board.until(lambda: len(board.recorder.volts) >= 3)
        assert all(5.0 < volts < 13.0 for volts in board.recorder.volts)


class SilentBattery(Bench):
    """A board that leaves the question for its voltage unanswered."""

    async def open(self) -> BoardPort:
        port = await super().open()
        write = port.write
        self.asked_ns: list[int] = []

        def without(data: bytes) -> None:
            if data == b"$read_vol#":
                self.asked_ns.append(self.now_ns())
                port.written.append((self.now_ns(), data))
            else:
                write(data)

        port.write = without  # type: ignore[method-assign]
        return port


@on_virtual_time
async def test_a_reversal_is_on_the_wire_within_the_spacing_while_the_voltage_is_not_answered() -> (
    None
):
    worst_ns, back = 0, b"$spd:-300,0,-300,0#"
    for phase_ms in range(0, 320, 8):
        async with SilentBattery() as board:
            await board.until(lambda board=board: board.port is not None)
            await board.until(lambda board=board: board.asked_ns)
            assert board.port is not None
            board.wheels.drive((300, 0, 300, 0))
            await asyncio.sleep(phase_ms / 1000)
            commanded_ns = board.now_ns()
            board.wheels.drive((-300, 0, -300, 0))
            await board.until(lambda board=board: back in board.port.frames)
            at_ns = next(ns for ns, data in board.port.written if data == back)
            worst_ns = max(worst_ns, at_ns - commanded_ns)
    print(f"a reversal waited for {worst_ns / 1e6:.1f} ms at most")
    assert worst_ns <= 20_000_000 + 12 * BoardPort.byte_ns


@on_virtual_time
async def test_a_voltage_that_is_not_answered_is_asked_for_less_and_less_and_logged_once() -> None:
    # Whole lines at a time: five minutes of them are many.
    whole_lines = ImpairmentOptions(chunk_s=0.005)
    async with SilentBattery(SimulationOptions(impairments=whole_lines)) as board:
        await board.connected()
        await asyncio.sleep(300.0)
        waits_s = [round((b - a) / 1e9) for a, b in itertools.pairwise(board.asked_ns)]
        assert waits_s[:6] == [5, 10, 20, 40, 80, 120]
        assert [each.kind for each in board.recorder.events] == ["battery_unanswered"]
        assert "board.battery_period_s = 0" in board.recorder.events[0].message
        assert board.session.facts()["battery_unanswered"] >= 6


@on_virtual_time
async def test_a_voltage_that_is_answered_late_is_asked_for_as_often() -> None:
    async with Bench() as board:
        await board.connected()
        board.robot.impairments.change(delay_s=0.4)
        before = len(board.recorder.volts)
        await board.until(lambda: len(board.recorder.volts) >= before + 4, 30.0)
        assert board.session.facts()["answers_late"] >= 3
        assert not board.session.facts().get("battery_unanswered")
