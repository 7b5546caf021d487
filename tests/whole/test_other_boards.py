"""A board that no file of the tree knows is found, driven, stopped, probed and set up.

And boards of different families bear each other's questions and stops: whichever is at a port, it
gets those of all.
"""

from __future__ import annotations

import asyncio
import itertools
import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from binary_board import Stored
from binary_dialect import BINARY, registered
from board_bench import LinkBench
from fault_bench import FaultBench, is_stop

from yahboomd.core.link.stopping import stop_unidentified
from yahboomd.core.link.storing import store
from yahboomd.core.protocol.first_words import FIRST_WORDS
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import DIALECTS, connect_stop
from yahboomd.simulation.imu import MPU9250, ImuOptions
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.tools.port.probing import examine
from yahboomd.tools.probe.probe_report import report
from yahboomd.tools.probe.probe_text import text

ALL = [*DIALECTS, "binary"]
BODIES = ("rosmaster", "binary")
"""Those that take the velocity of the body."""
MS = 1_000_000


@pytest.fixture(autouse=True)
def known() -> Iterator[None]:
    with registered():
        yield


def robot(tmp_path: Path, *overrides: str, **simulation: object) -> FaultBench:
    options = SimulationOptions(dialect="binary", **simulation)  # type: ignore[arg-type]
    return FaultBench(tmp_path, overrides, options)


@on_virtual_time
async def test_a_binary_board_is_found_beside_the_others_without_a_question(
    tmp_path: Path,
) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        session = bench.supervisor.session
        assert session is not None
        assert session.board is not None
        identity = session.board.identity
        assert identity.dialect == BINARY
        assert identity.settings == {"version": "1.7", "track_mm": 150}
        said = b"".join(data for _, data in bench.ports[0].written)
        assert not any(
            dialect.probe and dialect.probe in said
            for dialect in DIALECTS.values()
            if dialect is not BINARY
        )


@pytest.mark.cases(1)
@pytest.mark.parametrize("track_mm", [100, 150, 300])
@on_virtual_time
async def test_it_drives_a_curve_by_the_velocity_of_its_body_whatever_track_it_stores(
    tmp_path: Path, track_mm: int
) -> None:
    async with robot(tmp_path, flash=Stored(track_mm=track_mm)) as bench:
        await bench.ready()
        await bench.drive(3.0, 0.3, 1.0)
        left, right = bench.rim_speeds
        assert left == pytest.approx(0.3 - 0.075, abs=0.02)
        assert right == pytest.approx(0.3 + 0.075, abs=0.02)
        truth = bench.robot.truth(bench.clock.now_ns())
        pose = bench.heard.estimates[-1].pose
        # It reports every 40 ms: the truth may be as far ahead.
        assert pose.x == pytest.approx(truth.x, abs=0.02)
        assert pose.y == pytest.approx(truth.y, abs=0.02)


@on_virtual_time
async def test_it_is_probed_and_its_report_shows_its_own_settings() -> None:
    board = LinkBench(dialect="binary", initial_ticks=(7, 0, 8, 0), flash=Stored(track_mm=200))
    found = await examine(board.open, board.clock, {})
    assert found.dialect == BINARY
    assert found.settings == {"version": "1.7", "track_mm": 200}
    assert found.volts == pytest.approx(7.4, abs=0.1)
    assert (found.ticks, found.standing) == ((7, 0, 8, 0), True)
    shown = report(
        found,
        None,
        port="/dev/board",
        device="/dev/board",
        profile=PROFILES["520"],
        want={"track_mm": 150},
        wanted_dialect="auto",
    )
    lines = text(shown)
    assert "board of frames with a checksum, binary dialect, firmware 1.7" in lines[1]
    assert lines[-1].split() == ["track", "200", "mm", "150", "mm", "differs"]


@on_virtual_time
async def test_its_settings_are_stored_and_read_back() -> None:
    board = LinkBench(dialect="binary")
    storing = await store(board.open, board.clock, {"track_mm": 180})
    assert storing.complete
    assert storing.has["track_mm"] == 180
    assert board.robot.board.flash == Stored(track_mm=180)  # type: ignore[attr-defined]


# Boards of several families.


def at_rest_and_ready(dialect: str) -> SimulatedRobot:
    """A board as its own daemon leaves it: one command from turning."""
    board = SimulatedRobot(SimulationOptions(dialect=dialect))
    board.start(0)
    for index, frame in enumerate((DIALECTS[dialect].resync, *DIALECTS[dialect].arm)):
        board.host_wrote(frame, (1 + 30 * index) * MS)
    board.advance(500 * MS)
    return board


