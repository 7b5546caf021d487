"""``yahboomd simulate``: simulates a board on a pseudo-terminal, with motors and a chassis."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import signal
from collections.abc import Iterable
from pathlib import Path
from typing import get_args

import msgspec

from yahboomd.cli.shared_options import add_config_options, read_config
from yahboomd.core import program
from yahboomd.core.errors import ConfigError
from yahboomd.simulation.boards import BOARDS
from yahboomd.simulation.console import HELP
from yahboomd.simulation.options import (
    WIRINGS,
    DriveName,
    ImpairmentOptions,
    SimulationOptions,
    Wiring,
    at_plug,
)
from yahboomd.simulation.pty import RobotPort, serve
from yahboomd.simulation.robot import SimulatedRobot

DESCRIPTION = """\
Be a motor driver board on a pseudo-terminal, in real time, with motors and a chassis behind it. A
program opens it like the serial port of a real board. It runs until Ctrl-C.
"""

EPILOG = f"""\
a first drive, each line in a terminal of its own:
  yahboomd simulate --link /tmp/board
  yahboomd run --port /tmp/board

a robot with the motors and the chassis of a configuration:
  yahboomd simulate --link /tmp/board --config robot.toml

four wheels, their motors plugged in otherwise and the right ones mounted the other way round, with
two encoder plugs crossed and a motor without power:
  yahboomd simulate --link /tmp/board --drive skid_steer --plugs=2,1,-4,-3 \
    --do 'crossed 1 2' --do 'motor-dead rear_right'

a line that loses bytes, and a wheel whose encoder is dead from the start:
  yahboomd simulate --link /tmp/board --loss 0.02 --do 'encoder-dead left'

disturb it while it runs, by one command a line on the control socket:
  yahboomd simulate --link /tmp/board --control /tmp/board.control
  python3 -c 'import socket; c = socket.socket(socket.AF_UNIX); \
c.connect("/tmp/board.control"); c.send(b"unplug 2\\n"); print(c.recv(99).decode(), end="")'

control commands, for --control and --do:
{"".join(f"  {line}" + chr(10) for line in HELP.splitlines())}
exit status:
  0    ended by Ctrl-C, SIGTERM or SIGHUP
  78   an option, or the configuration, cannot be used
