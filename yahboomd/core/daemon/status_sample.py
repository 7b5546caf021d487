"""The status sample: state, who drives, why the robot stands, and every counter."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.presence import senders
from yahboomd.core.clock import Clock, nanoseconds
from yahboomd.core.daemon import logs
from yahboomd.core.daemon.black_box import KeptBox
from yahboomd.core.daemon.commands import CommandIntake
from yahboomd.core.daemon.control import Controller
from yahboomd.core.daemon.recorders import Recorders
from yahboomd.core.daemon.stamps import STEP_S
from yahboomd.core.daemon.supervisor import Supervisor
from yahboomd.core.drive import standing
from yahboomd.core.messages.native import StatusSample
from yahboomd.core.messages.status_fields import ZEROS
from yahboomd.core.protocol.settings import VERSION


class _Since:
    """The Unix time since which a fact holds.

    It stays while the fact does: the difference of two clocks that are read one by one jitters,
    and the wall clock is slewed. If the wall clock was set it follows.
    """

    def __init__(self) -> None:
        self._fact: object = None
        self._since_ns = self._offset_ns = 0

    def of(self, fact: object, now_ns: int, offset_ns: int) -> int:
        """Since when it holds: since now if it is new.

        Args:
            now_ns: Monotonic time.
            offset_ns: How far wall time is ahead of it.
        """
        if is_new := fact != self._fact:
            self._fact, self._since_ns = fact, now_ns
        if is_new or abs(offset_ns - self._offset_ns) >= nanoseconds(STEP_S):
            self._offset_ns = offset_ns
        return self._since_ns + self._offset_ns


class Status:
    """Collects the status from all stages.

    Args:
        bus: The routers and clients that the daemon is connected to.
        more_bus_facts: Returns facts that the bus itself does not have.
    """

    def __init__(
        self,
        clock: Clock,
        *,
        controller: Controller,
        intake: CommandIntake,
        supervisor: Supervisor,
        bus: Bus,
        box: KeptBox,
        recorders: Recorders,
        more_bus_facts: Callable[[], dict[str, Any]],
    ) -> None:
        self._clock = clock
        self._controller = controller
        self._intake = intake
        self._supervisor = supervisor
        self._bus = bus
        self._box = box
        self._recorders = recorders
        self._more_bus_facts = more_bus_facts
        self._state_since, self._driver_since, self._wheels_since = _Since(), _Since(), _Since()

    def sample(self) -> StatusSample:
        now_ns, clock_ns = self._clock.wall_ns(), self._clock.now_ns()
        offset_ns = now_ns - clock_ns
        decision = self._controller.decision
        since_ns = decision.since_ns
        state, reasons = self._controller.state(senders(self._bus.neighbours))
        wheels = self._controller.wheels
        return StatusSample(
            stamp_ns=now_ns,
            state=state,
            driver=decision.driver,
            driver_since_ns=(
                None if since_ns is None else self._driver_since.of(since_ns, since_ns, offset_ns)
            ),
            since_ns=self._state_since.of(state, clock_ns, offset_ns),
            why=standing.why(reasons),
            reasons=reasons,
            wheels=wheels,
            wheels_since_ns=self._wheels_since.of(wheels, clock_ns, offset_ns) if wheels else None,
            board=self.board(),
            link={**ZEROS["link"], **self._counted("link", self._supervisor.status_values)},
            command={
                **ZEROS["command"],
                **self._counted("commands", self._intake.status_values),
                **self._counted("control path", self._controller.status_values),
                **self._counted("black box", self._box.status_values),
                **self._recorders.status_values(),
                **logs.status_values(),
            },
            bus=self._counted("bus", self.bus),
        )

    def _counted(self, what: str, values: Callable[[], Mapping[str, Any]]) -> Mapping[str, Any]:
        found: Mapping[str, Any] = self._recorders.call(
            f"The status of the {what}", values, default={}
        )
        return found

    def board(self) -> dict[str, Any]:
        """The board's answers about itself; empty without a board."""
        session = self._supervisor.session
        board = None if session is None else session.board
        if board is None:
            return {}
        identity = board.identity
        facts: dict[str, Any] = {"port": board.port_name, "dialect": identity.dialect.name}
        settings = identity.settings
        if settings is not None:
            facts[VERSION] = settings.get(VERSION)
            for row in identity.dialect.settings:
                facts.update(row.named(settings.get(row.field)))
        if self._controller.volts is not None:
            facts["volts"] = self._controller.volts
        battery = self._controller.battery_watch
        if battery.level and battery.median_v is not None:
            facts |= {"battery": battery.level, "volts_at_rest": round(battery.median_v, 2)}
        if self._controller.imu_sensor is not None:
            facts["imu"] = self._controller.imu_sensor
        return facts

    def bus(self) -> dict[str, Any]:
        routers = [
            each.address or each.zid for each in self._bus.neighbours if each.kind == "router"
        ]
        return {
            **ZEROS["bus"],
            "zid": self._bus.zid,
            "routers": ", ".join(routers),
            "neighbours": len(self._bus.neighbours),
            **self._bus.status_values(),
            **self._more_bus_facts(),
        }
