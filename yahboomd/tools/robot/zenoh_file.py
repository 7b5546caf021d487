"""Judges the settings of the bus without a network, and finds the key that Zenoh refuses."""

from __future__ import annotations

import asyncio
import json
import os
from pathlib import Path

import msgspec
import zenoh

from yahboomd.core.bus.blocking import bounded
from yahboomd.core.bus.options import BusOptions, file_text, open_offline
from yahboomd.core.errors import BusConfigError

_REFUSED = " cannot be used: "


def judge(options: BusOptions) -> None:
    """Refuse what a daemon with these options would refuse on any network.

    Raises:
        BusConfigError: With the file and its key.
    """
    opening = bounded(lambda: open_offline(options), timeout_s=options.open_timeout_s, name="judge")
    try:
        asyncio.run(opening)
    except BusConfigError as error:
        raise with_key(error, options) from None
    except TimeoutError as error:
        raise BusConfigError(
            "The Zenoh session does not open: is a file of a certificate or private key a pipe?"
        ) from error


def with_key(error: BusConfigError, options: BusOptions) -> BusConfigError:
    """The same error, with the key of the user's file that Zenoh refuses, if it is one."""
    file = options.config_file
    if file is None or f"{file}{_REFUSED}" not in error.message:
        return error
    try:
        # In `metadata` Zenoh takes any value: its parser reads JSON5, which Python's does not.
        read = zenoh.Config.from_json5(f"{{metadata: {file_text(file)}\n}}")
        value = json.loads(read.get_json("metadata"))
    except (zenoh.ZError, OSError, ValueError):
        return error
    why, keys = _refusal(value, (), options), tuple[str, ...]()
    while isinstance(value, dict):
        below = {key: _refusal(inner, (*keys, key), options) for key, inner in value.items()}
        key = next((key for key in below if below[key] == why), None)
        if key is None:
            break
        keys, value = (*keys, key), value[key]
    why = ": ".join(filter(None, ("/".join(keys), why)))
    return BusConfigError(f"The Zenoh configuration {file}{_REFUSED}{why}", remedy=error.remedy)


def _refusal(value: object, keys: tuple[str, ...], options: BusOptions) -> str:
    """Zenoh's reason to refuse a file with nothing but this value; empty if it takes it."""
    for key in reversed(keys):
        value = {key: value}
    # A file in memory: its values may be secrets.
    fd = os.memfd_create("zenoh-json5", os.MFD_CLOEXEC)
    with os.fdopen(fd, "w") as file:
        json.dump(value, file)
        file.flush()
        try:
            open_offline(msgspec.structs.replace(options, config_file=Path(f"/proc/self/fd/{fd}")))
        except BusConfigError as error:
            return error.message.partition(_REFUSED)[2]
    return ""
