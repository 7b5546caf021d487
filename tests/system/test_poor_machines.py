"""Machines without a disk that can be written to."""

from __future__ import annotations

import re
import signal
from collections.abc import Iterator

import pytest
from nspawn_machine import Machine, wait_until
from service_bench import SERVICE, Bench

pytestmark = pytest.mark.realtime

DROPIN = "/run/systemd/system/yahboomd.service.d/test.conf"
STATE = "/var/lib/yahboomd"


@pytest.fixture
def read_only(bench: Bench) -> Iterator[Bench]:
    """The service, started on a root that cannot be written to."""
    make_read_only(bench.machine)
    try:
        assert "Read-only" in bench.machine.run("touch", "/etc/x", "/var/x", check=False)
        yield bench
    finally:
        bench.machine.run("mount", "-o", "remount,rw", "/")


@pytest.fixture
def full(bench: Bench) -> Iterator[Bench]:
    """The service, on a machine whose /var and /run have room for no more bytes."""
    machine = bench.machine
    machine.run("systemctl", "stop", SERVICE)
    machine.run("sh", "-ec", FILL)
    try:
        said = machine.run("cp", "/etc/passwd", "/var/lib/more", check=False)
        assert "No space left" in said
        yield bench
    finally:
        machine.run("sh", "-c", "rm -f /run/filled; mount -o remount,size=1G /run; umount -l /var")


FILL = """
kb=$(du -sk --apparent-size /var | cut -f1)
mkdir -p /run/var
mount -t tmpfs -o size=$((kb + 20000))k,mode=755 tmpfs /run/var
cp -a /var/. /run/var/
mount --bind /run/var /var
umount /run/var
cat /dev/zero > /var/filled 2>/dev/null || true
used=$(df --output=used -k /run | tail -1)
mount -o remount,size=$((used + 3000))k /run
cat /dev/zero > /run/filled 2>/dev/null || true
"""


def make_read_only(machine: Machine) -> None:
    machine.run("systemctl", "stop", SERVICE)
    # As from a boot on such a root: the journal is in memory.
    machine.run("journalctl", "--relinquish-var")
    remount = "mount -o remount,ro / || ls -l /proc/[0-9]*/fd"
    wait_until(lambda: not machine.run("sh", "-c", remount, check=False), "a read-only root", 30.0)


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
    said = machine.run("yahboomd", "blackbox", "save", check=False)
    # Within a minute of a kill the daemon has tried by itself.
    assert "Read-only file system" in said or "(failed)" in said
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
        # It becomes writable, and the stop is kept.
        machine.run("mount", "-o", "remount,rw", "/")
        bench.wait_for_line("The e-stop is on file now")
        machine.run("systemctl", "restart", SERVICE)
        bench.wait_for_status("estopped")
        assert bench.board.stands()
    finally:
        machine.run("mount", "-o", "remount,rw", "/")
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
    machine.run("sh", "-c", "rm -f /run/filled /var/filled")
    machine.run("systemctl", "restart", SERVICE)
    full.wait_for_status("standing")
    assert "Saved to" in machine.run("yahboomd", "blackbox", "save")


def counter(machine: Machine, name: str) -> int:
    """A counter of the daemon's status."""
    # Its status is that of a robot which may stand for a reason.
    said = machine.run("yahboomd", "status", "--json", check=False)
    found = re.search(rf'"{name}":\s*(\d+)', said)
    assert found is not None, name
    return int(found[1])
