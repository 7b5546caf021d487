"""The port that a configuration names, read before anything slow is imported.

A stop on a slow computer must not wait for the check of the whole configuration. What is not as
plain as expected is left to that check, which explains it.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

VARIABLE = "YAHBOOMD_SERIAL__"
SETTING = re.compile(r"\s*serial\s*\.\s*(?P<key>\w+)\s*=(?P<value>.*)", re.DOTALL)

LARGEST_FILE_BYTES = 1_000_000
MOST_DOTS = 200
"""In a line: on a key of thousands of parts tomllib would spend minutes."""


class NamedPort(NamedTuple):
    """The keys of the section `serial` that a port is opened by."""

    port: str = ""
    baudrate: int = 115200
    dtr: bool = True
    rts: bool = False
    hangup_on_close: bool = False


def named_port(
    path: Path | None, environ: Mapping[str, str], overrides: Sequence[str], port: str = ""
) -> NamedPort | None:
    """The port that file, environment, ``--set`` and ``--port`` name, the later over the earlier.

    Returns:
        None if they name none, or if one of its values is not as expected.
    """
    values: dict[str, Any] = {}
    if path is not None:
        section = _section(path)
        if section is None:
            return None
        values.update(section)
    for name in sorted(environ):
        if name.startswith(VARIABLE):
            values[name.removeprefix(VARIABLE).lower()] = _value(environ[name])
    for override in overrides:
        if found := SETTING.fullmatch(override):
            values[found["key"]] = _value(found["value"])
        elif "serial" in override.partition("=")[0]:
            # Such as one with quotes, which may name another port.
            return None
    if port:
        values["port"] = port
    named = NamedPort()._replace(
        **{key: value for key, value in values.items() if key in NamedPort._fields}
    )
    right = [type(value) is type(usual) for value, usual in zip(named, NamedPort(), strict=True)]
    return named if all(right) and named.port else None


def _section(path: Path) -> Mapping[str, Any] | None:
    """The section `serial` of a file; None if it cannot be read."""
    try:
        # A pipe would hold up the stop until somebody writes to it.
        fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with open(fd, "rb") as file:
            text = file.read(LARGEST_FILE_BYTES + 1).decode("utf-8-sig").replace("\r\n", "\n")
        if any(line.count(".") > MOST_DOTS for line in text.split("\n")):
            return None
        found = tomllib.loads(text).get("serial", {})
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, Mapping) and len(text) <= LARGEST_FILE_BYTES else None


def _value(text: str) -> object:
    """As the configuration reads it: TOML, else the text itself."""
    text = text.strip()
    if text.lower() in {"true", "false"}:
        return text.lower() == "true"
    try:
        return tomllib.loads(f"value = {text}")["value"] if "\n" not in text else text
    except (ValueError, RecursionError):
        return text