def ahead(dialect: str) -> bytes:
    """A command that turns all wheels forward."""
    return DIALECTS[dialect].speeds((300, 0, 0) if dialect in BODIES else (300, 0, 300, 0))


def speeds(board: SimulatedRobot) -> list[float]:
    return [abs(motor.speed_m_s) for motor in board.plant.motors]


@pytest.mark.cases(3)
@pytest.mark.parametrize(
    ("asking", "there"), [pair for pair in itertools.product(ALL, ALL) if pair[0] != pair[1]]
)
@pytest.mark.parametrize("cut_after", [0, 1, 5, 9])
def test_what_finds_one_board_turns_no_wheel_of_another_stores_nothing_and_leaves_it_able_to_hear(
    asking: str, there: str, cut_after: int
) -> None:
    board, stranger, own = at_rest_and_ready(there), DIALECTS[asking], DIALECTS[there]
    assert stranger.probe is not None
    before = getattr(board.board, "flash", None)
    now_ns = 500 * MS
    # Half a command of its own may wait in its ear.
    frames = [ahead(there)[:cut_after]] if cut_after and there in BODIES else []
    frames += [stranger.resync + stranger.probe] * 3
    frames += [stranger.resync + (stranger.cut or stranger.brake)]
    for frame in frames:
        board.host_wrote(frame, now_ns)
        for _ in range(30):
            now_ns += 10 * MS
            board.advance(now_ns)
            assert max(speeds(board)) < 0.001, frame
    assert getattr(board.board, "flash", None) == before
    board.host_wrote(own.resync, now_ns)
    board.host_wrote(ahead(there), now_ns + 5 * MS)
    board.advance(now_ns + 1000 * MS)
    assert min(speeds(board)) > 0.25


@pytest.mark.parametrize("there", ALL)
def test_the_stops_of_all_families_stop_each_board_that_is_driving(there: str) -> None:
    board = at_rest_and_ready(there)
    board.host_wrote(ahead(there), 500 * MS)
    board.advance(1500 * MS)
    assert min(speeds(board)) > 0.25
    now_ns = 1500 * MS
    for resync, stop in connect_stop():
        board.host_wrote(resync + stop, now_ns)
        now_ns += 30 * MS
        board.advance(now_ns)
    board.advance(now_ns + 1000 * MS)
    assert max(speeds(board)) < 0.03


@pytest.mark.cases(1)
@pytest.mark.parametrize("car_type", range(7))
def test_the_first_stops_stop_a_rosmaster_board_whatever_car_type_it_stores(car_type: int) -> None:
    own, flash = DIALECTS["rosmaster"], RosmasterStored(car_type=car_type)
    board = SimulatedRobot(SimulationOptions(dialect="rosmaster", flash=flash))
    board.start(0)
    board.host_wrote(own.outputs((2400,) * 4, {}), 500 * MS)
    board.advance(1500 * MS)
    assert min(speeds(board)) > 0.25
    board.host_wrote(FIRST_WORDS["rosmaster"], 1500 * MS)
    board.advance(1700 * MS)
    assert max(speeds(board)) < 0.03


@pytest.mark.cases(1)
@pytest.mark.parametrize("there", ALL)
def test_half_a_command_in_the_boards_ear_does_not_swallow_the_stop_behind_its_resync(
    there: str,
) -> None:
    own = DIALECTS[there]
    command = ahead(there)
    for size in range(1, len(command)):
        board = at_rest_and_ready(there)
        board.host_wrote(command, 500 * MS)
        board.advance(1000 * MS)
        board.host_wrote(command[:size], 1000 * MS)
        board.host_wrote(own.resync + (own.cut or own.brake), 1100 * MS)
        board.advance(2500 * MS)
        assert max(speeds(board)) < 0.03, size


async def stop_moments() -> dict[bytes, int]:
    """The moment of each dialect's stop, from the opening of a port."""
    board = LinkBench()
    port = await board.open()
    await stop_unidentified(port, LoopClock())
    first_ns = port.written[0][0]
    return {data: at_ns - first_ns for at_ns, data in port.written if is_stop(data)}


@on_virtual_time
async def test_another_family_delays_the_first_stop_of_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    together = await stop_moments()
    monkeypatch.delitem(DIALECTS, "binary")  # type: ignore[misc]
    alone = await stop_moments()
    assert (len(alone), len(together)) == (len(ALL) - 1, len(ALL))
    # The loop counts in seconds: to the microsecond.
    assert {stop: together[stop] for stop in alone} == pytest.approx(alone, abs=1000)


