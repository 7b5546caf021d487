"""The port on a real pty: locked, never blocking, and honest about its loss."""

from __future__ import annotations

import asyncio
import errno
import fcntl
import os
import pty
import tty
from collections.abc import AsyncIterator, Callable, Iterator

import pytest
import serial_asyncio

from yahboomd.core.clock import SystemClock
from yahboomd.core.errors import LinkError, PortBusy, PortLost, PortMissing
from yahboomd.core.link.port import (
    MAX_PENDING,
    PortOptions,
    SerialPort,
    _Serial,
    adopt,
    byte_time_ns,
    open_port,
)
from yahboomd.core.link.port_errors import lost
from yahboomd.core.link.seize import FIRST_WORDS, seize

pytestmark = pytest.mark.realtime


class Device:
    """The far side of a pty."""

    def __init__(self) -> None:
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        os.close(slave)

    def read(self, size: int = 65536) -> bytes:
        try:
            return os.read(self.master, size)
        except OSError:
            return b""

    def read_first_words(self) -> None:
        """Read the first words of a port, which may come in pieces."""
        left = len(b"".join(FIRST_WORDS.values()))
        while left:
            left -= len(self.read(left))

    def close(self) -> None:
        if self.master >= 0:
            os.close(self.master)
            self.master = -1


@pytest.fixture
def device() -> Iterator[Device]:
    device = Device()
    yield device
    device.close()


@pytest.fixture
async def port(device: Device) -> SerialPort:
    port = await open_port(PortOptions(path=device.path), SystemClock())
    yield port  # type: ignore[misc]
    port.close()


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(60):
        while not condition():
            await asyncio.sleep(0.001)


def test_a_byte_at_115200_baud_takes_86_8_microseconds() -> None:
    assert byte_time_ns(115200) == 86_805


async def test_bytes_pass_both_ways(port: SerialPort, device: Device) -> None:
    heard: list[bytes] = []
    port.listen(heard.append, lambda _: None)
    os.write(device.master, b"$data:1,2,3,4#")
    await until(lambda: b"".join(heard) == b"$data:1,2,3,4#")
    port.write(b"$read#")
    # Written at once: it is there before the loop turned.
    assert device.read() == b"$read#"


