"""Updates and back: nothing is asked, nothing of a person's is lost, an e-stop stays engaged."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from nspawn_machine import Machine, wait_until
from older_packages import OLDER, repacked
from service_bench import SERVICE, Bench, package_of_environment

pytestmark = pytest.mark.realtime

CONFIG = "/etc/yahboomd/config.toml"


@pytest.fixture
def package(bench: Bench, tmp_path: Path) -> Iterator[str]:
    """Install the older package on a machine that had no newer one; its path there."""
    machine = bench.machine
    prepared = package_of_environment()
    assert prepared is not None
    shutil.copy(repacked(prepared[1], tmp_path), machine.shared / "older.deb")
    try:
        machine.run("apt-get", "purge", "--yes", "yahboomd")
        install(machine, "/run/shared/older.deb")
        machine.run("systemctl", "start", SERVICE)
        bench.wait_for_status("standing")
        yield "/run/shared/older.deb"
    finally:
        machine.run("sh", "-c", "rm -f /run/yahboomd/estop*")
        machine.run("apt-get", "purge", "--yes", "yahboomd")
        install(machine, machine.package)


def install(machine: Machine, package: str, *, check: bool = True) -> str:
    """Install a package; a question would fail, because nobody answers."""
    return machine.run("apt-get", "install", "--yes", "--allow-downgrades", package, check=check)


def update(bench: Bench, package: str) -> None:
    """Install a package, and wait for its daemon."""
    before = bench.pid()
    install(bench.machine, package)
    bench.wait_until_active(before)


def test_an_update_and_back_keep_a_persons_file_a_drive_and_an_engaged_stop(
    bench: Bench, package: str
) -> None:
    machine = bench.machine
    line = "# mine\\n[limits.linear]\\nvelocity = 0.9\\n"
    machine.run("sh", "-c", f"sed -i 's/^linear = .*//' {CONFIG}; printf '{line}' >> {CONFIG}")
    mine = machine.run("cat", CONFIG)
    machine.run("systemctl", "restart", SERVICE)
    bench.wait_for_status("standing")
    # At rest, and back in a drive.
    update(bench, machine.package)
    bench.wait_for_status("standing")
    assert machine.run("cat", CONFIG) == mine
    assert "velocity = 0.9" in machine.run("yahboomd", "config", "show")
    bench.drive()
    update(bench, package)
    assert machine.run("cat", CONFIG) == mine
    wait_until(lambda: bench.board.speed_m_s() > 0.25, "the robot drives on")
    # Engaged by the older version, and kept by the newer one.
    machine.run("yahboomd", "stop")
    update(bench, machine.package)
    bench.wait_for_status("estopped")
    assert bench.board.stands()
    assert machine.run("cat", CONFIG) == mine
    said = install(machine, package, check=False)
    assert f"{OLDER} is older than" in said
    bench.wait_for_status("estopped")
    assert bench.board.stands()
