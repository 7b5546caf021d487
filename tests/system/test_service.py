"""The service on a real systemd: it starts, it stops the wheels whatever ends it, it comes back."""

from __future__ import annotations

import json
import re
import signal
import time

import pytest
from nspawn_machine import wait_until
from service_bench import PYTHON, SERVICE

pytestmark = pytest.mark.realtime
main_claim = pytest.mark.main_claim

GUARDS = "grep -l yahboomd-guard /proc/[0-9]*/comm | cut -d/ -f3"


@main_claim
def test_it_is_active_and_says_in_words_that_it_waits_for_the_board(machine) -> None:
    machine.run("systemctl", "start", SERVICE)
    assert machine.show(SERVICE, "ActiveState") == "active"
    wait_until(
        lambda: machine.show(SERVICE, "StatusText").startswith("waiting: no /dev/yahboom_driver"),
        "it says what it waits for",
    )
    assert machine.run("systemctl", "is-enabled", SERVICE).strip() == "enabled"
    machine.run("systemctl", "stop", SERVICE)


@main_claim
def test_after_sigkill_the_wheels_stop_and_the_service_drives_again(bench, figure) -> None:
    bench.drive()
    before = bench.pid()
    killed_ns = bench.kill(signal.SIGKILL)
    figure("SIGKILL", bench.board.stopped_after_s(killed_ns))
    bench.wait_until_active(before)
    bench.wait_for_status("driving")
    bench.wait_for_line("the wheels stand")


@main_claim
def test_a_daemon_that_hangs_is_killed_by_its_guard_and_the_service_returns(bench, figure) -> None:
    bench.drive()
    before = bench.pid()
    hung_ns = bench.kill(signal.SIGSTOP)
    figure("hang", bench.board.stopped_after_s(hung_ns))
    bench.wait_until_active(before)
    bench.wait_for_status("driving")
    bench.wait_for_line("was frozen or starved for 5 s, and was killed")
    assert not [text for _, text in bench.journal() if "Watchdog" in text]


@main_claim
def test_a_daemon_that_hangs_with_its_guard_is_ended_by_the_watchdog(bench, figure) -> None:
    bench.drive()
    before = bench.pid()
    bench.machine.run("sh", "-c", f"kill -STOP $({GUARDS})")
    hung_ns = bench.kill(signal.SIGSTOP)
    figure("hang of the guard, too", bench.board.stopped_after_s(hung_ns))
    bench.wait_until_active(before)
    bench.wait_for_line("Watchdog timeout")
    bench.wait_for_status("driving")


@main_claim
@pytest.mark.parametrize("away_s", [3, 15])
def test_a_crash_while_the_board_is_away_ends_in_wheels_that_stand_as_it_is_back(
    bench, figure, away_s: int
) -> None:
    """Its guard waits for the board until TimeoutStopSec=; then the next daemon does."""
    bench.drive()
    before = bench.pid()
    away_ns = time.monotonic_ns()
    bench.board.do(f"unplug {away_s}")
    bench.wait_for_line("the port went away")
    bench.kill(signal.SIGKILL)
    bench.stop_driving()
    back_ns = away_ns + away_s * 1_000_000_000
    figure(f"crash, board away {away_s} s", bench.board.stopped_after_s(back_ns))
    bench.wait_until_active(before)
    bench.wait_for_status("standing")
    timed_out = [text for _, text in bench.journal() if "timed out. Killing" in text]
    assert bool(timed_out) == (away_s > 10)


@main_claim
def test_a_port_that_vanishes_is_waited_for_by_the_same_process(bench) -> None:
    bench.drive()
    before = bench.pid()
    bench.stop_driving()
    bench.board.do("unplug 2")
    # Not by the status: on a busy machine it may be back before that was looked at.
    bench.wait_for_line("the port went away")
    bench.wait_for_line("Connected", 2)
    bench.wait_for_status("standing")
    assert bench.pid() == before
    assert bench.board.stands()


@main_claim
def test_systemctl_stop_has_stopped_the_wheels_when_it_returns(bench, figure) -> None:
    bench.drive()
    stopped_ns = time.monotonic_ns()
    bench.machine.run("systemctl", "stop", SERVICE)
    assert bench.board.stands()
    figure("systemctl stop", bench.board.stopped_after_s(stopped_ns))
    assert bench.machine.show(SERVICE, "Result") == "success"


