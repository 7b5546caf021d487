"""Makes a client from an address."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from yahboomd.client.async_robot import DEADMAN_S, ENDPOINT, RATE_HZ, WAIT_S, AsyncRobot
from yahboomd.core.bus.options import BusOptions


def client_options(
    endpoint: str | Sequence[str], *, namespace: str = "", zenoh_file: str | Path | None = None
) -> BusOptions:
    """The options of a client's session.

    Args:
        endpoint: The address of the daemon or its router, or several of them.
        namespace: The robot's.
        zenoh_file: A JSON5 file of Zenoh's: certificates, passwords. Access control is enforced by
            the daemon.
    """
    return BusOptions(
        mode="client",
        listen=(),
        connect=(endpoint,) if isinstance(endpoint, str) else tuple(endpoint),
        namespace=namespace,
        config_file=Path(zenoh_file) if zenoh_file else None,
        enforces=False,
    )


def connect(
    endpoint: str | Sequence[str] = ENDPOINT,
    *,
    namespace: str = "",
    source: str | None = None,
    label: str = "",
    deadman_s: float = DEADMAN_S,
    rate_hz: float = RATE_HZ,
    wait_s: float = WAIT_S,
    zenoh_file: str | Path | None = None,
) -> AsyncRobot:
    """Make a robot for asyncio, to be entered by ``async with``.

    Entering waits for the daemon; leaving stops the robot, also after an exception. In between a
    lost connection reconnects by itself.

    Args:
        endpoint: The address of the daemon or its router, or several of them.
        namespace: The robot's, as in the section ``[zenoh]`` of its configuration.
        source: The key to command on; the daemon's ``[command.sources]`` gives it its priority.
            Default: ``cmd_vel``; with a person's file of a fleet, ``cmd_vel/NAME``.
        label: Who commands, for people who read the daemon's status.
        deadman_s: How long a command without ``for_s`` lasts, in seconds.
        rate_hz: How often a command is repeated. The daemon stops the robot after 0.5 s of silence.
        wait_s: How long entering waits for the daemon, in seconds; 0: one try, ``math.inf``:
            without limit.
        zenoh_file: A JSON5 file of Zenoh's, for certificates and passwords.

    Raises:
        ValueError: An argument is out of range.
        NoDaemon: (On entering) no daemon answers there in time; the message includes a remedy.
        BusError: (On entering) the endpoint, the namespace or the file cannot be used.
    """
    return AsyncRobot(
        client_options(endpoint, namespace=namespace, zenoh_file=zenoh_file),
        source=source,
        label=label,
        deadman_s=deadman_s,
        rate_hz=rate_hz,
        wait_s=wait_s,
    )
