"""The stop socket of a tool that turns wheels without a daemon.

It is the daemon's own (:mod:`yahboomd.core.daemon.estop.local_stop`), so that `yahboomd stop` and
every other program that writes to it reach `setup` and `tune` as they reach a daemon. A stop ends
the tool as SIGTERM does, which stops the wheels first; the answer follows once the port is free.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import AsyncIterator, Mapping
from pathlib import Path

from yahboomd.core.config import runtime_folder
from yahboomd.core.daemon.estop.local_stop import NAME, LocalStop
from yahboomd.core.errors import Refused
from yahboomd.core.messages.native import ServiceReply
from yahboomd.tools.port.guarded import LeftTurning

SERVICES_FOLDER = Path("/run/yahboomd")
"""It stays when the service ends, and belongs to the service's user."""


def tools_folder(environ: Mapping[str, str], *, user_id: int) -> Path:
    """The folder of a tool's stop socket: the daemon's, but one of its own for root.

    The service's user could remove the socket of root's tool.
    """
    folder = runtime_folder(environ, user_id=user_id)
    # A stop finds it among those of the services, whose names begin in the same way.
    return Path("/run/yahboomd-root") if folder == SERVICES_FOLDER else folder


@contextlib.asynccontextmanager
async def stop_socket(command: str, port: str, environ: Mapping[str, str]) -> AsyncIterator[None]:
    """Let a stop end this process, whose SIGTERM is handled already.

    Args:
        command: Its name, such as ``tune``.
        port: The port that it takes.

    Raises:
        Refused: There can be no socket: no wheel must be turned.
    """
    ended = asyncio.Event()
    left_turning = False

    def engage(by: str) -> str:
        signal.raise_signal(signal.SIGTERM)
        return f"`yahboomd {command}` is ended by {by}, and stops the wheels first."

    async def acknowledged(words: str) -> ServiceReply:
        await ended.wait()
        return ServiceReply(success=not left_turning, message=words)

    folder = tools_folder(environ, user_id=os.getuid())
    local = LocalStop(
        folder,
        name=f"{NAME}-{command}",
        engage=engage,
        acknowledged=acknowledged,
        facts=lambda: {"daemon": "yahboomd", "command": command, "ports": [port]},
    )
    await local.open()
    try:
        if not local.status_values()["local_socket"]:
            raise Refused(
                f"There is no stop socket in {folder}, so that `yahboomd stop` could not end this "
                "command: no wheel is turned.",
                remedy="May this user write there? Else set RUNTIME_DIRECTORY to another folder.",
            )
        yield
    except LeftTurning:
        left_turning = True
        raise
    finally:
        ended.set()
        # In the iteration that this skips, the answers leave.
        await asyncio.sleep(0)
        local.close()
