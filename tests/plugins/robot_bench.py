"""Control path, link and simulated robot together, on virtual time, without a bus."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self

import msgspec
from board_bench import BoardPort
from event_check import assert_registered

from yahboomd.blackbox.kept_pose import PoseFile
from yahboomd.blackbox.recorded_odometer import odometer
from yahboomd.blackbox.recorder import Recorder
from yahboomd.blackbox.ring import Ring
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.config import Config, read
from yahboomd.core.daemon import assembly
from yahboomd.core.daemon.commands import CommandIntake
from yahboomd.core.daemon.control import Controller
from yahboomd.core.daemon.requests import Operator
from yahboomd.core.daemon.supervisor import Supervisor
from yahboomd.core.drive.standing import why
from yahboomd.core.errors import PortMissing
from yahboomd.core.link.port_guard import PortGuard
from yahboomd.core.link.tap import NO_TAP
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import VelocityCommand
from yahboomd.core.model import Event, ImuEstimate, OdometryEstimate
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.virtual_time import LoopClock


def state_and_why(controller: Controller) -> tuple[str, str]:
    """The state in the status, and the reasons as one text."""
    state, reasons = controller.state()
    return state, why(reasons)


def steps_of(controller: Controller) -> list[int]:
    """The moments of its steps from now on, filled as it steps."""
    steps: list[int] = []
    step = controller._step

    def noting() -> None:
        steps.append(controller._clock.now_ns())
        step()

    controller._step = noting  # type: ignore[method-assign]
    return steps


class Heard:
    """The events of the control path."""

    def __init__(self) -> None:
        self.estimates: list[OdometryEstimate] = []
        self.commands: list[tuple[float, ...]] = []
        self.imu_estimates: list[ImuEstimate] = []
        self.volts: list[float] = []
        self.events: list[Event] = []
        self.changes = 0

    def estimate(self, estimate: OdometryEstimate, command_m_s: tuple[float, ...]) -> None:
        self.estimates.append(estimate)
        self.commands.append(command_m_s)

    def imu(self, estimate: ImuEstimate) -> None:
        self.imu_estimates.append(estimate)

    def battery(self, volts: float) -> None:
        self.volts.append(volts)

    def event(self, event: Event) -> None:
        assert_registered(msgspec.structs.asdict(event) | {"stamp_ns": 0})
        self.events.append(event)

    def changed(self) -> None:
        self.changes += 1

    @property
    def kinds(self) -> list[str]:
        return [event.kind for event in self.events]


class RobotBench:
    """A daemon without its bus, driving a simulated robot.

    Args:
        folder: For the e-stop's file.
        overrides: As for ``--set``.
        simulation: The robot.
        file: The configuration.
        ring: Records a black box.
        poses: Keeps the pose for the next bench.
        robot: That of an earlier bench.
    """

    def __init__(
        self,
        folder: Path,
        overrides: Sequence[str] = (),
        simulation: SimulationOptions | None = None,
        file: Path | None = None,
        ring: Ring | None = None,
        poses: PoseFile | None = None,
        robot: SimulatedRobot | None = None,
    ) -> None:
        latch = f"estop.latch_file={folder / 'estop'}"
        self.config: Config = read(file, environ={}, overrides=[latch, *overrides]).config
        self.clock = LoopClock()
        self.robot = robot or SimulatedRobot(simulation or SimulationOptions())
        self.port: BoardPort | None = None
        self.heard = Heard()
        self.recorder = ring and Recorder(ring, self.clock.now_ns, self.clock.wall_ns)
        tap = self.recorder or NO_TAP
        self.arbiter = assembly.arbiter(self.config)
        self.latch = assembly.latch(self.config, self.clock, {})
        self.guard = PortGuard()
        self.controller = Controller(
            self.clock,
            assembly.control_options(self.config),
            arbiter=self.arbiter,
            latch=self.latch,
            outputs=self.heard,
            odometer=odometer(assembly.odometer_settings(self.config), self.recorder, poses),
            guard=self.guard,
        )
        self.operator = Operator(
            self.clock, controller=self.controller, arbiter=self.arbiter, latch=self.latch
        )
        self.intake = CommandIntake(
            self.arbiter,
            self.clock,
            holonomic=self.config.kinematics().holonomic,
            notice_pause=self.controller.notice_pause,
            step=self.controller.step_soon,
            refusal=self.controller.motion_refusal,
            recorder=self.recorder,
        )
        self.supervisor = Supervisor(
            lambda: assembly.session(
                self.config, self.clock, self.controller, self._open, tap, guard=self.guard
            ),
            self.clock,
            self.controller.unavailable,
        )
        self.tasks: list[asyncio.Task[None]] = []
        self.beats: list[int] = []

    async def _open(self) -> BoardPort:
        if self.robot.started:
            self.robot.advance(self.clock.now_ns())
        if not self.robot.plugged:
            raise PortMissing("/dev/simulated: there is no such port.")
        self.port = BoardPort(self.robot)
        return self.port

    async def __aenter__(self) -> Self:
        self.tasks = [
            asyncio.create_task(self.supervisor.run()),
            asyncio.create_task(self.controller.run(self._beat)),
        ]
        return self

    def _beat(self, due_ns: int) -> None:
        self.guard.promise(self.controller.promised_ns())
        self.beats.append(due_ns)

    async def __aexit__(self, *_: object) -> None:
        for task in self.tasks:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        self.controller.close()
        self.latch.settle()

    # Actions of a test.

    async def ready(self) -> None:
        """Until the wheels may turn."""
        await self.until(lambda: self.controller.state()[0] != "waiting")

    async def until(self, condition: Callable[[], object], within_s: float = 20.0) -> None:
        """Wait, in virtual time, until a condition holds; a task that fails is the test's end."""
        async with asyncio.timeout(within_s):
            while not condition():
                for task in self.tasks:
                    if task.done():
                        task.result()
                await asyncio.sleep(0.001)

    def command(self, vx: float = 0.0, wz: float = 0.0, *, source: str = "cmd_vel") -> None:
        """One command, now."""
        self.payload(encode(VelocityCommand(vx=vx, wz=wz), "json"), source=source)

    def payload(self, payload: bytes, *, source: str = "cmd_vel", dropped: int = 0) -> None:
        """Any bytes on a command key, now."""
        arrival = Arrival(
            key=source,
            payload=payload,
            stamp_ns=None,
            arrived_ns=self.clock.now_ns(),
            dropped=dropped,
        )
        self.intake.handler(source)([arrival])

    async def drive(
        self, for_s: float, vx: float = 0.0, wz: float = 0.0, *, source: str = "cmd_vel"
    ) -> None:
        """Command a velocity at 20 Hz for a while."""
        for _ in range(round(for_s / 0.05)):
            self.command(vx, wz, source=source)
            await asyncio.sleep(0.05)

    @property
    def rim_speeds(self) -> list[float]:
        """The true speeds of the wheels, now."""
        self.robot.advance(self.clock.now_ns())
        return [motor.speed_m_s for motor in self.robot.plant.motors]

    @property
    def standing(self) -> bool:
        return max(map(abs, self.rim_speeds)) < 0.03

    @property
    def frames(self) -> list[bytes]:
        """The bytes that were written to the port, in order."""
        assert self.port is not None
        return self.port.frames
