from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import struct
import termios
import time
import tty
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from yahboomd.core.errors import ConfigError
from yahboomd.simulation.heard import read_heard
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.pty import BACKLOG_NS, READ_BYTES, RobotPort, serve
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.truth import read_truth
from yahboomd.simulation.wire import transfer_ns

pytestmark = pytest.mark.realtime


class Host:
    """A program that has the port open."""

    def __init__(self, path: Path | str) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        # Without the flush that would hide what an earlier host left.
        tty.setraw(self.fd, termios.TCSANOW)
        self.heard = b""
        self.hung_up = asyncio.Event()
        self.news = asyncio.Event()
        asyncio.get_running_loop().add_reader(self.fd, self._read)

    def _read(self) -> None:
        try:
            data = os.read(self.fd, 4096)
        except OSError:
            data = b""
        if data:
            self.heard += data
            self.news.set()
        else:
            asyncio.get_running_loop().remove_reader(self.fd)
            self.hung_up.set()

    def write(self, data: bytes) -> None:
        os.write(self.fd, data)

    async def until(self, found: bytes, times: int = 1) -> None:
        while self.heard.count(found) < times:
            self.news.clear()
            await self.news.wait()

    def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self.fd)
        os.close(self.fd)


@contextlib.asynccontextmanager
async def served(link: Path, **kwargs: Any) -> AsyncIterator[RobotPort]:
    options = kwargs.pop("options", SimulationOptions())
    ready: asyncio.Future[RobotPort] = asyncio.get_running_loop().create_future()
    task = asyncio.create_task(
        serve(SimulatedRobot(options), link=link, ready=ready.set_result, **kwargs)
    )
    done, _ = await asyncio.wait({task, ready}, return_when=asyncio.FIRST_COMPLETED)
    if task in done:
        await task
    try:
        yield ready.result()
    finally:
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task


def unread(fd: int) -> int:
    """Bytes that wait to be read."""
    return int(struct.unpack("i", fcntl.ioctl(fd, termios.FIONREAD, b"\0" * 4))[0])


