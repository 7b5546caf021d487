"""A board that costs next to nothing: fixed answers on a pty, and a stamp on every received byte.

    python -m benchmarks.thin_board --links /tmp/port0 --log /tmp/heard --dialect streamed

The simulated robot of ``yahboomd simulate`` computes motors and a chassis, in Python, on the same
machine, and would cost as much as the daemon. This one answers as a board does, turns its counters
at the commanded speed, and writes whole lines at the time at which their last byte would be out.
Its log, written at the end, has (port, monotonic ns, bytes) of everything received.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import os
import re
import select
import signal
import time
import tty
from pathlib import Path

import msgspec

BYTE_NS = 86_806
CARRY_OUT_NS = 200_000
FRAME = re.compile(rb"\$([a-z_]+):?([^#$]*)#")
TICKS_PER_MM = 1320.0 / (3.141592653589793 * 67.0)
FLASH = (
    b"read_flash:OK!\r\nMotor_Version:1.7.3\r\nMotor_type:1\r\nDead_Zone:1900\r\nPulse_Line:11\r\n"
    b"Pulse_Phase:30\r\nwheel_diameter:67.000\r\nP:0.800\t I:0.060\t D:0.500\t \r\n"
)


class Log(msgspec.Struct):
    """The log of a board.

    Attributes:
        heard: Received bytes as (port, monotonic nanoseconds, bytes).
    """

    heard: list[tuple[int, int, bytes]]


class ThinBoard:
    """One port.

    Args:
        index: Its number in the log.
        link: A name for the pty.
        dialect: ``streamed`` or ``polled``; ``silent`` only listens.
        line_ns: The period of lines of a stream.
        ticks: The counters at the start.
    """

    def __init__(
        self,
        index: int,
        link: Path,
        *,
        dialect: str,
        line_ns: int,
        ticks: int,
    ) -> None:
        self.index = index
        self._dialect = dialect
        self._line_ns = line_ns
        self.fd, slave = os.openpty()
        tty.setraw(slave)
        self._slave = slave  # kept open: the pty never hangs up
        os.set_blocking(self.fd, False)
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(slave))
        self._speeds = [0.0] * 4
        self._travel = [float(ticks)] * 4
        self._moved_ns = time.monotonic_ns()
        self._streaming = False
        self._due: list[tuple[int, bytes]] = []
        self._line_due_ns = 0
        self._rest = b""

    def next_ns(self) -> int:
        """The time at which something is to be sent."""
        moments = [due_ns for due_ns, _ in self._due[:1]]
        if self._streaming:
            moments.append(self._line_due_ns)
        return min(moments, default=1 << 62)

    def speak(self, now_ns: int) -> None:
        """Send everything that is due."""
        while self._due and self._due[0][0] <= now_ns:
            self._say(self._due.pop(0)[1])
        if self._streaming and now_ns >= self._line_due_ns:
            # A board does not send missed lines later.
            self._line_due_ns = max(self._line_due_ns + self._line_ns, now_ns)
            self._say(b"$MAll:%d,%d,%d,%d#\r\n" % self._counters(now_ns))

    def hear(self, log: list[tuple[int, int, bytes]]) -> None:
        """Read, and stamp the bytes."""
        data = os.read(self.fd, 4096)
        now_ns = time.monotonic_ns()
        log.append((self.index, now_ns, data))
        if self._dialect == "silent":
            return
        self._rest += data
        end = 0
        for match in FRAME.finditer(self._rest):
            end = match.end()
            self._obey(match[1], match[2], now_ns, match.end() - match.start())
        self._rest = self._rest[end:][-128:]

    def _counters(self, now_ns: int) -> tuple[int, int, int, int]:
        elapsed_s = (now_ns - self._moved_ns) * 1e-9
        self._moved_ns = now_ns
        for n, speed in enumerate(self._speeds):
            self._travel[n] += speed * elapsed_s * TICKS_PER_MM
        a, b, c, d = map(int, self._travel)
        return a, b, c, d

    def _obey(self, name: bytes, args: bytes, now_ns: int, size: int) -> None:
        streamed = self._dialect == "streamed"
        if name == (b"spd" if streamed else b"speed"):
            self._counters(now_ns)
            self._speeds = [float(part) for part in args.split(b",")]
        elif streamed and name == b"pwm":
            self._counters(now_ns)
            self._speeds = [0.0] * 4
        elif streamed and name == b"upload":
            self._streaming = args.startswith(b"1")
            self._line_due_ns = now_ns + self._line_ns
        elif streamed and name == b"read_flash":
            self._answer(FLASH, now_ns, size)
        elif streamed and name == b"read_vol":
            self._answer(b"$Battery:7.4V#\r\n", now_ns, size)
        elif not streamed and name == b"read":
            self._answer(b"$data:%d,%d,%d,%d#" % self._counters(now_ns), now_ns, size)

    def _answer(self, data: bytes, now_ns: int, asked: int) -> None:
        wire_ns = (len(data) + asked) * BYTE_NS + CARRY_OUT_NS
        self._due.append((now_ns + wire_ns, data))

    def _say(self, data: bytes) -> None:
        # What nobody reads is lost.
        with contextlib.suppress(BlockingIOError):
            os.write(self.fd, data)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--links", nargs="+", type=Path, required=True)
    parser.add_argument("--log", type=Path, required=True)
    parser.add_argument("--dialect", default="streamed")
    parser.add_argument("--silent-from", type=int, default=1 << 30, help="these ports only listen")
    parser.add_argument("--line-us", type=int, default=5917, help="169 lines a second")
    parser.add_argument("--ticks", type=int, default=20_000)
    args = parser.parse_args()
    boards = [
        ThinBoard(
            index,
            link,
            dialect=args.dialect if index < args.silent_from else "silent",
            line_ns=args.line_us * 1000,
            ticks=args.ticks,
        )
        for index, link in enumerate(args.links)
    ]
    log = Log(heard=[])
    stop: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: stop.append(number))
    by_fd = {board.fd: board for board in boards}
    print("ready", flush=True)
    gc.disable()
    while not stop:
        wait_ns = min(board.next_ns() for board in boards) - time.monotonic_ns()
        wait_s = max(0.0, min(0.2, wait_ns * 1e-9))
        ready, _, _ = select.select(list(by_fd), [], [], wait_s)
        for fd in ready:
            by_fd[fd].hear(log.heard)
        now_ns = time.monotonic_ns()
        for board in boards:
            board.speak(now_ns)
    args.log.write_bytes(msgspec.msgpack.encode(log))


def read_log(where: Path) -> Log:
    """Read the log of a board that has ended."""
    return msgspec.msgpack.decode((where / "heard").read_bytes(), type=Log)


if __name__ == "__main__":
    main()
