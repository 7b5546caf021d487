"""A Debian with systemd as its first process, in a container that forgets all when it ends."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

PATIENCE_S = 60.0

OWN_GROUP = """
for tree in /sys/fs/cgroup/systemd /sys/fs/cgroup/unified; do
    group=$tree/yahboomd-$$
    mkdir "$group" 2>/dev/null && echo $$ > "$group/cgroup.procs"
done
exec "$0" "$@"
"""


def wait_until(condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> Any:
    """Wait until ``condition`` returns something true, and return that."""
    deadline = time.monotonic() + patience_s
    while not (result := condition()):
        if time.monotonic() > deadline:
            pytest.fail(f"never came true: {what}")
        time.sleep(0.02)
    return result


class Machine:
    """One container.

    Args:
        root: A Debian, which is only read: changes go to memory.
        package: A Debian package, found inside as ``/run/packages/…``.
        shared: A folder of the host, found inside as ``/run/shared``.
        log: The file for the console.
        name: Of the container.
    """

    def __init__(
        self, root: Path, package: Path, shared: Path, log: Path, name: str = "yahboomd-test"
    ) -> None:
        self.package = f"/run/packages/{package.name}"
        self.shared = shared
        self._log = log
        command = [
            *("systemd-nspawn", "--quiet", "-D", str(root), "--boot", "--volatile=overlay"),
            # Nothing of this machine's network: ports here are taken, and not ours to disturb.
            *("--private-network", "--console=pipe", f"--machine={name}"),
            f"--bind-ro={package.parent}:/run/packages",
            f"--bind={shared}:/run/shared",
        ]
        if not Path("/run/systemd/system").is_dir():
            # Without a systemd here two containers would have the same groups of processes.
            command = ["sh", "-c", OWN_GROUP, *command, "--register=no", "--keep-unit"]
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
            )
        try:
            self._leader = wait_until(self._find_leader, "the container's first process")
            wait_until(self._is_up, "the system is up")
            # Pseudo-terminals get the group and the mode that udev gives serial ports.
            self.run("mount", "-o", "remount,mode=660,gid=20", "/dev/pts")
        except BaseException:
            self.close()
            raise

    def run(self, *command: str, check: bool = True) -> str:
        """Run a command inside; its output, both streams."""
        done = subprocess.run(
            [
                *self.inside(),
                *("env", "-i", "PATH=/usr/sbin:/usr/bin:/sbin:/bin", "LANG=C.UTF-8", "HOME=/root"),
                *("SYSTEMD_PAGER=", "SYSTEMD_COLORS=0", "DEBIAN_FRONTEND=noninteractive"),
                *command,
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        if check and done.returncode != 0:
            pytest.fail(f"{' '.join(command)}: status {done.returncode}\n{done.stdout}")
        return done.stdout

    def inside(self) -> tuple[str, ...]:
        """The command that starts another one inside."""
        spaces = ("--mount", "--uts", "--ipc", "--net", "--pid", "--cgroup")
        return ("nsenter", f"--target={self._leader}", *spaces)

    def show(self, unit: str, key: str) -> str:
        """One property of a unit."""
        return self.run("systemctl", "show", "--property", key, "--value", unit).strip()

    def host_pid(self, unit: str) -> int:
        """The unit's main process, as this side of the wall counts."""
        inside = self.show(unit, "MainPID")
        space = os.readlink(f"/proc/{self._leader}/ns/pid")
        for folder in Path("/proc").iterdir():
            if not folder.name.isdigit():
                continue
            try:
                status = (folder / "status").read_text()
                same = os.readlink(folder / "ns/pid") == space
            except OSError:
                # It has ended meanwhile.
                continue
            numbers = next(line for line in status.splitlines() if line.startswith("NSpid:"))
            if same and numbers.split()[-1] == inside:
                return int(folder.name)
        pytest.fail(f"{unit} has no main process")

    def close(self) -> None:
        """Switch it off."""
        if self._process.poll() is None and getattr(self, "_leader", 0):
            # systemd's halt for process 1 of a container.
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._leader, signal.SIGRTMIN + 3)
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        for group in Path("/sys/fs/cgroup").glob(f"*/yahboomd-{self._process.pid}"):
            for folder in [*sorted(group.rglob("*/"), reverse=True), group]:
                with contextlib.suppress(OSError):
                    folder.rmdir()

    def _find_leader(self) -> int:
        if self._process.poll() is not None:
            pytest.fail(f"systemd-nspawn ended: {self._log.read_text(errors='replace')}")
        pid = self._process.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        return int(children[0]) if children else 0

    def _is_up(self) -> bool:
        # At first the only child is one that makes the container and ends.
        self._leader = self._find_leader() or self._leader
        state = self.run("systemctl", "is-system-running", check=False).strip()
        return state in {"running", "degraded"}
