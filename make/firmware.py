"""`make firmware`: tests on the vendors' own firmwares, which are no part of this project.

The files are in the folder that YAHBOOMD_FIRMWARE names, else in ../shared/firmware. Without them
no test runs, and the last line reports it.
"""

from __future__ import annotations

import importlib.util
import os
import random
import subprocess
import sys
from pathlib import Path

TREE = Path(__file__).resolve().parent.parent
FOLDER = Path(os.environ.get("YAHBOOMD_FIRMWARE") or TREE.parent / "shared/firmware")
CACHE = Path(
    os.environ.get("YAHBOOMD_CACHE")
    or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "yahboomd"
)
WHERE = "docs/protocol.md names the place of the vendor's files"


def main() -> int:
    build = FOLDER / "rosmaster/build.sh"
    if not build.exists():
        print(f"firmware: NOT tried: there is no {build}; {WHERE}.")
        return 0
    target = CACHE / "firmware"
    target.mkdir(parents=True, exist_ok=True)
    if not (target / "librosfw.so").exists() and subprocess.call(["sh", build, target]) != 0:
        print("firmware: NOT tried: the Rosmaster firmware was not compiled (see above; gcc?).")
        return 0
    image = FOLDER / "four_channel/FourWay_Motor_STM32.hex"
    lacking = "" if image.exists() else f"there is no {image}; {WHERE}"
    if importlib.util.find_spec("unicorn") is None:
        lacking = "unicorn, the emulator, is not installed here"
    lanes = str(os.cpu_count() or 1)
    call = [sys.executable, "-m", "pytest", "tests/firmware", "-q", "-n", lanes, *sys.argv[1:]]
    if os.environ.get("YAHBOOMD_FIRMWARE_LONG"):
        # Here, since each lane of pytest would draw its own.
        os.environ.setdefault("YAHBOOMD_SEED", str(random.randrange(10_000, 1_000_000)))
        print(f"YAHBOOMD_SEED={os.environ['YAHBOOMD_SEED']} repeats the commands.")
    ended = subprocess.call(call, cwd=TREE)
    if ended:
        print("firmware: tried, and FAILED")
    elif lacking:
        print(f"firmware: NOT tried on the four-channel board: {lacking}.")
    else:
        print("firmware: tried")
    return ended


if __name__ == "__main__":
    sys.exit(main())
