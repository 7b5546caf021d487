"""A pulse is short, bounded by counts or by time, and an output: never a speed."""

from __future__ import annotations

import asyncio
import itertools
import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest
from board_bench import LinkBench

from yahboomd.core.errors import BoardError
from yahboomd.core.link import handshake
from yahboomd.core.link.conversation import Conversation
from yahboomd.core.link.line import Line
from yahboomd.core.model import NS_PER_S
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.simulation.motors import FAULTS, MotorFaults, joined
from yahboomd.simulation.options import FOUR_WHEELS
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.port.board_questions import read_counters
from yahboomd.tools.port.pulses import LONGEST_S, SHOWN_TURNS, STEPS, Pulse, Pulses

TICKS = 1320.0
FASTEST = 200.0 / 19.0
HALF_TURN_M = 3.141592653589793 * 0.0335


@asynccontextmanager
async def pulses_on(board: LinkBench, **more: Any) -> AsyncIterator[tuple[Pulses, Line]]:
    line = Line(await board.open(), board.clock, resend_s=0.1)
    async with line.attended():
        talk = await Conversation.begin(line)
        await read_counters(talk)
        await handshake.await_reports(line, talk.dialect)
        options = {"ticks_per_revolution": TICKS, "fastest_turns_per_s": FASTEST, **more}
        stored = await talk.read_settings(PROFILES["520"].settings) or {}
        yield Pulses(line, talk.dialect, stored, **options), line


class Watched:
    """The truth of every pulse: how long it was driven, and how far each wheel rolled."""

    def __init__(self, board: LinkBench) -> None:
        self.driven_s: list[float] = []
        self.rolled_m: list[list[float]] = []
        self._plant = board.robot.plant
        self._board = board
        self._began_ns: int | None = None
        self._before: list[float] = []
        board.robot.on_truth = lambda sample: self._look(sample.t_ns)

    def mark(self, on: bool) -> None:
        travel = [motor.travel_m for motor in self._plant.motors]
        if on:
            self._before = travel
        else:
            rolled = [abs(new - old) for new, old in zip(travel, self._before, strict=True)]
            self.rolled_m.append(rolled)

    def _look(self, now_ns: int) -> None:
        driven = any(motor.pwm for motor in self._plant.motors)
        if driven and self._began_ns is None:
            self._began_ns = now_ns
        elif not driven and self._began_ns is not None:
            self.driven_s.append((now_ns - self._began_ns) / NS_PER_S)
            self._began_ns = None


def stands(board: LinkBench) -> bool:
    motors = board.robot.plant.motors
    return all(motor.pwm == 0 and abs(motor.speed_m_s) < 0.03 for motor in motors)


async def broken(board: LinkBench, breaks: Callable[[int], None]) -> None:
    """Turn a motor, after something happened to the robot."""
    async with pulses_on(board) as (pulses, _):
        breaks(board.clock.now_ns())
        await pulses.turn(1)


async def shown(pulses: Pulses, position: int) -> Pulse:
    """The pulse that turned a wheel, after a person saw that weaker ones did not."""
    pulse = await pulses.turn(position)
    return pulse if pulse.turns >= SHOWN_TURNS else await pulses.turn_stronger(position)


@pytest.mark.parametrize("car_type", [0, 3])
@on_virtual_time
async def test_a_wheel_of_a_board_that_ignores_a_cut_is_stopped(car_type: int) -> None:
    board = LinkBench(dialect="rosmaster", flash=RosmasterStored(car_type=car_type))
    async with pulses_on(board) as (pulses, _):
        pulse = await pulses.turn(1)
        while pulse.turns < SHOWN_TURNS:
            pulse = await pulses.turn_stronger(1)
        assert max(map(abs, board.rim_speeds)) < 0.03


