"""A simulated board and an application beside the installed service, all in one container."""

from __future__ import annotations

import json
import os
import socket
import time
from pathlib import Path

from nspawn_machine import Machine, wait_until

from yahboomd.core.standstill import STANDING_M_S
from yahboomd.simulation.truth import TruthSample, read_truth

SERVICE = "yahboomd.service"
PYTHON = "/opt/yahboomd/bin/python3"

DRIVER = """\
import sys, time, zenoh
config = zenoh.Config()
for key, value in {
    "mode": '"client"',
    "connect/endpoints": '["%s"]' % sys.argv[1],
    "scouting/multicast/enabled": "false",
    "transport/shared_memory/enabled": "false",
}.items():
    config.insert_json5(key, value)
while True:
    try:
        session = zenoh.open(config)
        break
    except zenoh.ZError:
        time.sleep(0.05)
while True:
    session.put(sys.argv[2], '{"vx": 0.3}')
    time.sleep(0.05)
"""
"""Commands 0.3 m/s twenty times a second, through every restart of the daemon."""


class Board:
    """A simulated board, as a service of the container: it outlives the daemon.

    Args:
        machine: Where.
        name: Of its unit and files.
        link: The name of its port.
    """

    def __init__(self, machine: Machine, name: str, link: str) -> None:
        self.machine = machine
        self.link = link
        self._unit = f"{name}.service"
        self._truth = machine.shared / f"{name}.truth"
        self._control = machine.shared / f"{name}.control"
        self._name = name

    def start(self) -> None:
        """Plug it in; it stands at the origin."""
        self._truth.unlink(missing_ok=True)
        self.machine.run(
            *("systemd-run", "--quiet", "--collect", f"--unit={self._unit}"),
            *("/usr/bin/yahboomd", "simulate", "--link", self.link),
            *("--truth", f"/run/shared/{self._name}.truth"),
            *("--control", f"/run/shared/{self._name}.control"),
        )
        wait_until(lambda: self._truth.exists() and self.truth(), "the board is there")

    def stop(self) -> None:
        """Take it away."""
        self.machine.run("systemctl", "stop", self._unit, check=False)
        wait_until(lambda: not self._control.exists(), "the board is gone")

    def do(self, command: str) -> None:
        """A control command, such as ``unplug 2``."""
        with socket.socket(socket.AF_UNIX) as control:
            control.connect(str(self._control))
            control.sendall(f"{command}\n".encode())
            answer = control.makefile().readline().strip()
        assert answer.startswith("ok"), answer

    def truth(self) -> list[TruthSample]:
        """The true path of the robot."""
        return read_truth(self._truth)

    def speed_m_s(self) -> float:
        """The fastest wheel, as of now."""
        now_ns = time.monotonic_ns()
        last = wait_until(
            lambda: (found := self.truth()) and found[-1].t_ns >= now_ns and found[-1], "truth"
        )
        return _speed(last)

    def stands(self) -> bool:
        """Whether the wheels stand now."""
        return self.speed_m_s() < STANDING_M_S

    def stopped_after_s(self, since_ns: int) -> tuple[float, float]:
        """The moments at which the wheels began to slow down and stood, after a given one.

        Waits for it.
        """

        def stood() -> tuple[float, float] | None:
            slowing_ns = 0
            fastest = 0.0
            for sample in self.truth():
                speed = _speed(sample)
                if sample.t_ns < since_ns:
                    fastest = max(0.9 * speed, fastest if speed > 0.8 * fastest else 0.0)
                    continue
                if speed >= 0.8 * fastest:
                    slowing_ns = 0
                elif not slowing_ns:
                    slowing_ns = sample.t_ns
                if speed < STANDING_M_S:
                    return (slowing_ns - since_ns) / 1e9, (sample.t_ns - since_ns) / 1e9
            return None

        found: tuple[float, float] = wait_until(stood, "the wheels stand")
        return found


