"""The bus half of ``yahboomd stop``: engages or releases the daemon's emergency stop."""

from __future__ import annotations

import asyncio
import contextlib

import msgspec

from yahboomd.client import AsyncRobot
from yahboomd.client.streams import read_sample
from yahboomd.core.bus import keys
from yahboomd.core.config import Config
from yahboomd.core.errors import BusError, NoDaemon, Refused
from yahboomd.core.messages.native import StatusSample, WheelsSample
from yahboomd.core.program import release_command
from yahboomd.tools.robot.daemon_address import client_options
from yahboomd.tools.stop.stop_local import same_port, verdict
from yahboomd.tools.terminal.words import listed

STATUS_WITHIN_S = 1.5
STAND_WITHIN_S = 2.0


class BusStop(msgspec.Struct, frozen=True, kw_only=True):
    """The daemons' answers to a stop.

    Attributes:
        words: The answer and the observed motion, for a person.
    """

    stood: bool
    words: str
    daemons: int = 1


async def engage(
    endpoints: tuple[str, ...],
    config: Config,
    *,
    port: str = "",
    within_s: float = STAND_WITHIN_S,
) -> BusStop | None:
    """Engage the emergency stop of every daemon there, and watch the wheels.

    Args:
        port: Only a daemon on this port is meant; empty for every daemon.

    Returns:
        The outcome; None if no daemon answers.
    """
    robot = AsyncRobot(client_options(endpoints, config))
    stood = standing = False
    try:
        await robot.join(0.0)
        if port and await _elsewhere(robot, port):
            return None
        robot.newest(WheelsSample)  # Subscribes, so that the wheels' motion is known at the end.
        answer = await robot.request_by_name(keys.ESTOP, b'{"by":"yahboomd stop"}')
        if not answer.answered:
            return None
        standing = await robot.standing(within_s)
        stood = answer.success and standing
        wheels = robot.newest(WheelsSample)
    except BusError:
        return None
    finally:
        await robot.close()
    speeds = () if wheels is None else wheels.speed_m_s
    fastest_m_s = max(map(abs, speeds), default=None)
    again = release_command(config.zenoh.namespace, endpoints)
    return BusStop(
        stood=stood,
        words=f"{answer.message} {verdict(fastest_m_s, stood=standing, again=again)}",
        daemons=answer.answered,
    )


async def _elsewhere(robot: AsyncRobot, port: str) -> bool:
    """Whether the daemons that answer are known to have other ports.

    It waits for a slow answer, because stopping the wrong robot would be a fault too. A daemon that
    has just started names its port once its board is identified.
    """
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(STATUS_WITHIN_S):
            while True:
                payloads = await robot.ask(keys.STATUS, timeout_s=STATUS_WITHIN_S)
                samples = [read_sample(payload, StatusSample) for payload in payloads]
                ports = [str(each.board.get("port", "")) for each in samples if each]
                if ports and all(ports):
                    return not any(same_port(each, port) for each in ports)
                await asyncio.sleep(0.1)
    return False


def release(endpoints: tuple[str, ...], config: Config, *, port: str = "") -> str:
    """Release the emergency stop; returns the daemon's answer.

    Args:
        port: Only a daemon on this port is meant; empty for every daemon.

    Raises:
        BusError: No daemon answers, it has another port, or it refuses.
    """
    return asyncio.run(_release(endpoints, config, port))


async def _release(endpoints: tuple[str, ...], config: Config, port: str) -> str:
    robot = AsyncRobot(client_options(endpoints, config))
    try:
        await _join(robot, endpoints)
        if port and await _elsewhere(robot, port):
            raise NoDaemon(
                f"The daemon at {listed(endpoints)} is not on {port}: nothing was released.",
                remedy="--connect or --namespace names the daemon on that port.",
            )
        answer = await robot.request_by_name(keys.ESTOP_RESET)
    finally:
        await robot.close()
    if not answer.answered:
        raise no_daemon(endpoints)
    if not answer.success:
        raise Refused(answer.message)
    return answer.message


async def _join(robot: AsyncRobot, endpoints: tuple[str, ...]) -> None:
    try:
        await robot.join(0.0)
    except NoDaemon as error:
        raise no_daemon(endpoints) from error


def no_daemon(endpoints: tuple[str, ...]) -> NoDaemon:
    """The error if no daemon answers."""
    return NoDaemon(
        f"No daemon answers at {listed(endpoints)}.",
        remedy="Is it running, under this namespace (--namespace)? --connect names another place.",
    )
