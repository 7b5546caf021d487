"""Starts the processes, sessions and meters of the benchmarks, and ends every process."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

import zenoh

from benchmarks.results import ROOT

PATIENCE_S = 120.0

Thing = TypeVar("Thing")


def wait_for(condition: Callable[[], Thing | None], what: str) -> Thing:
    """Wait until ``condition`` returns something true, and return it."""
    deadline = time.monotonic() + PATIENCE_S
    while not (result := condition()):
        if time.monotonic() > deadline:
            raise TimeoutError(f"never came true: {what}")
        time.sleep(0.01)
    return result


class Process:
    """A child of this Python; its output is kept. ``Process("-m", "yahboomd", ...)``."""

    def __init__(self, *arguments: str, environ: dict[str, str] | None = None) -> None:
        self.lines: list[str] = []
        self.process = subprocess.Popen(
            [sys.executable, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONUNBUFFERED": "1", **(environ or {})},
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.rstrip("\n"))

    @property
    def pid(self) -> int:
        """Its process id."""
        return self.process.pid

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self.process.poll() is None

    def says(self, words: str) -> str:
        """Wait until it has printed a line with these words; returns the line."""

        def found() -> str | None:
            ended = not self.alive
            if ended:
                # Its last output may still be on the way.
                self._reader.join()
            line = next((line for line in self.lines if words in line), None)
            if line is None and ended:
                raise ChildProcessError("\n".join(self.lines))
            return line

        return wait_for(found, words)

    def end(self) -> int:
        """Terminate it, and wait until it has ended; returns its status."""
        if self.alive:
            self.process.send_signal(signal.SIGTERM)
        return self.end_by_itself()

    def end_by_itself(self) -> int:
        """Wait until it ends, and kill it if it does not; returns its status."""
        try:
            status = self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            status = self.process.wait()
        self._reader.join(PATIENCE_S)
        if self._reader.is_alive():
            raise ChildProcessError("A process that it started runs on, and holds its output.")
        if self.process.stdout is not None:
            self.process.stdout.close()
        return status

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()


@contextlib.contextmanager
def folder() -> Iterator[Path]:
    """A temporary folder for ports, logs and latches."""
    with tempfile.TemporaryDirectory(prefix="yb") as path:
        yield Path(path)


def thin_board(where: Path, *options: str, ports: int = 1) -> Process:
    """A board that costs next to nothing; it logs received bytes to ``where``/heard."""
    process = Process(
        *("-m", "benchmarks.thin_board", "--log", str(where / "heard")),
        *("--links", *(str(where / f"port{n}") for n in range(ports)), *options),
    )
    process.says("ready")
    return process


def simulator(where: Path, *options: str, name: str = "board") -> Process:
    """The simulated robot of ``yahboomd simulate``."""
    process = Process("-m", "yahboomd", "simulate", "--link", str(where / name), *options)
    process.says("is at")
    return process


def daemon(
    where: Path,
    endpoint: str,
    *settings: str,
    port: str = "port0",
) -> Process:
    """``yahboomd run`` on a port in ``where``; the settings are those of ``--set``.

    It writes its log to standard output, which is kept.
    """
    own = [
        f"zenoh.listen={json.dumps([endpoint])}",
        "zenoh.connect=[]",
        f"estop.latch_file={where / (port + '.estop')}",
        *settings,
    ]
    arguments = [part for each in own for part in ("--set", each)]
    environ = {"STATE_DIRECTORY": str(where / (port + ".state"))}
    return Process(
        *("-m", "yahboomd", "run", "--no-guard", "--port", str(where / port), *arguments),
        environ=environ,
    )


_RESERVED: deque[socket.socket] = deque()


def free_endpoint() -> str:
    """A loopback endpoint that is not in use, and that no other caller on this machine gets."""
    while True:
        # Below the range of the system's ports for clients.
        port = random.SystemRandom().randrange(10_000, 32_000)
        reserved = socket.socket(socket.AF_UNIX)
        try:
            # An abstract name: the kernel gives it to one process until that closes it or ends.
            reserved.bind(f"\0yahboomd test port {port}")
            with socket.socket() as probe:
                probe.bind(("127.0.0.1", port))
        except OSError:
            reserved.close()
            continue
        _RESERVED.append(reserved)
        if len(_RESERVED) > 50:
            _RESERVED.popleft().close()
        return f"tcp/127.0.0.1:{port}"


def client(endpoint: str) -> zenoh.Session:
    """Open a Zenoh client, without shared memory; its router may be about to start."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    # It joins a daemon that was started again soon.
    config.insert_json5("connect/retry", '{"period_init_ms": 50, "period_max_ms": 400}')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")

    def opened() -> zenoh.Session | None:
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            return None

    return wait_for(opened, f"{endpoint} is served")


class Status:
    """The daemon's latest status sample."""

    def __init__(self, session: zenoh.Session) -> None:
        self.latest: dict[str, Any] = {}
        session.declare_subscriber("yahboomd/status", self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        self.latest = json.loads(bytes(sample.payload))

    def ready(self) -> None:
        """Wait until the wheels may turn."""
        wait_for(lambda: self.latest.get("state") in {"standing", "driving"}, "the robot is ready")


class Usage(NamedTuple):
    """CPU, memory and threads of a process."""

    cpu_ns: int
    wall_ns: int
    rss_mb: float
    threads: int


def usage(pid: int) -> Usage:
    """CPU of all threads, also of those that have ended; the rest from /proc."""
    tasks = list(Path(f"/proc/{pid}/task").iterdir())
    # The number of the process's own clock: clock_getcpuclockid(3), which Python does not have.
    cpu_ns = time.clock_gettime_ns(~pid << 3 | 2)
    status = Path(f"/proc/{pid}/status").read_text()
    # A process that has ended and was not waited for has none.
    rss = next((line for line in status.splitlines() if line.startswith("VmRSS:")), "VmRSS: 0 kB")
    return Usage(cpu_ns, time.monotonic_ns(), int(rss.split()[1]) * 1024 / 1e6, len(tasks))


def share_of_core(before: Usage, after: Usage) -> float:
    """CPU between two measurements, as a share of a core."""
    return (after.cpu_ns - before.cpu_ns) / (after.wall_ns - before.wall_ns)
