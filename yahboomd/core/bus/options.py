"""The options of the bus, and the Zenoh configuration that they become.

The defaults make a robot that cannot be reached over the network: a router on loopback, without
scouting. Zenoh's own would listen on every interface and answer to multicast.
"""

from __future__ import annotations

import errno
import json
import re
from pathlib import Path
from typing import Any, Literal, TypeAlias

import msgspec
import zenoh

from yahboomd.core.errors import BusConfigError
from yahboomd.core.names import endpoint_problem, is_local, name_problem

Mode: TypeAlias = Literal["router", "peer", "client"]

_OWN_SETTINGS = {
    "mode": "mode",
    "listen/endpoints": "listen",
    "connect/endpoints": "connect",
    "namespace": "namespace",
}
"""Zenoh's settings that have a name in yahboomd's own configuration, and only there."""


_LARGEST_BYTES = 1_000_000
"""A configuration is a few kilobytes; more is another file."""

_DEEPEST = 100
"""Zenoh's own settings nest ten deep. Its parser recurses, and ends the process at some 50,000."""

_TEXT_OR_COMMENT = re.compile(
    r""""(?:[^"\\]|\\.)*["\\]?|'(?:[^'\\]|\\.)*['\\]?|//[^\n\r\u2028\u2029]*|/\*.*?(?:\*/|\Z)""",
    re.DOTALL,
)
"""Of JSON5; one without its end extends to the end of the text, so that the search is made once."""


_ON_PORTS = ("tcp/", "udp/", "tls/", "quic/")
_PLACE = r"(tcp|udp)/.*|(tls|quic)/[^?#]*"
"""The address of an endpoint, and an interface that may be missing now."""


class BusOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of a Zenoh session.

    Attributes:
        mode: ``router`` serves clients and peers alike, and joins another router as a client does;
            two ``peer`` sessions that share a router but do not reach each other exchange nothing;
            a ``client`` alone cannot be opened without its router.
        listen: Endpoints to listen on. A client listens nowhere.
        connect: Routers to join: the first that answers, if there are several (a peer joins
            all). Tried for ever, never waited for (except by a client).
        namespace: Put in front of every key; empty for none.
        config_file: A JSON5 file of Zenoh's for everything else; its settings win over those that
            :func:`zenoh_config` would choose.
        enforces: Whether the access control of ``config_file`` is enforced here. It is written for
            the messages to the daemon: a tool that reads the same file would refuse the daemon's.
        gossip: Whether a router introduces its peers to each other; nodes of rmw_zenoh exchange
            nothing without. The session itself connects to none of them.
        lease_s: The silence after which the others take this session for gone.
        open_timeout_s: The longest wait for the session to open.
        close_timeout_s: The longest wait for it to close.
    """

    mode: Mode = "router"
    listen: tuple[str, ...] = ("tcp/127.0.0.1:7448",)
    connect: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    namespace: str = ""
    config_file: Path | None = None
    enforces: bool = True
    gossip: bool = False
    lease_s: float = 2.0
    open_timeout_s: float = 5.0
    close_timeout_s: float = 3.0

    @property
    def listening(self) -> tuple[str, ...]:
        return () if self.mode == "client" else self.listen

    @property
    def has_uplink(self) -> bool:
        """Whether another router is joined by a session of its own; see :mod:`.zenoh_sessions`."""
        return self.mode == "router" and bool(self.connect)

    @property
    def exposed(self) -> tuple[str, ...]:
        """The endpoints among them that other machines may reach."""
        return tuple(endpoint for endpoint in self.listening if not is_local(endpoint))


def admitted(options: BusOptions, endpoint: str = "") -> str:
    """Describe who may use the bus through ``endpoint``, as a clause: "every user can drive".

    Args:
        options: Options of the bus; their file must be readable.
        endpoint: The endpoint that is reached; empty for a router that the session joins.
    """
    config = _from_file(options.config_file, zenoh.Config())

    def is_set(key: str) -> bool:
        return config.get_json(key) not in {"null", "false", '""'}

    if is_set("access_control/enabled"):
        return f"the access control in {options.config_file} decides who can drive"
    if endpoint and is_set("transport/auth/usrpwd/dictionary_file"):
        return f"every user that {options.config_file} names can drive"
    tls = endpoint.partition("/")[0] in {"tls", "quic"}
    if tls and is_set("transport/link/tls/enable_mtls"):
        return f"every certificate that {options.config_file} accepts can drive"
    return "every program that reaches it can drive"


def zenoh_config(options: BusOptions, *, uplink: bool = False) -> zenoh.Config:
    """Zenoh's configuration for these options, with the user's own file in it.

    Args:
        uplink: For the session that joins another router, instead of the one that listens.

    Raises:
        BusConfigError: The namespace or an endpoint is wrong, or the file cannot be read or used.
    """
    _check(options)
    plain = zenoh.Config()
    config = _from_file(options.config_file, plain)
    if not options.enforces:
        config.insert_json5("access_control/enabled", "false")
    for key, value in (_uplink(options) if uplink else _always(options)).items():
        config.insert_json5(key, json.dumps(value))
    for key, value in _unless_set(options, uplink=uplink).items():
        # A default of Zenoh's in the file cannot be distinguished from a value that is not set.
        if config.get_json(key) == plain.get_json(key):
            config.insert_json5(key, json.dumps(value))
    return config


def open_offline(options: BusOptions) -> None:
    """Open and close a session with these options that reaches no network.

    Its listeners listen on free ports of this machine: their protocol has to be allowed, and a
    certificate and its key are read.

    Raises:
        BusConfigError: Zenoh refuses them, whatever the network does.
    """
    listen = (each for each in options.listening if each.startswith(_ON_PORTS))
    own = tuple(re.sub(_PLACE, r"\1\2/127.0.0.1:0", each) for each in listen)
    config = zenoh_config(msgspec.structs.replace(options, mode="peer", listen=own, connect=()))
    config.insert_json5("scouting/multicast/enabled", "false")
    try:
        zenoh.open(config).close()
    except zenoh.ZError as error:
        raise _unusable(options.config_file, short(error)) from error


def _always(options: BusOptions) -> dict[str, Any]:
    return {
        "mode": options.mode,
        "listen/endpoints": list(options.listening),
        "connect/endpoints": [] if options.has_uplink else list(options.connect),
    }


def _uplink(options: BusOptions) -> dict[str, Any]:
    return {
        "mode": "client",
        "listen/endpoints": [],
        "connect/endpoints": list(options.connect),
        # One try: otherwise a client's open would keep its thread until a router is there.
        "connect/timeout_ms": 0,
        # Others take two sessions with one id for one.
        "id": None,
    }


def _unless_set(options: BusOptions, *, uplink: bool) -> dict[str, Any]:
    client = uplink or options.mode == "client"
    return {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": options.gossip and not client,
        "scouting/gossip/autoconnect": {"router": [], "peer": []},
        # At open a router waits this long for results of scouting: half a second by default.
        "scouting/delay": 0,
        "open/return_conditions/connect_scouted": False,
        # Never waited for, tried for ever. A client is refused by Zenoh when its router is not
        # there in time, and with no limit its open would never return.
        "connect/timeout_ms": 0 if uplink else 1000 if client else -1,
        "connect/exit_on_failure": client,
        "connect/retry": {
            "period_init_ms": 250,
            "period_max_ms": 2000,
            "period_increase_factor": 2.0,
        },
        # A latched publisher's cache is kept by timestamps.
        "timestamping/enabled": True,
        # A connection without a complete handshake holds a place until this timeout (10 s by
        # default), and beyond this number (100) each new one is closed at once: 150 silent ones
        # locked everybody out.
        "transport/unicast/accept_timeout": 3000,
        "transport/unicast/accept_pending": 500,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": max(1, round(options.lease_s * 1000)),
        # A connection that takes nothing for this long is closed (5 s by default): until then it
        # holds up events and the closing of the session.
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,
        # Zenoh would assemble a message of one gigabyte for anyone who begins to send one.
        "transport/link/rx/max_message_size": 16 * 1024 * 1024,
    }


def _check(options: BusOptions) -> None:
    if options.namespace and (problem := name_problem(options.namespace)):
        raise BusConfigError(
            f"The namespace cannot be used: {problem}.",
            remedy="Set zenoh.namespace to a name such as 'bot1'.",
        )
    for setting, endpoints in (("listen", options.listening), ("connect", options.connect)):
        for endpoint in endpoints:
            if problem := endpoint_problem(endpoint):
                raise BusConfigError(f"An endpoint in zenoh.{setting} cannot be used: {problem}.")
    if options.mode == "client" and not options.connect:
        raise BusConfigError(
            "A Zenoh client needs a router to connect to, and zenoh.connect is empty.",
            remedy="Name one there, or set zenoh.mode to 'router'.",
        )


def _from_file(path: Path | None, plain: zenoh.Config) -> zenoh.Config:
    if path is None:
        return zenoh.Config()
    try:
        config = zenoh.Config.from_json5(file_text(path))
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise _unusable(path, f"it cannot be read: {why}") from error
    except ValueError as error:
        raise _unusable(path, str(error)) from error
    except zenoh.ZError as error:
        raise _unusable(path, _reason(error)) from None
    for key, name in _OWN_SETTINGS.items():
        if config.get_json(key) != plain.get_json(key):
            raise BusConfigError(
                f"The Zenoh configuration {path} sets {key}, which is zenoh.{name} here.",
                remedy=f"Take it out of that file and set zenoh.{name} in config.toml.",
            )
    return config


def file_text(path: Path) -> str:
    """The text of a file that Zenoh's parser survives; a ValueError for any other."""
    if path.exists() and not path.is_file():
        # Opening a pipe would wait until somebody writes to it.
        raise OSError(errno.EINVAL, "it is no ordinary file")
    with path.open("rb") as file:
        raw = file.read(_LARGEST_BYTES + 1)
    if len(raw) > _LARGEST_BYTES:
        raise ValueError(f"it is larger than {_LARGEST_BYTES} bytes, so not a configuration")
    text = raw.decode("utf-8")
    depth = 0
    for bracket in re.findall(r"[][{}]", _TEXT_OR_COMMENT.sub("", text)):
        depth += 1 if bracket in "[{" else -1
        if depth > _DEEPEST:
            raise ValueError(f"its lists and objects are nested more than {_DEEPEST} deep")
    return text


def _unusable(path: Path | None, why: str) -> BusConfigError:
    name = "in [zenoh]" if path is None else str(path)
    return BusConfigError(
        f"The Zenoh configuration {name} cannot be used: {why}.",
        remedy="docs/security.md has examples that work.",
    )


def short(error: zenoh.ZError) -> str:
    """Zenoh's words without places in its source, and without lines of the user's file."""
    plain = re.sub(r"(?m)^ *\d* \|.*$| at /\S+\.rs:\d+\.?", "", str(error))
    return " ".join(plain.split()).rstrip(" .")[:400]


def _reason(error: zenoh.ZError) -> str:
    """Zenoh's reason without the value that it quotes, which may be a secret."""
    text = short(error)
    what = re.sub(r".*(?:, (?=expected )|`: )", "", text)
    clean = what != text or re.fullmatch(r"--> .*|[A-Za-z ,]+", text)
    return what if clean else "it has a value that Zenoh does not take"