@pytest.mark.parametrize("dialect", ["streamed", "rosmaster"])
@on_virtual_time
async def test_one_wheel_turns_visibly_and_by_half_a_turn_at_most(dialect: str) -> None:
    board = LinkBench(dialect=dialect, drive="skid_steer", wiring=FOUR_WHEELS)
    watched = Watched(board)
    async with pulses_on(board, on_pulse=watched.mark) as (pulses, _):
        for position in (1, 2, 3, 4):
            pulse = await shown(pulses, position)
            assert pulse.turns >= SHOWN_TURNS
            assert [abs(count) > 100 for count in pulse.counts] == [
                each == position for each in (1, 2, 3, 4)
            ]
            assert stands(board)
            assert max(watched.rolled_m[-1]) > HALF_TURN_M / 8.0
    assert max(map(max, watched.rolled_m)) <= HALF_TURN_M
    assert max(watched.driven_s) <= LONGEST_S + 0.05


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", ["streamed", "rosmaster"])
@on_virtual_time
async def test_a_fast_wheel_is_ended_by_its_counts_before_half_a_turn(dialect: str) -> None:
    board = LinkBench(dialect=dialect, max_speed_m_s=2.4)
    watched = Watched(board)
    async with pulses_on(board, on_pulse=watched.mark) as (pulses, _):
        await pulses.turn(1)
    assert HALF_TURN_M / 4.0 < max(watched.rolled_m[-1]) <= HALF_TURN_M
    # By time it would have been driven for longer.
    assert watched.driven_s[-1] < 0.4


@pytest.mark.cases(1)
@pytest.mark.parametrize("ratio", [19.0, 30.0, 56.0])
@on_virtual_time
async def test_an_advance_comes_to_its_counts_in_pulses_of_half_a_turn_at_most(
    ratio: float,
) -> None:
    board = LinkBench(ratio=ratio)
    watched = Watched(board)
    more = {"on_pulse": watched.mark, "ticks_per_revolution": 44.0 * 56.0, "least_ticks": 836.0}
    async with pulses_on(board, **more) as (pulses, _):
        await shown(pulses, 1)
        await shown(pulses, 3)
        counts = await pulses.advance({1: 1}, 600.0)
        # A fast wheel is not driven closer than it rolls.
        assert 400 < counts[0] <= 660
        assert counts[2] == 0
        both = await pulses.advance({1: -1, 3: 1}, 200.0)
        assert both[0] < -150 < 150 < both[2]
        assert max(map(abs, await pulses.advance({1: 1}, 1e6))) <= 836.0
    assert max(map(max, watched.rolled_m)) <= HALF_TURN_M


@on_virtual_time
async def test_an_advance_of_a_motor_that_does_not_turn_ends() -> None:
    board = LinkBench()
    board.robot.start(round(asyncio.get_running_loop().time() * NS_PER_S))
    board.robot.set_faults("all", FAULTS["stalled"], now_ns=0)
    async with pulses_on(board) as (pulses, _):
        assert max(map(abs, await pulses.advance({1: 1, 3: 1}, 300.0))) < 20


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", ["streamed", "rosmaster"])
@pytest.mark.parametrize("speed_m_s", [0.4, 1.15, 1.4])
@on_virtual_time
async def test_without_counts_a_pulse_ends_by_time_before_half_a_turn(
    dialect: str, speed_m_s: float
) -> None:
    board = LinkBench(dialect=dialect, max_speed_m_s=speed_m_s, time_constant_s=0.02)
    board.robot.start(round(asyncio.get_running_loop().time() * NS_PER_S))
    board.robot.set_faults("all", FAULTS["encoder-dead"], now_ns=0)
    watched = Watched(board)
    async with pulses_on(board, on_pulse=watched.mark) as (pulses, _):
        pulse = await pulses.turn(1)
        assert pulse.counts == (0, 0, 0, 0)
        assert max(map(max, watched.rolled_m)) <= HALF_TURN_M
        assert sum(map(max, watched.rolled_m)) <= 2.0 * HALF_TURN_M
        if speed_m_s > 1.0:
            # Ten degrees: it can be seen. A slow motor hardly moves within the bound.
            assert max(map(max, watched.rolled_m)) > HALF_TURN_M / 18.0
        assert max(watched.driven_s) <= LONGEST_S + 0.05
        assert stands(board)


@pytest.mark.nightly
@on_virtual_time
async def test_counts_that_stop_within_a_pulse_end_it_before_half_a_turn() -> None:
    more = {"ticks_per_revolution": 44.0 * 56.0, "least_ticks": 836.0}
    for moment in range(0, 40, 3):
        # A slow start: the counters move long before the wheel is fast.
        board = LinkBench(
            max_speed_m_s=1.33, motor_dead_zone=1476, time_constant_s=0.23, ratio=19.0
        )
        watched = Watched(board)
        async with pulses_on(board, on_pulse=watched.mark, **more) as (pulses, _):
            await pulses.turn(1)
            board.robot.after(
                board.clock.now_ns() + moment * NS_PER_S // 50,
                lambda at_ns, board=board: board.robot.set_faults(
                    "all", FAULTS["encoder-dead"], now_ns=at_ns
                ),
            )
            await pulses.advance({1: 1}, pulses.most_counts)
        assert max(map(max, watched.rolled_m)) <= HALF_TURN_M
        assert stands(board)


