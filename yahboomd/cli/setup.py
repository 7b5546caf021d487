"""``yahboomd setup``: finds out how the motors are connected, and writes ``robot.toml``."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from yahboomd.cli.shared_options import add_config_options, add_port_option, number, read_config
from yahboomd.core.errors import ConfigError, LinkError, Refused

if TYPE_CHECKING:
    from yahboomd.tools.setup.description import Given
    from yahboomd.tools.terminal.terminal_questions import Respondent

STANDARD_FILE = Path("robot.toml")

DESCRIPTION = """\
Find out how the motors are connected, and write the robot's configuration. With the wheels off the
ground each motor turns for a moment, and you answer which wheel it was and which way it went. If
no configuration can help, setup names the plug to change. The daemon must not run: the port
is taken, as `probe` does.
"""

EPILOG = """\
examples:
  yahboomd setup                               every question, and robot.toml at the end
  yahboomd setup --output /etc/yahboomd/config.toml
  yahboomd setup --profile 520 --kinematics differential --wheel-diameter 67 --wheel-separation 150
  yahboomd setup --by-hand                     no motor turns: you turn the wheels
  yahboomd simulate --link /tmp/board --plugs=3,-1     in one terminal, and in another one
  yahboomd setup --port /tmp/board             without a robot

exit status:
  0    the file is written
  1    refused (the emergency stop is engaged, an answer denied it); nothing was written
  69   no port, a held one, or no board
  75   the cable was out while a wheel turned; it was waited for, and the wheels were stopped
  77   no permission
  78   a mistake in the configuration, a board that cannot drive so, or the file cannot be written
  130  Ctrl-C; the wheels stand and nothing was written
"""

_length = number("a length from 1 to 5000 mm", lambda mm: 1 <= mm <= 5000)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--output",
        metavar="FILE",
        type=Path,
        default=STANDARD_FILE,
        help="the file to write (default: %(default)s)",
    )
    parser.add_argument(
        "--overwrite", action="store_true", help="replace the file without asking if it is there"
    )
    known = parser.add_argument_group("what you know already is not asked")
    known.add_argument("--profile", metavar="MOTORS", help="the motors, such as 520, or custom")
    known.add_argument(
        "--kinematics",
        metavar="DRIVE",
        help="differential, skid_steer, mecanum or ackermann",
    )
    for name, words in (
        ("diameter", "of the driven wheels"),
        ("separation", "from the middle of the left wheels to the middle of the right ones"),
        ("base", "from the front axle to the rear one, for mecanum and ackermann"),
    ):
        known.add_argument(f"--wheel-{name}", metavar="MM", type=_length, help=words)
    parser.add_argument(
        "--by-hand",
        action="store_true",
        help="turn no motor: you turn the wheels by hand. Boards that know speeds only need it",
    )
    parser.add_argument("--json", action="store_true", help="print the result as one line of JSON")
    add_port_option(parser)
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Set the robot up, by the answers of the person at the terminal."""
    import asyncio
    import signal

    from yahboomd.cli.attended import until_signal
    from yahboomd.core.clock import SystemClock
    from yahboomd.core.daemon.process import deadly
    from yahboomd.core.link.port_guard import PortGuard
    from yahboomd.tools.port import charge
    from yahboomd.tools.port.guarded import ended_by_stops
    from yahboomd.tools.port.own_port import opener_of, with_hints
    from yahboomd.tools.setup.outcome import next_steps, result
    from yahboomd.tools.setup.robot_file import as_toml, write_robot
    from yahboomd.tools.setup.setup_wizard import Wizard
    from yahboomd.tools.stop.port_search import find_port
    from yahboomd.tools.terminal.terminal_questions import Terminal

    config = read_config(args).config
    given = _given(args)
    path: Path = args.output
    there = os.path.lexists(path)
    port = ""

    async def work() -> int:
        clock, person, guard = SystemClock(), Terminal(), PortGuard(charge.start, renewed=False)
        opener = opener_of(port, config, clock, guard)
        wizard = Wizard(person, given, config, port=port, opener=opener, clock=clock)
        with contextlib.redirect_stdout(sys.stderr):
            overwrite = args.overwrite or (there and await may_overwrite(person, path))
            async with ended_by_stops(guard, "setup", port, os.environ, clock):
                found = await wizard.find(by_hand=args.by_hand)
        write_robot(
            path,
            as_toml(
                found.description, found.wiring, port=config.serial.port, gear=found.gear.words
            ),
            overwrite=overwrite,
        )
        print(result(found, path) if args.json else next_steps(found, path), flush=True)
        return 0

    try:
        port = find_port(config)
        return asyncio.run(until_signal(work(), (*deadly(), signal.SIGTSTP)))
    except LinkError as error:
        raise with_hints(error, port) from error


def _given(args: argparse.Namespace) -> Given:
    from yahboomd.core.config.hardware import CUSTOM
    from yahboomd.core.drive.kinematics import KINEMATICS
    from yahboomd.core.protocol.profiles import PROFILES
    from yahboomd.tools.setup.description import Given, possible

    for option, known in (("profile", (*PROFILES, CUSTOM)), ("kinematics", tuple(KINEMATICS))):
        value = getattr(args, option)
        if value is not None and value not in known:
            raise ConfigError(f"--{option} knows no {value!r}; there are {possible(known)}.")
    return Given(
        profile=args.profile,
        kinematics=args.kinematics,
        wheel_diameter_mm=args.wheel_diameter,
        wheel_separation_mm=args.wheel_separation,
        wheel_base_mm=args.wheel_base,
    )


async def may_overwrite(person: Respondent, path: Path) -> bool:
    """Whether a file that is there may be replaced; it is asked for before all the work.

    Raises:
        Refused: It may not.
    """
    from yahboomd.tools.terminal.terminal_questions import agrees

    if not await agrees(person, f"{path} is there already. Replace it in the end?"):
        raise Refused("Nothing was written.", remedy="Name another file: `--output FILE`.")
    return True
