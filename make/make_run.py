"""`make run`: the daemon on a real port, or on a simulated board that ends with it."""

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

WORD_EVERY_S = 5.0
"""While a slow computer starts the board or the daemon."""

PASSED_ON = (signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2)
"""Passed on to the daemon, which stops the wheels and ends; then this and the board end."""

PAGE = "127.0.0.1:8480"
PAGE_FOR_PHONES = "0.0.0.0:8480"

HINT = """\

Now, in a second terminal, in this folder ({folder}):
  .venv/bin/yahboomd drive{options}      drive it with the keyboard
  .venv/bin/yahboomd move straight 1{options}    drive a metre; turn 90deg turns it
  .venv/bin/yahboomd monitor{options}    watch it
Ctrl-C ends it here.

"""


def main() -> int:
    from yahboomd.cli.shared_options import add_config_options, daemon_endpoints, read_config
    from yahboomd.core.errors import ConfigError
    from yahboomd.core.program import pasteable, readable

    parser = argparse.ArgumentParser(
        prog="make run", description=__doc__, usage="make run [PORT=/dev/...] [ARGS='...']"
    )
    parser.add_argument("--port", help="the board's serial port; without it, one is simulated")
    parser.add_argument(
        "--listen",
        metavar="ADDRESS:PORT",
        nargs="?",
        default=PAGE,
        const=PAGE_FOR_PHONES,
        help="serve the page to phones, too; prints the link and a QR code",
    )
    args, more = parser.parse_known_args()
    shared = argparse.ArgumentParser(add_help=False)
    add_config_options(shared)
    shared.add_argument("--namespace")
    options, _ = shared.parse_known_args(more)
    try:
        config = read_config(options).config
    except ConfigError as error:
        sys.stderr.write(f"yahboomd: {pasteable(readable(str(error)))}\n")
        return error.exit_code
    endpoints = daemon_endpoints(options, config)
    if (taken := _taken(args.listen)) is not None:
        sys.stderr.write(f"yahboomd: {taken}\n")
        return os.EX_UNAVAILABLE
    # Until the daemon is there, a signal ends everything that was started.
    for number in PASSED_ON:
        signal.signal(number, lambda number, _: sys.exit(128 + number))
    if args.port:
        return _drive(args.port, more, endpoints, args.listen)
    with tempfile.TemporaryDirectory(prefix="yahboomd-") as folder:
        link = Path(folder) / "board"
        with subprocess.Popen(
            [*_yahboomd(), "simulate", "--link", str(link), *_robot(options, link)],
            stdout=subprocess.DEVNULL,
            # Ctrl-C must reach only the daemon: the board must live until the wheels are stopped.
            start_new_session=True,
        ) as board:
            try:
                starts = Starting("the simulated board", time.monotonic())
                while not link.exists():
                    if board.poll() is not None:
                        sys.stderr.write("yahboomd: the simulated board did not start.\n")
                        return 1
                    starts.wait_on(time.monotonic())
                    time.sleep(0.05)
                sys.stdout.write(f"A simulated board is at {link}, and yahboomd starts on it.\n")
                # A simulated robot's e-stop and wheels end with it, so a guard would only report
                # that they may turn.
                own = ("--no-guard", "--set", f"estop.latch_file={Path(folder) / 'estop'}")
                return _drive(str(link), more, endpoints, args.listen, own)
            except KeyboardInterrupt:
                return 128 + signal.SIGINT
            finally:
                board.terminate()


def _taken(listen: str) -> str | None:
    """Why the page cannot be served there, in a sentence for `make`."""
    from yahboomd.core.errors import ListenError
    from yahboomd.tools.metrics.http_listener import Place
    from yahboomd.web.web_server import listen as listen_at

    if (place := Place.of(listen)) is None:
        # The page's own command names the mistake.
        return None
    try:
        listen_at(place.host, place.port).close()
    except ListenError as error:
        other = f"{listen.rpartition(':')[0]}:{place.port + 1}"
        return f"{error.message} Choose another port: make run ARGS='--listen {other}'"
    return None


def _robot(options: argparse.Namespace, link: Path) -> list[str]:
    """Options of `simulate` that give the board the daemon's motors and chassis."""
    words = ["--config", str(options.config)] if options.config else []
    sets = (*options.overrides, f"serial.port={link}")
    return [*words, *(word for each in sets for word in ("--set", each))]


def _drive(
    port: str,
    more: list[str],
    endpoints: tuple[str, ...],
    listen: str,
    own: tuple[str, ...] = (),
) -> int:
    """Run the daemon; once it listens start the page and the moves, and print how to drive.

    Args:
        port: The board's port.
        more: Options of the daemon; other commands need them too, to reach it.
        endpoints: The daemon's endpoints.
        listen: The address of the page.
        own: Further options of the daemon.
    """
    from yahboomd.core.names import host_and_port, is_local
    from yahboomd.tools.stop.unresponsive import listener

    # A Unix socket, or a client without one, does not show who listens.
    shows = any(host_and_port(each) and is_local(each) for each in endpoints)
    daemon = subprocess.Popen([*_yahboomd(), "run", "--port", port, *own, *more])
    for number in PASSED_ON:
        signal.signal(number, lambda number, _: daemon.send_signal(number))
    starts = Starting("yahboomd", time.monotonic())
    invited = False
    children: list[subprocess.Popen[bytes]] = []
    while True:
        try:
            if not invited and shows and listener(endpoints) != daemon.pid:
                starts.wait_on(time.monotonic())
            elif not invited:
                invited = True
                options = "".join(f" {shlex.quote(word)}" for word in more)
                sys.stdout.write(HINT.format(folder=Path.cwd(), options=options))
                sys.stdout.flush()
                children.append(subprocess.Popen([*_yahboomd(), "web", "--listen", listen, *more]))
                # Quiet: what it reports, the page's server reports too.
                moves = [*_yahboomd(), "moves", *more]
                children.append(subprocess.Popen(moves, stdout=subprocess.DEVNULL))
            status = daemon.wait(None if invited else 0.05)
            for child in children:
                child.terminate()
            for child in children:
                child.wait()
            return status if status >= 0 else 128 - status
        except subprocess.TimeoutExpired:
            continue
        except KeyboardInterrupt:
            # The signal also reached the daemon, which stops the wheels first.
            continue


class Starting:
    """Prints a line every few seconds while something starts.

    Args:
        name: Its name, as the beginning of a sentence.
        now_s: The time, as of the other calls.
    """

    def __init__(self, name: str, now_s: float) -> None:
        self._name = name
        self._began_s = self._last_s = now_s

    def wait_on(self, now_s: float) -> None:
        """Go on waiting."""
        if now_s - self._last_s < WORD_EVERY_S:
            return
        self._last_s = now_s
        sys.stdout.write(
            f"{self._name} starts, for {now_s - self._began_s:.0f} s so far; Ctrl-C ends it.\n"
        )
        sys.stdout.flush()


def _yahboomd() -> list[str]:
    return [sys.executable, "-m", "yahboomd"]


if __name__ == "__main__":
    os.chdir(Path(__file__).resolve().parent.parent)
    sys.exit(main())
