"""extras/fleet/ansible rolls out to three robots, each a container with the service, over ssh.

`make fleet-rollout` prepares it and runs it. The files are those of `yahboomd fleet`, as written.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from typing import NamedTuple

import pytest
from nspawn_machine import Machine, wait_until
from rollout_bench import ANSIBLE, BROKEN, GOOD, NAMES, NEWER, Robots, Rollout
from service_bench import Bench, package_of_environment

pytestmark = [
    pytest.mark.realtime,
    pytest.mark.skipif(not ANSIBLE, reason="needs Ansible and a root with ssh: make fleet-rollout"),
    pytest.mark.timeout(1800),
]


class First(NamedTuple):
    """The first rollout, which every case begins behind."""

    robots: Robots
    before: dict[str, str]
    done: Rollout


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Iterator[First]:
    prepared = package_of_environment()
    assert prepared is not None
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
        before = made.pids()
        yield First(made, before, made.roll_out(GOOD))
    finally:
        for machine in machines:
            machine.close()


@pytest.fixture
def robots(first: First) -> Iterator[Robots]:
    """Robots that stand, with what the last case left."""
    yield first.robots
    for bench in first.robots.benches.values():
        bench.stop_driving()
        if bench.status().startswith("estopped"):
            bench.machine.run("yahboomd", "stop", "--release")


def test_a_new_version_and_new_files_reach_every_robot_and_a_second_run_changes_nothing(
    robots: Robots, first: First
) -> None:
    assert first.done.status == 0, first.done.output
    assert robots.versions() == dict.fromkeys(NAMES, GOOD)
    assert robots.states() == dict.fromkeys(NAMES, "standing")
    for name, text in robots.files().items():
        assert (robots.fleet / f"robots/{name}.json5").read_text() in text
        assert f'namespace = "farm/north/{name}"' in text
        # The owners, and nothing else left behind.
        assert text.splitlines()[-5:] == [
            *("root yahboomd 640", "root root 644"),
            *("/etc/yahboomd", "/etc/yahboomd/config.toml", "/etc/yahboomd/zenoh.json5"),
        ]
    pids = robots.pids()
    assert all(pids[name] != first.before[name] for name in NAMES)
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
    robots: Robots, mistake: Callable[[Robots], dict[str, object]]
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
    with robots.begin() as process:
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
    assert process.returncode == 0, said
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


def test_a_robot_lost_in_the_middle_keeps_its_old_files_and_the_next_rollout_finishes_it(
    robots: Robots,
) -> None:
    robots.command("renew", *NAMES)
    files = robots.files()
    with robots.begin(yahboomd_waves=[2, 1], yahboomd_settle_s=20) as process:
        assert process.stdout is not None
        said = ""
        for line in process.stdout:
            said += line
            if "TASK [yahboomd_robot : Restart]" in line:
                break
        robots.cut("bot2")
        try:
            said += process.stdout.read()
        finally:
            robots.join("bot2")
    assert process.returncode != 0
    assert "bot2: the connection was lost in the middle of its change." in said, said
    now = robots.files()
    assert (robots.fleet / "robots/bot1.json5").read_text() in now["bot1"]
    assert now["bot3"] == files["bot3"]
    kept = "/var/lib/yahboomd-rollout/zenoh.json5"
    old = robots.benches["bot2"].machine.run("cat", kept)
    assert old in files["bot2"]
    assert old != (robots.fleet / "robots/bot2.json5").read_text()
    pid = robots.pids()["bot2"]
    done = robots.roll_out()
    assert done.status == 0, done.output
    # Its files were there already: what was missing is the restart.
    assert robots.pids()["bot2"] != pid
    assert robots.states() == dict.fromkeys(NAMES, "standing")
    now = robots.files()
    for name in NAMES:
        assert (robots.fleet / f"robots/{name}.json5").read_text() in now[name]
        assert kept not in now[name]


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
