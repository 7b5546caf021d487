"""The daemon as a whole: it runs until a signal, and ends with the wheels at rest."""

from __future__ import annotations

import asyncio
import gc
import logging
import signal
from collections.abc import Mapping
from typing import Any

import msgspec

from yahboomd.bus import keys
from yahboomd.bus.presence import NeighbourChange, TokenChange
from yahboomd.bus.publishers import BusPublisher
from yahboomd.bus.session import Bus
from yahboomd.clock import Clock, Schedule, SystemClock, nanoseconds
from yahboomd.config import Config
from yahboomd.daemon import assembly, ros2
from yahboomd.daemon.clocks import ClockWatch
from yahboomd.daemon.commands import CommandIntake
from yahboomd.daemon.control import Controller
from yahboomd.daemon.notify import Notifier
from yahboomd.daemon.opening import open_bus
from yahboomd.daemon.operator import Operator
from yahboomd.daemon.publisher import Publisher
from yahboomd.daemon.services import Services
from yahboomd.daemon.stamps import WallStamps
from yahboomd.daemon.status import Status
from yahboomd.daemon.supervisor import Supervisor
from yahboomd.link.session import Opener
from yahboomd.messages.codecs import encoding_name
from yahboomd.model import Event, OdometryEstimate

log = logging.getLogger(__name__)

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)

STATUS_EVERY_S = 0.5


