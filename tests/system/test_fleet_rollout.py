"""packaging/ansible rolls out to three robots, each a container with the service, over ssh.

`make fleet-rollout` prepares it and runs it. The files are those of `yahboomd fleet`, as written.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from nspawn_machine import Machine, wait_until
from older_packages import repacked
from service_bench import SERVICE, Bench, package_of_environment

ANSIBLE = os.environ.get("YAHBOOMD_ANSIBLE", "")
pytestmark = [
    pytest.mark.realtime,
    pytest.mark.skipif(not ANSIBLE, reason="needs Ansible and a root with ssh: make fleet-rollout"),
    pytest.mark.timeout(900),
]

ROOT = Path(__file__).resolve().parents[2]
PLAYBOOK = ROOT / "packaging/ansible/rollout.yml"
NAMES = ("bot1", "bot2", "bot3")
ZENOH = "/etc/yahboomd/zenoh.json5"
CONFIG = "/etc/yahboomd/config.toml"
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
    """The robots, and the operator's machine beside them."""

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
        way = " ".join(machine.inside()) + " /usr/sbin/sshd -i"
        options = f"-o ProxyCommand='{way}' -i {self._keys} -o UserKnownHostsFile=/dev/null"
        variables = {"ansible_user": "root", "ansible_ssh_common_args": options}
        (self.fleet / f"host_vars/{host}.yml").write_text(json.dumps(variables))

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
        """What is laid down on each robot."""
        return {
            name: bench.machine.run(
                *("sh", "-c", f"cat {ZENOH} {CONFIG}; stat -c '%U %G %a' {ZENOH}; ls /etc/yahboomd")
            )
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


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robots]:
    prepared = package_of_environment()
    assert prepared is not None
    # A short path: ssh has its sockets below it.
    folder = tmp_path_factory.mktemp("f")
    machines: list[Machine] = []
    try:
        for name in NAMES:
            shared = folder / name
            shared.mkdir()
            log = folder / f"{name}.log"
            machines.append(Machine(*prepared, shared=shared, log=log, name=f"rollout-{name}"))
        benches = {name: Bench(each) for name, each in zip(NAMES, machines, strict=True)}
        for bench in benches.values():
            bench.machine.run("apt-get", "install", "--yes", bench.machine.package)
            bench.begin()
        made = Robots(folder, benches)
        made.prepare(prepared[1])
        yield made
    finally:
        for machine in machines:
            machine.close()


def test_a_new_version_and_new_files_reach_every_robot_and_a_second_run_changes_nothing(
    robots: Robots,
) -> None:
    before = robots.pids()
    done = robots.roll_out(GOOD)
    assert done.status == 0, done.output
    assert robots.versions() == dict.fromkeys(NAMES, GOOD)
    assert robots.states() == dict.fromkeys(NAMES, "standing")
    for name, text in robots.files().items():
        assert (robots.fleet / f"robots/{name}.json5").read_text() in text
        assert f'namespace = "farm/north/{name}"' in text
        assert text.splitlines()[-3:] == ["root yahboomd 640", "config.toml", "zenoh.json5"]
    pids = robots.pids()
    assert not set(pids.values()) & set(before.values())
    again = robots.roll_out(GOOD)
    assert again.status == 0, again.output
    assert again.changed() == dict.fromkeys((*NAMES, "router.north"), 0)
    assert robots.pids() == pids


