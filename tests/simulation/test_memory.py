from __future__ import annotations

import asyncio
import errno

import pytest

from yahboomd.core.errors import PortBusy, PortMissing
from yahboomd.simulation.memory import MemoryPort
from yahboomd.simulation.options import ImpairmentOptions, SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.virtual_time import on_virtual_time


class Host:
    """Keeps what arrives, and when."""

    def __init__(self, robot: SimulatedRobot) -> None:
        self.chunks: list[tuple[float, bytes]] = []
        self.lost: list[Exception | None] = []
        self.port = MemoryPort(robot, on_data=self._data, on_lost=self.lost.append)
        self.port.open()

    def _data(self, data: bytes) -> None:
        self.chunks.append((asyncio.get_running_loop().time(), data))

    @property
    def heard(self) -> bytes:
        return b"".join(data for _, data in self.chunks)


def polled(**options: object) -> SimulatedRobot:
    return SimulatedRobot(SimulationOptions(dialect="polled", **options))


def now_ns() -> int:
    return round(asyncio.get_running_loop().time() * 1e9)


@on_virtual_time
async def test_an_answer_arrives_after_its_time_on_the_wire() -> None:
    host = Host(polled())
    start = asyncio.get_running_loop().time()
    host.port.write(b"$read#")
    await asyncio.sleep(0.1)
    assert host.heard == b"$data:0,0,0,0#"
    wire_s = 20 * 10 / 115200
    assert wire_s <= host.chunks[-1][0] - start <= wire_s + 0.0003
    host.port.close()


@on_virtual_time
async def test_bytes_arrive_in_chunks_of_a_millisecond() -> None:
    host = Host(SimulatedRobot())
    host.port.write(b"$read_flash#")
    await asyncio.sleep(0.1)
    assert host.heard.startswith(b"read_flash:OK!\r\n")
    assert all(len(data) <= 12 for _, data in host.chunks)
    assert len(host.chunks) >= len(host.heard) // 12
    host.port.close()


@on_virtual_time
async def test_bytes_can_arrive_one_at_a_time() -> None:
    host = Host(polled(impairments=ImpairmentOptions(chunk_s=0.0)))
    host.port.write(b"$read#")
    await asyncio.sleep(0.1)
    assert [data for _, data in host.chunks] == [bytes([b]) for b in b"$data:0,0,0,0#"]
    host.port.close()


@on_virtual_time
async def test_a_pulled_plug_is_reported_once_and_nothing_arrives_after() -> None:
    robot = SimulatedRobot()
    host = Host(robot)
    host.port.write(b"$upload:1,0,0#")
    await asyncio.sleep(0.5)
    robot.unplug(now_ns())
    await asyncio.sleep(0)
    assert [why.errno for why in host.lost if isinstance(why, OSError)] == [errno.EIO]
    heard = host.heard
    host.port.write(b"$read_vol#")
    host.port.close()
    await asyncio.sleep(1.0)
    assert host.heard == heard
    assert len(host.lost) == 1


@on_virtual_time
async def test_an_unplugged_board_cannot_be_opened_until_it_is_back() -> None:
    robot = SimulatedRobot()
    host = Host(robot)
    robot.unplug(now_ns(), 2.0)
    with pytest.raises(PortMissing):
        MemoryPort(robot).open()
    await asyncio.sleep(2.1)
    again = Host(robot)
    again.port.write(b"$read_vol#")
    await asyncio.sleep(0.1)
    assert again.heard == b"$Battery:7.4V#\r\n"
    again.port.close()
    assert host.lost


@on_virtual_time
async def test_the_board_drives_on_while_the_port_is_closed() -> None:
    robot = SimulatedRobot()
    host = Host(robot)
    host.port.write(b"$spd:300,0,300,0#")
    await asyncio.sleep(1.0)
    host.port.close()
    await asyncio.sleep(10.0)
    assert host.lost == [None]
    again = Host(robot)
    assert robot.truth(now_ns()).x == pytest.approx(3.3, abs=0.1)
    assert again.heard == b""
    again.port.close()


@on_virtual_time
async def test_bytes_sent_before_a_connection_are_lost() -> None:
    robot = SimulatedRobot()
    host = Host(robot)
    host.port.write(b"$upload:1,0,0#")
    await asyncio.sleep(0.1)
    host.port.close()
    await asyncio.sleep(5.0)
    again = Host(robot)
    await asyncio.sleep(0.1)
    assert 20 < again.heard.count(b"$MAll") < 60
    again.port.close()


@on_virtual_time
async def test_a_port_has_one_owner() -> None:
    robot = SimulatedRobot()
    host = Host(robot)
    with pytest.raises(PortBusy):
        MemoryPort(robot).open()
    host.port.close()
    MemoryPort(robot).open()


@on_virtual_time
async def test_draining_waits_for_the_wire_and_no_longer_than_its_timeout() -> None:
    host = Host(SimulatedRobot())
    loop = asyncio.get_running_loop()
    host.port.write(b"\n" * 1152)
    start = loop.time()
    assert not await host.port.drain(0.03)
    assert loop.time() - start == pytest.approx(0.03)
    assert await host.port.drain(1.0)
    assert loop.time() - start == pytest.approx(0.1)
    host.port.close()
    assert not await host.port.drain(1.0)


@on_virtual_time
async def test_a_listener_may_close_the_port_at_its_first_bytes() -> None:
    host = Host(SimulatedRobot())
    heard: list[bytes] = []

    def close(data: bytes) -> None:
        heard.append(data)
        host.port.close()

    host.port.listen(close, host.lost.append)
    host.port.write(b"$read_flash#")
    await asyncio.sleep(0.5)
    assert len(heard) == 1
    assert not host.port.is_open


@on_virtual_time
async def test_a_disturbance_takes_effect_at_once_when_the_port_is_poked() -> None:
    robot = SimulatedRobot()
    host = Host(robot)
    robot.reset(now_ns())
    host.port.poke()
    await asyncio.sleep(0.2)
    assert host.heard == b"\r\nReset MCU\rMotor_Version:1.7.3\r\n"
    host.port.close()
