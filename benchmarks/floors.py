"""Processes that do the least at a port: the floors of the measurements.

python -m benchmarks.floors zenoh tcp/127.0.0.1:PORT PTY
python -m benchmarks.floors loop tcp/127.0.0.1:PORT PTY
python -m benchmarks.floors socket tcp/127.0.0.1:PORT PTY
python -m benchmarks.floors streamed tcp/127.0.0.1:PORT PTY
python -m benchmarks.floors streamed-drives tcp/127.0.0.1:PORT PTY
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from functools import partial

import msgspec
import zenoh
from zenoh.handlers import Callback


def router(endpoint: str) -> zenoh.Config:
    """The configuration of a router that listens for itself."""
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return config


def zenoh_floor(endpoint: str, fd: int) -> None:
    """Write in the bare callback of a session that is a router, as the daemon's is."""
    done = threading.Event()
    signal.signal(signal.SIGTERM, lambda _number, _frame: done.set())
    with zenoh.open(router(endpoint)) as session:

        def heard(sample: zenoh.Sample) -> None:
            os.write(fd, sample.payload.to_bytes())

        session.declare_subscriber("cmd_vel", Callback(heard, indirect=False))
        print("ready", flush=True)
        done.wait()


def loop_floor(endpoint: str, fd: int) -> None:
    """Write through an event loop that has nothing else to do."""

    async def write() -> None:
        loop, done = asyncio.get_running_loop(), asyncio.Event()
        loop.add_signal_handler(signal.SIGTERM, done.set)

        def heard(sample: zenoh.Sample) -> None:
            loop.call_soon_threadsafe(os.write, fd, sample.payload.to_bytes())

        session.declare_subscriber("cmd_vel", Callback(heard, indirect=False))
        print("ready", flush=True)
        await done.wait()

    with zenoh.open(router(endpoint)) as session:
        asyncio.run(write())


def socket_floor(endpoint: str, fd: int) -> None:
    """Write the bytes of a TCP connection on loopback."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    with socket.create_server((host, int(port))) as server:
        print("ready", flush=True)
        connection, _ = server.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while data := connection.recv(4096):
            os.write(fd, data)


class Counted(msgspec.Struct):
    """The sample of a bare reader: as many numbers as a pose has."""

    stamp_ns: int
    seq: int
    x: float
    y: float
    theta: float
    ticks: tuple[int, ...]


def reader_floor(dialect: str, endpoint: str, fd: int) -> None:
    """Do the least that an asyncio program does with counts: read, cut, decode; at 50 Hz, put.

    A ``polled`` board is asked 50 times a second, a ``streamed`` one once.
    """
    with zenoh.open(router(endpoint)) as session:
        publisher = session.declare_publisher(
            "yahboomd/pose", congestion_control=zenoh.CongestionControl.DROP
        )
        asyncio.run(read_counts(dialect, fd, publisher.put))


def driver_floor(dialect: str, endpoint: str, fd: int) -> None:
    """Do the least that drives: as :func:`reader_floor`, but with three samples for the one, and a
    frame of speeds for each command, which the event loop writes. No odometry, no safety."""
    with zenoh.open(router(endpoint)) as session:
        publishers = [
            session.declare_publisher(
                f"yahboomd/{key}", congestion_control=zenoh.CongestionControl.DROP
            )
            for key in ("pose", "twist", "wheels")
        ]

        def put(payload: bytes) -> None:
            for publisher in publishers:
                publisher.put(payload)

        frame = b"$spd:%d,0,%d,0#" if dialect == "streamed" else b"$speed:%d,0,%d,0#"
        decode = msgspec.json.Decoder(Commanded).decode

        def drive(payload: bytes) -> None:
            command = decode(payload)
            speed, turn = 1000.0 * command.vx, 100.0 * command.wz
            os.write(fd, frame % (round(speed - turn), round(speed + turn)))

        async def run() -> None:
            loop = asyncio.get_running_loop()

            def heard(sample: zenoh.Sample) -> None:
                loop.call_soon_threadsafe(drive, sample.payload.to_bytes())

            session.declare_subscriber("cmd_vel", Callback(heard, indirect=False))
            await read_counts(dialect, fd, put)

        asyncio.run(run())


class Commanded(msgspec.Struct):
    """A command: metres and radians a second."""

    vx: float
    wz: float


async def read_counts(dialect: str, fd: int, put: Callable[[bytes], object]) -> None:
    """Read until SIGTERM."""
    loop, done = asyncio.get_running_loop(), asyncio.Event()
    loop.add_signal_handler(signal.SIGTERM, done.set)
    encode = msgspec.json.Encoder().encode
    rest, due_ns, seq = b"", 0, 0

    def heard() -> None:
        nonlocal rest, due_ns, seq
        *frames, rest = (rest + os.read(fd, 4096)).split(b"#")
        for frame in frames:
            name, _, counts = frame.partition(b":")
            if not name.endswith((b"$MAll", b"$data")):
                continue
            a, b, c, d = map(int, counts.split(b","))
            now_ns = time.monotonic_ns()
            if now_ns < due_ns - 5_000_000:
                continue
            due_ns = max(due_ns, now_ns - 20_000_000) + 20_000_000
            seq += 1
            put(encode(Counted(now_ns, seq, a + b, a - b, c - d, (a, b, c, d))))

    def ask(due_s: float) -> None:
        os.write(fd, b"$read#")
        loop.call_at(due_s + 0.02, ask, due_s + 0.02)

    loop.add_reader(fd, heard)
    if dialect == "polled":
        ask(loop.time())
    else:
        os.write(fd, b"$upload:1,0,0#")
    print("ready", flush=True)
    await done.wait()


if __name__ == "__main__":
    port_fd = os.open(sys.argv[3], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    FLOORS = {
        "zenoh": zenoh_floor,
        "loop": loop_floor,
        "socket": socket_floor,
        "streamed": partial(reader_floor, "streamed"),
        "polled": partial(reader_floor, "polled"),
        "streamed-drives": partial(driver_floor, "streamed"),
        "polled-drives": partial(driver_floor, "polled"),
    }
    FLOORS[sys.argv[1]](sys.argv[2], port_fd)
