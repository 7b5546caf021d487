"""`make arm`: the package on 64-bit ARM, in an emulated computer with its own kernel and systemd.

Builds the arm64 package on this processor, installs it into an arm64 Debian, and boots that in an
emulated computer (qemu). Inside, tests/system/arm/arm_check.py drives the simulated board. Takes a
quarter of an hour the first time. Needs root and the kernel's binfmt_misc. It is emulation: times
are those of no Raspberry Pi.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import plug_test
import system_test
from system_test import TREE, Impossible

TOOLS = {
    "qemu-system-aarch64": "qemu-system-arm",
    "qemu-aarch64-static": "qemu-user-static",
    "mke2fs": "e2fsprogs",
}
BINFMT = Path("/proc/sys/fs/binfmt_misc")

SETUP = r"""
set -e
dpkg -i /run/packages/*.deb
cat > /etc/systemd/system/arm-check.service <<'R'
[Unit]
After=multi-user.target
[Service]
Type=exec
ExecStart=/opt/yahboomd/bin/python3 /root/arm_check.py
StandardOutput=file:/dev/ttyAMA0
StandardError=file:/dev/ttyAMA0
[Install]
WantedBy=multi-user.target
R
systemctl enable arm-check.service
systemctl mask getty@tty1 serial-getty@ttyAMA0
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--suite", default="bookworm", help="the Debian release")
    args = parser.parse_args()
    system_test.NEEDED.update(TOOLS)
    try:
        cache = system_test.prepare_cache() / "arm64"
        cache.mkdir(exist_ok=True)
        system_test.install_tools()
        run_foreign_programs()
        root = system_test.make_root(cache, args.suite, "--arch=arm64")
        # Built on the same release of Debian, by this processor.
        own = system_test.make_root(cache.parent, args.suite)
        output = cache / f"packages-{args.suite}"
        package = system_test.build_package(TREE, output, own, "--architecture=arm64")
        kernel = "initramfs-tools linux-image-cloud-arm64"
        bootable = plug_test.with_packages(cache, root, "kernel", kernel)
    except Impossible as why:
        sys.stderr.write(f"arm: not run: {why}\n")
        return 1
    with tempfile.TemporaryDirectory(dir=cache, prefix=".arm-") as folder:
        said = plug_test.boot(
            *(Path(folder), bootable, package, SETUP),
            [TREE / "tests/system/arm/arm_check.py"],
            ["qemu-system-aarch64", "-M", "virt", "-cpu", "cortex-a72"],
            "ttyAMA0",
        )
    print("\n".join(line for line in said.splitlines() if line.startswith("figure:")))
    return plug_test.judge(said)


def run_foreign_programs() -> None:
    """Let the kernel start arm64 programs with qemu."""
    if (BINFMT / "qemu-aarch64").exists():
        return
    if not (BINFMT / "register").exists():
        subprocess.call(["mount", "-t", "binfmt_misc", "binfmt_misc", str(BINFMT)])
    try:
        rule = Path("/usr/lib/binfmt.d/qemu-aarch64.conf").read_text()
        (BINFMT / "register").write_text(rule)
    except OSError as error:
        raise Impossible(f"the kernel does not start arm64 programs: {error}.") from None


if __name__ == "__main__":
    sys.exit(main())