def test_abort_and_a_restart_stop_the_wheels_too(bench, figure) -> None:
    for name in ("SIGABRT", "SIGTERM"):
        bench.drive()
        before = bench.pid()
        sent_ns = bench.kill(getattr(signal, name))
        figure(name, bench.board.stopped_after_s(sent_ns))
        bench.wait_until_active(before)
        bench.stop_driving()


def test_however_often_it_is_killed_it_comes_back(bench) -> None:
    for _ in range(6):
        before = bench.pid()
        bench.kill(signal.SIGKILL)
        bench.wait_until_active(before)
    bench.wait_for_status("standing")


def test_an_emergency_stop_outlives_a_kill_and_a_restart(bench) -> None:
    bench.drive()
    bench.machine.run("yahboomd", "stop")
    assert bench.board.stands()
    before = bench.pid()
    bench.kill(signal.SIGKILL)
    bench.wait_until_active(before)
    bench.wait_for_status("estopped")
    bench.machine.run("systemctl", "stop", SERVICE)
    bench.machine.run("systemctl", "start", SERVICE)
    bench.wait_for_status("estopped")
    assert bench.board.stands()
    bench.stop_driving()
    bench.machine.run("yahboomd", "stop", "--release")
    bench.drive()


def test_a_configuration_with_a_mistake_is_left_to_a_person(bench) -> None:
    machine = bench.machine
    machine.run(
        "sh",
        "-c",
        "cp /etc/yahboomd/config.toml /run/kept; echo '[serial' >> /etc/yahboomd/config.toml",
    )
    try:
        machine.run("systemctl", "restart", SERVICE, check=False)
        assert machine.show(SERVICE, "ActiveState") == "failed"
        assert machine.show(SERVICE, "ExecMainStatus") == "78"
        restarts = machine.show(SERVICE, "NRestarts")
        time.sleep(2.5)
        assert machine.show(SERVICE, "NRestarts") == restarts
        assert any("config.toml" in text for _, text in bench.journal())
    finally:
        machine.run("cp", "/run/kept", "/etc/yahboomd/config.toml")
    machine.run("systemctl", "start", SERVICE)
    bench.wait_for_status("standing")


@main_claim
def test_the_journal_reads_well(bench) -> None:
    bench.drive()
    before = bench.pid()
    bench.kill(signal.SIGKILL)
    bench.wait_until_active(before)
    bench.wait_for_status("driving")
    bench.board.do("unplug 1")
    bench.wait_for_line("the port went away")
    # At the start, after the kill, and now.
    bench.wait_for_line("Connected", 3)
    bench.wait_for_status("driving")
    lines = bench.journal()
    ours = [(priority, text) for priority, text in lines if not text.startswith("yahboomd.service")]
    # The priority is a field of its own, not part of the words.
    assert not [text for _, text in lines if re.match(r"<\d>", text)]
    assert [text for priority, text in ours if priority == 3 and "the port went away" in text], (
        "\n".join(map(str, lines))
    )
    assert [text for priority, text in ours if priority == 6 and text.startswith("Connected")]
    # Two seconds without a board, one kill: no flood.
    assert len(lines) < 30, lines


def test_a_board_that_is_away_for_long_is_logged_once(bench) -> None:
    bench.board.do("unplug 10")
    bench.wait_for_status("waiting")
    count = len(bench.journal())
    bench.wait_for_status("standing")
    # Besides the lines of the loss: that it is back, and the box of a daemon of an earlier test.
    assert len(bench.journal()) <= count + 5


