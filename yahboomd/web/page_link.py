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

from yahboomd.core.clock import Clock
from yahboomd.core.errors import ConfigError
from yahboomd.core.model import NS_PER_S
from yahboomd.core.program import plain
from yahboomd.tools.metrics.http_listener import Place
from yahboomd.web.session_files import (
    MINUTES,
    Role,
    end_stored,
    forget_links,
    keep,
    make_entry,
    stored_numbers,
    stored_sessions,
)

ROLES: tuple[Role, Role] = ("driver", "viewer")

ELSEWHERE = ("192.0.2.1", 9)
"""An address of no network (RFC 5737), so that its route is the default one."""

SIOCGIFADDR = 0x8915
"""Of linux/sockios.h: the address of an interface."""


def link(host: str, port: int, *, tls: bool, token: str = "") -> str:
    """The link to the page; a token goes into its fragment, which no browser sends or logs."""
    where = f"[{host}]" if ":" in host else host
    fragment = f"#token={token}" if token else ""
    return f"{'https' if tls else 'http'}://{where}:{port}/{fragment}"


def reachable_hosts(host: str) -> list[str]:
    """The addresses at which other machines reach a server that listens on ``host``.

    The default route's is the first: another interface may be a lidar's.
    """
    if not ipaddress.ip_address(host).is_unspecified:
        return [host]
    first = default_address()
    return sorted(dict.fromkeys(own_addresses()), key=lambda each: each != first)


def default_address() -> str:
    """This machine's address on the default route; empty without one. Sends nothing."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        try:
            asking.connect(ELSEWHERE)
        except OSError:
            return ""
        return str(asking.getsockname()[0])


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


def print_links(folder: Path, place: Place, clock: Clock, *, tls: bool) -> None:
    """Make a link for a person who drives and one who watches; print both, with a QR code.

    Raises:
        ConfigError: The folder cannot be written to.
    """
    hosts = reachable_hosts(place.host)
    if not hosts:
        print(
            "This machine has no address on a network, so no phone reaches the page. Connect it, "
            "then get a link: yahboomd web --show-link"
        )
        return
    driver, viewer = (make_entry(folder, role, clock) for role in ROLES)
    for host in hosts:
        print(f"to drive:           {link(host, place.port, tls=tls, token=driver)}")
    for host in hosts:
        print(f"to watch and stop:  {link(host, place.port, tls=tls, token=viewer)}")
    print(f"Each lets one phone in, once, within {MINUTES} minutes.")
    if sys.stdout.isatty():
        print(f"\nto drive, for the camera of a phone that reaches {hosts[0]}:")
        print(qr_lines(link(hosts[0], place.port, tls=tls, token=driver)))


def announce(folder: Path, place: Place, clock: Clock, *, tls: bool) -> None:
    """Print links on a terminal; in a log, only how to get them."""
    with contextlib.suppress(OSError):
        keep(folder, SERVED, msgspec.json.encode(Served(listen=str(place), tls=tls)))
    if sys.stdout.isatty():
        try:
            print_links(folder, place, clock, tls=tls)
        except ConfigError as error:
            # A full disk: phones that have a session go on.
            print(error)
    else:
        print(
            f"The page is at port {place.port} of this machine. A phone gets in by a link, which "
            "is not logged; to get one, as this user or as root: yahboomd web --show-link"
        )
    if not tls:
        print(
            "Without TLS everybody on that network can read the traffic, also the cookies: "
            "yahboomd web --make-certificate",
            flush=True,
        )


def print_sessions(folder: Path, clock: Clock) -> None:
    """Print the phones that may use the page, those used last first."""
    now_ns = clock.wall_ns()
    found = sorted(stored_sessions(folder), key=lambda each: -each[2])
    if not found:
        print("No phone has a session. For a link: yahboomd web --show-link")
        return
    print(f"{'number':8}{'may':10}{'last used':18}name")
    for number, stored, used_ns in found:
        may = "drive" if stored.role == "driver" else "watch"
        ago = _ago(max(0, now_ns - used_ns) // NS_PER_S)
        print(f"{plain(number)[:6]:8}{may:10}{ago:18}{plain(stored.name)}")
    print("End one: yahboomd web --end-session NUMBER. End all: yahboomd web --end-session all")


def end_sessions(folder: Path, which: str) -> str:
    """End the session of this number, or `all` and every unused link; returns what was done.

    Raises:
        ConfigError: There is no such session, or its file cannot be removed.
    """
    try:
        if which == "all":
            ended = sum(end_stored(folder, number) for number in stored_numbers(folder))
            links = forget_links(folder)
            return f"{ended} sessions are ended, and {links} unused links are void."
        if which in stored_numbers(folder) and end_stored(folder, which):
            return f"Session {which} is ended: its page shows it within seconds."
    except OSError as error:
        raise ConfigError(
            f"A session in {folder} cannot be ended: {error.strerror}.",
            remedy="If it belongs to the service: `sudo yahboomd web --end-session ...`.",
        ) from error
    raise ConfigError(
        f"There is no session {which} in {folder}.",
        remedy="`yahboomd web --sessions` lists them; those of the service: with sudo.",
    )


def _ago(idle_s: int) -> str:
    for size_s, unit in ((86400, "days"), (3600, "h"), (60, "min")):
        if idle_s >= 2 * size_s:
            return f"{idle_s // size_s} {unit} ago"
    return "now"
