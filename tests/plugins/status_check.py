"""Holds a published status against the registry of its counters and facts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from yahboomd.core.messages.status_fields import FIELDS, REFUSALS, FieldKind

TYPES: dict[FieldKind, tuple[type, ...]] = {
    "counter": (int,),
    "gauge": (int, float),
    "text": (str,),
}


def assert_registered(status: Mapping[str, Any], sources: set[str]) -> None:
    """Nothing is missing that is present from the start, and nothing is there besides."""
    command = dict(status["command"])
    accounts = command.pop("sources")
    assert set(accounts) == sources
    found = {
        **{name: status[name] for name in ("link", "bus")},
        "command": command,
        **{f"sources {source}": account for source, account in accounts.items()},
    }
    # Without a board the group is empty.
    if status["board"]:
        found["board"] = status["board"]
    for name, group in found.items():
        fields = {each.name: each for each in FIELDS if each.group == name.partition(" ")[0]}
        assert set(group) <= set(fields), f"{name}: not registered"
        always = {each.name for each in fields.values() if not each.absent}
        assert always <= set(group), f"{name}: missing"
        for key, value in group.items():
            field = fields[key]
            for one in value.values() if field.per else (value,):
                assert isinstance(one, TYPES[field.kind]), f"{name}.{key}: {value!r}"
    assert all(account["refused"].keys() == REFUSALS.keys() for account in accounts.values())
