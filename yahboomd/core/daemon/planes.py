"""Planes beside the native one, such as that of ROS 2: they publish, and hand on requests.

Law: the daemon drives without them. Their calls go through the recorders: an error switches that
part of the plane off, is counted and reported, and reaches neither the control path nor the link.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, Protocol, TypeAlias

from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.clock import Clock
from yahboomd.core.config import Config
from yahboomd.core.daemon.commands import SentAt
from yahboomd.core.daemon.recorders import Recorders
from yahboomd.core.daemon.requests import Services
from yahboomd.core.messages.native import StatusSample
from yahboomd.core.model import Event, ImuEstimate, OdometryEstimate

Handler: TypeAlias = Callable[[list[Arrival]], None]

Guard: TypeAlias = Callable[[str, Callable[..., Any]], Callable[..., Any]]
"""Makes a callback harmless: it is given the name of a part of the plane, and a callback, which
returns None from its first error on."""


class PlaneSamples(Protocol):
    """A plane that is on the bus. Stamps are those of the native samples, Unix ns."""

    def estimate(self, estimate: OdometryEstimate, stamp_ns: int) -> None:
        """Publish one reading."""

    def imu(self, estimate: ImuEstimate, stamp_ns: int) -> None:
        """Publish a sample of the inertial sensor."""

    def battery(self, volts: float, stamp_ns: int) -> None:
        """Publish the voltage of the motors' supply."""

    def event(self, event: Event, stamp_ns: int) -> None:
        """Publish an event."""

    def status(self, sample: StatusSample) -> None:
        """Publish the status: twice a second, and when it changes."""


class PlaneRequests(NamedTuple):
    """The parts of the daemon that carry out the requests of a plane.

    Attributes:
        services: Offers actions on further keys, with answers in another encoding.
        commands: Returns the handler of a source's commands, which reads their time of sending as
            given.
        poses: Takes samples that set the pose.
        event: Publishes and logs an event.
    """

    services: Services
    commands: Callable[[str, SentAt], Handler]
    poses: Handler
    event: Callable[[Event], None]


class Plane(Protocol):
    """A plane that is not on the bus yet."""

    @property
    def name(self) -> str:
        """The end of its parts' names, as in "The pose for ROS 2"."""

    def start(
        self, bus: Bus, config: Config, clock: Clock, requests: PlaneRequests, guarded: Guard
    ) -> PlaneSamples:
        """Declare its keys on an open bus, after those of the native plane.

        Args:
            guarded: For each callback of its own that the bus or the daemon is to call.
        """


class Planes:
    """Starts planes, and hands them what the native plane published."""

    def __init__(self, planes: Iterable[Plane], recorders: Recorders) -> None:
        self._planes = tuple(planes)
        self._recorders = recorders
        self._started: list[tuple[str, PlaneSamples]] = []

    def start(self, bus: Bus, config: Config, clock: Clock, requests: PlaneRequests) -> None:
        """Start all of them; one that fails is left out."""
        for plane in self._planes:
            name = f"The start for {plane.name}"
            arguments = bus, config, clock, requests, self._guard(plane.name)
            samples = self._recorders.call(name, plane.start, *arguments)
            if samples is not None:
                self._started.append((plane.name, samples))

    def _guard(self, plane: str) -> Guard:
        return lambda part, callback: self._recorders.guarded(f"{part} for {plane}", callback)

    def estimate(self, estimate: OdometryEstimate, stamp_ns: int) -> None:
        for name, plane in self._started:
            self._recorders.call(f"The pose for {name}", plane.estimate, estimate, stamp_ns)

    def imu(self, estimate: ImuEstimate, stamp_ns: int) -> None:
        for name, plane in self._started:
            self._recorders.call(f"The inertial sensor for {name}", plane.imu, estimate, stamp_ns)

    def battery(self, volts: float, stamp_ns: int) -> None:
        for name, plane in self._started:
            self._recorders.call(f"The voltage for {name}", plane.battery, volts, stamp_ns)

    def event(self, event: Event, stamp_ns: int) -> None:
        for name, plane in self._started:
            self._recorders.call(f"The events for {name}", plane.event, event, stamp_ns)

    def status(self, sample: StatusSample) -> None:
        for name, plane in self._started:
            self._recorders.call(f"The status for {name}", plane.status, sample)
