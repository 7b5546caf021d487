"""The file that describes a fleet: its sites, its robots, its people and their roles."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import msgspec

from yahboomd.core.bus import keys
from yahboomd.core.bus.keys import full_key
from yahboomd.core.errors import ConfigError
from yahboomd.core.names import host_and_port
from yahboomd.tools.people.people_keys import PLACES

Role: TypeAlias = Literal["viewer", "driver", "operator", "maintainer"]
"""The roles; each may do everything that the ones before it may."""

TOP = "router"
"""The name in the certificate of the router above the sites."""

LOCAL_PORT = 7448
"""The port on which a robot serves the programs of its own machine."""

_NAME = re.compile(r"[a-z0-9][a-z0-9_-]*")
_RESERVED = ("yahboomd", "cmd_vel")
_LONGEST = 50
"""A certificate's name has at most 64 characters, its kind among them."""

_PAGE = re.compile(r"https?://[A-Za-z0-9._:\[\]-]+(/[A-Za-z0-9._~/-]*)?")
_ADDRESS = re.compile(r"([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\]):[0-9]{1,5}")


class PlannedSite(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A place with a router of its own.

    Attributes:
        router: The address of the router, ``host:port``, as robots and people reach it.
    """

    router: str


class PlannedRobot(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A robot.

    Attributes:
        address: ``host:port`` at which people reach it without a router; empty: only by its router.
        page: The address of its own page, as a browser opens it; empty: none is offered.
    """

    site: str
    address: str = ""
    page: str = ""


class PlannedPerson(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A person, or a program with a certificate of its own.

    Attributes:
        of: The sites and robots (``site/robot``) to which the role extends; left out: all. An
            empty list is refused: without the last site it would be all of them.
    """

    role: Role
    of: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)] = ()


class FleetPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A whole fleet.

    Attributes:
        fleet: Its name: the first part of every key.
        router: The address of the router above the sites; empty if there is one site.
        local: Whether every program on a robot's own machine may do everything to that robot.
    """

    fleet: str
    router: str = ""
    local: bool = True
    sites: dict[str, PlannedSite]
    robots: dict[str, PlannedRobot] = {}
    people: dict[str, PlannedPerson] = {}

    def namespace(self, robot: str) -> str:
        """The robot's namespace: ``fleet/site/robot``."""
        return f"{self.fleet}/{self.robots[robot].site}/{robot}"

    def groups(self, robot: str) -> tuple[str, ...]:
        """The names under which the robot is stopped together with others."""
        return f"{self.fleet}/{self.robots[robot].site}", self.fleet

    def robots_at(self, site: str) -> list[str]:
        return [name for name, robot in self.robots.items() if robot.site == site]

    def reaches(self, person: str, robot: str) -> bool:
        """Whether the person's role extends to the robot."""
        of, site = self.people[person].of, self.robots[robot].site
        return not of or site in of or f"{site}/{robot}" in of

    def places(self, person: str) -> list[str]:
        """The namespaces of the person's role, the widest first: the fleet, or sites and robots."""
        of = self.people[person].of
        return [f"{self.fleet}/{each}" for each in of] if of else [self.fleet]

    def identities(self) -> dict[str, tuple[str, ...]]:
        """The names in all certificates, and the host names at which each is reached."""
        found = {person_id(name): () for name in self.people}
        addresses = {robot_id(name): robot.address for name, robot in self.robots.items()}
        addresses |= {router_id(name): site.router for name, site in self.sites.items()}
        if self.router:
            addresses[TOP] = self.router
        return found | {name: _hosts(address) for name, address in addresses.items()}


def person_id(name: str) -> str:
    return f"person.{name}"


def robot_id(name: str) -> str:
    return f"robot.{name}"


def router_id(site: str) -> str:
    return f"{TOP}.{site}"


def stop_key(group: str) -> str:
    """The key that stops every robot of a group: a site or a fleet."""
    return full_key(group, keys.ESTOP)


def read_plan(path: Path) -> FleetPlan:
    """Read the file of a fleet.

    Raises:
        ConfigError: It cannot be read, or has mistakes; the first one is named.
    """
    try:
        plan = msgspec.convert(tomllib.loads(path.read_text("utf-8")), FleetPlan)
    except OSError as error:
        raise ConfigError(
            f"{path} cannot be read: {error.strerror}.",
            remedy="docs/fleet.md has one to begin with.",
        ) from error
    except (ValueError, msgspec.ValidationError) as error:
        raise ConfigError(f"{path}: {error}.", remedy="docs/fleet.md explains its keys.") from error
    if problem := plan_problem(plan):
        raise ConfigError(f"{path}: {problem}", remedy="docs/fleet.md explains its keys.")
    return plan


def plan_problem(plan: FleetPlan) -> str:
    """The first mistake in a plan, as a sentence; empty if there is none."""
    named = [plan.fleet, *plan.sites, *plan.robots, *plan.people]
    for name in named:
        if not _NAME.fullmatch(name) or name in _RESERVED or len(name) > _LONGEST:
            return (
                f"{name!r} cannot be a name here: up to {_LONGEST} small letters, digits, '-' and "
                f"'_' can, and it is none of {', '.join(_RESERVED)}."
            )
    if not plan.sites:
        return "there is no site, such as [sites.north]: each robot is at one."
    if not plan.router and len(plan.sites) != 1:
        return "with several sites `router` has to name the router above them."
    addresses = {"router": plan.router} if plan.router else {}
    addresses |= {f"sites.{name}.router": site.router for name, site in plan.sites.items()}
    addresses |= {
        f"robots.{name}.address": robot.address
        for name, robot in plan.robots.items()
        if robot.address
    }
    taken: dict[str, str] = {}
    for where, address in addresses.items():
        if not _ADDRESS.fullmatch(address) or not 0 < _port(address) < 65536:
            return f"{where} = {address!r} is not host:port, such as 192.168.1.20:7449."
        # Each has a certificate of its own, and is reached as what it is.
        if (first := taken.setdefault(address.lower(), where)) != where:
            return f"{where} = {address!r} is the address of {first} already."
    for name, robot in plan.robots.items():
        if robot.site not in plan.sites:
            return f"robots.{name} is at the site {robot.site!r}, which is not in the file."
        if robot.page and not _PAGE.fullmatch(robot.page):
            return f"robots.{name}.page is no address such as https://192.168.1.20:8480."
        if robot.address and _port(robot.address) == LOCAL_PORT:
            return (
                f"robots.{name}.address has the port {LOCAL_PORT}, which serves the programs on "
                "the robot itself: take another one, such as 7449."
            )
    places = {*plan.sites, *(f"{robot.site}/{name}" for name, robot in plan.robots.items())}
    for name, person in plan.people.items():
        if name in PLACES:
            return f"people.{name} has the name of a source of every robot, cmd_vel/{name}."
        for each in person.of:
            if each not in places:
                return f"people.{name}.of has {each!r}, which is neither a site nor site/robot."
    return ""


def _port(address: str) -> int:
    return int(address.rpartition(":")[2])


def _hosts(address: str) -> tuple[str, ...]:
    found = host_and_port(f"tls/{address}") if address else None
    return () if found is None else (found[0],)