async def eventually(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(60.0):
        while not condition():
            await asyncio.sleep(0.005)


async def exchange(link: Path, question: bytes, answer: bytes) -> None:
    host = Host(link)
    host.write(question)
    await host.until(answer)
    host.close()


async def test_a_host_talks_to_the_board_through_the_link(tmp_path: Path) -> None:
    link = tmp_path / "board"
    async with served(link) as port:
        assert str(link.readlink()) == port.name
        await exchange(link, b"\n" * 64 + b"$read_flash#", b"D:0.500\t \r\n")


async def test_streams_and_counters_reach_the_host(tmp_path: Path) -> None:
    async with served(tmp_path / "board") as port:
        host = Host(tmp_path / "board")
        host.write(b"$upload:1,0,0#")
        await host.until(b"$MAll:0,0,0,0#\r\n", 20)
        host.write(b"$spd:500,0,500,0#")
        await eventually(lambda: port.robot.board.totals[0] > 100)
        await host.until(b"$MAll:1")
        host.close()


async def test_the_board_drives_on_without_a_host_and_the_next_one_reads_nothing_old(
    tmp_path: Path,
) -> None:
    link = tmp_path / "board"
    async with served(link, options=SimulationOptions(dialect="polled")) as port:
        host = Host(link)
        host.write(b"$mtype:1#$speed:500,0,500,0#$read#")
        await host.until(b"#")
        asyncio.get_running_loop().remove_reader(host.fd)
        host.write(b"$read#")
        await eventually(lambda: unread(host.fd) > 12)
        os.close(host.fd)
        await eventually(lambda: not port.has_host)
        await eventually(lambda: port.robot.board.totals[0] > 300)
        again = Host(link)
        await eventually(lambda: port.has_host)
        again.write(b"$read#")
        await again.until(b"#")
        assert again.heard.count(b"$data") == 1
        assert int(again.heard[6:].split(b",")[0]) > 300
        again.close()


async def test_a_host_that_writes_and_leaves_at_once_is_heard(tmp_path: Path) -> None:
    async with served(tmp_path / "board") as port:
        host = Host(tmp_path / "board")
        host.write(b"$pwm:0,0,77,0#")
        host.close()
        await eventually(lambda: port.robot.plant.motors[1].pwm == 1677)


async def test_unplugging_hangs_up_and_replugging_brings_the_link_back(tmp_path: Path) -> None:
    link = tmp_path / "board"
    async with served(link) as port:
        host = Host(link)
        host.write(b"$read_vol#")
        await host.until(b"$Battery")
        assert port.command("unplug 0.2") == "ok"
        assert not os.path.lexists(link)
        await host.hung_up.wait()
        host.close()
        await eventually(lambda: os.path.lexists(link))
        await exchange(link, b"$read_vol#", b"$Battery")


async def test_a_host_that_does_not_read_loses_bytes_and_nothing_else(tmp_path: Path) -> None:
    async with served(tmp_path / "board", options=SimulationOptions(stream_pace="wire")) as port:
        host = Host(tmp_path / "board")
        asyncio.get_running_loop().remove_reader(host.fd)
        host.write(b"$upload:1,1,1#")
        await eventually(lambda: port.dropped_bytes > 2000)
        host.write(b"$pwm:0,0,77,0#")
        await eventually(lambda: port.robot.plant.motors[1].pwm == 1677)
        os.close(host.fd)


async def test_a_host_that_floods_is_held_back_by_its_own_buffer(tmp_path: Path) -> None:
    async with served(tmp_path / "board") as port:
        host = Host(tmp_path / "board")
        for _ in range(100):
            with contextlib.suppress(BlockingIOError):
                host.write(b"\n" * 4096)
            await asyncio.sleep(0.001)
        most_ns = BACKLOG_NS + transfer_ns(READ_BYTES, 115200)
        assert port.robot.host_backlog_ns(time.monotonic_ns()) <= most_ns
        host.close()


async def test_while_the_port_takes_nothing_what_the_host_writes_stays_in_the_kernel(
    tmp_path: Path,
) -> None:
    async with served(tmp_path / "board") as port:
        host = Host(tmp_path / "board")
        host.write(b"$read_vol#")
        await host.until(b"$Battery")
        assert port.command("stall 1000").startswith("ok until ")
        host.write(b"\n" * 64)
        await eventually(lambda: unread(port._master) == 64)
        host.write(b"$read_flash#")
        await eventually(lambda: unread(port._master) == 64 + len(b"$read_flash#"))
        assert port.command("stall 0").startswith("ok until ")
        await host.until(b"Motor_Version")
        host.close()


async def test_a_port_without_a_host_is_looked_at_now_and_then_only(tmp_path: Path) -> None:
    async with served(tmp_path / "board") as port:
        await exchange(tmp_path / "board", b"$read_vol#", b"$Battery")
        await eventually(lambda: not port.has_host)
        assert not asyncio.get_running_loop().remove_reader(port._master)


async def test_control_and_truth_come_with_it_and_go_with_it(tmp_path: Path) -> None:
    control, truth, link = tmp_path / "control", tmp_path / "truth", tmp_path / "board"
    async with served(link, control=control, truth=truth, at_start=["stalled right"]) as port:
        assert port.robot.plant.motors[1].faults.stalled
        reader, writer = await asyncio.open_unix_connection(control)
        writer.write(b"repair right\n")
        assert await reader.readline() == b"ok\n"
        assert not port.robot.plant.motors[1].faults.stalled
        writer.close()
        await writer.wait_closed()
        await exchange(link, b"$spd:300,0,300,0#$read_vol#", b"\r\n")
        await eventually(lambda: len(read_truth(truth)) > 20)
    assert not control.exists()
    assert not os.path.lexists(link)
    stamps = [sample.t_ns for sample in read_truth(truth)]
    assert stamps == sorted(stamps)


@pytest.mark.parametrize(
    ("kwargs", "words"),
    [
        ({"at_start": ["explode"]}, "at the start: unknown command 'explode'"),
        (
            {"truth": Path("/nowhere/truth")},
            "ground truth cannot be written to /nowhere/truth: No such file",
        ),
        ({"control": Path("/nowhere/control")}, "control socket .*: No such file"),
    ],
)
async def test_what_cannot_be_used_is_named_and_nothing_is_left(
    tmp_path: Path, kwargs: dict[str, Any], words: str
) -> None:
    waiting: Awaitable[None] = serve(SimulatedRobot(), link=tmp_path / "board", **kwargs)
    with pytest.raises(ConfigError, match=words):
        await waiting
    assert not os.path.lexists(tmp_path / "board")


async def test_a_file_in_the_place_of_the_link_is_not_touched(tmp_path: Path) -> None:
    link = tmp_path / "board"
    link.write_text("precious")
    with pytest.raises(ConfigError, match="is not a link"):
        await serve(SimulatedRobot(), link=link)
    assert link.read_text() == "precious"


async def test_a_second_board_neither_takes_nor_removes_the_link_of_the_first(
    tmp_path: Path,
) -> None:
    link = tmp_path / "board"
    async with served(link, truth=tmp_path / "truth") as port:
        with pytest.raises(ConfigError, match=r"simulated or replayed board runs behind .*board\."):
            await serve(SimulatedRobot(), link=link, truth=tmp_path / "truth")
        assert str(link.readlink()) == port.name
        await exchange(link, b"$read_vol#", b"$Battery")
    async with served(link) as port:
        await exchange(link, b"$read_vol#", b"$Battery")


async def test_a_link_that_was_left_behind_is_taken_over(tmp_path: Path) -> None:
    link = tmp_path / "board"
    link.symlink_to("/dev/pts/gone")
    async with served(link) as port:
        assert str(link.readlink()) == port.name


async def test_a_link_that_points_elsewhere_by_now_is_left_alone(tmp_path: Path) -> None:
    link = tmp_path / "board"
    async with served(link):
        link.unlink()
        link.symlink_to("/dev/pts/another")
    assert str(link.readlink()) == "/dev/pts/another"


async def test_an_error_inside_ends_the_service(tmp_path: Path) -> None:
    robot = SimulatedRobot()

    def fail(_sample: object) -> None:
        raise ZeroDivisionError

    robot.on_truth = fail
    with pytest.raises(ZeroDivisionError):
        await serve(robot, link=tmp_path / "board")
    assert not os.path.lexists(tmp_path / "board")


async def test_what_the_host_says_is_written_with_the_time_it_was_taken(tmp_path: Path) -> None:
    heard = tmp_path / "heard"
    before_ns = time.monotonic_ns()
    async with served(tmp_path / "board", heard=heard) as port:
        host = Host(port.name)
        host.write(b"$read_flash#")
        await host.until(b"Motor_Version")
        host.close()
    lines = read_heard(heard)
    assert "".join(line.data for line in lines) == "$read_flash#"
    assert before_ns < lines[0].t_ns < time.monotonic_ns()
