"""``yahboomd web``: serves the page for the phone, in a process of its own."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import ipaddress
import os
import pickle
import re
import signal
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

from yahboomd.cli.shared_options import (
    add_bus_options,
    add_config_options,
    add_source_option,
    daemon_options,
    read_config,
    robot_arguments,
    source_of,
)
from yahboomd.core.errors import ConfigError
from yahboomd.core.names import PAGE_SOURCE

if TYPE_CHECKING:
    from socket import socket
    from ssl import SSLContext

    from yahboomd.core.bus.options import BusOptions
    from yahboomd.core.clock import Clock
    from yahboomd.tools.metrics.http_listener import Place
    from yahboomd.web.page_hub import PageHub
    from yahboomd.web.page_tools import RobotList, ToolSettings
    from yahboomd.web.phone_sessions import Refusal
    from yahboomd.web.web_server import WebServer

SERVICES = Path("/etc/yahboomd")
"""The folder of services' configurations: their black boxes are in the daemon's directory."""

DEFAULT_PLACE = "127.0.0.1:8480"

REFUSALS_S = 60

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

DESCRIPTION = """\
Serve a page from which a phone drives the robot, watches it and stops it. It is an ordinary client
of the bus, and everything that it shows is in this installation: a robot's hotspot needs no
internet. Only this machine reaches it, unless --listen names another address: then each phone
gets in by a link, which this command prints, also as a QR code for the phone's camera. A link
works once; the phone then has a session of its own.
"""

EPILOG = """\
examples:
  yahboomd web                                 for a browser on this machine
  yahboomd web --listen 0.0.0.0:8480           for phones: prints the link and a QR code
  yahboomd web --show-link                     make links for further phones
  yahboomd web --sessions                      the phones that may use the page
  yahboomd web --end-session 3f9a2c            one of them may no longer; all: every one
  yahboomd web --make-certificate              once: the page is served over TLS from then on
  yahboomd web --listen 0.0.0.0:8480 --certificate FILE --key FILE

As a service: sudo yahboomd install --web. docs/web.md explains who gets in. Ctrl-C ends it.

exit status:
  0    you ended it
  69   the address is taken, or the bus can never be reached like this
  71   the system allows this process too few files or threads, or too little memory
  78   a mistake in the configuration, or a certificate that cannot be used
