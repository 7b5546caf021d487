"""The ``yahboomd`` command: finds the subcommand, runs it, and reports a failure in one message.

Each subcommand is a module of its name, a :class:`CommandModule`, imported only when it is used. So
``yahboomd --help`` does not wait for Zenoh, and if one command's extras are missing, the others
work. Other packages bring more of them: see :mod:`yahboomd.cli.packages`.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import importlib
import importlib.util
import io
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, NoReturn, Protocol, TypeAlias, cast

from yahboomd import __version__
from yahboomd.core.errors import LimitError, YahboomdError
from yahboomd.core.program import COMMANDS, PACKAGES, install_command, pasteable, readable

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

EXTRAS = {
    "rich": "monitor",
    "matplotlib": "plot",
    "numpy": "calibrate",
    "mcap": "record",
    **dict.fromkeys(("starlette", "uvicorn", "websockets", "segno"), "web"),
    "yahboomd-fleet": "fleet",
}
"""Optional packages, with what installs each: an extra, or one of ``PACKAGES``."""

FULL = (errno.ENOSPC, errno.EDQUOT)
"""The errors of a full disk."""

USAGE = 2
"""argparse's exit status for arguments that make no sense."""

OLDEST = (3, 11)
"""For the commands; :mod:`yahboomd.client` runs on 3.10."""

TOO_OLD = """\
yahboomd: this is Python {}.{}: yahboomd.client works here for your programs, but its commands \
need 3.11 or later. uv brings one (PACKAGE is the wheel, or the folder of the source): \
python3 -m pip install --user uv && python3 -m uv tool install --python 3.12 PACKAGE
"""

NOT_LINUX = "yahboomd: yahboomd.client works here for your programs, but its commands need Linux.\n"

EPILOG = """\
a first drive, without a robot:
  yahboomd simulate --link /tmp/board    in one terminal
  yahboomd run --port /tmp/board         in a second one
  yahboomd drive                         in a third one

`yahboomd COMMAND --help` explains each command.
"""


Subparsers: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"  # noqa: SLF001

_SHORTAGES = (errno.EMFILE, errno.ENFILE, errno.ENOMEM)

_SIGNS = {
    "can't start new thread": "no thread can be started",
    "can't spawn worker thread": "no thread can be started",
    "Failed to init": "Zenoh cannot start its threads",
    "failed to map segment": "no memory is left",
}
"""Texts of threading, of Zenoh's panics (no :class:`Exception`), and of the loader of libraries."""


class CommandModule(Protocol):
    """A subcommand's module."""

    DESCRIPTION: str
    EPILOG: str

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """Declare its options."""

    def run(self, args: argparse.Namespace) -> int:
        """Run the command; returns the exit status."""


class _OneLineEach(argparse.RawDescriptionHelpFormatter):
    """Indents the list of commands by the longest name, which argparse does not."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = max(map(len, COMMANDS)) + 4


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: The arguments after the program's name. None stands for the process's own arguments;
            then the process may end here: see :func:`_end_at_once`.

    Returns:
        The exit status: 0, the command's own, that of the error (78 for the configuration, 69 for
        a missing port or bus, 77 for a missing permission), or 130 after Ctrl-C.
    """
    if sys.version_info < OLDEST:
        sys.stderr.write(TOO_OLD.format(*sys.version_info))
        return os.EX_CONFIG
    if sys.platform != "linux":
        sys.stderr.write(NOT_LINUX)
        return 78
    if argv is not None:
        return _run(list(argv))
    _fill_standard_streams()
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A file's name may have bytes that are no character. Standard error escapes them already.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = _run(sys.argv[1:])
    except Exception:
        if not _threads_left():
            raise
        sys.excepthook(*sys.exc_info())
        status = 1
    if _threads_left():
        _end_at_once(status)
    return status


