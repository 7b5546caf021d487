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
from functools import partial
from pathlib import Path
from typing import TypeVar

import msgspec

from yahboomd.simulation.truth import TruthSample

T = TypeVar("T")

PYTHON = "/opt/yahboomd/bin/python3"
RULE = Path("/usr/lib/udev/rules.d/95-yahboomd.rules")
NAME = Path("/dev/yahboom_driver")
BY_PATH = Path("/dev/serial/by-path")
HEARD = Path("/run/heard")
PATIENCE_S = 60.0
ROUNDS = 5
"""How often each fault is tried for the relay."""

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


def seen(holds: Callable[[], T]) -> T | None:
    """Wait until it holds; None if it does not in time."""
    deadline = time.monotonic() + PATIENCE_S
    while not (what := holds()):
        if time.monotonic() > deadline:
            return None
        time.sleep(0.2)
    return what


def claim(words: str, holds: Callable[[], object]) -> None:
    if seen(holds):
        print(f"ok: {words}", flush=True)
    else:
        print(f"FAILED: {words}", flush=True)
        print(sh("systemctl status 'yahboomd*'; journalctl -k -o cat | tail"), flush=True)


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


def unplug(number: int) -> int:
    """Pull a plug; returns when, as every fault here does."""
    began_ns = time.monotonic_ns()
    Path("/sys/devices/platform/vhci_hcd.0/detach").write_text(str(number))
    # One that ended by itself counts as failed, and its name could not be used again.
    sh(f"systemctl stop plug{number}; systemctl reset-failed plug{number}")
    return began_ns


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


def truth() -> list[TruthSample]:
    """The newest samples of board 0: the file grows."""
    with Path("/run/board0.truth").open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - 200_000))
        lines = file.read().split(b"\n")[1:-1]
    return [msgspec.json.decode(line, type=TruthSample) for line in lines]


def fastest_m_s(sample: TruthSample) -> float:
    return max(map(abs, sample.speed_m_s))


def rows(*kinds: str) -> list[tuple[str, int]]:
    """What the relay's circuit printed of these kinds, and when."""
    said = (row.split() for row in Path("/run/relay").read_text().splitlines())
    return [(kind, int(t_ns)) for kind, t_ns in said if kind in kinds]


def relay_holds() -> bool:
    return rows("holds", "falls")[-1][0] == "holds"


def drives() -> bool:
    return relay_holds() and fastest_m_s(truth()[-1]) > 0.2


def fell_s(since_ns: int) -> float | None:
    after = (t_ns - since_ns for _, t_ns in rows("falls"))
    return next((took_ns / 1e9 for took_ns in after if took_ns > 0), None)


def stood_s(since_ns: int) -> float | None:
    after = (each.t_ns - since_ns for each in truth() if fastest_m_s(each) < 0.03)
    return next((took_ns / 1e9 for took_ns in after if took_ns > 0), None)


def relay_falls(fault: str, cause: Callable[[], int], heal: Callable[[], object]) -> None:
    """In motion, cause a fault, see the relay fall and the wheels stand, and drive again."""
    took: list[tuple[float | None, float | None]] = []
    while len(took) < ROUNDS and seen(drives):
        time.sleep(3.0)
        began_ns = cause()
        took.append((seen(partial(fell_s, began_ns)), seen(partial(stood_s, began_ns))))
        print(f"{fault}: {took[-1]}", flush=True)
        heal()
    good = [(fell, stood) for fell, stood in took if fell is not None and stood is not None]
    worst = [max(times, default=0.0) for times in zip(*good, strict=True)] or [0.0, 0.0]
    claim(
        f"{fault}: {len(good)} of {ROUNDS}, the relay fell after {worst[0]:.2f} s at most, and the "
        f"wheels stood after {worst[1]:.2f} s",
        lambda: len(good) == ROUNDS,
    )


def control(words: str) -> int:
    with socket.socket(socket.AF_UNIX) as console:
        console.connect("/run/board0.control")
        began_ns = time.monotonic_ns()
        console.sendall(words.encode() + b"\n")
        console.recv(100)
    return began_ns


def named_guard(comm: Path) -> bool:
    try:
        return comm.read_text().strip() == "yahboomd-guard"
    except OSError:
        return False


def kill_guard(frozen: str = "") -> int:
    """Kill the guard; a daemon that is frozen before can neither stop the wheels nor replace it."""
    guards = [each.parent for each in Path("/proc").glob("[0-9]*/comm") if named_guard(each)]
    if frozen:
        os.kill(int(frozen), signal.SIGSTOP)
    began_ns = time.monotonic_ns()
    for each in guards:
        os.kill(int(each.name), signal.SIGKILL)
    return began_ns


def relay() -> None:
    """Board 0 is there and driven by the service; its supply gets the relay."""
    before = set(Path("/dev").glob("gpiochip*"))
    chip = f"{PYTHON} /root/usbip_relay.py 3 /run/board0.control"
    sh(f"systemd-run --unit=relay --property=StandardOutput=file:/run/relay {chip}")
    claim("the relay's chip is there", lambda: set(Path("/dev").glob("gpiochip*")) - before)
    (line,) = set(Path("/dev").glob("gpiochip*")) - before
    sh(f"groupadd gpio; chgrp gpio {line}; chmod 660 {line}")
    claim("without the guard the relay has fallen", lambda: not relay_holds())
    dropin = Path("/run/systemd/system/yahboomd.service.d/relay.conf")
    dropin.parent.mkdir(parents=True, exist_ok=True)
    dropin.write_text(RELAY.format(chip=line))
    sh("systemctl daemon-reload; systemctl restart yahboomd")
    claim("the relay holds while the service hears the board", relay_holds)
    claim("the service with a relay drives", lambda: says("yahboomd", "standing"))

    sh("systemd-run --unit=driver -p Restart=always yahboomd send --vx 0.3 --for 3000")
    relay_falls("plug out in motion", partial(unplug, 0), partial(plug, 0))
    relay_falls("board mute, it hears no stop", partial(control, "hang"), partial(control, "reset"))
    relay_falls("guard killed", kill_guard, lambda: None)
    # The watchdog ends the daemon.
    relay_falls(
        "guard killed, daemon frozen",
        lambda: kill_guard(show("yahboomd", "MainPID")),
        lambda: None,
    )
    sh("systemctl stop driver")

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
