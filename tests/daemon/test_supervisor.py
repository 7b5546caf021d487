"""Reconnecting, for ever; the profile on the board before a session."""

from __future__ import annotations

import asyncio
import errno
import logging
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from board_bench import LinkBench
from robot_bench import RobotBench

from yahboomd.core.daemon.supervisor import BACK_OFF_S, Supervisor, storing_opener
from yahboomd.core.drive.standing import why
from yahboomd.core.errors import (
    LinkError,
    PortDenied,
    PortLost,
    PortMissing,
    YahboomdError,
)
from yahboomd.core.model import Event
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time

ON = "board.write_settings=true"
UNFIT = SimulationOptions(flash=FlashContent(lines=0))


@on_virtual_time
async def test_a_board_set_up_for_other_motors_is_set_up_and_driven(tmp_path: Path) -> None:
    async with RobotBench(tmp_path, [ON], UNFIT) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) == pytest.approx(0.3, abs=0.03)
        stored = [each.message for each in bench.heard.events if each.kind == "setting_stored"]
        assert [words.partition(" in ")[0] for words in stored] == [
            "Stored dead zone 1900",
            "Stored encoder lines 11",
        ]


@on_virtual_time
async def test_the_type_of_motor_or_car_is_never_stored_on_connecting(tmp_path: Path) -> None:
    other = SimulationOptions(flash=FlashContent(motor_type=2, lines=0))
    async with RobotBench(tmp_path, [ON], other) as bench:
        await bench.until(lambda: bench.heard.kinds.count("setting_stored") == 2)
        await bench.drive(0.5, 0.3)
        assert bench.standing
        assert "motor type 2" in why(bench.controller.state()[1])
        flash: FlashContent = bench.robot.board.flash  # type: ignore[attr-defined]
        assert (flash.motor_type, flash.lines) == (2, 11)


@on_virtual_time
async def test_unless_it_is_allowed_nothing_is_written(tmp_path: Path) -> None:
    async with RobotBench(tmp_path, [], UNFIT) as bench:
        await bench.until(lambda: bench.heard.estimates)
        await bench.drive(0.5, 0.3)
        assert bench.standing
        assert bench.controller.state()[0] == "fault"
        assert bench.robot.board.flash == UNFIT.flash  # type: ignore[attr-defined]


@on_virtual_time
async def test_what_is_stored_already_is_not_written_again(tmp_path: Path) -> None:
    async with RobotBench(tmp_path, [ON], UNFIT) as bench:
        await bench.ready()
        bench.robot.unplug(bench.clock.now_ns(), 0.3)
        await bench.until(lambda: bench.controller.state()[0] == "waiting")
        await bench.ready()
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) == pytest.approx(0.3, abs=0.03)
        assert bench.heard.kinds.count("setting_stored") == 2


@on_virtual_time
async def test_a_usb_error_in_motion_stops_the_wheels_on_the_new_port_until_a_new_command(
    tmp_path: Path,
) -> None:
    """Interference: EPROTO, and the same board is back under another name at once."""
    # The command of before is still fresh when the board is ready again.
    async with RobotBench(tmp_path, ["command.timeout_s=5"]) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        before, lost_ns = bench.port, bench.clock.now_ns()
        assert before is not None
        before._memory._lose(OSError(errno.EPROTO, os.strerror(errno.EPROTO)))
        await bench.until(lambda: bench.port is not before and any(bench.frames))
        assert bench.port is not None
        assert bench.port.written[0][0] - lost_ns < 300_000_000
        assert min(bench.rim_speeds) > 0.2
        # After a line's end, which closes what the interference cut.
        assert bench.frames == [b"", b"$pwm:0,0,0,0#"]
        await bench.until(lambda: bench.standing, within_s=0.5)
        await bench.ready()
        await asyncio.sleep(1.0)
        assert bench.standing
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) == pytest.approx(0.3, abs=0.03)


@on_virtual_time
async def test_a_value_that_the_board_refuses_is_reported_and_the_port_opened(
    tmp_path: Path,
) -> None:
    board = LinkBench()
    board.on_write = lambda data: data.replace(b"$deadzone:1900#", b"$deadzone:19#")
    events: list[Event] = []
    opener = storing_opener(board.open, board.clock, PROFILES["520"].settings, events.append)
    port = await opener()
    assert [each.kind for each in events] == ["setting_not_stored"]
    assert "dead zone 1900" in events[0].message
    port.close()
    await asyncio.sleep(0)


class Missing:
    """A session that finds no port."""

    board: object | None = None
    recognised = False

    def __init__(self, error: Callable[[], LinkError] | None = None) -> None:
        self._error = error or (lambda: PortMissing("/dev/x: there is no such port."))

    async def run(self) -> None:
        raise self._error()

    left_standing: bool | None = None

    def status_values(self) -> dict[str, int]:
        return {"bytes": 1}


