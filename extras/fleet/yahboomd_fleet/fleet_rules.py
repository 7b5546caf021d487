"""The access rules of a fleet: for each router and robot, the rights of each certificate.

A rule names exact keys for everything that moves a robot or changes something, so that one sample
on a wildcard drives no fleet. A stop and a reader may use wildcards.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

import msgspec
import zenoh

from yahboomd.client.services import own_source
from yahboomd.core.bus import keys
from yahboomd.core.bus.keys import own_key
from yahboomd_fleet.fleet_plan import (
    TOP,
    FleetPlan,
    Role,
    person_id,
    robot_id,
    router_id,
    stop_key,
)

READING = ("declare_subscriber", "liveliness_query", "declare_liveliness_subscriber")
EVERYTHING = (
    "put",
    "delete",
    "declare_queryable",
    "query",
    "reply",
    "liveliness_token",
    *READING,
)
"""All messages that Zenoh's access control distinguishes."""

ROLES: tuple[Role, ...] = ("viewer", "driver", "operator", "maintainer")

PERSON = "PERSON"
_MOVES = "yahboomd/moves"
_SETTING = (keys.ESTOP_RESET, keys.ODOMETRY_RESET, keys.ODOMETRY_SET_POSE)
_OUT = "everything out"
_ROBOT = "all of a robot"

AccessControl: TypeAlias = dict[str, Any]
"""The section ``access_control`` of a Zenoh file."""


class Right(msgspec.Struct, frozen=True, kw_only=True):
    """Something that a person may do to a robot.

    Attributes:
        role: The least role that has it.
        messages: Zenoh's messages for it.
        keys: Their keys, below the robot's namespace; ``PERSON`` in them stands for the person's
            name: nobody else has these.
    """

    role: Role
    messages: tuple[str, ...]
    keys: tuple[str, ...]

    def keys_of(self, person: str) -> tuple[str, ...]:
        """The keys of one person."""
        return tuple(key.replace(PERSON, person) for key in self.keys)


RIGHTS = {
    "watch": Right(role="viewer", messages=READING, keys=("**",)),
    "ask": Right(role="viewer", messages=("query",), keys=(*keys.SAMPLES, _MOVES)),
    "stop": Right(
        role="viewer", messages=("put", "query"), keys=(keys.ESTOP, own_key(keys.ESTOP, PERSON))
    ),
    "drive": Right(role="driver", messages=("put",), keys=(own_source(PERSON),)),
    "move": Right(
        role="driver",
        messages=("query",),
        keys=tuple(f"{_MOVES}/{each}" for each in ("start", "cancel", "pause", "resume")),
    ),
    "hold a move": Right(
        role="driver",
        messages=("put", "liveliness_token"),
        keys=(f"{_MOVES}/beat", f"{_MOVES}/holder/*"),
    ),
    "release and set the pose": Right(
        role="operator",
        messages=("put", "query"),
        keys=(*_SETTING, *(own_key(key, PERSON) for key in _SETTING)),
    ),
    "read the configuration": Right(
        role="maintainer", messages=("query",), keys=(*keys.READ_ONLY, keys.BLACKBOX_SAVE)
    ),
}
"""What a person may do, by its name; roles inherit downwards."""

_BY_WILDCARD = ("watch", "ask", "stop")
"""Rights that extend over the whole place of a role, by one key."""


class RuleSet:
    """Collects rules and who has them; equal ones are written once."""

    def __init__(self) -> None:
        self._rules: dict[str, dict[str, Any]] = {}
        self._has: dict[str, list[str]] = {}
        self._more: list[dict[str, Any]] = []

    def allow(
        self, who: str, name: str, messages: Iterable[str], key_exprs: Iterable[str], flow: str
    ) -> None:
        """Allow somebody some messages on some keys.

        Raises:
            ValueError: A rule of this name allows something else.
        """
        rule = {
            "id": name,
            "permission": "allow",
            "flows": [flow],
            "messages": list(messages),
            "key_exprs": list(key_exprs),
        }
        known = self._rules.setdefault(name, rule)
        if known != rule:
            raise ValueError(f"two rules are called {name!r}")
        self._has.setdefault(who, []).append(name)

    def out(self, who: str) -> None:
        """Send everything to somebody: only what was asked for goes there."""
        self.allow(who, _OUT, EVERYTHING, ["**"], "egress")

    def here(self) -> None:
        """Let the programs of this machine do everything, over plain TCP on loopback."""
        self.allow("here", "everything in", EVERYTHING, ["**"], "ingress")
        self.out("here")
        self._more.append({"id": "here", "interfaces": ["lo"], "link_protocols": ["tcp"]})

    def section(self) -> AccessControl:
        """The section for a Zenoh file."""
        more = {each["id"] for each in self._more}
        subjects = [{"id": who, "cert_common_names": [who]} for who in self._has if who not in more]
        return {
            "enabled": True,
            "default_permission": "deny",
            "rules": list(self._rules.values()),
            "subjects": subjects + self._more,
            "policies": [{"rules": rules, "subjects": [who]} for who, rules in self._has.items()],
        }