def test_a_listen_port_that_another_process_has_is_waited_for_with_few_words(bench, rate) -> None:
    machine = bench.machine
    machine.run("systemctl", "stop", SERVICE)
    machine.run(
        *("systemd-run", "--quiet", "--unit=squatter.service", PYTHON, "-c"),
        "import socket, time; s = socket.create_server(('127.0.0.1', 7448)); time.sleep(1e6)",
    )
    wait_until(lambda: "LISTEN" in _listeners(machine), "the port is taken")
    try:
        count, began_s = len(bench.journal()), time.monotonic()
        machine.run("systemctl", "start", "--no-block", SERVICE)
        wait_until(
            lambda: bench.status().startswith("waiting for the bus: The bus cannot listen on"),
            "STATUS= says what it waits for",
        )
        assert machine.show(SERVICE, "ActiveState") == "activating"
        # Longer than its patience with one start, so that a restart's messages count too.
        wait_until(lambda: machine.show(SERVICE, "NRestarts") != "0", "a restart", 90.0)
        elapsed_s = max(60.0, time.monotonic() - began_s)
        lines = bench.journal()[count:]
        per_minute = 60.0 * len(lines) / elapsed_s
        rate("another process has the listen port", per_minute)
        assert per_minute <= 12, lines
        assert any("keeps trying" in text for _, text in lines), lines
        # `systemctl stop` does not have to wait for the bus.
        wait_until(lambda: bench.status().startswith("waiting for the bus"), "it waits again")
        machine.run("systemctl", "stop", SERVICE)
        assert machine.show(SERVICE, "Result") == "success"
        machine.run("systemctl", "start", "--no-block", SERVICE)
        wait_until(lambda: bench.status().startswith("waiting for the bus"), "it waits again")
        before = bench.pid()
    finally:
        machine.run("systemctl", "stop", "squatter.service")
    # The same process, no restart: the port is free and the bus stands.
    bench.wait_for_status("standing")
    assert bench.pid() == before
    bench.drive()


def test_a_daemon_that_fails_at_every_start_does_not_fill_the_journal(bench, rate) -> None:
    machine = bench.machine
    # As long as a traceback, each second and a half, and it would be for ever.
    script = "#!/bin/sh\nfor each in $(seq 60); do echo a line of a traceback; done\nexit 70\n"
    (machine.shared / "fails").write_text(script)
    (machine.shared / "fails").chmod(0o755)
    dropin = "/run/systemd/system/yahboomd.service.d/test.conf"
    machine.run("mkdir", "-p", "/run/systemd/system/yahboomd.service.d")
    settings = "[Service]\\nExecStart=\\nExecStart=/run/shared/fails\\n"
    machine.run("sh", "-c", f"printf '{settings}' > {dropin}")
    try:
        machine.run("systemctl", "daemon-reload")
        count = len(bench.journal())
        machine.run("systemctl", "restart", SERVICE, check=False)
        time.sleep(60.0)
        per_minute = len(bench.journal()) - count
        restarts = int(machine.show(SERVICE, "NRestarts"))
        rate(f"{restarts} starts that failed with 60 lines each", per_minute)
        assert restarts > 15
        assert per_minute < 1200
    finally:
        machine.run("rm", "-f", dropin)
        machine.run("systemctl", "daemon-reload")
        machine.run("systemctl", "restart", SERVICE)
    bench.wait_for_status("standing")


def test_it_runs_as_its_own_user_without_any_right_of_root(bench) -> None:
    pid = bench.pid()
    status = bench.machine.run("cat", f"/proc/{pid}/status")
    user = bench.machine.run("id", "-u", "yahboomd").strip()
    assert re.search(rf"^Uid:\s+{user}\s+{user}\s", status, re.MULTILINE)
    assert re.search(r"^CapEff:\s+0+$", status, re.MULTILINE)
    assert re.search(r"^CapBnd:\s+0+$", status, re.MULTILINE)
    assert re.search(r"^NoNewPrivs:\s+1$", status, re.MULTILINE)
    assert re.search(r"^Seccomp:\s+2$", status, re.MULTILINE)


def test_members_of_its_group_reach_the_unix_socket_and_others_do_not(bench) -> None:
    machine = bench.machine
    machine.run("mkdir", "-p", "/run/systemd/system/yahboomd.service.d")
    dropin = "/run/systemd/system/yahboomd.service.d/test.conf"
    listen = 'YAHBOOMD_ZENOH__LISTEN=["unixsock-stream//run/yahboomd/zenoh.sock"]'
    machine.run("sh", "-c", f"printf '%s\\n' '[Service]' '{_environment(listen)}' > {dropin}")
    try:
        machine.run("systemctl", "daemon-reload")
        machine.run("systemctl", "restart", SERVICE)
        sockets = machine.run("sh", "-c", "ls -l /run/yahboomd")
        assert re.search(r"^srwxrwx--- .* yahboomd yahboomd .* zenoh\.sock", sockets, re.MULTILINE)
        listing = machine.run(
            "setpriv", "--reuid=65534", "--clear-groups", "--regid=65534", "ls", "/run/yahboomd",
            check=False,
        )  # fmt: skip
        assert "Permission denied" in listing
        bench.drive("unixsock-stream//run/yahboomd/zenoh.sock")
    finally:
        machine.run("rm", "-f", dropin)
        machine.run("systemctl", "daemon-reload")