@pytest.mark.cases(1)
@pytest.mark.parametrize("fault", ["encoder-reversed", "phases-swapped", "mounted-round"])
@on_virtual_time
async def test_a_wheel_that_would_run_away_is_only_pulsed_and_never_sent_a_speed(
    fault: str,
) -> None:
    board = LinkBench()
    board.robot.start(round(asyncio.get_running_loop().time() * NS_PER_S))
    board.robot.set_faults("left", FAULTS[fault], now_ns=0)
    watched = Watched(board)
    async with pulses_on(board, on_pulse=watched.mark) as (pulses, _):
        pulse = await pulses.turn(1)
    assert abs(pulse.counts[0]) > 100
    assert max(map(max, watched.rolled_m)) <= HALF_TURN_M
    assert stands(board)
    speeds = [frame for frame in board.frames if re.match(rb"\$sp(ee)?d:", frame)]
    assert set(speeds) <= {b"$speed:0,0,0,0#"}


@on_virtual_time
async def test_it_starts_small_and_the_next_motor_a_little_below_the_last() -> None:
    board = LinkBench()
    async with pulses_on(board) as (pulses, _):
        await pulses.turn(1)
        first = [frame for frame in board.frames if re.match(rb"\$pwm:[1-9]", frame)]
        least = next(share for share in STEPS if share * 3600 > 1600)
        assert first[0] == b"$pwm:%d,0,0,0#" % (round(least * 3600) - 1600)
        moved = first[-1]
        await pulses.turn(3)
    later = [frame for frame in board.frames if re.match(rb"\$pwm:0,0,[1-9]", frame)]
    assert int(later[0].split(b",")[2]) <= int(moved.split(b":")[1].split(b",")[0])


@on_virtual_time
async def test_lost_frames_leave_no_wheel_turning() -> None:
    for seed in range(2):
        board = LinkBench(seed=seed)
        async with pulses_on(board) as (pulses, _):
            board.robot.impairments.change(loss=0.02)
            for position in (1, 3):
                await pulses.turn(position)
                assert stands(board)


@on_virtual_time
async def test_a_wheel_that_turns_by_itself_is_named_and_nothing_is_driven() -> None:
    board = LinkBench()

    def breaks(now_ns: int) -> None:
        board.robot.set_faults("right", FAULTS["turning"], now_ns=now_ns)

    with pytest.raises(BoardError, match="a wheel turns"):
        await broken(board, breaks)
    assert not any(re.match(rb"\$pwm:[1-9]", frame) for frame in board.frames)