class Daemon:
    """One robot's daemon. ``run`` is called once.

    Args:
        config: What a person decided.
        environ: The process's environment.
        clock: What tells the time.
        opener: Opens the port; made from the configuration unless given.
    """

    def __init__(
        self,
        config: Config,
        *,
        environ: Mapping[str, str],
        clock: Clock | None = None,
        opener: Opener | None = None,
    ) -> None:
        self._config = config
        self._environ = environ
        self._clock = clock or SystemClock()
        self._opener = opener or assembly.opener(config, self._clock, environ)
        self._stop = asyncio.Event()
        self._status_due = asyncio.Event()
        self._others: set[str] = set()
        self._callback_failed = asyncio.Event()
        self.left_clean = True
        """Whether the bus could be closed; where not, only ``os._exit`` ends the process."""

    def stop(self, why: str) -> None:
        """Ask the daemon to end; the wheels are stopped first."""
        log.info("%s: stopping the wheels, then ending.", why)
        self._stop.set()

    async def run(self) -> None:
        """Serve until a signal or :meth:`stop`.

        Raises:
            BusError: The Zenoh session cannot be opened as configured; as a service, not within
                a minute.
        """
        loop = asyncio.get_running_loop()
        for number in SIGNALS:
            loop.add_signal_handler(number, self.stop, number.name)
        loop.set_exception_handler(self._uncaught)
        notifier = Notifier(self._environ)
        bus = Bus(assembly.bus_options(self._config), clock=self._clock)
        try:
            if await open_bus(bus.open, notifier=notifier, clock=self._clock, stop=self._stop):
                await self._serve(bus, notifier)
        finally:
            notifier.stopping()
            self.left_clean = await bus.close()
            notifier.close()
            for number in SIGNALS:
                loop.remove_signal_handler(number)

    def _uncaught(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """An error in a callback, which has no task to fail: the daemon ends as if it had one."""
        loop.default_exception_handler(context)
        # What a transport reports its owner hears, too; a result that nobody wants moves nothing.
        if not context.keys() & {"transport", "future", "task"}:
            self._callback_failed.set()

    async def _serve(self, bus: Bus, notifier: Notifier) -> None:
        config, clock = self._config, self._clock
        arbiter = assembly.arbiter(config)
        self._publisher = Publisher(
            lambda key, message: self._open_outlet(bus, key, message),
            encoding=config.zenoh.encoding,
            stamps=WallStamps(clock),
            period_ns=nanoseconds(1.0 / config.odometry.publish_rate_hz),
            frame_id=config.odometry.frame_id,
            child_frame_id=config.odometry.child_frame_id,
            motor_names=tuple(motor.name for motor in config.motors()),
        )
        latch = assembly.latch(config, clock, self._environ)
        controller = assembly.controller(config, clock, arbiter=arbiter, latch=latch, outputs=self)
        self._controller = controller
        self._clocks = ClockWatch(arbiter.clock_warnings, controller.event)
        intake = CommandIntake(
            arbiter,
            clock,
            holonomic=config.kinematics().holonomic,
            step=controller.step_soon,
        )
        supervisor = Supervisor(
            lambda: assembly.session(config, clock, controller, self._opener), clock, controller
        )
        status = Status(
            clock,
            controller=controller,
            intake=intake,
            supervisor=supervisor,
            bus=bus,
            more_bus_facts=self._publisher.facts,
        )
        services = Services(
            Operator(clock, controller=controller, arbiter=arbiter, latch=latch),
            encoding=config.zenoh.encoding,
            config=lambda: config.model_dump(mode="json", exclude_none=True),
            board=status.board,
        )
        # The e-stop is there before anything can be commanded.
        services.serve(bus)
        for source in config.command.sources:
            bus.subscribe(source, intake.handler(source), keep_oversize=True)
        self._ros2 = ros2.start(
            bus,
            config,
            clock,
            services=services,
            commands=lambda source: intake.handler(source, attached=True),
        )
        self._announce(bus)
        notifier.ready()
        gc.freeze()
        try:
            await self._run_tasks(controller, supervisor, status, notifier)
        finally:
            controller.close()

    async def _run_tasks(
        self, controller: Controller, supervisor: Supervisor, status: Status, notifier: Notifier
    ) -> None:
        async with asyncio.TaskGroup() as tasks:
            board = tasks.create_task(supervisor.run(), name="supervisor")
            others: list[asyncio.Task[Any]] = [
                tasks.create_task(self._control(controller, notifier), name="control"),
                tasks.create_task(self._tell_status(status, notifier), name="status"),
                tasks.create_task(self._callback_failed.wait(), name="callback"),
            ]
            asked = tasks.create_task(self._stop.wait(), name="stop")
            done, _ = await asyncio.wait(
                [asked, board, *others], return_when=asyncio.FIRST_COMPLETED
            )
            if asked not in done:
                # A task group goes on without a task that was cancelled alone. Not this one.
                raise RuntimeError(f"the task {done.pop().get_name()} ended by itself")
            # The session's end stops the wheels and looks whether they stand; meanwhile counts
            # still become poses, and the watchdog is fed.
            board.cancel()
            await asyncio.wait([board])
            for task in others:
                task.cancel()

    async def _control(self, controller: Controller, notifier: Notifier) -> None:
        schedule = Schedule(self._clock, assembly.command_period_ns(self._config))
        feed_ns = None if notifier.watchdog_ns is None else notifier.watchdog_ns // 3
        fed_ns = 0
        try:
            while True:
                beat_ns = await schedule.beat()
                controller.step()
                controller.counters["beats_missed"] = schedule.missed
                if feed_ns is not None and beat_ns - fed_ns >= feed_ns:
                    fed_ns = beat_ns
                    notifier.alive()
        finally:
            schedule.close()

    async def _tell_status(self, status: Status, notifier: Notifier) -> None:
        alarm = self._clock.alarm(self._status_due.set)
        try:
            while True:
                sample = status.sample()
                self._publisher.status(sample)
                self._ros2.status(sample)
                self._clocks.look(self._clock.now_ns())
                notifier.status(f"{sample.state}: {sample.why}")
                alarm.set(self._clock.now_ns() + nanoseconds(STATUS_EVERY_S))
                self._status_due.clear()
                await self._status_due.wait()
        finally:
            alarm.close()

    # What the control path tells (control.Outputs).

    def estimate(self, estimate: OdometryEstimate, command_m_s: tuple[float, ...]) -> None:
        """A new reading."""
        stamp_ns = self._publisher.estimate(estimate, command_m_s)
        if stamp_ns is not None:
            self._ros2.estimate(estimate, stamp_ns)

    def battery(self, volts: float) -> None:
        """The voltage."""
        self._ros2.battery(volts, self._publisher.battery(volts))

    def event(self, event: Event) -> None:
        """Something happened."""
        self._publisher.event(event)

    def changed(self) -> None:
        """Tell the status now rather than at its next turn."""
        self._status_due.set()

    # The bus.

    def _open_outlet(self, bus: Bus, key: str, message: type[msgspec.Struct]) -> BusPublisher:
        # Telemetry never waits for a subscriber: the wheels hang on the same thread.
        return bus.publisher(key, encoding=encoding_name(message, self._config.zenoh.encoding))

    def _announce(self, bus: Bus) -> None:
        own = keys.holder_key(keys.ALIVE, bus.zid)
        bus.token(keys.ALIVE)
        bus.token(own)
        bus.watch_tokens(f"{keys.ALIVE}/*", lambda changes: self._holders(bus, changes))
        bus.watch_neighbours(lambda changes: self._neighbours(bus, changes))
        for endpoint in bus.options.listening:
            if endpoint in bus.options.exposed:
                log.warning("Listening on %s: whoever reaches it can drive this robot.", endpoint)
            else:
                log.info("Listening on %s, for this machine alone.", endpoint)

    def _holders(self, bus: Bus, changes: list[TokenChange]) -> None:
        for change in changes:
            zid = keys.holder_of(bus.key(keys.ALIVE), change.key)
            if zid is None or zid == bus.zid:
                continue
            if not change.present:
                self._others.discard(zid)
            elif zid not in self._others:
                self._others.add(zid)
                words = (
                    f"Another yahboomd ({zid}) uses the same namespace: both obey the same "
                    "commands. Give each robot its own zenoh.namespace."
                )
                self._controller.event(
                    Event(kind="second_daemon", severity="warning", message=words)
                )

    def _neighbours(self, bus: Bus, changes: list[NeighbourChange]) -> None:
        for change in changes:
            neighbour = change.neighbour
            if neighbour.kind != "router":
                continue
            where = neighbour.address or neighbour.zid
            if change.present:
                words = f"Joined the router at {where}: whoever reaches it can drive this robot."
                event = Event(kind="router_joined", severity="warning", message=words)
            else:
                words = f"The router at {where} is gone; it is joined again when it comes back."
                event = Event(kind="router_lost", severity="info", message=words)
            self._controller.event(event)
        if not bus.neighbours:
            # Nobody is left who could command, or take a command back.
            self._controller.bus_lost()
        self.changed()
