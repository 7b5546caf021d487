"""Robots in containers that Ansible reaches over ssh, and the operator's machine beside them."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from nspawn_machine import Machine
from older_packages import repacked
from service_bench import SERVICE, Bench

ANSIBLE = os.environ.get("YAHBOOMD_ANSIBLE", "")
"""The folder of Ansible's programs."""

PLAYBOOK = Path(__file__).resolve().parents[1] / "ansible/rollout.yml"
NAMES = ("bot1", "bot2", "bot3")
ZENOH = "/etc/yahboomd/zenoh.json5"
CONFIG = "/etc/yahboomd/config.toml"
LISTED = (
    f"cat {ZENOH} {CONFIG}; stat -c '%U %G %a' {ZENOH} {CONFIG}; "
    "find /etc/yahboomd /var/lib/yahboomd-rollout* /var/cache/apt/archives/yahboomd*.deb | sort"
)
"""Shows the files, their owners and modes, and what a rollout may leave behind."""

GOOD, BROKEN, NEWER = "0.2.0", "0.3.0", "0.4.0"
FLEET = """\
fleet = "farm"
[sites.north]
router = "north.example:7447"
[robots]
bot1.site = "north"
bot2.site = "north"
bot3.site = "north"
[people.anna]
role = "operator"
"""
ROUTER = """\
import sys, time, zenoh
session = zenoh.open(zenoh.Config.from_file(sys.argv[1]))
time.sleep(1e9)
"""
"""A router of Zenoh's library in place of the program zenohd, with the same file."""

ROUTER_UNIT = """\
[Service]
ExecStart=/opt/yahboomd/bin/python3 /root/router.py /etc/zenohd/zenohd.json5
User=zenohd
Restart=on-failure
[Install]
WantedBy=multi-user.target
"""


