"""Opens the board's port for a command without a daemon, and explains why it cannot."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Mapping
from pathlib import Path

from yahboomd.core.clock import Clock
from yahboomd.core.config import Config
from yahboomd.core.daemon.estop.latch_file import LatchFile, engaged_in
from yahboomd.core.errors import LinkError, PortBusy, PortLost, Refused, YahboomdError
from yahboomd.core.link import discovery
from yahboomd.core.link.port import Opener, Port, open_port
from yahboomd.core.link.port_errors import holders
from yahboomd.core.link.port_guard import PortGuard
from yahboomd.core.model import NS_PER_S
from yahboomd.tools.port.guarded import SERVICES_FOLDER
from yahboomd.tools.stop import diagnosis
from yahboomd.tools.stop.port_search import port_options
from yahboomd.tools.stop.stop_local import folders
from yahboomd.tools.stop.stop_port import pids
from yahboomd.tools.stop.unresponsive import FROZEN, is_guard, process_state, true_names

GUARD_ENDS_WITHIN_NS = 10 * NS_PER_S
RETRY_S = 0.05


def opener_of(port: str, config: Config, clock: Clock, guard: PortGuard | None = None) -> Opener:
    """A function that opens the port by the configuration, for this process and its guard alone.

    It waits for the guard of a killed `setup` or `tune`, which stops the wheels.
    """
    options, own = port_options(port, config), guard or PortGuard()

    async def open_it() -> Port:
        end_ns = clock.now_ns() + GUARD_ENDS_WITHIN_NS
        before: set[int] = set()
        while True:
            try:
                opened = await open_port(options, clock)
            except PortBusy:
                own.want(port)
                found = pids(holders(port))
                # A guard that is just ending, or that this user may not see, looks like another
                # program or like none (0). Another program still has the port at the next look.
                others = {pid for pid in found if not is_guard(pid)} if found else {0}
                if clock.now_ns() >= end_ns or others & before:
                    raise
                before = others
            else:
                opened.share(own, options)
                # Another program's device may be there: its wheels are this process's, and its
                # guard's, once a board has answered.
                own.standing()
                return opened
            await asyncio.sleep(RETRY_S)

    return open_it


def refuse_estop(port: str, config: Config, environ: Mapping[str, str]) -> None:
    """Refuse to turn wheels while an emergency stop is engaged that may belong to this board.

    Raises:
        Refused: One is engaged, or its state cannot be read.
    """
    own = config.latch_path(environ, user_id=os.getuid())
    try:
        found = own if _engaged(own) else None
        for folder in folders(environ):
            found = found or engaged_in(Path(folder), port)
    except OSError as error:
        raise Refused(
            f"{error.filename} cannot be read ({error.strerror}), so the emergency stop may be "
            "engaged: no wheel is turned.",
            remedy="Run the same command with sudo, or as a user of the group yahboomd.",
        ) from error
    if found is not None:
        raise Refused(
            f"The emergency stop is engaged ({found}): no wheel is turned.",
            remedy="See why it was engaged. Then start the daemon, release it with `yahboomd stop "
            "--release`, and end the daemon again.",
        )


def _engaged(own: Path) -> bool:
    # To root the service's folder is another user's, whom the service itself trusts.
    if own.parent == SERVICES_FOLDER:
        return os.path.lexists(own)
    return LatchFile(own).load() is not None


HOLDS = (
    "The board holds its last output: if a wheel turns, switch the motors' supply off, or plug the "
    "board in again and run `yahboomd stop`."
)


def with_hints(error: YahboomdError, port: str) -> YahboomdError:
    """The same error, with hints from the state of this machine."""
    if not isinstance(error, LinkError):
        return error
    if isinstance(error, PortBusy):
        return _held(error, tuple(map(true_names, holders(port))))
    hints = diagnosis.hints(error, port, found=discovery.candidates())
    if isinstance(error, PortLost):
        hints = (HOLDS, *hints)
    return type(error)(error.message, remedy=" ".join(hints) or error.remedy)


def _held(error: PortBusy, who: tuple[str, ...]) -> PortBusy:
    """The same error, with the command that ends each holder."""
    commands = [
        f"kill -CONT {pid} (it is suspended), then kill {pid}"
        if process_state(pid) in FROZEN
        else f"kill {pid}"
        for pid in pids(who)
        if not is_guard(pid)
    ]
    remedy = " ".join(diagnosis.busy(who))
    if commands:
        remedy += f" One program at a time can use the board. End the other: {'; '.join(commands)}"
    return PortBusy(true_names(error.message), remedy=remedy.strip())
