"""The processes: simulated boards, the daemon under something like a service manager, and helpers.

Each is ended by its handle.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO

import msgspec

from benchmarks.soak.tail import Truth, Wire

WATCHDOG_S = 2.0
"""The unit's value, like the niceness and the command after a failed daemon."""

DAEMON_NICE = -5
BOARD_NICE = -15
"""A real board has a processor of its own, so other processes must not delay it.

Both are relative to the soak's own niceness: ``nice -n -10 make soak`` puts all of it before the
rest of a busy machine.
"""

FED_LATELY_NS = 50_000_000
RESTART_S = 0.1
END_S = 15.0

INITIAL_TICKS = "3000000,0,3000000,0"
"""A board that has run for a while: 480 m on each wheel."""


def prefer(process: subprocess.Popen[str] | subprocess.Popen[bytes], nice: int) -> bool:
    """Give a process a higher priority, if that is permitted."""
    try:
        own = os.getpriority(os.PRIO_PROCESS, 0)
        os.setpriority(os.PRIO_PROCESS, process.pid, max(-20, own + nice))
    except OSError:
        return False
    return True


def end(process: subprocess.Popen[str]) -> int:
    """Ask a process to end, and kill it if it does not."""
    if process.poll() is None:
        process.send_signal(signal.SIGCONT)
        process.terminate()
    try:
        return process.wait(END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


class Helper:
    """A child of :mod:`benchmarks.soak.children` and its output."""

    def __init__(self, *arguments: str) -> None:
        self.lines: list[str] = []
        self.process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.soak.children", *arguments],
            stdout=subprocess.PIPE,
            text=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.strip())

    def wait_ready(self, patience_s: float = 20.0) -> None:
        """Wait for its first line."""
        deadline = time.monotonic() + patience_s
        while not self.lines:
            if self.process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError("a helper of the soak did not start")
            time.sleep(0.005)

    def kill(self) -> None:
        """Kill it, as a power failure would."""
        self.process.kill()
        self.process.wait()
        self._reader.join()
        if self.process.stdout is not None:
            self.process.stdout.close()


class Stalls:
    """Times in which the machine ran no process, measured by a process beside the soak's."""

    def __init__(self) -> None:
        self._helper = Helper("stalls")
        self._helper.wait_ready()
        self._taken = 1
        self._found: list[tuple[int, int]] = []

    def _look(self) -> list[tuple[int, int]]:
        lines = self._helper.lines
        while self._taken < len(lines):
            before, late = lines[self._taken].split()
            self._found.append((int(before), int(late)))
            self._taken += 1
        return self._found

    def within_s(self, since_ns: int, until_ns: int) -> float:
        """The total time that it stood still in a stretch of time."""
        return (
            sum(
                late
                for before, late in self._look()
                if before + late >= since_ns and before <= until_ns
            )
            / 1e9
        )

    def longest_s(self, since_ns: int) -> float:
        """The longest stall from a moment on."""
        late = [late for before, late in self._look() if before + late >= since_ns]
        return max(late, default=0) / 1e9

    @property
    def worst_s(self) -> float:
        """The longest stall."""
        return max((late for _, late in self._look()), default=0) / 1e9

    @property
    def count(self) -> int:
        """The number of stalls."""
        return len(self._look())

    def close(self) -> None:
        """End it."""
        self._helper.kill()


