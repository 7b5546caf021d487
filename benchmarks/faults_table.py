"""Time from a fault to standing wheels, of two source trees in one run: ``make faults``.

Each trial has its own simulated robot, at 0.4 m/s, and its own daemon, ``setup`` or ``tune``. The
trees take turns, so that both meet the same load. Root only: faults need users, namespaces, mounts.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import resource
import select
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from real_robot import DRIVER
from truth_tail import Truth

from benchmarks import rig

WATCHED_S = 5.0
"""Wheels that turn for longer than this after the fault, or its end, count as not stopped."""

HOLD = """
import fcntl, os, sys, time
end = time.monotonic() + 3.0
while True:
    try:
        port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
        fcntl.flock(port, fcntl.LOCK_EX | fcntl.LOCK_NB)
        break
    except OSError:
        if time.monotonic() > end:
            sys.exit()
        time.sleep(0.001)
time.sleep(max(0.0, end - time.monotonic()))
"""
NEIGHBOUR = 'import os, time; os.setuid(65534); print("up", flush=True); time.sleep(99)'
SETUP = ("--profile", "520", "--kinematics", "differential", "--wheel-diameter", "67")


class Robot:
    """A simulated board, and what turns its wheels.

    Args:
        tree: The source tree to try.
        folder: For everything that it writes.
        tool: ``run``, ``setup`` or ``tune``.
        before: Words before the command, such as ``unshare``.
    """

    def __init__(self, tree: Path, folder: Path, tool: str, before: tuple[str, ...] = ()) -> None:
        self.folder = folder
        self.port, self.control = folder / "board", folder / "control"
        self.python = str(tree / ".venv/bin/python")
        self.tree, self.before = tree, before
        for name in ("run", "state"):
            (folder / name).mkdir(mode=0o700)
        self.environ = {
            **os.environ,
            "RUNTIME_DIRECTORY": str(folder / "run"),
            "STATE_DIRECTORY": str(folder / "state"),
        }
        slow = ("--lines", "3", "--flash", "dead_zone=1900") if tool == "setup" else ()
        self.board = self.start(
            *("simulate", "--link", str(self.port), "--truth", str(folder / "truth")),
            *("--control", str(self.control), *slow),
        )
        rig.wait_for(lambda: self.port.exists() or None, "the board")
        if before == AS_A_USER:
            folder.chmod(0o711)
            for path in (folder / "run", folder / "state", Path(os.path.realpath(self.port))):
                os.chown(path, 65534, 65534)
        self.truth = Truth(folder / "truth")
        self.driver: subprocess.Popen[bytes] | None = None
        if tool == "run":
            endpoint = rig.free_endpoint()
            self.tool = self.start(
                *("run", "--port", str(self.port), "--set", f'zenoh.listen=["{endpoint}"]'),
                *(
                    "--set",
                    "zenoh.connect=[]",
                    "--set",
                    f"estop.latch_file={folder / 'state/estop'}",
                ),
                before=before,
            )
            self.driver = subprocess.Popen(
                [self.python, "-c", DRIVER, endpoint, "cmd_vel"], stdout=subprocess.DEVNULL
            )
        elif tool == "tune":
            self.tool = self.start("tune", "--port", str(self.port), "--yes", "--json")
        else:
            options = (*SETUP, "--wheel-separation", "150")
            self.tool = self.start("setup", "--port", str(self.port), *options)
            assert self.tool.stdin is not None
            self.tool.stdin.write(b"yes\n\n")
            self.tool.stdin.flush()
        fast = 0.35 if tool == "run" else 0.1
        rig.wait_for(lambda: self.turns(fast), f"the wheels turn by {tool}")

    def start(self, *words: str, before: tuple[str, ...] = ()) -> subprocess.Popen[bytes]:
        """Start a command of the tree."""
        with (self.folder / f"{words[0]}.log").open("ab") as log:
            return subprocess.Popen(
                [*before, self.python, "-m", "yahboomd", *words],
                cwd=self.folder,
                env=self.environ,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
            )

    def turns(self, fast: float) -> bool:
        now_ns = time.monotonic_ns() - 300_000_000
        last = self.truth.since(now_ns)[-3:]
        return len(last) == 3 and all(max(map(abs, each.speed_m_s)) > fast for each in last)

    @property
    def pid(self) -> int:
        """The process that turns the wheels, below ``unshare``, a shell or an init."""
        pid = self.tool.pid
        while not command_line(pid).startswith(f"{self.python} -m"):
            children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
            pid = int(children[0])
        return pid

    def do(self, command: str) -> None:
        """Tell the simulated board something."""
        with socket.socket(socket.AF_UNIX) as control:
            control.connect(str(self.control))
            control.sendall(f"{command}\n".encode())
            control.recv(99)

    def kill(self, number: int = signal.SIGKILL) -> int:
        """Send a signal; returns when."""
        pid, now_ns = self.pid, time.monotonic_ns()
        os.kill(pid, number)
        return now_ns

    def stood_s(self, since_ns: int) -> float | None:
        """Seconds until the wheels stood for good; None if they did not."""
        end = time.monotonic() + WATCHED_S
        while time.monotonic() < end:
            at_ns: int | None = self.truth.stood_at(since_ns)
            if at_ns is not None:
                return (at_ns - since_ns) / 1e9
            time.sleep(0.02)
        return None

    def close(self) -> None:
        """End everything of this robot, its guard by its environment."""
        for each in (self.driver, self.tool, self.board):
            if each is not None:
                each.kill()
                each.wait()
        mark = f"RUNTIME_DIRECTORY={self.folder / 'run'}".encode()
        for pid in (int(name) for name in os.listdir("/proc") if name.isdigit()):
            with contextlib.suppress(OSError):
                ours = "yahboomd" in command_line(pid)
                if ours and mark in Path(f"/proc/{pid}/environ").read_bytes():
                    os.kill(pid, signal.SIGKILL)
        self.truth.close()


def command_line(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")


def signalled(number: int) -> Callable[[Robot], int]:
    return lambda robot: robot.kill(number)


def pause(seconds: float) -> Callable[[Robot], int]:
    def fault(robot: Robot) -> int:
        pid, at_ns = robot.pid, robot.kill(signal.SIGSTOP)
        threading.Timer(seconds, os.kill, (pid, signal.SIGCONT)).start()
        return at_ns

    return fault


def foreign(robot: Robot) -> int:
    """A program takes the port as the owner is killed, and another user has a robot, too."""
    neighbour = subprocess.Popen(
        ["yahboomd", "-c", NEIGHBOUR, "run"],
        executable=sys.executable,
        stdout=subprocess.PIPE,
    )
    assert neighbour.stdout is not None
    neighbour.stdout.readline()
    os.chmod(os.path.realpath(robot.port), 0o666)
    with contextlib.suppress(OSError):
        pid = robot.pid
        holder = subprocess.Popen([sys.executable, "-c", HOLD, str(robot.port)])
        time.sleep(0.15)
        at_ns = time.monotonic_ns()
        os.kill(pid, signal.SIGKILL)
        holder.wait()
        neighbour.kill()
        neighbour.wait()
    return at_ns


def board(*commands: str, then: str = "", after_s: float = 3.0) -> Callable[[Robot], int]:
    """Killed while the board does something; counts from the end of that."""

    def fault(robot: Robot) -> int:
        for command in commands:
            robot.do(command)
        time.sleep(0.05)
        at_ns = robot.kill()
        if then:
            time.sleep(after_s)
            at_ns = time.monotonic_ns()
            robot.do(then)
        return at_ns

    return fault


def unplug(robot: Robot) -> int:
    robot.do("unplug")
    time.sleep(2.0)
    at_ns = time.monotonic_ns()
    robot.do("replug")
    return at_ns


def no_descriptors(robot: Robot) -> int:
    pid = robot.pid
    used = len(os.listdir(f"/proc/{pid}/fd"))
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (used, used))
    return robot.kill()


def no_process(robot: Robot) -> int:
    """Of a user, since root may always start some."""
    words = ["prlimit", f"--pid={robot.pid}", "--nproc=1:1"]
    subprocess.run(words, user=65534, group=65534, extra_groups=[], check=True)
    return robot.kill()


def busy(fault: Callable[[Robot], int], loops: int) -> Callable[[Robot], int]:
    def beside(robot: Robot) -> int:
        with contextlib.ExitStack() as stack:
            for _ in range(loops):
                loop = subprocess.Popen([sys.executable, "-c", "while 1: pass"])
                stack.callback(loop.wait)
                stack.callback(loop.kill)
            time.sleep(2.0)
            at_ns = fault(robot)
            robot.stood_s(at_ns)
        return at_ns

    return beside


def starved(robot: Robot) -> int:
    """It gets what others leave, which is next to nothing, and its client ends."""
    pid = robot.pid
    for thread in os.listdir(f"/proc/{pid}/task"):
        os.sched_setscheduler(int(thread), os.SCHED_IDLE, os.sched_param(0))
    time.sleep(1.0)
    assert robot.driver is not None
    at_ns = time.monotonic_ns()
    robot.driver.kill()
    return at_ns


def out_of_memory(robot: Robot) -> int:
    """The kernel kills the daemon alone, in a group of its own (cgroup v1)."""
    pid = robot.pid
    group = Path(f"/sys/fs/cgroup/memory/yb{pid}")
    group.mkdir()
    ended = os.pidfd_open(pid)
    try:
        (group / "memory.limit_in_bytes").write_text("4096")
        (group / "cgroup.procs").write_text(str(pid))
        assert select.select([ended], [], [], 60.0)[0], "the kernel kills it"
        return time.monotonic_ns()
    finally:
        os.close(ended)
        robot.tool.wait(9)
        group.rmdir()


def ctrl_z(robot: Robot) -> int:
    assert robot.tool.stdin is not None
    at_ns = time.monotonic_ns()
    robot.tool.stdin.write(b"\x1a")
    robot.tool.stdin.flush()
    return at_ns


def of_two_robots(robot: Robot) -> int:
    """The first is killed, and the second drives on."""
    folder = robot.folder / "second"
    folder.mkdir()
    second = Robot(robot.tree, folder, "run")
    try:
        at_ns = robot.kill()
        robot.stood_s(at_ns)
        assert second.turns(0.35), "the second robot drives on"
    finally:
        second.close()
    return at_ns


AS_A_USER = ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups")
TERMINAL = (sys.executable, "-c", "import pty, sys; pty.spawn(sys.argv[1:])")
FULL = """
mount -t tmpfs -o size=64k none "$STATE_DIRECTORY"
head -c 99999 /dev/zero >"$STATE_DIRECTORY/full" 2>/dev/null
exec "$@"
"""
INIT = ("unshare", "--pid", "--fork", "sh", "-c", '"$@" & wait', "sh")
FAULTS: dict[str, tuple[str, Callable[[Robot], int], tuple[str, ...]]] = {
    **{
        name: ("run", signalled(getattr(signal, name)), ())
        for name in (
            *("SIGKILL", "SIGSEGV", "SIGABRT", "SIGTERM", "SIGINT", "SIGHUP", "SIGQUIT"),
            *("SIGSTOP", "SIGTSTP"),
        )
    },
    **{f"pause of {s} s": ("run", pause(s), ()) for s in (1, 2, 4)},
    "Ctrl-Z in a terminal": ("run", ctrl_z, TERMINAL),
    "killed beside 10 busy loops": ("run", busy(Robot.kill, 10), ()),
    "starved beside 4 busy loops, its client ends": ("run", busy(starved, 4), ()),
    "killed for want of memory": ("run", out_of_memory, ()),
    "killed with a full disk": ("run", Robot.kill, ("unshare", "--mount", "sh", "-c", FULL, "sh")),
    "killed, a second robot drives on": ("run", of_two_robots, ()),
    "killed on a port 0.2 s late": ("run", board("delay 0.2"), ()),
    "killed, foreign program has the port for 3 s": ("run", foreign, ()),
    "killed, board deaf and mute for 3 s": ("run", board("loss 1", then="clear"), ()),
    "killed, half of the bytes damaged for 1 s": (
        "run",
        board("corruption 0.5", then="clear", after_s=1.0),
        (),
    ),
    "killed, port takes no output for 1 s": ("run", board("stall 1"), ()),
    "killed while unplugged for 2 s": ("run", board("unplug", then="replug", after_s=2.0), ()),
    "unplugged for 2 s": ("run", unplug, ()),
    "killed without free descriptors": ("run", no_descriptors, ()),
    "killed without room for a process": ("run", no_process, AS_A_USER),
    "killed as first process of a container": ("run", Robot.kill, ("unshare", "--pid", "--fork")),
    "killed in a container with an init": ("run", Robot.kill, INIT),
    **{
        f"{tool} killed, {name}": (tool, fault, ())
        for tool in ("setup", "tune")
        for name, fault in (
            ("", Robot.kill),
            ("foreign program has the port for 3 s", foreign),
            ("board deaf and mute for 3 s", board("loss 1", then="clear")),
        )
    },
}


def trial(tree: Path, name: str) -> tuple[float | None, bool]:
    """The time to standing wheels, and whether the owner lives two seconds later."""
    tool, fault, before = FAULTS[name]
    with tempfile.TemporaryDirectory(prefix="yb", dir="/tmp") as folder:
        robot = Robot(tree, Path(folder), tool, before)
        try:
            stood_s = robot.stood_s(fault(robot))
            if "pause" in name:
                time.sleep(4.5)
            return stood_s, "pause" in name and robot.tool.poll() is None
        finally:
            robot.close()


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults_table")
    parser.add_argument("--before", type=Path, required=True, help="a source tree with its .venv")
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--times-before", type=int, default=5)
    parser.add_argument("--only", default="", help="faults with these words")
    parser.add_argument("--together", type=int, default=2, help="robots at the same time")
    args = parser.parse_args()
    trees = (args.before.resolve(), Path(__file__).resolve().parents[1])
    print("| fault | before: stood, median, worst s, lives | after | load |\n|---|---|---|---|")
    for name in (name for name in FAULTS if re.search(args.only, name)):
        found: dict[Path, list[tuple[float | None, bool]]] = {tree: [] for tree in trees}

        def one(tree: Path, name: str = name) -> tuple[Path, tuple[float | None, bool] | None]:
            try:
                return tree, trial(tree, name)
            except (TimeoutError, OSError, AssertionError) as error:
                print(f"not tried: {name}, {tree.name}: {error!r}", file=sys.stderr)
                return tree, None

        with ThreadPoolExecutor(args.together) as pool:
            order = [
                tree
                for number in range(args.times)
                for tree in (trees if number < args.times_before else trees[1:])
            ]
            for tree, result in pool.map(one, order):
                if result is not None:
                    found[tree].append(result)
        cells = [cell(found[tree]) for tree in trees]
        print(f"| {name} | {' | '.join(cells)} | {os.getloadavg()[0]:.1f} |", flush=True)


def cell(found: list[tuple[float | None, bool]]) -> str:
    """Of how many trials the wheels stood, and when."""
    stood = [s for s, _ in found if s is not None]
    lived = sum(lives for _, lives in found)
    times = f", {statistics.median(stood):.2f}, {max(stood):.2f}" if stood else ""
    return f"{len(stood)} of {len(found)}{times}" + (f"; {lived} live" if lived else "")


if __name__ == "__main__":
    main()
