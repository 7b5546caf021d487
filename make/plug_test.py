"""`make plug-test`: plugs a board in, on a real kernel with a real udev.

An emulated PC (qemu, without need of virtualisation) boots Debian with Debian's kernel, with the
package installed. Inside, tests/system/plug/check.py puts simulated CH340 chips on virtual USB
sockets; the kernel's ch341 driver, udev and systemd do the rest. Takes some five minutes.

It uses the Debian and the package of `make system-test`.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import system_test
from system_test import TREE, Impossible

PATIENCE_S = 1800
TOOLS = {"qemu-system-x86_64": "qemu-system-x86", "mke2fs": "e2fsprogs"}

SETUP = r"""
set -e
dpkg -i /run/packages/*.deb
cat > /usr/lib/udev/rules.d/85-brltty.rules <<'R'
ACTION!="add", GOTO="end"
SUBSYSTEM!="usb", GOTO="end"
ENV{PRODUCT}=="1a86/7523/*", ENV{SYSTEMD_WANTS}+="brltty-stand-in.service", TAG+="systemd"
LABEL="end"
R
cat > /etc/systemd/system/brltty-stand-in.service <<'R'
[Service]
ExecStart=/bin/sleep infinity
R
cat > /etc/systemd/system/plug-check.service <<'R'
[Service]
Type=exec
ExecStart=/opt/yahboomd/bin/python3 /root/check.py
StandardOutput=file:/dev/ttyS0
StandardError=file:/dev/ttyS0
[Install]
WantedBy=multi-user.target
R
systemctl enable plug-check.service
systemctl mask getty@tty1 serial-getty@ttyS0
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--suite", default="bookworm", help="the Debian release to boot")
    args = parser.parse_args()
    system_test.NEEDED.update(TOOLS)
    try:
        cache = system_test.prepare_cache()
        system_test.install_tools()
        root = system_test.make_root(cache, args.suite)
        package = system_test.build_package(TREE, cache / f"packages-{root.name}", root)
        bootable = with_packages(cache, root, "kernel", "initramfs-tools linux-image-amd64")
    except Impossible as why:
        sys.stderr.write(f"plug-test: not run: {why}\n")
        return 1
    with tempfile.TemporaryDirectory(dir=cache, prefix=".plug-") as folder:
        here = TREE / "tests/system/plug"
        said = boot(
            *(Path(folder), bootable, package, SETUP),
            [here / name for name in ("usbip_ch340.py", "usbip_relay.py", "check.py")],
            ["qemu-system-x86_64", "-M", "q35"],
            "ttyS0",
        )
    return judge(said)


def judge(said: str) -> int:
    """Print the claims, or all that the console said if they do not all hold."""
    claims = [line for line in said.splitlines() if line.startswith(("ok:", "FAILED:"))]
    good = bool(claims) and all(line.startswith("ok:") for line in claims) and "\nend" in said
    print("\n".join(claims) if good else said)
    print(f"{len(claims)} claims, {'all hold' if good else 'NOT all hold'}")
    return 0 if good else 1


def with_packages(cache: Path, root: Path, name: str, packages: str) -> Path:
    """A copy of a Debian with more packages, such as a kernel; made once.

    Args:
        name: The end of the copy's name.
    """
    made = cache / f"{root.name}-{name}"
    if not made.exists():
        print(f"installing {packages} into {made} (a minute, once)", flush=True)
        half = cache / f".{made.name}"
        shutil.rmtree(half, ignore_errors=True)
        subprocess.check_call(["cp", "-a", str(root), str(half)])
        install = "apt-get install -y -qq --no-install-recommends"
        command = f"apt-get update -qq && {install} {packages}"
        if _inside(half, f"export DEBIAN_FRONTEND=noninteractive; {command}") != 0:
            raise Impossible(f"{packages} could not be installed; see above.")
        half.rename(made)
    return made


def boot(
    folder: Path,
    bootable: Path,
    package: Path,
    setup: str,
    files: list[Path],
    computer: list[str],
    console: str,
) -> str:
    """Boot a copy of a Debian with the package in it; the words of its console.

    Args:
        folder: For the copy.
        bootable: The Debian, with a kernel.
        package: Installed from /run/packages by ``setup``.
        setup: A shell script that prepares the copy.
        files: Copied to /root.
        computer: The emulator's command, and which computer it is to be.
        console: The name of its serial port.
    """
    root = folder / "root"
    subprocess.check_call(["cp", "-a", str(bootable), str(root)])
    for file in files:
        shutil.copy(file, root / "root" / file.name)
    (root / "root/setup.sh").write_text(setup)
    if _inside(root, "sh /root/setup.sh", f"--bind-ro={package.parent}:/run/packages") != 0:
        raise SystemExit("the package could not be installed; see above.")
    image, words = folder / "disk", folder / "console"
    with image.open("wb") as disk:
        disk.truncate(2 * 2**30)
    subprocess.check_call(["mke2fs", "-q", "-t", "ext4", "-d", str(root), str(image)])
    kernel = next((root / "boot").glob("vmlinuz-*"))
    initrd = next((root / "boot").glob("initrd.img-*"))
    print("booting (some minutes)", flush=True)
    emulator = subprocess.Popen(
        [
            *(*computer, "-m", "1024", "-smp", "2", "-nic", "none"),
            *("-no-reboot", "-display", "none", "-monitor", "none", "-serial", f"file:{words}"),
            *("-kernel", str(kernel), "-initrd", str(initrd)),
            *("-append", f"root=/dev/vda rw console={console} quiet loglevel=3"),
            *("-drive", f"file={image},if=virtio,format=raw"),
        ],
        stdin=subprocess.DEVNULL,
    )
    try:
        emulator.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        print(f"after {PATIENCE_S / 60:.0f} minutes it was switched off", flush=True)
    finally:
        emulator.kill()
        emulator.wait()
    return words.read_text(errors="replace").replace("\r", "")


def _inside(root: Path, words: str, *options: str) -> int:
    return subprocess.call(
        [
            *("systemd-nspawn", "--quiet", "-D", str(root), "--register=no", "--keep-unit"),
            *("--pipe", "--resolv-conf=copy-host", *options, "sh", "-c", words),
        ],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    )


if __name__ == "__main__":
    sys.exit(main())
