"""Wheels in the air, over a clean line: each is checked, watched while it turns, left standing."""

from __future__ import annotations

import asyncio

import pytest
from tuning_bench import TuningBench

from yahboomd.core.errors import BoardError
from yahboomd.simulation.motors import FAULTS
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.tune.estimates.dead_zone import stopping_output, turning_output
from yahboomd.tools.tune.stand import Stand


def opened(bench: TuningBench):
    return Stand.open(bench.link.open, bench.link.clock, bench.config)


def motor(bench: TuningBench, name: str):
    plant = bench.link.robot.plant
    return plant.motors[[wire.name for wire in plant.wiring].index(name)]


async def standing(bench: TuningBench) -> None:
    """They stand, with the motors let go."""
    await asyncio.sleep(1.0)
    assert not any(bench.link.rim_speeds)
    assert not any(each.pwm for each in bench.link.robot.plant.motors)


async def turning(bench: TuningBench) -> None:
    """Wait until the wheels turn by their command."""
    while not bench.link.ports or min(bench.link.rim_speeds) < 0.25:
        await asyncio.sleep(0.01)


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("encoder-reversed", "counts down while it is driven forward"),
        ("unplugged", "does not count"),
    ],
)
@on_virtual_time
async def test_a_wheel_that_would_run_away_is_found_without_regulation(fault, words) -> None:
    bench = TuningBench()
    motor(bench, "left").faults = FAULTS[fault]
    with pytest.raises(BoardError, match=words):
        async with opened(bench) as stand:
            await stand.ramp(stand.motors[0], 1, down=True)
    assert not [
        frame
        for frame in bench.link.frames
        if frame.startswith(b"$spd:") and b"0,0,0,0" not in frame
    ]
    await standing(bench)


@pytest.mark.cases(1)
@pytest.mark.parametrize("fault", ["encoder-reversed", "phases-swapped"])
@on_virtual_time
async def test_a_wheel_that_turns_against_its_command_is_cut_at_once(fault) -> None:
    bench = TuningBench(dialect="polled")
    motor(bench, "right").faults = FAULTS[fault]
    fastest = 0.0

    async def watch() -> None:
        nonlocal fastest
        while True:
            fastest = max(fastest, *map(abs, bench.link.rim_speeds))
            await asyncio.sleep(0.01)

    watching = asyncio.ensure_future(watch())
    with pytest.raises(BoardError, match=r"right .* turned against its command"):
        async with opened(bench) as stand:
            await stand.step(0.3, 1.0)
    watching.cancel()
    await asyncio.gather(watching, return_exceptions=True)
    assert fastest > 0.1


@pytest.mark.cases(1)
@pytest.mark.parametrize("fault", ["motor-dead", "encoder-dead", "unplugged"])
@on_virtual_time
async def test_a_wheel_that_stands_while_another_one_turns_is_cut(fault) -> None:
    bench = TuningBench()
    motor(bench, "left").faults = FAULTS[fault]
    with pytest.raises(BoardError, match=r"left .* stood while another wheel turned"):
        async with opened(bench) as stand:
            # Long before the step ends.
            await asyncio.wait_for(stand.step(0.4, 1.5), 1.2)
    await standing(bench)


@on_virtual_time
async def test_a_computer_that_stood_still_as_a_wheel_was_cut_accuses_no_wheel() -> None:
    bench = TuningBench()
    motors, loop = bench.link.robot.plant.motors, asyncio.get_running_loop()

    async def stand_still() -> None:
        for driven in (True, False):
            while any(each.pwm for each in motors) != driven:
                await asyncio.sleep(0.005)
        loop.freeze(4.0)

    standing_still = asyncio.ensure_future(stand_still())
    async with opened(bench) as stand:
        await stand.ramp(stand.motors[0], 1, down=True)
    await standing_still
    await standing(bench)


@on_virtual_time
async def test_cancelled_in_a_step_the_wheels_stand() -> None:
    bench = TuningBench()

    async def work() -> None:
        async with opened(bench) as stand:
            await stand.step(0.4, 1.5)

    task = asyncio.ensure_future(work())
    await turning(bench)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    await standing(bench)


@on_virtual_time
async def test_a_step_is_the_travel_of_each_wheel_along_its_command() -> None:
    bench = TuningBench()
    async with opened(bench) as stand:
        for speed in (0.4, -0.4):
            traces = await stand.step(speed, 1.0)
            for travel in traces.travel_m:
                assert travel[-1] == pytest.approx(0.4, abs=0.06)
                assert (travel[-1] - travel[-21]) / 0.2 == pytest.approx(0.4, rel=0.03)
    await standing(bench)


# The board stores 1600: wheels whose friction is above and below it.
@pytest.mark.parametrize("friction", [1440, 1950])
@pytest.mark.parametrize(
    "stick", [1.3, *(pytest.param(each, marks=pytest.mark.nightly) for each in (1.0, 1.6))]
)
@pytest.mark.parametrize("lag_s", [0.06, pytest.param(0.3, marks=pytest.mark.nightly)])
@on_virtual_time
async def test_a_wheel_stops_at_its_moving_friction_however_it_sticks(
    friction: int, stick: float, lag_s: float
) -> None:
    bench = TuningBench(
        options={"motor_dead_zone": friction, "sticks": (stick,), "time_constant_s": lag_s}
    )
    async with opened(bench) as stand:
        rise, fall = await stand.ramp(stand.motors[0], -1, down=True)
    begins = turning_output(rise)
    assert begins is not None
    assert begins >= stick * friction - 20
    assert stopping_output(fall) == pytest.approx(friction, rel=0.03)
    await standing(bench)