def router_rules(plan: FleetPlan, site: str, without: Iterable[str] = ()) -> AccessControl:
    """The rules of a router: that of a site, or with an empty name the one above all sites.

    Args:
        without: The names of revoked certificates.
    """
    rules, gone = RuleSet(), set(without)
    if site:
        if plan.router and TOP not in gone:
            rules.out(TOP)
            rules.allow(TOP, "all of the fleet", EVERYTHING, [f"{plan.fleet}/**"], "ingress")
        for robot in plan.robots_at(site):
            if (who := robot_id(robot)) not in gone:
                rules.out(who)
                _own(rules, who, plan.namespace(robot))
                _hear(rules, who, f"{_HEAR} {site}", plan.groups(robot))
    else:
        for each in plan.sites:
            if (who := router_id(each)) not in gone:
                rules.out(who)
                rules.allow(
                    who, f"all of {each}", EVERYTHING, [f"{plan.fleet}/{each}/**"], "ingress"
                )
                _hear(rules, who, _HEAR, [plan.fleet])
                rules.allow(who, _STOP, ("put", "query"), [_every_stop(plan.fleet)], "ingress")
    robots = plan.robots_at(site) if site else list(plan.robots)
    _people(rules, plan, robots, gone)
    return rules.section()


def robot_rules(plan: FleetPlan, robot: str, without: Iterable[str] = ()) -> AccessControl:
    """The rules of a robot: its router, the people who reach it directly, its own programs."""
    rules, gone = RuleSet(), set(without)
    if plan.local:
        rules.here()
    router = router_id(plan.robots[robot].site)
    if router not in gone:
        rules.out(router)
        _own(rules, router, plan.namespace(robot))
        rules.allow(router, _STOP, ("put", "query"), [_every_stop(plan.fleet)], "ingress")
        rules.allow(router, "read", ("query", *READING), [f"{plan.fleet}/**"], "ingress")
    if plan.robots[robot].address:
        _people(rules, plan, [robot], gone)
    return rules.section()


_HEAR = "hear the stops of"
_STOP = "stop all"


def _own(rules: RuleSet, who: str, namespace: str) -> None:
    rules.allow(who, f"{_ROBOT}: {namespace}", EVERYTHING, [f"{namespace}/**"], "ingress")


def _hear(rules: RuleSet, who: str, name: str, groups: Iterable[str]) -> None:
    messages = ("declare_subscriber", "declare_queryable")
    rules.allow(who, name, messages, map(stop_key, groups), "ingress")


def _every_stop(place: str) -> str:
    """Covers the stop of a place, those of all places and robots in it, and their wildcards."""
    return stop_key(f"{place}/**")


def _people(rules: RuleSet, plan: FleetPlan, robots: list[str], gone: set[str]) -> None:
    for person, planned in plan.people.items():
        mine = [each for each in robots if plan.reaches(person, each)]
        who = person_id(person)
        if not mine or who in gone:
            continue
        rules.out(who)
        of = ", ".join(planned.of) or "all sites"
        for name, right in RIGHTS.items():
            if ROLES.index(right.role) > ROLES.index(planned.role):
                continue
            exact = [
                f"{plan.namespace(each)}/{key}" for each in mine for key in right.keys_of(person)
            ]
            wide = name in _BY_WILDCARD
            key_exprs = _wide(plan, person, name, right) if wide else exact
            # A rule with a name in it is one person's.
            named = f" of {person}" if right.keys_of(person) != right.keys else ""
            rules.allow(who, f"{name}{named}: {of}", right.messages, key_exprs, "ingress")


def _wide(plan: FleetPlan, person: str, name: str, right: Right) -> list[str]:
    found = []
    for place in plan.places(person):
        depth = place.count("/")
        if name == "stop":
            every = _every_stop(place) if depth < 2 else stop_key(place)
            found += [every, own_key(every, person)]
        elif name == "watch":
            found.append(f"{place}/**")
        else:
            found += [f"{place}{'/*' * (2 - depth)}/{key}" for key in right.keys_of(person)]
    return found


def is_allowed(rules: Mapping[str, Any], who: str, message: str, key: str, flow: str) -> bool:
    """Whether an access control lets a message through, by the rules as they are in a file."""
    subjects = {
        each["id"] for each in rules["subjects"] if who in each.get("cert_common_names", ())
    }
    has = {
        rule
        for policy in rules["policies"]
        if subjects & set(policy["subjects"])
        for rule in policy["rules"]
    }
    wanted = zenoh.KeyExpr(key)
    return any(
        rule["id"] in has
        and flow in rule["flows"]
        and message in rule["messages"]
        and any(zenoh.KeyExpr(each).includes(wanted) for each in rule["key_exprs"])
        for rule in rules["rules"]
    )
