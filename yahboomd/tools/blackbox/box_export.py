"""Exports a black box as MCAP: bytes, commands, decisions and events by the wall clock."""

from __future__ import annotations

import json
import os
import secrets
from functools import cache
from pathlib import Path

import msgspec

from yahboomd.blackbox import records
from yahboomd.blackbox.box_file import Box
from yahboomd.core.bus import keys
from yahboomd.core.errors import Refused
from yahboomd.core.messages.native import EventSample, event_sample
from yahboomd.tools.blackbox.box_story import wall_clock
from yahboomd.tools.record.mcap_files import Channel, McapFiles
from yahboomd.tools.schemas.message_schema import schema

RECEIVED = "yahboomd/blackbox/received"
WRITTEN = "yahboomd/blackbox/written"
COMMANDS = "yahboomd/blackbox/commands"
DECISIONS = "yahboomd/blackbox/decisions"
LINK = "yahboomd/blackbox/link"


class PortBytes(msgspec.Struct, frozen=True, kw_only=True):
    """Bytes of the serial port, in hexadecimal and as text."""

    hex: str
    text: str


class PortChange(msgspec.Struct, frozen=True, kw_only=True):
    """A change of the serial port: opened, identified or closed."""

    what: str
    port: str = ""
    dialect: str = ""


def export(box: Box, path: Path) -> int:
    """Write a box as an MCAP file; returns its messages.

    Args:
        path: A new file. It appears only once it is complete.

    Raises:
        Refused: The file exists, or it cannot be written.
    """
    if path.exists():
        raise Refused(f"{path} is there already. Name a new file.")
    unfinished = f".{path.name}-{secrets.token_hex(4)}"
    facts = {
        "config": json.dumps(box.header.config),
        "version": box.header.version,
        "saved": ", ".join(box.header.saved.reasons) if box.header.saved else "",
    }
    wall_clock_ns = wall_clock(box)
    files = McapFiles(path.parent, unfinished, facts=facts)
    made = path.parent / f"{unfinished}_0.mcap"
    try:
        try:
            for number, record in enumerate(box.records):
                if (found := _message(record.meaning, wall_clock_ns(record.at_ns))) is None:
                    continue
                channel, data, at_ns = found
                files.write(channel, data, logged_ns=at_ns, published_ns=at_ns, sequence=number)
            files.end()
            if not files.messages:
                raise Refused("This black box is empty: nothing was written.")
            os.rename(made, path)
        finally:
            made.unlink(missing_ok=True)
    except OSError as error:
        raise Refused(f"{path} cannot be written: {error.strerror}.") from error
    return files.messages


def _message(meaning: records.Meaning, at_ns: int) -> tuple[Channel, bytes, int] | None:
    at_ns = max(0, at_ns)
    message: msgspec.Struct
    match meaning:
        case records.Received() | records.Written():
            key = RECEIVED if isinstance(meaning, records.Received) else WRITTEN
            text = meaning.data.decode("ascii", "replace")
            message = PortBytes(hex=meaning.data.hex(), text=text)
        case records.CommandRecord():
            key, message = COMMANDS, meaning
        case records.DecisionRecord():
            key, message = DECISIONS, meaning
        case records.Opened():
            key, message = LINK, PortChange(what="opened", port=meaning.port)
        case records.Identified():
            key, message = LINK, PortChange(what="identified", dialect=meaning.dialect)
        case records.Closed():
            key, message = LINK, PortChange(what="closed")
        case records.Happened():
            sample = event_sample(meaning.event, stamp_ns=at_ns)
            return _events(), msgspec.json.encode(sample), at_ns
        case _:
            return None
    return _channel(key, type(message)), msgspec.json.encode(message), at_ns


@cache
def _channel(key: str, message: type[msgspec.Struct]) -> Channel:
    generated = msgspec.json.schema(message)
    own = generated["$defs"].pop(message.__name__)
    # Readers of MCAP expect the type at the top level.
    text = json.dumps({**own, "type": "object"})
    return Channel(key, "json", f"yahboomd.{message.__name__}", "jsonschema", text)


@cache
def _events() -> Channel:
    text = json.dumps({"type": "object", **schema(EventSample)})
    return Channel(keys.EVENTS, "json", "EventSample", "jsonschema", text)
