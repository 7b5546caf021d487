"""The connection to a daemon: opened when a router answers, kept by Zenoh, and judged here.

A Zenoh client cannot open without a router, so opening is retried until it works. An open one
reconnects by itself, within two seconds. A daemon shows itself by its liveliness token, or by its
status if an access control hides the token.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from pathlib import Path

from yahboomd.client.streams import MAX_BYTES, read_sample
from yahboomd.core.bus import keys
from yahboomd.core.bus.blocking import bounded
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.keys import full_key
from yahboomd.core.bus.options import BusOptions, zenoh_config
from yahboomd.core.bus.presence import NeighbourChange, TokenChange
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.clock import Clock, nanoseconds, timeout
from yahboomd.core.errors import BusConfigError, BusError, NoDaemon
from yahboomd.core.messages.native import StatusSample
from yahboomd.core.names import is_local

log = logging.getLogger("yahboomd.client")

ENDPOINT = "tcp/127.0.0.1:7448"
"""A daemon's default endpoint, for this machine only."""

RETRY_S = 0.25
LOOK_S = 0.25

PATIENCE_S = 2.0
"""Without a status for this time no daemon is there: it publishes one twice a second."""


def client_options(
    endpoint: str | Sequence[str], *, namespace: str = "", zenoh_file: str | Path | None = None
) -> BusOptions:
    """The options of a client's session.

    Args:
        endpoint: The address of the daemon or its router, or several of them.
        namespace: The robot's.
        zenoh_file: A JSON5 file of Zenoh's: certificates, passwords. Access control is enforced by
            the daemon.
    """
    return BusOptions(
        mode="client",
        listen=(),
        connect=(endpoint,) if isinstance(endpoint, str) else tuple(endpoint),
        namespace=namespace,
        config_file=Path(zenoh_file) if zenoh_file else None,
        enforces=False,
    )