"""


ROBOT = (
    ("--wheel-radius", "M", "wheel_radius_m", "true radius of the wheels"),
    ("--wheel-separation", "M", "wheel_separation_m", "from the left wheels to the right ones"),
    ("--wheel-base", "M", "wheel_base_m", "from axle to axle, for mecanum and ackermann"),
    (
        *("--sideways", "SHARE", "sideways"),
        "way to the side per metre that mecanum wheels roll; negative: rollers mounted mirrored",
    ),
    ("--lines", "N", "lines", "encoder lines of the motors"),
    ("--ratio", "X", "ratio", "their true gear ratio"),
    ("--battery", "V", "battery_volts", "the battery at rest"),
    ("--firmware", "VERSION", "firmware", "the version that the board reports; empty: its own"),
    (
        *("--start-up", "S", "start_up_s"),
        "how long a board is silent after a reset while it sets up its inertial sensor",
    ),
    (
        *("--tick-period", "S", "tick_period_s"),
        "how often a board that sends its totals renews them, 0 for with every line",
    ),
    (
        *("--tick-jitter", "S", "tick_jitter_s"),
        "each of these periods is longer by a random time up to this one",
    ),
    ("--seed", "N", "seed", "of all that is random: the same number, the same faults"),
)
"""The options of the robot: flag, metavar, field, help."""

LINE = (
    ("--loss", "SHARE", "loss", "share of bytes that vanish, each way, 0 to 1"),
    (
        *("--corruption", "SHARE", "corruption"),
        "share of bytes that arrive with a bit flipped, each way, 0 to 1",
    ),
    ("--delay", "S", "delay_s", "delay of every chunk, each way"),
    ("--jitter", "S", "jitter_s", "additional random delay, up to this time"),
    ("--chunk", "S", "chunk_s", "period in which bytes arrive, 0 for each alone"),
)
"""The options of the line, in the same form."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    robot = SimulationOptions()
    where = parser.add_argument_group("its port and files")
    where.add_argument(
        "--link",
        metavar="PATH",
        type=Path,
        help="a name for the port, such as /tmp/board (default: only the system's own, /dev/pts/N)",
    )
    where.add_argument(
        "--truth",
        metavar="FILE",
        type=Path,
        help="write the true pose of the robot, 100 times a second, as JSON lines",
    )
    where.add_argument(
        "--heard",
        metavar="FILE",
        type=Path,
        help="write the frames from the host, with their times, as JSON lines",
    )
    where.add_argument(
        "--control", metavar="PATH", type=Path, help="a unix socket that takes control commands"
    )
    where.add_argument(
        "--do",
        metavar="COMMAND",
        action="append",
        default=[],
        help="a control command to carry out at the start; may be repeated",
    )

    add_config_options(parser)
    what = parser.add_argument_group(
        "the robot (with --config or --set, its motors, wheels and chassis are those of the file)"
    )
    what.add_argument(
        "--dialect",
        choices=tuple(BOARDS),
        default=robot.dialect,
        help="the board's dialect (default: %(default)s, as boards on sale do)",
    )
    what.add_argument(
        "--drive",
        choices=get_args(DriveName),
        default=robot.drive,
        help="the geometry (default: %(default)s); differential: left on M1, right on M3; "
        "ackermann: a car, rear wheels on M2 and M4, whose front wheels the board turns if it can "
        "(docs/boards.md has an example); "
        "the others: M1 to M4 as the vendor has them",
    )
    _add_fields(what, ROBOT, robot)
    _add_frictions(what, robot)
    what.add_argument(
        "--plugs",
        metavar="N,N[,N,N]",
        default="",
        help="the plugs of the motors, 1 to 4: left, right; or front left, rear left, "
        "front right, rear right. Negative for one that is mounted the other way round, such as "
        "--plugs=3,-1",
    )
    what.add_argument(
        "--flash",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="a value that the board has stored, such as lines=0; may be repeated. "
        + "; ".join(
            f"{name}: {', '.join(kind.flash.__struct_fields__)}"
            for name, kind in BOARDS.items()
            if kind.flash is not None
        ),
    )
    what.add_argument(
        "--ticks",
        metavar="A,B,C,D",
        default="0,0,0,0",
        help="counters at the start (default: %(default)s)",
    )
    what.add_argument(
        "--stream-pace",
        choices=("measured", "wire"),
        default=robot.stream_pace,
        help="stream lines at the rate of a real board, or one right after the other",
    )
    bad = parser.add_argument_group("faults of the line")
    _add_fields(bad, LINE, robot.impairments)


def _add_frictions(group: argparse._ArgumentGroup, robot: SimulationOptions) -> None:
    for flag, field, words in (
        ("--friction-scales", "friction_scales", "the friction of each motor as a multiple"),
        ("--sticks", "sticks", "static friction of each motor as a multiple of the moving one"),
    ):
        default = getattr(robot, field)
        group.add_argument(
            flag,
            metavar="X[,X...]",
            type=_numbers,
            default=default,
            help=f"{words}, in the order of the motors, and again from the first (default: "
            f"{','.join(map('{:g}'.format, default))})",
        )


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return tuple(map(float, text.split(",")))
    except ValueError:
        raise argparse.ArgumentTypeError(f"numbers with commas between, not {text!r}") from None


def _add_fields(
    group: argparse._ArgumentGroup, fields: Iterable[tuple[str, str, str, str]], of: msgspec.Struct
) -> None:
    for flag, metavar, field, words in fields:
        default = getattr(of, field)
        group.add_argument(
            flag,
            metavar=metavar,
            dest=field,
            type=type(default),
            default=default,
            help=f"{words} (default: %(default)s)",
        )


def run(args: argparse.Namespace) -> int:
    """Serve until SIGINT, SIGTERM or SIGHUP, which is a closed terminal."""
    robot = SimulatedRobot(_options(args))
    return asyncio.run(_serve(robot, args))


