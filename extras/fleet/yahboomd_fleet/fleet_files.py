"""The files of a fleet: one for each router, robot and person, with certificate, key and rules.

Each is a file of Zenoh's that holds all that its machine needs, its private key among it, so that
one file is copied and nothing refers to a path. Every file is readable by its owner alone.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, TypeAlias

import msgspec

from yahboomd.client.services import FLEET, own_source
from yahboomd.core.atomic_write import write_atomic
from yahboomd.core.config import Config
from yahboomd.core.errors import ConfigError
from yahboomd_fleet.authority import Authority, Issued, end_of, make_authority
from yahboomd_fleet.fleet_list import FleetList, ZenohFile, read_zenoh
from yahboomd_fleet.fleet_plan import (
    LOCAL_PORT,
    TOP,
    FleetPlan,
    person_id,
    robot_id,
    router_id,
)
from yahboomd_fleet.fleet_rules import AccessControl, robot_rules, router_rules

ROUTERS, ROBOTS, PEOPLE = "routers", "robots", "people"
KEY, CERTIFICATE, REVOKED = "authority.key", "authority.pem", "revoked.json"
INVENTORY = "inventory.yml"
DRIVING = {"driver": 60, "operator": 70, "maintainer": 80}
"""The priority of a person's commands by role: above the robot's page, below its own joystick."""

_HEADER = "// Made by `yahboomd fleet`. It has a private key in it: nobody else may read it.\n"
_CONFIG = "/etc/yahboomd/zenoh.json5"
_PATIENT = {
    # TLS and Zenoh need five round trips, and a way with 200 ms each way 2 s for them.
    "timeout_ms": 4000,
    "retry": {"period_init_ms": 250, "period_max_ms": 500, "period_increase_factor": 2.0},
}
"""How a person's programs connect: a router that is away is tried often, a slow one waited for."""


Inventory: TypeAlias = dict[str, Any]


class Revocation(msgspec.Struct, frozen=True, kw_only=True):
    """A revoked certificate: its name, and the time at which it ends by itself."""

    name: str
    until: datetime