class Attempts:
    """Makes sessions, and notes when."""

    def __init__(self, kind: type[Missing]) -> None:
        self._kind = kind
        self.began_ns: list[int] = []

    def __call__(self) -> Missing:
        self.began_ns.append(LoopClock().now_ns())
        return self._kind()


def ignore(_error: YahboomdError) -> None:
    pass


async def run_for(supervisor: Supervisor, for_s: float) -> None:
    task = asyncio.create_task(supervisor.run())
    await asyncio.sleep(for_s)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


@on_virtual_time
async def test_a_missing_port_is_looked_for_with_bounded_back_off_for_ever() -> None:
    sessions = Attempts(Missing)
    supervisor = Supervisor(sessions, LoopClock(), ignore)  # type: ignore[arg-type]
    await run_for(supervisor, 600.0)
    waits = [b - a for a, b in zip(sessions.began_ns, sessions.began_ns[1:], strict=False)]
    assert waits[: len(BACK_OFF_S)] == pytest.approx([s * 1e9 for s in BACK_OFF_S], rel=1e-6)
    assert max(waits) <= BACK_OFF_S[-1] * 1e9 * 1.000001
    # About one attempt a second: no spinning, and no giving up.
    assert 740 < len(sessions.began_ns) < 760


def test_the_same_fault_is_logged_once_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    @on_virtual_time
    async def scene() -> Supervisor:
        supervisor = Supervisor(Missing, LoopClock(), ignore)  # type: ignore[arg-type]
        await run_for(supervisor, 3600.0)
        return supervisor

    with caplog.at_level(logging.INFO, logger="yahboomd"):
        supervisor = scene()
    assert caplog.text.count("no such port") == 1
    assert supervisor.counters["repeated_faults"] > 3000


def test_a_port_that_udev_has_not_yet_handed_over_is_no_news(
    caplog: pytest.LogCaptureFixture,
) -> None:
    errors: list[LinkError] = [
        PortMissing("/dev/x: there is no such port."),
        PortDenied("/dev/x: this user may not open the port."),
    ]

    @on_virtual_time
    async def scene(more: list[LinkError]) -> None:
        answers = [*errors, *more]
        sessions = Missing(lambda: answers.pop(0) if answers else errors[0])
        supervisor = Supervisor(lambda: sessions, LoopClock(), ignore)  # type: ignore[arg-type, return-value]
        await run_for(supervisor, 10.0)

    with caplog.at_level(logging.INFO, logger="yahboomd"):
        scene([])
    assert "may not open" not in caplog.text
    with caplog.at_level(logging.INFO, logger="yahboomd"):
        scene([errors[1]])
    assert caplog.text.count("may not open") == 1


@on_virtual_time
async def test_after_a_good_session_the_next_attempt_comes_soon() -> None:
    class Steady(Missing):
        board = object()

        async def run(self) -> None:
            await asyncio.sleep(10.0)
            raise PortLost("/dev/x: the port went away.")

    sessions = Attempts(Steady)
    await run_for(Supervisor(sessions, LoopClock(), ignore), 35.0)  # type: ignore[arg-type]
    gaps = [b - a for a, b in zip(sessions.began_ns, sessions.began_ns[1:], strict=False)]
    assert all(gap < 10.2e9 for gap in gaps)


@on_virtual_time
async def test_a_port_that_goes_away_while_it_is_asked_to_end_does_not_keep_it() -> None:
    class Losing(Missing):
        async def run(self) -> None:
            try:
                await asyncio.sleep(1000.0)
            except asyncio.CancelledError:
                # A task group does this to a cancellation that an error overtakes.
                raise PortLost("/dev/x: the port went away.") from None

    task = asyncio.create_task(
        Supervisor(Losing, LoopClock(), ignore).run()  # type: ignore[arg-type]
    )
    await asyncio.sleep(1.0)
    task.cancel()
    done, _ = await asyncio.wait([task], timeout=1.0)
    assert done
    assert task.cancelled()


@on_virtual_time
async def test_the_counters_of_ended_sessions_are_kept() -> None:
    supervisor = Supervisor(Missing, LoopClock(), ignore)  # type: ignore[arg-type]
    await run_for(supervisor, 10.0)
    assert supervisor.status_values()["bytes"] == supervisor.counters["attempts"]


@on_virtual_time
async def test_an_error_of_the_program_is_not_retried() -> None:
    def broken() -> LinkError:
        raise ZeroDivisionError

    supervisor = Supervisor(lambda: Missing(broken), LoopClock(), ignore)  # type: ignore[arg-type, return-value]
    with pytest.raises(ZeroDivisionError):
        await supervisor.run()
