"""Asks a daemon for samples, and prints payloads as one line of JSON."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TypeVar

import msgspec

from yahboomd.client.streams import read_sample
from yahboomd.core.errors import NoDaemon, Refused
from yahboomd.core.messages.codecs import encoding_of
from yahboomd.core.messages.native import ServiceReply

if TYPE_CHECKING:
    from yahboomd.client import AsyncRobot

Message = TypeVar("Message", bound=msgspec.Struct)


async def newest(robot: AsyncRobot, key: str, message: type[Message]) -> tuple[bytes, Message]:
    """The newest sample of a key: its payload, and the message in it.

    Raises:
        NoDaemon: No daemon answers.
        Refused: There is no such sample yet; the message is the daemon's.
    """
    payloads = await robot.ask(key)
    if not payloads:
        raise NoDaemon("The daemon is there and does not answer.", remedy="Is it busy? Try again.")
    if len(payloads) > 1:
        print(
            f"yahboomd: {len(payloads)} daemons answer on {key}: this is the answer "
            "of the first. Each robot needs a namespace of its own.",
            file=sys.stderr,
        )
    # The fields of samples and replies differ, so one is never read as the other.
    if (sample := read_sample(payloads[0], message)) is not None:
        return payloads[0], sample
    reply = read_sample(payloads[0], ServiceReply)
    raise Refused("An answer came that cannot be read." if reply is None else reply.message)


def one_line(payload: bytes) -> str:
    """A JSON or MessagePack payload as JSON without line breaks."""
    if encoding_of(payload) == "msgpack":
        return msgspec.json.encode(msgspec.msgpack.decode(payload)).decode()
    return msgspec.json.format(payload, indent=-1).decode()
