"""Writes ``schemas/`` from the Structs: schemas and samples for programs in other languages.

``python -m make.schema_files.generate FOLDER`` writes them; ``--check`` compares, lists the
differences, and exits with 1 if there are any. Equal Structs give equal bytes.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from make.schema_files import cdr_samples, event_samples, move_samples, samples
from yahboomd.core.messages import codecs
from yahboomd.tools.schemas.event_kinds import EVENTS, KINDS
from yahboomd.tools.schemas.message_schema import schema

PLAIN = {**samples.NATIVE, **move_samples.SAMPLES}
"""The golden samples of all messages but events with data."""

_README = """\
# Schemas and golden samples

For programs in any language that talk to yahboomd over Zenoh. The keys, and their timing, are in
[`docs/bus.md`](../docs/bus.md). Everything here is generated, and checked by a test:

    make schemas          # write
    make schemas-check    # compare

| where | what |
|---|---|
| `<Message>.json` | its JSON Schema (draft 2020-12): fields, types, units |
| `events/<Message>.json` | an `EventSample` of kinds that carry `data`, with its types |
| `samples/json/<Message>.json` | an example, byte for byte as it travels in JSON |
| `samples/msgpack/<Message>.bin` | the same example in MessagePack |
| `samples/cdr/<Type>.bin` | an example of a ROS 2 message in CDR, with its four-byte header |
| `samples/cdr/<Type>.json` | its type and its values (`"NaN"` stands for not-a-number) |
| `samples/refused.json` | velocity commands that are refused, as hexadecimal bytes, and why |

## How to use them
1. Generate types from the schemas, or write them by hand: there are few, and they are flat but for
   `RosVelocityCommand`, the groups of counters in `StatusSample`, and the `data` of events and
   replies.
2. Test the decoder: `samples/msgpack/X.bin` must decode to the values of `samples/json/X.json`, and
   `samples/cdr/X.bin` to the `values` of `samples/cdr/X.json`.
3. Test the encoder by meaning, not by bytes: the order of fields, white space, and how wide a
   MessagePack number is are free. Fields with a default may be left out.
4. Ignore fields that you do not know. A message changes by growing fields; anything else would be
   a new message. A field that is not `required` may be absent: that means "not known".
5. Take a word that you do not know (`state`, `severity`, `kind`) as text: sets of words grow, too,
   so the schemas have no list of them. In a state that you do not know the robot may not drive.

## What to know
- Which encoding a sample has is its Zenoh Encoding, with the message's name behind a semicolon,
  such as `{example}`: {encodings}.
  Each key carries one type in one encoding.
- The first byte of what you send tells its encoding: `{{` (after white space) is JSON, 80-8f, de
  or df a MessagePack map, 00 CDR. At most {limit} bytes are read.
- Numbers are SI: metres, radians, m/s, rad/s. `stamp_ns` is Unix time in nanoseconds and needs 64
  bits; in JavaScript read it as a BigInt, or lose the last three digits.
- A JSON or MessagePack number is finite: NaN and infinities are refused. Integers are welcome
  for a schema's number.
- In CDR both byte orders are read, and little-endian is written.

## The messages
| schema | meaning |
|---|---|
{messages}

| event with data | its `kind`s |
|---|---|
{events}

| ROS 2 sample | type | bytes |
|---|---|---|
{types}
"""


def generated() -> dict[str, bytes]:
    """Every file below the folder, by its path with forward slashes."""
    files = {"README.md": _readme().encode()}
    for folder, messages in (("", PLAIN), ("events/", event_samples.SAMPLES)):
        for name, message in messages.items():
            files[f"{folder}{name}.json"] = _pretty(schema(type(message)))
            files[f"samples/json/{folder}{name}.json"] = codecs.encode(message, "json")
            files[f"samples/msgpack/{folder}{name}.bin"] = codecs.encode(message, "msgpack")
    for name, sample in cdr_samples.CDR.items():
        files[f"samples/cdr/{name}.bin"] = sample.payload
        files[f"samples/cdr/{name}.json"] = _pretty(
            {"type": sample.ros_type, "values": _without_nan(sample.values)}
        )
    refused = {
        name: {"reason": sample.reason, "payload": sample.payload.hex()}
        for name, sample in samples.REFUSED.items()
    }
    files["samples/refused.json"] = _pretty(refused)
    return files


def differences(expected: Mapping[str, bytes], found: Mapping[str, bytes]) -> list[str]:
    """Missing, different and superfluous files, one line each."""
    lines: list[str] = []
    for path in sorted({*expected, *found}):
        if path not in found:
            lines.append(f"missing: {path}")
        elif path not in expected:
            lines.append(f"not generated: {path}")
        elif found[path] != expected[path]:
            lines.append(f"differs: {path}")
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m make.schema_files.generate")
    parser.description = "Write JSON Schemas and golden samples of every message."
    parser.add_argument("folder", type=Path, help="their folder, such as schemas")
    parser.add_argument("--check", action="store_true", help="write nothing, list differences")
    options = parser.parse_args(arguments)
    folder: Path = options.folder
    files = generated()
    if not options.check:
        for path, content in files.items():
            target = folder / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
    found = {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }
    lines = differences(files, found)
    for line in lines:
        sys.stdout.write(f"{line}\n")
    if lines:
        sys.stdout.write("run: make schemas\n")
    return 1 if lines else 0


def _pretty(value: object) -> bytes:
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
    return f"{text}\n".encode()


def _without_nan(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return "NaN" if isinstance(value, float) and math.isnan(value) else value


def _kinds(event: str) -> str:
    return ", ".join(f"`{k}`" for k, info in KINDS.items() if info.message is EVENTS[event])


def _readme() -> str:
    meanings = {
        name: schema(type(message))["description"].partition("\n")[0]
        for name, message in PLAIN.items()
    }
    return _README.format(
        encodings=", ".join(f"`{name}`" for name in codecs.MEDIA_TYPES.values()),
        example=codecs.encoding_name("PoseSample", "json"),
        limit=codecs.MAX_PAYLOAD_BYTES,
        messages="\n".join(f"| [`{n}`]({n}.json) | {text} |" for n, text in meanings.items()),
        events="\n".join(
            f"| [`{name}`](events/{name}.json) | {_kinds(name)} |" for name in event_samples.SAMPLES
        ),
        types="\n".join(
            f"| `{name}` | `{sample.ros_type}` | {len(sample.payload)} |"
            for name, sample in cdr_samples.CDR.items()
        ),
    )


if __name__ == "__main__":
    sys.exit(main())
