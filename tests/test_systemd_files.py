"""The files for systemd and udev, as far as they can be judged without a running systemd."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from yahboomd.core.daemon.control import MOST_PROMISED_NS
from yahboomd.tools.port.guard_law import Limits

SYSTEMD = Path(__file__).resolve().parent.parent / "systemd"
UNITS = ("yahboomd.service", "yahboomd@.service")
METRICS = "yahboomd-metrics.service"
MOVES = "yahboomd-moves.service"
WEB = "yahboomd-web.service"
MOST_EXPOSURE = 1.5

analyze = shutil.which("systemd-analyze")
needs_analyze = pytest.mark.skipif(analyze is None, reason="this machine has no systemd-analyze")


def keys(unit: str) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in (SYSTEMD / unit).read_text().splitlines():
        if line and line[0] not in "#[":
            key, _, value = line.partition("=")
            found.setdefault(key, []).append(value)
    return found


@pytest.fixture
def units(tmp_path: Path) -> Path:
    """The units with a program that exists, since systemd looks."""
    for unit in (*UNITS, METRICS, MOVES, WEB):
        text = (SYSTEMD / unit).read_text().replace("/usr/bin/yahboomd", "/bin/true")
        (tmp_path / unit).write_text(text)
    return tmp_path


@pytest.mark.cases(2)
@needs_analyze
@pytest.mark.parametrize(
    "unit", ["yahboomd.service", "yahboomd@front.service", METRICS, MOVES, WEB]
)
def test_systemd_finds_nothing_to_say_about_the_unit(units: Path, unit: str) -> None:
    ran = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(units / unit)],
        capture_output=True,
        text=True,
        check=False,
    )
    ours = [line for line in (ran.stdout + ran.stderr).splitlines() if "yahboomd" in line]
    assert ours == []
    assert ran.returncode == 0


@pytest.mark.cases(2)
@needs_analyze
@pytest.mark.parametrize("unit", [*UNITS, METRICS, MOVES, WEB])
def test_the_service_is_exposed_to_little(unit: str) -> None:
    ran = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", str(SYSTEMD / unit)],
        capture_output=True,
        text=True,
        check=False,
    )
    figure = re.search(r"Overall exposure level for \S+: ([0-9.]+)", ran.stdout)
    if figure is None:
        pytest.skip("this systemd-analyze cannot judge a file (it came with systemd 250)")
    assert float(figure[1]) <= MOST_EXPOSURE


def test_the_unit_for_several_boards_differs_in_what_each_board_has_of_its_own() -> None:
    one, several = (keys(unit) for unit in UNITS)
    differing = {key for key in one if one[key] != several.get(key)}
    assert set(one) == set(several)
    assert differing == {
        "Description",
        "ExecStart",
        "ExecStopPost",
        "StateDirectory",
        "RuntimeDirectory",
        "WantedBy",
    }
    for key in differing - {"WantedBy"}:
        assert "%i" in several[key][0]


@pytest.mark.parametrize("unit", UNITS)
def test_a_robot_is_never_given_up_but_for_a_persons_mistake(unit: str) -> None:
    unit_keys = keys(unit)
    assert unit_keys["Restart"] == ["always"]
    assert unit_keys["StartLimitIntervalSec"] == ["0"]
    assert unit_keys["RestartPreventExitStatus"] == ["78"]


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize(("result", "runs"), [("success", False), ("exit-code", True)])
def test_wheels_that_were_not_seen_to_stand_are_stopped_once_more(
    unit: str, result: str, runs: bool
) -> None:
    """Status 75 is a failure to systemd: nothing makes it a success, or keeps a restart away."""
    unit_keys = keys(unit)
    assert "SuccessExitStatus" not in unit_keys
    assert "RestartForceExitStatus" not in unit_keys
    words = shlex.split(unit_keys["ExecStopPost"][0].replace("/usr/bin/yahboomd", "echo"))
    ran = subprocess.run(
        words, capture_output=True, text=True, check=True, env={"SERVICE_RESULT": result}
    )
    assert ran.stdout.startswith("stop --direct") is runs


@pytest.mark.parametrize("unit", UNITS)
def test_after_a_crash_the_guard_lives_on_and_the_watchdog_waits_for_it(unit: str) -> None:
    unit_keys = keys(unit)
    # By default systemd kills no other process of the group before TimeoutStopSec=.
    assert "KillMode" not in unit_keys
    assert "SendSIGKILL" not in unit_keys
    kill_after_s = MOST_PROMISED_NS / 1e9 + Limits().kill_after / 1e3
    assert int(unit_keys["WatchdogSec"][0]) > kill_after_s + 2.0
    assert int(unit_keys["TimeoutStopSec"][0]) > kill_after_s


@pytest.mark.parametrize("unit", UNITS)
def test_the_daemon_goes_before_other_services_also_where_niceness_does_not_count(
    unit: str,
) -> None:
    others = [int(keys(beside).get("CPUWeight", ["100"])[0]) for beside in (METRICS, MOVES, WEB)]
    assert int(keys(unit)["CPUWeight"][0]) > max(others)
    assert int(keys(unit)["Nice"][0]) < 0


@pytest.mark.parametrize("unit", UNITS)
def test_the_emergency_stop_outlives_the_service(unit: str) -> None:
    assert keys(unit)["RuntimeDirectoryPreserve"] == ["yes"]


@pytest.mark.parametrize("unit", UNITS)
def test_the_group_reaches_the_local_socket_and_others_do_not(unit: str) -> None:
    unit_keys = keys(unit)
    assert unit_keys["Group"] == ["yahboomd"]
    assert unit_keys["RuntimeDirectoryMode"] == ["0750"]
    assert "AF_UNIX" in unit_keys["RestrictAddressFamilies"][0].split()


@pytest.mark.parametrize("unit", UNITS)
def test_the_service_outlives_its_board(unit: str) -> None:
    assert not {"BindsTo", "Requires", "Requisite", "PartOf", "StopWhenUnneeded"} & set(keys(unit))


@pytest.mark.parametrize("unit", UNITS)
def test_a_listener_that_a_person_opens_is_not_cut_off(unit: str) -> None:
    assert not {"IPAddressDeny", "IPAddressAllow", "PrivateNetwork"} & set(keys(unit))


@pytest.mark.parametrize("unit", [*UNITS, METRICS, MOVES, WEB])
def test_the_page_that_a_unit_names_is_in_the_package(unit: str) -> None:
    (link,) = keys(unit)["Documentation"]
    page = link.removeprefix("file:/usr/share/doc/yahboomd/")
    assert (SYSTEMD.parent / page).is_file()


@pytest.mark.parametrize("beside", [METRICS, WEB])
def test_what_runs_beside_the_daemon_has_no_more_rights_than_named_and_does_not_start_with_it(
    beside: str,
) -> None:
    unit_keys = keys(beside)
    assert unit_keys["DynamicUser"] == ["yes"]
    assert not {"DeviceAllow", "RuntimeDirectory"} & set(unit_keys)
    if beside == WEB:
        # It writes the calibration file, and reads the black boxes.
        assert unit_keys["SupplementaryGroups"] == ["yahboomd"]
        assert unit_keys["ReadWritePaths"] == ["-/var/lib/yahboomd"]
        assert unit_keys["ReadOnlyPaths"] == ["-/var/lib/yahboomd/blackbox"]
    else:
        assert not {"SupplementaryGroups", "ReadWritePaths"} & set(unit_keys)
    assert unit_keys["IPAddressDeny"] == ["any"]
    assert unit_keys["IPAddressAllow"] == ["localhost"]
    for unit in UNITS:
        assert beside not in (SYSTEMD / unit).read_text()
    # All that protects the daemon protects it, too.
    weaker = {
        key
        for key, value in keys(UNITS[0]).items()
        if key.startswith(("Protect", "Private", "Restrict", "SystemCall", "Lock", "Memory", "No"))
        and unit_keys.get(key) != value
    }
    assert weaker <= {"NotifyAccess", "RestartPreventExitStatus"}


def test_the_pages_tokens_are_for_its_own_user_and_it_listens_on_loopback() -> None:
    unit_keys = keys(WEB)
    assert unit_keys["StateDirectory"] == ["yahboomd-web"]
    assert unit_keys["StateDirectoryMode"] == ["0700"]
    assert unit_keys["UMask"] == ["0077"]
    assert unit_keys["Environment"] == ['"WEB_OPTIONS=--listen 127.0.0.1:8480"']


def rules() -> list[str]:
    """The lines of the udev rule, each whole."""
    text = (SYSTEMD / "95-yahboomd.rules").read_text().replace("\\\n", " ")
    return [line for line in text.splitlines() if line and line[0] != "#"]


def usb_ids_of(line: str) -> set[str]:
    """The USB ids that a line of the rule is for."""
    vendor = re.search(r'ATTRS\{idVendor\}=="([0-9a-f]{4})"', line)
    products = re.search(r'ATTRS\{idProduct\}=="([0-9a-f|]+)"', line)
    assert vendor, line
    assert products, line
    return {f"{vendor[1]}:{product}" for product in products[1].split("|")}


@pytest.mark.parametrize(
    "effect", ['SYMLINK+="yahboom_driver"', 'ENV{ID_MM_DEVICE_IGNORE}="1"', 'ENV{SYSTEMD_WANTS}=""']
)
def test_the_rule_is_for_the_usb_ids_of_the_dialects_and_no_others(effect: str) -> None:
    from yahboomd.core.link.discovery import UDEV_NAME
    from yahboomd.core.protocol.registry import usb_ids

    assert UDEV_NAME == "/dev/yahboom_driver"
    lines = [line for line in rules() if effect in line]
    assert lines
    for line in lines:
        assert usb_ids_of(line) == set(usb_ids())


def test_of_several_the_likeliest_usb_id_has_the_name() -> None:
    from yahboomd.core.protocol.registry import usb_ids

    (line,) = (line for line in rules() if "link_priority" in line)
    assert usb_ids_of(line) == {usb_ids()[0]}
    # One without a priority has 0.
    found = re.search(r'OPTIONS\+="link_priority=(\d+)"', line)
    assert found
    assert int(found[1]) > 0


def test_a_board_that_is_plugged_in_gets_its_name_when_the_package_is_installed() -> None:
    from yahboomd.core.protocol.registry import usb_ids

    script = (SYSTEMD.parent / "packaging/postinst").read_text()
    triggered = set(re.findall(r"--attr-match=idVendor=(\w+)", script))
    assert triggered == {usb.partition(":")[0] for usb in usb_ids()}


needs_udevadm = pytest.mark.skipif(
    shutil.which("udevadm") is None, reason="this machine has no udevadm"
)


@needs_udevadm
def test_udev_finds_nothing_to_say_about_the_rule() -> None:
    ran = subprocess.run(
        ["udevadm", "verify", str(SYSTEMD / "95-yahboomd.rules")],
        capture_output=True,
        text=True,
        check=False,
    )
    if "verify" in ran.stderr and ran.returncode != 0 and "nknown command" in ran.stderr:
        pytest.skip("this udevadm verifies nothing (that came with systemd 254)")
    assert ran.returncode == 0, ran.stdout + ran.stderr


def test_the_device_that_wants_the_service_is_the_one_that_the_rule_names() -> None:
    assert "dev-yahboom_driver.device" in keys("yahboomd.service")["WantedBy"][0].split()
    assert 'TAG+="systemd"' in (SYSTEMD / "95-yahboomd.rules").read_text()


def test_the_rule_comes_after_those_that_it_overrules_and_before_systemds_own() -> None:
    names = sorted(
        ["95-yahboomd.rules", "85-brltty.rules", "90-brltty-device.rules", "99-systemd.rules"]
    )
    assert names.index("95-yahboomd.rules") == 2
