"""A person's file: the papers for the routers, and the robots to which they lead."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, TypeAlias

import msgspec

from yahboomd.client.services import FLEET
from yahboomd.core.errors import ConfigError
from yahboomd_fleet.fleet_plan import Role

ZenohFile: TypeAlias = dict[str, Any]


class FleetList(msgspec.Struct, frozen=True, kw_only=True):
    """The robots of a person.

    Attributes:
        ways: The endpoints of routers, with the places behind each: a fleet, sites, robots.
        robots: The namespaces of the robots.
        pages: The addresses of robots' own pages, by namespace.
    """

    person: str
    role: Role
    ways: dict[str, list[str]]
    robots: list[str]
    pages: dict[str, str] = {}


def standard_papers() -> Path:
    """The place of a person's file on the person's own machine."""
    config = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(config, "yahboomd", "fleet.json5")


def read_zenoh(path: Path) -> ZenohFile:
    """Read a file that this module wrote.

    Raises:
        ConfigError: It is none.
    """
    try:
        lines = path.read_text().splitlines()
        found = json.loads("\n".join(line for line in lines if not line.startswith("//")))
        found["transport"]["link"]["tls"]["connect_private_key_base64"]
    except OSError as error:
        raise ConfigError(
            f"{path} cannot be read: {error.strerror}. It is your file of `yahboomd fleet init`: "
            "name it with `--fleet FILE`. `yahboomd stop` stops the robot of this machine."
        ) from error
    except (ValueError, LookupError, TypeError) as error:
        raise ConfigError(
            f"{path} is no file of `yahboomd fleet`.",
            remedy="`yahboomd fleet add` writes it anew if you remove it.",
        ) from error
    return dict(found)


def read_list(path: Path) -> FleetList:
    """Read the list of robots in a person's file.

    Raises:
        ConfigError: There is none in it.
    """
    try:
        return msgspec.convert(read_zenoh(path)["metadata"][FLEET], FleetList)
    except (LookupError, TypeError, msgspec.ValidationError) as error:
        raise ConfigError(
            f"{path} lists no robots: it is not the file of a person.",
            remedy="`yahboomd fleet` writes one for each person, in the folder people/.",
        ) from error
