"""Installing, updating and removing, on a real system."""

from __future__ import annotations

import pytest
from nspawn_machine import wait_until
from service_bench import SERVICE, Board

pytestmark = pytest.mark.realtime


def test_an_update_keeps_the_configuration_and_drives_on(bench) -> None:
    machine = bench.machine
    machine.run("sh", "-c", "echo '# mine' >> /etc/yahboomd/config.toml")
    before = bench.pid()
    machine.run("apt-get", "install", "--yes", "--reinstall", machine.package)
    bench.wait_until_active(before)
    assert "# mine" in machine.run("tail", "-1", "/etc/yahboomd/config.toml")
    bench.drive()


def test_a_service_that_was_disabled_stays_so_after_an_update(bench) -> None:
    machine = bench.machine
    machine.run("systemctl", "disable", "--now", SERVICE)
    try:
        machine.run("apt-get", "install", "--yes", "--reinstall", machine.package)
        assert machine.run("systemctl", "is-enabled", SERVICE, check=False).strip() == "disabled"
        assert machine.show(SERVICE, "ActiveState") == "inactive"
    finally:
        machine.run("systemctl", "enable", SERVICE)


def test_a_second_board_has_a_service_a_namespace_and_a_port_of_its_own(bench) -> None:
    machine = bench.machine
    second = Board(machine, "second", "/dev/second_board")
    second.start()
    try:
        said = machine.run(
            "yahboomd", "install", "--instance", "front", "--port", "/dev/second_board"
        )
        assert "systemctl status yahboomd@front" in said
        wait_until(
            lambda: "standing" in machine.show("yahboomd@front", "StatusText"), "the second drives"
        )
        # A command for one board moves that board alone.
        bench.command("tcp/127.0.0.1:7449", "front/cmd_vel")
        wait_until(lambda: second.speed_m_s() > 0.25, "the second robot drives")
        assert bench.board.stands()
        machine.run("yahboomd", "uninstall", "--instance", "front")
        assert second.stands()
        assert machine.show(SERVICE, "ActiveState") == "active"
    finally:
        machine.run("rm", "-f", "/etc/yahboomd/front.toml")
        second.stop()


def test_removing_the_package_stops_the_wheels_and_purging_leaves_nothing(bench) -> None:
    machine = bench.machine
    bench.drive()
    try:
        machine.run("apt-get", "remove", "--yes", "yahboomd")
        # The application has lost its Python with it; the board's simulation is in memory.
        assert bench.board.stands()
        machine.run("apt-get", "purge", "--yes", "yahboomd")
        left = machine.run(
            *("find", "/etc", "/usr", "/opt", "/var/lib", "/run/yahboomd", "-name", "*yahboom*"),
            *("-not", "-path", "/var/lib/dpkg/*"),
            check=False,
        )
        assert [line for line in left.splitlines() if line.startswith("/")] == []
    finally:
        machine.run("apt-get", "install", "--yes", machine.package)


def test_without_the_package_a_virtual_environment_and_install_do_the_same(bench) -> None:
    machine = bench.machine
    machine.run("systemctl", "stop", SERVICE)
    # The same program in another place, as pip or uv would have it.
    machine.run("cp", "-a", "/opt/yahboomd", "/opt/elsewhere")
    machine.run("sed", "-i", "1s|.*|#!/opt/elsewhere/bin/python3|", "/opt/elsewhere/bin/yahboomd")
    machine.run("apt-get", "purge", "--yes", "yahboomd")
    try:
        said = machine.run("/opt/elsewhere/bin/yahboomd", "install")
        assert "journalctl -u yahboomd -f" in said
        bench.wait_for_status("standing")
        assert "/opt/elsewhere/bin/yahboomd" in machine.show(SERVICE, "ExecStart")
        again = machine.run("/opt/elsewhere/bin/yahboomd", "install")
        assert "wrote" not in again
        assert "replaced" not in again
        machine.run("/opt/elsewhere/bin/yahboomd", "uninstall")
        assert machine.show(SERVICE, "LoadState") == "not-found"
        assert machine.run("ls", "/etc/yahboomd").split() == ["config.toml"]
    finally:
        machine.run("rm", "-rf", "/etc/yahboomd")
        machine.run("apt-get", "install", "--yes", machine.package)
