"""``yahboomd calibrate``: finds the true size of wheels and track by tape, squares or a sensor."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from yahboomd.cli.shared_options import add_source_option, check_source, number
from yahboomd.core.errors import ConfigError, Refused, YahboomdError

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
  yahboomd calibrate tape --by-hand          you push the robot; it drives nothing
  yahboomd calibrate squares --dry-run       print the result, write nothing
  yahboomd calibrate poses run1 --frames map laser
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

RUNS = {
    "method": "verb",
    "straight_m": "straight",
    "speed_m_s": "speed",
    "turn_rad_s": "turn_speed",
    "turns": "turns",
    "sideways_m": "sideways",
    "side_m": "side",
    "count": "count",
    "by_hand": "by_hand",
    "dry_run": "dry_run",
    "source": "source",
}
"""The option for each field of ``RunOptions``."""

_positive = number("a number above 0", lambda value: math.isfinite(value) and value > 0.0)
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
    _add_size(tape, "turns", "N", 5, "turns in place each way")
    _add_size(tape, "sideways", "M", 1.0, "of a mecanum base: way to the left, then to the right")
    _add_size(squares, "side", "M", 2.0, "of a square")
    _add_size(squares, "count", "N", 5, "squares each way")
    for each, metres in ((tape, 2.0), (squares, 5.0)):
        _add_size(each, "straight", "M", metres, "length of the straight run, metres")
        _add_size(each, "speed", "M_PER_S", 0.2)
        _add_size(each, "turn-speed", "RAD_PER_S", 0.8)
        each.add_argument(
            "--by-hand",
            action="store_true",
            help="drive nothing: you push the robot, or drive it from elsewhere",
        )
        _add_result_options(each)
        add_source_option(each, "cmd_vel")
        _add_dialogue_option(each)
        each.add_argument(
            "--held",
            action="store_true",
            help="with --dialogue: it moves only while lines report that a button is held",
        )
        add_robot_options(each)
    poses = verbs.add_parser(
        "poses",
        help="against another sensor's poses in a recording: no tape at all",
        description="Against the poses of another sensor, such as SLAM or motion capture, in a "
        "recording with the joint states. The place of the sensor on the robot is found too.",
    )
    poses.add_argument(
        "bags", metavar="BAG", nargs="+", type=Path, help="folder of a bag, such as record makes"
    )
    poses.add_argument("--topic", default="/tf", help="of the poses (default: %(default)s)")
    poses.add_argument(
        "--frames",
        metavar=("PARENT", "CHILD"),
        nargs=2,
        help="of the transform, if the topic carries transforms, such as map laser",
    )
    _add_result_options(poses)
    add_config_options(poses)
    imu = verbs.add_parser(
        "imu",
        help="turns by hand: how the inertial sensor is mounted, and its gyro's scale",
        description="You turn the robot by hand. Prints the section [imu] of the configuration; "
        "drives nothing and writes nothing.",
    )
    _add_size(imu, "turns", "N", 5, "to the left")
    _add_dialogue_option(imu)
    add_robot_options(imu)
    undo = verbs.add_parser(
        "undo",
        help="take the newest calibration back",
        description="Take the newest calibration back; the one before it counts again.",
    )
    add_config_options(undo)


def _add_size(
    parser: argparse.ArgumentParser, name: str, metavar: str, default: float, words: str = ""
) -> None:
    parser.add_argument(
        f"--{name}",
        metavar=metavar,
        type=_count if metavar == "N" else _positive,
        default=default,
        help=f"{words} (default: %(default)s)".lstrip(),
    )


def _add_result_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--dry-run", action="store_true", help="print the result, write nothing")
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

    loaded = read_config(args)
    if args.verb == "undo":
        return _undo(loaded)
    if args.verb == "imu":
        return _by_hand(loaded, args)
    # Imported first, so that a missing extra is reported before the robot moves.
    import numpy  # noqa: F401

    if args.verb == "poses":
        return _by_poses(loaded, args)

    import msgspec

    from yahboomd.cli.attended import attend
    from yahboomd.core.daemon.process import deadly
    from yahboomd.tools.calibrate.calibration_writing import check_writable
    from yahboomd.tools.calibrate.wizard import RunOptions, calibrate

    check_source(args)
    if args.held and not args.dialogue:
        raise ConfigError("--held needs --dialogue json: the button is that of a program.")

    if not args.dry_run and loaded.calibration_path is not None:
        check_writable(loaded.calibration_path)

    given = {
        field: getattr(args, option) for field, option in RUNS.items() if hasattr(args, option)
    }
    options = msgspec.convert(given, RunOptions)

    async def work(robot: AsyncRobot) -> int:
        import asyncio

        try:
            return await lead(robot)
        except asyncio.CancelledError:
            words = await _ended(robot, drove=not args.by_hand)
            # The terminal may be gone.
            with contextlib.suppress(OSError):
                print(words, file=sys.stderr)
            raise

    async def lead(robot: AsyncRobot) -> int:
        if not args.dialogue:
            from yahboomd.tools.terminal.asking import Answers

            return await calibrate(robot, loaded, options, Answers(as_json=args.json))
        from yahboomd.core.clock import SystemClock
        from yahboomd.tools.calibrate.dialogue import Dialogue
        from yahboomd.tools.calibrate.hold import HeldButton

        hold = HeldButton(SystemClock(), robot.stop) if args.held else None
        dialogue = Dialogue(hold)
        return await dialogue.lead(calibrate(robot, loaded, options, dialogue, hold))

    import signal

    return attend(args, work, source=args.source, signals=(*deadly(), signal.SIGTSTP))


async def _ended(robot: AsyncRobot, *, drove: bool) -> str:
    """Stop the robot and watch it stand; returns the outcome in words."""
    if not drove:
        return "Ended: nothing was driven, and nothing was written."
    robot.stop()
    if await robot.standing():
        return "Ended: the wheels were stopped and stand; nothing was written."
    return (
        "Ended: a stop was sent, but the wheels were not seen to stand. Look at them, or run "
        "`yahboomd stop`. Nothing was written."
    )


def _undo(loaded: Loaded) -> int:
    from yahboomd.tools.calibrate.calibration_writing import undo_calibration

    path = loaded.calibration_path
    if path is None or not undo_calibration(path):
        raise Refused(f"There is no calibration to take back in {path or 'any state directory'}.")
    print(f"Taken back in {path}. The daemon reads it when it starts.")
    return 0


def _by_hand(loaded: Loaded, args: argparse.Namespace) -> int:
    from yahboomd.cli.attended import attend
    from yahboomd.client import ImuSample
    from yahboomd.tools.calibrate.dialogue import Dialogue
    from yahboomd.tools.calibrate.imu_by_hand import show_mounted, turn_by_hand
    from yahboomd.tools.calibrate.wizard import config_of
    from yahboomd.tools.terminal.asking import Answers

    async def ask(robot: AsyncRobot, person: Answers | Dialogue) -> int:
        config = await config_of(robot, loaded)
        found = await turn_by_hand(
            lambda: robot.samples(ImuSample, depth=1024), person, config, args.turns
        )
        show_mounted(found, config, person)
        return 0

    async def work(robot: AsyncRobot) -> int:
        if not args.dialogue:
            return await ask(robot, Answers())
        dialogue = Dialogue(None)
        return await dialogue.lead(ask(robot, dialogue))

    return attend(args, work)


def _by_poses(loaded: Loaded, args: argparse.Namespace) -> int:
    from yahboomd.tools.calibrate.estimates.least_squares import Unseen
    from yahboomd.tools.calibrate.estimates.sensor import fit_to_sensor
    from yahboomd.tools.calibrate.estimates.verdict import unseen
    from yahboomd.tools.calibrate.recorded_poses import tracks
    from yahboomd.tools.calibrate.result import conclude
    from yahboomd.tools.terminal.asking import Answers

    config = loaded.config
    if config.kinematics().holonomic:
        raise Refused("A mecanum base is calibrated by tape: `yahboomd calibrate tape`")
    frames = tuple(args.frames) if args.frames else None
    recorded = tracks(args.bags, config, topic=args.topic, frames=frames)
    try:
        found, mounting = fit_to_sensor(recorded)
    except Unseen as error:
        raise Refused(f"Nothing was written. {unseen(error)}") from error
    print(
        f"The sensor sits {mounting.x:.3f} m ahead and {mounting.y:.3f} m to the left of the "
        f"axle's middle, turned {math.degrees(mounting.heading):.2f}\N{DEGREE SIGN} to the left.",
        file=sys.stderr,
    )
    return conclude(
        found,
        config,
        loaded.calibration_path,
        method=f"poses of {args.topic}",
        dry_run=args.dry_run,
        person=Answers(as_json=args.json),
    )
