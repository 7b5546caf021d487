"""Who a program is, in a fleet: the name in a person's file of `yahboomd fleet`, and its key."""

from __future__ import annotations

import json
from pathlib import Path

import zenoh

from yahboomd.core.bus import keys
from yahboomd.core.bus.options import file_text
from yahboomd.core.names import name_problem

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
