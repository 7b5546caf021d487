"""Who is there: liveliness tokens, and the sessions that this one is connected to."""

from __future__ import annotations

import msgspec
import zenoh


class TokenChange(msgspec.Struct, frozen=True, kw_only=True):
    """A token came (``present``) or went; ``key`` is in full, namespace included."""

    key: str
    present: bool


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


class Neighbours:
    """The sessions that are connected now, kept from Zenoh's transport events."""

    def __init__(self) -> None:
        self._present: dict[str, Neighbour] = {}

    def now(self) -> tuple[Neighbour, ...]:
        """All that are connected, in the order in which they came."""
        return tuple(self._present.values())

    def change(
        self, session: zenoh.Session, transport: zenoh.Transport, kind: zenoh.SampleKind
    ) -> NeighbourChange | None:
        """Take an event over; on the loop.

        Returns:
            What changed, or None where the event tells nothing new.
        """
        zid = str(transport.zid)
        if kind == zenoh.SampleKind.DELETE:
            gone = self._present.pop(zid, None)
            return None if gone is None else NeighbourChange(neighbour=gone, present=False)
        if zid in self._present:
            return None
        address = next((link.dst for link in session.info.links() if str(link.zid) == zid), "")
        neighbour = Neighbour(zid=zid, kind=str(transport.whatami), address=address)
        self._present[zid] = neighbour
        return NeighbourChange(neighbour=neighbour, present=True)


def stamp_id(zid: str) -> int:
    """A Zenoh id as a number, to be compared with :func:`stamper`."""
    return int(zid, 16)


def stamper(timestamp: zenoh.Timestamp) -> int:
    """The id of the session that made a timestamp, as a number.

    Its bytes are the little-endian form of the id that is written in hexadecimal.
    """
    return int.from_bytes(bytes(timestamp.get_id()), "little")
