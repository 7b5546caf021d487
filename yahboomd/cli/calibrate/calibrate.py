"""``yahboomd calibrate``: the true size of wheels and track, by a tape, by squares, or a sensor."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from yahboomd.cli.shared_options import add_source_option, check_source, number
from yahboomd.errors import ConfigError, Refused

if TYPE_CHECKING:
    from yahboomd.calibration.runs import Run
    from yahboomd.cli.calibrate.asking import Answers
    from yahboomd.cli.calibrate.shapes import Driver, Leg
    from yahboomd.client import AsyncRobot
    from yahboomd.config import Config, Loaded

TAPE_STD_M = 0.002
"""The exactness with which a person reads a tape beside a robot."""

ANGLE_STD_RAD = math.radians(0.5)
"""The exactness with which a person sees an angle against a mark."""

DESCRIPTION = """\
Find the true size of the wheels and of the track, and write it to the calibration file, which goes
over the two multipliers of [chassis]. The robot drives known shapes while the daemon runs; you say
where it truly ended. It moves only while this command runs, within the bounds that it announces;
Ctrl-C stops it. Nothing is written that cannot be trusted, and the reason is named.
"""

EPILOG = """\
examples:
  yahboomd calibrate tape                    a straight of 2 m and 5 turns in place: ten minutes
  yahboomd calibrate squares --side 2        five squares each way, then a straight: the best
  yahboomd calibrate tape --by-hand          you push the robot; it drives nothing
  yahboomd calibrate squares --dry-run       print what would be written
  yahboomd calibrate poses run1 --frames map laser
  yahboomd calibrate imu                     turn it by hand: axes and scale of the sensor
  yahboomd calibrate undo                    the calibration before counts again
  yahboomd config check                      which value comes from where

exit status:
  0    written, or printed with --dry-run
  1    the result cannot be trusted, or the robot does not obey; nothing was written
  69   no daemon is there, or it was lost
  78   a mistake in the configuration, or the file cannot be written
  130  Ctrl-C; the robot was stopped and nothing was written
"""

_positive = number("a number above 0", lambda value: math.isfinite(value) and value > 0.0)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs."""
    from yahboomd.cli.robot.attended import add_robot_options
    from yahboomd.cli.shared_options import add_config_options

    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    tape = verbs.add_parser(
        "tape",
        help="a straight and turns in place: size of the wheels, and track",
        description="A straight between two marks gives the size of the wheels, turns in place on "
        "a mark give the track.",
    )
    squares = verbs.add_parser(
        "squares",
        help="squares in both directions and a straight: the ratio of the wheels too",
        description="Squares in both directions, then a straight. Fitted jointly over all counts.",
    )
    tape.add_argument(
        "--turns",
        metavar="N",
        type=number("a whole number from 1 to 50", lambda n: n in range(1, 51)),
        default=5,
        help="turns in place each way (default: %(default)s)",
    )
    squares.add_argument(
        "--side",
        metavar="M",
        type=_positive,
        default=2.0,
        help="of a square (default: %(default)s)",
    )
    squares.add_argument(
        "--count",
        metavar="N",
        type=number("a whole number from 1 to 50", lambda n: n in range(1, 51)),
        default=5,
        help="squares each way (default: %(default)s)",
    )
    for each, default in ((tape, 2.0), (squares, 5.0)):
        each.add_argument(
            "--straight",
            metavar="M",
            type=_positive,
            default=default,
            help="length of the straight run, metres (default: %(default)s)",
        )
        each.add_argument(
            "--speed", metavar="M_PER_S", type=_positive, default=0.2, help="(default: %(default)s)"
        )
        each.add_argument(
            "--turn-speed",
            metavar="RAD_PER_S",
            type=_positive,
            default=0.8,
            help="(default: %(default)s)",
        )
        each.add_argument(
            "--by-hand",
            action="store_true",
            help="drive nothing: you push the robot, or drive it from elsewhere",
        )
        each.add_argument("--dry-run", action="store_true", help="print the result, write nothing")
        each.add_argument(
            "--json", action="store_true", help="print the result as one line of JSON"
        )
        add_source_option(each, "cmd_vel")
        add_robot_options(each)
    poses = verbs.add_parser(
        "poses",
        help="against another sensor's poses in a recording: no tape at all",
        description="Against the poses of another sensor, such as SLAM or motion capture, in a "
        "recording with the joint states. Where the sensor sits on the robot is found too.",
    )
    poses.add_argument(
        "bags", metavar="BAG", nargs="+", type=Path, help="folder of a bag, such as record makes"
    )
    poses.add_argument("--topic", default="/tf", help="of the poses (default: %(default)s)")
    poses.add_argument(
        "--frames",
        metavar=("PARENT", "CHILD"),
        nargs=2,
        help="of the transform, where the topic carries transforms, such as map laser",
    )
    poses.add_argument("--dry-run", action="store_true", help="print the result, write nothing")
    poses.add_argument("--json", action="store_true", help="print the result as one line of JSON")
    add_config_options(poses)
    imu = verbs.add_parser(
        "imu",
        help="turns by hand: how the inertial sensor is mounted, and its gyro's scale",
        description="You turn the robot by hand. Prints the section [imu] of the configuration; "
        "drives nothing and writes nothing.",
    )
    imu.add_argument(
        "--turns",
        metavar="N",
        type=number("a whole number from 1 to 50", lambda n: n in range(1, 51)),
        default=5,
        help="to the left (default: %(default)s)",
    )
    add_robot_options(imu)
    undo = verbs.add_parser(
        "undo",
        help="take the newest calibration back",
        description="Take the newest calibration back; the one before it counts again.",
    )
    add_config_options(undo)


