from __future__ import annotations

import signal
import time
from typing import Any

import pytest
from zenoh_fixtures import eventually

from yahboomd.core.bus import keys

pytestmark = pytest.mark.realtime

ZERO = (0.0, 0.0)

WAYS = [signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1, signal.SIGTSTP]


async def start(terminal: Any, endpoint: str, *options: str) -> Any:
    process = terminal("drive", "--connect", endpoint, *options)
    await process.shows("yahboomd drive")
    return process


async def test_a_key_drives_until_it_is_let_go(terminal: Any, fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    process = await start(terminal, daemon.endpoint, "--linear", "0.2", "--angular", "0.5")
    await process.shows("● STANDING At rest.")
    process.type("w")
    await eventually(lambda: (0.2, 0.0) in daemon.velocities)
    await eventually(lambda: daemon.velocities[-1] == ZERO)
    process.type("\x1b[D")
    await eventually(lambda: (0.0, 0.5) in daemon.velocities)
    stamps = [command["stamp_ns"] for command in daemon.commands]
    assert stamps == sorted(stamps)
    assert daemon.commands[0]["source"] == "yahboomd drive"


@pytest.mark.nightly
async def test_keys_that_waited_while_it_stood_still_move_nothing(
    terminal: Any, fake_daemon: Any
) -> None:
    daemon = await fake_daemon()
    process = await start(terminal, daemon.endpoint)
    await process.shows("● STANDING At rest.")
    process.process.send_signal(signal.SIGSTOP)
    until_s = time.monotonic() + 0.8
    process.type("www")
    await eventually(lambda: time.monotonic() > until_s)
    process.process.send_signal(signal.SIGCONT)
    await process.shows("Keys that waited for this program are old: discarded.")
    assert daemon.velocities == []
    # One that stops is never too late.
    process.process.send_signal(signal.SIGSTOP)
    until_s = time.monotonic() + 0.8
    process.type("we")
    await eventually(lambda: time.monotonic() > until_s)
    process.process.send_signal(signal.SIGCONT)
    await process.shows("The emergency stop is engaged.")
    assert set(daemon.velocities) <= {ZERO}


async def test_emergency_stop_and_release_are_asked_for_and_their_answers_shown(
    terminal: Any, fake_daemon: Any
) -> None:
    daemon = await fake_daemon()
    process = await start(terminal, daemon.endpoint)
    await process.shows("● STANDING")
    process.type("e")
    await process.shows("The emergency stop is engaged.")
    daemon.releases = False
    process.type("R")
    await process.shows("Not released: cmd_vel commands motion.")
    daemon.releases = True
    process.type("r")
    await process.shows("Released.")
    assert daemon.asked == [keys.ESTOP, keys.ESTOP_RESET, keys.ESTOP_RESET]
    await eventually(lambda: ZERO in daemon.velocities)


@pytest.mark.cases(1)
@pytest.mark.parametrize("way", [*("q", "\x03"), *WAYS])
async def test_on_every_way_out_the_robot_stops_and_the_terminal_is_put_back(
    terminal: Any, fake_daemon: Any, way: str | signal.Signals
) -> None:
    daemon = await fake_daemon()
    process = await start(terminal, daemon.endpoint)
    await process.shows("● STANDING")
    process.type("w")
    await eventually(lambda: (0.3, 0.0) in daemon.velocities)
    if isinstance(way, str):
        process.type(way)
    else:
        process.process.send_signal(way)
    assert await process.ended() == 0
    assert process.restored
    # A full connection may have dropped the zeros before the last one, which waits for room.
    await eventually(lambda: daemon.velocities[-1] == ZERO)


@pytest.mark.nightly
async def test_when_its_window_is_closed_the_robot_stops(terminal: Any, fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    process = await start(terminal, daemon.endpoint)
    await process.shows("● STANDING")
    process.type("w")
    await eventually(lambda: (0.3, 0.0) in daemon.velocities)
    process.hang_up()
    assert await process.ended() == 0
    await eventually(lambda: daemon.velocities[-3:] == [ZERO] * 3)
