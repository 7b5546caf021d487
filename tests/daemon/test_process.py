"""Signals; systemd's messages, on a real datagram socket; waiting for the bus."""

from __future__ import annotations

import asyncio
import itertools
import logging
import os
import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from yahboomd.core.daemon.process import (
    BACK_OFF_S,
    ENDING,
    KILLING,
    PATIENCE_S,
    SUSPENDING,
    Notifier,
    Signals,
    name_of,
    open_bus,
)
from yahboomd.core.errors import BusConfigError, BusError
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time


def test_every_signal_is_handled_that_can_be_and_would_end_or_suspend_the_process() -> None:
    left = signal.valid_signals() - {*ENDING, *KILLING, *SUSPENDING}
    assert {signal.Signals(each).name for each in left} == {
        *("SIGKILL", "SIGSTOP"),
        *("SIGCHLD", "SIGCONT", "SIGURG", "SIGWINCH"),
        *("SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV"),
    }


def test_signals_without_a_name_of_their_own_have_one() -> None:
    assert name_of(signal.SIGQUIT) == "SIGQUIT"
    assert name_of(signal.SIGRTMIN + 3) == "SIGRTMIN+3"


@pytest.mark.parametrize("number", [*ENDING, *KILLING], ids=name_of)
async def test_any_signal_that_would_end_the_process_asks_for_its_end_and_is_kept_if_it_kills(
    number: int,
) -> None:
    # Once the end was asked for, all that ask for it are ignored.
    before = {each: signal.signal(each, signal.SIG_DFL) for each in {*ENDING, number}}
    asked: list[str] = []
    signals = Signals(asked.append)
    try:
        signals.install()
        signal.raise_signal(number)
        while not asked:
            await asyncio.sleep(0)
        assert asked == [name_of(number)]
        assert signals.fatal == (None if number in ENDING else number)
    finally:
        signals.remove()
        for each, handler in before.items():
            signal.signal(each, handler)


@pytest.mark.parametrize("number", SUSPENDING)
async def test_any_signal_that_would_suspend_the_process_waits_for_the_wheels_first(
    number: int,
) -> None:
    signals = Signals(lambda _name: None)
    signals.at_once = False
    try:
        signals.install()
        signal.raise_signal(number)
        await signals.suspend.wait()
    finally:
        signals.remove()


async def test_a_signal_that_is_ignored_stays_ignored() -> None:
    """As it is for a program that a script started in the background."""
    before = signal.signal(signal.SIGQUIT, signal.SIG_IGN)
    asked: list[str] = []
    signals = Signals(asked.append)
    try:
        signals.install()
        signal.raise_signal(signal.SIGQUIT)
        signal.raise_signal(signal.SIGUSR1)
        signal.raise_signal(signal.SIGUSR2)
        while len(asked) < 2:
            await asyncio.sleep(0.001)
        assert asked == ["SIGUSR1", "SIGUSR2"]
        # The first one decides.
        assert signals.fatal == signal.SIGUSR1
    finally:
        signals.remove()
        signal.signal(signal.SIGQUIT, before)
    assert signal.getsignal(signal.SIGUSR1) is signal.SIG_DFL
    assert signal.getsignal(signal.SIGTSTP) is signal.SIG_DFL


async def test_a_signal_that_asks_again_for_the_end_breaks_off_nothing_of_it() -> None:
    before = {number: signal.getsignal(number) for number in ENDING}
    asked: list[str] = []
    signals = Signals(asked.append)
    try:
        signals.install()
        signal.raise_signal(signal.SIGINT)
        while not asked:
            await asyncio.sleep(0.001)
        signals.remove()
        for number in ENDING:
            signal.raise_signal(number)
        assert asked == ["SIGINT"]
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


