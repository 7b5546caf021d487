"""Announces the daemon on the bus, and reports who else is there: daemons, routers, clients."""

from __future__ import annotations

import logging
from collections.abc import Callable

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import admitted
from yahboomd.core.bus.presence import NeighbourChange, TokenChange
from yahboomd.core.model import Event

log = logging.getLogger(__name__)


class BusPresence:
    """The daemon's presence, on an open bus.

    Args:
        report: Publishes an event.
        bus_lost: Called when no client is left.
        changed: Called when connections were made or lost.
    """

    def __init__(
        self,
        bus: Bus,
        *,
        report: Callable[[Event], None],
        bus_lost: Callable[[], None],
        changed: Callable[[], None],
    ) -> None:
        self._bus = bus
        # Tokens may come while the bus is closing, and has no zid any more.
        self._zid = bus.zid
        self._report = report
        self._bus_lost = bus_lost
        self._changed = changed
        self._others = set[str]()
        self._admitted = admitted(bus.options)

    def announce(self) -> None:
        """Declare the tokens, watch those of others, and log the endpoints of the bus."""
        bus = self._bus
        bus.token(keys.ALIVE)
        bus.token(keys.holder_key(keys.ALIVE, self._zid))
        bus.watch_tokens(f"{keys.ALIVE}/*", self._holders)
        bus.watch_neighbours(self._neighbours)
        for endpoint in bus.options.listening:
            if endpoint in bus.options.exposed:
                log.warning("Listening on %s: %s.", endpoint, admitted(bus.options, endpoint))
            else:
                log.info("Listening on %s, for this machine alone.", endpoint)

    def _holders(self, changes: list[TokenChange]) -> None:
        for change in changes:
            zid = keys.holder_of(self._bus.key(keys.ALIVE), change.key)
            if zid is None or zid == self._zid:
                continue
            if not change.present:
                self._others.discard(zid)
            elif zid not in self._others:
                self._others.add(zid)
                words = (
                    f"Another yahboomd ({zid}) uses the same namespace: what reaches both moves "
                    "both, and an emergency stop may reach one alone. Give each robot its own "
                    "namespace, such as --set zenoh.namespace=bot2."
                )
                self._report(Event(kind="second_daemon", severity="warning", message=words))

    def _neighbours(self, changes: list[NeighbourChange]) -> None:
        for change in changes:
            neighbour = change.neighbour
            if neighbour.kind != "router":
                continue
            where = neighbour.address or neighbour.zid
            if change.present:
                words = f"Joined the router at {where}: {self._admitted}."
                event = Event(kind="router_joined", severity="warning", message=words)
            else:
                words = f"The router at {where} is gone; it is joined again when it comes back."
                event = Event(kind="router_lost", severity="info", message=words)
            self._report(event)
        if not self._bus.neighbours:
            # No client is left that could command, or take a command back.
            self._bus_lost()
        self._changed()
