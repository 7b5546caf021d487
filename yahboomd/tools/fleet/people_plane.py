"""The people of a fleet at one robot: services under their own names, and who drives.

The access rules of a fleet let each person, and nobody else, use the keys with the person's name.
So the key makes the name true: a payload can claim any. Programs on the robot itself are believed.
"""

from __future__ import annotations

from functools import partial

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.services import BusQuery
from yahboomd.core.clock import Clock
from yahboomd.core.config import Config
from yahboomd.core.daemon.planes import Guard, PlaneRequests
from yahboomd.core.messages.native import ServiceReply, StatusSample
from yahboomd.core.model import Event, ImuEstimate, OdometryEstimate
from yahboomd.tools.fleet.people_keys import NAMED, own_key, own_stop, person_of


def people_of(config: Config) -> tuple[str, ...]:
    """The people with a source of their own; none unless the robot is one of a fleet."""
    found = map(person_of, config.command.sources) if config.estop.groups else ()
    return tuple(filter(None, found))


class PeoplePlane:
    """Offers the services that change something under each person's name, and records their use.

    Args:
        people: Their names.
    """

    name = "the people of the fleet"

    def __init__(self, people: tuple[str, ...]) -> None:
        self._people = people

    def start(
        self, bus: Bus, _config: Config, _clock: Clock, requests: PlaneRequests, _guarded: Guard
    ) -> DriverWatch:
        """Offer them, and watch who drives."""
        services = requests.services
        for person in self._people:
            for key in NAMED:
                action = partial(self._ask, requests, person, key)
                services.offer(bus, key, action, at=own_key(key, person))
        return DriverWatch(requests)

    def _ask(
        self, requests: PlaneRequests, person: str, key: str, request: BusQuery
    ) -> ServiceReply:
        services = requests.services
        if key == keys.ESTOP and not request.harmless:
            words = services.operator.engage_estop(own_stop(person))
            reply = ServiceReply(success=True, message=words)
        else:
            reply = services.actions[key](request)
        requests.event(
            Event(
                kind="asked_by_name",
                severity="info",
                message=f"{person} asked for {key}: {reply.message}",
                data={"name": person, "key": key, "done": reply.success},
            )
        )
        return reply


class DriverWatch:
    """Publishes an event when another source has control. It publishes nothing else."""

    def __init__(self, requests: PlaneRequests) -> None:
        self._event = requests.event
        self._driver: str | None = None

    def status(self, sample: StatusSample) -> None:
        """Compare the driver with the last one."""
        last, self._driver = self._driver, sample.driver
        if last == sample.driver:
            return
        if sample.driver is None:
            words = f"No source has control any more; {last} had it."
        else:
            person = person_of(sample.driver)
            who = f"{person} has control" if person else f"{sample.driver} has control"
            words = f"{who}, by a key of that person's own." if person else f"{who}."
        self._event(
            Event(
                kind="driver_changed",
                severity="info",
                message=words,
                data={"name": person_of(sample.driver or ""), "key": sample.driver, "done": None},
            )
        )

    def estimate(self, estimate: OdometryEstimate, stamp_ns: int) -> None:
        """Nothing."""

    def imu(self, estimate: ImuEstimate, stamp_ns: int) -> None:
        """Nothing."""

    def battery(self, volts: float, stamp_ns: int) -> None:
        """Nothing."""

    def event(self, event: Event, stamp_ns: int) -> None:
        """Nothing."""