def test_a_direct_stop_sends_what_stops_each_of_them() -> None:
    assert list(FIRST_WORDS.values()) == [resync + stop for resync, stop in connect_stop()]
    assert FIRST_WORDS["binary"].endswith(BINARY.cut or b"none")


@on_virtual_time
async def test_a_board_that_may_report_by_itself_is_listened_for_before_any_is_asked() -> None:
    board = LinkBench()
    found = await examine(board.open, board.clock, {})
    assert found.dialect is not None
    assert found.dialect.name == "streamed"
    probe = DIALECTS["streamed"].probe
    assert probe is not None
    asked_ns = next(at_ns for at_ns, data in board.ports[0].written if probe in data)
    stopped_ns = max(
        at_ns
        for at_ns, data in board.ports[0].written
        if at_ns < asked_ns and connect_stop()[-1][1] in data
    )
    assert asked_ns - stopped_ns >= BINARY.listen_ns


SLIPPERY = (
    "chassis.preset=4wd",
    "chassis.wheel_separation_multiplier=1.25",
    "odometry.heading=fused",
)
"""The configured track is a quarter wider than the base acts: the wheels see too little turn."""


@on_virtual_time
async def test_with_a_gyro_the_heading_of_a_base_that_slips_is_right(tmp_path: Path) -> None:
    async with robot(tmp_path, *SLIPPERY, drive="skid_steer", flash=Stored(imu=MPU9250)) as bench:
        await bench.ready()
        await asyncio.sleep(8.0)
        # The first clear turn is the wheels', and shows the sign of the gyro.
        await bench.drive(2.0, 0.1, 1.0)
        await asyncio.sleep(1.0)
        assert bench.heard.kinds[-2:] == ["gyro_unfit", "gyro_fit"]
        first = bench.robot.truth(bench.clock.now_ns()).pose.theta
        off = bench.heard.estimates[-1].pose.theta - first
        variance = bench.heard.estimates[-1].pose_covariance[8]
        assert 0.1 < abs(off) < 2.0 * math.sqrt(variance)
        await bench.drive(5.0, 0.1, 1.0)
        await asyncio.sleep(1.0)
        truth = bench.robot.truth(bench.clock.now_ns()).pose
        pose = bench.heard.estimates[-1].pose
        assert abs(truth.theta - first) > 3.0
        # Of the scale of this gyro up to 3 % is off.
        assert pose.theta - off == pytest.approx(truth.theta, abs=0.03 * (truth.theta - first))
        assert bench.heard.kinds[-1] == "gyro_fit"


@on_virtual_time
async def test_axes_turn_the_sensor_as_it_is_mounted(tmp_path: Path) -> None:
    mounted = ImuOptions(axes="y x -z")
    given = ("imu.axes=y x -z", "imu.frame_id=head")
    async with robot(tmp_path, *given, flash=Stored(imu=mounted)) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.0, 1.0)
        reading = bench.heard.imu_estimates[-1].reading
        assert reading.gyro_rad_s[2] == pytest.approx(1.0, abs=0.1)
        assert reading.acceleration_m_s2[2] == pytest.approx(9.8, abs=0.01)


@pytest.mark.cases(1)
@pytest.mark.parametrize("sensor", ["mpu9250", "icm20948"])
@on_virtual_time
async def test_a_rosmaster_board_gives_the_heading_its_gyro(tmp_path: Path, sensor: str) -> None:
    simulation = SimulationOptions(dialect="rosmaster", flash=RosmasterStored(imu=sensor))
    async with FaultBench(tmp_path, ["odometry.heading=fused"], simulation) as bench:
        await bench.ready()
        await asyncio.sleep(6.0)
        for wz in (1.0, -0.6, 1.0):
            await bench.drive(2.0, 0.2, wz)
            await asyncio.sleep(1.0)
        truth = bench.robot.truth(bench.clock.now_ns()).pose
        estimate, sample = bench.heard.estimates[-1], bench.heard.imu_estimates[-1]
        assert sample.reading.sensor.name == sensor
        assert estimate.pose.theta == pytest.approx(truth.theta, rel=0.03, abs=0.02)
        assert abs(sample.theta - truth.theta) < 4.0 * math.sqrt(sample.theta_variance) + 0.01
        assert sample.bias_variance < 1e-5
        assert bench.heard.kinds == ["connected", "gyro_unfit", "gyro_fit"]
