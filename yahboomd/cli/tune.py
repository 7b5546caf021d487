"""``yahboomd tune``: how each wheel follows a step, its dead zone, and better gains."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import datetime
import os
import signal
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from yahboomd.cli.shared_options import (
    add_config_options,
    add_port_option,
    check_picture,
    number,
    read_config,
)
from yahboomd.core.errors import LinkError, Refused, YahboomdError
from yahboomd.core.program import readable

if TYPE_CHECKING:
    from yahboomd.core.clock import Clock
    from yahboomd.core.config import Config
    from yahboomd.core.link.port_guard import PortGuard
    from yahboomd.core.protocol.dialect import Dialect
    from yahboomd.core.protocol.settings import BoardSettings
    from yahboomd.tools.tune.procedure import Procedure
    from yahboomd.tools.tune.tuning_result import Result

DESCRIPTION = """\
Measure how each wheel follows a step of its speed and where its dead zone ends, and find gains for
the board's speed loop that settle soon and do not overshoot. The wheels turn: every wheel of the
robot has to be in the air. Takes the port itself, so the daemon must be stopped. The board's
values are saved before they are changed, and --undo stores them again.
"""

EPILOG = """\
examples:
  yahboomd tune                      measure, suggest, ask, store, measure again
  yahboomd tune --dry-run            write nothing to the board
  yahboomd tune --undo               store the board's former values again
  yahboomd tune --yes --json --output steps.svg    for a program; the wheels are in the air

exit status:
  0    better gains are stored, or there are none; with --dry-run: measured
  1    refused: the emergency stop is engaged, no gains were better, or an answer denied it
  69   no port, a held one, or no board
  75   the cable was out while a wheel turned; it was waited for, and the wheels were stopped
  77   no permission
  78   a mistake in the configuration, a wheel that does not do as it should, or a line to the
       board that loses or alters bytes
  130  Ctrl-C; other signals end with 128 and their number. The wheels were stopped
"""

ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

FLASH_WRITES = 10_000
"""What a page of the flash of such microcontrollers endures, by their data sheet."""

RESET_S = 0.35

IN_THE_AIR = (
    "Every wheel will turn, alone and together, at up to {speed:.2f} m/s for 1.5 s at a time, for "
    "a minute in all.\nDoes the robot stand so that all wheels are in the air, and is nothing near "
    "them? [y/N]"
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--dry-run", action="store_true", help="measure and suggest; write nothing to the board"
    )
    parser.add_argument(
        "--undo", action="store_true", help="store the board's former values again; no wheel turns"
    )
    parser.add_argument(
        "--speed",
        metavar="M_S",
        type=number("a speed from 0.1 to 1 m/s", lambda speed: 0.1 <= speed <= 1.0),
        default=0.4,
        help="of the steps (default: %(default)s m/s)",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        type=Path,
        help="the picture: .png or .svg (default: tune-DATE-TIME.png)",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object, for programs")
    parser.add_argument(
        "--yes",
        action="store_true",
        help="do not ask: the wheels are in the air, and values may be written",
    )
    add_port_option(parser)
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Tune."""
    if not args.undo:
        # The extra is missed before a wheel turns.
        import matplotlib  # noqa: F401

        if args.output is not None:
            check_picture(args.output)
    loaded = read_config(args)
    config = loaded.config
    from yahboomd.core.clock import SystemClock
    from yahboomd.core.link.port_guard import PortGuard
    from yahboomd.tools.port import charge
    from yahboomd.tools.port.own_port import opener_of, refuse_estop, with_hints
    from yahboomd.tools.stop.port_search import find_port
    from yahboomd.tools.tune.saved import saved_path

    place = saved_path(config, os.environ, args.config)
    port = ""
    try:
        port = find_port(config)
        refuse_estop(port, config, os.environ)
        clock, guard = SystemClock(), PortGuard(charge.start, renewed=False)
        tuning = TuneCommand(args, config, port, place)
        opener = opener_of(port, config, clock, guard)
        if args.undo:
            from yahboomd.tools.tune.undo import undo

            return _ended_by_signals(
                lambda: undo(opener, clock, place, as_json=args.json), tuning, guard, clock
            )
        from yahboomd.tools.tune.procedure import Procedure

        procedure = Procedure(opener, clock, config, speed_m_s=args.speed, say=tuning.say)
        procedure.result.port = port
        return _ended_by_signals(lambda: tuning.tune(procedure), tuning, guard, clock)
    except LinkError as error:
        raise (with_hints(error, port) if port else error) from error


def _ended_by_signals(
    work: Callable[[], Awaitable[int]], tuning: TuneCommand, guard: PortGuard, clock: Clock
) -> int:
    """Run it; a signal ends it, and the wheels are brought to rest on the way."""
    from yahboomd.cli.attended import until_signal
    from yahboomd.tools.port.guarded import ended_by_stops

    async def attended() -> int:
        async def reached_by_stops() -> int:
            async with ended_by_stops(guard, "tune", tuning.port, os.environ, clock):
                return await work()

        status = await until_signal(reached_by_stops(), ENDINGS)
        if status > 128:
            tuning.say_ended(signal.Signals(status - 128).name)
        return status

    return asyncio.run(attended())


