"""A bus that cannot be opened yet: a service waits for it, a person gets the error at once."""

from __future__ import annotations

import asyncio
import itertools
import logging
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from yahboomd.clock import LoopClock
from yahboomd.daemon.opening import BACK_OFF_S, PATIENCE_S, open_bus
from yahboomd.daemon.process import Notifier
from yahboomd.errors import BusError
from yahboomd.simulation.virtual_time import on_virtual_time


class Blocked:
    """A bus that opens at the attempt that is named, or never."""

    def __init__(self, opens_at: int = 0) -> None:
        self.tried_s: list[float] = []
        self._opens_at = opens_at

    async def open(self) -> None:
        self.tried_s.append(asyncio.get_running_loop().time())
        if len(self.tried_s) != self._opens_at:
            raise BusError("The bus cannot listen on tcp/127.0.0.1:7448.", remedy="End the other.")


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.setblocking(False)
        yield listening


@pytest.fixture
def notifier(manager: socket.socket) -> Iterator[Notifier]:
    made = Notifier({"NOTIFY_SOCKET": manager.getsockname()})
    yield made
    made.close()


def heard(manager: socket.socket) -> list[bytes]:
    found = []
    while True:
        try:
            found.append(manager.recv(500))
        except BlockingIOError:
            return found


async def opened(bus: Blocked, notifier: Notifier, stop: asyncio.Event | None = None) -> bool:
    return await open_bus(
        bus.open, notifier=notifier, clock=LoopClock(), stop=stop or asyncio.Event()
    )


@on_virtual_time
async def test_without_a_service_manager_the_error_is_reported_at_once() -> None:
    bus = Blocked(opens_at=2)
    with pytest.raises(BusError):
        await opened(bus, Notifier({}))
    assert len(bus.tried_s) == 1


@on_virtual_time
async def test_a_service_tries_again_with_growing_waits_until_the_bus_opens(
    notifier: Notifier,
) -> None:
    bus = Blocked(opens_at=8)
    assert await opened(bus, notifier)
    waits = [after - before for before, after in itertools.pairwise(bus.tried_s)]
    assert waits == pytest.approx([*BACK_OFF_S, BACK_OFF_S[-1], BACK_OFF_S[-1]])


def test_what_it_waits_for_is_reported_once_to_the_manager_and_to_the_log(
    manager: socket.socket, notifier: Notifier, caplog: pytest.LogCaptureFixture
) -> None:
    @on_virtual_time
    async def scene() -> None:
        assert await opened(Blocked(opens_at=8), notifier)

    with caplog.at_level(logging.INFO, logger="yahboomd"):
        scene()
    words = "The bus cannot listen on tcp/127.0.0.1:7448. End the other."
    assert heard(manager) == [f"STATUS=waiting for the bus: {words}".encode()]
    assert [record.getMessage() for record in caplog.records] == [f"{words} yahboomd keeps trying."]


@on_virtual_time
async def test_one_start_waits_for_a_minute_and_no_longer(notifier: Notifier) -> None:
    bus = Blocked()
    with pytest.raises(BusError, match="cannot listen"):
        await opened(bus, notifier)
    waited_s = bus.tried_s[-1] - bus.tried_s[0]
    assert PATIENCE_S <= waited_s <= PATIENCE_S + BACK_OFF_S[-1]


@on_virtual_time
async def test_a_stop_meanwhile_ends_the_waiting_at_once(notifier: Notifier) -> None:
    bus, stop = Blocked(), asyncio.Event()
    loop = asyncio.get_running_loop()
    loop.call_later(20.0, stop.set)
    began_s = loop.time()
    assert not await opened(bus, notifier, stop)
    assert loop.time() - began_s == pytest.approx(20.0)
