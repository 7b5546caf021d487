"""Zenoh's errors, in words that help a person."""

from __future__ import annotations

import os
import re
from pathlib import Path

from yahboomd.bus.options import BusOptions
from yahboomd.errors import BusError

_LISTENING = "0A"
"""The state of a listening socket in /proc/net/tcp."""


def open_failure(error: Exception, options: BusOptions) -> BusError:
    """The reason why the session did not open, and a remedy."""
    text = str(error)
    if "Address already in use" in text:
        return _in_use(text, options)
    if "Cannot assign requested address" in text:
        return BusError(
            f"This machine has no address {_place(text, options)}, where zenoh.listen wants it.",
            remedy="Use 127.0.0.1 for this machine alone, or one that `ip address` shows.",
        )
    if "Permission denied" in text:
        return BusError(
            f"This user may not listen on {_place(text, options)}.",
            remedy="Ports below 1024 need privileges; a socket's folder must be writable.",
        )
    if "Unable to open lock file" in text:
        return BusError(
            f"The Unix socket {options.unix_socket} cannot be made: {_short(text)}.",
            remedy="Its folder must exist and be writable.",
        )
    if "Unable to connect" in text:
        return BusError(
            f"No Zenoh router answers at {', '.join(options.connect)}.",
            remedy="Start it first, or set zenoh.mode to 'router', which does not wait.",
        )
    if "not supported for" in text:
        return BusError(
            f"An endpoint names a protocol that this Zenoh does not have: {_short(text)}.",
            remedy="tcp, udp, tls, quic and unixsock-stream are there.",
        )
    return BusError(
        f"The Zenoh session cannot be opened: {_short(text)}.",
        remedy="Look at [zenoh] in the configuration, and at the file that zenoh.config names.",
    )


def port_holder(port: int) -> str | None:
    """The process that listens on a TCP port of this machine, such as ``yahboomd (812)``.

    Returns:
        None when none is found; without privileges, one of another user's is never found.
    """
    inodes = set[str]()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        try:
            lines = Path(table).read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            fields = line.split()
            if fields[3] == _LISTENING and int(fields[1].rpartition(":")[2], 16) == port:
                inodes.add(f"socket:[{fields[9]}]")
    if not inodes:
        return None
    for name in os.listdir("/proc"):
        folder = Path("/proc", name)
        try:
            if name.isdigit() and any(
                str(fd.readlink()) in inodes for fd in (folder / "fd").iterdir()
            ):
                return f"{(folder / 'comm').read_text(encoding='utf-8').strip()} ({name})"
        except OSError:  # it ended meanwhile, or is another user's
            continue
    return None


def _in_use(text: str, options: BusOptions) -> BusError:
    place = _place(text, options)
    port = place.rpartition(":")[2]
    holder = port_holder(int(port)) if port.isdigit() else None
    owner = f"the process {holder}" if holder else "another process, maybe another user's,"
    return BusError(
        f"The bus cannot listen on {place}: {owner} listens there already.",
        remedy="Is yahboomd running twice? End the other one, or give this one another port, such "
        "as --set zenoh.listen=tcp/127.0.0.1:7449.",
    )


def _place(text: str, options: BusOptions) -> str:
    for endpoint in options.listening:
        if endpoint in text or endpoint.partition("/")[2] in text:
            return endpoint
    return ", ".join(options.listening)


def _short(text: str) -> str:
    """Without the places in Zenoh's own source."""
    return " ".join(re.sub(r" at /\S+\.rs:\d+\.?", "", text).split()).rstrip(" .")