"""


class _Setup(NamedTuple):
    """Everything that serving needs."""

    place: Place
    names: list[str]
    context: SSLContext | None
    options: BusOptions
    source: str
    folder: Path
    tools: ToolSettings


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--listen",
        metavar="ADDRESS:PORT",
        help=f"where browsers find the page (default: {DEFAULT_PLACE}); 0.0.0.0:8480 for every "
        "network of this machine",
    )
    parser.add_argument(
        "--host-name",
        metavar="NAME",
        type=_host_name,
        action="append",
        default=[],
        help="a name by which browsers may ask, besides addresses and the names of this machine; "
        "may be repeated",
    )
    parser.add_argument("--certificate", metavar="FILE", type=Path, help="serve over TLS with this")
    parser.add_argument("--key", metavar="FILE", type=Path, help="the certificate's private key")
    parser.add_argument(
        "--show-link",
        action="store_true",
        help="make a link to drive and one to watch, each for one phone; print them, and the QR "
        "code; serve nothing",
    )
    parser.add_argument(
        "--sessions",
        action="store_true",
        help="list the phones that may use the page; serve nothing",
    )
    parser.add_argument(
        "--end-session",
        metavar="NUMBER",
        help="end the session of a phone by its number in that list, or of all phones; serve "
        "nothing",
    )
    parser.add_argument(
        "--make-certificate",
        action="store_true",
        help="make a certificate for the addresses and names of this machine; serve nothing",
    )
    parser.add_argument(
        "--fleet",
        metavar="FILE",
        type=Path,
        help="your file of `yahboomd fleet`: the page lists its robots too, and stops all of them",
    )
    add_source_option(parser, PAGE_SOURCE)
    add_bus_options(parser)
    add_config_options(parser)


def _host_name(text: str) -> str:
    """A name or an address in the form that browsers send."""
    with contextlib.suppress(ValueError):
        name = text.encode("idna").decode()
        if re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", name) or ipaddress.ip_address(name):
            return name
    raise argparse.ArgumentTypeError(f"{text!r} is no name of a machine, such as robot.local")


def run(args: argparse.Namespace) -> int:
    """Serve until a signal ends it."""
    folder = state_folder(os.environ, os.geteuid())
    if args.make_certificate:
        return _certify(folder, args.host_name)
    if args.end_session is not None or args.sessions or args.show_link:
        return _access(args, folder)
    from yahboomd.web.page_tools import ToolSettings

    place = _place(args.listen or DEFAULT_PLACE)
    loaded = read_config_apart(args)
    if loaded.path is not None and loaded.path.parent == SERVICES:
        # Tools that pages use work in the directory of the robot's service, not of the page's.
        os.environ.pop("STATE_DIRECTORY", None)
    setup = _Setup(
        place=place,
        names=args.host_name,
        context=_context(args, place, folder),
        folder=folder,
        options=loaded.options,
        source=loaded.source,
        tools=ToolSettings(
            robot=robot_arguments(args),
            recordings=folder / "recordings",
            load=lambda: read_config(args),
            camera=loaded.camera,
            fleet=_fleet(args.fleet) if args.fleet else None,
        ),
    )
    return asyncio.run(_serve(setup))


def _fleet(papers: Path) -> RobotList:
    from yahboomd.cli import packages
    from yahboomd.core.clock import SystemClock

    made = cast("Callable[[Path, Clock], RobotList]", packages.page_part("fleet"))
    return made(papers, SystemClock())


class ReadApart(NamedTuple):
    """What the page needs of a configuration, and the file that it was read from, if any."""

    options: BusOptions
    source: str
    camera: str
    path: Path | None


def read_config_apart(args: argparse.Namespace) -> ReadApart:
    """Read the configuration in a process that ends: pydantic needs 9 MB, which end with it.

    Call it before there are threads, which do not survive in the other process.

    Raises:
        ConfigError: The configuration has mistakes; the error names each.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    reading, writing = os.pipe()
    if (child := os.fork()) == 0:
        # The child never returns: it would end what is the parent's.
        try:
            os.close(reading)
            with os.fdopen(writing, "wb") as pipe:
                pickle.dump(_read(args), pipe)
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        answer = pipe.read()
    os.waitpid(child, 0)
    # Without an answer the child failed: the same here shows why.
    # It comes from our own process.
    found: ReadApart | tuple[str, str] = pickle.loads(answer) if answer else _read(args)  # noqa: S301
    if not isinstance(found, ReadApart):
        message, remedy = found
        raise ConfigError(message, remedy=remedy)
    return found


def _read(args: argparse.Namespace) -> ReadApart | tuple[str, str]:
    try:
        loaded = read_config(args)
        options = daemon_options(args, loaded.config)
        source = source_of(args, loaded.config, PAGE_SOURCE)
    except ConfigError as error:
        return error.message, error.remedy
    return ReadApart(options, source, loaded.config.web.camera, loaded.path)


def state_folder(environ: Mapping[str, str], user_id: int) -> Path:
    """The folder for links, sessions and a certificate; root's is the service's, if there is one.

    Args:
        environ: For ``STATE_DIRECTORY`` (the service manager's), ``XDG_STATE_HOME`` and ``HOME``.
    """
    if given := environ.get("STATE_DIRECTORY", "").split(":")[0]:
        return Path(given)
    if user_id == 0 and (service := Path("/var/lib/yahboomd-web")).is_dir():
        return service
    if state := environ.get("XDG_STATE_HOME"):
        return Path(state) / "yahboomd"
    return Path(environ.get("HOME", "/")) / ".local/state/yahboomd"


def _place(text: str) -> Place:
    from yahboomd.tools.metrics.http_listener import Place

    place = Place.of(text)
    if place is None:
        raise ConfigError(
            f"--listen {text} is no address and port of this machine.",
            remedy=f"Such as {DEFAULT_PLACE}, or 0.0.0.0:8480 for phones.",
        )
    return place


def _context(args: argparse.Namespace, place: Place, folder: Path) -> SSLContext | None:
    """The given certificate; else, beyond loopback, the one that was made here."""
    from yahboomd.web.certificate import CERTIFICATE, KEY, Certificate
    from yahboomd.web.page_link import reachable_hosts

    certificate, key = args.certificate, args.key
    if (certificate is None) != (key is None):
        raise ConfigError("--certificate and --key belong together: give both, or neither.")
    if certificate is None and not place.is_loopback and (folder / CERTIFICATE).exists():
        certificate, key = folder / CERTIFICATE, folder / KEY
    if certificate is None:
        return None
    pair = Certificate(certificate=certificate, key=key)
    context = pair.context()
    if words := pair.lacks(reachable_hosts(place.host)):
        print(f"warning: {words}", file=sys.stderr, flush=True)
    return context


