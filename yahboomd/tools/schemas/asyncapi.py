"""Writes ``schemas/asyncapi.json``: the bus as an AsyncAPI document, from the table of keys.

``python -m yahboomd.tools.schemas.asyncapi FOLDER`` writes it; ``--check`` compares, and exits with
1 if the file differs. The operations are yahboomd's own: it sends samples, and receives commands
and queries.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from yahboomd import RELEASE
from yahboomd.core.bus import keys
from yahboomd.core.bus.publishers import PriorityName
from yahboomd.core.config.outputs import Zenoh
from yahboomd.core.messages.codecs import MAX_PAYLOAD_BYTES, MEDIA_TYPES, encoding_name
from yahboomd.core.messages.native import EventSample, ServiceReply, StatusSample
from yahboomd.core.messages.status_fields import FIELDS
from yahboomd.ros2.ros2_topics import ROS_TOPICS
from yahboomd.tools.schemas import event_samples, move_samples, samples
from yahboomd.tools.schemas.event_kinds import EVENTS, KINDS
from yahboomd.tools.schemas.key_table import INPUTS, OFFERS, OUTPUTS, Offer

Json = dict[str, Any]

FILE = "asyncapi.json"

QUERY, TOKEN = "Query", "AliveToken"
NATIVE = [MEDIA_TYPES["json"], MEDIA_TYPES["msgpack"]]

_DESCRIPTION = """\
Every key of yahboomd on Zenoh. The rules (who drives, how old a command may be, what an emergency
stop does) are in docs/bus.md.

- `send` operations are yahboomd's samples; `receive` operations are the samples that it takes and,
  if the operation has a reply, the queries.
- With a `namespace` in the configuration every address has it in front, as in `bot1/yahboomd/pose`.
- `x-zenoh` has the QoS. Payloads are JSON, or MessagePack of the same shape with
  `encoding = "msgpack"`; the Zenoh Encoding of a sample names both, as in
  `application/json;PoseSample`. Samples to yahboomd need no Encoding.
- The keys for ROS 2 carry CDR; their names can be configured.
"""


def _reference(*path: str) -> Json:
    return {"$ref": "#/" + "/".join(path)}


def _qos(priority: PriorityName, *, blocks: bool, encodings: Iterable[str]) -> Json:
    return {
        "reliability": "reliable",
        "congestionControl": "block" if blocks else "drop",
        "priority": priority,
        "express": False,
        "encodings": list(encodings),
    }


_ANSWERS = _qos("data", blocks=True, encodings=NATIVE)


def _takes(*, cdr: bool) -> Json:
    encodings = [*NATIVE, MEDIA_TYPES["cdr"]] if cdr else NATIVE
    return {"encodings": encodings, "maxBytes": MAX_PAYLOAD_BYTES}


def _kinds(message: type[msgspec.Struct]) -> str:
    rows = [
        f"| `{kind}` | {', '.join(info.severities)} | {info.when} |"
        for kind, info in KINDS.items()
        if info.message is message
    ]
    data = "" if message.__name__ in EVENTS else "Any event. These kinds have no `data`:\n\n"
    return data + "\n".join(["| kind | severity | published when |", "|---|---|---|", *rows])


def _message(message: type[msgspec.Struct]) -> Json:
    name = message.__name__
    event = name in EVENTS
    example = {**event_samples.SAMPLES, **samples.NATIVE, **move_samples.SAMPLES}[name]
    summary = " ".join((message.__doc__ or "").split())
    made: Json = {
        "name": name,
        "title": name,
        "summary": summary,
        "contentType": MEDIA_TYPES["json"],
        "payload": {"$ref": f"./events/{name}.json" if event else f"./{name}.json"},
        "examples": [{"name": "golden sample", "payload": msgspec.to_builtins(example)}],
    }
    if event or message is EventSample:
        made["description"] = _kinds(message)
    if message is StatusSample:
        made["description"] = (
            "Its groups hold what `x-status-fields` lists. Counters are present from the first "
            "status on, start at 0 with the daemon, and only grow; `sources` is the account of "
            "one source, under `command.sources`."
        )
        made["x-status-fields"] = [msgspec.to_builtins(field) for field in FIELDS]
    return made


def _cdr(ros_type: str, part: str = "") -> Json:
    name = f"{ros_type}{part}"
    return {
        "name": name,
        "title": name,
        "summary": f"{name} of ROS 2, in CDR.",
        "contentType": MEDIA_TYPES["cdr"],
        "payload": {"type": "string", "format": "binary"},
    }


class _Document:
    """Collects channels, operations and messages."""

    def __init__(self) -> None:
        self.channels: Json = {}
        self.operations: Json = {}
        self.messages: Json = {
            QUERY: {
                "name": QUERY,
                "title": QUERY,
                "summary": "A query without a payload; one that it has is ignored.",
            },
            TOKEN: {
                "name": TOKEN,
                "title": TOKEN,
                "summary": "A liveliness token: it has no payload, and lives as long as yahboomd.",
            },
        }

    def native(self, *messages: type[msgspec.Struct]) -> list[str]:
        for message in messages:
            self.messages.setdefault(message.__name__, _message(message))
        return [message.__name__ for message in messages]

    def cdr(self, *ros_types: str, part: str = "") -> list[str]:
        names = [f"{ros_type.rpartition('/')[2]}{part}" for ros_type in ros_types]
        for name, ros_type in zip(names, ros_types, strict=True):
            self.messages.setdefault(name, _cdr(ros_type, part))
        return names

    def channel(self, key: str, messages: Iterable[str]) -> str:
        """Add messages to a key's channel, and return its id."""
        name = key.removeprefix("yahboomd/").replace("/", "_")
        made = self.channels.setdefault(name, {"address": key, "messages": {}})
        for message in messages:
            made["messages"].setdefault(message, _reference("components", "messages", message))
        return name

    def operation(
        self,
        verb: str,
        key: str,
        action: str,
        messages: Sequence[str],
        *,
        summary: str,
        zenoh: Json,
        replies: Sequence[str] = (),
        tag: str,
    ) -> None:
        channel = self.channel(key, messages)
        made: Json = {
            "action": action,
            "channel": _reference("channels", channel),
            "summary": summary,
            "tags": [{"name": tag}],
            "messages": [_reference("channels", channel, "messages", name) for name in messages],
            "x-zenoh": zenoh,
        }
        if replies:
            answer = f"{channel}_reply"
            found = self.channels.setdefault(
                answer,
                {
                    "address": None,
                    "description": f"Answers to queries on `{key}`, on the query itself.",
                    "messages": {},
                },
            )
            for name in replies:
                found["messages"].setdefault(name, _reference("components", "messages", name))
            made["reply"] = {
                "channel": _reference("channels", answer),
                "messages": [_reference("channels", answer, "messages", name) for name in replies],
            }
        self.operations[f"{verb}_{channel}"] = made


