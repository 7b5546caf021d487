"""Presence: liveliness tokens, and the sessions that this one is connected to."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeAlias

import msgspec
import zenoh
from zenoh.handlers import Callback

from yahboomd.core.bus.inbox import Inbox, SampleLane


class TokenChange(msgspec.Struct, frozen=True, kw_only=True):
    """A token came (``present``) or went; ``key`` is in full, namespace included."""

    key: str
    present: bool


class Token:
    """A liveliness token of our own. Made by ``Bus.token``."""

    def __init__(self, key: str) -> None:
        self.key = key
        # A token without a reference is undeclared when it is collected.
        self._tokens: list[zenoh.LivelinessToken] = []

    def attach(self, session: zenoh.Session) -> None:
        self._tokens.append(session.liveliness().declare_token(self.key))


NAMED_MOST = 4
"""The most clients that are named as possible senders; of more the number is given."""

MOST_TOKENS = 256
"""Tokens that a watch keeps; more are counted. Any client may declare any number of them."""

LONGEST_KEY = 512
"""Characters of a token's key; a token with a longer one is only counted."""


class TokenWatch:
    """Tokens that match a pattern. Made by ``Bus.watch_tokens``.

    Zenoh's threads keep the present tokens, so that no change is lost on the way to the loop, which
    compares them with its last report.
    """

    def __init__(
        self, pattern: str, handler: Callable[[list[TokenChange]], None], inbox: Inbox
    ) -> None:
        self.ignored = 0
        """Tokens that were not kept because there were too many or their keys were too long."""
        self._pattern = pattern
        self._handler = handler
        self._lane: SampleLane[None] = inbox.lane(self._compare, depth=1)
        self._subscribers: list[zenoh.Subscriber[None]] = []
        # A token is present while any session sees it.
        self._present: dict[str, frozenset[int]] = {}
        self._reported = set[str]()
        self._lock = threading.Lock()

    def attach(self, session: zenoh.Session) -> None:
        """Watch this session too; existing tokens come first."""
        index = len(self._subscribers)

        def changed(sample: zenoh.Sample) -> None:
            self.note_token(
                str(sample.key_expr), index, present=sample.kind == zenoh.SampleKind.PUT
            )

        self._subscribers.append(
            session.liveliness().declare_subscriber(
                self._pattern, Callback(changed, indirect=False), history=True
            )
        )

    def note_token(self, key: str, session: int, *, present: bool) -> None:
        """Note that a session saw a token come or go; from any thread."""
        with self._lock:
            seen = self._present.get(key, frozenset())
            if not present:
                seen = seen - {session}
            elif seen or (len(self._present) < MOST_TOKENS and len(key) <= LONGEST_KEY):
                seen = seen | {session}
            else:
                self.ignored += 1
                return
            if seen:
                self._present[key] = seen
            else:
                self._present.pop(key, None)
        self._lane.offer(None)

    def _compare(self, _batch: list[None], _merged: int) -> None:
        with self._lock:
            present = set(self._present)
        gone = [TokenChange(key=key, present=False) for key in sorted(self._reported - present)]
        come = [TokenChange(key=key, present=True) for key in sorted(present - self._reported)]
        self._reported = present
        if changes := gone + come:
            self._handler(changes)


class Neighbour(msgspec.Struct, frozen=True, kw_only=True):
    """A session at the other end of a connection.

    Attributes:
        kind: ``router``, ``peer`` or ``client``.
        address: Its end of the connection, such as ``tcp/127.0.0.1:7447``; empty when unknown.
    """

    zid: str
    kind: str
    address: str = ""


def senders(neighbours: tuple[Neighbour, ...]) -> str:
    """The possible senders of something without a name: Zenoh does not tell which one it is."""
    near = [each.address or each.zid for each in neighbours]
    match near:
        case []:
            return ""
        case [one]:
            return f", from {one}"
        case [*some] if len(some) <= NAMED_MOST:
            return f", from one of {', '.join(some)}"
    return f", from one of {len(near)} clients"


class NeighbourChange(msgspec.Struct, frozen=True, kw_only=True):
    """A connection was made (``present``) or lost."""

    neighbour: Neighbour
    present: bool


