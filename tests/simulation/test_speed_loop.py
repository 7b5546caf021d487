from __future__ import annotations

import math
from pathlib import Path
from random import Random

import pytest

from yahboomd.simulation.four_channel.flash import FlashContent, tuning
from yahboomd.simulation.motors import FAULTS, HEALTHY, PWM_MAX
from yahboomd.simulation.options import PLAIN_GAIN, QUICK_GAIN, SimulationOptions
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.rosmaster.car_drive import CarDrive
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.speed_loop import TICK_NS, LoopSettings, MotorControl, SpeedLoop, wind_up_s


def rosmaster(car_type: int, **gains: float) -> LoopSettings:
    """The speed loop of a car."""
    options = SimulationOptions(dialect="rosmaster")
    plant = Plant(options, Random(0))
    stored = RosmasterStored(car_type=car_type, **gains)
    return CarDrive(plant, MotorControl(plant), stored).tuning


class Rig:
    def __init__(
        self,
        flash: FlashContent | None = None,
        totals: int = 0,
        *,
        gain: float = QUICK_GAIN,
        wired_type: int = 1,
        **options: object,
    ) -> None:
        self.plant = Plant(SimulationOptions(**options), Random(0))  # type: ignore[arg-type]
        self.plant.start(0)
        self.control = MotorControl(self.plant, (totals,) * 4, gain)
        self.tuning = tuning(flash or FlashContent(), wired_type)
        self.now_ns = 0

    def run(self, seconds: float) -> list[float]:
        """Speeds of the left wheel in m/s, one per tick."""
        speeds = []
        for _ in range(round(seconds * 100)):
            self.now_ns += TICK_NS
            self.control.tick(self.now_ns, self.tuning)
            self.control.renew_totals(self.now_ns, self.tuning)
            speeds.append(self.plant.motors[0].speed_m_s)
        return speeds

    def go(self, speed: int) -> None:
        self.control.regulate((speed, 0, speed, 0))


@pytest.mark.parametrize("target", [200, 500, 800, -500])
def test_a_healthy_wheel_reaches_its_speed_soon_and_keeps_it(target: int) -> None:
    rig = Rig()
    rig.go(target)
    speeds = [speed * 1000 / target for speed in rig.run(3.0)]
    assert min(speeds[40:]) > 0.85
    assert max(speeds) < 1.1
    assert sum(speeds[100:]) / len(speeds[100:]) == pytest.approx(1.0, abs=0.005)


@pytest.mark.parametrize("dead_zone", [1600, 1900])
@pytest.mark.parametrize("speed", [200, 1000])
def test_target_zero_brakes_a_healthy_wheel_and_holds_it(speed: int, dead_zone: int) -> None:
    rig = Rig(FlashContent(dead_zone=dead_zone))
    rig.go(speed)
    rig.run(1.5)
    rig.go(0)
    speeds = rig.run(2.0)
    assert all(abs(v) < 0.03 for v in speeds[60:])
    assert all(v == 0.0 for v in speeds[150:])


def test_a_dead_encoder_runs_away_and_target_zero_does_not_end_it() -> None:
    rig = Rig()
    rig.plant.motors[0].faults = FAULTS["encoder-dead"]
    rig.go(100)
    assert rig.run(3.0)[-1] > 1.1
    rig.go(0)
    assert rig.run(3.0)[-1] > 0.9


def test_a_reversed_encoder_runs_away() -> None:
    rig = Rig()
    rig.plant.motors[0].faults = FAULTS["encoder-reversed"]
    rig.go(100)
    assert rig.run(3.0)[-1] > 1.1
    rig.go(0)
    assert rig.run(1.0)[-1] > 1.1


@pytest.mark.parametrize("fault", ["encoder-dead", "encoder-reversed", "phases-swapped"])
def test_outputs_at_zero_stop_every_runaway(fault: str) -> None:
    rig = Rig()
    rig.plant.motors[0].faults = FAULTS[fault]
    rig.go(100)
    rig.run(3.0)
    rig.control.drive((0, 0, 0, 0))
    assert rig.run(2.0)[-1] == 0.0


@pytest.mark.parametrize("zero", ["lines", "ratio", "wheel_diameter_mm"])
def test_a_stored_zero_runs_away(zero: str) -> None:
    rig = Rig(FlashContent(**{zero: 0}))
    rig.go(100)
    rig.run(3.0)
    rig.go(0)
    assert rig.run(1.0)[-1] > 0.9


def test_a_type_that_does_not_fit_the_wiring_runs_away() -> None:
    rig = Rig(FlashContent(motor_type=2))
    rig.go(100)
    assert rig.run(3.0)[-1] > 1.1


def test_a_tt_motor_on_a_board_set_for_a_520_turns_backward_and_counts_forward() -> None:
    rig = Rig(wired_type=3)
    rig.go(300)
    assert rig.run(2.0)[-1] == pytest.approx(-0.3, abs=0.03)
    assert rig.control.totals[0] > 1000


@pytest.mark.parametrize("volts", [12.0, 8.0])
def test_the_plain_law_needs_more_than_600_ms_from_half_a_metre_a_second(volts: float) -> None:
    rig = Rig(gain=PLAIN_GAIN, rated_volts=12.0, battery_volts=volts)
    rig.go(500)
    rig.run(3.0)
    rig.go(0)
    speeds = rig.run(2.0)
    assert speeds[60] > 0.03
    assert speeds[-1] < 0.03


