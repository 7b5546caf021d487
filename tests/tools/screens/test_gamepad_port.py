"""A gamepad that comes and goes: a terminal stands in for the kernel's device."""

from __future__ import annotations

import asyncio
import os
import tty
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from gamepad_records import axis, button
from zenoh_fixtures import eventually

from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.tools.screens.gamepad import EAST, HAT_Y, LEFT_SHOULDER, START, STICK_X, STICK_Y
from yahboomd.tools.screens.gamepad_port import GamepadPort

ZERO = (0.0, 0.0)


class FakePad:
    """A device to which a test writes records; its name is a link that goes with it."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "event7"
        self._fds: list[int] = []

    def plug_in(self) -> None:
        master, slave = os.openpty()
        tty.setraw(slave)
        self._fds = [master, slave]
        self.path.symlink_to(os.ttyname(slave))

    def sends(self, data: bytes) -> None:
        os.write(self._fds[0], data)

    def unplug(self) -> None:
        if self._fds:
            self.path.unlink()
        for fd in self._fds:
            os.close(fd)
        self._fds = []


@pytest.fixture
def pad(tmp_path: Path) -> Iterator[FakePad]:
    made = FakePad(tmp_path)
    yield made
    made.unplug()


def port(device: Path | None, folder: Path) -> GamepadPort:
    return GamepadPort(
        device,
        LoopClock(),
        reads=lambda: None,
        wanted=lambda _: None,
        moved=lambda: None,
        lost=lambda: None,
        folder=folder,
    )


@on_virtual_time
async def test_a_device_that_the_user_may_not_read_is_named_with_what_to_type() -> None:
    with TemporaryDirectory(dir="/tmp") as name:
        folder = Path(name)
        (folder / "event3").touch(mode=0)
        folder.chmod(0o755)
        user = os.geteuid()
        if user == 0:
            # Root may read everything.
            os.seteuid(65534)
        try:
            with port(None, folder) as found:
                words = found.words
        finally:
            os.seteuid(user)
    assert words == (
        f"Your user may not read {folder / 'event3'}. Type `sudo usermod -aG input $USER`, then "
        "log out and in again."
    )


@on_virtual_time
async def test_a_joystick_is_named_and_not_called_absent(tmp_path: Path) -> None:
    (tmp_path / "event3").write_bytes(b"")
    (tmp_path / "js0").write_bytes(b"")
    with port(None, tmp_path) as looking:
        assert f"{tmp_path}/js0 is a joystick, not a gamepad" in looking.words


@on_virtual_time
async def test_a_pad_that_is_plugged_in_later_is_found_within_a_second(
    tmp_path: Path, pad: FakePad
) -> None:
    with port(pad.path, tmp_path) as found:
        assert (
            found.words
            == f"{pad.path} is not there: plug it in, or connect it. It is found " + ("by itself.")
        )
        pad.plug_in()
        found.look()
        assert found.pad is None
        await asyncio.sleep(1.0)
        found.look()
        assert found.pad is not None
        assert "hold a shoulder button" in found.words


async def start(terminal: Any, endpoint: str, pad: FakePad) -> Any:
    process = terminal("drive", "--connect", endpoint, "--gamepad", str(pad.path))
    await process.shows("yahboomd drive")
    await process.shows("● STANDING")
    return process


@pytest.mark.realtime
async def test_the_stick_drives_while_the_shoulder_is_held_and_stops_with_it(
    terminal: Any, fake_daemon: Any, pad: FakePad
) -> None:
    daemon = await fake_daemon()
    pad.plug_in()
    process = await start(terminal, daemon.endpoint, pad)
    await process.shows("shoulder")
    # The stick alone moves nothing.
    pad.sends(axis(STICK_Y, -32768) + axis(HAT_Y, -1))
    await process.shows("0.33 m/s")
    assert daemon.velocities == []
    pad.sends(button(LEFT_SHOULDER, 1))
    forward, turning = (pytest.approx(0.33), 0.0), (0.0, pytest.approx(1.1))
    # Nothing more comes from a stick that stays where it is, and the robot drives on.
    await eventually(lambda: [each == forward for each in daemon.velocities].count(True) > 15)
    pad.sends(axis(STICK_Y, 0) + axis(STICK_X, -32768))
    await eventually(lambda: daemon.velocities[-1] == turning)
    pad.sends(button(LEFT_SHOULDER, 0))
    await eventually(lambda: daemon.velocities[-1] == ZERO)
    pad.sends(axis(STICK_X, -20000))
    pad.sends(button(EAST, 1))
    await process.shows("The emergency stop is engaged.")
    pad.sends(button(START, 1))
    await process.shows("Released.")
    assert daemon.velocities[-1] == ZERO


@pytest.mark.nightly
@pytest.mark.realtime
async def test_a_pad_that_goes_in_mid_drive_stops_the_robot_and_counts_again_once_it_is_back(
    terminal: Any, fake_daemon: Any, pad: FakePad
) -> None:
    daemon = await fake_daemon()
    pad.plug_in()
    process = await start(terminal, daemon.endpoint, pad)
    await process.shows("shoulder")
    pad.sends(button(LEFT_SHOULDER, 1) + axis(STICK_Y, -32768))
    await eventually(lambda: (0.3, 0.0) in daemon.velocities)
    pad.unplug()
    await process.shows("The gamepad is gone")
    await eventually(lambda: daemon.velocities[-1] == ZERO)
    pad.plug_in()
    await process.shows("shoulder")
    moved = daemon.velocities.count((0.3, 0.0))
    # The stick is pushed still; the shoulder has to be pressed again.
    pad.sends(axis(STICK_Y, -32768) + button(LEFT_SHOULDER, 2))
    pad.sends(button(EAST, 1))
    await process.shows("The emergency stop is engaged.")
    assert daemon.velocities.count((0.3, 0.0)) == moved
    pad.sends(button(LEFT_SHOULDER, 1))
    await eventually(lambda: daemon.velocities.count((0.3, 0.0)) > moved)
