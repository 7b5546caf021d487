"""What a certificate may do, read from the rules as they are in the files of routers and robots."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

import msgspec

from yahboomd.core.errors import ConfigError
from yahboomd_fleet.authority import end_of, name_in
from yahboomd_fleet.fleet_files import FleetFolder, identity_in, rules_in
from yahboomd_fleet.fleet_list import read_zenoh
from yahboomd_fleet.fleet_plan import TOP, FleetPlan, person_id, robot_id, router_id
from yahboomd_fleet.fleet_rules import RIGHTS, AccessControl, Right, is_allowed


class CertificateRights(msgspec.Struct, frozen=True, kw_only=True):
    """What a certificate may do.

    Attributes:
        name: The name in it.
        until: Its end.
        by_way: The rights for each robot, by the way to it.
    """

    name: str
    until: datetime
    by_way: dict[str, dict[str, tuple[str, ...]]]


def full_name(plan: FleetPlan, name: str) -> str:
    """The name in the certificate of a person, a robot or a router.

    Raises:
        ConfigError: There is none of this name, or several.
    """
    known = list(plan.identities())
    if name in known:
        return name
    found = [each for each in (person_id(name), robot_id(name), router_id(name)) if each in known]
    match found:
        case [one]:
            return one
        case []:
            raise ConfigError(f"Nobody in this fleet is called {name!r}.")
    raise ConfigError(f"Several are called {name!r}.", remedy=f"Name one: {', '.join(found)}.")


def check(folder: FleetFolder, plan: FleetPlan, path: Path) -> CertificateRights:
    """Read the rights of the certificate in a file from the rules of all routers and robots."""
    certificate = identity_in(read_zenoh(path)).certificate
    name = name_in(certificate)
    rules = {
        each: rules_in(read_zenoh(file))
        for each, file in folder.paths().items()
        if file.exists() and not each.startswith("person.")
    }
    return CertificateRights(
        name=name,
        until=end_of(certificate),
        by_way={
            robot: {
                way: tuple(
                    words
                    for words, right in RIGHTS.items()
                    if _has(rules, name, hops, plan.namespace(robot), right)
                )
                for way, hops in ways(plan, robot).items()
            }
            for robot in plan.robots
            if robot_id(robot) in rules
        },
    )


def ways(plan: FleetPlan, robot: str) -> dict[str, tuple[str, ...]]:
    """The ways to a robot: the names of the certificates on each, the robot's own last."""
    last = (router_id(plan.robots[robot].site), robot_id(robot))
    found: dict[str, tuple[str, ...]]
    found = {"by the router above": (TOP, *last)} if plan.router else {}
    found["by the site's router"] = last
    if plan.robots[robot].address:
        found["directly"] = last[1:]
    return found


def _has(
    rules: Mapping[str, AccessControl], who: str, hops: tuple[str, ...], place: str, right: Right
) -> bool:
    """Whether each key of a right below a namespace passes each hop, in and out."""
    own = right.keys_of(who.removeprefix("person."))
    needed = [(message, f"{place}/{key}") for message in right.messages for key in own]
    for here, onward in zip(hops, (*hops[1:], ""), strict=True):
        section = rules.get(here)
        if section is None:
            return False
        for message, key in needed:
            if not is_allowed(section, who, message, key, "ingress"):
                return False
            if onward and not is_allowed(section, onward, message, key, "egress"):
                return False
        who = here
    return True
