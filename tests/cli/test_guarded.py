"""Wheels that a tool turns: the port that went away is waited for only if they may turn."""

from __future__ import annotations

import os
import tty
from collections.abc import Iterator

import pytest

from yahboomd.core.clock import SystemClock
from yahboomd.core.config import Config
from yahboomd.core.errors import PortLost
from yahboomd.core.link.line import Line
from yahboomd.core.link.port import PortOptions, open_port
from yahboomd.core.link.port_identity import identify
from yahboomd.core.model import NS_PER_S as SECOND_NS
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.tools.port.guarded import guarded
from yahboomd.tools.port.tool_guard import ToolGuard


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
            guard.mark(True)
            guard.mark(False)
            raise PortLost(f"{path} went away.")

    with pytest.raises(PortLost, match="away"):
        await driven()
    port.close()
    assert said == []


async def test_the_device_is_noted_while_the_port_is_open(path: str) -> None:
    clock = SystemClock()
    port = await open_port(PortOptions(path=path), clock)
    config = Config.of({"serial": {"dtr": False, "rts": True}})
    async with guarded(Line(port, clock), config, print) as guard:
        note = guard.note
    port.close()
    assert note is not None
    assert (note.path, note.dtr, note.rts) == (path, False, True)
    assert note.device == identify(os.stat(path))


@pytest.mark.parametrize("car_type", [0, 3])
async def test_its_stop_ends_motion_on_a_rosmaster_whose_car_type_ignores_a_cut(
    path: str, monkeypatch: pytest.MonkeyPatch, car_type: int
) -> None:
    clock, stops = SystemClock(), list[bytes]()
    monkeypatch.setattr(ToolGuard, "start", lambda _fd, stop, _note: stops.append(stop))
    port = await open_port(PortOptions(path=path), clock)
    dialect = DIALECTS["rosmaster"]
    async with guarded(Line(port, clock), Config(), print) as guard:
        guard.watch_over(dialect)
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
