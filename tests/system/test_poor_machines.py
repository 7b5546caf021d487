"""Machines without a disk that can be written to, and without a clock."""

from __future__ import annotations

import re
import shutil
import signal
import struct
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from nspawn_machine import Machine, wait_until
from service_bench import SERVICE, Bench

pytestmark = pytest.mark.realtime

DROPIN = "/run/systemd/system/yahboomd.service.d/test.conf"
STATE = "/var/lib/yahboomd"
MOUNT2 = "LIBMOUNT_FORCE_MOUNT2=always"
"""A container's root cannot be changed by the newer call, which Debian 13 uses first."""


@pytest.fixture
def read_only(bench: Bench) -> Iterator[Bench]:
    """The service, started on a root that cannot be written to."""
    make_read_only(bench.machine)
    try:
        assert "Read-only" in bench.machine.run("touch", "/etc/x", "/var/x", check=False)
        yield bench
    finally:
        bench.machine.run("env", MOUNT2, "mount", "-o", "remount,rw", "/")


@pytest.fixture
def full(bench: Bench) -> Iterator[Bench]:
    """The service, with no room for another byte in /var and in its runtime folder."""
    machine = bench.machine
    machine.run("systemctl", "stop", SERVICE)
    # The journal is in memory: it could write nothing here.
    machine.run("journalctl", "--relinquish-var")
    machine.run("sh", "-ec", FILL)
    try:
        said = machine.run("cp", "/etc/passwd", "/var/lib/more", check=False)
        assert "No space left" in said
        yield bench
    finally:
        machine.run("systemctl", "stop", SERVICE)
        machine.run("umount", "--lazy", "/run/yahboomd", "/var")


FILL = """
kb=$(du -sk --apparent-size /var | cut -f1)
mkdir -p /run/var
mount -t tmpfs -o size=$((kb + 20000))k,mode=755 tmpfs /run/var
cp -a /var/. /run/var/
mount --bind /run/var /var
umount /run/var
cat /dev/zero > /var/filled 2>/dev/null || true
mkdir -p /run/yahboomd
mount -t tmpfs -o size=16k,mode=750,uid=yahboomd,gid=yahboomd tmpfs /run/yahboomd
cat /dev/zero > /run/yahboomd/filled 2>/dev/null || true
"""


def make_read_only(machine: Machine) -> None:
    machine.run("systemctl", "stop", SERVICE)
    # As from a boot on such a root: the journal is in memory.
    machine.run("journalctl", "--relinquish-var")
    remount = f"{MOUNT2} mount -o remount,ro / || ls -l /proc/[0-9]*/fd"

    def refusal() -> str:
        return machine.run("sh", "-c", remount, check=False)

    try:
        wait_until(lambda: not refusal(), "a read-only root", 30.0)
    except pytest.fail.Exception:
        print(refusal())
        raise


def drives_and_stops(bench: Bench) -> None:
    """The service starts, drives, and stops the wheels however it ends; an e-stop is kept."""
    machine = bench.machine
    machine.run("systemctl", "restart", SERVICE)
    bench.wait_for_status("standing")
    bench.drive()
    # The deadman: nobody commands any more.
    bench.stop_driving()
    wait_until(bench.board.stands, "the deadman stops the wheels")
    bench.drive()
    before = bench.pid()
    killed_ns = bench.kill(signal.SIGKILL)
    bench.board.stopped_after_s(killed_ns)
    bench.wait_until_active(before)
    wait_until(lambda: bench.board.speed_m_s() > 0.25, "it drives again")
    machine.run("yahboomd", "stop")
    assert bench.board.stands()
    before = bench.pid()
    bench.kill(signal.SIGKILL)
    bench.wait_until_active(before)
    bench.wait_for_status("estopped")
    machine.run("systemctl", "restart", SERVICE)
    bench.wait_for_status("estopped")
    assert bench.board.stands()
    bench.stop_driving()
    wait_until(
        lambda: "Released" in machine.run("yahboomd", "stop", "--release", check=False), "a release"
    )
    bench.drive()
    machine.run("systemctl", "stop", SERVICE)
    assert bench.board.stands()
    assert machine.show(SERVICE, "Result") == "success"
    machine.run("systemctl", "start", SERVICE)
    bench.stop_driving()
    bench.wait_for_status("standing")


def test_on_a_read_only_root_it_drives_and_stops_and_an_emergency_stop_is_kept(
    read_only: Bench,
) -> None:
    drives_and_stops(read_only)


def test_on_a_read_only_root_what_cannot_be_saved_is_counted_and_said(read_only: Bench) -> None:
    machine = read_only.machine
    machine.run("systemctl", "restart", SERVICE)
    read_only.wait_for_status("standing")
    # An earlier daemon's may have been saved within the minute before.
    wait_until(
        lambda: "Read-only file system" in machine.run("yahboomd", "blackbox", "save", check=False),
        "the refusal is told",
        90.0,
    )
    read_only.wait_for_line("Read-only file system")
    assert counter(machine, "blackbox_failures") >= 1
    assert counter(machine, "blackbox_recording") == 1


def test_an_emergency_stop_whose_file_is_on_a_read_only_disk_says_that_it_is_not_kept(
    bench: Bench,
) -> None:
    machine = bench.machine
    machine.run("mkdir", "-p", DROPIN.rpartition("/")[0])
    setting = f"[Service]\\nEnvironment=YAHBOOMD_ESTOP__LATCH_FILE={STATE}/estop\\n"
    machine.run("sh", "-c", f"printf '{setting}' > {DROPIN}")
    machine.run("systemctl", "daemon-reload")
    make_read_only(machine)
    try:
        machine.run("systemctl", "restart", SERVICE)
        bench.wait_for_status("standing")
        bench.drive()
        said = machine.run("yahboomd", "stop", check=False)
        assert bench.board.stands()
        assert "would not survive a restart" in said
        bench.wait_for_line("cannot be written (")
        bench.wait_for_status("estopped")
        assert counter(machine, "estop_not_on_file") == 1
    finally:
        machine.run("env", MOUNT2, "mount", "-o", "remount,rw", "/")
        machine.run("rm", "-f", DROPIN, f"{STATE}/estop")
        machine.run("systemctl", "daemon-reload")