@main_claim
def test_systemd_has_nothing_to_say_about_the_units_and_calls_them_safe(machine) -> None:
    for unit in ("yahboomd.service", "yahboomd@front.service"):
        said = machine.run("systemd-analyze", "verify", "--man=no", unit)
        assert [line for line in said.splitlines() if "yahboomd" in line] == []
        security = machine.run("systemd-analyze", "security", "--no-pager", unit)
        figure = re.search(r"exposure level for \S+: ([0-9.]+)", security)
        assert figure is not None, security
        assert float(figure[1]) <= 1.5


def test_udev_has_nothing_to_say_about_the_rule(machine) -> None:
    version = int(machine.run("systemctl", "--version").split()[1])
    if version < 254:
        pytest.skip(f"systemd {version} has no udevadm verify")
    said = machine.run("udevadm", "verify", "/usr/lib/udev/rules.d/95-yahboomd.rules")
    assert re.search(r"^\s*Fail:\s+0$", said, re.MULTILINE), said


def _listeners(machine) -> str:
    # ss is not part of a small Debian. 1D18 is 7448, 0A listening.
    table = machine.run("cat", "/proc/net/tcp")
    return "LISTEN" if re.search(r":1D18 \S+ 0A ", table) else ""


def _environment(setting: str) -> str:
    escaped = setting.replace('"', '\\"')
    return f'Environment="{escaped}"'


@main_claim
def test_the_metrics_are_off_until_enabled_and_outlive_the_daemon(bench) -> None:
    machine = bench.machine
    unit = "yahboomd-metrics.service"
    ask = "import urllib.request as r; print(r.urlopen('http://127.0.0.1:9448/metrics').read().decode())"

    def page() -> str:
        return machine.run(PYTHON, "-c", ask, check=False)

    assert machine.run("systemctl", "is-enabled", unit, check=False).strip() == "disabled"
    assert machine.show(unit, "ActiveState") == "inactive"
    machine.run("systemctl", "enable", "--now", unit)
    try:
        wait_until(lambda: 'yahboomd_up{robot="yahboomd"} 1' in page(), "the daemon is seen")
        # Under all that shields it from the system, with a user of its own.
        assert 'yahboomd_board_info{robot="yahboomd",port="/dev/' in page()
        # The range of users that systemd makes for a service alone.
        assert 61184 <= int(machine.show(unit, "UID")) <= 65519
        machine.run("systemctl", "stop", SERVICE)
        wait_until(lambda: 'yahboomd_up{robot="yahboomd"} 0' in page(), "it is seen to be gone")
        machine.run("systemctl", "kill", "--signal=SIGKILL", unit)
        machine.run("systemctl", "start", SERVICE)
        wait_until(lambda: 'yahboomd_up{robot="yahboomd"} 1' in page(), "both are back")
    finally:
        machine.run("systemctl", "disable", "--now", unit)
        machine.run(PYTHON, "-c", ADDRESS, "127.0.0.1")
    bench.drive()


ENTER = """
import http.client, json, sys
def ask(method, path, token=""):
    link = http.client.HTTPConnection("127.0.0.1", 8480)
    body = json.dumps({"token": token}) if token else ""
    headers = {"Origin": "http://127.0.0.1:8480"} if method == "POST" else {}
    link.request(method, path, body, headers)
    answer = link.getresponse()
    return answer.status, answer.read().decode()
print(*ask("GET", "/session"), *ask("POST", "/session", sys.argv[1]))
"""


