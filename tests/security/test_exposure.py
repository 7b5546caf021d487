"""The reach of the daemon, as the machine's own tables show it."""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from real_robot import Client, RealRobot

from yahboomd.core.config import Config

pytestmark = pytest.mark.realtime

LISTENING = "0A"


def sockets_of(pid: int) -> set[str]:
    """The inodes of a process's sockets."""
    inodes = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        try:
            target = os.readlink(entry)
        except OSError:
            continue
        if target.startswith("socket:["):
            inodes.add(target.removeprefix("socket:[").removesuffix("]"))
    return inodes


def address_of(text: str) -> tuple[str, int]:
    """The kernel's hexadecimal address, in words."""
    host, port = text.split(":")
    raw = bytes.fromhex(host)
    # Words of 32 bits, each in the byte order of the machine.
    words = b"".join(raw[n : n + 4][::-1] for n in range(0, len(raw), 4))
    return str(ipaddress.ip_address(words)), int(port, 16)


def reachable(pid: int) -> dict[str, set[tuple[str, int]]]:
    """The addresses on which a process takes connections (tcp) or packets (udp), by protocol."""
    own = sockets_of(pid)
    found: dict[str, set[tuple[str, int]]] = {}
    for table in ("tcp", "tcp6", "udp", "udp6", "udplite", "udplite6", "raw", "raw6"):
        path = Path(f"/proc/{pid}/net/{table}")
        if not path.exists():
            continue
        rows = [line.split() for line in path.read_text().splitlines()[1:]]
        found[table] = {
            address_of(row[1])
            for row in rows
            if row[9] in own and (row[3] == LISTENING or not table.startswith("tcp"))
        }
    return found


def test_by_default_one_port_is_open_and_only_this_machine_reaches_it(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    (default,) = Config().zenoh.listen
    assert default == "tcp/127.0.0.1:7448"
    robot = real_robot()
    # But for the number of the port, which others on this machine may have taken, the default.
    port = int(robot.endpoint.removeprefix("tcp/127.0.0.1:"))
    client("client", robot.endpoint).in_state("standing")
    found = reachable(robot.daemon.process.pid)
    assert found.pop("tcp") == {("127.0.0.1", port)}
    assert not any(found.values()), found
    assert "this machine alone" in robot.daemon.output


@pytest.mark.nightly
def test_a_port_that_others_reach_is_found_by_this_test_and_logged_by_the_daemon(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot(run=["--set", 'zenoh.listen=["tcp/0.0.0.0:0"]'])
    robot.daemon.says("every program that reaches it can drive")
    robot.daemon.says("Connected")
    assert {host for host, _ in reachable(robot.daemon.process.pid)["tcp"]} == {"0.0.0.0"}