class Connection:
    """A Zenoh session, and whether the daemon is there.

    Args:
        changed: Called on the loop when the daemon is there, and when it no longer is.

    Attributes:
        alive: Whether the daemon is there.
        status: Its newest status; None while it is away.
    """

    def __init__(
        self, options: BusOptions, clock: Clock, changed: Callable[[bool], None] = lambda _: None
    ) -> None:
        self.options = options
        self.alive = False
        self.status: StatusSample | None = None
        self._clock = clock
        self._changed = changed
        self._bus: Bus | None = None
        self._failure: BusError | None = None
        self._tokens = set[str]()
        self._has_tokens = False
        self._opened_ns = 0
        self._status_ns: int | None = None
        self._warned_of_status = False
        self._found = asyncio.Event()
        self._watching: asyncio.Task[None] | None = None

    @property
    def bus(self) -> Bus:
        """The open session.

        Raises:
            NoDaemon: It is not open: no router answered yet.
        """
        if self._bus is None:
            raise self.no_daemon()
        return self._bus

    @property
    def is_open(self) -> bool:
        """Whether a router answered; from then on the session reconnects by itself."""
        return self._bus is not None

    @property
    def where(self) -> str:
        """The endpoints at which the daemon is expected, in words."""
        return " or ".join(self.options.connect)

    async def open(self, wait_s: float) -> None:
        """Open the session.

        Args:
            wait_s: How long to wait for a router; 0: one try, ``math.inf``: without limit.

        Raises:
            NoDaemon: Nothing answers there in time.
            BusError: The endpoint, the namespace or the file cannot be used.
        """
        zenoh_config(self.options)
        deadline_s = self._clock.now_ns() / 1e9 + wait_s
        while True:
            bus = Bus(self.options, clock=self._clock)
            try:
                await bus.open()
                break
            except BusConfigError:
                raise
            except BusError as error:
                self._failure = error
                if self._clock.now_ns() / 1e9 >= deadline_s:
                    # Our message contains the cause's. Its traceback is long, and advises a daemon.
                    raise self.no_daemon() from None
                await asyncio.sleep(RETRY_S)
        self._bus, self._opened_ns = bus, self._clock.now_ns()
        bus.subscribe(keys.STATUS, self._receive_status, max_bytes=MAX_BYTES)
        # Each daemon has its own token: one of two in a namespace may end.
        bus.watch_tokens(f"{keys.ALIVE}/*", self._tokens_changed)
        bus.watch_neighbours(self._neighbours_changed)
        self._watching = asyncio.create_task(self._watch(), name="client-watch")

    async def wait_alive(self, wait_s: float) -> None:
        """Wait until the daemon is there.

        Raises:
            NoDaemon: It is not there in time; the message names the namespaces in use there.
        """
        try:
            async with timeout(None if wait_s == float("inf") else wait_s):
                await self._found.wait()
        except TimeoutError:
            others = await self._namespaces() if self.is_open else []
            raise self.no_daemon(others) from None

    def learn_status(self, status: StatusSample) -> None:
        """Use a queried status until the first one is published."""
        self.status = self.status or status

    async def close(self) -> None:
        """End the session, within bounds; safe to call twice."""
        if self._watching is not None:
            self._watching.cancel()
            await asyncio.gather(self._watching, return_exceptions=True)
            self._watching = None
        bus, self._bus = self._bus, None
        self.alive, self.status = False, None
        if bus is not None:
            await bus.close()

    @property
    def problem(self) -> str:
        """The reason why no daemon is there, in a sentence; empty while one is."""
        if self.alive:
            return ""
        if self._bus is None:
            # For a person who drives a robot, the router is the daemon.
            why = "" if self._failure is None else self._failure.message
            return why.replace("No Zenoh router answers", "No yahboomd answers")
        if not self._bus.neighbours:
            return f"The connection to {self.where} is lost; it reconnects by itself."
        if self._clock.now_ns() - self._opened_ns < nanoseconds(PATIENCE_S):
            return "The connection is there; listening …"
        return self._router_alone

    @property
    def _router_alone(self) -> str:
        name = self.options.namespace
        below = f"in the namespace {name!r}" if name else "without a namespace"
        return (
            f"A Zenoh router answers at {self.where}, but no yahboomd is there {below}: "
            f"nothing answers {full_key(name, keys.STATUS)}."
        )

    def no_daemon(self, others: list[str] | None = None) -> NoDaemon:
        """The error to raise if the daemon does not answer, with a remedy.

        Args:
            others: Namespaces in which a daemon is there.
        """
        if others:
            listed = ", ".join(repr(each) if each else "none" for each in others)
            return NoDaemon(self._router_alone, remedy=f"Namespaces in use there: {listed}.")
        if self._bus is not None:
            # The wait is over, so `problem`'s "listening" would be wrong.
            alone = self._router_alone if self._bus.neighbours and not self.alive else ""
            return NoDaemon(
                alone or self.problem or f"The daemon at {self.where} does not answer.",
                remedy="Does it run (`yahboomd run`), and under this namespace?",
            )
        remedy = "Start one there with `yahboomd run`."
        if not all(map(is_local, self.options.connect)):
            remedy += (
                " A daemon accepts connections from other machines only if its zenoh.listen names "
                "an address of the network."
            )
        return NoDaemon(
            self.problem or f"No yahboomd answers at {self.where}.",
            remedy=remedy,
        )

    async def _namespaces(self) -> list[str]:
        session = self.bus.session

        def find() -> list[str]:
            replies = session.liveliness().get(f"**/{keys.ALIVE}", timeout=1.0)
            found = {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}
            return sorted(key.removesuffix(keys.ALIVE).strip("/") for key in found)

        try:
            return await bounded(find, timeout_s=1.5, name="client-namespaces")
        except Exception:  # noqa: BLE001 - it only helps an error's remedy
            return []

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(LOOK_S)
            self._judge()

    def _receive_status(self, arrivals: list[Arrival]) -> None:
        sample = read_sample(arrivals[-1].payload, StatusSample)
        if sample is None:
            if not self._warned_of_status:
                self._warned_of_status = True
                log.warning("The status of the daemon at %s cannot be read.", self.where)
        else:
            self._status_ns = arrivals[-1].arrived_ns
            self._judge()
            self.status = sample

    def _tokens_changed(self, changes: list[TokenChange]) -> None:
        gone = {change.key for change in changes if not change.present}
        self._tokens = {each.key for each in changes if each.present} | (self._tokens - gone)
        self._has_tokens |= bool(self._tokens)
        self._judge(lost=bool(gone))

    def _neighbours_changed(self, changes: list[NeighbourChange]) -> None:
        self._judge(lost=any(not change.present for change in changes))

    def _judge(self, *, lost: bool = False) -> None:
        """See whether the daemon is there.

        Args:
            lost: The daemon or the connection was lost just now, even if it is back already.
        """
        bus = self._bus
        if bus is None:
            return
        if lost:
            self._set_alive(False)
        silent_ns = self._clock.now_ns() - (self._status_ns or self._opened_ns)
        talks = self._status_ns is not None and silent_ns < nanoseconds(PATIENCE_S)
        # Once a token was seen, tokens decide; until then the status does.
        known = bool(self._tokens) if self._has_tokens else talks
        self._set_alive(known and bool(bus.neighbours))

    def _set_alive(self, alive: bool) -> None:
        if alive == self.alive:
            return
        self.alive = alive
        if alive:
            self._found.set()
            log.info("The daemon at %s is there.", self.where)
        else:
            self._found.clear()
            self.status = self._status_ns = None
            log.warning(
                "The daemon at %s is gone. Its robot stops by itself, commands are dropped until "
                "it is back.",
                self.where,
            )
        self._changed(alive)