class Board:
    """A simulated board on a pty, behind a name that outlives it.

    Args:
        folder: The folder for its files.
        dialect: Its dialect.
        seed: Decides its random events.
    """

    def __init__(self, folder: Path, dialect: str, seed: int) -> None:
        self.dialect = dialect
        self.port = folder / "board"
        self._files = [folder / f"{name}-{time.monotonic_ns()}" for name in ("truth", "heard")]
        self._control = folder / "control"
        self.truth = Truth(self._files[0])
        self.wire = Wire(self._files[1])
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "yahboomd", "simulate", "--dialect", dialect),
                *("--link", str(self.port), "--seed", str(seed), "--ticks", INITIAL_TICKS),
                # Every other board fills the wire with its lines, if it streams them.
                *("--stream-pace", "wire" if seed % 2 else "measured"),
                # A real board's ten seconds would be most of the run.
                *("--start-up", "0.3"),
                *("--truth", str(self._files[0]), "--heard", str(self._files[1])),
                *("--control", str(self._control)),
            ],
            stdout=subprocess.PIPE,
            text=True,
        )
        self.preferred = prefer(self.process, BOARD_NICE)
        assert self.process.stdout is not None
        if "is at" not in self.process.stdout.readline():
            raise RuntimeError("the simulated board did not start")

    def do(self, command: str) -> int:
        """Send a control command; returns when it was sent."""
        return self._ask(command)[0]

    def stall(self, for_s: float) -> int:
        """Stall the port's output for a while; returns when the port takes output again.

        The board reports that time, because it may receive the command late.
        """
        return int(self._ask(f"stall {for_s:.3f}")[1].removeprefix("ok until "))

    def _ask(self, command: str) -> tuple[int, str]:
        with socket.socket(socket.AF_UNIX) as control:
            control.settimeout(10.0)
            control.connect(str(self._control))
            sent_ns = time.monotonic_ns()
            control.sendall(f"{command}\n".encode())
            with control.makefile() as answers:
                answer = answers.readline().strip()
        if not answer.startswith("ok"):
            raise RuntimeError(f"the simulated board says to {command!r}: {answer!r}")
        return sent_ns, answer

    def close(self) -> None:
        """End it and remove its files."""
        end(self.process)
        if self.process.stdout is not None:
            self.process.stdout.close()
        self.truth.close()
        self.wire.close()
        for file in self._files:
            file.unlink(missing_ok=True)


class Life(msgspec.Struct, kw_only=True):
    """One run of the daemon.

    Attributes:
        began_ns: When it was started.
        pid: Its process.
        ended_ns: When it ended.
        status: Its exit status; negative for a signal.
        asked: Whether the soak ended it.
        note: Its state when the watchdog ended it.
        rss_first_mb: Resident memory soon after its start.
        rss_mb: The latest figure.
        rss_most_mb: The largest.
    """

    began_ns: int
    pid: int
    ended_ns: int | None = None
    status: int | None = None
    asked: bool = False
    note: str = ""
    rss_first_mb: float | None = None
    rss_mb: float = 0.0
    rss_most_mb: float = 0.0

    @property
    def age_s(self) -> float:
        """The age of the process."""
        return ((self.ended_ns or time.monotonic_ns()) - self.began_ns) / 1e9