class FleetFolder:
    """The folder of a fleet's files, on its operator's machine.

    Args:
        now: The time of certificates that are made.
    """

    def __init__(self, folder: Path, plan: FleetPlan, now: datetime) -> None:
        self.folder = folder
        self._plan = plan
        self._now = now

    def begin(self) -> None:
        """Make the folder and the authority.

        Raises:
            ConfigError: There is one already, or a file has the folder's name.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise ConfigError(
                f"{self.folder} is a file, and the fleet's folder has this name.",
                remedy="Call the fleet's file fleet.toml: its folder is fleet/ then.",
            )
        if (self.folder / KEY).exists():
            raise ConfigError(
                f"{self.folder} has an authority already; nothing was changed.",
                remedy="`yahboomd fleet add` makes the files of new robots and people.",
            )
        made = make_authority(self._plan.fleet, self._now)
        # The key last: it tells that there is an authority, also after an interrupt.
        _keep(self.folder / CERTIFICATE, made.certificate)
        _keep(self.folder / KEY, made.key)

    def paths(self) -> dict[str, Path]:
        """The file of each certificate, by the name in it."""
        plan = self._plan
        found = {router_id(site): Path(ROUTERS, site) for site in plan.sites}
        if plan.router:
            found[TOP] = Path("router")
        found |= {robot_id(name): Path(ROBOTS, name) for name in plan.robots}
        found |= {person_id(name): Path(PEOPLE, name) for name in plan.people}
        return {
            name: (self.folder / path).with_name(f"{path.name}.json5")
            for name, path in found.items()
        }

    def revoked(self) -> list[Revocation]:
        """The revoked certificates."""
        path = self.folder / REVOKED
        try:
            return msgspec.json.decode(path.read_bytes(), type=list[Revocation])
        except FileNotFoundError:
            return []
        except msgspec.MsgspecError as error:
            raise ConfigError(f"{path} cannot be used: {error}.") from error

    def write(
        self, renewed: Iterable[str] = (), tell: Callable[[Path], object] = lambda _: None
    ) -> list[Path]:
        """Write what is missing and what has changed, and remove the files of the revoked.

        Args:
            renewed: The names of certificates that are made anew.
            tell: Called with each file that changes, before it does: after an interrupt nobody
                finds out which files were already new.

        Returns:
            The files that changed: each belongs on its machine.
        """
        anew, gone = set(renewed), {each.name for each in self.revoked()}
        authority: Authority | None = None
        changed = []
        identities, paths = self._plan.identities(), self.paths()
        for name, path in paths.items():
            if name in gone:
                path.unlink(missing_ok=True)
                continue
            issued = None if name in anew else self._issued(path)
            if issued is None:
                authority = authority or self._authority()
                issued = authority.issue(name, identities[name], self._now)
            content = self._content(name, issued, gone)
            text = _HEADER + json.dumps(content, indent=1) + "\n"
            if not path.exists() or path.read_text() != text:
                tell(path)
                _keep(path, text.encode())
                changed.append(path)
        for robot in self._plan.robots:
            path = paths[robot_id(robot)].with_suffix(".toml")
            if robot_id(robot) in gone:
                path.unlink(missing_ok=True)
            else:
                text = self._robot_toml(robot)
                if not path.exists() or path.read_text() != text:
                    tell(path)
                    _keep(path, text.encode())
                    changed.append(path)
        listed = json.dumps(self._inventory(gone), indent=1)
        text = f"# Made by `yahboomd fleet`, for Ansible.\n{listed}\n"
        _keep(self.folder / INVENTORY, text.encode())
        return changed

    def revoke(self, name: str) -> Revocation:
        """Put a certificate on the list of the revoked; :meth:`write` removes its rights.

        One that is on the list stays there: an interrupted run can be repeated.

        Raises:
            ConfigError: There is no such certificate.
        """
        for each in self.revoked():
            if each.name == name:
                return each
        issued = self._issued(self.paths()[name]) if name in self.paths() else None
        if issued is None:
            raise ConfigError(f"There is no certificate of {name!r} in {self.folder}.")
        made = Revocation(name=name, until=end_of(issued.certificate))
        _keep(self.folder / REVOKED, msgspec.json.encode([*self.revoked(), made]))
        return made

    def readers(self) -> list[Path]:
        """The files with rules in them: those of routers and robots."""
        return [
            path
            for name, path in self.paths().items()
            if not name.startswith("person.") and path.exists()
        ]

    def ending(self, within: timedelta) -> list[str]:
        """The names of the certificates that end within a time."""
        found = {name: self._issued(path) for name, path in self.paths().items()}
        return [
            name
            for name, issued in found.items()
            if issued is not None and end_of(issued.certificate) < self._now + within
        ]

    def _issued(self, path: Path) -> Issued | None:
        return identity_in(read_zenoh(path)) if path.exists() else None

    def _authority(self) -> Authority:
        try:
            key = self.folder / KEY
            if key.stat().st_mode & 0o077:
                raise ConfigError(
                    f"Others may read {key}: everybody who did can make certificates.",
                    remedy=f"`chmod 600 {key}`, and begin anew if somebody may have read it.",
                )
            return Authority(Issued((self.folder / CERTIFICATE).read_bytes(), key.read_bytes()))
        except FileNotFoundError as error:
            raise ConfigError(
                f"There is no authority in {self.folder}: {error.filename} is missing.",
                remedy="`yahboomd fleet init` makes one.",
            ) from error
        except ValueError as error:
            raise ConfigError(f"The authority in {self.folder} cannot be used: {error}.") from error

    def _content(self, name: str, issued: Issued, gone: set[str]) -> ZenohFile:
        plan = self._plan
        content: ZenohFile = {"transport": {"link": {"tls": self._tls(issued)}}}
        kind, _, which = name.partition(".")
        if kind == "person":
            content["metadata"] = {FLEET: msgspec.to_builtins(self._list(which, gone))}
            content["connect"] = _PATIENT
        elif kind == "robot":
            content["access_control"] = robot_rules(plan, which, gone)
        else:
            content |= self._router(which)
            content["transport"] |= {
                "unicast": {"max_sessions": 2000, "accept_pending": 500, "accept_timeout": 3000},
                "shared_memory": {"enabled": False},
            }
            content["transport"]["link"] |= {
                "tx": {"lease": 2000},
                "rx": {"max_message_size": 16 * 1024 * 1024},
            }
            content["access_control"] = router_rules(plan, which, gone)
        return content

    def _tls(self, issued: Issued) -> ZenohFile:
        certificate, key = _text(issued.certificate), _text(issued.key)
        return {
            "root_ca_certificate_base64": _text((self.folder / CERTIFICATE).read_bytes()),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
            "listen_certificate_base64": certificate,
            "listen_private_key_base64": key,
            "connect_certificate_base64": certificate,
            "connect_private_key_base64": key,
        }

    def _router(self, site: str) -> ZenohFile:
        plan = self._plan
        own = plan.sites[site].router if site else plan.router
        above = [f"tls/{plan.router}"] if site and plan.router else []
        return {
            "mode": "router",
            "listen": {"endpoints": [f"tls/0.0.0.0:{own.rpartition(':')[2]}"]},
            "connect": {"endpoints": above, "timeout_ms": -1, "exit_on_failure": False},
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        }

    def _inventory(self, gone: set[str]) -> Inventory:
        """The machines by groups of Ansible's, with the hosts at which each is reached.

        A robot without an address is reached at its name.
        """
        plan = self._plan
        hosts, files = plan.identities(), self.paths()
        sites: dict[str, Inventory] = {}
        for robot, planned in plan.robots.items():
            if (name := robot_id(robot)) not in gone:
                # Ansible's groups have no hyphens in their names.
                site = sites.setdefault(f"site_{planned.site.replace('-', '_')}", {"hosts": {}})
                site["hosts"][robot] = {"ansible_host": hosts[name][0]} if hosts[name] else {}
        addresses = {router_id(name): site.router for name, site in plan.sites.items()}
        if plan.router:
            addresses[TOP] = plan.router
        routers = {
            # A robot may be called "router", and none has a dot in its name.
            "above.router" if name == TOP else name: {
                "ansible_host": hosts[name][0],
                "zenohd_from": str(files[name].relative_to(self.folder)),
                "zenohd_port": int(address.rpartition(":")[2]),
            }
            for name, address in addresses.items()
            if name not in gone
        }
        return {"all": {"children": {"robots": {"children": sites}, "routers": {"hosts": routers}}}}

    def _list(self, person: str, gone: set[str]) -> FleetList:
        plan = self._plan
        mine = [
            robot
            for robot in plan.robots
            if plan.reaches(person, robot) and robot_id(robot) not in gone
        ]
        places = plan.places(person)
        ways = {f"tls/{plan.router}": places} if plan.router else {}
        for site in dict.fromkeys(plan.robots[robot].site for robot in mine):
            home = f"{plan.fleet}/{site}"
            here = [each for each in places if f"{each}/".startswith(f"{home}/")]
            ways[f"tls/{plan.sites[site].router}"] = here or [home]
        return FleetList(
            person=person,
            role=plan.people[person].role,
            ways=ways,
            robots=[plan.namespace(robot) for robot in mine],
            pages={
                plan.namespace(robot): page for robot in mine if (page := plan.robots[robot].page)
            },
        )

    def _robot_toml(self, robot: str) -> str:
        plan = self._plan
        planned = plan.robots[robot]
        listen = [f"tcp/127.0.0.1:{LOCAL_PORT}"] if plan.local else []
        if planned.address:
            listen.append(f"tls/0.0.0.0:{planned.address.rpartition(':')[2]}")
        return (
            f"# {robot}: put this into /etc/yahboomd/config.toml, and {robot}.json5 to\n"
            f"# {_CONFIG}, readable by the daemon's user alone.\n"
            "[zenoh]\n"
            f'namespace = "{plan.namespace(robot)}"\n'
            f"listen = {json.dumps(listen)}\n"
            f'connect = ["tls/{plan.sites[planned.site].router}"]\n'
            f'config = "{_CONFIG}"\n'
            "[estop]\n"
            f"groups = {json.dumps(plan.groups(robot))}\n"
            "[command.sources]\n" + self._sources(robot)
        )

    def _sources(self, robot: str) -> str:
        """The usual sources, and a key for each person who may drive the robot.

        A revoked person keeps it: the rules refuse its use, and this file need not be copied.
        """
        plan = self._plan
        sources = {
            key: {"priority": source.priority, "timeout_s": source.timeout_s}
            for key, source in Config().command.sources.items()
        }
        for person, planned in plan.people.items():
            if planned.role in DRIVING and plan.reaches(person, robot):
                sources[own_source(person)] = {
                    "priority": DRIVING[planned.role],
                    "timeout_s": 0.3,
                }
        return "".join(f'"{key}" = {{ {_inline(source)} }}\n' for key, source in sources.items())


def _inline(source: dict[str, Any]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in source.items() if value is not None)


def identity_in(file: ZenohFile) -> Issued:
    """The certificate and the key in a file."""
    tls = file["transport"]["link"]["tls"]
    return Issued(
        base64.b64decode(tls["connect_certificate_base64"]),
        base64.b64decode(tls["connect_private_key_base64"]),
    )


def rules_in(file: ZenohFile) -> AccessControl:
    """The access rules in the file of a router or a robot."""
    return dict(file["access_control"])


def _text(content: bytes) -> str:
    return base64.b64encode(content).decode()


def _keep(path: Path, content: bytes) -> None:
    """Replace a file by one that its owner alone can read, at once or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    write_atomic(path, content, mode=0o600)
