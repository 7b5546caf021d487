"""The bus at the start of a service: what stands in its way is waited for, in the same process.

A service that ended for it would be started again every second, for ever: another process on the
listen port, an address that the network has not given out yet, a folder that is not mounted.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
from collections.abc import Awaitable, Callable

from yahboomd.clock import Clock, nanoseconds
from yahboomd.daemon.process import Notifier
from yahboomd.errors import BusError

log = logging.getLogger(__name__)

BACK_OFF_S = (0.25, 0.5, 1.0, 2.0, 5.0)
"""Waits between attempts; the last one again and again."""

PATIENCE_S = 60.0
"""The time that one start waits. A process that waits for the start to end (``systemctl start``, an
installation, the machine's boot) is not held for ever; the service manager starts another one."""


async def open_bus(
    open_once: Callable[[], Awaitable[None]],
    *,
    notifier: Notifier,
    clock: Clock,
    stop: asyncio.Event,
) -> bool:
    """Open the bus; under a service manager, try again until it opens.

    Without a manager the first failure is raised: a person sits there and reads it.

    Args:
        open_once: Opens it, or raises a BusError.
        notifier: Reports to the manager in words what is waited for.
        stop: Set when the daemon is to end.

    Returns:
        Whether it is open; it is not where ``stop`` was set meanwhile.

    Raises:
        BusError: It cannot be opened, or could not within :data:`PATIENCE_S`.
    """
    until_ns = clock.now_ns() + nanoseconds(PATIENCE_S)
    said = ""
    for attempt in itertools.count():
        try:
            await open_once()
        except BusError as error:
            if not notifier.heard or clock.now_ns() >= until_ns:
                raise
            notifier.status(f"waiting for the bus: {error}")
            if error.message != said:
                said = error.message
                log.warning("%s yahboomd keeps trying.", error)
        else:
            return True
        try:
            async with asyncio.timeout(BACK_OFF_S[min(attempt, len(BACK_OFF_S) - 1)]):
                await stop.wait()
        except TimeoutError:
            continue
        return False
    raise AssertionError  # the count has no end