async def _serve(robot: SimulatedRobot, args: argparse.Namespace) -> int:
    def ready(port: RobotPort) -> None:
        name = port.name if args.link is None else f"{args.link} ({port.name})"
        reach = port.name if args.link is None else args.link
        print(
            f"A simulated {robot.options.dialect} board is at {name}; drive it: "
            f"{program.name()} run --port {reach}",
            flush=True,
        )

    loop = asyncio.get_running_loop()
    served = asyncio.ensure_future(
        serve(
            robot,
            link=args.link,
            truth=args.truth,
            heard=args.heard,
            control=args.control,
            at_start=args.do,
            ready=ready,
        )
    )
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, served.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await served
    return 0


def _options(args: argparse.Namespace) -> SimulationOptions:
    robot = _given(args)
    if args.config or args.overrides:
        from yahboomd.tools.robot.simulated_robot import as_configured

        robot = as_configured(read_config(args).config, robot)
    if not args.flash:
        return robot
    stored = _flash(robot.dialect, args.flash)
    if robot.flash is not None:
        named = {name: getattr(stored, name) for name in _named(args.flash)}
        stored = msgspec.structs.replace(robot.flash, **named)
    return msgspec.structs.replace(robot, flash=stored)


def _given(args: argparse.Namespace) -> SimulationOptions:
    return SimulationOptions(
        dialect=args.dialect,
        drive=args.drive,
        wiring=_plugged(args.drive, args.plugs) if args.plugs else None,
        initial_ticks=_ticks(args.ticks),
        stream_pace=args.stream_pace,
        friction_scales=args.friction_scales,
        sticks=args.sticks,
        impairments=ImpairmentOptions(**{field: getattr(args, field) for _, _, field, _ in LINE}),
        **{field: getattr(args, field) for _, _, field, _ in ROBOT},
    )


def _plugged(drive: DriveName, text: str) -> tuple[Wiring, ...]:
    usual = WIRINGS[drive]
    try:
        plugs = [int(part) for part in text.split(",")]
    except ValueError:
        plugs = []
    if len(plugs) != len(usual) or 0 in plugs:
        raise ConfigError(
            f"--plugs takes a plug for each of {len(usual)} motors, such as "
            f"--plugs={','.join(str(wire.position) for wire in usual)}, not {text!r}."
        )
    return tuple(at_plug(wire, plug) for wire, plug in zip(usual, plugs, strict=True))


def _named(settings: list[str]) -> dict[str, str]:
    return dict(setting.partition("=")[::2] for setting in settings)


def _flash(dialect: str, settings: list[str]) -> msgspec.Struct:
    values, kind = _named(settings), BOARDS[dialect].flash
    if kind is None:
        raise ConfigError(f"--flash: a {dialect} board stores nothing.")
    unknown = set(values) - set(kind.__struct_fields__)
    if unknown:
        raise ConfigError(
            f"--flash knows no {', '.join(sorted(unknown))}.",
            remedy=f"There are {', '.join(kind.__struct_fields__)}.",
        )
    wrong = [
        f"{name} takes a {'whole ' if field.type is int else ''}number, not {values[name]!r}"
        for field in msgspec.structs.fields(kind)
        if (name := field.name) in values and not _is_a(field.type, values[name])
    ]
    if wrong:
        raise ConfigError(f"--flash: {'; '.join(wrong)}.")
    return msgspec.convert(values, kind, strict=False)


def _is_a(kind: object, text: str) -> bool:
    try:
        msgspec.convert(text, kind, strict=False)
    except msgspec.ValidationError:
        return False
    return True


def _ticks(text: str) -> tuple[int, int, int, int]:
    try:
        a, b, c, d = (int(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"--ticks takes four whole numbers, not {text!r}.") from None
    if any(not -(2**31) <= ticks < 2**31 for ticks in (a, b, c, d)):
        raise ConfigError(f"--ticks takes numbers of 32 bits, not {text!r}.")
    return a, b, c, d
