"""Makes the pages ``docs/events.md`` and ``docs/status.md`` from their registries.

``python -m make.schema_files.reference_pages events`` prints one; ``make schemas`` writes
both.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from yahboomd.core.messages.status_fields import FIELDS, REFUSALS, GroupName, StatusField
from yahboomd.tools.schemas.event_kinds import EVENTS, KINDS

_EVENTS = """\
# Events

yahboomd publishes an `EventSample` on `yahboomd/events` ([bus.md](bus.md)) for each event, such as
a fault or a reset of the board. `kind` names the event, `message` explains it to people. At most
five events of one kind go out in a second; `events_suppressed` in the [status](status.md) counts
the others. A later version may add kinds: ignore those that you do not know.

`make schemas` generates this page from `yahboomd/tools/schemas/event_kinds.py`.

{kinds}

## Data
`data` has exactly these fields; an event of another kind has none. Each message below is an
`EventSample` with the types of its data, for generators: [`schemas/events/`](../schemas/README.md).

{data}
"""

_STATUS = """\
# Counters and facts of the status

`StatusSample` ([bus.md](bus.md)) has four groups: `board`, `link`, `command` and `bus`. This page
lists everything in them. `make schemas` generates it from
`yahboomd/core/messages/status_fields.py`.

A **counter** starts at 0 with the daemon, only grows, and is present in every status. A **gauge**
is any other number. A **text** is for people. If a fact may be missing, its line tells
when.

{groups}

## Why commands are refused
Each reason is a counter in `command`, and in `refused` of the account of the command's source.

{refusals}
"""

_TITLES: dict[GroupName, str] = {
    "board": "`board`: the board",
    "link": "`link`: the serial port",
    "command": "`command`: commands, control and odometry",
    "sources": "`command.sources`: one account for each source",
    "bus": "`bus`: the Zenoh session and the local socket",
}


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---" for _ in head], *rows]
    return "\n".join(f"| {' | '.join(line)} |".replace("|  |", "| |") for line in lines)


def events_page() -> str:
    """The page of all kinds of events."""
    kinds = _table(
        ("kind", "severity", "published when", "`data`"),
        (
            (
                f"`{kind}`",
                ", ".join(info.severities),
                info.when,
                f"[{info.message.__name__}](#{info.message.__name__.lower()})" if info.data else "",
            )
            for kind, info in KINDS.items()
        ),
    )
    return _EVENTS.format(kinds=kinds, data="\n\n".join(map(_data, EVENTS)))


def _data(name: str) -> str:
    info = next(info for info in KINDS.values() if info.message is EVENTS[name])
    assert info.data is not None
    definitions = msgspec.json.schema(info.data)["$defs"]
    fields: dict[str, Any] = definitions[info.data.__name__]["properties"]
    kinds = ", ".join(f"`{k}`" for k, each in KINDS.items() if each.message is EVENTS[name])
    rows = ((f"`{field}`", _type(found), found["description"]) for field, found in fields.items())
    return f"### {name}\nKinds: {kinds}.\n\n{_table(('field', 'type', ''), rows)}"


def _type(found: dict[str, Any]) -> str:
    branches = found.get("anyOf", [found])
    return " or ".join(
        "text" if "enum" in b or b["type"] == "string" else b["type"] for b in branches
    )


def status_page() -> str:
    """The page of every counter and fact of the status."""
    groups = "\n\n".join(f"## {title}\n{_group(name)}" for name, title in _TITLES.items())
    refusals = _table(
        ("reason", "the command is refused because"),
        ((f"`{name}`", words) for name, words in REFUSALS.items()),
    )
    return _STATUS.format(groups=groups, refusals=refusals)


def _group(name: GroupName) -> str:
    fields = [
        f for f in FIELDS if f.group == name and (name != "command" or f.name not in REFUSALS)
    ]
    rows = ((f"`{field.name}`", field.kind, field.unit, _meaning(field)) for field in fields)
    return _table(("name", "kind", "unit", "meaning"), rows)


def _meaning(field: StatusField) -> str:
    per = f"; a map by {field.per}" if field.per else ""
    absent = f"; missing while {field.absent}" if field.absent else ""
    return f"{field.meaning}{per}{absent}"


PAGES = {"events": events_page, "status": status_page}


if __name__ == "__main__":
    sys.stdout.write(PAGES[sys.argv[1]]())
