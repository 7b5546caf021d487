"""``yahboomd calibrate``: finds the true size of wheels and track by tape or squares."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import signal
import sys
from typing import TYPE_CHECKING

from yahboomd.cli.shared_options import add_source_option, number, source_of
from yahboomd.core.bus.keys import CMD_VEL
from yahboomd.core.errors import ConfigError, YahboomdError
from yahboomd.tools.calibrate.choices import CALIBRATIONS, fields_of

if TYPE_CHECKING:
    from yahboomd.client import AsyncRobot
    from yahboomd.core.config import Loaded

DESCRIPTION = """\
Find the true size of the wheels and of the track, and write it to the calibration file, which goes
over the multipliers of [chassis]. The robot drives known shapes while the daemon runs; you enter
its true end positions. It moves only while this command runs, within the bounds that it announces;
Ctrl-C stops it. A result that cannot be trusted is not written, and the reason is printed.
"""

EPILOG = """\
examples:
  yahboomd calibrate tape                    a straight of 2 m and 5 turns in place: ten minutes
  yahboomd calibrate squares --side 2        five squares each way, then a straight: the best
  yahboomd calibrate squares --dry-run       print the result, write nothing
  yahboomd calibrate imu                     turn it by hand: axes and scale of the sensor
  yahboomd calibrate tape --dialogue json --held     led by a program, such as a page
  yahboomd calibrate undo                    the calibration before counts again
  yahboomd config check                      which value comes from where

exit status:
  0    written, or printed with --dry-run
  1    the result cannot be trusted, or the robot does not obey; nothing was written
  69   no daemon is there, or it was lost
  78   a mistake in the configuration, or the file cannot be written
  130  Ctrl-C; the robot was stopped and nothing was written
"""

_positive = number("a number above 0", lambda value: value > 0.0)
_whole = number("a whole number from 1 to 50", lambda n: n in range(1, 51))


def _count(text: str) -> int:
    return int(_whole(text))


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs."""
    from yahboomd.cli.attended import add_robot_options
    from yahboomd.cli.shared_options import add_config_options

    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    tape = verbs.add_parser(
        "tape",
        help="a straight and turns in place: size of the wheels, and track",
        description="A straight between two marks gives the size of the wheels, turns in place on "
        "a mark give the track. A mecanum base also goes to either side, which gives the slip of "
        "its rollers.",
    )
    squares = verbs.add_parser(
        "squares",
        help="squares in both directions and a straight: the ratio of the wheels too",
        description="Squares in both directions, then a straight. Fitted jointly over all counts.",
    )
    for verb, each in (("tape", tape), ("squares", squares)):
        _add_choices(each, verb)
        _add_json_option(each)
        add_source_option(each, "cmd_vel")
        _add_dialogue_option(each)
        each.add_argument(
            "--held",
            action="store_true",
            help="with --dialogue: it moves only while lines report that a button is held",
        )
        add_robot_options(each)
    imu = verbs.add_parser(
        "imu",
        help="turns by hand: how the inertial sensor is mounted, and its gyro's scale",
        description="You turn the robot by hand. Prints the section [imu] of the configuration; "
        "drives nothing and writes nothing.",
    )
    _add_choices(imu, "imu")
    _add_dialogue_option(imu)
    add_robot_options(imu)
    undo = verbs.add_parser(
        "undo",
        help="take the newest calibration back",
        description="Take the newest calibration back; the one before it counts again.",
    )
    add_config_options(undo)


def _add_choices(parser: argparse.ArgumentParser, verb: str) -> None:
    """Add an option for each choice of a calibration."""
    for name, each in fields_of(CALIBRATIONS[verb]).items():
        if each["type"] == "boolean":
            parser.add_argument(f"--{name}", action="store_true", help=each["description"])
            continue
        parser.add_argument(
            f"--{name}",
            metavar="N",
            type=_count if each["type"] == "integer" else _positive,
            default=each["default"],
            help=f"{each['description']} (default: %(default)s)",
        )


def _add_json_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print the result as one line of JSON")


def _add_dialogue_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--dialogue",
        choices=("json",),
        help="ask a program: lines of JSON on standard output, its answers on standard input "
        "(docs/calibration.md)",
    )


def run(args: argparse.Namespace) -> int:
    """Carry out one verb."""
    try:
        return _run(args)
    except YahboomdError as error:
        if getattr(args, "dialogue", None):
            from yahboomd.tools.calibrate.dialogue import write_refused

            write_refused(error)
        raise


def _run(args: argparse.Namespace) -> int:
    from yahboomd.cli.shared_options import read_config
    from yahboomd.tools.calibrate import calibration

    loaded = read_config(args)
    if args.verb == "undo":
        print(calibration.undo(loaded))
        return 0
    return _with_person(args, loaded)


def _with_person(args: argparse.Namespace, loaded: Loaded) -> int:
    from yahboomd.cli.attended import attend
    from yahboomd.core.clock import SystemClock
    from yahboomd.core.daemon.process import deadly
    from yahboomd.tools.calibrate.calibration import calibrate, ended
    from yahboomd.tools.calibrate.dialogue import Dialogue, lead_by_lines, write_line
    from yahboomd.tools.calibrate.hold import HeldButton
    from yahboomd.tools.terminal.asking import Answers

    kind = CALIBRATIONS[args.verb]
    fields = zip(kind.__struct_fields__, kind.__struct_encode_fields__, strict=True)
    choices = kind(**{field: getattr(args, name.replace("-", "_")) for field, name in fields})
    drives = args.verb != "imu"
    if drives and args.held and not args.dialogue:
        raise ConfigError("--held needs --dialogue json: the button is that of a program.")
    source = source_of(args, loaded.config, CMD_VEL) if drives else CMD_VEL

    async def work(robot: AsyncRobot) -> int:
        try:
            await lead(robot)
        except asyncio.CancelledError:
            words = await ended(robot, choices)
            # The terminal may be gone.
            with contextlib.suppress(OSError):
                print(words, file=sys.stderr)
            raise
        return 0

    async def lead(robot: AsyncRobot) -> None:
        if not args.dialogue:
            person = Answers(as_json=drives and args.json)
            await calibrate(robot, loaded, choices, person, source=source)
            return
        clock = SystemClock()
        hold = HeldButton(clock, robot.stop) if drives and args.held else None
        dialogue = Dialogue(write_line, clock, hold)
        asking = calibrate(robot, loaded, choices, dialogue, hold, source=source)
        await lead_by_lines(dialogue, asking)

    return attend(args, work, source=source, signals=(*deadly(), signal.SIGTSTP))