class ServiceManager:
    """Acts as systemd does for the unit: starts the daemon, watches it, stops after it, restarts.

    Args:
        folder: For the log, the e-stop's file and the notification socket.
        port: The port of the board.
        endpoint: The daemon's endpoint.
    """

    def __init__(self, folder: Path, port: Path, endpoint: str) -> None:
        self.log_path = folder / "daemon.log"
        self.lives: list[Life] = []
        self.stop_statuses: list[int] = []
        self.watchdog_kills = 0
        self._port = port
        self._arguments = [
            *("run", "--port", str(port)),
            *("--set", f'zenoh.listen=["{endpoint}"]', "--set", "zenoh.connect=[]"),
            *("--set", f"estop.latch_file={folder / 'estop'}"),
        ]
        self.fuse = folder / "recorders fail"
        self._notify_path = folder / "notify"
        self._notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._notify.bind(str(self._notify_path))
        self._notify.settimeout(0.05)
        self._process: subprocess.Popen[bytes] | None = None
        self._log: IO[bytes] = self.log_path.open("ab")
        self._fed_ns: int | None = None
        self._ending = threading.Event()
        self._threads = [
            threading.Thread(target=self._serve, daemon=True),
            threading.Thread(target=self._watch, daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def life(self) -> Life:
        """The current run, or the last one."""
        while not self.lives:
            time.sleep(0.001)
        return self.lives[-1]

    def signal(self, number: int) -> int:
        """Send the daemon a signal that ends it; returns when it was sent."""
        process = self._process
        assert process is not None
        self.life.asked = True
        sent_ns = time.monotonic_ns()
        process.send_signal(number)
        return sent_ns

    def freeze(self) -> int:
        """Stop the daemon's process just after it fed the watchdog; returns when."""
        deadline = time.monotonic() + WATCHDOG_S
        while time.monotonic() < deadline:
            fed_ns = self._fed_ns
            if fed_ns is not None and time.monotonic_ns() - fed_ns < FED_LATELY_NS:
                break
            time.sleep(0.005)
        frozen_ns = time.monotonic_ns()
        os.kill(self.life.pid, signal.SIGSTOP)
        return frozen_ns

    def thaw(self) -> int:
        """Continue it, if it still exists; returns when."""
        thawed_ns = time.monotonic_ns()
        process = self._process
        if process is not None and process.poll() is None:
            process.send_signal(signal.SIGCONT)
        return thawed_ns

    def _serve(self) -> None:
        while not self._ending.is_set():
            self._fed_ns = None
            began_ns = time.monotonic_ns()
            process = subprocess.Popen(
                [
                    *(sys.executable, "-m", "benchmarks.soak.failing_daemon", str(self.fuse)),
                    *self._arguments,
                ],
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
                env={
                    **os.environ,
                    "STATE_DIRECTORY": str(self._notify_path.with_name("state")),
                    "NOTIFY_SOCKET": str(self._notify_path),
                    "WATCHDOG_USEC": str(round(WATCHDOG_S * 1e6)),
                },
            )
            prefer(process, DAEMON_NICE)
            life = Life(began_ns=began_ns, pid=process.pid)
            self._process = process
            self.lives.append(life)
            if self._ending.is_set():
                process.terminate()
            status = process.wait()
            life.ended_ns = time.monotonic_ns()
            life.status = status
            if status != 0:
                self._stop_post()
            self._ending.wait(RESTART_S)

    def _stop_post(self) -> None:
        """Run the unit's command after a failed daemon."""
        stop = subprocess.Popen(
            [
                *(sys.executable, "-m", "yahboomd", "stop", "--direct"),
                *("--port", str(self._port)),
            ],
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=self._log,
        )
        prefer(stop, DAEMON_NICE)
        self.stop_statuses.append(stop.wait())

    def _watch(self) -> None:
        looked_ns = 0
        while not self._ending.is_set():
            with contextlib.suppress(TimeoutError):
                words = self._notify.recv(4096)
                if words.startswith((b"READY=1", b"WATCHDOG=1")):
                    self._fed_ns = time.monotonic_ns()
                elif words.startswith(b"STOPPING=1"):
                    self._fed_ns = None
            now_ns = time.monotonic_ns()
            process, fed_ns = self._process, self._fed_ns
            if process is None or process.poll() is not None:
                continue
            if fed_ns is not None and now_ns - fed_ns > WATCHDOG_S * 1e9:
                self.watchdog_kills += 1
                self._fed_ns = None
                self.life.note = f" (the watchdog: no sign of life, {_doing(process.pid)})"
                process.kill()
            if now_ns - looked_ns > 1_000_000_000:
                looked_ns = now_ns
                self._weigh(process.pid)

    def _weigh(self, pid: int) -> None:
        life = self.life
        if life.pid != pid or life.age_s < 3.0:
            return
        with contextlib.suppress(OSError, IndexError, ValueError):
            life.rss_mb, most_mb = memory_mb(pid)
            life.rss_first_mb = life.rss_first_mb or life.rss_mb
            life.rss_most_mb = max(life.rss_most_mb, most_mb)

    @property
    def tracebacks(self) -> int:
        """Tracebacks in the daemon's log, except those of recorders that were made to fail."""
        words = self.log_path.read_text(errors="replace")
        return words.count("Traceback") - words.count("failed and is switched off until")

    def close(self) -> None:
        """End the daemon and its watch."""
        self._ending.set()
        process = self._process
        if process is not None and process.poll() is None:
            self.life.asked = True
            process.send_signal(signal.SIGCONT)
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(END_S)
            if process.poll() is None:
                process.kill()
        for thread in self._threads:
            thread.join(END_S)
        self._notify.close()
        self._log.close()


def memory_mb(pid: int, *, forget_peak: bool = False) -> tuple[float, float]:
    """Resident memory of a process, and its peak.

    Args:
        pid: The process.
        forget_peak: Restart the peak.
    """
    if forget_peak:
        Path(f"/proc/{pid}/clear_refs").write_text("5")
    status = Path(f"/proc/{pid}/status").read_text()
    now, most = (int(status.split(name)[1].split()[0]) / 1024.0 for name in ("VmRSS:", "VmHWM:"))
    return now, most


def stopped_by_signal(pid: int) -> bool:
    """Whether a process is stopped, as by Ctrl-Z."""
    return _doing(pid).startswith("state T")


def _doing(pid: int) -> str:
    """The kernel's account of a process: running, sleeping, stopped, and where."""
    with contextlib.suppress(OSError, IndexError):
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        return f"state {state} in {Path(f'/proc/{pid}/wchan').read_text() or 'user space'}"
    return "gone"
