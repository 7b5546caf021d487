"""Runs inside the emulated ARM computer: drives the simulated board through the installed service.

Each line on the console that starts with ``ok:`` or ``FAILED:`` is a claim, with ``figure:`` a
measurement.
"""

from __future__ import annotations

import json
import os
import platform
import signal
import subprocess
import time
import traceback
import urllib.request
from collections.abc import Callable
from pathlib import Path

from yahboomd.simulation.truth import read_truth

PYTHON = "/opt/yahboomd/bin/python3"
LINK = "/dev/yahboom_driver"
TRUTH = Path("/run/truth")
PATIENCE_S = 240.0

DRIVER = """
import time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["tcp/127.0.0.1:7448"]')
config.insert_json5("scouting/multicast/enabled", "false")
session = zenoh.open(config)
while True:
    session.put("cmd_vel", '{"vx": 0.3}')
    time.sleep(0.05)
"""

KNOWN = "--profile 520 --kinematics differential --wheel-diameter 67 --wheel-separation 150"
ANSWERS = "n\nyes\n\n1\nf\n\n0\n\n2\nf\n"
"""Store nothing; the wheels are lifted; M1 left, M2 none, M3 right, both forward."""

WRITABLE_CODE = "import mmap; mmap.mmap(-1, 4096, prot=mmap.PROT_WRITE | mmap.PROT_EXEC)"


def sh(words: str, given: str | None = None) -> str:
    done = subprocess.run(
        words, shell=True, capture_output=True, text=True, input=given, check=False
    )
    return (done.stdout + done.stderr).strip()


def works(words: str) -> bool:
    return subprocess.run(words, shell=True, capture_output=True, check=False).returncode == 0


