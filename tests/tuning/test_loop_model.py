"""The model of a loop answers as the loop does, and is found again from its own steps."""

from __future__ import annotations

import itertools
import math
from itertools import pairwise
from random import Random

import numpy as np
import pytest

from yahboomd.simulation.speed_loop import LoopSettings, SpeedLoop
from yahboomd.tools.tune.estimates.loop_model import Gains, LoopModel, Step, _shifted, fit, run
from yahboomd.tools.tune.estimates.suggestion import suggest

TICK_S = 0.01
MOTOR = LoopModel(gain=2.8, lag_s=0.06, gap=200.0, fastest=1150.0)
COUNT = 0.16


def step(gains: Gains, model: LoopModel = MOTOR, *, late: float = 0.0, apart: int = 1) -> Step:
    """A step whose counts were rounded down, as encoders do, from several places between two."""
    travels = [run(model, gains, 400.0, tick_s=TICK_S, ticks=150, count=COUNT) for _ in range(4)]
    travel = [sum(each) / 4.0 for each in zip(*travels, strict=True)]
    if late:
        travel = [0.0] * round(late / TICK_S) + travel[: 151 - round(late / TICK_S)]
    return Step(gains=gains, target=400.0, travel=travel, apart=apart)


def test_a_loop_with_an_integral_part_comes_to_its_target_in_spite_of_a_dead_zone():
    travel = run(MOTOR, Gains(0.5, 0.08, 0.0), 400.0, tick_s=TICK_S, ticks=200)
    assert (travel[-1] - travel[-2]) / TICK_S == pytest.approx(400.0, rel=1e-3)


def test_without_an_integral_part_it_stays_short_by_the_formula():
    """At rest P e is all of the output: v = A P (T - v) - B."""
    travel = run(MOTOR, Gains(1.0, 0.0, 0.0), 400.0, tick_s=TICK_S, ticks=300)
    expected = (2.8 * 400.0 - 200.0) / 3.8
    assert (travel[-1] - travel[-2]) / TICK_S == pytest.approx(expected, rel=1e-3)


def test_no_output_makes_it_faster_than_its_motor():
    travel = run(MOTOR, Gains(9.0, 3.0, 0.0), 3000.0, tick_s=TICK_S, ticks=100)
    fastest = max(after - before for before, after in itertools.pairwise(travel)) / TICK_S
    assert 1100.0 < fastest <= 1150.0 + 1e-6


def test_it_is_the_law_of_the_simulated_boards_loop():
    """The two were written apart from each other: outputs agree to the rounding of the board's."""
    random = Random(1)
    loop, gains = SpeedLoop(gain=1.0), Gains(0.8, 0.06, 0.5)
    loop.target_mm_s = 400
    tuning = LoopSettings(mm_s_per_tick=1.0, p=gains.p, i=gains.i, d=gains.d, dead_zone=0)
    output = error1 = error2 = 0.0
    for _ in range(50):
        measured = random.uniform(0.0, 500.0)
        error = 400.0 - measured
        output += (
            gains.p * (error - error1) + gains.i * error + gains.d * (error - 2.0 * error1 + error2)
        )
        error1, error2 = error, error1
        assert loop.next_output(measured, tuning) == int(output)


@pytest.mark.parametrize(
    "gains", [Gains(0.8, 0.06, 0.5), Gains(0.1, 0.02, 0.0), Gains(0.1, 0.15, 0.0)]
)
@pytest.mark.parametrize("late", [0.0, 0.01])
def test_a_motor_is_found_from_one_step_with_any_usual_gains(gains, late):
    found, left = fit([step(gains, late=late)], tick_s=TICK_S, fastest=1500.0)
    assert left < 0.02
    # Steep steps that come late leave a doubt between gain and lag, which the gains bear.
    assert found.gain / found.lag_s == pytest.approx(MOTOR.gain / MOTOR.lag_s, rel=0.45)
    suggested = suggest([found], 400.0, tick_s=TICK_S, count=COUNT)
    travel = run(MOTOR, suggested.gains, 400.0, tick_s=TICK_S, ticks=150)
    assert max(after - before for before, after in pairwise(travel)) <= 1.05 * 400.0 * TICK_S


def test_two_steps_of_other_gains_are_explained_by_one_motor():
    steps = [step(Gains(0.8, 0.06, 0.5)), step(Gains(0.3, 0.1, 0.0))]
    found, left = fit(steps, tick_s=TICK_S, fastest=1500.0)
    assert found.gain == pytest.approx(MOTOR.gain, rel=0.1)
    assert found.gap == pytest.approx(MOTOR.gap, rel=0.3)
    assert left < 0.02


def test_readings_every_four_ticks_are_enough():
    seen = step(Gains(0.3, 0.1, 0.0))
    # Straight lines between every fourth tick, from four beginnings.
    lines = []
    for phase in range(4):
        marks = [0, *range(phase or 4, 151, 4), 150]
        line = [
            seen.travel[low] + (seen.travel[high] - seen.travel[low]) * (tick - low) / (high - low)
            for low, high in itertools.pairwise(marks)
            if high > low
            for tick in range(low, high)
        ]
        lines.append([*line, seen.travel[150]])
    travel = [sum(each) / 4.0 for each in zip(*lines, strict=True)]
    read = Step(gains=seen.gains, target=400.0, travel=travel, apart=4)
    found, _ = fit([read], tick_s=TICK_S, fastest=1500.0)
    assert found.gain == pytest.approx(MOTOR.gain, rel=0.15)
    assert found.lag_s == pytest.approx(MOTOR.lag_s, rel=0.25)


def test_what_is_no_step_of_a_motor_leaves_much_unexplained():
    random = Random(3)
    place, travel = 0.0, [0.0]
    for _ in range(150):
        place += random.uniform(0.0, 8.0)
        travel.append(place)
    noise = Step(gains=Gains(0.8, 0.06, 0.5), target=400.0, travel=travel)
    assert fit([noise], tick_s=TICK_S, fastest=1500.0)[1] > 0.06
    assert math.isfinite(fit([noise], tick_s=TICK_S, fastest=1500.0)[0].gain)


def test_the_first_ticks_are_those_of_the_law_by_hand():
    """A motor without lag or gap, which follows the output at once."""
    motor = LoopModel(gain=1.0, lag_s=1e-6, gap=0.0, fastest=1000.0)
    travel = run(motor, Gains(0.1, 0.2, 0.05), 100.0, tick_s=TICK_S, ticks=3)
    assert travel == pytest.approx([0.0, 0.35, 0.7275, 1.242875], rel=1e-3)


def test_an_output_within_the_gap_moves_nothing():
    assert run(MOTOR, Gains(0.01, 0.0, 0.0), 400.0, tick_s=TICK_S, ticks=5) == [0.0] * 6


@pytest.mark.parametrize(
    ("late", "explained"),
    [(-1.5, False), (-0.5, True), (0.0, True), (0.4, True), (1.3, True), (2.5, True), (3.5, False)],
)
def test_a_command_acts_up_to_two_and_a_half_ticks_late(late, explained):
    ticks = np.arange(60.0)
    expected, seen = (1.0 / (1.0 + np.exp((30.0 + by - ticks) / 3.0)) for by in (0.0, late))
    a_tick = float(np.linalg.norm(np.gradient(expected)))
    left = float(np.linalg.norm(_shifted(seen, expected)))
    assert left < 0.05 * a_tick if explained else left > 0.7 * a_tick