def run(args: argparse.Namespace) -> int:
    """Carry out one verb.

    Raises:
        Refused: The result cannot be trusted, or the robot does not obey.
        NoDaemon: No daemon is there, or it was lost.
        ConfigError: The configuration has mistakes, or the file cannot be written.
    """
    from yahboomd.cli.shared_options import read_config

    loaded = read_config(args)
    if args.verb == "undo":
        return _undo(loaded)
    if args.verb == "imu":
        return _by_hand(loaded, args)
    # The extra is missed before the robot moves, not after.
    import numpy  # noqa: F401

    if args.verb == "poses":
        return _by_poses(loaded, args)

    from yahboomd.cli.robot.attended import attend
    from yahboomd.daemon.process import deadly

    check_source(args)

    async def work(robot: AsyncRobot) -> int:
        return await _calibrate(robot, loaded, args)

    import signal

    return attend(args, work, source=args.source, signals=(*deadly(), signal.SIGTSTP))


def _undo(loaded: Loaded) -> int:
    from yahboomd.config.calibration_file import undo_calibration

    path = loaded.calibration_path
    if path is None or not undo_calibration(path):
        raise Refused(f"There is no calibration to take back in {path or 'any state directory'}.")
    print(f"Taken back in {path}. The daemon reads it when it starts.")
    return 0


def _by_hand(loaded: Loaded, args: argparse.Namespace) -> int:
    from yahboomd.cli.calibrate.asking import Answers
    from yahboomd.cli.calibrate.imu_by_hand import print_mounted, turn_by_hand
    from yahboomd.cli.robot.attended import attend
    from yahboomd.client import ImuSample

    async def work(robot: AsyncRobot) -> int:
        config = await _config_of(robot, loaded)
        found = await turn_by_hand(
            lambda: robot.samples(ImuSample, depth=1024), Answers(), config, args.turns
        )
        print_mounted(found, config)
        return 0

    return attend(args, work)


def _by_poses(loaded: Loaded, args: argparse.Namespace) -> int:
    from yahboomd.calibration.least_squares import Unseen
    from yahboomd.calibration.sensor import fit_to_sensor
    from yahboomd.calibration.verdict import unseen
    from yahboomd.cli.calibrate.recorded_poses import tracks
    from yahboomd.cli.calibrate.result import conclude

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
        as_json=args.json,
    )


async def _calibrate(robot: AsyncRobot, loaded: Loaded, args: argparse.Namespace) -> int:
    from yahboomd.calibration.least_squares import PARTS, Unseen, fit
    from yahboomd.calibration.verdict import unseen
    from yahboomd.cli.calibrate.asking import Answers
    from yahboomd.cli.calibrate.result import conclude
    from yahboomd.cli.calibrate.shapes import Driver

    config = await _config_of(robot, loaded)
    if args.verb == "squares" and config.kinematics().holonomic:
        raise Refused(
            "A mecanum base is calibrated by tape: its slip hides the ratio of the wheels. "
            "`yahboomd calibrate tape`"
        )
    driver, answers = Driver(robot, config, args.source), Answers()
    if args.verb == "tape":
        runs = await _by_tape(driver, answers, args)
        method, free = "tape", PARTS[::2]
    else:
        runs = await _by_squares(driver, answers, args)
        method, free = f"squares of {args.side:g} m", PARTS
    try:
        found = fit(runs, free=free)
    except Unseen as error:
        raise Refused(f"Nothing was written. {unseen(error)}") from error
    return conclude(
        found,
        config,
        loaded.calibration_path,
        method=method,
        runs=runs,
        dry_run=args.dry_run,
        as_json=args.json,
    )