@on_virtual_time
async def test_a_board_that_resets_itself_under_load_has_too_weak_a_supply() -> None:
    board = LinkBench()

    def breaks(now_ns: int) -> None:
        board.robot.after(now_ns + NS_PER_S // 2, board.robot.brown_out)

    with pytest.raises(BoardError, match="supply is too weak"):
        await broken(board, breaks)
    assert stands(board)


@on_virtual_time
async def test_counters_that_stop_end_the_pulse() -> None:
    board = LinkBench()

    def breaks(now_ns: int) -> None:
        board.robot.after(now_ns + NS_PER_S // 5, lambda at_ns: board.robot.mute(at_ns, 60.0))

    with pytest.raises(BoardError, match="M1 was let go, and no counts come"):
        await broken(board, breaks)
    assert stands(board)


@on_virtual_time
async def test_a_computer_that_stood_still_as_a_motor_was_let_go_blames_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    board, loop = LinkBench(), asyncio.get_running_loop()
    async with pulses_on(board) as (pulses, line):
        reset = line.watch.reset

        def reset_and_stand_still() -> None:
            reset()
            loop.call_soon(loop.freeze, 4.0)

        monkeypatch.setattr(line.watch, "reset", reset_and_stand_still)
        assert (await pulses.turn(1)).turns >= SHOWN_TURNS
        monkeypatch.undo()
    assert stands(board)


@on_virtual_time
async def test_cancelled_at_any_moment_it_leaves_the_wheels_at_rest() -> None:
    for tenths in range(1, 40, 9):
        board = LinkBench()
        board.robot.start(round(asyncio.get_running_loop().time() * NS_PER_S))
        faults = joined(FAULTS["encoder-reversed"], MotorFaults())
        board.robot.set_faults("left", faults, now_ns=board.clock.now_ns())

        async def turned(board: LinkBench = board) -> None:
            async with pulses_on(board) as (pulses, _):
                while True:
                    await pulses.turn(1)

        task = asyncio.ensure_future(turned())
        await asyncio.sleep(tenths / 10.0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await asyncio.sleep(1.0)
        board.robot.advance(board.clock.now_ns())
        assert stands(board)


def stiff_robot(friction: float, stick: float, volts: float, **motor: float) -> LinkBench:
    """A motor by its friction as a share of full output at 12 V."""
    return LinkBench(
        motor_dead_zone=round(friction * 3600),
        sticks=(stick,),
        battery_volts=volts,
        rated_volts=12.0,
        **motor,
    )


QUICK, SLOW = {"time_constant_s": 0.06, "max_speed_m_s": 1.93}, {"time_constant_s": 0.3}


@pytest.mark.parametrize(
    ("friction", "stick", "volts", "motor", "dead"),
    [
        (0.47, 1.6, 12.0, QUICK, False),
        (0.47, 1.6, 12.0, QUICK, True),
        (0.40, 1.6, 10.5, SLOW, False),
        *(
            pytest.param(*case, marks=pytest.mark.nightly)
            for case in itertools.product(
                (0.40, 0.47), (1.3, 1.6), (10.5, 12.0), ({}, QUICK, SLOW), (False, True)
            )
        ),
    ],
)
@on_virtual_time
async def test_a_motor_that_sticks_turns_with_more_output_within_the_same_bounds(
    friction: float, stick: float, volts: float, motor: dict[str, float], dead: bool
) -> None:
    board = stiff_robot(friction, stick, volts, **motor)
    board.robot.start(board.now_ns)
    if dead:
        board.robot.set_faults("all", FAULTS["encoder-dead"], now_ns=board.now_ns)
    watched = Watched(board)
    turn_m = 2.0 * HALF_TURN_M
    async with pulses_on(board, on_pulse=watched.mark) as (pulses, _):
        pulse = await pulses.turn(1)
        rolled = 0.0
        while pulse.turns < SHOWN_TURNS and rolled < 0.003 and pulses.has_stronger(1):
            number = len(watched.rolled_m)
            pulse = await pulses.turn_stronger(1)
            rolled = sum(map(max, watched.rolled_m[number:]))
            assert rolled <= turn_m
    assert max(map(max, watched.rolled_m)) <= HALF_TURN_M
    assert (pulse.turns >= SHOWN_TURNS) != dead
    # A person sees three millimetres.
    assert max(map(max, watched.rolled_m)) > 0.001


@on_virtual_time
async def test_a_wheel_that_needed_more_output_has_it_in_an_advance() -> None:
    for stick, strongest in ((1.6, 0.66), (1.0, 0.48)):
        board = stiff_robot(0.4, stick, 12.0)
        async with pulses_on(board) as (pulses, _):
            if (await pulses.turn(1)).turns < SHOWN_TURNS:
                assert (await pulses.turn_stronger(1)).output == round(strongest * 3600)
            counts = await pulses.advance({1: 1}, 0.5 * TICKS)
        # It leaps when it breaks away, and may roll past what is left.
        assert 0.35 * TICKS < counts[0] < 0.55 * TICKS


@on_virtual_time
async def test_full_output_is_the_last_that_a_dead_motor_gets() -> None:
    board = LinkBench()
    board.robot.start(board.now_ns)
    board.robot.set_faults("all", FAULTS["motor-dead"], now_ns=board.now_ns)
    async with pulses_on(board) as (pulses, _):
        await pulses.turn(1)
        while pulses.has_stronger(1):
            pulse = await pulses.turn_stronger(1)
        assert pulse.output == 3600
        # Repaired, it is tried as at first.
        await pulses.turn(1)
        assert pulses.has_stronger(1)
