"""The people of a fleet at one robot: services under their own names, and who drives.

The access rules of a fleet let each person, and nobody else, use the keys with the person's name.
So the key makes the name true: a payload can claim any. Programs on the robot itself are believed.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import msgspec

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.keys import own_key
from yahboomd.core.bus.services import BusQuery
from yahboomd.core.clock import Clock
from yahboomd.core.config import Config
from yahboomd.core.daemon.planes import Guard, PlaneRequests
from yahboomd.core.daemon.requests import Services
from yahboomd.core.messages.native import ServiceReply, StatusSample
from yahboomd.core.model import Event, ImuEstimate, OdometryEstimate
from yahboomd.tools.people.people_keys import NAMED, own_stop, person_of

TOGETHER_NS = 10_000_000_000
"""Requests that repeat one within this time are published together."""


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
        self, bus: Bus, _config: Config, clock: Clock, requests: PlaneRequests, _guarded: Guard
    ) -> DriverWatch:
        """Offer them, and watch who drives."""
        services = requests.services
        asked = RequestsByName(requests.event, clock)
        for person in self._people:
            for key in NAMED:
                action = partial(self._ask, services, asked, person, key)
                services.offer(bus, key, action, at=own_key(key, person))
        return DriverWatch(requests, asked)

    def _ask(
        self,
        services: Services,
        asked: RequestsByName,
        person: str,
        key: str,
        request: BusQuery,
    ) -> ServiceReply:
        if key == keys.ESTOP and not request.harmless:
            words = services.operator.engage_estop(own_stop(person))
            reply = ServiceReply(success=True, message=words)
        else:
            reply = services.actions[key](request)
        asked.note(person, key, reply)
        return reply


class RequestsByName:
    """Publishes who asked for what, and answers for no flood of events.

    The first request is an event at once. Those of the next ten seconds, by the same person for the
    same service and with the same outcome, are counted, and become one event.

    Args:
        event: Publishes one.
    """

    def __init__(self, event: Callable[[Event], None], clock: Clock) -> None:
        self._event = event
        self._clock = clock
        self._kept: dict[tuple[str, str, bool], _Repeated] = {}

    def note(self, person: str, key: str, reply: ServiceReply) -> None:
        """Publish a request, or count it."""
        self.settle()
        asked = person, key, reply.success
        kept = self._kept.get(asked)
        if kept is None:
            self._kept[asked] = _Repeated(since_ns=self._clock.now_ns())
            self._publish(asked, 1, reply.message)
        else:
            kept.times += 1
            kept.answer = reply.message

    def settle(self) -> None:
        """Publish the counted requests whose ten seconds are over; call it now and then."""
        now_ns = self._clock.now_ns()
        over = [
            asked for asked, kept in self._kept.items() if now_ns - kept.since_ns >= TOGETHER_NS
        ]
        for asked in over:
            kept = self._kept.pop(asked)
            if kept.times:
                # The time begins anew: one event in ten seconds, for as long as they come.
                self._kept[asked] = _Repeated(since_ns=now_ns)
                self._publish(asked, kept.times, kept.answer)

    def _publish(self, asked: tuple[str, str, bool], times: int, answer: str) -> None:
        person, key, done = asked
        how_often = "" if times == 1 else f" {times} times, the last answer"
        self._event(
            Event(
                kind="asked_by_name",
                severity="info",
                message=f"{person} asked for {key}{how_often}: {answer}",
                data={"name": person, "key": key, "done": done, "times": times},
            )
        )


class _Repeated(msgspec.Struct, kw_only=True):
    since_ns: int
    times: int = 0
    answer: str = ""


class DriverWatch:
    """Publishes an event when another source has control, and requests that were counted."""

    def __init__(self, requests: PlaneRequests, asked: RequestsByName) -> None:
        self._event = requests.event
        self._asked = asked
        self._driver: str | None = None

    def status(self, sample: StatusSample) -> None:
        """Compare the driver with the last one; this comes twice a second."""
        self._asked.settle()
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
                data={
                    "name": person_of(sample.driver or ""),
                    "key": sample.driver,
                    "done": None,
                    "times": None,
                },
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
