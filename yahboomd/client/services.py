"""Asks the daemon's services, in a person's name where one is proven, and combines the answers."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from yahboomd.client.commanding import Commands
from yahboomd.client.connection import Connection
from yahboomd.client.streams import read_sample
from yahboomd.core.bus import keys
from yahboomd.core.bus.alarms import READ_BYTES
from yahboomd.core.bus.blocking import bounded
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import file_text
from yahboomd.core.errors import Refused
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import EstopRequest, ServiceReply, SetPoseRequest
from yahboomd.core.names import name_problem


class RobotServices:
    """The services of a robot's daemon, and the names under which a client asks them."""

    _connection: Connection
    _commands: Commands
    _person: str
    _label: str

    @property
    def bus(self) -> Bus:
        """The session itself, for keys that have no method here.

        Raises:
            NoDaemon: It is not open.
        """
        return self._connection.bus

    async def ask(
        self, key: str, payload: bytes = b"{}", *, timeout_s: float = 1.5, urgent: bool = False
    ) -> list[bytes]:
        """Query any key below the namespace; the payload of each answer."""
        bus = self.bus
        return await ask(bus.session, bus.key(key), payload, timeout_s=timeout_s, urgent=urgent)

    async def request(
        self, key: str, payload: bytes = b"{}", *, timeout_s: float = 1.5, urgent: bool = False
    ) -> Answer:
        """Ask a service; return the outcome, also if it refuses."""
        return read_answers(await self.ask(key, payload, timeout_s=timeout_s, urgent=urgent))

    async def call(
        self, key: str, payload: bytes = b"{}", *, timeout_s: float = 1.5, urgent: bool = False
    ) -> Answer:
        """Ask a service; return the outcome, or raise if it is not done.

        Raises:
            NoDaemon: No daemon answers within ``timeout_s`` seconds.
            Refused: A daemon refused; the message has the reason.
        """
        return self._done(await self.request(key, payload, timeout_s=timeout_s, urgent=urgent))

    async def ask_by_name(self, key: str, payload: bytes = b"{}") -> tuple[list[bytes], str]:
        """Query a service that changes something; in a fleet by the key that proves who asks.

        The name is that of the person's file (``zenoh_file``). If no daemon answers on this key,
        the common one is asked. The emergency stop waits for no answer: it is asked for on both
        keys at once.

        Returns:
            The payload of each answer, and a sentence if they prove no name although there is one.
        """
        stops = key == keys.ESTOP
        if not self._person:
            return await self.ask(key, payload, urgent=stops), ""
        own = keys.own_key(key, self._person)
        if stops:
            bus = self.bus
            in_full = (bus.key(own), bus.key(key))
            named, common = await ask_urgently(bus.session, in_full, payload)
        else:
            named = await self.ask(own, payload)
            common = [] if named else await self.ask(key, payload)
        unproven = ""
        if len(named) < len(common):
            which = "not every daemon" if named else "nothing"
            unproven = f"Asked without a proven name: {which} answers on {own}."
        return which_count(named, common), unproven

    async def request_by_name(self, key: str, payload: bytes = b"{}") -> Answer:
        """Ask as :meth:`ask_by_name` does; the message tells if no name is proven."""
        payloads, unproven = await self.ask_by_name(key, payload)
        answer = read_answers(payloads)
        words = f"{answer.message} {unproven}".rstrip()
        return msgspec.structs.replace(answer, message=words)

    def _done(self, answer: Answer) -> Answer:
        if not answer.answered:
            raise self._connection.no_daemon()
        if not answer.success:
            raise Refused(answer.message)
        return answer

    async def estop(self, by: str = "") -> str:
        """Engage the emergency stop of every daemon there; it stays until :meth:`release`.

        Args:
            by: Who or what asks, for people. Default: the client's label, else the name and the
                number of this process.

        Returns:
            The daemon's acknowledgement.

        Raises:
            NoDaemon: No daemon acknowledged it. Switch the motors' supply off.
            Refused: A daemon answered that it did not engage, or could not send it to the board.
        """
        if self._commands.commanded is not None:
            self._commands.stop(None)
        payload = estop_payload(by or self._label)
        return self._done(await self.request_by_name(keys.ESTOP, payload)).message

    async def release(self) -> str:
        """Release the emergency stop, and clear a fault; returns the daemon's words.

        Raises:
            NoDaemon: No daemon answers.
            Refused: A source commanded motion within the last second.
        """
        return self._done(await self.request_by_name(keys.ESTOP_RESET)).message

    async def reset_odometry(self) -> str:
        """Make the pose zero; returns the daemon's words."""
        return self._done(await self.request_by_name(keys.ODOMETRY_RESET)).message

    async def set_pose(
        self, x: float, y: float, theta: float, *, covariance: Sequence[float] | None = None
    ) -> str:
        """Make odometry continue from this pose; returns the daemon's words.

        Args:
            x: Metres.
            y: Metres.
            theta: Radians, counter-clockwise.
            covariance: Nine numbers over (x, y, theta), row by row; None: known exactly.

        Raises:
            Refused: A number is out of range, or the covariance is not a valid one.
        """
        given = None if covariance is None else tuple(float(each) for each in covariance)
        wanted = SetPoseRequest(x=x, y=y, theta=theta, covariance=given)  # type: ignore[arg-type]
        payload = encode(wanted, "json")
        return self._done(await self.request_by_name(keys.ODOMETRY_SET_POSE, payload)).message

    async def config(self) -> dict[str, Any]:
        """The daemon's configuration in effect, by section and key."""
        return (await self.call(keys.CONFIG)).data

    async def board(self) -> dict[str, Any]:
        """What the daemon knows of the board: firmware, settings, problems.

        Raises:
            Refused: No board is connected.
        """
        return (await self.call(keys.BOARD)).data


