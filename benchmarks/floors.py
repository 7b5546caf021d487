"""Floors: processes that write received bytes to a port, and do nothing else.

python -m benchmarks.floors zenoh tcp/127.0.0.1:PORT PTY
python -m benchmarks.floors socket tcp/127.0.0.1:PORT PTY
python -m benchmarks.floors timer 50 PTY
python -m benchmarks.floors poll 5 PTY
"""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import sys
import threading
import time

import zenoh
from zenoh.handlers import Callback


def zenoh_floor(endpoint: str, fd: int) -> None:
    """A bare callback of a session that is a router, as the daemon's is."""
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    done = threading.Event()
    signal.signal(signal.SIGTERM, lambda _number, _frame: done.set())
    with zenoh.open(config) as session:

        def heard(sample: zenoh.Sample) -> None:
            os.write(fd, sample.payload.to_bytes())

        session.declare_subscriber("cmd_vel", Callback(heard, indirect=False))
        print("ready", flush=True)
        done.wait()


def socket_floor(endpoint: str, fd: int) -> None:
    """A TCP connection on loopback."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    with socket.create_server((host, int(port))) as server:
        print("ready", flush=True)
        connection, _ = server.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while data := connection.recv(4096):
            os.write(fd, data)


def timer_floor(rate_hz: str, fd: int) -> None:
    """Sleep until the time, write a request, repeat: the limit of the machine."""
    period_ns = round(1e9 / float(rate_hz))
    due_ns = time.monotonic_ns() + period_ns
    print("ready", flush=True)
    while True:
        time.sleep(max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))
        os.write(fd, b"$read#")
        due_ns += period_ns


def poll_floor(seconds: str, fd: int) -> None:
    """Poll, wait for the answer, poll again: the limit of board and machine."""
    os.write(fd, b"$mtype:1#")
    polls = 0
    start_ns = time.monotonic_ns()
    end_ns = start_ns + round(float(seconds) * 1e9)
    while (now_ns := time.monotonic_ns()) < end_ns:
        os.write(fd, b"$read#")
        answer = b""
        while b"#" not in answer:
            if select.select([fd], [], [], 1.0)[0]:
                answer += os.read(fd, 4096)
        polls += 1
    print("polls", polls / (now_ns - start_ns) * 1e9, flush=True)


if __name__ == "__main__":
    port_fd = os.open(sys.argv[3], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    FLOORS = {
        "zenoh": zenoh_floor,
        "socket": socket_floor,
        "timer": timer_floor,
        "poll": poll_floor,
    }
    FLOORS[sys.argv[1]](sys.argv[2], port_fd)
