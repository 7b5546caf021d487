"""Who is there: liveliness tokens, and the sessions that this one is connected to."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import msgspec
import zenoh
from zenoh.handlers import Callback

from yahboomd.bus.inbox import Inbox, Lane


class TokenChange(msgspec.Struct, frozen=True, kw_only=True):
    """A token came (``present``) or went; ``key`` is in full, namespace included."""

    key: str
    present: bool


class Token:
    """A liveliness token of our own. Made by ``Bus.token``.

    Args:
        key: The key in full.
    """

    def __init__(self, key: str) -> None:
        self.key = key
        self._open = True
        # A token that nobody holds on to is undeclared when it is collected.
        self._tokens: list[zenoh.LivelinessToken] = []

    def attach(self, session: zenoh.Session) -> None:
        """Be seen in this session too."""
        if self._open:
            self._tokens.append(session.liveliness().declare_token(self.key))

    def close(self) -> None:
        """Let the others see it go."""
        self._open = False
        for token in self._tokens:
            token.undeclare()
        self._tokens.clear()


Seen: TypeAlias = tuple[int, zenoh.Sample]
"""A token's change and the session that saw it, counted from 0."""


class TokenWatch:
    """Tokens that match a pattern. Made by ``Bus.watch_tokens``.

    Args:
        pattern: The key expression in full.
        handler: Takes the changes, on the loop.
        inbox: Brings them there.
    """

    def __init__(
        self, pattern: str, handler: Callable[[list[TokenChange]], None], inbox: Inbox
    ) -> None:
        self._pattern = pattern
        self._handler = handler
        self._inbox = inbox
        self._open = True
        self._lane: Lane[Seen] = inbox.lane(self._changed, depth=1024)
        self._subscribers: list[zenoh.Subscriber[None]] = []
        # A token is there as long as one session sees it.
        self._present: dict[str, set[int]] = {}

    def attach(self, session: zenoh.Session) -> None:
        """Look in this session too; those that exist already come first."""
        if not self._open:
            return
        lane, index = self._lane, len(self._subscribers)

        def changed(sample: zenoh.Sample) -> None:
            lane.offer((index, sample))

        self._subscribers.append(
            session.liveliness().declare_subscriber(
                self._pattern, Callback(changed, indirect=False), history=True
            )
        )

    def close(self) -> None:
        """Look no more."""
        self._open = False
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self._subscribers.clear()
        self._inbox.remove(self._lane)

    def _changed(self, batch: list[Seen], _lost: int) -> None:
        changes = list[TokenChange]()
        for index, sample in batch:
            key = str(sample.key_expr)
            seen = self._present.setdefault(key, set())
            before = bool(seen)
            if sample.kind == zenoh.SampleKind.PUT:
                seen.add(index)
            else:
                seen.discard(index)
            if bool(seen) != before:
                changes.append(TokenChange(key=key, present=bool(seen)))
            if not seen:
                del self._present[key]
        if changes:
            self._handler(changes)


class Neighbour(msgspec.Struct, frozen=True, kw_only=True):
    """A session at the other end of a connection.

    Attributes:
        zid: Its Zenoh id.
        kind: ``router``, ``peer`` or ``client``.
        address: Its end of the connection, such as ``tcp/127.0.0.1:7447``; empty when unknown.
    """

    zid: str
    kind: str
    address: str = ""


class NeighbourChange(msgspec.Struct, frozen=True, kw_only=True):
    """A connection was made (``present``) or lost."""

    neighbour: Neighbour
    present: bool


Transported: TypeAlias = tuple[zenoh.Session, zenoh.TransportEvent]
"""A connection that was made or lost, and the session that it belongs to."""


class Neighbours:
    """The sessions that are connected now, kept from Zenoh's transport events."""

    def __init__(self) -> None:
        self._lane: Lane[Transported] | None = None
        self._present: dict[str, Neighbour] = {}
        self._watchers: list[Callable[[list[NeighbourChange]], None]] = []
        self._own = frozenset[int]()
        self._stampers = frozenset[int]()

    def begin(self, inbox: Inbox) -> None:
        """Have the events brought to the loop by ``inbox``."""
        self._lane = inbox.lane(self._changed, depth=1024)

    def attach(self, session: zenoh.Session) -> None:
        """Follow this session's connections too."""
        self._own |= {stamp_id(str(session.zid()))}
        self._update_stampers()
        if (lane := self._lane) is None:
            return

        def changed(event: zenoh.TransportEvent) -> None:
            lane.offer((session, event))

        session.info.declare_transport_events_listener(
            Callback(changed, indirect=False), history=True
        )

    def watch(self, watcher: Callable[[list[NeighbourChange]], None]) -> None:
        """Have changes told to ``watcher`` too, on the loop."""
        self._watchers.append(watcher)

    def now(self) -> tuple[Neighbour, ...]:
        """All that are connected, in the order in which they came."""
        return tuple(self._present.values())

    def sent_ns(self, timestamp: zenoh.Timestamp | None) -> int | None:
        """When the sender says that it sent a sample, in Unix nanoseconds of its clock.

        Returns:
            None where the sender said nothing. Whatever comes without a stamp is stamped by the
            first session that stamps at all: by the nearest router, or by one of our own. Such a
            stamp says when a sample came by, and a backlog that a stalled link lets go would look
            fresh. (A stamp over 500 ms ahead of our clock is replaced by one of ours, too.)
        """
        if timestamp is None or stamper(timestamp) in self._stampers:
            return None
        return timestamp.get_time_as_ntp64().as_nanos()

    def _changed(self, batch: list[Transported], _lost: int) -> None:
        changes = [change for session, event in batch if (change := self._change(session, event))]
        self._update_stampers()
        if changes:
            for watcher in self._watchers:
                watcher(changes)

    def _change(
        self, session: zenoh.Session, event: zenoh.TransportEvent
    ) -> NeighbourChange | None:
        zid = str(event.transport.zid)
        if event.kind == zenoh.SampleKind.DELETE:
            gone = self._present.pop(zid, None)
            return None if gone is None else NeighbourChange(neighbour=gone, present=False)
        if zid in self._present:
            return None
        address = next((link.dst for link in session.info.links() if str(link.zid) == zid), "")
        neighbour = Neighbour(zid=zid, kind=str(event.transport.whatami), address=address)
        self._present[zid] = neighbour
        return NeighbourChange(neighbour=neighbour, present=True)

    def _update_stampers(self) -> None:
        routers = {stamp_id(each.zid) for each in self.now() if each.kind == "router"}
        self._stampers = self._own | routers


def stamp_id(zid: str) -> int:
    """A Zenoh id as a number, to be compared with :func:`stamper`."""
    return int(zid, 16)


def stamper(timestamp: zenoh.Timestamp) -> int:
    """The id of the session that made a timestamp, as a number.

    Its bytes are the little-endian form of the id that is written in hexadecimal.
    """
    return int.from_bytes(bytes(timestamp.get_id()), "little")
