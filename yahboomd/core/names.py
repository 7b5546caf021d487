"""Checks of names and endpoints of the bus that a person wrote."""

from __future__ import annotations

import ipaddress
import re

PROTOCOLS = ("tcp", "udp", "tls", "quic", "unixsock-stream")
"""Compiled into the Zenoh wheel, and known to clients in other languages as well."""

PAGE_SOURCE = "cmd_vel/web"
"""The key on which the page commands."""

# The configuration is published, and stands in black boxes and logs. Nothing can tell a secret by
# its name (psw=, u=, loginpas=): only parameters that are known to be none are taken.
_PARAMETER = (
    r"((rel|prio|iface|bind|dscp|so_sndbuf|so_rcvbuf|multistream|mixed_rel|enable_mtls|initial_mtu"
    r"|verify_name_on_connect|close_link_on_expiration|exit_on_failure|retry_period_\w+)=[\w.:%-]*"
    r"|(root_ca|listen|connect)_(certificate(_file)?|private_key_file)=/[^;?#\s]*)"
)
_ENDPOINT = re.compile(rf"(?P<protocol>[^/]+)/(?P<address>[^?#\s]+)([?#;]{_PARAMETER})*")
_CAMERA = re.compile(
    r"http://(\[[\da-fA-F:.]+\]|[\w.-]+)(:(?P<port>[0-9]{1,5}))?(/[\w./~+,:-]*"
    "([?&](action|camera|channel|compression|default_transport|fps|height|invert|qos_profile"
    r"|quality|rate|resolution|size|src|stream|topic|type|width)=[\w./:+-]*)*)?",
    re.ASCII,
)
_ADDRESS = re.compile(r"(?P<host>\[[0-9A-Fa-f:.%a-z]+\]|[^:\[\]/@;=&]+):(?P<port>[0-9]{1,5})")

# Zenoh's rules for a key without wildcards: chunks that are not empty, none of `*`, `$`, `?`, `#`.
# `@` opens a chunk that wildcards do not reach; a robot must not be hidden by accident.
_CHUNK = re.compile(r"[^*$?#/@\s\x00-\x1f][^*$?#/\s\x00-\x1f]*\Z")
_SURROGATE = re.compile("[\ud800-\udfff]")

NOT_UTF8 = "it is not UTF-8"


def is_utf8(text: str) -> bool:
    """Whether text can be sent: bytes of the command line that are no UTF-8 become surrogates."""
    return not _SURROGATE.search(text)


def name_problem(name: str) -> str | None:
    """The reason why ``name`` cannot be a namespace or a key below it; None when it can."""
    if not is_utf8(name):
        return NOT_UTF8
    if name.startswith("/") or name.endswith("/"):
        return "it may not begin or end with '/'"
    for chunk in name.split("/"):
        if not chunk:
            return "between two '/' there must be a name"
        if not _CHUNK.match(chunk):
            return "it has a character that keys may not have (one of * $ ? # @ or a space)"
    return None


def endpoint_problem(endpoint: str) -> str | None:
    """The reason why ``endpoint`` cannot work; None when it looks right.

    Zenoh does not report a wrong endpoint to connect to: it retries for ever.
    """
    if not is_utf8(endpoint):
        return NOT_UTF8
    parts = _ENDPOINT.fullmatch(endpoint)
    if parts is None:
        words = "it is not of the form protocol/address, such as tcp/127.0.0.1:7447, with known"
        return f"{words} parameters: what stands here is published, and a secret belongs elsewhere"
    protocol, address = parts["protocol"], parts["address"]
    if protocol not in PROTOCOLS:
        return f"its protocol is none of {', '.join(PROTOCOLS)}"
    if protocol == "unixsock-stream":
        return None if address.startswith("/") else "the socket's path must begin with '/'"
    found = host_and_port(endpoint)
    if found is None:
        return "its address is not host:port, such as 127.0.0.1:7447 or [::1]:7447"
    return None if found[1] <= 65535 else f"{found[1]} is not a port from 0 to 65535"


def camera_problem(address: str) -> str | None:
    """The reason why a camera's ``address`` cannot be used; None if it can, or is empty."""
    found = _CAMERA.fullmatch(address)
    if address and (found is None or int(found["port"] or 80) > 65535):
        words = "it is not of the form http://host:port/path, such as http://127.0.0.1:8080/stream"
        return f"{words}, with known parameters: it is published, and a secret cannot stand in it"
    return None


def host_and_port(endpoint: str) -> tuple[str, int] | None:
    """The host, without brackets, and the port of ``endpoint``; None if it has none."""
    parts = _ENDPOINT.fullmatch(endpoint)
    address = _ADDRESS.fullmatch(parts["address"]) if parts else None
    return (address["host"].strip("[]"), int(address["port"])) if address else None


def is_local(endpoint: str) -> bool:
    """Whether only this machine reaches ``endpoint``.

    A host name that is not ``localhost`` may mean anything: it counts as reachable by others.
    """
    host, _ = host_and_port(endpoint) or ("", 0)
    if endpoint.startswith("unixsock-stream/") or host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def source_words(key: str | None) -> str:
    """A source of commands at the beginning of a sentence for people."""
    return "The page" if key == PAGE_SOURCE else str(key)


def is_ros_name(name: str) -> bool:
    """Whether ROS 2 takes ``name`` for a relative name of a topic or a namespace."""
    return re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*", name) is not None