def test_an_engaged_stop_stays_engaged_over_new_certificates_and_keeps_a_new_configuration_off(
    robots: Robots,
) -> None:
    robots.command("renew", *NAMES)
    engaged = robots.benches["bot3"]
    engaged.machine.run("yahboomd", "stop")
    done = robots.roll_out(GOOD)
    assert done.status == 0, done.output
    assert robots.states() == {"bot1": "standing", "bot2": "standing", "bot3": "estopped"}
    files = robots.files()
    assert (robots.fleet / "robots/bot3.json5").read_text() in files["bot3"]
    settings = robots.fleet / "settings.toml"
    settings.write_text("[limits.linear]\nvelocity = 0.4\n")
    done = robots.roll_out(GOOD, yahboomd_settings=str(settings))
    assert done.status != 0
    assert "bot3 was not touched: its emergency stop is engaged" in done.output, done.output
    now = robots.files()
    assert now["bot3"] == files["bot3"]
    assert all("velocity = 0.4" in now[name] for name in ("bot1", "bot2"))
    assert robots.states() == {"bot1": "standing", "bot2": "standing", "bot3": "estopped"}
    engaged.machine.run("yahboomd", "stop", "--release")
    engaged.wait_for_status("standing")
    done = robots.roll_out(GOOD)
    assert done.status == 0, done.output
    assert robots.files() == files


def unusable_rules(robots: Robots) -> dict[str, object]:
    """The file of Zenoh's was cut off while it was copied."""
    for name in NAMES:
        path = robots.fleet / f"robots/{name}.json5"
        path.write_text(path.read_text()[:2000])
    return {}


def an_unknown_key(robots: Robots) -> dict[str, object]:
    settings = robots.fleet / "settings.toml"
    settings.write_text("[limits]\nfastest = 3\n")
    return {"yahboomd_settings": str(settings)}


def a_port_that_is_not_there(robots: Robots) -> dict[str, object]:
    settings = robots.fleet / "settings.toml"
    settings.write_text('[serial]\nport = "/dev/ttyS99"\n')
    return {"yahboomd_settings": str(settings)}


@pytest.mark.parametrize("mistake", [unusable_rules, an_unknown_key, a_port_that_is_not_there])
def test_a_bad_configuration_ends_at_the_first_robot_which_gets_its_old_file_back(
    robots: Robots, mistake
) -> None:
    files, pids = robots.files(), robots.pids()
    kept = robots.fleet.with_name("kept")
    shutil.copytree(robots.fleet / "robots", kept)
    try:
        done = robots.roll_out(GOOD, **mistake(robots))
    finally:
        for path in kept.iterdir():
            path.replace(robots.fleet / "robots" / path.name)
        kept.rmdir()
    assert done.status != 0
    assert "bot1 was put back." in done.output, done.output
    assert "It is healthy again." in done.output, done.output
    assert robots.files() == files
    assert robots.states() == dict.fromkeys(NAMES, "standing")
    assert set(done.changed()) == {"bot1", "router.north"}
    assert {**robots.pids(), "bot1": ""} == {**pids, "bot1": ""}


def test_a_bad_version_ends_at_the_first_robot_which_gets_its_old_version_back(
    robots: Robots,
) -> None:
    files, pids, versions = robots.files(), robots.pids(), robots.versions()
    done = robots.roll_out(BROKEN)
    assert done.status != 0
    assert "bot1 was put back." in done.output, done.output
    assert "It is healthy again." in done.output, done.output
    assert robots.versions() == versions
    assert robots.files() == files
    assert robots.states() == dict.fromkeys(NAMES, "standing")
    assert {**robots.pids(), "bot1": ""} == {**pids, "bot1": ""}
    assert set(done.changed()) == {"bot1", "router.north"}


def test_a_robot_that_fails_in_a_wave_of_two_is_put_back_alone(robots: Robots) -> None:
    robots.command("renew", *NAMES)
    files = robots.files()
    bad = robots.fleet / "robots/bot2.json5"
    good = bad.read_text()
    bad.write_text(good[:2000])
    try:
        done = robots.roll_out(GOOD)
    finally:
        bad.write_text(good)
    assert done.status != 0
    assert "bot2 was put back." in done.output, done.output
    now = robots.files()
    assert now["bot2"] == files["bot2"]
    for name in ("bot1", "bot3"):
        assert (robots.fleet / f"robots/{name}.json5").read_text() in now[name]
    assert robots.states() == dict.fromkeys(NAMES, "standing")
    # The rest of them, with the file as it should be.
    done = robots.roll_out(GOOD)
    assert done.status == 0, done.output
    assert {name for name, number in done.changed().items() if number} == {"bot2"}