async def test_continuing_before_the_wheels_stand_takes_a_suspension_back() -> None:
    signals = Signals(lambda _name: None)
    signals.at_once = False
    try:
        signals.install()
        signal.raise_signal(signal.SIGTSTP)
        await signals.suspend.wait()
        # Meanwhile more of them change nothing.
        assert signal.getsignal(signal.SIGTTOU) is signal.SIG_IGN
        signal.raise_signal(signal.SIGCONT)
        while signals.suspend.is_set():
            await asyncio.sleep(0.001)
        signal.raise_signal(signal.SIGTTOU)
        await signals.suspend.wait()
    finally:
        signals.remove()


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.settimeout(5)
        yield listening


def test_every_message_reaches_the_manager(manager: socket.socket) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": manager.getsockname()})
    notifier.ready()
    notifier.status("waiting for the board")
    notifier.alive()
    notifier.stopping()
    heard = [manager.recv(100) for _ in range(4)]
    notifier.close()
    assert heard == [b"READY=1", b"STATUS=waiting for the board", b"WATCHDOG=1", b"STOPPING=1"]


def test_a_status_of_several_lines_is_one_assignment_to_the_manager(
    manager: socket.socket,
) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": manager.getsockname()})
    notifier.status('waiting: two boards.\nport = "/dev/a"')
    assert manager.recv(100) == b'STATUS=waiting: two boards. port = "/dev/a"'
    notifier.close()


def test_the_same_status_is_sent_once(manager: socket.socket) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": manager.getsockname()})
    notifier.status("driving")
    notifier.status("driving")
    notifier.status("standing")
    assert [manager.recv(100), manager.recv(100)] == [b"STATUS=driving", b"STATUS=standing"]
    notifier.close()


def test_an_age_that_grows_is_no_news(manager: socket.socket) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": manager.getsockname()})
    for age in ("0.0", "0.5", "12.0"):
        notifier.status(f"waiting: no port. (since {age} s, for another 3.0 s) cmd fell silent.")
    notifier.status("standing: cmd_vel fell silent after its last command 0.6 s ago.")
    notifier.status("driving: cmd_vel drives.")
    assert [manager.recv(200) for _ in range(3)] == [
        b"STATUS=waiting: no port. cmd fell silent.",
        b"STATUS=standing: cmd_vel fell silent after its last command.",
        b"STATUS=driving: cmd_vel drives.",
    ]
    notifier.close()


def test_an_abstract_socket_is_reached() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(f"\0yahboomd-test-{os.getpid()}")
        listening.settimeout(5)
        notifier = Notifier({"NOTIFY_SOCKET": f"@yahboomd-test-{os.getpid()}"})
        notifier.ready()
        assert listening.recv(100) == b"READY=1"
        notifier.close()


def test_without_a_manager_nothing_happens() -> None:
    notifier = Notifier({})
    notifier.ready()
    notifier.alive()
    notifier.close()
    assert notifier.watchdog_ns is None


def test_a_manager_that_is_gone_does_no_harm(tmp_path: Path) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": str(tmp_path / "gone")})
    notifier.ready()
    notifier.close()


@pytest.mark.parametrize(
    ("environ", "expected"),
    [
        ({"WATCHDOG_USEC": "2000000"}, 2_000_000_000),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": str(os.getpid())}, 2_000_000_000),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
        ({"WATCHDOG_USEC": "0"}, None),
        ({}, None),
    ],
)
def test_the_watchdog_is_fed_only_where_it_waits_for_this_process(
    environ: dict[str, str], expected: int | None
) -> None:
    assert Notifier(environ).watchdog_ns == expected


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
def notifier(manager: socket.socket) -> Iterator[Notifier]:
    made = Notifier({"NOTIFY_SOCKET": manager.getsockname()})
    yield made
    made.close()


def heard(manager: socket.socket) -> list[bytes]:
    found = []
    manager.setblocking(False)
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
async def test_settings_that_no_network_can_mend_are_not_tried_again(notifier: Notifier) -> None:
    tried = 0

    async def open_once() -> None:
        nonlocal tried
        tried += 1
        raise BusConfigError("zenoh.json5 cannot be used.")

    with pytest.raises(BusConfigError):
        await open_bus(open_once, notifier=notifier, clock=LoopClock(), stop=asyncio.Event())
    assert tried == 1


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
