"""Wheels that a tool turns: the port that went away is waited for only if they may turn."""

from __future__ import annotations

import os
import tty
from collections.abc import Iterator

import pytest

from yahboomd.core.clock import SystemClock
from yahboomd.core.config import Config
from yahboomd.core.errors import BoardError, PortLost
from yahboomd.core.link.line import Line
from yahboomd.core.link.port import Port
from yahboomd.core.link.port_guard import PortGuard, stops_of
from yahboomd.core.model import NS_PER_S as SECOND_NS
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.tools.port import charge
from yahboomd.tools.port.guarded import guarded
from yahboomd.tools.port.own_port import opener_of


@pytest.fixture
def path() -> Iterator[str]:
    master, slave = os.openpty()
    tty.setraw(slave)
    yield os.ttyname(slave)
    os.close(slave)
    os.close(master)


async def opened(path: str) -> tuple[Port, PortGuard]:
    """The port, as a tool opens it, and its guard."""
    guard = PortGuard(charge.start, renewed=False)
    guard.begin()
    return await opener_of(path, Config(), SystemClock(), guard)(), guard


async def test_a_port_that_went_away_while_the_wheels_stood_is_not_waited_for(path: str) -> None:
    clock, said = SystemClock(), list[str]()
    port, own = await opened(path)

    async def driven() -> None:
        async with guarded(Line(port, clock), said.append) as guard:
            await guard.watch_over(DIALECTS["streamed"])
            guard.mark(True)
            guard.mark(False)
            raise PortLost(f"{path} went away.")

    with pytest.raises(PortLost, match="away"):
        await driven()
    port.close()
    own.end()
    assert said == []


async def test_without_the_guard_no_wheel_is_driven(path: str) -> None:
    port, own = await opened(path)
    async with guarded(Line(port, SystemClock()), print) as guard:
        await guard.watch_over(DIALECTS["streamed"])
        guard.mark(True)
        guard.mark(False)
        process = own._process
        assert process is not None
        process.kill()
        process.wait()
        with pytest.raises(BoardError, match="no motor is turned"):
            guard.mark(True)
    port.close()


@pytest.mark.parametrize("car_type", [0, 3])
def test_the_surest_stop_ends_motion_on_a_rosmaster_whose_car_type_ignores_a_cut(
    car_type: int,
) -> None:
    dialect = DIALECTS["rosmaster"]
    flash = RosmasterStored(car_type=car_type)
    robot = SimulatedRobot(SimulationOptions(dialect="rosmaster", flash=flash))
    robot.start(0)
    full = dialect.outputs((dialect.most_output,) * 4, {})
    for now_ns, frame in ((SECOND_NS, full), (2 * SECOND_NS, stops_of(dialect)[1])):
        robot.host_wrote(frame, now_ns)
        robot.advance(now_ns + SECOND_NS)
        assert turns(robot, now_ns + SECOND_NS) is (frame == full)


def turns(robot: SimulatedRobot, now_ns: int) -> bool:
    return max(map(abs, robot.truth(now_ns).speed_m_s)) > 0.1


@pytest.mark.parametrize("name", DIALECTS)
def test_a_stop_within_any_frame_that_its_owner_was_writing_is_obeyed(name: str) -> None:
    dialect = DIALECTS[name].for_profile(PROFILES["520"])
    body = name == "rosmaster"
    motion = dialect.speeds((300, 0, 0) if body else (300,) * 4)
    for stop in stops_of(dialect):
        for at in range(len(motion) + 1):
            robot = SimulatedRobot(SimulationOptions(dialect=name))  # type: ignore[arg-type]
            robot.start(0)
            for number, frame in enumerate((*dialect.arm, motion)):
                robot.host_wrote(frame, SECOND_NS + number * SECOND_NS // 10)
            robot.advance(2 * SECOND_NS)
            assert turns(robot, 2 * SECOND_NS)
            for late_ns, part in enumerate((motion[:at], stop, motion[at:])):
                robot.host_wrote(part, 2 * SECOND_NS + 1000 * late_ns)
            # It is repeated until its owner has written all, and acknowledged it.
            robot.advance(2 * SECOND_NS + SECOND_NS // 10)
            robot.host_wrote(stop, 2 * SECOND_NS + SECOND_NS // 10)
            robot.advance(4 * SECOND_NS)
            assert not turns(robot, 4 * SECOND_NS), at
