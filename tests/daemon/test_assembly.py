"""From the configuration to objects: nothing a person wrote gets lost on the way."""

from __future__ import annotations

import asyncio
import logging
import os
import threading
import tty
from pathlib import Path

import pytest

from yahboomd.core import atomic_write
from yahboomd.core.clock import SystemClock
from yahboomd.core.config import Config, read
from yahboomd.core.daemon import assembly
from yahboomd.core.daemon.estop.latch_file import LatchFile
from yahboomd.core.errors import PortMissing
from yahboomd.core.link import port_note
from yahboomd.core.link.discovery import Candidate
from yahboomd.core.link.port_identity import identify
from yahboomd.core.link.port_note import PortNote
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time


def config(*overrides: str) -> Config:
    return read(None, environ={}, overrides=overrides).config


def test_the_bus_listens_where_the_configuration_says() -> None:
    options = assembly.bus_options(
        config('zenoh.listen=["tcp/127.0.0.1:9"]', "zenoh.connect=[]", "zenoh.namespace=bot1")
    )
    assert options.listen == ("tcp/127.0.0.1:9",)
    assert options.connect == ()
    assert options.namespace == "bot1"
    assert options.mode == "router"


def test_a_session_gets_the_port_and_the_wheels() -> None:
    options = assembly.session_options(
        config("serial.dialect=polled", "odometry.poll_rate_hz=100", "command.resend_s=0.2")
    )
    assert (options.dialect, options.poll_rate_hz, options.resend_s) == ("polled", 100.0, 0.2)
    # 30 mm/s at a 67 mm wheel with 1320 counts.
    assert options.still_ticks_per_s == pytest.approx(188.1, abs=0.5)
    assert options.profile.name == "520"


def test_the_control_path_gets_limits_policies_and_the_period() -> None:
    options = assembly.control_options(
        config(
            "limits.linear.velocity=0.5",
            "faults.stall=report",
            "command.at_rest=release",
            "command.rate_hz=100",
            "chassis.command_scale=0.9",
        )
    )
    assert options.linear.velocity == 0.5
    assert options.stall == "report"
    assert options.at_rest == "release"
    assert options.period_s == 0.01
    assert options.command_scale == 0.9
    assert [motor.position for motor in options.motors] == [1, 3]


def test_stops_are_repeated_and_watched_ten_times_a_second_at_least() -> None:
    sources = "command.sources={cmd_vel={priority=10}}"
    settings = config("command.rate_hz=1", "command.timeout_s=3", sources)
    assert assembly.control_options(settings).period_s == 0.1


@on_virtual_time
async def test_a_missing_port_is_found_missing_at_each_attempt() -> None:
    open_it = assembly.opener(config("serial.port=/dev/not-there"), LoopClock())
    for _ in range(2):
        with pytest.raises(PortMissing, match="/dev/not-there"):
            await open_it()


@pytest.mark.realtime
async def test_of_two_ports_the_daemon_opens_the_boards_and_logs_the_other_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    board, other = os.openpty(), os.openpty()
    for _, slave in (board, other):
        tty.setraw(slave)
    names = [os.ttyname(slave) for _, slave in (board, other)]
    found = tuple(
        Candidate(path=path, description="", usb="1a86:7523", is_ch340=True, by_path=None)
        for path in names
    )
    monkeypatch.setattr(assembly, "candidates", lambda: found)
    open_it = assembly.opener(config(), SystemClock())
    loop = asyncio.get_running_loop()

    def report() -> None:
        nonlocal timer
        os.write(board[0], bytes.fromhex("fffb0a0ac8000000f4017849"))
        timer = loop.call_later(0.02, report)

    timer = loop.call_soon(report)
    with caplog.at_level(logging.INFO):
        for _ in range(2):
            port = await open_it()
            assert port.name == names[0]
            port.close()
    timer.cancel()
    os.set_blocking(other[0], False)
    with pytest.raises(BlockingIOError):
        os.read(other[0], 1)
    for each in (*board, *other):
        os.close(each)
    said = [each.message for each in caplog.records if "could be the board" in each.message]
    assert len(said) == 1
    assert f"{names[1]} (1a86:7523) was not asked" in said[0]


async def test_how_the_port_was_opened_is_noted_for_the_stop_after_a_kill(tmp_path: Path) -> None:
    master, slave = os.openpty()
    environ = {"RUNTIME_DIRECTORY": str(tmp_path)}
    settings = config(f"serial.port={os.ttyname(slave)}", "serial.baudrate=57600")
    port = await assembly.opener(settings, SystemClock(), environ)()
    device = identify(os.fstat(slave))
    port.close()
    os.close(slave)
    os.close(master)
    (note,) = port_note.read(str(tmp_path))
    assert note == PortNote(
        settings.serial.port,
        *(57600, True, False, False, device, os.getpid()),
        listen=settings.zenoh.listen,
        latch=str(settings.latch_path(environ, user_id=os.getuid())),
    )


async def test_a_disk_that_hangs_under_the_note_holds_up_one_thread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = threading.Event()
    monkeypatch.setattr(atomic_write, "write_atomic", lambda *_, **__: disk.wait())
    master, slave = os.openpty()
    open_it = assembly.opener(
        config(f"serial.port={os.ttyname(slave)}"),
        SystemClock(),
        {"RUNTIME_DIRECTORY": str(tmp_path)},
    )
    for _ in range(3):
        (await open_it()).close()
    assert [each.name for each in threading.enumerate()].count("port-note") == 1
    disk.set()
    os.close(slave)
    os.close(master)


@on_virtual_time
async def test_an_engaged_latch_is_found_where_the_configuration_says(tmp_path: Path) -> None:
    (tmp_path / "estop").write_text('{"by": "somebody"}')
    latch = assembly.latch(config(f"estop.latch_file={tmp_path / 'estop'}"), LoopClock(), {})
    assert latch.engaged


@pytest.mark.parametrize(
    ("settings", "engaged"),
    [
        ((), True),
        (("serial.port=/dev/ttyUSB0",), True),
        (("serial.port=/tmp/board",), False),
        (("zenoh.namespace=bot1",), False),
    ],
)
@on_virtual_time
async def test_a_simulated_board_and_another_namespace_have_latches_of_their_own(
    tmp_path: Path, settings: tuple[str, ...], engaged: bool
) -> None:
    environ = {"RUNTIME_DIRECTORY": str(tmp_path)}
    LatchFile(tmp_path / "estop").engage("a person")
    latch = assembly.latch(config(*settings), LoopClock(), environ)
    assert latch.engaged is engaged
    if engaged:
        assert latch.settle()
        assert latch.release(()).released
        assert not assembly.latch(config(*settings), LoopClock(), environ).engaged
