"""A client's side of the bus: reach a daemon that may not be there yet, listen, and ask.

A Zenoh client cannot be opened without a router, so opening is tried until it works. Once open it
reconnects by itself, within two seconds.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import zenoh
from zenoh.handlers import RingChannel

from yahboomd.bus.bounded import bounded
from yahboomd.bus.options import BusOptions, zenoh_config
from yahboomd.bus.session import Bus
from yahboomd.cli.incoming import read_sample
from yahboomd.errors import BusError
from yahboomd.messages.native import ServiceReply

if TYPE_CHECKING:
    from yahboomd.config import Config

MAX_BYTES = 1 << 18
"""The largest sample that a client takes: a status with every counter has some kilobytes."""

RETRY_S = 0.25


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """What became of a question.

    Attributes:
        success: Whether it was done, by everybody who answered.
        message: What was done, or why not, in their words; a sentence of ours where nobody
            answered.
        answered: How many did.
    """

    success: bool
    message: str
    answered: int


class BusClient(Bus):
    """A session that can also ask. Opened and closed as any :class:`Bus`."""

    def newest(self, key: str) -> Callable[[], bytes | None]:
        """Keep the newest sample of a key, for whoever looks less often than samples come.

        Nothing of Python runs when one comes: at fifty a second on three keys, what a subscription
        hands over one by one costs more than drawing a screen.

        Returns:
            What takes the newest sample's payload; None where none came since it was taken.
        """
        subscriber = self.session.declare_subscriber(self.key(key), RingChannel(1))

        def take() -> bytes | None:
            sample = subscriber.try_recv()
            return None if sample is None else sample.payload.to_bytes()

        return take

    async def ask(
        self, key: str, payload: bytes = b"{}", *, timeout_s: float = 1.5, urgent: bool = False
    ) -> list[bytes]:
        """Query a service of the daemon's.

        Args:
            key: The service's key, below the namespace.
            payload: The request. Its encoding is also that of the answer.
            timeout_s: The longest wait for answers.
            urgent: Overtakes what else is under way.

        Returns:
            The payload of each answer; none where nobody answers in time.

        Raises:
            BusError: The session is not open.
        """
        session, name = self.session, self.key(key)

        def get() -> list[bytes]:
            replies = session.get(
                name,
                # Every daemon that is there, not the nearest one: an emergency stop is for all.
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=timeout_s,
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=zenoh.Priority.REAL_TIME if urgent else zenoh.Priority.DATA,
                express=urgent,
                payload=payload,
                encoding="application/json",
            )
            return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]

        try:
            return await bounded(get, timeout_s=timeout_s + 0.5, name="bus-ask")
        except (TimeoutError, zenoh.ZError):
            return []

    async def request(
        self, key: str, payload: bytes = b"{}", *, timeout_s: float = 1.5, urgent: bool = False
    ) -> Answer:
        """Like :meth:`ask`, the answers read and put together."""
        payloads = await self.ask(key, payload, timeout_s=timeout_s, urgent=urgent)
        return read_answers(payloads)


def read_answers(payloads: list[bytes]) -> Answer:
    """Put the answers of a service together; what cannot be read counts as a refusal."""
    replies = [
        read_sample(payload, ServiceReply)
        or ServiceReply(success=False, message="An answer came that cannot be read.")
        for payload in payloads
    ]
    if not replies:
        return Answer(success=False, message="Nobody answered.", answered=0)
    return Answer(
        success=all(reply.success for reply in replies),
        message=" ".join(dict.fromkeys(reply.message for reply in replies)),
        answered=len(replies),
    )


def client_options(endpoints: tuple[str, ...], config: Config) -> BusOptions:
    """A client of the daemon that a configuration describes.

    Args:
        endpoints: Where it is reached.
        config: Names the namespace, and Zenoh's own file (certificates, passwords). Its access
            control is the daemon's to enforce.
    """
    return BusOptions(
        mode="client",
        listen=(),
        connect=endpoints,
        namespace=config.zenoh.namespace,
        config_file=Path(config.zenoh.config) if config.zenoh.config else None,
        enforces=False,
    )


async def reach(options: BusOptions, *, waiting: Callable[[str], None] | None = None) -> BusClient:
    """Open a session, however long it takes until somebody listens there.

    Args:
        options: Of a client.
        waiting: Told why it is not open yet, after each attempt.

    Raises:
        BusError: It can never be opened like this: a wrong endpoint, namespace or file.
    """
    zenoh_config(options)
    while True:
        client = BusClient(options)
        try:
            await client.open()
        except BusError as error:
            if waiting is not None:
                waiting(error.message)
            await asyncio.sleep(RETRY_S)
        else:
            return client
