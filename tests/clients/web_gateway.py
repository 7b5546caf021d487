"""The gateway of ``examples/clients/gateway``, in front of a robot, on a port that is free."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from real_robot import free_endpoint, wait_for

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "clients" / "gateway"
STAND_IN = f"{sys.executable} {Path(__file__).with_name('web_plugins_process.py')}"
"""Answers in the place of zenohd; it needs no compiling."""


class Gateway:
    """A running gateway.

    Args:
        folder: For its copy and its sockets.
        robot: The endpoint of the daemon.
        zenohd: The program with both plugins, or its substitute.
        drive: The configuration lets pages and programs drive, not only watch and stop.
        namespace: Of the daemon.
        page: The folder of the page.
    """

    def __init__(
        self,
        folder: Path,
        robot: str,
        *,
        zenohd: str = STAND_IN,
        drive: bool = True,
        namespace: str = "",
        page: Path = EXAMPLE,
    ) -> None:
        needed = ("nginx", "socat", "ip", "unshare", "curl")
        path = f"{os.environ['PATH']}:/usr/sbin:/sbin"
        if missing := [each for each in needed if shutil.which(each, path=path) is None]:
            pytest.skip(f"the gateway needs {', '.join(missing)}")
        self.port = int(free_endpoint().rsplit(":", 1)[1])
        self.origin = f"http://127.0.0.1:{self.port}"
        self.folder = folder / f"gateway{self.port}"
        shutil.copytree(EXAMPLE, self.folder)
        nginx = self.folder / "nginx.conf"
        nginx.write_text(nginx.read_text().replace("8080", str(self.port)))
        program = self.folder / "zenohd"
        program.write_text(f'#!/bin/sh\nexec {zenohd} "$@"\n')
        program.chmod(0o755)
        config = self.folder / "gateway.json5"
        config.write_text(configuration(drive=drive, namespace=namespace))
        self._runtime = self.folder / "run"
        self._runtime.mkdir()
        self.log = self.folder / "log"
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                [self.folder / "gateway.sh"],
                env={
                    **os.environ,
                    "ZENOHD": str(program),
                    "ROBOT_PORT": robot.rsplit(":", 1)[1],
                    "PAGE": str(page),
                    "XDG_RUNTIME_DIR": str(self._runtime),
                },
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        wait_for(self._is_up, f"the gateway opens: {self.log}")

    def _is_up(self) -> bool:
        if self.process.poll() is not None:
            text = self.log.read_text()
            if "unshare failed" in text or "Operation not permitted" in text:
                pytest.skip(f"no network namespaces here: {text}")
            pytest.fail(text)
        return self.curl("/rest/up", "--header", "X-Yahboomd: 1") in {200, 404}

    @property
    def run_folder(self) -> Path:
        """The addresses of its sockets."""
        (folder,) = self._runtime.iterdir()
        return folder

    def curl(self, path: str, *arguments: str) -> int:
        """The status of the answer to a request; 0 if none came."""
        done = subprocess.run(
            ["curl", "--silent", "--noproxy", "*", "--max-time", "60", "--output", "/dev/null",
             "--write-out", "%{http_code}", *arguments, f"{self.origin}{path}"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        return int(done.stdout or 0)

    def refused(self) -> list[str]:
        """The lines of the log of refusals."""
        return (self.run_folder / "refused.log").read_text().splitlines()

    def children(self) -> dict[str, int]:
        """The processes that it started, by name."""
        found = subprocess.run(
            ["ps", "-o", "pid=,comm=", "--sid", str(self.process.pid)],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        return {name: int(pid) for pid, name in map(str.split, found.stdout.splitlines())}

    def send(self, number: int) -> None:
        """A signal to all of it."""
        os.killpg(self.process.pid, number)

    def close(self) -> None:
        """End it, as Ctrl-C does."""
        if self.process.poll() is None:
            self.send(signal.SIGCONT)
            self.process.terminate()
            try:
                self.process.wait(20)
            except subprocess.TimeoutExpired:
                self.send(signal.SIGKILL)
                self.process.wait()


def configuration(*, drive: bool, namespace: str = "") -> str:
    """The example's configuration, with the line that lets clients drive switched on or off."""
    text = (EXAMPLE / "gateway.json5").read_text()
    line = '// { rules: ["drive", "hold", "services"]'
    assert text.count(line) == 1
    if drive:
        text = text.replace(line, line.removeprefix("// "))
    if namespace:
        text = re.sub(r'"(yahboomd/|cmd_vel)', rf'"{namespace}/\1', text)
    return text
