"""The daemon as a whole: it runs until a signal, and ends with the wheels at rest."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NoReturn

import msgspec

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.publishers import BusPublisher
from yahboomd.core.clock import Clock, SystemClock, nanoseconds
from yahboomd.core.config import Config, runtime_folder
from yahboomd.core.daemon import assembly
from yahboomd.core.daemon.black_box import NAME, KeptBox, MakesBlackBox, NoBlackBox
from yahboomd.core.daemon.bus_presence import BusPresence
from yahboomd.core.daemon.commands import ClockWatch, CommandIntake, PoseIntake
from yahboomd.core.daemon.control import Controller
from yahboomd.core.daemon.local_requests import LocalRequests
from yahboomd.core.daemon.planes import Plane, PlaneRequests, Planes
from yahboomd.core.daemon.process import Notifier, Signals, open_bus
from yahboomd.core.daemon.publisher import PUBLISHED, Publisher
from yahboomd.core.daemon.recorders import Recorders
from yahboomd.core.daemon.requests import Operator, Services
from yahboomd.core.daemon.stamps import WallStamps
from yahboomd.core.daemon.status_sample import Status
from yahboomd.core.daemon.supervisor import Supervisor
from yahboomd.core.drive import standing
from yahboomd.core.errors import BusError, YahboomdError
from yahboomd.core.link import port_note
from yahboomd.core.link.guard_words import STOP_SOCKET, Listening
from yahboomd.core.link.port import Opener
from yahboomd.core.link.port_guard import NO_SOCKET, PortGuard
from yahboomd.core.link.takeover import take_over
from yahboomd.core.messages.codecs import encoding_name
from yahboomd.core.model import NS_PER_S, Event, ImuEstimate, OdometryEstimate

log = logging.getLogger(__name__)

STATUS_EVERY_S = 0.5

STARTS_NS = 20 * NS_PER_S
"""The guard stops wheels that a crash left turning if the start hangs for longer. One attempt to
open the bus, and the wait after it, take less."""

LOCAL_FACTS = "The status at the local socket"


class Daemon:
    """One robot's daemon. ``run`` is called once.

    Args:
        black_box: Makes the black box.
        planes: Publish beside the native plane; the daemon drives without them.
        opener: Opens the port; made from the configuration unless given.
        guard: Stops the wheels if this process cannot; None without it.
    """

    def __init__(
        self,
        config: Config,
        *,
        environ: Mapping[str, str],
        black_box: MakesBlackBox,
        planes: Sequence[Plane] = (),
        clock: Clock | None = None,
        opener: Opener | None = None,
        guard: PortGuard | None = None,
    ) -> None:
        self._config = config
        self._environ = environ
        self._make_box = black_box
        self._clock = clock or SystemClock()
        self._guard = guard or PortGuard()
        self._notifier = Notifier(environ)
        self._opener = opener or assembly.opener(config, self._clock, environ, self._guard)
        self._stop = asyncio.Event()
        self._signals = Signals(self.stop)
        self._status_due = asyncio.Event()
        self._recorders = Recorders()
        self._planes = Planes(planes, self._recorders)
        self._callback_failed = asyncio.Event()
        self._took_over = False
        self.left_clean = True
        """Whether the bus could be closed; if not, only ``os._exit`` ends the process."""
        self.left_standing = True
        """Whether the wheels were seen to stand in the end, as far as this daemon moved them."""

    def stop(self, why: str) -> None:
        """Ask the daemon to end; the wheels are stopped first. Further calls change nothing."""
        if not self._stop.is_set():
            log.info("%s: stopping the wheels, then ending.", why)
            self._stop.set()

    @property
    def fatal_signal(self) -> int | None:
        """The signal that ended it, if that asks for more than an orderly end."""
        return self._signals.fatal

    async def run(self) -> None:
        """Serve until a signal or :meth:`stop`.

        Raises:
            BusError: The Zenoh session cannot be opened as configured; as a service, not within
                a minute.
        """
        loop = asyncio.get_running_loop()
        self._signals.install()
        loop.set_exception_handler(self._uncaught)
        notifier = self._notifier
        bus = Bus(assembly.bus_options(self._config), clock=self._clock, aside=True)
        try:
            opening = partial(self._open_bus, bus)
            if await open_bus(opening, notifier=notifier, clock=self._clock, stop=self._stop):
                await self._serve(bus, notifier)
        finally:
            notifier.stopping()
            # Wheels that were not seen to stand are the guard's from now on.
            self._guard.end()
            self.left_clean = await bus.close()
            notifier.close()
            self._signals.remove()

    async def _open_bus(self, bus: Bus) -> None:
        try:
            await bus.open()
        except BusError:
            if not self._took_over:
                self._took_over = await self._take_over()
            self._guard.renew(self._clock.now_ns() + STARTS_NS)
            raise

    async def _take_over(self) -> bool:
        """Stop wheels that an earlier daemon left turning: sessions begin once the bus is open.

        Returns:
            Whether a stop was sent: a port that is not there yet is tried again.
        """
        try:
            port = await self._opener()
            self._guard.renew(self._clock.now_ns() + STARTS_NS)
            report = await take_over(port, self._clock)
        except YahboomdError as error:
            log.debug("The wheels cannot be stopped before the bus is open: %s", error)
            return False
        if report.stood:
            self._end_note()
        else:
            log.warning(
                "%s: a stop was sent, and the wheels were not seen to stand. Look at them.",
                report.port,
            )
        return True

    def _uncaught(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """End the daemon after an error in a callback, which has no task to fail."""
        loop.default_exception_handler(context)
        # A transport's error also reaches its owner; an unread exception moves no wheel.
        if not context.keys() & {"transport", "future", "task"}:
            self._callback_failed.set()

    async def _serve(self, bus: Bus, notifier: Notifier) -> None:
        config, clock = self._config, self._clock
        recorders = self._recorders
        arbiter = assembly.arbiter(config)
        latch = self._latch = assembly.latch(config, clock, self._environ)
        made = recorders.call(NAME, self._make_box, config, clock, self._environ, recorders)
        box: KeptBox = made or NoBlackBox()
        self._box = box
        controller = Controller(
            clock,
            assembly.control_options(config),
            arbiter=arbiter,
            odometer=box.odometer(assembly.odometer_settings(config)),
            latch=latch,
            outputs=self,
            guard=self._guard,
        )
        self._controller = controller
        self._stamps = WallStamps(clock, controller.event)
        self._publisher = Publisher(
            lambda key: self._open_outlet(bus, key),
            encoding=config.zenoh.encoding,
            stamps=self._stamps,
            period_ns=nanoseconds(1.0 / config.odometry.publish_rate_hz),
            frame_id=config.odometry.frame_id,
            child_frame_id=config.odometry.child_frame_id,
            imu_frame_id=config.imu.frame_id,
            motor_names=tuple(motor.name for motor in config.motors()),
        )
        self._clocks = ClockWatch(arbiter.clock_warnings, controller.event)
        intake = CommandIntake(
            arbiter,
            clock,
            holonomic=config.kinematics().holonomic,
            notice_pause=controller.notice_pause,
            step=controller.step_soon,
            refusal=controller.motion_refusal,
            recorder=box.recorder,
        )
        supervisor = Supervisor(
            lambda: assembly.session(
                config, clock, controller, self._opener, box.tap, guard=self._guard
            ),
            clock,
            controller.unavailable,
        )
        operator = Operator(clock, controller=controller, arbiter=arbiter, latch=latch)
        local = LocalRequests(self._guard, clock, operator=operator, controller=controller)
        status = Status(
            clock,
            controller=controller,
            intake=intake,
            supervisor=supervisor,
            bus=bus,
            box=box,
            recorders=recorders,
            more_bus_facts=lambda: {**self._publisher.status_values(), **local.status_values()},
        )
        services = Services(
            operator,
            encoding=config.zenoh.encoding,
            config=config.as_data,
            board=status.board,
            newest=self._publisher.newest,
            save_box=box.save_now,
        )
        # The e-stop is there before anything can be commanded.
        latch_path = config.latch_path(self._environ, user_id=os.getuid())
        folder = runtime_folder(self._environ, user_id=os.getuid())
        listening = Listening(str(folder), STOP_SOCKET, str(latch_path.absolute()))
        recorders.call(LOCAL_FACTS, self._show_facts, supervisor)
        if not await self._guard.listen(listening, local.engage, clock):
            log.info("No local socket: %s", NO_SOCKET)
        services.serve(bus, config.estop.groups)
        for source in config.command.sources:
            bus.subscribe(source, intake.handler(source), keep_oversize=True)
        poses = PoseIntake(operator, config.ros2.frame_prefix + config.odometry.frame_id)
        bus.subscribe(keys.ODOMETRY_SET_POSE, poses.accept)
        requests = PlaneRequests(services, intake.handler, poses.accept, controller.event)
        self._planes.start(bus, config, clock, requests)
        BusPresence(
            bus, report=controller.event, bus_lost=controller.bus_lost, changed=self.changed
        ).announce()
        notifier.ready()
        gc.freeze()
        fault: BaseException | None = None
        try:
            await self._run_tasks(controller, supervisor, status, notifier)
        except BaseExceptionGroup as group:
            fault = group
            raise
        finally:
            self._leave_wheels(supervisor.left_standing)
            # Even if it was switched off: a ring left on disk looks like a killed daemon's.
            recorders.call("The end of the black box", box.close, fault)
            local.close()
            controller.close()
            latch.settle()
            if self.left_standing:
                self._end_note()

    def _leave_wheels(self, standing: bool) -> None:
        """End the guard, which first sees to wheels that were not seen to stand."""
        self.left_standing = standing
        if standing:
            self._guard.standing()
        self._guard.end()

    def _end_note(self) -> None:
        self._guard.standing()
        port_note.end(str(runtime_folder(self._environ, user_id=os.getuid())), os.getpid())

    async def _run_tasks(
        self, controller: Controller, supervisor: Supervisor, status: Status, notifier: Notifier
    ) -> None:
        async with asyncio.TaskGroup() as tasks:
            board = tasks.create_task(supervisor.run(), name="supervisor")
            others: list[asyncio.Task[Any]] = [
                tasks.create_task(self._control(controller, notifier), name="control"),
                tasks.create_task(self._report_status(status, supervisor, notifier), name="status"),
                tasks.create_task(self._callback_failed.wait(), name="callback"),
            ]
            asked = tasks.create_task(self._stop.wait(), name="stop")
            self._signals.at_once = False
            while True:
                suspend = tasks.create_task(self._signals.suspend.wait(), name="suspend")
                done, _ = await asyncio.wait(
                    [asked, suspend, board, *others], return_when=asyncio.FIRST_COMPLETED
                )
                if not done <= {asked, suspend}:
                    # A task group continues if one task alone is cancelled. This one must not.
                    raise RuntimeError(f"the task {done.pop().get_name()} ended by itself")
                # The session's end stops the wheels and checks that they stand; meanwhile counts
                # still become poses, and the watchdog is fed.
                board.cancel()
                await asyncio.wait([board])
                if self._stop.is_set():
                    break
                self._suspend(supervisor)
                board = tasks.create_task(supervisor.run(), name="supervisor")
            for task in (suspend, *others):
                task.cancel()

    def _suspend(self, supervisor: Supervisor) -> None:
        """Suspend the process, now that the wheels stand; the board is connected again after it."""
        if not self._signals.suspend.is_set():
            log.info("Continued before it was suspended.")
        elif supervisor.left_standing:
            self._guard.standing()
            self._signals.freeze()
            self._notifier.alive()
        else:
            self._signals.resume()
            log.error(
                "Not suspended: the wheels were not seen to stand, and nothing could stop them. "
                "Look at them; end yahboomd, or suspend it again once the board is back."
            )

    async def _control(self, controller: Controller, notifier: Notifier) -> NoReturn:
        feed_ns = None if notifier.watchdog_ns is None else notifier.watchdog_ns // 3
        fed_ns = 0

        def feed(beat_ns: int) -> None:
            nonlocal fed_ns
            self._guard.promise(controller.promised_ns())
            if feed_ns is not None and beat_ns - fed_ns >= feed_ns:
                fed_ns = beat_ns
                notifier.alive()

        await controller.run(feed)

    async def _report_status(
        self, status: Status, supervisor: Supervisor, notifier: Notifier
    ) -> None:
        alarm = self._clock.alarm(self._status_due.set)
        try:
            while True:
                call = self._recorders.call
                call("The watch on the wall clock", self._stamps.follow)
                if (sample := call("The status", status.sample)) is not None:
                    call(NAME, self._box.status, sample)
                    call("The status on the bus", self._publisher.status, sample)
                    self._planes.status(sample)
                    words = f"{sample.state}: {sample.why}"
                    call("The status for the service manager", notifier.status, words)
                call("The watch on senders' clocks", self._clocks.report, self._clock.now_ns())
                call(LOCAL_FACTS, self._show_facts, supervisor)
                if self._latch.restore_file(self._clock.now_ns()):
                    self._guard.look_after_socket()
                alarm.set(self._clock.now_ns() + nanoseconds(STATUS_EVERY_S))
                self._status_due.clear()
                await self._status_due.wait()
        finally:
            alarm.close()

    def _show_facts(self, supervisor: Supervisor) -> None:
        """Tell programs of this machine which robot this is."""
        session, configured = supervisor.session, self._config.serial.port
        ports = (configured, "" if session is None else session.port_name)
        state, reasons = self._controller.state()
        facts = {
            "daemon": "yahboomd",
            "pid": os.getpid(),
            "namespace": self._config.zenoh.namespace,
            "ports": [port for port in dict.fromkeys(ports) if port],
            "listen": list(self._config.zenoh.listen),
            "connected": session is not None and session.board is not None,
            "state": state,
            "why": standing.why(reasons),
        }
        self._guard.show(msgspec.json.encode(facts))

    # Callbacks of the control path (`publisher.Outputs`).

    def estimate(self, estimate: OdometryEstimate, command_m_s: tuple[float, ...]) -> None:
        publish, call = self._publisher, self._recorders.call
        stamp_ns = call("The pose on the bus", publish.estimate, estimate, command_m_s)
        if stamp_ns is not None:
            self._planes.estimate(estimate, stamp_ns)

    def imu(self, estimate: ImuEstimate) -> None:
        name, publish = "The inertial sensor on the bus", self._publisher.imu
        stamp_ns = self._recorders.call(name, publish, estimate)
        if stamp_ns is not None:
            self._planes.imu(estimate, stamp_ns)

    def battery(self, volts: float) -> None:
        publish = self._publisher.battery
        stamp_ns = self._recorders.call("The voltage on the bus", publish, volts)
        if stamp_ns is not None:
            self._planes.battery(volts, stamp_ns)

    def event(self, event: Event) -> None:
        call = self._recorders.call
        call(NAME, self._box.event, event)
        stamp_ns = call("The events on the bus", self._publisher.event, event)
        # An emergency stop over the local socket may come before any plane is started.
        if stamp_ns is not None:
            self._planes.event(event, stamp_ns)

    def changed(self) -> None:
        """Publish the status now rather than at its next time."""
        self._status_due.set()

    # The bus.

    def _open_outlet(self, bus: Bus, key: str) -> BusPublisher:
        encoding = encoding_name(PUBLISHED[key], self._config.zenoh.encoding)
        return bus.publisher(key, encoding=encoding)