ADDRESS = """
import fcntl, socket, struct, sys
for name, address in zip(("lo", "lo:1"), sys.argv[1:]):
    inet = struct.pack("HH4s8x", socket.AF_INET, 0, socket.inet_aton(address))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        fcntl.ioctl(link, 0x8916, struct.pack("16s16s8x", name.encode(), inet))
"""
"""Gives the loopback these addresses (SIOCSIFADDR): the machine has no other network."""


@main_claim
def test_the_page_is_off_until_installed_and_its_tokens_are_in_no_journal(bench) -> None:
    machine = bench.machine
    unit = "yahboomd-web.service"

    def entered(token: str) -> str:
        return machine.run(PYTHON, "-c", ENTER, token, check=False)

    assert machine.run("systemctl", "is-enabled", unit, check=False).strip() == "disabled"
    machine.run("yahboomd", "install", "--web")
    try:
        # On loopback everybody on this machine drives.
        wait_until(lambda: entered("none").startswith('200 {"role":"driver"'), "the page")
        assert 61184 <= int(machine.show(unit, "UID")) <= 65519
        machine.run("yahboomd", "install", "--web", "--listen", "0.0.0.0:8480")
        wait_until(lambda: entered("wrong").startswith("401"), "the page wants a link")
        assert "no address on a network" in machine.run("yahboomd", "web", "--show-link")
        machine.run(PYTHON, "-c", ADDRESS, "192.0.2.7", "127.0.0.1")
        links = machine.run("yahboomd", "web", "--show-link")
        tokens = re.findall(r"#token=([\w-]{22})", links)
        assert len(set(tokens)) == 2
        assert " 204 " in entered(tokens[0])
        journal = machine.run("journalctl", "-u", unit, "--no-pager")
        assert "yahboomd web --show-link" in journal
        assert not any(token in journal for token in tokens)
        machine.run("systemctl", "kill", "--signal=SIGKILL", unit)
        wait_until(lambda: " 204 " in entered(tokens[1]), "it is back, and knows the other link")
        assert "used already" in entered(tokens[1])
        listed = machine.run("yahboomd", "web", "--sessions")
        assert len(re.findall("A browser", listed)) == 2
        machine.run("yahboomd", "web", "--end-session", "all")
        assert "No phone has a session" in machine.run("yahboomd", "web", "--sessions")
        assert machine.show(SERVICE, "ActiveState") == "active"
    finally:
        machine.run("systemctl", "disable", "--now", unit)
    bench.drive()


TOOLS = """
import asyncio, http.client, json
from websockets.asyncio.client import connect
def boxes():
    link = http.client.HTTPConnection("127.0.0.1", 8480)
    link.request("GET", "/boxes")
    return json.loads(link.getresponse().read())
async def main():
    async with connect("ws://127.0.0.1:8480/ws", origin="http://127.0.0.1:8480") as socket:
        async def until(wanted):
            async for frame in socket:
                for part in json.loads(frame):
                    if (found := wanted(part)) is not None:
                        return found
        async def use(number, what, args):
            tool = {"type": "tool", "id": number, "do": what, "args": args}
            await socket.send(json.dumps(tool))
            return await until(lambda part: part["text"] if part.get("id") == number else None)
        await until(lambda part: part if part["type"] == "status" else None)
        undone = await use(1, "undo_calibration", {})
        await use(2, "calibrate", {"verb": "tape", "choices": {}})
        asked = await until(
            lambda part: (part["question"] or {}).get("text") or part["refused"] or None
            if part["type"] == "calibration" else None
        )
    print(json.dumps({"boxes": boxes(), "undone": undone, "asked": asked}))
asyncio.run(main())
"""


CALIBRATION = """
made = "2026-01-01 00:00"
method = "tape"
residual = "none"
geometry.kinematics = "differential"
geometry.wheel_separation_m = 0.15
geometry.wheel_radius_m = 0.0335
geometry.ticks_per_revolution = 1560.0
[chassis]
wheel_radius_multiplier = { left = 1.0, right = 1.0 }
wheel_separation_multiplier = 1.0
[before]
wheel_radius_multiplier = { left = 1.0, right = 1.0 }
wheel_separation_multiplier = 1.0
"""


