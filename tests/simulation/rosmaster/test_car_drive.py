from __future__ import annotations

from random import Random

import pytest

from yahboomd.simulation.options import PLAIN_GAIN, SimulationOptions
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.rosmaster.car_drive import BRAKED, CarDrive
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.speed_loop import MotorControl


class Bench:
    """The drive of a car, and what becomes of its motors."""

    def __init__(self, car_type: int, drive: str = "mecanum") -> None:
        options = SimulationOptions(dialect="rosmaster", drive=drive, wheel_base_m=0.23)
        self.plant = Plant(options, Random(1))
        self.plant.start(0)
        self.control = MotorControl(self.plant, gain=PLAIN_GAIN)
        self.drive = CarDrive(self.plant, self.control, RosmasterStored(car_type=car_type))

    @property
    def targets(self) -> list[int] | None:
        """The speeds that the loops want; None where they do not run."""
        loops = [loop.target_mm_s for loop in self.control._loops]
        return loops if self.control.regulates else None

    @property
    def outputs(self) -> list[int]:
        return [motor.pwm for motor in self.plant.motors]


@pytest.mark.parametrize("car_type", range(7))
def test_zeros_brake_whatever_car_it_is(car_type: int) -> None:
    bench = Bench(car_type)
    bench.drive.set_outputs(bytes((50, 50, 50, 50)))
    bench.drive.move(0, 0, 0)
    assert bench.outputs == [BRAKED] * 4
    assert bench.targets is None


@pytest.mark.parametrize("car_type", [0, 3])
def test_a_type_that_it_does_not_drive_obeys_outputs_and_zeros_alone(car_type: int) -> None:
    bench = Bench(car_type)
    bench.drive.set_outputs(bytes((50, 0, 0, 206)))
    before = bench.outputs
    assert before == [2600, 0, 0, -2600]
    bench.drive.move(300, 0, 0)
    bench.drive.run(0, 0)
    bench.drive.run(7, 0)
    assert bench.outputs == before
    assert bench.targets is None


def test_an_x3_plus_limits_the_velocity_before_its_wheels() -> None:
    bench = Bench(2)
    bench.drive.move(1000, 1000, 0)
    assert bench.targets == [0, 700, 700, 0]


def test_an_x1_that_is_to_go_aside_alone_brakes() -> None:
    bench = Bench(4)
    bench.drive.move(300, 0, 0)
    bench.drive.move(0, 300, 0)
    assert bench.targets is None
    assert bench.outputs == [BRAKED] * 4


def test_a_sunrise_has_a_larger_dead_zone_and_less_above_it() -> None:
    bench = Bench(6)
    bench.drive.set_outputs(bytes((1, 50, 100, 156)))
    assert bench.outputs == [2016, 2800, 3600, -3600]
    assert bench.drive.tuning.most_output == 1600


@pytest.mark.parametrize(
    ("state", "speed", "targets"),
    [
        (1, 30, [300, 300, 300, 300]),
        (2, 30, [-300, -300, -300, -300]),
        (3, 30, [-300, 300, 300, -300]),
        (5, 20, [-164, -164, 164, 164]),
        (0, 1, None),
        (8, 30, None),
        # 16 bits: 65,540 tenths are 4.
        (1, 6554, [4, 4, 4, 4]),
    ],
)
def test_function_11_has_eight_states_and_takes_10_mm_s(
    state: int, speed: int, targets: list[int] | None
) -> None:
    bench = Bench(1)
    bench.drive.run(state, speed)
    assert bench.targets == targets


def test_a_car_keeps_its_angle_in_states_and_takes_it_as_vy_else() -> None:
    bench = Bench(5, "ackermann")
    bench.drive.move(500, 20, 0)
    assert bench.drive.steering_deg == 20
    bench.drive.run(2, 40)
    assert bench.drive.steering_deg == 20
    assert bench.targets is not None
    assert bench.targets[1] > -400 > bench.targets[3]
    bench.drive.move(0, -60, 0)
    assert (bench.drive.steering_deg, bench.targets) == (-45, None)
    bench.drive.run(7, 0)
    assert bench.drive.steering_deg == 0


def test_function_31_steers_alone_or_with_the_rear_wheels() -> None:
    bench = Bench(5, "ackermann")
    bench.drive.move(400, 10, 0)
    before = bench.targets
    bench.drive.steer(30)
    assert bench.targets == before
    bench.drive.steer_with_wheels(30)
    assert bench.targets is not None
    assert bench.targets[1] < before[1]
    assert bench.targets[3] > before[3]


def test_another_centre_moves_the_front_wheels_of_a_car_that_was_straight() -> None:
    bench = Bench(5, "ackermann")
    bench.drive.set_centre(80)
    bench.plant.advance(200_000_000)
    assert bench.plant._steered_deg == pytest.approx(10.0)
    bench.drive.turn_servo(200)
    bench.plant.advance(400_000_000)
    assert bench.plant._steered_deg == pytest.approx(10.0)


def test_the_counts_of_a_type_that_is_wired_otherwise_are_turned_round() -> None:
    drive = Bench(1).drive
    assert not drive.tuning.counts_inverted
    drive.set_type(6)
    assert drive.tuning.counts_inverted
    other = Bench(6).drive
    assert not other.tuning.counts_inverted
    other.set_type(4)
    assert other.tuning.counts_inverted
