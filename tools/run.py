"""`make run`: the daemon on a real port, or on a simulated board that lives as long as it does."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PATIENCE_S = 15.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", help="the board's serial port; without it, one is simulated")
    args, more = parser.parse_known_args()
    yahboomd = [sys.executable, "-m", "yahboomd"]
    if args.port:
        return _end_of(subprocess.Popen([*yahboomd, "run", "--port", args.port, *more]))
    with tempfile.TemporaryDirectory(prefix="yahboomd-") as folder:
        link = Path(folder) / "board"
        with subprocess.Popen([*yahboomd, "simulate", "--link", str(link)]) as board:
            try:
                deadline = time.monotonic() + PATIENCE_S
                while not link.exists():
                    if board.poll() is not None or time.monotonic() > deadline:
                        sys.stderr.write("yahboomd: the simulated board did not start.\n")
                        return 1
                    time.sleep(0.05)
                sys.stdout.write(
                    "\nNow, in a second terminal:\n"
                    "  .venv/bin/yahboomd monitor    watch the robot\n"
                    "  .venv/bin/yahboomd drive      drive it with the keyboard\n\n"
                )
                sys.stdout.flush()
                return _end_of(subprocess.Popen([*yahboomd, "run", "--port", str(link), *more]))
            finally:
                board.terminate()


def _end_of(daemon: subprocess.Popen[bytes]) -> int:
    """Wait for the daemon: a Ctrl-C reaches it as well, and it stops the wheels first."""
    signal.signal(signal.SIGTERM, lambda *_: daemon.terminate())
    while True:
        try:
            return daemon.wait()
        except KeyboardInterrupt:
            continue


if __name__ == "__main__":
    os.chdir(Path(__file__).resolve().parent.parent)
    sys.exit(main())
