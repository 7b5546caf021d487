"""Options that several commands share, and the configuration that they describe."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from yahboomd.core.errors import ConfigError, Refused
from yahboomd.tools.robot.daemon_address import client_options, configured_endpoints
from yahboomd.tools.terminal.words import decimal

if TYPE_CHECKING:
    from yahboomd.core.bus.options import BusOptions
    from yahboomd.core.config import Config, Loaded


NEGATIVE = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?(deg)?$")


def take_negative_numbers(parser: argparse.ArgumentParser) -> None:
    """Read ``-1e-16`` and ``-90deg`` as numbers; argparse reads them as options."""
    parser._negative_number_matcher = NEGATIVE  # noqa: SLF001 - there is no public way


def number(what: str, good: Callable[[float], bool] = math.isfinite) -> Callable[[str], float]:
    """Make a reader of an option's number, which refuses a number that is not ``what``."""

    def read(text: str) -> float:
        value = decimal(text)
        if not good(value):
            raise argparse.ArgumentTypeError(f"{text} is not {what}")
        return value

    return read


seconds = number("a number of seconds from 0 to 3600", lambda value: 0.0 <= value <= 3600.0)
"""The reader of a duration."""


def add_config_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--config FILE`` and ``--set SECTION.KEY=VALUE``."""
    parser.add_argument(
        "--config",
        metavar="FILE",
        type=Path,
        help="configuration to read (default: /etc/yahboomd/config.toml, if it exists)",
    )
    add_set_option(parser)


def add_set_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--set SECTION.KEY=VALUE``, which may be repeated."""
    parser.add_argument(
        "--set",
        metavar="SECTION.KEY=VALUE",
        action="append",
        default=[],
        dest="overrides",
        help="change one key, over file and environment; may be repeated",
    )


def add_source_option(parser: argparse.ArgumentParser, default: str) -> None:
    """Add ``--source KEY``, for commands that drive."""
    parser.add_argument(
        "--source",
        metavar="KEY",
        help="the key to command on; the daemon's [command.sources] gives it its priority "
        f"(default: {default}; with your file of `yahboomd fleet`: cmd_vel/NAME)",
    )


def source_of(args: argparse.Namespace, config: Config, default: str) -> str:
    """The key of ``--source``; or else the person's own by the fleet's file; or else the default.

    Raises:
        ConfigError: The key cannot be one.
    """
    from yahboomd.client.services import own_source, person_in
    from yahboomd.core.names import name_problem

    if args.source:
        if problem := name_problem(args.source):
            raise ConfigError(f"--source {args.source}: {problem}.")
        return str(args.source)
    person = person_in(config.zenoh.config)
    return own_source(person) if person else default


def check_picture(path: Path) -> None:
    """Raise early if a picture cannot be written: before all the work, and before a file is lost.

    Raises:
        Refused: The name has another ending, or its folder does not exist.
    """
    if path.suffix not in {".png", ".svg", ".pdf"}:
        raise Refused(f"{path} is no picture: name a file that ends in .png, .svg or .pdf.")
    if not path.absolute().parent.is_dir():
        raise Refused(f"There is no folder {path.absolute().parent} for the picture.")


def add_port_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--port PATH``, short for ``--set serial.port=PATH``."""
    parser.add_argument(
        "--port",
        metavar="PATH",
        help="serial port of the board, such as /dev/ttyUSB0 (default: find it)",
    )


def add_bus_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--namespace NAME`` and ``--connect ENDPOINT``, for commands that use a daemon."""
    parser.add_argument(
        "--namespace",
        metavar="NAME",
        help="name of the robot, short for --set zenoh.namespace=NAME",
    )
    add_connect_option(parser)


def add_connect_option(
    parser: argparse._ActionsContainer,  # parsers and their groups
    words: str = "where to reach the daemon or its router, such as tcp/192.168.1.5:7447 "
    "(default: the endpoints on which the configured daemon listens)",
) -> None:
    """Add ``--connect ENDPOINT``, which may be repeated."""
    parser.add_argument(
        "--connect",
        metavar="ENDPOINT",
        action="append",
        type=_endpoint,
        help=words,
    )


def read_config(args: argparse.Namespace, environ: Mapping[str, str] | None = None) -> Loaded:
    """Read the configuration that the shared options describe.

    Args:
        environ: The environment; the process's own when None.

    Raises:
        ConfigError: The configuration has mistakes; the error names each.
    """
    # Imported here, because pydantic takes a tenth of a second that --help must not wait for.
    from yahboomd.core.config import read

    overrides = list(args.overrides)
    for option, key in (("port", "serial.port"), ("namespace", "zenoh.namespace")):
        value = getattr(args, option, None)
        if value is not None:
            # As a string, even if TOML would read it as a number.
            overrides.append(f"{key}={quoted(value)}")
    return read(
        args.config, environ=os.environ if environ is None else environ, overrides=overrides
    )


def robot_arguments(args: argparse.Namespace) -> tuple[str, ...]:
    """The shared options as arguments for another command that shall reach the same robot."""
    arguments = [f"--connect={endpoint}" for endpoint in args.connect or ()]
    arguments += [f"--set={override}" for override in args.overrides]
    for name in ("config", "namespace"):
        if (value := getattr(args, name)) is not None:
            arguments.append(f"--{name}={value}")
    return tuple(arguments)


def daemon_options(args: argparse.Namespace, config: Config) -> BusOptions:
    """The options of a client of that daemon."""
    return client_options(daemon_endpoints(args, config), config)


def daemon_endpoints(args: argparse.Namespace, config: Config) -> tuple[str, ...]:
    """The daemon's endpoints: those of ``--connect``, or else those of its configuration."""
    return tuple(getattr(args, "connect", None) or configured_endpoints(config))


def _endpoint(text: str) -> str:
    from yahboomd.core.names import endpoint_problem

    if problem := endpoint_problem(text):
        raise argparse.ArgumentTypeError(f"{problem}.")
    return text


def quoted(text: str) -> str:
    """The text as a basic string of TOML."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
