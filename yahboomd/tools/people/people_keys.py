"""The keys of a fleet's people: each has some that nobody else may use. Pure.

The access rules refuse a person every other one's keys, so a key makes the name in it true.
"""

from __future__ import annotations

import re

from yahboomd.core.bus import keys
from yahboomd.core.bus.keys import own_key

NAMED = (keys.ESTOP, keys.ESTOP_RESET, keys.ODOMETRY_RESET, keys.ODOMETRY_SET_POSE)
"""The services that each person has a key of."""

PLACES = frozenset({"teleop", "web", "moves"})
"""Names of sources that are no person's: the robot's own joystick, its page, its moves."""

_SOURCE = re.compile(r"cmd_vel/([a-z0-9][a-z0-9_-]*)")


def person_of(source: str) -> str:
    """The name in a person's source; empty for any other source."""
    found = _SOURCE.fullmatch(source)
    return "" if found is None or found[1] in PLACES else found[1]


def own_stop(person: str) -> str:
    """Who engaged an emergency stop, if the key proves it.

    It is longer than a name that a payload can claim: nobody can claim this one.
    """
    return f"{person}, by a key that is this person's alone ({own_key(keys.ESTOP, person)})"


_ENGAGED = re.compile(r"Emergency stop,? engaged by (?P<by>.*)")
_NO_NAME = ("a sample on ", "a query on ", "the local socket ", "`yahboomd stop` (")
"""What the daemon itself writes if it was told no name."""


def claims_a_name(why: str) -> bool:
    """Whether the reason of an emergency stop has a name that nothing but the request claims."""
    found = _ENGAGED.match(why)
    if found is None or found["by"].startswith(_NO_NAME):
        return False
    return not found["by"].startswith(own_stop(found["by"].partition(",")[0]))