async def _config_of(robot: AsyncRobot, loaded: Loaded) -> Config:
    """The daemon's configuration, which the calibration file of this machine must belong to.

    Raises:
        ConfigError: It is another robot's.
    """
    import msgspec

    from yahboomd.config import Config
    from yahboomd.config.calibration_file import geometry_of

    config = Config.model_validate_json(msgspec.json.encode(await robot.config()))
    if geometry_of(config) != geometry_of(loaded.config):
        raise ConfigError(
            "The daemon runs with another robot's configuration than "
            f"{loaded.path or 'the defaults'}, which this command has read.",
            remedy="Name the daemon's own file: `--config FILE`.",
        )
    return config


async def _by_tape(driver: Driver, answers: Answers, args: argparse.Namespace) -> list[Run]:
    from yahboomd.cli.calibrate.shapes import turns

    runs = [await _straight(driver, answers, args)]
    for left in (True, False):
        way = "to the left" if left else "to the right"
        whole = 2.0 * math.pi * args.turns * (1.0 if left else -1.0)
        await _move(
            driver,
            answers,
            args,
            turns(whole, args.turn_speed),
            f"Turn {args.turns:g} times {way}: mark which way the robot points.",
        )
        beyond = await answers.number(
            "How many degrees beyond its mark did it turn? (negative: short of it)",
            good=lambda value: abs(value) < 3600.0,
            wrong="A number of degrees, such as 12.5 or -8.",
            blank=0.0,
        )
        assert beyond is not None
        measured = whole + math.copysign(1.0, whole) * math.radians(beyond)
        runs.append(_run(driver, "turn", (measured,), (ANGLE_STD_RAD,)))
    return runs


async def _by_squares(driver: Driver, answers: Answers, args: argparse.Namespace) -> list[Run]:
    from yahboomd.cli.calibrate.shapes import square

    runs = []
    for left in (True, False):
        way = "left" if left else "right"
        for count in range(1, int(args.count) + 1):
            await _move(
                driver,
                answers,
                args,
                square(args.side, args.speed, args.turn_speed, left=left),
                f"Square {count} of {args.count:g} to the {way}: put the robot on its mark.",
            )
            x = await _metres(answers, "How far ahead of its mark did it end, in mm?")
            y = await _metres(answers, "How far to the left of its mark, in mm?")
            degrees = await answers.number(
                "How many degrees to the left does it point? (empty: not measured)",
                good=lambda value: abs(value) <= 360.0,
                wrong="A number of degrees, or nothing.",
            )
            measured: tuple[float, ...] = (x, y)
            std: tuple[float, ...] = (TAPE_STD_M, TAPE_STD_M)
            if degrees is not None:
                measured, std = (*measured, math.radians(degrees)), (*std, ANGLE_STD_RAD)
            runs.append(_run(driver, "pose", measured, std))
    runs.append(await _straight(driver, answers, args))
    return runs


async def _straight(driver: Driver, answers: Answers, args: argparse.Namespace) -> Run:
    from yahboomd.cli.calibrate.shapes import straight

    await _move(
        driver,
        answers,
        args,
        straight(args.straight, args.speed),
        f"A straight of {args.straight:g} m: mark where the robot stands.",
    )
    length = await answers.number(
        "How far did it truly go, in m?",
        good=lambda value: 0.0 < value < 1000.0,
        wrong="A number of metres, such as 1.987.",
    )
    if length is None:
        raise Refused("Without a length there is nothing to calibrate by: nothing was written.")
    return _run(driver, "straight", (length,), (TAPE_STD_M,))


async def _metres(answers: Answers, question: str) -> float:
    value = await answers.number(
        f"{question} (negative: the other way)",
        good=lambda each: abs(each) < 100_000.0,
        wrong="A number of millimetres, such as 35 or -12.",
        blank=0.0,
    )
    assert value is not None
    return value / 1000.0


async def _move(
    driver: Driver, answers: Answers, args: argparse.Namespace, legs: list[Leg], words: str
) -> None:
    """Announce a shape, wait for the person, and drive it or have it driven by hand."""
    await driver.begin()
    if args.by_hand:
        print(f"{words} Then move it so.", file=sys.stderr)
        await driver.by_hand(answers, "Enter when it stands at the end.")
        return
    bounds = sum(leg.limit_s for leg in legs)
    print(f"{words} It will move for at most {bounds:.0f} s; Ctrl-C stops it.", file=sys.stderr)
    await answers.line("Enter when its way is free.")
    await driver.begin()
    for number_, leg in enumerate(legs, start=1):
        if len(legs) > 1:
            print(f"\r  part {number_} of {len(legs)}", end="", file=sys.stderr, flush=True)
        await driver.drive(leg)
    if len(legs) > 1:
        print(file=sys.stderr)


def _run(driver: Driver, kind: str, measured: tuple[float, ...], std: tuple[float, ...]) -> Run:
    from yahboomd.calibration.runs import Run

    left, right, separation_m = driver.gathered()
    return Run(kind, left, right, separation_m, measured, std)  # type: ignore[arg-type]
