"""The article's bridge, rebuilt without ROS.

    python -m benchmarks.article PTY PORT LOG

Rebuilt from the description in "Building a ROS 2 Hardware Bridge for Yahboom 520 Motor Drivers":
one process, one serial handle, one thread. A timer asks for the counters 20 times a second with
``readline()``. Its time-out of 50 ms always runs out, because the board ends its answers with ``#``
alone. The pose is integrated at the midpoint from the difference to the last counts, which are 0 at
the start. A velocity becomes wheel speeds times SCALE_FACTOR 1000, each wheel clipped by itself,
and is written once. A socket on loopback delivers velocities in place of ROS, which costs less; as
in a single-threaded executor, one callback runs at a time. At its end it sends one speed of zero.
Poses go to LOG, one JSON line each.
"""

from __future__ import annotations

import json
import math
import select
import signal
import socket
import sys
import time
from pathlib import Path
from typing import IO

import serial

WHEEL_RADIUS_M = 0.0325
WHEEL_SEPARATION_M = 0.15
TICKS_PER_REV = 1320.0
SCALE_FACTOR = 1000.0
MAX_COMMAND = 1000
PERIOD_S = 0.05
READ_TIMEOUT_S = 0.05


class Bridge:
    """Serial port in, pose out."""

    def __init__(self, path: str, log: IO[str]) -> None:
        self._serial = serial.Serial(path, 115200, timeout=READ_TIMEOUT_S)
        self._log = log
        self._left = self._right = 0
        self.readings = 0
        self.x = self.y = self.theta = 0.0
        self._serial.write(b"$mtype:1#")
        time.sleep(0.1)

    def velocity(self, vx: float, wz: float) -> None:
        """The callback of cmd_vel."""
        left = vx - wz * WHEEL_SEPARATION_M / 2.0
        right = vx + wz * WHEEL_SEPARATION_M / 2.0
        a, c = (
            max(-MAX_COMMAND, min(MAX_COMMAND, int(speed * SCALE_FACTOR)))
            for speed in (left, right)
        )
        try:
            self._serial.write(f"$speed:{a},0,{c},0#".encode())
        except (serial.SerialException, OSError) as error:
            print("write failed:", error, flush=True)

    def poll(self) -> None:
        """The callback of the timer."""
        try:
            self._serial.write(b"$read#")
            line = self._serial.readline().decode().strip()
            if line.startswith("$data:") and line.endswith("#"):
                values = [int(part) for part in line[6:-1].split(",")]
                self._integrate(values[0], values[2])
        except Exception as error:  # noqa: BLE001 - as such bridges do
            print("poll failed:", error, flush=True)

    def stop(self) -> None:
        """Stop the wheels at the end of the node."""
        self._serial.write(b"$speed:0,0,0,0#")
        self._serial.flush()

    def _integrate(self, left: int, right: int) -> None:
        per_tick = 2.0 * math.pi * WHEEL_RADIUS_M / TICKS_PER_REV
        moved_left = (left - self._left) * per_tick
        moved_right = (right - self._right) * per_tick
        self._left, self._right = left, right
        self.readings += 1
        distance = (moved_left + moved_right) / 2.0
        turn = (moved_right - moved_left) / WHEEL_SEPARATION_M
        self.x += distance * math.cos(self.theta + turn / 2.0)
        self.y += distance * math.sin(self.theta + turn / 2.0)
        self.theta += turn
        pose = (time.monotonic_ns(), self.x, self.y, self.theta)
        self._log.write(json.dumps(pose) + "\n")


def spin(bridge: Bridge, commands: socket.socket) -> None:
    """Run one callback after the other, the timer's first."""
    due = time.monotonic() + PERIOD_S
    pending = b""
    while True:
        wait_s = max(0.0, due - time.monotonic())
        ready, _, _ = select.select([commands], [], [], wait_s)
        if time.monotonic() >= due:
            # A late timer skips the periods that it missed.
            due += PERIOD_S * max(1, math.ceil((time.monotonic() - due) / PERIOD_S))
            bridge.poll()
        if ready:
            data = commands.recv(4096)
            if not data:
                return
            *lines, pending = (pending + data).split(b"\n")
            for line in lines:
                bridge.velocity(*json.loads(line))


if __name__ == "__main__":
    with (
        Path(sys.argv[3]).open("w", buffering=1) as file,
        socket.create_server(("127.0.0.1", int(sys.argv[2]))) as server,
    ):
        node = Bridge(sys.argv[1], file)
        print("ready", flush=True)
        connection, _ = server.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # The end of a ROS node ends its spinning; then the node stops the wheels.
        signal.signal(signal.SIGTERM, lambda _number, _frame: sys.exit(0))
        try:
            spin(node, connection)
        finally:
            node.stop()
