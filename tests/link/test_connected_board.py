"""A board that takes commands, and its reports."""

from __future__ import annotations

import asyncio
import itertools

import pytest
from board_bench import Bench, BoardPort

from yahboomd.core.link import connected_board
from yahboomd.core.link.line import DAMAGES_MOST, NOISY_DAMAGES
from yahboomd.core.link.session import SessionOptions
from yahboomd.simulation.options import ImpairmentOptions, SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time


@on_virtual_time
async def test_after_a_rest_a_speed_waits_for_an_answer_not_for_the_next_question() -> None:
    async with Bench(SimulationOptions(dialect="polled")) as board:
        await board.connected()
        assert board.port is not None
        for phase_ms in (0, 9, 18):
            board.wheels.drive((0, 0, 0, 0))
            await asyncio.sleep(2.0)
            asked = len(board.port.written)
            await board.until(lambda asked=asked: len(board.port.written) > asked)
            await asyncio.sleep(phase_ms * 1e-3)
            commanded_ns, sent = board.now_ns(), len(board.port.written)
            board.wheels.drive((200, 0, 200, 0))
            await asyncio.sleep(0.02)
            speeds = [ns for ns, frame in board.port.written[sent:] if b"$speed:2" in frame]
            assert speeds[0] - commanded_ns < 6_000_000


@on_virtual_time
async def test_a_board_that_resets_is_noticed_and_armed_again() -> None:
    async with Bench() as board:
        await board.connected()
        board.robot.reset(board.now_ns())
        await board.until(lambda: board.recorder.resets)
        count = len(board.recorder.readings)
        await board.until(lambda: len(board.recorder.readings) > count + 10)
        assert board.recorder.readings[count].after_reset
        assert sum(each.after_reset for each in board.recorder.readings) == 1


@on_virtual_time
async def test_the_listener_hears_of_the_end_once_the_brake_is_on_the_wire() -> None:
    board = Bench()
    said: list[bytes] = []

    def leaving() -> None:
        assert board.port is not None
        said.extend(board.port.frames[frames:])

    board.recorder.leaving = leaving  # type: ignore[method-assign]
    async with board:
        await board.connected()
        assert board.port is not None
        frames = len(board.port.frames)
    assert b"$spd:0,0,0,0#" in said
    assert b"$pwm:0,0,0,0#" not in said


@on_virtual_time
async def test_a_stop_is_sent_once_no_part_of_it_waits_in_the_kernel() -> None:
    async with Bench() as board:
        await board.connected()
        assert board.port is not None
        board.wheels.drive((300, 0, 300, 0))
        await asyncio.sleep(0.1)
        assert not board.wheels.stop_sent
        board.wheels.brake()
        await board.until(lambda: board.wheels.stop_sent)
        board.port.waiting = 5  # of the 13 that were written
        assert not board.wheels.stop_sent


@on_virtual_time
async def test_on_a_noisy_line_a_speed_is_repeated_more_often_until_the_noise_is_over() -> None:
    async with Bench() as board:
        await board.connected()
        assert board.port is not None
        board.wheels.drive((300, 0, 300, 0))

        async def sent_in_a_second() -> int:
            before = board.session.status_values().get("velocities_sent", 0)
            await asyncio.sleep(1.0)
            return board.session.status_values().get("velocities_sent", 0) - before

        assert await sent_in_a_second() <= 11
        for _ in range(NOISY_DAMAGES):
            assert not board.wheels.noisy
            board.port._memory.on_data(b"$MAll:1,$")
        assert (board.wheels.damages, board.wheels.noisy) == (NOISY_DAMAGES, True)
        assert await sent_in_a_second() >= 25
        assert board.port.written[-1][1] == b"\n" * 64 + b"$spd:300,0,300,0#"
        for _ in range(DAMAGES_MOST):
            board.port._memory.on_data(b"$MAll:1,$")
        assert board.wheels.damages == DAMAGES_MOST
        await asyncio.sleep(9.9)
        assert board.wheels.noisy
        await asyncio.sleep(0.2)
        assert (board.wheels.damages, board.wheels.noisy) == (0, False)
        assert await sent_in_a_second() <= 11


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
    for phase_ms in range(0, 320, 40):
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
async def test_a_voltage_that_is_not_answered_is_asked_for_less_and_less_and_logged_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert connected_board.BATTERY_SELDOM_S == 120.0
    # Minutes of lines are many.
    monkeypatch.setattr(connected_board, "BATTERY_SELDOM_S", 3.0)
    whole_lines = SimulationOptions(impairments=ImpairmentOptions(chunk_s=0.005))
    async with SilentBattery(whole_lines, SessionOptions(battery_period_s=1.0)) as board:
        await board.connected()
        await asyncio.sleep(20.0)
        waits_s = [round((b - a) / 1e9) for a, b in itertools.pairwise(board.asked_ns)]
        assert waits_s[:4] == [1, 2, 3, 3]
        assert [each.kind for each in board.recorder.events] == ["battery_unanswered"]
        assert "board.battery_period_s = 0" in board.recorder.events[0].message
        assert board.session.status_values()["battery_unanswered"] >= 5


@on_virtual_time
async def test_a_voltage_that_is_answered_late_is_asked_for_as_often() -> None:
    async with Bench(options=SessionOptions(battery_period_s=1.0)) as board:
        await board.connected()
        board.robot.impairments.change(delay_s=0.4)
        before = len(board.recorder.volts)
        await board.until(lambda: len(board.recorder.volts) >= before + 4, 30.0)
        assert board.session.status_values()["answers_late"] >= 3
        assert not board.session.status_values().get("battery_unanswered")
