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

PATIENCE_S = 1200
KERNEL = "linux-image-amd64 initramfs-tools"
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
        package = system_test.build_package(cache, root)
        bootable = _with_kernel(cache, root)
    except Impossible as why:
        sys.stderr.write(f"plug-test: not run: {why}\n")
        return 1
    with tempfile.TemporaryDirectory(dir=cache, prefix=".plug-") as folder:
        said = _boot(Path(folder), bootable, package)
    claims = [line for line in said.splitlines() if line.startswith(("ok:", "FAILED:"))]
    good = bool(claims) and all(line.startswith("ok:") for line in claims) and "\nend" in said
    print("\n".join(claims) if good else said)
    print(f"plug-test: {len(claims)} claims, {'all hold' if good else 'NOT all hold'}")
    return 0 if good else 1


def _with_kernel(cache: Path, root: Path) -> Path:
    """A copy of the Debian, with a kernel; made once."""
    bootable = cache / f"{root.name}-kernel"
    if not bootable.exists():
        print(f"plug-test: installing a kernel into {bootable} (a minute, once)", flush=True)
        half = cache / f".{root.name}-kernel"
        shutil.rmtree(half, ignore_errors=True)
        subprocess.check_call(["cp", "-a", str(root), str(half)])
        command = f"apt-get update -qq && apt-get install -y -qq --no-install-recommends {KERNEL}"
        if _inside(half, f"export DEBIAN_FRONTEND=noninteractive; {command}") != 0:
            raise Impossible("the kernel could not be installed; see above.")
        half.rename(bootable)
    return bootable


def _boot(folder: Path, bootable: Path, package: Path) -> str:
    """Boot a copy, and return its console output."""
    root = folder / "root"
    subprocess.check_call(["cp", "-a", str(bootable), str(root)])
    for name in ("usbip_ch340.py", "check.py"):
        shutil.copy(TREE / "tests/system/plug" / name, root / "root" / name)
    (root / "root/setup.sh").write_text(SETUP)
    if _inside(root, "sh /root/setup.sh", f"--bind-ro={package.parent}:/run/packages") != 0:
        raise SystemExit("plug-test: the package could not be installed; see above.")
    image, console = folder / "disk", folder / "console"
    with image.open("wb") as disk:
        disk.truncate(2 * 2**30)
    subprocess.check_call(["mke2fs", "-q", "-t", "ext4", "-d", str(root), str(image)])
    kernel = next((root / "boot").glob("vmlinuz-*"))
    initrd = next((root / "boot").glob("initrd.img-*"))
    print("plug-test: booting (some minutes)", flush=True)
    subprocess.run(
        [
            *("qemu-system-x86_64", "-M", "q35", "-m", "1024", "-smp", "2", "-nic", "none"),
            *("-no-reboot", "-display", "none", "-monitor", "none", "-serial", f"file:{console}"),
            *("-kernel", str(kernel), "-initrd", str(initrd)),
            *("-append", "root=/dev/vda rw console=ttyS0 quiet loglevel=3"),
            *("-drive", f"file={image},if=virtio,format=raw"),
        ],
        stdin=subprocess.DEVNULL,
        timeout=PATIENCE_S,
        check=False,
    )
    return console.read_text(errors="replace").replace("\r", "")


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
