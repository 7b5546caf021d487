"""Updates and back: nothing is asked, nothing of a person's is lost, an e-stop stays engaged."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from nspawn_machine import Machine, wait_until
from older_packages import OLDER, real_older, repacked
from service_bench import SERVICE, Bench, package_of_environment

pytestmark = pytest.mark.realtime

ROOT = Path(__file__).resolve().parents[2]
CONFIG = "/etc/yahboomd/config.toml"
DEFAULT = (ROOT / "systemd/config.toml").read_text()
KINDS = ("full", "bare", "real")
"""Every default in a file of dpkg's; as the tested one is; of an older commit, if one was named."""


@pytest.fixture(scope="module")
def older(machine: Machine, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Older packages by their kind, as paths inside."""
    prepared = package_of_environment()
    assert prepared is not None
    made = {}
    for kind in KINDS:
        folder = tmp_path_factory.mktemp(kind)
        if kind == "real":
            real = real_older()
            if real is None:
                continue
            # Before the first tag each build had the number of the release to come.
            package = repacked(real, folder)
        else:
            config = (ROOT / "config.toml").read_text() if kind == "full" else ""
            package = repacked(prepared[1], folder, config=config)
        shutil.copy(package, machine.shared / f"{kind}.deb")
        made[kind] = f"/run/shared/{kind}.deb"
    return made


@pytest.fixture(params=KINDS)
def package(request: pytest.FixtureRequest, bench: Bench, older: dict[str, str]) -> Iterator[str]:
    """The older package, installed as the only one that ever was."""
    if request.param not in older:
        pytest.skip("no older commit was named: make system-test OLDER=REVISION")
    machine = bench.machine
    try:
        machine.run("apt-get", "purge", "--yes", "yahboomd")
        install(machine, older[request.param])
        machine.run("systemctl", "start", SERVICE)
        bench.wait_for_status("standing")
        yield older[request.param]
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
    if package.endswith("real.deb"):
        # Only the older package itself can refuse, and that of an old commit does not.
        return
    if OLDER in said:
        assert f"{OLDER} is older than" in said
        bench.wait_for_status("estopped")
        assert bench.board.stands()


@pytest.mark.parametrize("package", ["full"], indirect=True)
def test_a_default_file_that_nobody_changed_becomes_the_new_one(bench: Bench, package: str) -> None:
    machine = bench.machine
    install(machine, machine.package)
    assert machine.run("cat", CONFIG) == DEFAULT
    assert "needs no change" in machine.run("yahboomd", "config", "migrate")
