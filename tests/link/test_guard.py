"""The guard stops the wheels if the process that it watches dies, or hangs, in a pulse."""

from __future__ import annotations

import asyncio
import fcntl
import os
import resource
import select
import shutil
import signal
import socket
import subprocess
import sys
import termios
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import yahboomd
from yahboomd.core.clock import SystemClock
from yahboomd.core.link import guard_words, port_note
from yahboomd.core.link.port import PortOptions, open_port
from yahboomd.core.link.port_errors import holders
from yahboomd.core.link.port_guard import ENDS_WITHIN_S, SEEN_MS, PortGuard
from yahboomd.core.link.port_identity import identify
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.model import NS_PER_S
from yahboomd.core.protocol.first_words import FIRST_WORDS
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.tools.port import charge

pytestmark = pytest.mark.realtime

DIALECT = DIALECTS["streamed"]
STOP = b"$pwm:0,0,0,0#"
ZERO = b"$spd:0,0,0,0#"

WATCHED = """
import asyncio, os, sys, time
from yahboomd.core.clock import SystemClock
from yahboomd.core.link.port_guard import PortGuard
from yahboomd.core.link.port_note import note_of
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.tools.port import charge
class Raw:
    pending = 0
    def fileno(self): return int(sys.argv[1])
    def write(self, data): os.write(self.fileno(), data)
guard = PortGuard(charge.start)
guard.begin()
guard.share(Raw(), note_of(sys.argv[2]))
for mark in sys.argv[3]:
    if mark == "?":
        assert asyncio.run(guard.watches(DIALECTS["streamed"], SystemClock()))
    else:
        guard.promise(time.monotonic_ns() + 600_000_000) if mark == "+" else guard.standing()
print(guard._process.pid, flush=True)
time.sleep(60)
"""


class Ends(NamedTuple):
    """A port without a board: its far end, its descriptor here, and its note."""

    far: int
    fd: int
    note: PortNote


@pytest.fixture
def port() -> Iterator[Ends]:
    far, fd = os.openpty()
    tty.setraw(fd)
    os.set_blocking(fd, False)
    path = os.ttyname(fd)
    yield Ends(far, fd, PortNote(path, 115200, True, False, False, identify(os.stat(path))))
    os.close(far)


class Raw:
    """A port that its guard's owner writes to."""

    pending = 0

    def __init__(self, fd: int) -> None:
        self._fd = fd

    def fileno(self) -> int:
        return self._fd

    def write(self, data: bytes) -> None:
        os.write(self._fd, data)


