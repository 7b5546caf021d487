"""Runs inside the emulated PC: plugs simulated boards in and prints the results.

Each line on the console that starts with ``ok:`` or ``FAILED:`` is a claim.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import time
import traceback
from collections.abc import Callable
from pathlib import Path

from yahboomd.simulation.truth import TruthSample, read_truth

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
    sh(
        f"systemd-run --unit=board{number} yahboomd simulate --dialect polled --link {path} "
        f"--truth {path}.truth --control {path}.control"
    )
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


RELAY = """
[Service]
TimeoutStartSec=300
Environment=YAHBOOMD_GUARD__RELAY={chip}:0
DeviceAllow={chip} rw
SupplementaryGroups=gpio
"""


def speed_m_s(sample: TruthSample) -> float:
    return max(map(abs, sample.speed_m_s))


def rows(*kinds: str) -> list[tuple[str, int]]:
    """What the relay's circuit printed of these kinds, and when."""
    said = (row.split() for row in Path("/run/relay").read_text().splitlines())
    return [(kind, int(t_ns)) for kind, t_ns in said if kind in kinds]


def relay_is(kind: str) -> bool:
    return rows("holds", "falls")[-1][0] == kind


def relay_falls(fault: str, cause: Callable[[], object]) -> None:
    """Drive, cause a fault, and see the relay take the motors' supply away."""
    truth = Path("/run/board0.truth")
    driver = subprocess.Popen(["yahboomd", "send", "--vx", "0.3", "--for", "600"])
    claim(f"{fault}: before that the robot drives", lambda: speed_m_s(read_truth(truth)[-1]) > 0.2)
    time.sleep(3.0)
    began_ns = time.monotonic_ns()
    cause()

    def fell_ns() -> int:
        return next((t_ns for _, t_ns in rows("falls") if t_ns > began_ns), 0)

    def stood_ns() -> int:
        later = (each for each in read_truth(truth) if each.t_ns > began_ns)
        return next((each.t_ns for each in later if speed_m_s(each) < 0.03), 0)

    claim(f"{fault}: the relay falls", fell_ns)
    claim(f"{fault}: the wheels stand", stood_ns)
    edges = [(t_ns - began_ns) / 1e9 for _, t_ns in rows("edge")]
    last = max(each for each in edges if each * 1e9 < fell_ns() - began_ns)
    rate_hz = sum(-3.0 < each < 0.0 for each in edges) / 3.0
    took = [(t_ns - began_ns) / 1e9 for t_ns in (fell_ns(), stood_ns())]
    print(
        f"ok: {fault}: after {rate_hz:.1f} Hz the newest edge came at {last:.2f} s, the relay fell "
        f"at {took[0]:.2f} s, the wheels stood at {took[1]:.2f} s",
        flush=True,
    )
    driver.kill()


def control(words: str) -> None:
    with socket.socket(socket.AF_UNIX) as console:
        console.connect("/run/board0.control")
        console.sendall(words.encode() + b"\n")
        console.recv(100)


def named_guard(comm: Path) -> bool:
    try:
        return comm.read_text().strip() == "yahboomd-guard"
    except OSError:
        return False


def freeze() -> None:
    """End the guard, and let its owner neither stop the wheels nor start another one."""
    guards = [each.parent for each in Path("/proc").glob("[0-9]*/comm") if named_guard(each)]
    os.kill(int(show("yahboomd", "MainPID")), signal.SIGSTOP)
    for each in guards:
        os.kill(int(each.name), signal.SIGKILL)


def relay() -> None:
    """Board 0 is there and driven by the service; its supply gets the relay."""
    before = set(Path("/dev").glob("gpiochip*"))
    chip = f"{PYTHON} /root/usbip_relay.py 3 /run/board0.control"
    sh(f"systemd-run --unit=relay --property=StandardOutput=file:/run/relay {chip}")
    claim("the relay's chip is there", lambda: set(Path("/dev").glob("gpiochip*")) - before)
    (line,) = set(Path("/dev").glob("gpiochip*")) - before
    sh(f"groupadd gpio; chgrp gpio {line}; chmod 660 {line}")
    claim("without the guard the relay has fallen", lambda: relay_is("falls"))
    dropin = Path("/run/systemd/system/yahboomd.service.d/relay.conf")
    dropin.parent.mkdir(parents=True, exist_ok=True)
    dropin.write_text(RELAY.format(chip=line))
    sh("systemctl daemon-reload; systemctl restart yahboomd")
    claim("the relay holds while the service hears the board", lambda: relay_is("holds"))
    claim("the service with a relay drives", lambda: says("yahboomd", "standing"))

    relay_falls("plug out", lambda: unplug(0))
    plug(0)
    claim("plugged in again, the relay holds", lambda: relay_is("holds"))
    claim("and the service drives", lambda: says("yahboomd", "standing"))
    relay_falls("board hung", lambda: control("hang"))
    control("reset")
    claim("once the board is heard, the relay holds", lambda: relay_is("holds"))
    claim("and the service drives again", lambda: says("yahboomd", "standing"))
    relay_falls("guard killed, daemon frozen", freeze)
    claim("a new daemon's guard holds the relay", lambda: relay_is("holds"))
    claim("and that daemon drives", lambda: says("yahboomd", "standing"))

    dropin.unlink()
    sh("systemctl daemon-reload; systemctl restart yahboomd")
    unplug(3)
    claim("without a relay it drives as before", lambda: says("yahboomd", "standing"))


def main() -> None:
    sh("modprobe -a vhci-hcd cp210x")
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

    relay()

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