def document() -> Json:
    """The whole AsyncAPI document."""
    made = _Document()
    for key, output in {**OUTPUTS, **move_samples.OUTPUTS}.items():
        name = output.message.__name__
        encodings = [encoding_name(output.message, each) for each in ("json", "msgpack")]
        carried = (output.message, *(EVENTS.values() if key == keys.EVENTS else ()))
        made.operation(
            *("publish", key, "send", made.native(*carried)),
            summary=f"Published {output.when}.",
            zenoh=_qos("data_high", blocks=False, encodings=encodings),
            tag="published",
        )
        if key in {*keys.SAMPLES, *move_samples.OUTPUTS}:
            made.operation(
                *("get", key, "receive", [QUERY]),
                summary=f"Returns the newest {name}; before the first one a ServiceReply with "
                "the reason.",
                zenoh={"query": True, "wildcards": True, "reply": _ANSWERS},
                replies=made.native(output.message, ServiceReply),
                tag="published",
            )
    for key, entry in {**INPUTS, **move_samples.INPUTS}.items():
        made.operation(
            *("take", key, "receive"),
            [*made.native(*entry.messages), *made.cdr(*entry.ros_types)],
            summary=f"A sample {entry.does}.",
            zenoh=_takes(cdr=bool(entry.ros_types)),
            tag="commands",
        )
    for key, offer in {**OFFERS, **move_samples.OFFERS}.items():
        _offer(made, key, offer)
    for key, topic in ROS_TOPICS.items():
        made.operation(
            *("ros2", key, "send", made.cdr(topic.ros_type)),
            summary=f"Published {topic.when}, if ROS 2 is enabled.",
            zenoh={
                **_qos("data_high", blocks=False, encodings=[encoding_name(topic.ros_type, "cdr")]),
                "ros2": msgspec.to_builtins(topic.qos),
            },
            tag="ROS 2",
        )
    made.operation(
        *("declare", keys.ALIVE, "send", [TOKEN]),
        summary="Present while yahboomd runs; a second token, `yahboomd/alive/{zid}`, names its "
        "session.",
        zenoh={"liveliness": True},
        tag="published",
    )
    return _whole(made)


def _offer(made: _Document, key: str, offer: Offer) -> None:
    """A service: a query, natively or as a service of ROS 2."""
    requests = made.native(offer.request) if offer.request else [QUERY]
    replies = made.native(ServiceReply)
    if offer.ros_type:
        requests += made.cdr(offer.ros_type, part="_Request")
        replies += made.cdr(offer.ros_type, part="_Response")
    takes = _takes(cdr=bool(offer.ros_type))
    zenoh: Json = {"query": True, "wildcards": key in keys.READ_ONLY, **takes, "reply": _ANSWERS}
    if key == keys.ESTOP:
        zenoh["target"] = "all"
    made.operation(
        *("call", key, "receive", requests),
        summary=f"{offer.does[0].upper()}{offer.does[1:]}.",
        zenoh=zenoh,
        replies=replies,
        tag="services",
    )


def _whole(made: _Document) -> Json:
    endpoint = Zenoh().listen[0]
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "yahboomd",
            "version": RELEASE,
            "description": _DESCRIPTION,
            "license": {"name": "Apache-2.0"},
        },
        "defaultContentType": MEDIA_TYPES["json"],
        "servers": {
            "robot": {
                "host": endpoint.partition("/")[2],
                "protocol": "zenoh",
                "protocolVersion": "1",
                "description": f"Zenoh, for clients and peers: connect to `{endpoint}`.",
            }
        },
        "channels": made.channels,
        "operations": made.operations,
        "components": {"messages": made.messages},
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m yahboomd.tools.schemas.asyncapi")
    parser.description = "Write the AsyncAPI document of the bus."
    parser.add_argument("folder", type=Path, help="its folder, such as schemas")
    parser.add_argument("--check", action="store_true", help="write nothing, compare")
    options = parser.parse_args(arguments)
    path: Path = options.folder / FILE
    text = json.dumps(document(), indent=2, ensure_ascii=False) + "\n"
    if not options.check:
        path.write_text(text, encoding="utf-8")
    elif not path.exists() or path.read_text(encoding="utf-8") != text:
        sys.stdout.write(f"differs: {path}\nrun: {parser.prog} {options.folder}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
