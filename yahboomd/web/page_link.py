"""The links to the page, for this machine and for phones, with a token, and as a QR code."""

from __future__ import annotations

import contextlib
import fcntl
import ipaddress
import socket
import struct
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec

from yahboomd.core.errors import ConfigError
from yahboomd.tools.metrics.http_listener import Place
from yahboomd.web.entry_tokens import Tokens, keep

SIOCGIFADDR = 0x8915
"""Of linux/sockios.h: the address of an interface."""


def link(host: str, port: int, *, tls: bool, token: str = "") -> str:
    """The link to the page; a token goes into its fragment, which no browser sends or logs."""
    where = f"[{host}]" if ":" in host else host
    fragment = f"#token={token}" if token else ""
    return f"{'https' if tls else 'http'}://{where}:{port}/{fragment}"


def reachable_hosts(host: str) -> list[str]:
    """The addresses at which other machines reach a server that listens on ``host``."""
    if not ipaddress.ip_address(host).is_unspecified:
        return [host]
    return list(dict.fromkeys(own_addresses())) or [socket.gethostname()]


def own_addresses() -> Iterator[str]:
    """The IPv4 address of each interface but loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        for _, name in socket.if_nameindex():
            try:
                answer = fcntl.ioctl(asking, SIOCGIFADDR, struct.pack("256s", name.encode()))
            except OSError:
                continue
            address = socket.inet_ntoa(answer[20:24])
            if not ipaddress.ip_address(address).is_loopback:
                yield address


def own_names() -> set[str]:
    """The names under which other machines know this one."""
    name = socket.gethostname()
    return {name, socket.getfqdn(), f"{name.partition('.')[0]}.local"}


def qr_lines(text: str) -> str:
    """A QR code for a terminal, in half blocks, with explicit colours: white on black."""
    import io

    import segno

    out = io.StringIO()
    segno.make(text, error="l").terminal(out, compact=True)
    # A light terminal's own colours would make a negative, which some cameras cannot read.
    lines = out.getvalue().splitlines()
    return "\n".join(f"\x1b[38;5;231;48;5;16m{line}\x1b[0m" for line in lines)


class Served(msgspec.Struct, frozen=True):
    """How the page was served last, for --show-link."""

    listen: str
    tls: bool


SERVED = "web-served.json"


def last_served(folder: Path) -> tuple[Place, bool]:
    """The address and port at which the page was last served, and whether over TLS.

    Raises:
        ConfigError: They are not known.
    """
    path = folder / SERVED
    try:
        served = msgspec.json.decode(path.read_bytes(), type=Served)
        if (place := Place.of(served.listen)) is not None:
            return place, served.tls
        why = f"{path} names no address and port"
    except FileNotFoundError:
        why = f"there is no {path}"
    except (OSError, ValueError) as error:
        why = f"{path} cannot be used: {getattr(error, 'strerror', None) or error}"
    raise ConfigError(
        f"The page's last address is not known: {why}.",
        remedy="Start `yahboomd web --listen 0.0.0.0:8480` first, or add --listen here.",
    )


def print_links(place: Place, tokens: Tokens, *, tls: bool) -> None:
    """Print the links for people who drive and who watch, and a QR code on a terminal."""
    hosts = reachable_hosts(place.host)
    for host in hosts:
        print(f"to drive:           {link(host, place.port, tls=tls, token=tokens.driver)}")
    for host in hosts:
        print(f"to watch and stop:  {link(host, place.port, tls=tls, token=tokens.viewer)}")
    if sys.stdout.isatty():
        print(f"\nto drive, for the camera of a phone that reaches {hosts[0]}:")
        print(qr_lines(link(hosts[0], place.port, tls=tls, token=tokens.driver)))


def announce(place: Place, tokens: Tokens, folder: Path, *, tls: bool) -> None:
    """Print the links on a terminal; in a log, only how to see them."""
    with contextlib.suppress(OSError):
        keep(folder, SERVED, msgspec.json.encode(Served(listen=str(place), tls=tls)))
    if sys.stdout.isatty():
        print_links(place, tokens, tls=tls)
    else:
        print(
            f"The page is at port {place.port} of this machine. Its links have tokens and are not "
            "logged; to see them, as this user or as root: yahboomd web --show-link"
        )
    if not tls:
        print(
            "Without TLS everybody on that network can read the traffic, also the token: "
            "yahboomd web --make-certificate",
            flush=True,
        )