def claim(words: str, holds: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not holds():
        if time.monotonic() > deadline:
            print(f"FAILED: {words}", flush=True)
            print(sh("systemctl status 'yahboomd*'; journalctl -o cat | tail -30"), flush=True)
            return
        time.sleep(0.2)
    print(f"ok: {words}", flush=True)


def figure(what: str, value: float, unit: str) -> None:
    print(f"figure: {what}: {value:.3g} {unit}", flush=True)


def show(key: str, unit: str = "yahboomd") -> str:
    return sh(f"systemctl show --property {key} --value {unit}")


def says(state: str) -> bool:
    return show("ActiveState") == "active" and show("StatusText").startswith(f"{state}:")


def speed_m_s() -> float:
    return max(map(abs, read_truth(TRUTH)[-1].speed_m_s))


def drive() -> None:
    sh("systemctl start driver")
    claim("commands turn the wheels", lambda: speed_m_s() > 0.25)


def stood_ns(since_ns: int) -> int | None:
    """The first moment at which the wheels stood, after a given one."""
    later = (each for each in read_truth(TRUTH) if each.t_ns >= since_ns)
    return next((each.t_ns for each in later if max(map(abs, each.speed_m_s)) < 0.03), None)


def stand(what: str, since_ns: int) -> None:
    claim(f"{what}: the wheels stand", lambda: stood_ns(since_ns))
    before = [each for each in read_truth(TRUTH) if each.t_ns < since_ns]
    # A computer this slow may have starved the driving program, so that they stood already.
    turned = bool(before) and max(map(abs, before[-1].speed_m_s)) > 0.2
    if turned and (at_ns := stood_ns(since_ns)) is not None:
        figure(what, (at_ns - since_ns) / 1e6, "ms to standing wheels")


def sandbox() -> None:
    status = Path(f"/proc/{show('MainPID')}/status").read_text()
    claim("system calls of the service are filtered by the kernel", lambda: "Seccomp:\t2" in status)
    claim("it can gain no privileges", lambda: "NoNewPrivs:\t1" in status)
    denied = f'systemd-run --quiet --pipe --wait -p MemoryDenyWriteExecute=yes {PYTHON} -c "{{}}"'
    words = sh(denied.format(WRITABLE_CODE))
    claim("the kernel refuses writable code", lambda: "PermissionError" in words)


def stops() -> None:
    drive()
    now_ns = time.monotonic_ns()
    sh("systemctl kill --signal=SIGKILL driver; systemctl stop driver")
    stand("the driving program is killed", now_ns)

    drive()
    now_ns = time.monotonic_ns()
    sh("yahboomd stop")
    stand("yahboomd stop", now_ns)
    claim("the emergency stop is engaged", lambda: says("estopped"))
    claim("no release while a program drives", lambda: not works("yahboomd stop --release"))
    sh("systemctl stop driver")
    # A slow computer may not answer in time; a person asks again then.
    claim("the stop is released", lambda: works("yahboomd stop --release"))
    drive()

    killed = show("MainPID")
    now_ns = time.monotonic_ns()
    os.kill(int(killed), signal.SIGKILL)
    claim("after SIGKILL another process serves", lambda: show("MainPID") not in {killed, "0"})
    claim("which drives", lambda: says("driving"))
    # Standing in between: it drives again as soon as it is back.
    stand("SIGKILL", now_ns)
    claim("it drives at full speed", lambda: speed_m_s() > 0.25)

    now_ns = time.monotonic_ns()
    sh("systemctl stop yahboomd")
    stand("systemctl stop", now_ns)
    sh("systemctl stop driver")


def tools() -> None:
    found = json.loads(sh(f"yahboomd probe --json --port {LINK} 2>/dev/null"))
    claim("probe finds the board", lambda: found["dialect"] == "streamed")
    options = f"--json --port {LINK} {KNOWN} --output /root/bot.toml"
    words = sh(f"yahboomd setup {options} 2>/root/setup.log", ANSWERS)
    if not words:
        print(sh("tail -n 30 /root/setup.log"), flush=True)
    claim("setup finds both motors", lambda: len(json.loads(words)["motors"]) == 2)
    checked = sh("yahboomd config check --config /root/bot.toml >/dev/null && echo good")
    claim("and writes a file that is valid", lambda: checked == "good")


def page() -> None:
    sh("systemctl start yahboomd yahboomd-web")

    def served() -> bool:
        try:
            with urllib.request.urlopen("http://127.0.0.1:8480/") as answer:
                return b"yahboomd" in answer.read()
        except OSError:
            return False

    claim("the page is served", served)


def main() -> None:
    claim("this is 64-bit ARM", lambda: platform.machine() == "aarch64")
    claim("the service is up, and waits for a board", lambda: says("waiting"))
    began, ended = (
        int(show(f"{each}TimestampMonotonic")) for each in ("InactiveExit", "ActiveEnter")
    )
    figure("start of the service, beside the rest of the boot", (ended - began) / 1e6, "s")
    sandbox()
    # Pseudo-terminals get the group and the mode that udev gives serial ports.
    sh("mount -o remount,mode=660,gid=20 /dev/pts")
    sh(f"systemd-run --unit=board yahboomd simulate --link {LINK} --truth {TRUTH}")
    Path("/root/driver.py").write_text(DRIVER)
    unit = f"[Service]\nExecStart={PYTHON} /root/driver.py\nRestart=always\n"
    Path("/run/systemd/system/driver.service").write_text(unit)
    sh("systemctl daemon-reload")
    claim("it finds the board", lambda: says("standing"))
    now_ns = time.monotonic_ns()
    sh("systemctl restart yahboomd")
    claim("it starts again", lambda: says("standing"))
    figure("restart, until it stands ready", (time.monotonic_ns() - now_ns) / 1e9, "s")
    stops()
    tools()
    page()
    claim("the service is back", lambda: says("standing"))
    for unit in ("yahboomd", "yahboomd-web"):
        status = Path(f"/proc/{show('MainPID', unit)}/status").read_text()
        resident = next(line for line in status.splitlines() if line.startswith("VmRSS"))
        figure(f"memory of {unit}", int(resident.split()[1]) / 1e3, "MB")
    errors = sh("journalctl --unit=yahboomd --output=cat")
    claim("its journal has no traceback", lambda: "Traceback" not in errors)
    print("end", flush=True)


if __name__ == "__main__":
    try:
        main()
    except Exception:
        traceback.print_exc()
    finally:
        # The console is slow.
        time.sleep(2)
        sh("poweroff -f")