def _certify(folder: Path, names: list[str]) -> int:
    from yahboomd.web.certificate import make_certificate
    from yahboomd.web.page_link import own_addresses, own_names

    hosts = dict.fromkeys(("127.0.0.1", "localhost", *own_addresses(), *sorted(own_names())))
    certificate, key, fingerprint = make_certificate(folder, [*hosts, *names])
    print(f"A certificate is made: {certificate}, with its key {key}.")
    print(f"Its fingerprint (SHA-256): {fingerprint}")
    print("From the next start on `yahboomd web --listen` uses it for other machines. Browsers")
    print("warn of it once, because no authority signed it: compare the fingerprint.")
    return os.EX_OK


def _access(args: argparse.Namespace, folder: Path) -> int:
    from yahboomd.core.clock import SystemClock
    from yahboomd.web.page_link import end_sessions, last_served, print_links, print_sessions

    clock = SystemClock()
    if args.end_session is not None:
        print(end_sessions(folder, args.end_session))
    elif args.sessions:
        print_sessions(folder, clock)
    else:
        given = args.listen is not None
        place, tls = (_place(args.listen), False) if given else last_served(folder)
        tls = tls or _context(args, place, folder) is not None
        print_links(folder, place, clock, tls=tls)
    return os.EX_OK


async def _serve(setup: _Setup) -> int:
    from yahboomd.cli.process_limits import allow_files, check_limits
    from yahboomd.core.clock import SystemClock
    from yahboomd.web.page_hub import PageHub
    from yahboomd.web.page_link import announce, link, own_names
    from yahboomd.web.web_application import RequestOrigin, WebApplication, page_files
    from yahboomd.web.web_server import FILES, WebServer, listen

    check_limits(who="the page's server")
    allow_files(FILES, who="the page's server")
    place, tls = setup.place, setup.context is not None
    clock = SystemClock()
    listener = listen(place.host, place.port)
    port = listener.getsockname()[1]
    place = type(place)(host=place.host, port=port)
    # On loopback everybody who reaches the page drives.
    phones = None if place.is_loopback else setup.folder
    hub = PageHub(setup.options, clock, setup.tools, setup.source, phones)
    if hub.sessions is not None:
        hub.sessions.start()
    names = set(setup.names) | (set() if place.is_loopback else own_names())
    application = WebApplication(
        hub,
        page_files(),
        RequestOrigin(names, local=place.is_loopback, tls=tls),
        clock,
        secure=tls,
        port=port,
    )
    server = WebServer(application.asgi, setup.context)
    loop = asyncio.get_running_loop()
    for number in SIGNALS:
        loop.add_signal_handler(number, _end, server, hub)
    if phones is None:
        print(f"The page is at {link(place.host, port, tls=tls)}", flush=True)
    else:
        announce(setup.folder, place, clock, tls=tls)
    return await _until_ended(server, hub, listener, ", ".join(setup.options.connect))


def _end(server: WebServer, hub: PageHub) -> None:
    # The wheels first.
    hub.stop()
    server.should_exit = True


async def _until_ended(server: WebServer, hub: PageHub, listener: socket, where: str) -> int:
    following = asyncio.create_task(hub.run(), name="web-robot")
    serving = asyncio.create_task(server.serve(sockets=[listener]), name="web-server")
    reporting = asyncio.create_task(_report(hub, where), name="web-report")
    try:
        await asyncio.wait([following, serving], return_when=asyncio.FIRST_COMPLETED)
        _end(server, hub)
        await serving
    finally:
        for task in (following, reporting):
            task.cancel()
        await asyncio.gather(following, reporting, return_exceptions=True)
    if not following.cancelled():
        # The robot can never be reached like this.
        following.result()
    return os.EX_OK


async def _report(hub: PageHub, where: str) -> None:
    """Print when the daemon comes or goes, why the camera shows nothing, and who was refused."""
    alive: bool | None = None
    problem = ""
    told: dict[Refusal, int] = {}
    seconds = 0
    while True:
        await asyncio.sleep(1.0)
        if hub.robot.alive != alive:
            alive = hub.robot.alive
            words = "answers" if alive else "does not answer; it is waited for"
            print(f"yahboomd at {where} {words}.", flush=True)
        if hub.camera is not None and hub.camera.problem not in {"", problem}:
            problem = hub.camera.problem
            print(problem, flush=True)
        seconds += 1
        if hub.sessions is not None and seconds % REFUSALS_S == 1 and hub.sessions.refused != told:
            told = dict(hub.sessions.refused)
            print(f"Refused since the start: {hub.sessions.refused_in_words()}.", flush=True)