class TuneCommand:
    """The command's side: questions, files, and words.

    Args:
        place: Of the file with what the board stored.
    """

    def __init__(self, args: argparse.Namespace, config: Config, port: str, place: Path) -> None:
        from yahboomd.tools.terminal.input_lines import InputLines

        self._args = args
        self._config = config
        self.port = port
        self._place = place
        self._lines = InputLines()
        self._wrote = False
        self._left_turning = False
        self._procedure: Procedure | None = None

    def say(self, words: str) -> None:
        """Show progress, on standard error: standard output is the result."""
        # A terminal that is gone must not hide why it ended.
        with contextlib.suppress(OSError):
            print(readable(words), file=sys.stderr, flush=True)

    def say_ended(self, name: str) -> None:
        """Explain an end by a signal."""
        how = "." if self._left_turning else ": the wheels were stopped."
        self.say(f"Ended by {name}{how}")
        self._say_undo()

    def _say_undo(self) -> None:
        if self._wrote and self._procedure is not None and self._procedure.restored:
            # Before the words: a disk that does not take it is an error of its own.
            self._finish()
            self.say("The board stores its former values again.")
        elif self._wrote:
            self.say(
                "The board stores trial values now. `yahboomd tune --undo` stores the former ones."
            )

    async def tune(self, procedure: Procedure) -> int:
        """Measure, suggest, store, and report."""
        args, result = self._args, procedure.result
        self._procedure = procedure
        if not args.yes and not await self._yes(IN_THE_AIR.format(speed=args.speed)):
            raise Refused("The wheels have to be in the air: nothing was turned.")
        stored = True
        from yahboomd.tools.port.guarded import LeftTurning

        try:
            await procedure.examine(self._check_place)
            if result.worth_writing and not args.dry_run:
                stored = await procedure.store(self._agree, self._save)
                self._finish()
            elif result.suggested and not result.worth_writing:
                result.notes.append(
                    "The gains are good: the suggested ones would hardly settle sooner."
                )
        except LeftTurning:
            self._left_turning = True
            raise
        except YahboomdError as error:
            self._say_undo()
            if not args.json:
                raise
            print(_json(result, error=str(error)))
            return error.exit_code
        picture = args.output or Path(
            f"tune-{datetime.datetime.now().astimezone():%Y-%m-%d-%H%M%S}.png"
        )
        from yahboomd.tools.tune.step_picture import save_picture

        lost: Refused | None = None
        try:
            save_picture(result, picture)
        except Refused as error:
            # The figures are worth more than the picture.
            lost = error
        if args.json:
            print(_json(result, error=str(lost)) if lost else _json(result, picture=str(picture)))
            return lost.exit_code if lost else os.EX_OK if stored else 1
        from yahboomd.tools.tune.tune_text import lines

        print("\n".join(map(readable, [*lines(result), *([] if lost else ["", str(picture)])])))
        if lost:
            raise lost
        return os.EX_OK if stored else 1

    async def _yes(self, question: str) -> bool:
        """Ask; an empty answer means no, and earlier typing is discarded."""
        from yahboomd.tools.terminal.terminal_questions import yes_or_no

        while True:
            answer = yes_or_no(await self._lines.ask(question, fresh=True) or "")
            if answer is not None:
                return answer
            self.say("y or n, please.")

    async def _agree(self, wanted: BoardSettings, dialect: Dialect) -> bool:
        """Announce the values to be written, and ask."""
        from yahboomd.tools.tune.procedure import MOST_WRITES
        from yahboomd.tools.tune.tune_text import values

        resets = any(row.resets for row in dialect.settings if row.field in wanted)
        restart = f", and restarts the board ({RESET_S:g} s)" if resets else ""
        self.say(
            f"To be stored: {values(wanted)}. Each value costs one of some {FLASH_WRITES:,} writes "
            f"of the board's flash{restart}; each is measured, {MOST_WRITES} are written at most. "
            f"Its present values are saved in {self._place}."
        )
        if self._args.yes:
            return True
        return await self._yes("Store it? [y/N]")

    def _check_place(self) -> None:
        from yahboomd.tools.tune.saved import check_place

        if not self._args.dry_run:
            check_place(self._place, self.port)

    def _save(self, dialect: Dialect, settings: BoardSettings) -> None:
        from yahboomd.tools.tune.saved import SavedSettings, save

        now = datetime.datetime.now(datetime.UTC)
        found = SavedSettings(
            made=f"{now:%Y-%m-%d %H:%M:%S}",
            port=self.port,
            dialect=dialect.name,
            settings=dict(settings),
        )
        kept = save(self._place, found)
        if kept is not found:
            self.say(
                f"A tuning of {kept.made} did not end: --undo stores the values from before it."
            )
        self._wrote = True

    def _finish(self) -> None:
        from yahboomd.tools.tune.saved import finish, read_saved

        saved = read_saved(self._place)
        if saved is not None and self._wrote:
            finish(self._place, saved)
        self._wrote = False


def _json(result: Result, **more: str) -> str:
    data = msgspec.to_builtins(result) | more
    return readable(msgspec.json.format(msgspec.json.encode(data), indent=2).decode())
