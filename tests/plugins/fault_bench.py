"""The bench for tests of faults: it keeps the truth, and reads frames off a wire."""

from __future__ import annotations

import itertools
import math
import os
import re
from collections.abc import Sequence
from pathlib import Path

import msgspec
from binary_dialect import BINARY
from board_bench import BoardPort
from robot_bench import RobotBench

from yahboomd.core.model import OdometryEstimate
from yahboomd.core.protocol.rosmaster.rosmaster import Rosmaster
from yahboomd.simulation.boards import BOARDS
from yahboomd.simulation.console import execute
from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.options import PLAIN_GAIN, QUICK_GAIN, SimulationOptions
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.truth import TruthSample

MS = 1_000_000
ROSMASTER = Rosmaster()
EVERY_DIALECT = ["streamed", "polled", "rosmaster", "binary"]
OURS_ALONE = ["binary"] if os.environ.get("YAHBOOMD_EVERY_BOARD") else []
"""No robot has this board, so `make every-board` alone runs all faults on it."""

DIALECTS = ["streamed", "polled", "rosmaster", *OURS_ALONE]
STREAMS = ["streamed", "rosmaster", *OURS_ALONE]
"""Those that report their counts by themselves, and can cut the power."""

CUT = b"$pwm:0,0,0,0#"
SUREST = {
    "streamed": CUT,
    "polled": b"$speed:0,0,0,0#",
    "rosmaster": ROSMASTER.cut,
    "binary": BINARY.cut,
}
"""The command that releases the motors of each board, or is the best that there is."""

START_UP_S = 0.1
"""Of a board that is silent for long after a reset, here."""

RATES_HZ = {"streamed": 100.0, "polled": 50.0, "rosmaster": 24.39, "binary": 25.0}
"""New counts."""

SPEED_MAX_M_S = 2.0
TICK_M = math.pi * 0.067 / 1320

_ORDER = re.compile(
    rb"\$(?:spd|speed|pwm):(-?\d+,-?\d+,-?\d+,-?\d+)#"
    rb"|\xa5\x06\x10(.{6})..|\xa5\x00\x11.."
    rb"|\xff\xfc\x0a\x12\x01(.{6}).|\xff\xfc\x07\x11\x01\x00\x00\x00\x19",
    re.DOTALL,
)


def with_true_gains(simulation: SimulationOptions) -> SimulationOptions:
    """The same loops, quick by gains that the board stores and shows: the check goes by them."""
    if simulation.loop_gain != QUICK_GAIN or simulation.dialect not in {"streamed", "rosmaster"}:
        return simulation
    if not BOARDS[simulation.dialect].make.__module__.startswith("yahboomd."):
        return simulation  # a vendor's firmware, whose loop is its own
    flash = simulation.flash
    if flash is None:
        steers = simulation.drive == "ackermann"
        rosmaster = simulation.dialect == "rosmaster"
        flash = RosmasterStored(car_type=5 if steers else 1) if rosmaster else FlashContent()
    assert isinstance(flash, FlashContent | RosmasterStored)
    gains = {name: QUICK_GAIN * getattr(flash, name) for name in ("p", "i", "d")}
    flash = msgspec.structs.replace(flash, **gains)
    return msgspec.structs.replace(simulation, loop_gain=PLAIN_GAIN, flash=flash)


class Kept:
    """An outlet that keeps its samples."""

    has_subscribers = True

    def __init__(self) -> None:
        self.payloads: list[bytes] = []

    def put(self, payload: bytes) -> bool:
        self.payloads.append(payload)
        return True