class Robots:
    """The robots, and the operator's machine beside them.

    Args:
        folder: For all that the operator has; a short path, because ssh has its sockets there.
        benches: The robots by their names.
    """

    def __init__(self, folder: Path, benches: dict[str, Bench]) -> None:
        self.benches = benches
        self.fleet = folder / "fleet"
        self._file = folder / "fleet.toml"
        self._keys = folder / "key"
        self._home = folder / "a"

    def prepare(self, package: Path) -> None:
        """Make the fleet's files, the packages, and the way to each robot."""
        self._file.write_text(FLEET)
        self.command("init")
        packages = self.fleet / "packages"
        packages.mkdir()
        _, before, end = package.name.split("_")
        shutil.copy(package, packages)
        system = before.rpartition("~")[2]
        for version in (GOOD, BROKEN, NEWER):
            work = self._file.with_name(version)
            work.mkdir()
            full = f"{version}-1~{system}"
            made = repacked(package, work, version=full, breaks="run" if version == BROKEN else "")
            made.rename(packages / f"yahboomd_{full}_{end}")
            shutil.rmtree(work)
        subprocess.run(
            ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(self._keys)], check=True
        )
        public = self._keys.with_suffix(".pub").read_text()
        (self.fleet / "host_vars").mkdir()
        for name, bench in self.benches.items():
            machine = bench.machine
            (machine.shared / "key").write_text(public)
            machine.run("mkdir", "-p", "-m", "700", "/root/.ssh", "/run/sshd")
            keys = "/root/.ssh/authorized_keys"
            machine.run("install", "-m", "600", "/run/shared/key", keys)
            self.reach(name, machine)
        # The site's router is on the last one.
        self.reach("router.north", machine)
        machine.run("useradd", "-r", "-s", "/bin/false", "zenohd")
        machine.run("mkdir", "-p", "/etc/zenohd")
        (machine.shared / "router.py").write_text(ROUTER)
        machine.run("cp", "/run/shared/router.py", "/root/")
        machine.run("chmod", "755", "/root", "/root/router.py")
        (machine.shared / "zenohd.service").write_text(ROUTER_UNIT)
        machine.run("cp", "/run/shared/zenohd.service", "/etc/systemd/system/")
        machine.run("systemctl", "daemon-reload")

    def reach(self, host: str, machine: Machine) -> None:
        """A real sshd for each connection, with no network between."""
        way = self._way(host)
        inside = " ".join(machine.inside())
        way.write_text(f"#!/bin/sh\ntest -e {way}.cut || exec {inside} /usr/sbin/sshd -i\n")
        way.chmod(0o755)
        options = f"-o ProxyCommand={way} -i {self._keys} -o UserKnownHostsFile=/dev/null"
        variables = {"ansible_user": "root", "ansible_ssh_common_args": options}
        (self.fleet / f"host_vars/{host}.yml").write_text(json.dumps(variables))

    def cut(self, name: str) -> None:
        """End all connections to a robot, and let no new one in."""
        Path(f"{self._way(name)}.cut").touch()
        self.benches[name].machine.run("pkill", "sshd")

    def join(self, name: str) -> None:
        """Let connections to it in again."""
        # It goes with the server that was killed.
        self.benches[name].machine.run("mkdir", "-p", "-m", "700", "/run/sshd")
        Path(f"{self._way(name)}.cut").unlink()

    def _way(self, host: str) -> Path:
        return self._file.with_name(f"way-{host}")

    def command(self, verb: str, *names: str) -> None:
        """A command of `yahboomd fleet`."""
        yahboomd = Path(sys.executable).with_name("yahboomd")
        subprocess.run([yahboomd, "fleet", verb, self._file, *names], check=True)

    def begin(self, version: str = "", **variables: object) -> subprocess.Popen[str]:
        """Begin a rollout in waves of one and two."""
        given = {
            "yahboomd_version": version,
            "yahboomd_waves": [1, 2],
            "yahboomd_healthy_s": 20,
            "yahboomd_settle_s": 5,
            **variables,
        }
        return subprocess.Popen(
            [
                *(f"{ANSIBLE}/ansible-playbook", "-i", str(self.fleet / "inventory.yml")),
                *(str(PLAYBOOK), "--diff", "-e", json.dumps(given)),
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={
                **os.environ,
                "ANSIBLE_HOME": str(self._home),
                "ANSIBLE_LOG_PATH": str(self._file.with_name("rollouts.log")),
                "ANSIBLE_SSH_CONTROL_PATH_DIR": str(self._home),
                # A busy machine takes its time for a connection.
                "ANSIBLE_TIMEOUT": "300",
                "ANSIBLE_HOST_KEY_CHECKING": "False",
                "ANSIBLE_PIPELINING": "True",
                "ANSIBLE_NOCOLOR": "1",
                "ANSIBLE_SSH_ARGS": "-o ControlMaster=auto -o ControlPersist=20s",
            },
        )

    def roll_out(self, version: str = "", **variables: object) -> Rollout:
        """A whole rollout."""
        process = self.begin(version, **variables)
        output, _ = process.communicate()
        return Rollout(output, process.returncode)

    def files(self) -> dict[str, str]:
        """What is laid down on each robot, and what lies beside it."""
        return {
            name: bench.machine.run("sh", "-c", f"{{ {LISTED}; }} 2>/dev/null")
            for name, bench in self.benches.items()
        }

    def versions(self) -> dict[str, str]:
        """The installed versions, without the distribution."""
        return {
            name: bench.machine.run(
                "dpkg-query", "--show", "--showformat=${Version}", "yahboomd"
            ).partition("-1~")[0]
            for name, bench in self.benches.items()
        }

    def pids(self) -> dict[str, str]:
        """The daemon's process on each."""
        return {name: bench.pid() for name, bench in self.benches.items()}

    def states(self) -> dict[str, str]:
        """The state of each, as the service reports it; empty for one that is down."""
        return {
            name: bench.status().partition(":")[0]
            if bench.machine.show(SERVICE, "ActiveState") == "active"
            else ""
            for name, bench in self.benches.items()
        }


class Rollout:
    """What a rollout printed, and how it ended."""

    def __init__(self, output: str, status: int) -> None:
        self.output = output
        self.status = status
        # Keys must not show, even with --diff.
        assert "PRIVATE" not in output
        assert "private_key" not in output

    def changed(self) -> dict[str, int]:
        """The changes on each machine, by the recap."""
        found = re.findall(r"^(\S+)\s+: ok=\d+\s+changed=(\d+)", self.output, re.MULTILINE)
        assert found, self.output
        return {name: int(number) for name, number in found}