def _fill_standard_streams() -> None:
    """Open streams that the caller closed (`2>&-`), so that no port becomes standard error.

    Libraries write to the descriptor 2 when they fail.
    """
    while (fd := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(fd)


def _threads_left() -> bool:
    """Whether another thread runs, such as one that is still opening a Zenoh session."""
    threading = sys.modules.get("threading")
    return threading is not None and threading.active_count() > 1


def _end_at_once(status: int) -> NoReturn:
    """Flush all output, and end without Python's ordinary exit.

    At an ordinary exit Python ends a thread that returns from a library by unwinding through that
    library. A Rust library then aborts the process (signal 6), and the exit status is lost.
    """
    if (logging := sys.modules.get("logging")) is not None:
        logging.shutdown()
    for stream in filter(None, (sys.stdout, sys.stderr)):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(status)


def _run(arguments: list[str]) -> int:
    try:
        status = _dispatch(arguments)
        # None if the caller closed it (`>&-`).
        if sys.stdout is not None:
            sys.stdout.flush()
    except YahboomdError as error:
        _print_error(str(error))
        return error.exit_code
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except BrokenPipeError:
        # The reader (head, less) has left.
        _drop_output()
        return 128 + signal.SIGPIPE
    except BaseException as error:
        if (limit := _shortage(error)) is not None:
            _print_error(str(limit))
            return limit.exit_code
        if not isinstance(error, OSError):
            raise
        if isinstance(error.filename, str | os.PathLike):
            _print_error(f"{error.filename}: {error.strerror}.")
        elif error.errno in FULL:
            _drop_output()
            _print_error(f"the output cannot be written: {error.strerror}.")
        else:
            raise
        return os.EX_IOERR
    return status


def _shortage(error: BaseException) -> LimitError | None:
    """The limit of the system that caused an error; None for any other error."""
    words = "no memory is left" if isinstance(error, MemoryError) else ""
    if isinstance(error, OSError) and error.errno in _SHORTAGES:
        words = os.strerror(error.errno)
    elif not isinstance(error, OSError | SystemExit):
        said = str(error)
        words = words or next((_SIGNS[sign] for sign in _SIGNS if sign in said), "")
    if not words:
        return None
    return LimitError(
        f"The system gives this process too little: {words}.",
        remedy="`ulimit -a` shows the limits of this shell; a service has its own (LimitNOFILE=, "
        "TasksMax=, MemoryMax=).",
    )


def _drop_output() -> None:
    # Otherwise Python would complain again when it flushes at exit.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _dispatch(arguments: list[str]) -> int:
    name = next((word for word in arguments if not word.startswith("-")), None)
    parser, subparsers = _bare_parser()
    packaged, lines = _of_packages() if _looks_further(name, arguments) else ({}, COMMANDS)
    command: CommandModule | None = None
    for known, line in lines.items():
        if known == name:
            try:
                command = _load(known, packaged)
            except ModuleNotFoundError as error:
                _print_error(_missing(known, error))
                return os.EX_UNAVAILABLE
            _add(subparsers, known, line, command)
        else:
            subparsers.add_parser(known, help=line)
    if name in PACKAGES and command is None:
        _print_error(_missing(name, ModuleNotFoundError(name=f"yahboomd-{name}")))
        return os.EX_UNAVAILABLE
    args, unknown = parser.parse_known_args(arguments)
    if unknown:
        # With the command's own usage, not that of all commands.
        (subparsers.choices[name] if command is not None and name else parser).error(
            f"unrecognized arguments: {' '.join(unknown)}"
        )
    if command is None:
        parser.print_help()
        return USAGE
    try:
        return command.run(args)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] not in EXTRAS:
            raise
        _print_error(_missing(args.command, error))
        return os.EX_UNAVAILABLE


def _looks_further(name: str | None, arguments: list[str]) -> bool:
    """Whether the commands of other packages are wanted: for their help, or as one of them."""
    return "--version" not in arguments if name is None else name not in COMMANDS


def _of_packages() -> tuple[dict[str, EntryPoint], dict[str, str]]:
    """The commands of other packages, and the lines of all commands in the help."""
    from yahboomd.cli import packages

    found = packages.commands()
    return found, COMMANDS | packages.lines(found)


def whole_parser(*, installed: bool = False) -> argparse.ArgumentParser:
    """The parser with every command's options, for man pages and completions.

    Args:
        installed: Also with the commands of other packages.
    """
    parser, subparsers = _bare_parser()
    packaged, lines = _of_packages() if installed else ({}, COMMANDS)
    for name, line in lines.items():
        _add(subparsers, name, line, _load(name, packaged))
    return parser


def _add(subparsers: Subparsers, name: str, line: str, command: CommandModule) -> None:
    command.add_options(
        subparsers.add_parser(
            name,
            help=line,
            description=command.DESCRIPTION,
            epilog=command.EPILOG,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
    )


def _bare_parser() -> tuple[argparse.ArgumentParser, Subparsers]:
    parser = argparse.ArgumentParser(
        prog="yahboomd",
        description="Drives Yahboom encoder motor boards: velocity commands in over Zenoh, exact "
        "odometry out.",
        epilog=EPILOG,
        formatter_class=_OneLineEach,
    )
    parser.add_argument(
        "--version",
        action="version",
        version=f"yahboomd {__version__}",
        help="show the version and exit",
    )
    return parser, parser.add_subparsers(dest="command", metavar="COMMAND")


def _load(name: str, packaged: Mapping[str, EntryPoint]) -> CommandModule:
    if name in packaged:
        return cast(CommandModule, packaged[name].load())
    if name == "run":
        _spare_openssl()
    return cast(CommandModule, importlib.import_module(_module(name)))


def _spare_openssl() -> None:
    """Keep OpenSSL's 5 MB out of the daemon: asyncio and hashlib load it, Zenoh has its own TLS."""
    if importlib.util.find_spec("_md5") is not None:  # without it hashlib needs OpenSSL
        for name in ("ssl", "_hashlib"):
            sys.modules.setdefault(name, cast(ModuleType, None))


def _module(name: str) -> str:
    return ".".join(filter(None, ("yahboomd.cli", "shell" if name == "completions" else "", name)))


def _missing(command: str, error: ModuleNotFoundError) -> str:
    package = (error.name or "").partition(".")[0]
    if package in EXTRAS:
        return f"`{command}` needs {package}: {install_command(EXTRAS[package])}"
    if error.name == _module(command):
        return f"`{command}` is not part of this installation."
    return f"`{command}` needs the Python package {error.name}, which is missing: install again."


def _print_error(message: str) -> None:
    print(f"yahboomd: {pasteable(readable(message))}", file=sys.stderr)


if __name__ == "__main__":
    raise SystemExit(main())
