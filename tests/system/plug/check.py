"""Runs inside the emulated PC: plugs simulated boards in and prints the results.

Each line on the console that starts with ``ok:`` or ``FAILED:`` is a claim.
"""

from __future__ import annotations

import os
import signal
import subprocess
import time
import traceback
from collections.abc import Callable
from pathlib import Path

PYTHON = "/opt/yahboomd/bin/python3"
RULE = Path("/usr/lib/udev/rules.d/95-yahboomd.rules")
NAME = Path("/dev/yahboom_driver")
BY_PATH = Path("/dev/serial/by-path")
HEARD = Path("/run/heard")
PATIENCE_S = 60.0

VOICE = f"""
import os, pty, tty
master, slave = pty.openpty()
tty.setraw(slave)
os.symlink(os.ttyname(slave), "/run/board2")
while data := os.read(master, 100):
    open("{HEARD}", "ab").write(data)
"""


def sh(words: str) -> str:
    done = subprocess.run(words, shell=True, capture_output=True, text=True, check=False)
    return (done.stdout + done.stderr).strip()


def claim(words: str, holds: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not holds():
        if time.monotonic() > deadline:
            print(f"FAILED: {words}", flush=True)
            print(sh("systemctl status 'yahboomd*'; journalctl -k -o cat | tail"), flush=True)
            return
        time.sleep(0.2)
    print(f"ok: {words}", flush=True)


def show(unit: str, key: str) -> str:
    return sh(f"systemctl show --property {key} --value {unit}")


def says(unit: str, state: str) -> bool:
    # The last status of a service that is down remains.
    active = show(unit, "ActiveState") == "active"
    return active and show(unit, "StatusText").startswith(f"{state}:")


def stopped() -> bool:
    return "the wheels stand" in sh("journalctl -u yahboomd -o cat")


def board(number: int) -> None:
    path = Path(f"/run/board{number}")
    # An emulated PC is slow, and a polled board sends little by itself.
    sh(f"systemd-run --unit=board{number} yahboomd simulate --dialect polled --link {path}")
    while not path.exists():
        time.sleep(0.1)


def voice_module() -> None:
    """A device that says nothing and keeps what it is sent, as number 2."""
    HEARD.touch()
    subprocess.Popen([PYTHON, "-c", VOICE])
    while not os.path.lexists("/run/board2"):
        time.sleep(0.1)


def plug(number: int, product: str = "7523") -> None:
    chip = f"{PYTHON} /root/usbip_ch340.py {number} /run/board{number} {product}"
    sh(f"systemd-run --unit=plug{number} {chip}")


def unplug(number: int) -> None:
    sh(f"echo {number} > /sys/devices/platform/vhci_hcd.0/detach")
    # One that ended by itself counts as failed, and its name could not be used again.
    sh(f"systemctl stop plug{number}; systemctl reset-failed plug{number}")


def sockets() -> set[Path]:
    """The ports by their sockets; udev creates the folder with the first one."""
    return set(BY_PATH.glob("*"))


def main() -> None:
    sh("modprobe vhci-hcd")
    claim("the service is up, without a board", lambda: says("yahboomd", "waiting"))
    loaded = "ttyUSB" in Path("/proc/devices").read_text()
    claim("the serial driver is not loaded yet", lambda: not loaded)
    board(0)
    board(1)

    plug(0)
    claim("a board of 1a86:7523 gets its name", NAME.exists)
    claim("the waiting service may open it and drives", lambda: says("yahboomd", "standing"))
    claim(
        "brltty's rule would have taken it, and did not",
        lambda: show("brltty-stand-in", "ActiveState") == "inactive",
    )
    properties = sh(f"udevadm info {NAME}")
    claim("ModemManager leaves it alone", lambda: "ID_MM_PORT_IGNORE=1" in properties)
    denied = (
        "systemd-run --quiet --pipe --wait -p DevicePolicy=closed -p 'DeviceAllow=char-188 rw' "
        "sh -c 'exec 3<>/dev/ttyS1'"
    )
    claim("no other port is open to it", lambda: "Operation not permitted" in sh(denied))

    killed = show("yahboomd", "MainPID")
    os.kill(int(killed), signal.SIGKILL)
    claim("after SIGKILL the port is taken to stop the wheels", stopped)
    # The dead daemon's last status remains until the next one publishes.
    claim(
        "and the service is back",
        lambda: (
            show("yahboomd", "ActiveState") == "active"
            and show("yahboomd", "MainPID") != killed
            and says("yahboomd", "standing")
        ),
    )

    before = show("yahboomd", "MainPID")
    unplug(0)
    claim("unplugged, it waits", lambda: says("yahboomd", "waiting"))
    plug(1, "7522")
    claim("a board of 1a86:7522 is taken", lambda: says("yahboomd", "standing"))
    claim("by the same process", lambda: show("yahboomd", "MainPID") == before)

    sh("systemctl stop yahboomd")
    unplug(1)
    claim("the name goes with the board", lambda: not NAME.exists())
    plug(1)
    claim("a stopped service starts at plug-in", lambda: says("yahboomd", "standing"))

    named = NAME.resolve()
    voice_module()
    plug(2, "7522")
    claim("a voice module of 1a86:7522 is there, too", lambda: len(sockets()) == 2)
    sh("udevadm settle")
    claim("though it came last, the board has the name", lambda: NAME.resolve() == named)
    (module,) = {each.resolve() for each in sockets()} - {named}
    properties = sh(f"udevadm info {module}")
    claim("ModemManager leaves it alone as well", lambda: "ID_MM_PORT_IGNORE=1" in properties)
    sh("systemctl restart yahboomd")
    claim("with both there, the board is found", lambda: says("yahboomd", "standing"))
    said = f"{module} (1a86:7522) was not asked; "
    said_too = f"{module} (1a86:7522) was not asked."
    log = sh("journalctl -u yahboomd -o cat")
    claim("the log names the voice module", lambda: said in log or said_too in log)
    claim("which was sent nothing", lambda: HEARD.read_bytes() == b"")
    unplug(1)
    claim("without the board, the name is the module's", lambda: NAME.resolve() == module)
    plug(1)
    claim("and the board's again", lambda: NAME.exists() and NAME.resolve() != module)
    claim("which the service drives", lambda: says("yahboomd", "standing"))
    unplug(2)
    claim("the module is gone", lambda: len(sockets()) == 1)

    first = sockets()
    plug(0)
    claim("two boards have a name each by their sockets", lambda: len(sockets()) == 2)
    second = (sockets() - first).pop()
    print(sh(f"yahboomd install --instance front --port {second}"), flush=True)
    claim("the second board has its own service", lambda: says("yahboomd@front", "standing"))
    claim("the first one's goes on", lambda: says("yahboomd", "standing"))

    sh("systemctl disable --now yahboomd yahboomd@front")
    unplug(0)
    unplug(1)
    plug(0)
    claim("the board is back", NAME.exists)
    time.sleep(5)
    claim("disabled is disabled", lambda: show("yahboomd", "ActiveState") == "inactive")

    # Without our rule, the stand-in for brltty must start: else it proves nothing above.
    unplug(0)
    RULE.rename("/root/rule")
    sh("udevadm control --reload")
    plug(0)
    claim(
        "without our rule, brltty's takes the board",
        lambda: show("brltty-stand-in", "ActiveState") == "active",
    )
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