def test_the_page_writes_the_calibration_and_reads_the_black_boxes(bench) -> None:
    machine = bench.machine
    unit, state = "yahboomd-web.service", "/var/lib/yahboomd"
    machine.run("yahboomd", "blackbox", "save", check=False)
    (machine.shared / "calibration.toml").write_text(CALIBRATION)
    machine.run("cp", "/run/shared/calibration.toml", state)
    machine.run("rm", "-rf", f"/etc/systemd/system/{unit}.d")
    machine.run("yahboomd", "install", "--web")
    try:
        wait_until(
            lambda: machine.run(PYTHON, "-c", ENTER, "none", check=False).startswith("200"),
            "a page",
        )
        found = json.loads(machine.run(PYTHON, "-c", TOOLS))
        assert found["boxes"]["problem"] == ""
        assert found["boxes"]["boxes"]
        # It may write there: the undone calibration is gone, and another may begin.
        assert "calibration.toml" not in machine.run("ls", state), found["undone"]
        assert "A straight of 2 m" in found["asked"], found
        # Boxes are read-only for it: in its service even root writes none.
        pid = machine.show(unit, "MainPID")
        inside = f"nsenter --mount --target={pid} touch {state}/blackbox/x 2>&1"
        assert "Read-only" in machine.run("sh", "-c", inside, check=False)
    finally:
        machine.run("systemctl", "disable", "--now", unit)


def test_the_black_box_of_a_killed_daemon_is_saved_for_its_group_and_explained(bench) -> None:
    machine = bench.machine
    # Boxes of earlier tests, and those that wait to be saved: it is one a minute.
    machine.run("systemctl", "stop", SERVICE)
    machine.run("sh", "-c", "rm -rf /var/lib/yahboomd/blackbox /run/yahboomd/*.ring")
    machine.run("systemctl", "start", SERVICE)
    bench.drive()
    before = bench.pid()
    bench.kill(signal.SIGKILL)
    bench.wait_until_active(before)
    bench.wait_for_status("driving")
    listing = machine.run(
        *("sh", "-c"),
        "for n in $(seq 50); do ls -l /var/lib/yahboomd/blackbox/*_killed*.blackbox && exit; "
        "sleep 0.2; done; ls -lR /var/lib/yahboomd",
    )
    assert re.search(
        r"^-rw-r----- .* yahboomd yahboomd .*_killed\.blackbox$", listing, re.MULTILINE
    )
    # Under its hardening the ring is in memory that outlives the process.
    assert ".ring" in machine.run("ls", "/run/yahboomd")
    explained = machine.run("yahboomd", "blackbox", "explain")
    assert "saved for: the daemon was killed" in explained
    assert "It drives to the end of the record." in explained


def test_the_stop_after_a_kill_has_longer_than_the_daemons_own(bench) -> None:
    machine = bench.machine
    machine.run("mkdir", "-p", "/run/systemd/system/yahboomd.service.d")
    dropin = "/run/systemd/system/yahboomd.service.d/test.conf"
    machine.run("sh", "-c", f"printf '[Service]\\nTimeoutStopSec=4\\n' > {dropin}")
    try:
        machine.run("systemctl", "daemon-reload")
        bench.drive()
        bench.kill(signal.SIGKILL)
        pid = wait_until(lambda: _asked_to_wait(machine), "systemd is asked to wait")
        # As one that has next to no processor.
        machine.run("sh", "-c", f"kill -STOP {pid}")
        time.sleep(6.0)
        machine.run("sh", "-c", f"kill -CONT {pid}")
        bench.wait_for_line("the wheels stand")
        assert not [text for _, text in bench.journal() if "timed out" in text]
    finally:
        machine.run("rm", "-f", dropin)
        machine.run("systemctl", "daemon-reload")


def _asked_to_wait(machine) -> str:
    """The process that stops the wheels, once systemd-notify beside it has said so."""
    pid = machine.show(SERVICE, "ControlPID")
    words = machine.run("sh", "-c", f"tr '\\0' ' ' < /proc/{pid}/cmdline", check=False)
    asking = "for each in /proc/[0-9]*/status; do grep -qs 'Name:.systemd-notif' $each && "
    asking += "grep -L 'State:.Z' $each; done"
    asks = "/proc/" in machine.run("sh", "-c", asking, check=False)
    return pid if "yahboomd stop --direct" in words and not asks else ""
