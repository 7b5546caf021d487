"""What a client reads of the native plane: samples in JSON or MessagePack, by their first byte.

The daemon decides the encoding; a client takes either, and a payload that it cannot read is
a value, not an error: it may come from another version, or from somebody else.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TypeVar

import msgspec
from msgspec import structs

from yahboomd.messages.codecs import encoding_of
from yahboomd.messages.native import EventSample, ServiceReply, StatusSample
from yahboomd.program import pasteable, plain

Message = TypeVar("Message", bound=msgspec.Struct)

# Also what msgspec raises for text that is no UTF-8 (a ValueError), and for brackets without end.
_BROKEN = (ValueError, RecursionError, OverflowError)

_FOR_PEOPLE: dict[type[msgspec.Struct], str] = {
    StatusSample: "why",
    EventSample: "message",
    ServiceReply: "message",
}
"""Texts for people, with commands that they paste, which any client of the bus may have written."""


def read_sample(payload: bytes, message: type[Message]) -> Message | None:
    """A sample as the message that its key carries; None where the bytes are no such message.

    Args:
        payload: What arrived.
        message: The message's type, such as ``PoseSample``. Unknown fields are ignored.
    """
    encoding = encoding_of(payload)
    if encoding not in {"json", "msgpack"}:
        return None
    try:
        sample = _decoder(encoding == "json", message)(payload)
    except _BROKEN:
        return None
    if not isinstance(sample, message):
        return None
    if (field := _FOR_PEOPLE.get(message)) is not None:
        sample = structs.replace(sample, **{field: pasteable(plain(getattr(sample, field)))})
    return sample


@cache
def _decoder(json: bool, message: type[msgspec.Struct]) -> Callable[[bytes], msgspec.Struct]:
    if json:
        return msgspec.json.Decoder(message).decode
    return msgspec.msgpack.Decoder(message).decode