def test_on_a_full_disk_it_drives_and_stops_and_an_emergency_stop_is_kept(full: Bench) -> None:
    drives_and_stops(full)


def test_on_a_full_disk_what_cannot_be_saved_is_counted_and_said(full: Bench) -> None:
    machine = full.machine
    machine.run("systemctl", "restart", SERVICE)
    full.wait_for_status("standing")
    said = machine.run("yahboomd", "blackbox", "save", check=False)
    # Without room in memory there is no black box to save.
    assert "No space left" in said or "No black box is kept" in said
    full.wait_for_line("No space left on device")
    machine.run(
        "sh", "-c", "rm -f /run/yahboomd/filled /var/filled; mount -o remount,size=9M /run/yahboomd"
    )
    machine.run("systemctl", "restart", SERVICE)
    full.wait_for_status("standing")
    # Once a minute, and what was left behind there is a box, too.
    wait_until(
        lambda: ".blackbox" in machine.run("yahboomd", "blackbox", "save", check=False),
        "a black box is saved",
        90.0,
    )


def counter(machine: Machine, name: str) -> int:
    """A counter of the daemon's status."""
    # Its status is that of a robot which may stand for a reason.
    said = machine.run("yahboomd", "status", "--json", check=False)
    found = re.search(rf'"{name}":\s*(\d+)', said)
    assert found is not None, name
    return int(found[1])


YEAR_S = 365 * 86_400


class WallClock:
    """What the daemon believes that the time is, beside a monotonic clock that goes on."""

    def __init__(self, machine: Machine) -> None:
        compiler = shutil.which("cc")
        if compiler is None:
            pytest.skip("the clock of a process is set by a library, for which this needs cc")
        source, library = Path(__file__).with_name("wall_clock.c"), machine.shared / "wall_clock.so"
        command = [compiler, "-shared", "-fPIC", "-o", library, source, "-ldl"]
        subprocess.run(command, check=True)
        self._file = machine.shared / "ahead"
        self._file.write_bytes(bytes(8))
        self.set(30.0)
        settings = ["LD_PRELOAD=/run/shared/wall_clock.so", "AHEAD_S=/run/shared/ahead"]
        text = "[Service]\n" + "".join(f"Environment={each}\n" for each in settings)
        (machine.shared / "dropin").write_text(text)
        machine.run("mkdir", "-p", DROPIN.rpartition("/")[0])
        machine.run("cp", "/run/shared/dropin", DROPIN)
        machine.run("systemctl", "daemon-reload")

    def set(self, unix_s: float) -> None:
        """Set it; it goes on from there."""
        with self._file.open("r+b") as file:
            file.write(struct.pack("q", round(unix_s - time.time())))


@pytest.fixture
def clock(bench: Bench) -> Iterator[WallClock]:
    """The service, which has started in 1970."""
    machine = bench.machine
    try:
        made = WallClock(machine)
        machine.run("systemctl", "restart", SERVICE)
        bench.wait_for_status("standing")
        yield made
    finally:
        machine.run("rm", "-f", DROPIN)
        machine.run("systemctl", "daemon-reload")


def stamp_s(machine: Machine) -> float:
    """The daemon's own time, in seconds."""
    said = machine.run("yahboomd", "status", "--json", check=False)
    found = re.search(r'"stamp_ns":\s*(\d+)', said)
    assert found is not None, said
    return int(found[1]) / 1e9


def test_from_1970_it_drives_through_every_jump_of_the_clock_and_stops(
    bench: Bench, clock: WallClock
) -> None:
    machine = bench.machine
    now_s = time.time()
    assert stamp_s(machine) < YEAR_S
    bench.drive()
    before = bench.pid()
    # By half a century, as if the first answer of a time server came; then back by an hour.
    for unix_s in (now_s, now_s - 3600, now_s + 10 * YEAR_S, now_s):
        clock.set(unix_s)
        wait_until(lambda then=unix_s: abs(stamp_s(machine) - then) < 60.0, "it has the new time")
        wait_until(lambda: bench.board.speed_m_s() > 0.25, "it drives on")
    bench.wait_for_line("clock")
    assert bench.pid() == before
    bench.stop_driving()
    wait_until(bench.board.stands, "the deadman stops the wheels")
    bench.drive()
    clock.set(now_s - YEAR_S)
    machine.run("systemctl", "stop", SERVICE)
    assert bench.board.stands()
    assert machine.show(SERVICE, "Result") == "success"
    machine.run("systemctl", "start", SERVICE)


def test_an_emergency_stop_and_a_black_box_of_1970_are_there_in_this_century(
    bench: Bench, clock: WallClock
) -> None:
    machine = bench.machine
    machine.run("rm", "-rf", f"{STATE}/blackbox")
    bench.drive()
    machine.run("yahboomd", "stop")
    assert bench.board.stands()
    before = bench.pid()
    bench.kill(signal.SIGKILL)
    clock.set(time.time())
    bench.wait_until_active(before)
    bench.wait_for_status("estopped")
    assert bench.board.stands()
    wait_until(
        lambda: "_killed" in machine.run("ls", f"{STATE}/blackbox", check=False), "a saved box"
    )
    assert "the daemon was killed" in machine.run("yahboomd", "blackbox", "explain")
