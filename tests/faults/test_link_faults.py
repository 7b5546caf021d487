"""The line and the board fail in every way that is known: the robot stands, and comes back.

On virtual time. The same on a real pty is in ``test_link_real.py``.
"""

from __future__ import annotations

import asyncio
import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from board_bench import BoardPort
from fault_bench import (
    DIALECTS,
    MS,
    STREAMS,
    FaultBench,
    assert_no_jump,
    first_stop_ns,
    is_stop,
)
from robot_bench import state_and_why

from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.virtual_time import on_virtual_time


def robot(tmp_path: Path, *overrides: str, **simulation: object) -> FaultBench:
    return FaultBench(tmp_path, overrides, SimulationOptions(**simulation))  # type: ignore[arg-type]


def alive(bench: FaultBench) -> bool:
    """Whether nothing inside has failed."""
    return not any(task.done() for task in bench.tasks)


@on_virtual_time
async def test_a_board_whose_version_holds_escape_sequences_commands_no_terminal(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with robot(tmp_path, firmware="1.7.3\x1b[2J\x1b]0;mine\x07") as bench:
        await bench.ready()
        await asyncio.sleep(1.5)
        bench.do("brown-out 0.05")
        await bench.until(lambda: "board_reset" in bench.heard.kinds)
        await bench.ready()
        session = bench.supervisor.session
        assert session is not None
        assert session.board is not None
        assert session.board.identity.settings is not None
        version = session.board.identity.settings["version"]
        assert version is not None
        assert version.startswith("1.7.3")
        assert version.isprintable()
        assert all(event.message.isprintable() for event in bench.heard.events)
        assert all(record.getMessage().isprintable() for record in caplog.records)


# A board that is no longer heard.


SELDOM = ("odometry.poll_rate_hz=1", "odometry.publish_rate_hz=1")
"""A stream is missed as soon, however seldom a board without one would be asked."""


@pytest.mark.cases(3)
@pytest.mark.parametrize(
    "fault", ["mute 0.8", "mute 3", "babble 3", "hang", "brown-out 0.5", "reset"]
)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_unseen_wheels_are_stopped_after_300_ms_and_turn_again_once_the_board_is_heard(
    tmp_path: Path, dialect: str, fault: str
) -> None:
    async with robot(tmp_path, *(SELDOM if dialect in STREAMS else ()), dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        now_ns = bench.clock.now_ns()
        bench.do(fault)
        await bench.drive(0.6, 0.3)
        assert first_stop_ns(bench.orders_since(now_ns)) - now_ns <= 350 * MS
        if fault not in {"brown-out 0.5", "reset"}:
            state, why = state_and_why(bench.controller)
            assert state == "waiting"
            assert "No counts" in why
        # A board that listens obeys. One that hangs keeps its motors as they were.
        assert bench.standing == (fault != "hang")
        if fault == "hang":
            await asyncio.sleep(10.0)
            assert min(bench.rim_speeds) > 0.2
            assert "no board answers here" in state_and_why(bench.controller)[1]
            assert "no counts showed whether they stand" in bench.events("stop_not_seen")[0]
            bench.do("reset")
        await bench.drive(7.0, 0.3)
        assert min(bench.rim_speeds) > 0.2
        assert bench.controller.state()[0] == "driving"
        assert alive(bench)


@pytest.mark.cases(1)
@pytest.mark.parametrize("stopped_s", [None, 0.0, 0.05, 0.2])
@pytest.mark.parametrize("for_s", [0.3, 0.6, 0.8])
@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@on_virtual_time
async def test_a_dip_of_the_supply_accuses_no_wheel_of_disobeying_a_stop(
    tmp_path: Path, dialect: str, for_s: float, stopped_s: float | None
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(1.5, 0.3)
        if stopped_s is not None:
            bench.operator.engage_estop("a test")
            await asyncio.sleep(stopped_s)
        bench.do(f"brown-out {for_s}")
        await bench.drive(2.0, 0.3)
        assert "stop_not_obeyed" not in bench.heard.kinds
        # The wheels were not seen meanwhile: the motors are cut all the same.
        if for_s > 0.6:
            assert bench.controller.counters["cuts"] > 0


# A line that garbles.


@pytest.mark.cases(1)
@pytest.mark.parametrize("noise", ["loss 0.2", "loss 0.05", "corruption 0.2", "corruption 0.02"])
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_noise_may_stop_the_robot_and_raises_nothing(
    tmp_path: Path, dialect: str, noise: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        bench.do(noise)
        await bench.drive(10.0, 0.3)
        assert alive(bench)
        # Whatever became of it, the stop is heard in the end, through the noise.
        bench.operator.engage_estop("a test")
        await asyncio.sleep(3.0)
        assert bench.standing
        bench.do("clear")
        await bench.until(lambda: bench.controller.state()[0] == "estopped")
        await asyncio.sleep(3.0)
        assert bench.operator.release_estop()[0]
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) > 0.2


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_bytes_that_come_one_by_one_and_late_drive_as_well(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        bench.do("chunk 0")
        bench.do("delay 0.005 0.01")
        await bench.drive(2.0, 0.3)
        assert min(bench.rim_speeds) > 0.2
        assert set(bench.heard.kinds) == {"connected"}


class HalvingPort(BoardPort):
    """Breaks every nth line of either side off in its middle."""

    every = 0

    def __init__(self, robot: SimulatedRobot) -> None:
        super().__init__(robot)
        self._said = 0

    def _half(self, data: bytes) -> bytes:
        self._said += 1
        if not self.every or self._said % self.every:
            return data
        return data[: len(data) // 2]

    def listen(self, on_data: Callable[[bytes], None], on_lost: object) -> None:
        super().listen(lambda data: on_data(self._half(data)), on_lost)

    def write(self, data: bytes) -> None:
        super().write(self._half(data))


class HalvingBench(FaultBench):
    async def _open(self) -> BoardPort:
        self.port = HalvingPort(self.robot)
        self.ports.append(self.port)
        return self.port


@pytest.mark.cases(1)
@pytest.mark.parametrize("every", [2, 3, 7])
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_half_frames_either_way_may_stop_the_robot_and_move_nothing_that_was_not_commanded(
    tmp_path: Path, dialect: str, every: int
) -> None:
    simulation = SimulationOptions(dialect=dialect)  # type: ignore[arg-type]
    async with HalvingBench(tmp_path, (), simulation) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        assert isinstance(bench.port, HalvingPort)
        bench.port.every = every
        now_ns = bench.clock.now_ns()
        await bench.drive(3.0, 0.3)
        assert alive(bench)
        assert bench.fastest_since(now_ns) < 0.4
        assert_no_jump(bench.heard.estimates)
        bench.operator.engage_estop("a test")
        await asyncio.sleep(1.5)
        assert bench.standing
        bench.port.every = 0
        await asyncio.sleep(1.5)
        assert bench.operator.release_estop()[0]
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) > 0.2


# Resets.


# A Rosmaster's silence after a reset is long enough to end the session: see test_rosmaster.py.
HEARD_OR_NOT = [
    (dialect, announced)
    for dialect in STREAMS
    for announced in (True, False)
    if announced or dialect != "rosmaster"
]


@pytest.mark.cases(1)
@pytest.mark.parametrize(("dialect", "announced"), HEARD_OR_NOT)
@pytest.mark.parametrize("fault", ["reset", "brown-out 0.3"])
@on_virtual_time
async def test_after_a_reset_in_motion_the_robot_stands_a_second_heard_or_not(
    tmp_path: Path, fault: str, announced: bool, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3)
        if not announced:
            bench.do("mute 0.45")
        bench.do(fault)
        now_ns = bench.clock.now_ns()
        await bench.drive(4.0, 0.3)
        assert len(bench.events("board_reset")) == 1
        stop_ns = first_stop_ns(bench.orders_since(now_ns))
        moving = [at for at, order in bench.orders_since(stop_ns) if not is_stop(order)]
        # From the board's report on; the stop may have waited for the line to be free.
        assert moving[0] - stop_ns >= 980 * MS
        assert min(bench.rim_speeds) > 0.2


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_board_that_keeps_resetting_is_left_alone_until_a_person_came(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        for _ in range(3):
            await bench.drive(2.5, 0.3)
            bench.do("brown-out 0.1")
        await bench.drive(15.0, 0.3)
        assert bench.standing
        state, why = state_and_why(bench.controller)
        assert state == "fault"
        assert "reset itself 3 times" in why
        await asyncio.sleep(1.0)
        assert bench.operator.release_estop()[0]
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) > 0.2


# A port that goes away, and comes back.


# It comes back just after an attempt, at 1.51 s.
@pytest.mark.cases(2)
@pytest.mark.parametrize("away_s", [0.05, 0.5, 1.51, 3.0, 30.0])
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_after_a_replug_the_wheels_are_stopped_before_anything_else(
    tmp_path: Path, dialect: str, away_s: float
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        bench.do(f"unplug {away_s}")
        await bench.drive(away_s, 0.3)
        # The board cannot be commanded meanwhile.
        assert min(bench.rim_speeds) > 0.2
        back_ns = bench.clock.now_ns()
        await asyncio.sleep(1.5)
        orders = bench.orders_since(back_ns - 50 * MS)
        print(f"{dialect}, {away_s} s: stop {(orders[0][0] - back_ns) / MS:.0f} ms after replug")
        assert is_stop(orders[0][1])
        # The rest of the second is for a busy computer.
        assert orders[0][0] - back_ns <= 850 * MS
        assert bench.standing
        assert (bench.stood_at(back_ns) - back_ns) <= 1500 * MS
        assert alive(bench)


@pytest.mark.parametrize("code", [errno.EIO, None])
@on_virtual_time
async def test_whatever_the_kernel_calls_a_lost_port_it_is_opened_again_and_the_wheels_stopped(
    tmp_path: Path, code: int | None
) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        assert bench.port is not None
        now_ns = bench.clock.now_ns()
        # A hang-up has no number.
        bench.port._memory.on_lost(None if code is None else OSError(code, os.strerror(code)))
        await bench.drive(0.5, 0.3)
        orders = bench.orders_since(now_ns + 1)
        assert is_stop(orders[0][1])
        assert orders[0][0] - now_ns <= 200 * MS
        assert "the port went away" in bench.events("disconnected")[0]
        await bench.ready()
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) > 0.2
        assert alive(bench)


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_what_was_commanded_while_the_board_was_away_is_over_when_it_comes_back(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, "command.timeout_s=30", dialect=dialect) as bench:
        await bench.ready()
        bench.command(0.3)
        bench.do("unplug 2")
        bench.command(0.3)
        await asyncio.sleep(2.0)
        await bench.ready()
        await asyncio.sleep(2.0)
        assert bench.standing


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_a_silent_port_is_tried_for_ever_without_spinning(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        bench.do("hang")
        await asyncio.sleep(100.0)
        attempts = bench.supervisor.counters["attempts"]
        print(f"100 s of silence: {attempts} attempts")
        assert 16 < attempts < 100
        assert alive(bench)


# A port that takes nothing.


class StuckPort(BoardPort):
    """Its output is held back while ``stuck``; counts still come."""

    stuck = False

    def queued(self) -> int:
        return 20 if self.stuck else 0

    def write(self, data: bytes) -> None:
        if not self.stuck:
            super().write(data)

    async def drain(self, timeout_s: float) -> bool:
        await asyncio.sleep(timeout_s if self.stuck else 0.005)
        return not self.stuck


class StuckBench(FaultBench):
    async def _open(self) -> BoardPort:
        self.port = StuckPort(self.robot)
        self.ports.append(self.port)
        return self.port


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_port_whose_output_is_stuck_is_opened_again_and_the_wheels_stopped(
    tmp_path: Path, dialect: str
) -> None:
    simulation = SimulationOptions(dialect=dialect)  # type: ignore[arg-type]
    async with StuckBench(tmp_path, (), simulation) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        assert isinstance(bench.port, StuckPort)
        bench.port.stuck = True
        now_ns = bench.clock.now_ns()
        bench.operator.engage_estop("a test")
        await asyncio.sleep(1.5)
        stop_ns = first_stop_ns(bench.orders_since(now_ns))
        print(f"{dialect}: stop {(stop_ns - now_ns) / MS:.0f} ms after the output got stuck")
        assert stop_ns - now_ns <= 500 * MS
        assert len(bench.ports) == 2
        assert bench.standing
        assert "takes no output" in bench.events("disconnected")[0]