class FaultBench(RobotBench):
    """A robot bench that keeps every port that was opened, and the robot's true poses."""

    def __init__(
        self,
        folder: Path,
        overrides: Sequence[str] = (),
        simulation: SimulationOptions | None = None,
    ) -> None:
        simulation = simulation or SimulationOptions()
        if simulation.start_up_s == SimulationOptions().start_up_s:
            # Its length is a test of its own.
            simulation = msgspec.structs.replace(simulation, start_up_s=START_UP_S)
        simulation = with_true_gains(simulation)
        super().__init__(folder, overrides, simulation)
        self.ports: list[BoardPort] = []
        self.truth: list[TruthSample] = []
        self.robot.on_truth = self.truth.append

    async def _open(self) -> BoardPort:
        port = await super()._open()
        self.ports.append(port)
        return port

    def do(self, command: str) -> None:
        """A fault, by the name that ``yahboomd simulate`` knows."""
        answer = execute(self.robot, command, self.clock.now_ns())
        assert answer.startswith("ok"), answer

    @property
    def orders(self) -> list[tuple[int, bytes]]:
        """Every speed and every stop that was written to any port, with its time."""
        return list(itertools.chain.from_iterable(map(orders_of, self.ports)))

    def orders_since(self, ns: int) -> list[tuple[int, bytes]]:
        """Those that were written at or after a moment."""
        return [order for order in self.orders if order[0] >= ns]

    def fastest_since(self, ns: int) -> float:
        """The fastest that any wheel truly turned since."""
        self.robot.advance(self.clock.now_ns())
        return max(max(map(abs, each.speed_m_s)) for each in self.truth if each.t_ns >= ns)

    def stood_at(self, ns: int) -> int:
        """The moment from which all wheels truly stood for good."""
        self.robot.advance(self.clock.now_ns())
        turning = [
            each.t_ns
            for each in self.truth
            if each.t_ns >= ns and max(map(abs, each.speed_m_s)) >= 0.03
        ]
        return turning[-1] if turning else ns

    def events(self, kind: str) -> list[str]:
        """The words of all events of a kind."""
        return [event.message for event in self.heard.events if event.kind == kind]


def orders_of(port: BoardPort) -> list[tuple[int, bytes]]:
    """Every speed and every stop that was written to a port, with its time."""
    return [(at_ns, match[0]) for at_ns, data in port.written for match in _ORDER.finditer(data)]


def is_stop(order: bytes) -> bool:
    """Whether a speed frame moves nothing."""
    match = _ORDER.fullmatch(order)
    return match is not None and not (
        any(map(int, (match[1] or b"0").split(b","))) or any(match[2] or match[3] or b"")
    )


def holds_stop(data: bytes) -> bool:
    """Whether a frame that moves nothing is among the bytes."""
    return any(is_stop(match[0]) for match in _ORDER.finditer(data))


def first_stop_ns(orders: Sequence[tuple[int, bytes]]) -> int:
    """The moment at which the first frame that moves nothing was written."""
    return next(at_ns for at_ns, order in orders if is_stop(order))


def assert_no_jump(estimates: Sequence[OdometryEstimate]) -> None:
    """No step is longer than a wheel can roll in its time, and one tick."""
    for before, after in itertools.pairwise(estimates):
        assert after.stamp_ns > before.stamp_ns
        room_m = SPEED_MAX_M_S * (after.stamp_ns - before.stamp_ns) / 1e9 + TICK_M
        for old, new in zip(before.motor_ticks, after.motor_ticks, strict=True):
            assert abs(new - old) * TICK_M <= room_m * (1.0 + 1e-9)
        # The correction for curvature adds a little sideways to the rolled way.
        moved = (after.pose.x - before.pose.x, after.pose.y - before.pose.y)
        assert math.hypot(*moved) <= 1.05 * room_m


def assert_covariance_grows(estimates: Sequence[OdometryEstimate]) -> None:
    """The uncertainty of the pose never becomes less."""
    for before, after in itertools.pairwise(estimates):
        assert after.pose_covariance[8] >= before.pose_covariance[8]
        assert _volume(after) >= _volume(before) * (1.0 - 1e-6)


def _volume(estimate: OdometryEstimate) -> float:
    a, b, c, d, e, f, g, h, i = estimate.pose_covariance
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