Transported: TypeAlias = tuple[int, str, str, bool]
"""The number of a session of ours, the id and the kind of the one at the other end of a connection,
and whether the connection was made or lost."""


class Neighbours:
    """The sessions that are connected now, kept from Zenoh's transport events."""

    def __init__(self) -> None:
        self._lane: SampleLane[Transported] | None = None
        # One may be connected to both of our sessions; it is gone when it is connected to none.
        self._present: dict[str, Neighbour] = {}
        self._seen_by: dict[str, set[int]] = {}
        self._sessions: list[zenoh.Session] = []
        self._watchers: list[Callable[[list[NeighbourChange]], None]] = []
        self._own = frozenset[int]()
        self._stampers = frozenset[int]()

    def begin(self, inbox: Inbox) -> None:
        self._lane = inbox.lane(self._changed, depth=1024)

    def attach(self, session: zenoh.Session) -> None:
        self._own |= {stamp_id(str(session.zid()))}
        self._update_stampers()
        index = len(self._sessions)
        self._sessions.append(session)
        if (lane := self._lane) is None:
            return

        def changed(event: zenoh.TransportEvent) -> None:
            transport = event.transport
            made = event.kind == zenoh.SampleKind.PUT
            lane.offer((index, str(transport.zid), str(transport.whatami), made))

        session.info.declare_transport_events_listener(
            Callback(changed, indirect=False), history=True
        )

    def watch(self, watcher: Callable[[list[NeighbourChange]], None]) -> None:
        self._watchers.append(watcher)

    def now(self) -> tuple[Neighbour, ...]:
        return tuple(self._present.values())

    def sent_ns(self, timestamp: zenoh.Timestamp | None) -> int | None:
        """The time at which the sender sent a sample, in Unix nanoseconds of its clock.

        Returns:
            None if the sender gave none. A sample without a stamp is stamped by the first session
            that stamps at all: by the nearest router, or by one of our own. Such a stamp is the
            time at which the sample passed, and a backlog behind a stalled link would look
            fresh. (A stamp over 500 ms ahead of our clock is replaced by one of ours, too.)
        """
        if timestamp is None or stamper(timestamp) in self._stampers:
            return None
        return timestamp.get_time_as_ntp64().as_nanos()

    def _changed(self, batch: list[Transported], lost: int) -> None:
        events = [*batch, *self._missed()] if lost else batch
        changes = [change for event in events if (change := self._change(*event))]
        self._update_stampers()
        if changes:
            for watcher in self._watchers:
                watcher(changes)

    def _missed(self) -> list[Transported]:
        """The changes that were lost, found from the present connections."""
        missed = list[Transported]()
        for index, session in enumerate(self._sessions):
            now = {str(each.zid): str(each.whatami) for each in session.info.transports()}
            missed += [(index, zid, kind, True) for zid, kind in now.items()]
            known = [zid for zid, sessions in self._seen_by.items() if index in sessions]
            missed += [(index, zid, "", False) for zid in known if zid not in now]
        return missed

    def _change(self, index: int, zid: str, kind: str, made: bool) -> NeighbourChange | None:
        seen_by = self._seen_by.setdefault(zid, set())
        if not made:
            seen_by.discard(index)
            if seen_by:
                return None
            del self._seen_by[zid]
            gone = self._present.pop(zid, None)
            return None if gone is None else NeighbourChange(neighbour=gone, present=False)
        seen_by.add(index)
        if zid in self._present:
            return None
        links = self._sessions[index].info.links()
        address = next((link.dst for link in links if str(link.zid) == zid), "")
        neighbour = Neighbour(zid=zid, kind=kind, address=address)
        self._present[zid] = neighbour
        return NeighbourChange(neighbour=neighbour, present=True)

    def _update_stampers(self) -> None:
        routers = {stamp_id(each.zid) for each in self.now() if each.kind == "router"}
        self._stampers = self._own | routers


def stamp_id(zid: str) -> int:
    return int(zid, 16)


def stamper(timestamp: zenoh.Timestamp) -> int:
    """The id of the session that made a timestamp, as a number.

    Its bytes are the little-endian form of the id that is written in hexadecimal.
    """
    return int.from_bytes(bytes(timestamp.get_id()), "little")
