"""The way to another router on the machine: a client session of its own, opened when it is there.

yahboomd could join that router as a router, in one session. Measured with eclipse-zenoh 1.10.2,
that does not hold: in one of some hundred starts and ends the tables that routers share broke, on
either side and for good (a panic, or subscriptions that became known after ten seconds or never).
As a client: never in 400. It also keeps what others say to each other out of the robot.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

import zenoh

from yahboomd.bus.bounded import bounded
from yahboomd.bus.options import BusOptions, zenoh_config

log = logging.getLogger(__name__)

RETRY_S = 0.5
"""Between two tries. One without an answer costs 0.2 ms."""


async def open_uplink(options: BusOptions) -> zenoh.Session:
    """Open a session to the first router that answers; waits for one for ever.

    Afterwards the session finds a router that went and came again by itself.
    """
    reported = False
    while True:
        try:
            return await bounded(
                _opening(options),
                timeout_s=options.open_timeout_s,
                name="bus-uplink",
                late=lambda session: session.close(),
            )
        except (zenoh.ZError, TimeoutError) as error:
            if not reported:
                log.debug("No router at %s yet: %s", ", ".join(options.connect), error)
                reported = True
        await asyncio.sleep(RETRY_S)


def _opening(options: BusOptions) -> Callable[[], zenoh.Session]:
    config = zenoh_config(options, uplink=True)
    return lambda: zenoh.open(config)