async def test_a_port_that_was_seized_is_carried_on_without_being_opened_again(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    seized = seize(device.path)
    device.read_first_words()
    with monkeypatch.context() as patched:
        patched.delattr(os, "open")
        port = await adopt(seized, SystemClock())
    heard: list[bytes] = []
    gone: list[Exception | None] = []
    port.listen(heard.append, gone.append)
    port.write(b"$read_flash#")
    assert device.read() == b"$read_flash#"
    os.write(device.master, b"read_flash:OK!\r\n")
    await until(lambda: b"".join(heard) == b"read_flash:OK!\r\n")
    device.close()
    await until(lambda: gone)
    assert gone == [None]


@pytest.mark.parametrize("seized", [True, False])
async def test_a_port_that_hangs_up_before_it_is_carried_is_lost_and_closed(
    device: Device, monkeypatch: pytest.MonkeyPatch, seized: bool
) -> None:
    if seized:
        held = seize(device.path)
        device.close()
        with pytest.raises(PortLost, match="went away"):
            await adopt(held, SystemClock())
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(held.fd)
        return
    configure = _Serial.configure

    def configure_and_hang_up(self: _Serial, *, hangup_on_close: bool) -> None:
        configure(self, hangup_on_close=hangup_on_close)
        device.close()

    monkeypatch.setattr(_Serial, "configure", configure_and_hang_up)
    with pytest.raises(PortLost, match="went away"):
        await open_port(PortOptions(path=device.path), SystemClock())


async def test_what_waits_is_dropped_where_it_is_discarded(port: SerialPort) -> None:
    port.listen(lambda _: None, lambda _: None)
    while not port.pending:
        port.write(b"x" * 1024)
    port.discard()
    assert port.pending == 0


async def test_a_second_owner_is_refused_and_the_first_is_named(
    port: SerialPort, device: Device
) -> None:
    with pytest.raises(PortBusy, match="held") as caught:
        await open_port(PortOptions(path=device.path), SystemClock())
    assert "stop the other one" in str(caught.value)


async def test_a_missing_port_is_named_with_the_remedy() -> None:
    with pytest.raises(PortMissing, match=r"/dev/not-there.*plugged in"):
        await open_port(PortOptions(path="/dev/not-there"), SystemClock())


async def test_what_is_no_serial_port_is_refused() -> None:
    with pytest.raises(LinkError, match=r"^/dev/null: this is no serial port\."):
        await open_port(PortOptions(path="/dev/null"), SystemClock())


async def test_an_idle_port_that_hangs_up_is_reported(port: SerialPort, device: Device) -> None:
    gone: list[Exception | None] = []
    port.listen(lambda _: None, gone.append)
    device.close()
    await until(lambda: gone)
    assert lost(port.name, gone[0]).message == f"{port.name}: the port went away."


async def test_a_port_that_hangs_up_with_output_waiting_is_reported(
    port: SerialPort, device: Device
) -> None:
    gone: list[Exception | None] = []
    port.listen(lambda _: None, gone.append)
    while not port.pending:
        port.write(b"x" * 1024)
    device.close()
    await until(lambda: gone)
    assert len(gone) == 1


async def test_writing_to_a_lost_port_neither_raises_nor_reports_again(
    port: SerialPort, device: Device
) -> None:
    gone: list[Exception | None] = []
    port.listen(lambda _: None, gone.append)
    device.close()
    port.write(b"$read#")
    await until(lambda: gone)
    port.write(b"$read#")
    assert port.pending == 0
    assert len(gone) == 1


@pytest.mark.parametrize("call", ["read", "write"])
async def test_an_error_of_the_usb_ends_the_port_once_with_its_number(
    port: SerialPort, device: Device, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    """Interference on the cable: EPROTO, while the far side still holds its end."""
    gone: list[Exception | None] = []
    port.listen(lambda _: None, gone.append)
    real = getattr(os, call)

    def disturbed(fd: int, what: object) -> object:
        if fd == port.fileno():
            raise OSError(errno.EPROTO, os.strerror(errno.EPROTO))
        return real(fd, what)

    with monkeypatch.context() as patched:
        patched.setattr(os, call, disturbed)
        if call == "read":
            os.write(device.master, b"$data:1,2,3,4#")
        else:
            port.write(b"$spd:300,0,300,0#")
        await until(lambda: gone)
        port.write(b"$spd:300,0,300,0#")
        await until(lambda: port._transport is None)
    assert [getattr(each, "errno", None) for each in gone] == [errno.EPROTO]


async def test_output_that_is_not_taken_is_bounded_and_ends_the_port(port: SerialPort) -> None:
    gone: list[Exception | None] = []
    port.listen(lambda _: None, gone.append)
    for _ in range(100):
        port.write(b"x" * 1024)
        assert port.pending <= MAX_PENDING + 1024
    assert gone
    assert getattr(gone[0], "errno", None) == errno.ETIMEDOUT


async def test_output_that_the_kernel_took_in_part_arrives_whole(
    port: SerialPort, device: Device
) -> None:
    port.listen(lambda _: None, lambda _: None)
    sent = 0
    while not port.pending:
        port.write(b"0123456789abcdef" * 64)
        sent += 1024
    received = 0
    async with asyncio.timeout(60):
        while received < sent:
            received += len(await asyncio.to_thread(device.read))
    assert received == sent
    assert await port.drain(60.0)


async def test_closing_a_port_that_takes_no_output_does_not_block(
    device: Device,
) -> None:
    port = await open_port(PortOptions(path=device.path), SystemClock())
    port.listen(lambda _: None, lambda _: None)
    while not port.pending:
        port.write(b"x" * 1024)
    assert not await port.drain(0.02)
    port.close()
    with pytest.raises(OSError, match="Bad file descriptor"):
        fcntl.fcntl(port._fd, fcntl.F_GETFD)


# The library's own behaviour, and why the port does not rely on it.


class Bare(asyncio.Protocol):
    """Keeps the calls of the library's own transport."""

    def __init__(self) -> None:
        self.losses: list[Exception | None] = []

    def connection_lost(self, exc: Exception | None) -> None:
        self.losses.append(exc)


@pytest.fixture
async def bare(device: Device) -> AsyncIterator[tuple[serial_asyncio.SerialTransport, Bare]]:
    """The library alone, with output waiting that is not taken."""
    loop = asyncio.get_running_loop()
    transport, protocol = await serial_asyncio.create_serial_connection(loop, Bare, device.path)
    transport.write(b"x" * 100_000)
    await turns()
    assert transport.get_write_buffer_size()
    yield transport, protocol
    transport.abort()
    await turns()


async def turns() -> None:
    """Enough iterations of the loop for everything that needs no help from outside."""
    for _ in range(50):
        await asyncio.sleep(0)


@pytest.fixture
def unreadable(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """From its call on, every read fails as if the device were gone."""
    read = os.read

    def failing(fd: int, size: int) -> bytes:
        if os.isatty(fd):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return read(fd, size)

    return lambda: monkeypatch.setattr(os, "read", failing)


async def test_the_library_alone_never_ends_a_close_with_output_that_is_not_taken(
    bare: tuple[serial_asyncio.SerialTransport, Bare],
) -> None:
    transport, protocol = bare
    transport.close()
    await turns()
    assert protocol.losses == []
    assert transport.serial.is_open
    # And later writes do not report it.
    transport.write(b"$spd:0,0,0,0#")
    assert b"".join(transport._write_buffer).find(b"$spd") == -1


async def test_the_library_alone_hides_a_read_that_failed_while_output_waits(
    bare: tuple[serial_asyncio.SerialTransport, Bare],
    device: Device,
    unreadable: Callable[[], None],
) -> None:
    transport, protocol = bare
    unreadable()
    os.write(device.master, b"x")
    await until(transport.is_closing)
    await turns()
    assert protocol.losses == []


async def test_a_read_that_fails_while_output_waits_is_reported(
    port: SerialPort, device: Device, unreadable: Callable[[], None]
) -> None:
    gone: list[Exception | None] = []
    port.listen(lambda _: None, gone.append)
    while not port.pending:
        port.write(b"x" * 1024)
    unreadable()
    os.write(device.master, b"x")
    await until(lambda: gone)
    assert len(gone) == 1
    assert "Input/output error" in str(gone[0])
