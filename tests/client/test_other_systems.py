"""Windows and macOS: the client imports and drives without what Linux alone has.

A child process takes from this Linux what the other system lacks. It is not that system.
"""

from __future__ import annotations

import asyncio
import sys
from typing import Any

import pytest
from zenoh_fixtures import eventually

pytestmark = pytest.mark.realtime

LACKS = """
import asyncio, builtins, ctypes, os, pathlib, signal, socket, subprocess, sys, time
import concurrent.futures, logging, platform, zenoh, msgspec

system = sys.argv[1]
LINUX = {
    os: "eventfd eventfd_read eventfd_write EFD_NONBLOCK EFD_CLOEXEC memfd_create pidfd_open "
    "sched_getaffinity sched_setaffinity sched_yield",
    time: "CLOCK_BOOTTIME",
}
UNIX = {
    os: "EX_OK EX_USAGE EX_UNAVAILABLE EX_SOFTWARE EX_OSERR EX_CANTCREAT EX_IOERR EX_TEMPFAIL "
    "EX_NOPERM EX_CONFIG O_NONBLOCK O_CLOEXEC O_NOCTTY O_DIRECTORY fork getuid geteuid getgid "
    "getsid setsid getpgid killpg nice uname mkfifo fchmod fchown chown getloadavg sysconf wait "
    "register_at_fork set_blocking_ ttyname",
    signal: "SIGHUP SIGUSR1 SIGUSR2 SIGALRM SIGKILL SIGSTOP SIGCONT SIGTSTP SIGCHLD SIGPIPE "
    "setitimer pthread_sigmask pthread_kill alarm pause sigwait",
    socket: "SO_REUSEPORT MSG_DONTWAIT",
    time: "CLOCK_MONOTONIC CLOCK_REALTIME clock_gettime clock_gettime_ns",
}
MODULES = {*"fcntl termios pwd grp resource tty pty syslog readline curses".split()}

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

def strip(names):
    for module, words in names.items():
        for word in words.split():
            if hasattr(module, word):
                delattr(module, word)

def without_proc(call):
    def called(path=".", *rest, **named):
        if str(path).startswith("/proc"):
            raise FileNotFoundError(2, "No such file or directory", str(path))
        return call(path, *rest, **named)
    return called

def absent(*_, **__):
    raise NotImplementedError

strip(LINUX)
for module in (os, builtins):
    for name in ("open", "listdir", "scandir", "stat", "readlink"):
        if hasattr(module, name):
            setattr(module, name, without_proc(getattr(module, name)))
loaded = ctypes.CDLL
if system == "win32":
    sys.meta_path.insert(0, Absent())
    for name in MODULES:
        sys.modules.pop(name, None)
    strip(UNIX)
    loop = asyncio.new_event_loop()
    for each in (*type(loop).__mro__, asyncio.AbstractEventLoop):
        for name in ("add_reader", "add_writer", "add_signal_handler", "remove_signal_handler"):
            if name in vars(each):
                setattr(each, name, absent)
    loop.close()
    def CDLL(name, *rest, **named):
        if name is None:
            raise TypeError("LoadLibrary() argument 1 must be str, not None")
        return loaded(name, *rest, **named)
    ctypes.CDLL = CDLL
else:
    class CDLL(loaded):
        def __getattr__(self, name):
            if "timerfd" in name:
                raise AttributeError(f"dlsym: symbol not found: {name}")
            return super().__getattr__(name)
    ctypes.CDLL = CDLL
sys.platform = system
"""

DRIVES = """
from yahboomd.client import EventSample, NoDaemon, PoseSample, Robot, connect

with Robot(sys.argv[2]) as robot:
    robot.drive(0.1, 0.2, for_s=0.3)
    assert next(iter(robot.samples(PoseSample))).x is not None
    assert robot.finished()
    robot.drive(0.3, for_s=60)
    time.sleep(0.2)

async def main():
    async with connect(sys.argv[2]) as robot:
        robot.drive(0.4, for_s=60)
        await asyncio.sleep(0.2)
    try:
        async with connect("tcp/127.0.0.1:9", wait_s=0.2):
            pass
    except NoDaemon as error:
        print(error)

asyncio.run(main())
"""


@pytest.mark.parametrize("system", ["win32", "darwin"])
async def test_the_client_drives_without_what_linux_alone_has(
    fake_daemon: Any, system: str
) -> None:
    daemon = await fake_daemon()
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", LACKS + DRIVES, system, daemon.endpoint),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    said, wrong = await process.communicate()
    assert (process.returncode, wrong.decode()) == (0, "")
    assert "No yahboomd answers" in said.decode()
    assert {vx for vx, _ in daemon.velocities} == {0.0, 0.1, 0.3, 0.4}
    await eventually(lambda: daemon.velocities[-1] == (0.0, 0.0))


@pytest.mark.parametrize("system", ["win32", "darwin"])
async def test_a_command_says_that_it_needs_linux(system: str) -> None:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", f"{LACKS}\nfrom yahboomd.cli.main import main\nsys.exit(main([]))"),
        system,
        stderr=asyncio.subprocess.PIPE,
    )
    _, wrong = await process.communicate()
    assert process.returncode == 78
    assert wrong.count(b"\n") == 1
    assert b"its commands need Linux" in wrong