class Bench:
    """The service with its board and the application that drives.

    Args:
        machine: The container with the package.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.board = Board(machine, "board", "/dev/yahboom_driver")
        self._cursor = ""

    def begin(self) -> None:
        """A fresh board, a fresh daemon, an empty journal."""
        self._cursor = self._read_cursor()
        self.board.start()
        self.machine.run("systemctl", "reset-failed", SERVICE, check=False)
        self.machine.run("systemctl", "restart", SERVICE)
        self.wait_for_status("standing")

    def end(self) -> None:
        """No driver, no stop engaged, and the default configuration again."""
        self.stop_driving()
        self.machine.run("systemctl", "stop", SERVICE)
        self.machine.run("sh", "-c", "rm -f /run/yahboomd/estop*")
        self.board.stop()

    def drive(self, endpoint: str = "tcp/127.0.0.1:7448", key: str = "cmd_vel") -> None:
        """Start the application, and wait until the robot moves."""
        self.command(endpoint, key)
        wait_until(lambda: self.board.speed_m_s() > 0.25, "the robot drives")

    def command(self, endpoint: str = "tcp/127.0.0.1:7448", key: str = "cmd_vel") -> None:
        """Start the application."""
        script = self.machine.shared / "driver.py"
        script.write_text(DRIVER)
        self.machine.run(
            *("systemd-run", "--quiet", "--unit=driver.service", PYTHON, "/run/shared/driver.py"),
            *(endpoint, key),
        )

    def stop_driving(self) -> None:
        """End the application."""
        self.machine.run("systemctl", "stop", "driver.service", check=False)

    def status(self) -> str:
        """The service's status line, as systemctl shows it."""
        return self.machine.show(SERVICE, "StatusText")

    def wait_for_status(self, state: str) -> None:
        """Wait until the service reports a state."""
        # The last status of a service that is down remains.
        wait_until(
            lambda: (
                self.status().startswith(f"{state}:")
                and self.machine.show(SERVICE, "ActiveState") == "active"
            ),
            f"STATUS= says {state}",
        )

    def wait_until_active(self, since_pid: str) -> None:
        """Until another process serves."""
        wait_until(
            lambda: (
                self.machine.show(SERVICE, "ActiveState") == "active"
                and self.machine.show(SERVICE, "MainPID") not in {since_pid, "0"}
            ),
            "the service is back",
        )

    def pid(self) -> str:
        """The main process, as counted inside."""
        return self.machine.show(SERVICE, "MainPID")

    def kill(self, number: int) -> int:
        """Send the daemon a signal; when."""
        pid = self.machine.host_pid(SERVICE)
        now_ns = time.monotonic_ns()
        os.kill(pid, number)
        return now_ns

    def journal(self, unit: str = SERVICE) -> list[tuple[int, str]]:
        """Priority and words of each line since :meth:`begin`; systemd's own lines included."""
        text = self.machine.run(
            *("journalctl", "--unit", unit, "--output=json", f"--after-cursor={self._cursor}")
        )
        entries = [json.loads(line) for line in text.splitlines() if line.startswith("{")]
        return [(int(each["PRIORITY"]), str(each["MESSAGE"])) for each in entries]

    def wait_for_line(self, words: str, times: int = 1) -> None:
        """Wait until this many lines of the journal since :meth:`begin` have these words."""
        wait_until(
            lambda: sum(words in text for _, text in self.journal()) >= times,
            f"the journal says {words}",
        )

    def _read_cursor(self) -> str:
        text = self.machine.run("journalctl", "--lines=1", "--output=json")
        return str(json.loads(text.splitlines()[-1])["__CURSOR"])


def _speed(sample: TruthSample) -> float:
    return max(map(abs, sample.speed_m_s))


def package_of_environment() -> tuple[Path, Path] | None:
    """The root and the package that `make system-test` has prepared."""
    root, package = (os.environ.get(f"YAHBOOMD_SYSTEM_{each}", "") for each in ("ROOT", "PACKAGE"))
    return (Path(root), Path(package)) if root and package else None
