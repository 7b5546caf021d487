"""What systemd hears, on a real datagram socket."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from yahboomd.daemon.notify import Notifier


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


def test_the_same_status_is_told_once(manager: socket.socket) -> None:
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
    notifier.status("standing: cmd_vel fell silent: its last command was given 0.6 s ago.")
    notifier.status("driving: cmd_vel drives.")
    assert [manager.recv(200) for _ in range(3)] == [
        b"STATUS=waiting: no port. cmd fell silent.",
        b"STATUS=standing: cmd_vel fell silent: its last command was given.",
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


def test_a_manager_that_is_gone_disturbs_nobody(tmp_path: Path) -> None:
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
