"""The Python client: drive a robot and read what it publishes, with asyncio or without.

``async with connect(...) as robot:`` gives an :class:`AsyncRobot`; ``with Robot(...) as robot:`` is
the same for programs without asyncio. Leaving either stops the robot. `docs/clients.md` shows both.
"""

from yahboomd.client.async_robot import AsyncRobot, connect
from yahboomd.client.commanding import Counters
from yahboomd.client.move_messages import Move, MoveSample
from yahboomd.client.plain_robot import Robot
from yahboomd.client.robot_moves import MoveEnded
from yahboomd.client.services import Answer
from yahboomd.client.streams import Samples
from yahboomd.core.errors import BusError, CommandEnded, NoDaemon, Refused, YahboomdError
from yahboomd.core.messages.native import (
    BatterySample,
    EventSample,
    ImuSample,
    PoseSample,
    ServiceReply,
    StatusSample,
    TwistSample,
    WheelsSample,
)
from yahboomd.core.model import Twist2d

__all__ = [
    "Answer",
    "AsyncRobot",
    "BatterySample",
    "BusError",
    "CommandEnded",
    "Counters",
    "EventSample",
    "ImuSample",
    "Move",
    "MoveEnded",
    "MoveSample",
    "NoDaemon",
    "PoseSample",
    "Refused",
    "Robot",
    "Samples",
    "ServiceReply",
    "StatusSample",
    "Twist2d",
    "TwistSample",
    "WheelsSample",
    "YahboomdError",
    "connect",
]