def test_a_held_wheel_winds_up_and_leaps_when_freed() -> None:
    rig = Rig()
    rig.plant.motors[0].faults = FAULTS["stalled"]
    rig.go(200)
    rig.run(3.0)
    rig.plant.motors[0].faults = HEALTHY
    assert max(rig.run(1.0)) > 0.3


BOARDS = {
    "four-channel, as sold": (tuning(FlashContent(dead_zone=1600), 1), 2000),
    "four-channel, a 520's dead zone": (tuning(FlashContent(dead_zone=1900), 1), 1700),
    "four-channel, no dead zone": (tuning(FlashContent(dead_zone=0), 1), 2000),
    "four-channel, tuned": (tuning(FlashContent(dead_zone=1900, p=0.3, i=0.12, d=0.0), 1), 1700),
    "rosmaster": (rosmaster(1), 2000),
    "rosmaster, sunrise": (rosmaster(6, p=1.5, i=0.08), 1600),
}
"""Speed loops, and the output that each adds to the dead zone at most."""


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("target", [10, 50, 100, 150, 300, -500, 1000])
def test_the_time_to_full_output_of_a_wheel_that_does_not_turn_is_as_the_formula_has_it(
    board: str, target: int
) -> None:
    law, most = BOARDS[board]
    loop = SpeedLoop(PLAIN_GAIN)
    loop.target_mm_s = target
    ticks = 1
    while abs(loop.next_output(0.0, law)) < law.dead_zone + most:
        ticks += 1
    # The sum of many steps may lack a unit of output.
    assert ticks / 100 == pytest.approx(wind_up_s(target, law), abs=0.0101)
    assert ticks / 100 == pytest.approx((most / abs(target) - law.p) / law.i / 100.0, abs=0.0201)


@pytest.mark.parametrize(
    ("row", "law"),
    [
        ("four-channel as sold", tuning(FlashContent(dead_zone=1600), 1)),
        ("four-channel, dead zone of a 520", tuning(FlashContent(dead_zone=1900), 1)),
        ("Rosmaster X3", rosmaster(1)),
        ("Rosmaster Sunrise", rosmaster(6, p=1.5, i=0.08)),
    ],
)
def test_the_page_has_the_times_of_the_formula(row: str, law: LoopSettings) -> None:
    page = (Path(__file__).parents[2] / "docs/protocol.md").read_text()
    line = next(line for line in page.splitlines() if line.startswith(f"| {row}"))
    times = [wind_up_s(speed, law) for speed in (20, 50, 100, 150, 300, 500, 1000)]
    assert line.endswith(f"| {' | '.join(map('{:.2f}'.format, times))} |")


def test_a_wheel_breaks_away_when_the_loop_has_wound_up_to_its_static_friction() -> None:
    rig = Rig(gain=PLAIN_GAIN, motor_dead_zone=1700, sticks=(1.2,))
    rig.go(50)
    due = round(wind_up_s(50, rig.tuning, 2041) * 100)
    speeds = rig.run(due / 100 + 0.02)
    assert max(speeds[:due]) == 0.0
    assert speeds[due] > 0.0


def test_the_default_robot_begins_late_and_unevenly() -> None:
    rig = Rig(drive="skid_steer")
    rig.control.regulate((50,) * 4)
    began_ms = [0] * 4
    for tick in range(60):
        rig.run(0.01)
        for index, motor in enumerate(rig.plant.motors):
            began_ms[index] = began_ms[index] or 10 * tick * (motor.speed_m_s > 0.0)
    assert 150 < min(began_ms) < max(began_ms) < 400
    assert len(set(began_ms)) == 4


def test_a_loop_without_integral_never_winds_up() -> None:
    assert wind_up_s(100, tuning(FlashContent(i=0.0), 1)) == math.inf
    assert wind_up_s(0, tuning(FlashContent(), 1)) == math.inf


def test_the_output_stays_while_the_error_stays_zero() -> None:
    loop, law = SpeedLoop(), tuning(FlashContent(), 1)
    loop.target_mm_s = 100
    for _ in range(50):
        output = loop.next_output(0.0, law)
    loop.target_mm_s = 0
    # Two ticks until the differences are gone.
    outputs = [loop.next_output(0.0, law) for _ in range(50)]
    assert 0 < outputs[2] <= output
    assert len(set(outputs[2:])) == 1


def test_outputs_never_leave_the_range() -> None:
    loop, law = SpeedLoop(), tuning(FlashContent(p=1e12, i=1e12), 1)
    for measured in (0.0, 1e9, -1e9, 0.0):
        assert abs(loop.next_output(measured, law)) <= PWM_MAX


def test_totals_wrap_at_32_bits() -> None:
    rig = Rig(totals=2**31 - 100)
    rig.go(500)
    rig.run(1.0)
    assert rig.control.totals[0] < -(2**31) + 10_000
    travelled = (rig.control.totals[0] - (2**31 - 100)) % 2**32
    assert travelled == rig.plant.ticks[0]


def test_a_restart_zeroes_the_counters_while_the_wheels_still_roll() -> None:
    rig = Rig()
    rig.go(500)
    rig.run(1.0)
    rig.control.restart()
    assert rig.control.totals == (0, 0, 0, 0)
    speeds = rig.run(2.0)
    assert speeds[0] > 0.3
    assert speeds[-1] == 0.0
    assert rig.control.totals[0] > 50