def estop_payload(by: str = "") -> bytes:
    """The payload that engages the e-stop, with the name of who asks; default: this process.

    A name that is too long for the daemon is cut.
    """
    program = os.path.basename(sys.argv[0]) if sys.argv else ""
    named = program not in {"", "-c"}
    by = by or f"{program if named else 'python'} (pid {os.getpid()})"
    while len(payload := encode(EstopRequest(by=by), "json")) > READ_BYTES:
        by = by[:-1]
    return payload


GRACE_S = 0.5
"""A query that has not ended this long after its own timeout never will."""


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a request.

    Attributes:
        success: Whether every daemon that answered did it.
        message: The daemon's report of success, or its reason against it; a sentence of ours if no
            daemon answered.
        answered: How many daemons answered.
        data: The values that the first of them returned, by name.
    """

    success: bool
    message: str
    answered: int
    data: dict[str, Any] = {}


async def ask(
    session: zenoh.Session,
    key: str,
    payload: bytes = b"{}",
    *,
    timeout_s: float = 1.5,
    urgent: bool = False,
) -> list[bytes]:
    """Query a key at every daemon, off the event loop.

    Args:
        key: The key in full.
        payload: The request. Its encoding is also that of the answer.
        urgent: Overtakes other messages on the way.

    Returns:
        The payload of each answer; empty if no daemon answers in time.
    """

    def get() -> list[bytes]:
        return list(_payloads(_query(session, key, payload, timeout_s, urgent)))

    try:
        return await bounded(get, timeout_s=timeout_s + GRACE_S, name="client-ask")
    except (TimeoutError, zenoh.ZError):
        return []


async def ask_urgently(
    session: zenoh.Session, keys_in_full: Sequence[str], payload: bytes, *, timeout_s: float = 1.5
) -> list[list[bytes]]:
    """Query several keys at once, urgently, off the event loop.

    They go out together and arrive in this order. A key that nothing knows, or that an access rule
    drops, keeps no other one from being asked or answered.

    Returns:
        For each key the payload of each answer.
    """
    found: list[list[bytes]] = [[] for _ in keys_in_full]

    def get() -> None:
        asked = []
        for key, payloads in zip(keys_in_full, found, strict=True):
            with suppress(zenoh.ZError):
                asked.append((_query(session, key, payload, timeout_s, urgent=True), payloads))
        # The last one's first: a query that nothing answers may end with its timeout.
        for replies, payloads in reversed(asked):
            payloads.extend(_payloads(replies))

    with suppress(TimeoutError):
        await bounded(get, timeout_s=timeout_s + GRACE_S, name="client-ask")
    return [list(each) for each in found]


def which_count(named: list[bytes], common: list[bytes]) -> list[bytes]:
    """Of one request by a person's key and by the common one, the answers that count.

    Those by the person's key, unless not every daemon gave one, or one refused.
    """
    if len(named) < len(common):
        return common
    # What was refused on one key and done on the other was done.
    return common if common and not read_answers(named).success else named


def _query(
    session: zenoh.Session, key: str, payload: bytes, timeout_s: float, urgent: bool
) -> Iterable[zenoh.Reply]:
    return session.get(
        key,
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


def _payloads(replies: Iterable[zenoh.Reply]) -> Iterator[bytes]:
    return (reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None)


def silence_of(payloads: list[bytes], source: str) -> float | None:
    """How long daemons wait for a source before they stop the robot, by their configurations.

    Returns:
        Seconds, the shortest of several daemons; None if no answer has it.
    """
    found = list[float]()
    for payload in payloads:
        command = _group((read_sample(payload, ServiceReply) or _NOTHING).data, "command")
        own = _group(_group(command, "sources"), source).get("timeout_s")
        silence_s = own if own is not None else command.get("timeout_s")
        if isinstance(silence_s, int | float) and silence_s > 0.0:
            found.append(float(silence_s))
    return min(found, default=None)


_NOTHING = ServiceReply(success=False, message="")


def _group(facts: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = facts.get(name)
    return found if isinstance(found, Mapping) else {}


def read_answers(payloads: list[bytes]) -> Answer:
    """Combine the answers of a service; an unreadable one counts as a refusal."""
    replies = [
        read_sample(payload, ServiceReply)
        or ServiceReply(success=False, message="An answer cannot be read.")
        for payload in payloads
    ]
    if not replies:
        return Answer(success=False, message="No daemon answered.", answered=0)
    return Answer(
        success=all(reply.success for reply in replies),
        message=" ".join(dict.fromkeys(reply.message for reply in replies)),
        answered=len(replies),
        data=dict(replies[0].data),
    )


FLEET = "yahboomd_fleet"
"""The name of a person's list of robots in ``metadata`` of the file, which Zenoh ignores."""


def own_source(person: str) -> str:
    """The key on which a person commands velocities, and nobody else may."""
    return f"{keys.CMD_VEL}/{person}"


def person_in(zenoh_file: str | Path | None) -> str:
    """The name in a person's file.

    Returns:
        The name; empty without a file, and for one that is no person's: it proves no name.
    """
    if not zenoh_file:
        return ""
    try:
        listed = json.loads(
            zenoh.Config.from_json5(file_text(Path(zenoh_file))).get_json("metadata")
        )
        person = listed[FLEET]["person"]
    except (zenoh.ZError, OSError, ValueError, LookupError, TypeError):
        return ""
    good = isinstance(person, str) and person and not name_problem(own_source(person))
    return person if good else ""