class Watched:
    """A process with a guard, whose pulses were marked."""

    def __init__(self, port: Ends, marks: str, package: Path | None = None) -> None:
        words = (str(port.fd), port_note.text_of(port.note), marks)
        self.process = subprocess.Popen(
            [sys.executable, "-c", WATCHED, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pass_fds=(port.fd,),
            start_new_session=True,
            text=True,
            cwd=package,
        )
        os.close(port.fd)
        assert self.process.stdout is not None
        self.guard = int(self.process.stdout.readline())

    def kill(self) -> None:
        self.process.kill()
        self.process.communicate()


def stops(far: int) -> None:
    """See ten stops."""
    found = b""
    while found.count(STOP) < 10:
        found += os.read(far, 4096)


def frames(far: int, last: bytes) -> list[bytes]:
    """What is written, without resyncs, until a frame comes."""
    found = b""
    while last not in found:
        found += os.read(far, 4096)
    return found.split()


def written(far: int) -> bytes:
    """All that was written until every process has let go of the port."""
    found = b""
    os.set_blocking(far, False)
    while True:
        try:
            found += os.read(far, 4096)
        except BlockingIOError:
            select.select([far], [], [], 0.05)
        except OSError:
            return found


def test_after_a_kill_in_a_pulse_stops_are_sent_until_the_wheels_are_seen(port: Ends) -> None:
    watched = Watched(port, "?+-+")
    os.kill(watched.guard, signal.SIGTERM)
    watched.kill()
    stops(port.far)
    # No board answers, so nothing else ends it.
    os.kill(watched.guard, signal.SIGKILL)


def test_a_port_that_nobody_can_open_is_stopped_on_the_shared_descriptor(port: Ends) -> None:
    assert port.note.device is not None
    away = port.note._replace(device=port.note.device._replace(node="gone"))
    watched = Watched(port._replace(note=away), "?+")
    watched.kill()
    assert select.select([port.far], [], [], 30.0)[0]
    assert os.read(port.far, 4096).strip().startswith(STOP)
    os.kill(watched.guard, signal.SIGKILL)


def test_a_port_whose_output_another_program_suspended_is_stopped(port: Ends) -> None:
    watched = Watched(port, "?+")
    other = os.open(port.note.path, os.O_RDWR | os.O_NOCTTY)
    termios.tcflow(other, termios.TCOOFF)
    watched.kill()
    stops(port.far)
    os.close(other)
    os.kill(watched.guard, signal.SIGKILL)


def test_a_guard_whose_package_is_removed_goes_on_stopping(port: Ends, tmp_path: Path) -> None:
    package = Path(yahboomd.__file__).parent
    shutil.copytree(package, tmp_path / "yahboomd", ignore=shutil.ignore_patterns("__pycache__"))
    watched = Watched(port, "?+", tmp_path)
    shutil.rmtree(tmp_path / "yahboomd")
    watched.kill()
    stops(port.far)
    os.kill(watched.guard, signal.SIGKILL)


def test_requests_that_come_at_once_cost_one_step() -> None:
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    process = subprocess.Popen(["true"])
    process.wait()
    guard, heard = PortGuard(lambda _: (process, ours)), list[tuple[int, str]]()
    guard.begin()
    guard._on_stop = lambda *request: heard.append(request)
    for number in range(1, 100):
        its.send(b"%s %d somebody" % (guard_words.ASKED, number))
    guard._read()
    assert heard == [(99, "somebody")]
    its.close()
    ours.close()


def test_before_the_board_is_known_every_dialect_is_stopped(port: Ends) -> None:
    watched = Watched(port, "")
    watched.kill()
    heard = b""
    while not heard.startswith(b"".join(FIRST_WORDS.values())):
        assert select.select([port.far], [], [], 30.0)[0]
        heard += os.read(port.far, 4096)
    os.kill(watched.guard, signal.SIGKILL)


def test_a_process_that_hangs_in_motion_is_stopped_and_at_last_its_motors_are_let_go(
    port: Ends,
) -> None:
    watched = Watched(port, "?+")
    watched.process.send_signal(signal.SIGSTOP)
    assert frames(port.far, STOP)[0] == ZERO
    os.kill(watched.guard, signal.SIGKILL)
    watched.kill()


def test_a_board_that_answered_is_stopped_if_its_tool_is_killed_before_it_turned_a_wheel(
    port: Ends,
) -> None:
    watched = Watched(port, "-?")
    watched.kill()
    stops(port.far)
    os.kill(watched.guard, signal.SIGKILL)


def test_a_port_where_no_board_answered_yet_is_let_alone(port: Ends) -> None:
    Watched(port, "-").kill()
    assert written(port.far) == b""


def test_a_process_that_dies_between_pulses_is_let_alone(port: Ends) -> None:
    Watched(port, "?+-").kill()
    assert written(port.far) == b""


@pytest.mark.nightly
def test_signals_of_the_terminal_do_not_end_it(port: Ends) -> None:
    watched = Watched(port, "?+")
    os.killpg(watched.process.pid, signal.SIGINT)
    watched.process.communicate()
    stops(port.far)
    os.kill(watched.guard, signal.SIGKILL)


@pytest.fixture
def guard() -> Iterator[PortGuard]:
    made = PortGuard(charge.start)
    made.begin()
    yield made
    made.dismiss()


def pid_of(guard: PortGuard) -> int | None:
    return None if guard._process is None else guard._process.pid


async def test_a_guard_without_a_free_descriptor_does_not_watch_and_another_one_does(
    port: Ends, guard: PortGuard
) -> None:
    clock, options = SystemClock(), PortOptions(path=port.note.path)
    os.close(port.fd)
    first, opened = pid_of(guard), await open_port(options, clock)
    opened.share(guard, options)
    assert await guard.watches(DIALECT, clock)
    opened.close()
    assert first is not None
    resource.prlimit(first, resource.RLIMIT_NOFILE, (3, 3))
    again = await open_port(options, clock)
    again.share(guard, options)
    assert await guard.watches(DIALECT, clock)
    assert pid_of(guard) != first
    again.close()


async def test_a_guard_drives_the_relay_of_its_port(
    port: Ends, guard: PortGuard, capfd: pytest.CaptureFixture[str]
) -> None:
    guard.share(Raw(port.fd), port.note._replace(relay="/dev/null:17"))
    said = ""
    while "/dev/null:17, the line of the relay" not in said:
        assert await guard.watches(DIALECT, SystemClock())
        said += capfd.readouterr().err


async def test_a_guard_that_did_not_get_the_port_is_known(
    port: Ends,
) -> None:
    ends: list[socket.socket] = []

    def without_the_port(_promise: int) -> tuple[subprocess.Popen[bytes], socket.socket]:
        own, end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        end.send(b"0")
        ends.append(end)
        return subprocess.Popen(["sleep", "60"]), own

    guard = PortGuard(without_the_port)
    guard.begin()
    guard.share(Raw(port.fd), port.note)
    assert not await guard.watches(DIALECT, SystemClock())
    assert guard.watching is False
    guard.dismiss()
    for end in ends:
        end.close()
    os.close(port.fd)


@pytest.mark.parametrize("let_go", [False, True])
async def test_a_stop_is_repeated_until_it_is_acknowledged_by_its_number(
    port: Ends, guard: PortGuard, let_go: bool
) -> None:
    raw = Raw(port.fd)
    guard.share(raw, port.note)
    assert await guard.watches(DIALECT, SystemClock())
    guard.let_go(let_go)
    guard.promise(SystemClock.now_ns() + NS_PER_S // 10)
    # A zero speed would start the speed loop of motors that were let go.
    stop = STOP if let_go else ZERO
    assert frames(port.far, stop + DIALECT.resync + stop)[0] == stop
    assert guard.stopped
    # A motion is on its way yet, and would follow the stop.
    raw.pending = 1
    guard.promise(SystemClock.now_ns() + NS_PER_S)
    assert guard.stopped
    assert frames(port.far, stop)
    raw.pending = 0
    guard.promise(SystemClock.now_ns() + 100 * NS_PER_S)
    assert not guard.stopped
    os.set_blocking(port.far, False)
    while select.select([port.far], [], [], 0.5)[0]:
        left = os.read(port.far, 4096)
    assert left.endswith(DIALECT.resync)
    assert guard.stops == 1
    guard.close_port()
    os.close(port.fd)


@pytest.mark.parametrize("frozen", [False, True])
async def test_a_port_that_was_closed_is_free_whatever_its_guard_does(
    port: Ends, guard: PortGuard, frozen: bool
) -> None:
    clock, options = SystemClock(), PortOptions(path=port.note.path)
    os.close(port.fd)
    opened = await open_port(options, clock)
    opened.share(guard, options)
    assert await guard.watches(DIALECT, clock)
    first = pid_of(guard)
    assert first is not None
    if frozen:
        os.kill(first, signal.SIGSTOP)
    opened.close()
    free = os.open(options.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(free, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(free)
    # A starved guard may answer too late, too, and is replaced.
    assert pid_of(guard) != first or not frozen
    assert holders(options.path) == ()


async def test_a_guard_that_freezes_is_replaced_while_its_owner_promises(
    port: Ends, guard: PortGuard
) -> None:
    clock = SystemClock()
    guard.share(Raw(port.fd), port.note)
    assert await guard.watches(DIALECT, clock)
    first = pid_of(guard)
    assert first is not None
    os.kill(first, signal.SIGSTOP)
    watching = []
    for step in range(1, 6):
        # By control steps; how long they take makes no difference.
        guard.promise((step * SEEN_MS + 1) * 1_000_000)
        watching.append(guard.watching)
    assert (watching, pid_of(guard) == first) == ([True, True, True, True, False], False)
    while not guard.watching:
        await asyncio.sleep(0.01)
        guard.promise(clock.now_ns() + NS_PER_S)
    guard.standing()
    guard.close_port()
    os.close(port.fd)


async def test_a_guard_beside_its_owner_is_not_named_as_a_holder(
    port: Ends, guard: PortGuard
) -> None:
    guard.share(Raw(port.fd), port.note)
    assert await guard.watches(DIALECT, SystemClock())
    assert holders(port.note.path) == ()
    guard.close_port()
    os.close(port.fd)


@pytest.mark.nightly
async def test_a_guard_that_ends_in_order_writes_nothing(port: Ends, guard: PortGuard) -> None:
    guard.share(Raw(port.fd), port.note)
    assert await guard.watches(DIALECT, SystemClock())
    guard.promise(SystemClock.now_ns() + NS_PER_S)
    guard.standing()
    guard.close_port()
    guard.end(ENDS_WITHIN_S)
    os.close(port.fd)
    assert written(port.far) == b""


@pytest.mark.nightly
async def test_a_port_that_went_away_is_let_go_and_a_dismissed_guard_ends(
    port: Ends, guard: PortGuard
) -> None:
    assert port.note.device is not None
    pid, away = pid_of(guard), port.note._replace(device=port.note.device._replace(node="gone"))
    guard.share(Raw(port.fd), away)
    guard.promise(SystemClock.now_ns() + NS_PER_S)
    guard.close_port()
    waiting = asyncio.create_task(guard.outcome(SystemClock()))
    os.close(port.fd)
    # The port ends only if no process has it open.
    assert await asyncio.to_thread(written, port.far) == b""
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    guard.dismiss()
    assert not os.path.exists(f"/proc/{pid}")
