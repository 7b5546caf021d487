"""A daemon in the test's own process, so that a test can break what runs inside it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import nullcontext
from pathlib import Path

import pytest
import zenoh
from binary_dialect import registered
from board_bench import BoardPort
from fault_bench import is_stop, orders_of
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.blackbox.box_keeper import BoxKeeper
from yahboomd.core.clock import SystemClock
from yahboomd.core.config import read
from yahboomd.core.daemon.service import Daemon
from yahboomd.ros2.ros2_plane import Ros2Plane
from yahboomd.simulation.robot import SimulatedRobot


@pytest.fixture(autouse=True)
def third_board(request: pytest.FixtureRequest) -> Iterator[None]:
    """The board of the tests is known while a test asks for it."""
    asked = getattr(request.node, "callspec", None)
    with registered() if asked and "binary" in asked.params.values() else nullcontext():
        yield


class InnerDaemon:
    """The daemon with a simulated robot in memory, a real bus, and a client that drives."""

    def __init__(self, folder: Path, environ: dict[str, str]) -> None:
        self.endpoint = free_endpoint()
        self.robot = SimulatedRobot()
        self.ports: list[BoardPort] = []
        overrides = [
            f'zenoh.listen=["{self.endpoint}"]',
            "zenoh.connect=[]",
            f"estop.latch_file={folder / 'estop'}",
        ]
        config = read(None, environ={}, overrides=overrides).config
        environ = {
            "RUNTIME_DIRECTORY": str(folder / "run"),
            "STATE_DIRECTORY": str(folder / "state"),
            **environ,
        }
        self.daemon = Daemon(
            config,
            environ=environ,
            black_box=BoxKeeper,
            planes=(Ros2Plane(),),
            clock=SystemClock(),
            opener=self._open,
        )
        self.task = asyncio.create_task(self.daemon.run())
        self.session: zenoh.Session

    async def _open(self) -> BoardPort:
        self.ports.append(BoardPort(self.robot))
        return self.ports[-1]

    async def driven(self) -> None:
        """Connect, and drive until the wheels turn."""
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{self.endpoint}"]')

        def opened() -> zenoh.Session | None:
            try:
                return zenoh.open(config)
            except zenoh.ZError:
                return None

        self.session = await eventually(opened)

        def turning() -> bool:
            self.session.put("cmd_vel", b'{"vx": 0.3}')
            return min(motor.speed_m_s for motor in self.robot.plant.motors) > 0.2

        await eventually(turning)

    @property
    def standing(self) -> bool:
        return max(abs(motor.speed_m_s) for motor in self.robot.plant.motors) < 0.03

    @property
    def ends_with_a_stop(self) -> bool:
        """Whether the last words on the wire moved nothing."""
        return is_stop(orders_of(self.ports[-1])[-1][1])

    async def ends_by_itself_at_rest(self) -> None:
        """Wait for an unrequested end; the wheels stand, and the last frame was a stop."""
        with pytest.raises(BaseExceptionGroup):
            await self.task
        assert self.standing
        assert self.ends_with_a_stop

    async def close(self) -> None:
        if not self.task.done():
            self.daemon.stop("the test's end")
        await asyncio.gather(self.task, return_exceptions=True)
        if hasattr(self, "session"):
            await asyncio.to_thread(self.session.close)


@pytest.fixture
async def inner_with(
    tmp_path: Path,
) -> AsyncIterator[Callable[[dict[str, str]], InnerDaemon]]:
    """Makes daemons: ``inner_with(environ)``."""
    made: list[InnerDaemon] = []

    def make(environ: dict[str, str]) -> InnerDaemon:
        made.append(InnerDaemon(tmp_path, environ))
        return made[-1]

    yield make
    for each in made:
        await each.close()


@pytest.fixture
async def inner(inner_with: Callable[[dict[str, str]], InnerDaemon]) -> InnerDaemon:
    """One daemon."""
    return inner_with({})
