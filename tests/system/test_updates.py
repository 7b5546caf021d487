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
            package = real_older()
            if package is None:
                continue
        else:
            config = (ROOT / "config.toml").read_text() if kind == "full" else ""
            package = repacked(prepared[1], folder, config=config)
        shutil.copy(package, machine.shared / f"{kind}.deb")
        made[kind] = f"/run/shared/{kind}.deb"
    return made


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest, older: dict[str, str]) -> str:
    if request.param not in older:
        pytest.skip("no older commit was named: make system-test OLDER=REVISION")
    return str(request.param)


@pytest.fixture
def package(bench: Bench, older: dict[str, str], kind: str) -> Iterator[str]:
    """The older package, installed as the only one that ever was."""
    machine = bench.machine
    machine.run("apt-get", "purge", "--yes", "yahboomd")
    install(machine, older[kind])
    machine.run("systemctl", "start", SERVICE)
    bench.wait_for_status("standing")
    try:
        yield older[kind]
    finally:
        machine.run("sh", "-c", "rm -f /run/yahboomd/estop*")
        machine.run("apt-get", "purge", "--yes", "yahboomd")
        install(machine, machine.package)


def install(machine: Machine, package: str) -> str:
    """Install a package; a question would fail, because nobody answers."""
    return machine.run("apt-get", "install", "--yes", "--allow-downgrades", package)


def change(machine: Machine) -> str:
    """A person's change of the configuration; the whole file."""
    line = "# mine\\n[limits.linear]\\nvelocity = 0.9\\n"
    machine.run("sh", "-c", f"sed -i 's/^linear = .*//' {CONFIG}; printf '{line}' >> {CONFIG}")
    return machine.run("cat", CONFIG)


def test_a_robot_that_drives_drives_on_after_an_update_and_back(bench: Bench, package: str) -> None:
    machine = bench.machine
    mine = change(machine)
    machine.run("systemctl", "restart", SERVICE)
    bench.wait_for_status("standing")
    bench.drive()
    for other in (machine.package, package):
        before = bench.pid()
        install(machine, other)
        bench.wait_until_active(before)
        assert machine.run("cat", CONFIG) == mine
        wait_until(lambda: bench.board.speed_m_s() > 0.25, "the robot drives on")
        assert "velocity = 0.9" in machine.run("yahboomd", "config", "show")


def test_an_engaged_stop_stays_engaged_and_no_older_version_replaces_one_that_engaged_it(
    bench: Bench, package: str, kind: str
) -> None:
    machine = bench.machine
    bench.drive()
    machine.run("yahboomd", "stop")
    before = bench.pid()
    install(machine, machine.package)
    bench.wait_until_active(before)
    bench.wait_for_status("estopped")
    assert bench.board.stands()
    if kind != "real":
        # Its program is the tested one: it refuses by the numbers.
        said = machine.run(
            "apt-get", "install", "--yes", "--allow-downgrades", package, check=False
        )
        assert f"{OLDER} is older than" in said
    bench.wait_for_status("estopped")
    assert bench.board.stands()


def test_a_default_file_that_nobody_changed_becomes_the_new_one(bench: Bench, package: str) -> None:
    machine = bench.machine
    install(machine, machine.package)
    assert machine.run("cat", CONFIG) == DEFAULT
    # From now on it is a person's, also where it is the old one again.
    mine = change(machine)
    install(machine, machine.package)
    assert machine.run("cat", CONFIG) == mine
    assert "needs no change" in machine.run("yahboomd", "config", "migrate")
