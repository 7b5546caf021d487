"""`make run`: the daemon on a real port, or on a simulated board that lives as long as it does."""

from __future__ import annotations

import argparse
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PATIENCE_S = 15.0

HINT = """\
Now, in a second terminal, in this folder ({folder}):
  .venv/bin/yahboomd drive{options}      drive it with the keyboard
  .venv/bin/yahboomd monitor{options}    watch it
Ctrl-C ends it here.

"""


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="make run", description=__doc__, usage="make run [PORT=/dev/...] [ARGS='...']"
    )
    parser.add_argument("--port", help="the board's serial port; without it, one is simulated")
    args, more = parser.parse_known_args()
    if args.port:
        return _drive(args.port, more)
    with tempfile.TemporaryDirectory(prefix="yahboomd-") as folder:
        link = Path(folder) / "board"
        with subprocess.Popen(
            [*_yahboomd(), "simulate", "--link", str(link)],
            stdout=subprocess.DEVNULL,
            # A Ctrl-C is the daemon's: the board has to be there still when it stops the wheels.
            start_new_session=True,
        ) as board:
            try:
                deadline = time.monotonic() + PATIENCE_S
                while not link.exists():
                    if board.poll() is not None or time.monotonic() > deadline:
                        sys.stderr.write("yahboomd: the simulated board did not start.\n")
                        return 1
                    time.sleep(0.05)
                sys.stdout.write(f"A simulated board is at {link}, and yahboomd starts on it.\n")
                return _drive(str(link), more)
            except KeyboardInterrupt:
                return 128 + signal.SIGINT
            finally:
                board.terminate()


def _drive(port: str, more: list[str]) -> int:
    """Run the daemon. Whoever looks for it needs the options that say where it is."""
    options = "".join(f" {shlex.quote(word)}" for word in more)
    sys.stdout.write(HINT.format(folder=Path.cwd(), options=options))
    sys.stdout.flush()
    daemon = subprocess.Popen([*_yahboomd(), "run", "--port", port, *more])
    signal.signal(signal.SIGTERM, lambda *_: daemon.terminate())
    while True:
        try:
            return daemon.wait()
        except KeyboardInterrupt:
            # It reached the daemon as well, which stops the wheels first.
            continue


def _yahboomd() -> list[str]:
    return [sys.executable, "-m", "yahboomd"]


if __name__ == "__main__":
    os.chdir(Path(__file__).resolve().parent.parent)
    sys.exit(main())
