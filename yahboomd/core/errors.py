"""The exceptions of yahboomd, split by what the caller does about them.

``YahboomdError``
├── ``ConfigError``      a person edits something: exit 78 (EX_CONFIG)
├── ``LinkError``        the port: the supervisor reconnects
│   ├── ``PortMissing``      nothing there to open: exit 69 (EX_UNAVAILABLE)
│   ├── ``PortBusy``         another process owns it
│   ├── ``PortDenied``       no permission: exit 77 (EX_NOPERM)
│   ├── ``PortLost``         it was open and went away
│   └── ``BoardSilent``      open, and nothing that answers like a board
├── ``BoardError``       the board answered, and refuses or must not be driven
│   └── ``BoardStoresNothing``  it has no settings that could be stored
├── ``BusError``         the Zenoh session: exit 69 (EX_UNAVAILABLE)
│   ├── ``NoDaemon``         no daemon answers there
│   ├── ``BusConfigError``   its settings, without any network: exit 78, as a ConfigError
│   └── ``Refused``          the daemon answered with a refusal: exit 1
├── ``CommandEnded``     this program stood still, and its robot stopped: exit 1
├── ``ListenError``      another listener of ours: exit 69 (EX_UNAVAILABLE)
└── ``LimitError``       too few files or threads, or too little memory: exit 71 (EX_OSERR)

Bad bytes, from the wire or from the bus, are no exceptions: they are counted.
"""

from __future__ import annotations

from typing import ClassVar

# Windows' module os, where a client may run, has no names for them.
EX_UNAVAILABLE, EX_SOFTWARE, EX_OSERR, EX_NOPERM, EX_CONFIG = 69, 70, 71, 77, 78


class YahboomdError(Exception):
    """An error for a person: a message and a remedy.

    Args:
        message: The fault and its place (port, key, file and line).
        remedy: The person's next step; empty if there is none.
    """

    exit_code: ClassVar[int] = EX_SOFTWARE

    def __init__(self, message: str, *, remedy: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.remedy = remedy

    def __str__(self) -> str:
        return f"{self.message} {self.remedy}".rstrip()


class ConfigError(YahboomdError):
    """The configuration cannot be used; the message names every mistake in it."""

    exit_code = EX_CONFIG


class LinkError(YahboomdError):
    """The serial port cannot be used now; a later attempt may succeed."""

    exit_code = EX_UNAVAILABLE


class PortMissing(LinkError):
    """There is no such port."""


class PortBusy(LinkError):
    """Another process holds the port."""


class PortDenied(LinkError):
    """The port may not be opened by this user."""

    exit_code = EX_NOPERM


class PortLost(LinkError):
    """The open port was lost."""


class BoardSilent(LinkError):
    """The port is open, and no board answers on it."""


class BoardError(YahboomdError):
    """The board answered, but refuses, or must not be driven with its settings."""

    exit_code = EX_CONFIG


class BoardStoresNothing(BoardError):
    """The board's dialect stores no settings: it gets its motor type at each connection."""


class BusError(YahboomdError):
    """The Zenoh session cannot be opened or has been lost for good."""

    exit_code = EX_UNAVAILABLE


class BusConfigError(ConfigError, BusError):
    """The bus cannot be used with these settings, whatever the network does."""


class NoDaemon(BusError):
    """No daemon answers there now; it may start later."""


class Refused(BusError):
    """The daemon refused the request; the message gives the reason."""

    exit_code = 1


class CommandEnded(YahboomdError):
    """This program did not run for a moment: the robot stopped, and its command has ended."""

    exit_code = 1


class ListenError(YahboomdError):
    """An address for scrapers cannot be listened on."""

    exit_code = EX_UNAVAILABLE


class LimitError(YahboomdError):
    """The system gives this process too few files or threads, or too little memory."""

    exit_code = EX_OSERR
