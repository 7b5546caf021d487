"""Wheels that a tool turns: the port that went away is waited for only if they may turn."""

from __future__ import annotations

import os
import tty
from collections.abc import Iterator

import pytest

from yahboomd.core.clock import SystemClock
from yahboomd.core.config import Config
from yahboomd.core.errors import PortLost
from yahboomd.core.link.port import PortOptions, open_port
from yahboomd.core.link.port_identity import identify
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
        async with guarded(port, Config(), clock, said.append) as guard:
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
    async with guarded(port, config, clock, print) as guard:
        note = guard.note
    port.close()
    assert note is not None
    assert (note.path, note.dtr, note.rts) == (path, False, True)
    assert note.device == identify(os.stat(path))
