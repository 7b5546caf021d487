"""Checks by Host and Origin whether a request comes from our own page.

Any website can point a name of its own at this machine (DNS rebinding), and any website's script
can send requests here. So Host has to be an address or a name of this machine, and Origin, which a
script cannot forge, has to match it.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Collection
from urllib.parse import urlsplit

_HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[^\[\]:@/?#\s]+)(?::\d{1,5})?\Z")


class RequestOrigin:
    """The names under which the page is served.

    Args:
        names: The names of this machine, besides its addresses.
        local: Whether only programs on this machine reach it: then only `localhost` and loopback
            addresses are accepted.
        tls: Whether it is served over TLS.
    """

    def __init__(self, names: Collection[str], *, local: bool, tls: bool) -> None:
        self._names = {name.lower().rstrip(".") for name in names} | {"localhost"}
        self._local = local
        self._scheme = "https" if tls else "http"

    def host_is_ours(self, host: str) -> bool:
        """Whether the Host header names this machine."""
        found = _HOST.match(host)
        if found is None:
            return False
        name = found["name"].lower().rstrip(".")
        try:
            address = ipaddress.ip_address(name.strip("[]"))
        except ValueError:
            return name in self._names
        return address.is_loopback or not self._local

    def origin_is_ours(self, origin: str, host: str) -> bool:
        """Whether the Origin header names the page that Host names."""
        try:
            parts = urlsplit(origin)
        except ValueError:
            return False
        return (parts.scheme, parts.netloc.lower()) == (self._scheme, host.lower())