def test_a_robot_that_drives_is_touched_once_it_stands(robots: Robots) -> None:
    driving = robots.benches["bot1"]
    namespace = "farm/north/bot1"
    driving.drive(key=f"{namespace}/cmd_vel")
    robots.command("renew", *NAMES)
    pid, files = robots.pids(), robots.files()
    process = robots.begin()
    assert process.stdout is not None
    said = ""
    for line in process.stdout:
        said += line
        # The second time: it was asked before, and drove.
        if said.count("RETRYING: [bot1]: Stand without a driver") >= 2:
            break
    assert robots.pids() == pid
    assert robots.files() == files
    assert driving.board.speed_m_s() > 0.25
    driving.stop_driving()
    said += process.stdout.read()
    assert process.wait() == 0, said
    assert all(text != files[name] for name, text in robots.files().items())
    assert robots.states() == dict.fromkeys(NAMES, "standing")


def test_a_robot_that_drives_on_is_left_out_and_named_and_the_others_are_changed(
    robots: Robots,
) -> None:
    robots.command("renew", *NAMES)
    driving = robots.benches["bot2"]
    driving.drive(key="farm/north/bot2/cmd_vel")
    files = robots.files()
    try:
        done = robots.roll_out(yahboomd_rest_s=10)
        assert driving.board.speed_m_s() > 0.25
    finally:
        driving.stop_driving()
    assert done.status != 0
    assert "bot2 was not touched: it was not seen to stand" in done.output
    now = robots.files()
    assert now["bot2"] == files["bot2"]
    assert all(now[name] != files[name] for name in ("bot1", "bot3"))
    driving.wait_for_status("standing")
    done = robots.roll_out()
    assert done.status == 0, done.output
    assert robots.states() == dict.fromkeys(NAMES, "standing")
    assert now["bot2"] != robots.files()["bot2"]


def test_a_bad_file_of_a_router_is_put_back_and_no_robot_is_touched(robots: Robots) -> None:
    machine = robots.benches["bot3"].machine
    robots.command("renew", *NAMES)
    files = robots.files()
    path = robots.fleet / "routers/north.json5"
    good = path.read_text()
    path.write_text(good[:2000])
    try:
        done = robots.roll_out()
    finally:
        path.write_text(good)
    assert done.status != 0
    assert "router.north was put back." in done.output, done.output
    assert "It listens again." in done.output, done.output
    assert machine.run("cat", "/etc/zenohd/zenohd.json5") == good
    assert machine.run("ls", "/etc/zenohd").split() == ["zenohd.json5"]
    wait_until(lambda: machine.show("zenohd", "ActiveState") == "active", "the router is up")
    assert robots.files() == files


def test_a_bad_version_on_a_robot_with_an_engaged_stop_ends_there_and_says_what_is_not_back(
    robots: Robots,
) -> None:
    """The package refuses to go back while the stop is engaged, and nothing releases it."""
    first = robots.benches["bot1"]
    first.machine.run("yahboomd", "stop")
    versions, files = robots.versions(), robots.files()
    done = robots.roll_out(BROKEN)
    assert done.status != 0
    assert "Its package could not be put back" in done.output, done.output
    assert "It is NOT HEALTHY" in done.output, done.output
    assert robots.versions() == {**versions, "bot1": BROKEN}
    assert robots.files() == files
    assert first.board.stands()
    # Forward it goes, and the stop is engaged still.
    done = robots.roll_out(NEWER, yahboomd_repair=True)
    assert done.status == 0, done.output
    assert robots.versions() == dict.fromkeys(NAMES, NEWER)
    assert robots.states() == {"bot1": "estopped", "bot2": "standing", "bot3": "standing"}
