"""Wheels that a tool turns: the port that went away is waited for only if they may turn."""

from __future__ import annotations

import os
import signal
import tty
from collections.abc import Iterator

import pytest

from yahboomd.core.clock import Clock, SystemClock
from yahboomd.core.config import Config
from yahboomd.core.errors import BoardError, PortLost
from yahboomd.core.link.line import Line
from yahboomd.core.link.port import PortOptions, open_port
from yahboomd.core.link.port_guard import PortGuard
from yahboomd.core.model import NS_PER_S as SECOND_NS
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.tools.port.guarded import guarded


@pytest.fixture
def path() -> Iterator[str]:
    master, slave = os.openpty()
    tty.setraw(slave)
    yield os.ttyname(slave)
    os.close(slave)
    os.close(master)


async def test_a_port_that_went_away_while_the_wheels_stood_is_not_waited_for(path: str) -> None:
    clock, said = SystemClock(), list[str]()
    port = await open_port(PortOptions(path=path), clock)

    async def driven() -> None:
        async with guarded(Line(port, clock), Config(), said.append) as guard:
            await guard.watch_over(DIALECTS["streamed"])
            guard.mark(True)
            guard.mark(False)
            raise PortLost(f"{path} went away.")

    with pytest.raises(PortLost, match="away"):
        await driven()
    port.close()
    assert said == []


async def test_without_the_guard_no_wheel_is_driven(path: str) -> None:
    clock = SystemClock()
    port = await open_port(PortOptions(path=path), clock)
    async with guarded(Line(port, clock), Config(), print) as guard:
        await guard.watch_over(DIALECTS["streamed"])
        guard.mark(True)
        guard.mark(False)
        assert guard._guard.pid is not None
        os.kill(guard._guard.pid, signal.SIGKILL)
        guard._guard._process.wait()
        with pytest.raises(BoardError, match="no motor is turned"):
            guard.mark(True)
    port.close()


@pytest.mark.parametrize("car_type", [0, 3])
async def test_its_stop_ends_motion_on_a_rosmaster_whose_car_type_ignores_a_cut(
    path: str, monkeypatch: pytest.MonkeyPatch, car_type: int
) -> None:
    clock, stops = SystemClock(), list[bytes]()

    async def watches(_guard: PortGuard, stop: bytes, _clock: Clock) -> bool:
        stops.append(stop)
        return True

    monkeypatch.setattr(PortGuard, "watches", watches)
    port = await open_port(PortOptions(path=path), clock)
    dialect = DIALECTS["rosmaster"]
    async with guarded(Line(port, clock), Config(), print) as guard:
        await guard.watch_over(dialect)
    port.close()
    flash = RosmasterStored(car_type=car_type)
    robot = SimulatedRobot(SimulationOptions(dialect="rosmaster", flash=flash))
    robot.start(0)
    full = dialect.outputs((dialect.most_output,) * 4, {})
    for now_ns, frame in ((SECOND_NS, full), (2 * SECOND_NS, stops[0])):
        robot.host_wrote(frame, now_ns)
        robot.advance(now_ns + SECOND_NS)
        turns = max(map(abs, robot.truth(now_ns + SECOND_NS).speed_m_s)) > 0.1
        assert turns is (frame == full)
