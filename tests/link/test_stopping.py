"""The last words on a port."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Iterator

import pytest
from kernel_queue import Line, QueueingPort

from yahboomd.core.link import stopping
from yahboomd.core.link.stopping import (
    StopReport,
    bring_to_rest,
    stop_unidentified,
)
from yahboomd.core.protocol.dialect import Totals
from yahboomd.core.protocol.four_channel.framing import RESYNC
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.standstill import STAND_WITHIN_S, CountedStandstill
from yahboomd.simulation.motors import MotorFaults
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time

MS = 1_000_000


class Scene:
    """A robot that somebody left driving."""

    def __init__(
        self, dialect: str, line: Line | None = None, flash: RosmasterStored | None = None
    ) -> None:
        options = SimulationOptions(dialect=dialect, flash=flash)  # type: ignore[arg-type]
        self.robot = SimulatedRobot(options)
        self.port = QueueingPort(self.robot, line or Line())
        self.dialect = DIALECTS[dialect]
        self.watch = CountedStandstill(190.0)
        self.framer = self.dialect.framer()
        self.deaf = False
        self.late: list[bytes] | None = None
        self.port.listen(self.data, lambda _: None)

    def data(self, data: bytes) -> None:
        if self.late is not None:
            self.late.append(data)
        else:
            self.hear(data)

    def hear(self, data: bytes) -> None:
        for item in self.framer.feed(data):
            decoded = self.dialect.decode(item)
            if isinstance(decoded, Totals) and not self.deaf:
                self.watch.add(decoded.ticks, LoopClock().now_ns())

    async def drive(self, fault: MotorFaults | None = None) -> None:
        for frame in self.dialect.arm:
            self.port.write(frame)
            await asyncio.sleep(0.05)
        if fault is not None:
            self.robot.set_faults("left", fault, now_ns=LoopClock().now_ns())
        self.port.write(self.dialect.speeds((300, 0, 300, 0)))
        await asyncio.sleep(1.0)
        assert min(self.speeds) > 0.2

    async def rest(self) -> StopReport:
        return await bring_to_rest(self.port, LoopClock(), self.dialect, self.watch)

    @property
    def speeds(self) -> list[float]:
        self.robot.advance(LoopClock().now_ns())
        return [abs(motor.speed_m_s) for motor in self.robot.plant.motors]


@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@on_virtual_time
async def test_turning_wheels_are_brought_to_rest_and_seen_to_stand(dialect: str) -> None:
    scene = Scene(dialect)
    await scene.drive()
    before, now_ns = len(scene.port.written), LoopClock().now_ns()
    report = await scene.rest()
    # Its first byte goes out at once.
    assert scene.port.written[before] == (now_ns, RESYNC + scene.dialect.brake)
    assert report.stood is True
    assert report.flushed
    assert report.took_s <= STAND_WITHIN_S + 0.03
    assert max(scene.speeds) < 0.03


@on_virtual_time
async def test_a_wheel_that_does_not_obey_the_brake_is_cut() -> None:
    scene = Scene("streamed")
    await scene.drive(MotorFaults(encoder_reversed=True))
    report = await scene.rest()
    assert report.cut
    # Seen to roll out, after the cut.
    assert report.stood is True
    assert report.took_s > STAND_WITHIN_S
    await asyncio.sleep(1.0)
    assert max(scene.speeds) < 0.05


@pytest.mark.parametrize("car_type", [0, 3])
@on_virtual_time
async def test_motors_that_were_let_go_stop_on_a_rosmaster_whose_car_type_ignores_a_cut(
    car_type: int,
) -> None:
    scene = Scene("rosmaster", flash=RosmasterStored(car_type=car_type))
    full = scene.dialect.outputs((scene.dialect.most_output,) * 4, {})
    for frame in (*scene.dialect.arm, full):
        scene.port.write(frame)
        await asyncio.sleep(1.0)
    assert min(scene.speeds) > 0.1
    report = await bring_to_rest(scene.port, LoopClock(), scene.dialect, scene.watch, let_go=True)
    assert report.stood
    assert max(scene.speeds) < 0.03


@pytest.mark.cases(2)
@pytest.mark.parametrize("at_ms", range(10, 70, 10))
@on_virtual_time
async def test_counts_that_come_late_and_one_by_one_end_in_no_false_verdict(at_ms: int) -> None:
    """As a starved host, or a USB adapter, hands them over."""
    scene = Scene("streamed")
    await scene.drive()

    async def hold() -> None:
        await asyncio.sleep(at_ms / 1000)
        scene.late = []
        await asyncio.sleep(0.2)
        first, *others = scene.late
        scene.late = None
        scene.data(first)
        await asyncio.sleep(0.004)
        scene.data(b"".join(others))

    holding = asyncio.create_task(hold())
    report = await scene.rest()
    assert report.stood is True
    assert max(scene.speeds) < 0.03
    await holding


@pytest.mark.cases(2)
@pytest.mark.parametrize("seed", [0, 110, 124, 137, 141, 193])
@on_virtual_time
async def test_counts_that_stall_again_and_again_end_in_no_false_verdict(seed: int) -> None:
    """Each time that they look like standstill, more come of wheels that turned."""
    chance = random.Random(seed)
    scene = Scene("streamed")
    await scene.drive()

    async def stall() -> None:
        for _ in range(8):
            scene.late = late = []
            await asyncio.sleep(chance.uniform(0.03, 0.4))
            scene.late = None
            for data in late:
                scene.hear(data)
                if chance.random() < 0.2:
                    await asyncio.sleep(chance.choice((0.002, 0.005, 0.02)))
            await asyncio.sleep(chance.uniform(0.0, 0.1))

    stalling = asyncio.create_task(stall())
    report = await scene.rest()
    assert report.stood is True
    assert max(scene.speeds) < 0.03
    stalling.cancel()


@on_virtual_time
async def test_without_counts_nothing_is_claimed_and_the_motors_are_let_go() -> None:
    scene = Scene("streamed")
    await scene.drive()
    scene.deaf = True
    report = await scene.rest()
    assert report.stood is None
    assert report.cut
    assert sum(scene.dialect.brake in data for _, data in scene.port.written) >= 5


@on_virtual_time
async def test_half_a_frame_before_does_not_swallow_the_stop() -> None:
    scene = Scene("streamed")
    await scene.drive()
    scene.port.write(b"$spd:500,0,5")
    await asyncio.sleep(0.05)
    report = await scene.rest()
    assert report.stood is True
    assert max(scene.speeds) < 0.03


def each_cut(dialect: str, every: int) -> Iterator[tuple[bytes, int]]:
    """A motion frame, a configuration frame and the stops, and the bytes to cut them at."""
    speaks = DIALECTS[dialect]
    frames = (speaks.speeds((300, 0, -300, 0)), *speaks.arm, speaks.brake, speaks.cut)
    cuts = [(frame, cut) for frame in filter(None, frames) for cut in range(1, len(frame))]
    yield from cuts[::every]


cuts_of_frames = pytest.mark.parametrize(
    ("dialect", "every"),
    [
        ("streamed", 9),
        *(pytest.param(each, 1, marks=pytest.mark.nightly) for each in ("streamed", "polled")),
    ],
)


@cuts_of_frames
@on_virtual_time
async def test_a_frame_cut_at_any_byte_swallows_no_stop(dialect: str, every: int) -> None:
    for frame, cut in each_cut(dialect, every):
        scene = Scene(dialect)
        await scene.drive()
        scene.port.write(frame[:cut])
        report = await scene.rest()
        assert report.stood is True, (frame, cut)
        assert report.took_s <= STAND_WITHIN_S + 0.03
        assert max(scene.speeds) < 0.03, (frame, cut)
        scene.port.close()


@cuts_of_frames
@on_virtual_time
async def test_a_frame_cut_at_any_byte_by_dropping_the_queue_swallows_no_stop(
    dialect: str, every: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stopping, "GIVE_UP_S", 0.1)
    for frame, cut in each_cut(dialect, every):
        line = Line(drops=True)
        scene = Scene(dialect, line)
        await scene.drive()
        # It sends again when all was given up, and the queue dropped.
        line.stall(0.2)
        scene.port.interrupted(frame, cut)
        report = await scene.rest()
        assert report.doubt == "the port did not take all of it"
        await asyncio.sleep(1.0)
        assert max(scene.speeds) < 0.03, (frame, cut)
        scene.port.close()


@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@on_virtual_time
async def test_no_last_word_is_written_before_the_one_ahead_is_on_the_wire(dialect: str) -> None:
    line = Line()
    scene = Scene(dialect, line)
    await scene.drive()
    line.stall(1.0)
    before, now_ns = len(scene.port.written), LoopClock().now_ns()
    report = await scene.rest()
    words = scene.port.written[before:]
    assert [data for at_ns, data in words if at_ns < now_ns + 1_000_000_000] == [
        RESYNC + scene.dialect.brake
    ]
    # And the brake again, once the port sends.
    assert words[1][1] == scene.dialect.brake
    assert report.stood is True
    assert report.doubt is None


@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@on_virtual_time
async def test_the_stop_of_an_unknown_board_is_said_again_after_it_was_held_up(
    dialect: str,
) -> None:
    line = Line()
    scene = Scene(dialect, line)
    await scene.drive()
    line.stall(0.5)
    assert await stop_unidentified(scene.port, LoopClock())
    await asyncio.sleep(1.0)
    assert max(scene.speeds) < 0.03
    line.stall(10.0)
    assert not await stop_unidentified(scene.port, LoopClock())


@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@on_virtual_time
async def test_a_board_whose_dialect_is_unknown_is_stopped(dialect: str) -> None:
    scene = Scene(dialect)
    await scene.drive()
    await stop_unidentified(scene.port, LoopClock())
    await asyncio.sleep(1.0)
    assert max(scene.speeds) < 0.03


@on_virtual_time
async def test_it_ends_in_bounded_time_whatever_the_board_does() -> None:
    scene = Scene("streamed")
    await scene.drive()
    scene.robot.hang(LoopClock().now_ns())
    start_ns = LoopClock().now_ns()
    report = await scene.rest()
    assert report.stood is not True
    assert LoopClock().now_ns() - start_ns < 2_000_000_000


@on_virtual_time
async def test_a_port_that_stalls_again_while_late_counts_deny_the_standstill_is_given_up() -> None:
    line = Line()
    scene = Scene("streamed", line)
    await scene.drive()
    line.stall(2.2)

    async def trouble() -> None:
        await asyncio.sleep(2.35)
        line.stall(10.0)
        for ticks in range(0, 40_000, 40):
            scene.watch.add((ticks,) * 4, LoopClock().now_ns())
            await asyncio.sleep(0.01)

    start_ns = LoopClock().now_ns()
    in_trouble = asyncio.create_task(trouble())
    report = await scene.rest()
    assert not report.flushed
    assert LoopClock().now_ns() - start_ns < 3_500 * MS
    in_trouble.cancel()


# Do the wheels stand?


def test_nothing_is_said_before_a_whole_window_was_seen() -> None:
    watch = CountedStandstill(190.0)
    watch.add((0, 0, 0, 0), 0)
    watch.add((0, 0, 0, 0), 40 * MS)
    assert watch.speed is None
    assert not watch.standing


def test_equal_counts_across_the_window_are_standstill() -> None:
    watch = CountedStandstill(190.0)
    for ms in range(0, 100, 10):
        watch.add((5, 5, 5, 5), ms * MS)
    assert watch.standing


def test_one_turning_wheel_is_enough_to_deny_it() -> None:
    watch = CountedStandstill(190.0)
    for ms in range(0, 100, 10):
        watch.add((5, 5, -ms, 5), ms * MS)
    assert watch.speed is not None
    assert abs(watch.speed - 1000.0) < 1.0
    assert not watch.standing


def test_a_wrap_of_the_counter_is_no_motion() -> None:
    watch = CountedStandstill(190.0)
    for ms in range(0, 100, 10):
        ticks = 2**31 - 1 if ms < 50 else -(2**31)
        watch.add((ticks, 0, 0, 0), ms * MS)
    assert watch.standing


def test_forgetting_restarts_the_window() -> None:
    watch = CountedStandstill(190.0)
    for ms in range(0, 100, 10):
        watch.add((0, 0, 0, 0), ms * MS)
    watch.reset()
    assert not watch.standing
