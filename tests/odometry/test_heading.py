"""Wheels and gyro, step by step: the trust in each, and the reports."""

from __future__ import annotations

import math
from random import Random

import msgspec
import pytest

from yahboomd.core.drive.kinematics import KINEMATICS, unit_geometry
from yahboomd.core.model import Event, ImuReading, ImuSensor
from yahboomd.core.odometry.heading import CATCH_UP_RAD_S, PLAUSIBLE_RAD_S, Heading
from yahboomd.core.odometry.heading_filter import BIAS_RAD_S
from yahboomd.tools.schemas.event_kinds import KINDS

CYCLE_NS = 41_000_000
TICK = 1e-3
SENSOR = ImuSensor(
    name="any",
    gyro_limit_rad_s=8.0,
    gyro_noise_rad_s=1e-3,
    gyro_scale=0.0,
    acceleration_limit_m_s2=20.0,
    acceleration_noise_m_s2=0.01,
)
TURN_SLIP = {name: unit_geometry(name).turn_slip for name in KINEMATICS}
SLIPPING = [name for name, slip in TURN_SLIP.items() if slip]
COUNTERS = (
    "gyro_silent",
    "gyro_saturated",
    "gyro_implausible",
    "gyro_unchecked",
    "wheels_slipped",
)


class Base:
    """A base whose wheels count in ticks, with a gyro that is read between their readings."""

    def __init__(
        self,
        geometry: str = "differential",
        *,
        seed: int = 1,
        bias: float = 0.02,
        scale: float | None = 0.0,
        fused: bool = True,
    ) -> None:
        self.counters = dict.fromkeys(COUNTERS, 0)
        self.heading = Heading(
            TURN_SLIP[geometry],
            self.counters,
            tick_variance=TICK * TICK / 3.0,
            scale=scale,
            fused=fused,
        )
        self.random = Random(seed)
        self.bias = bias
        self.now_ns = 0
        self.truth = self.fused = self.counted = self.shown = 0.0
        self.kinds: list[str] = []
        self.events: list[Event] = []
        self.jumps: list[float] = []

    def step(self, wheels: float, gyro: float | None, *, truth: float | None = None) -> None:
        """One cycle: rates of turn by the wheels, by the gyro (None: silent), and the true one."""
        dt_s = CYCLE_NS * 1e-9
        if gyro is not None:
            measured = gyro + self.bias + self.random.gauss(0.0, 1e-3)
            self.heading.accept(
                ImuReading(
                    sensor=SENSOR,
                    sent_ns=self.now_ns + CYCLE_NS // 2,
                    gyro_rad_s=(0.0, 0.0, measured),
                    acceleration_m_s2=(0.0, 0.0, self.random.gauss(9.8, 0.01)),
                )
            )
        self.now_ns += CYCLE_NS
        self.counted += wheels * dt_s
        turn = round(self.counted / TICK) * TICK - self.shown
        self.shown += turn
        rolled = 1e-3 * (abs(wheels) + 0.3 * (wheels != 0.0)) * dt_s
        added = turn + self.heading.fuse(turn, rolled, self.now_ns, CYCLE_NS)
        self.fused += added
        self.jumps.append(abs(added))
        self.truth += (wheels if truth is None else truth) * dt_s
        self.kinds += [event.kind for event in self.heading.events]
        self.events += self.heading.events
        for event in self.heading.events:
            assert event.severity in KINDS[event.kind].severities
        self.heading.events.clear()

    def run(self, seconds: float, wheels: float, gyro: float | None, *, truth: float) -> None:
        for _ in range(round(seconds * 1e9 / CYCLE_NS)):
            self.step(wheels, gyro, truth=truth)

    @property
    def off(self) -> float:
        return self.fused - self.truth


@pytest.fixture
def base() -> Base:
    made = Base()
    made.run(10.0, 0.0, 0.0, truth=0.0)
    return made


def test_the_bias_is_learned_at_rest_while_the_heading_stays(base: Base) -> None:
    assert base.heading.bias_rad_s == pytest.approx(base.bias, abs=1e-3)
    assert base.fused == 0.0


def test_while_wheels_do_not_slip_the_heading_is_theirs(base: Base) -> None:
    for rate in (0.5, -0.8, 0.0, 1.5):
        base.run(10.0, rate, rate, truth=rate)
    # A tick, and what two samplings of a turn that changes at once leave.
    assert base.off == pytest.approx(0.0, abs=2e-3)
    assert base.kinds == []


@pytest.mark.parametrize("geometry", ["differential", "skid_steer"])
def test_wheels_that_slip_lose_the_heading_to_the_gyro(geometry: str) -> None:
    base = Base(geometry)
    base.run(10.0, 0.0, 0.0, truth=0.0)
    base.run(5.0, 1.0, 0.8, truth=0.8)
    assert base.off == pytest.approx(0.0, abs=0.02)
    assert base.counted - base.truth == pytest.approx(1.0, abs=0.01)


def test_a_slip_is_said_once_and_counted_and_the_variance_shows_it(base: Base) -> None:
    before = base.heading.variance
    base.run(3.1, 1.0, 0.0, truth=0.0)
    assert base.kinds == ["wheels_slip"]
    assert base.counters["wheels_slipped"] == 3
    assert base.heading.variance > 100.0 * before
    base.run(2.1, 0.0, 0.0, truth=0.0)
    base.run(2.1, 1.0, 0.0, truth=0.0)
    assert base.kinds == ["wheels_slip"] * 2
    for event in base.events:
        assert event.data is not None
        assert event.data == {name: round(value, 4) for name, value in event.data.items()}
        assert event.data["over_s"] == 1.025


def test_a_skid_steer_base_that_turns_as_it_does_is_not_said_to_slip() -> None:
    base = Base("skid_steer")
    base.run(10.0, 0.0, 0.0, truth=0.0)
    for turn in (0.8, 1.2, 1.0):
        base.run(5.0, 1.0, turn, truth=turn)
    assert base.kinds == []


def test_a_robot_that_is_turned_by_hand_has_turned(base: Base) -> None:
    base.run(2.0, 0.0, 1.0, truth=1.0)
    assert base.off == pytest.approx(0.0, abs=0.03)
    assert base.kinds == ["wheels_slip"]


@pytest.mark.parametrize(
    ("gyro", "problem"), [(None, "gyro_silent"), (9.0, "gyro_saturated"), (-9.0, "gyro_saturated")]
)
def test_a_gyro_that_fails_leaves_the_heading_to_the_wheels_without_a_jump(
    base: Base, gyro: float | None, problem: str
) -> None:
    base.run(3.0, 1.0, 0.8, truth=0.8)
    base.jumps.clear()
    off = base.off
    base.run(3.0, 0.6, gyro, truth=0.6)
    assert base.counters[problem] == 1
    assert base.kinds[-1] == "gyro_unfit"
    # Never more than a cycle's turn at the faster rate.
    assert max(base.jumps) < 1.1 * 1.0 * CYCLE_NS * 1e-9
    assert base.off == pytest.approx(off, abs=0.05)
    base.run(3.0, 0.6, 0.6, truth=0.6)
    assert base.kinds[-1] == "gyro_fit"
    assert base.off == pytest.approx(off, abs=0.05)
    assert max(base.jumps) < 0.06


def test_a_stuck_gyro_is_implausible(base: Base) -> None:
    stuck = ImuReading(
        sensor=SENSOR,
        sent_ns=0,
        gyro_rad_s=(0.0, 0.0, 0.3),
        acceleration_m_s2=(0.0, 0.0, 9.8),
    )
    for _ in range(100):
        base.now_ns += CYCLE_NS
        base.heading.accept(
            ImuReading(
                sensor=SENSOR,
                sent_ns=base.now_ns,
                gyro_rad_s=stuck.gyro_rad_s,
                acceleration_m_s2=stuck.acceleration_m_s2,
            )
        )
        base.heading.fuse(0.0, 0.0, base.now_ns, CYCLE_NS)
    assert base.counters["gyro_implausible"] == 1


def test_a_gyro_that_turns_against_the_wheels_is_not_believed_until_it_turns_with_them(
    base: Base,
) -> None:
    base.run(5.0, 1.0, -1.0, truth=1.0)
    assert base.counters["gyro_implausible"] == 1
    assert base.kinds.count("gyro_unfit") == 1
    # It takes a second to notice, and the wheels have the heading from then on.
    off = base.off
    base.run(5.0, 1.0, -1.0, truth=1.0)
    assert base.off == pytest.approx(off, abs=2e-3)
    base.run(5.0, 1.0, 1.0, truth=1.0)
    assert base.kinds[-1] == "gyro_fit"


def test_the_rate_is_weighted_by_certainty(base: Base) -> None:
    base.run(2.0, 0.5, 0.5, truth=0.5)
    gyro_variance = 1e-6 + 1e-6
    sure, unsure = (base.heading.rate(1.0, variance) for variance in (1e-9, 1.0))
    assert sure[0] == pytest.approx(1.0, abs=0.01)
    assert unsure == (pytest.approx(0.5, abs=0.01), pytest.approx(gyro_variance, rel=1.0))
    gyro = base.heading.rate(0.0, 1e9)
    assert base.heading.rate(1.0, gyro[1]) == pytest.approx(((1.0 + gyro[0]) / 2, gyro[1] / 2))
    for variance in (1e-9, 1e-5, 1.0):
        assert base.heading.rate(1.0, variance)[1] < variance
    base.run(1.0, 0.5, None, truth=0.5)
    assert base.heading.rate(1.0, 0.25) == (1.0, 0.25)


def test_after_a_reset_both_agree() -> None:
    base = Base("skid_steer")
    base.run(10.0, 0.0, 0.0, truth=0.0)
    base.run(3.0, 1.0, 0.8, truth=0.8)
    assert abs(base.heading.error) > 0.5
    base.heading.reset()
    assert (base.heading.error, base.heading.variance) == (0.0, 0.0)


def test_what_neither_saw_makes_it_less_sure(base: Base) -> None:
    before = base.heading.variance
    base.heading.lose(0.25)
    # A board that restarted has another zero.
    assert base.heading.bias_variance == BIAS_RAD_S**2
    assert base.heading.variance == pytest.approx(before + 0.25)


@pytest.mark.parametrize("geometry", SLIPPING)
def test_the_variance_covers_what_a_floor_does_to_turns(geometry: str) -> None:
    base = Base(geometry)
    base.run(2.0, 0.0, 0.0, truth=0.0)
    base.run(2.5, 0.8, None, truth=0.8)
    least = TURN_SLIP[geometry] * 2.0
    assert math.sqrt(base.heading.variance) > 0.95 * math.sqrt(least)


@pytest.mark.parametrize("rate", [0.1, 0.25])
def test_a_gyro_against_the_wheels_is_noticed_in_a_slow_turn_too(base: Base, rate: float) -> None:
    base.run(10.0, rate, -rate, truth=rate)
    assert base.kinds[-1] == "gyro_unfit"
    assert base.counters["gyro_implausible"] == 1
    off = base.off
    base.run(10.0, rate, -rate, truth=rate)
    assert base.off == pytest.approx(off, abs=0.01)


@pytest.mark.parametrize("jump", [0.1, -0.3])
def test_a_bias_that_jumped_turns_a_standing_robot_for_seconds_and_no_longer(
    base: Base, jump: float
) -> None:
    base.bias += jump
    base.run(7.0, 0.0, 0.0, truth=0.0)
    assert base.kinds[-1] == "gyro_unfit"
    off = base.off
    assert abs(off) < 2.0 * math.sqrt(base.heading.variance)
    base.run(60.0, 0.0, 0.0, truth=0.0)
    assert base.off == off
    # Once the wheels roll, it is learned.
    base.run(4.0, 0.5, 0.5, truth=0.5)
    assert base.kinds[-1] == "gyro_fit"
    assert base.heading.bias_rad_s == pytest.approx(base.bias, abs=5e-3)
    base.run(8.0, 0.0, 0.0, truth=0.0)
    assert base.heading.bias_rad_s == pytest.approx(base.bias, abs=1e-3)
    assert base.kinds[-1] == "gyro_fit"


@pytest.mark.parametrize("rate", [0.01, 0.05, 0.2, -0.3])
def test_an_even_turn_that_may_be_a_bias_is_covered_by_the_variance_at_each_moment(
    base: Base, rate: float
) -> None:
    for _ in range(60):
        base.run(0.5, 0.0, rate, truth=rate)
        assert abs(base.off) < 2.0 * math.sqrt(base.heading.variance)
    assert abs(base.off) > 0.8 * 27.0 * abs(rate)
    # It ends: it was no bias, and none was learned.
    base.run(7.0, 0.0, 0.0, truth=0.0)
    assert base.kinds[-1] == "gyro_fit"
    assert base.heading.bias_rad_s == pytest.approx(base.bias, abs=1e-3)
    before = base.heading.variance
    base.run(5.0, 0.0, 0.0, truth=0.0)
    assert base.heading.variance == pytest.approx(before, rel=1e-3)


def test_an_even_turn_that_may_be_a_bias_makes_the_heading_unsure_from_its_fifth_sample_on(
    base: Base,
) -> None:
    unsure = []
    for samples in range(1, 7):
        base.step(0.0, 0.2, truth=0.2)
        unsure.append(math.sqrt(base.heading.variance) > 0.9 * 0.2 * samples * CYCLE_NS * 1e-9)
    assert unsure == [False] * 4 + [True] * 2


@pytest.mark.parametrize("rate", [0.5, -1.0])
def test_an_even_turn_faster_than_any_bias_is_a_turn_however_long_it_is(
    base: Base, rate: float
) -> None:
    base.run(30.0, 0.0, rate, truth=rate)
    assert abs(base.off) < 2.0 * math.sqrt(base.heading.variance)
    assert base.off == pytest.approx(0.0, abs=0.08)
    assert base.heading.bias_rad_s == pytest.approx(base.bias, abs=2e-3)
    assert "gyro_unfit" not in base.kinds


def test_a_gyro_whose_zero_was_taken_in_a_turn_is_not_used_and_no_such_bias_is_learned() -> None:
    base = Base(bias=0.6)
    base.run(10.0, 0.0, 0.0, truth=0.0)
    assert base.kinds == ["wheels_slip", "gyro_unfit"]
    off = base.off
    base.run(20.0, 0.0, 0.0, truth=0.0)
    base.run(5.0, 0.5, 0.5, truth=0.5)
    assert base.off == pytest.approx(off, abs=2e-3)
    assert abs(base.heading.bias_rad_s) < PLAUSIBLE_RAD_S
    assert abs(base.off) < 2.0 * math.sqrt(base.heading.variance)


def test_after_a_restart_of_the_board_another_zero_is_no_turn(base: Base) -> None:
    base.heading.lose(0.0)
    base.bias = -0.2
    base.run(7.0, 0.0, 0.0, truth=0.0)
    assert base.heading.bias_rad_s == pytest.approx(-0.2, abs=2e-3)
    assert "gyro_unfit" not in base.kinds


def test_a_turn_by_hand_at_the_start_is_no_bias_once_the_robot_stands() -> None:
    base = Base()
    base.run(2.0, 0.0, 0.4, truth=0.4)
    base.run(7.0, 0.0, 0.0, truth=0.0)
    assert base.heading.bias_rad_s == pytest.approx(base.bias, abs=2e-3)
    off = base.off
    base.run(60.0, 0.0, 0.0, truth=0.0)
    assert base.off == pytest.approx(off, abs=0.01)


def test_a_hand_that_turns_the_robot_unevenly_changes_no_bias(base: Base) -> None:
    for step in range(200):
        rate = 1.0 + 0.1 * math.sin(step / 7.0)
        base.step(0.0, rate, truth=rate)
    assert base.off == pytest.approx(0.0, abs=0.05)
    assert "gyro_unfit" not in base.kinds


def test_wheels_and_gyro_that_are_read_milliseconds_apart_do_not_differ_in_a_fast_turn(
    base: Base,
) -> None:
    for step in range(250):
        base.step(5.5 if step % 2 else 4.5, 5.0, truth=5.0)
    assert base.off == pytest.approx(0.0, abs=1e-3)


def test_however_long_wheels_rolled_their_first_slip_is_noticed_in_a_third_of_a_second(
    base: Base,
) -> None:
    base.run(20.0, 1.0, 1.0, truth=1.0)
    for _ in range(7):
        base.step(1.0, 0.9, truth=0.9)
    assert base.heading.error == pytest.approx(0.1 * 7 * CYCLE_NS * 1e-9, abs=5e-3)


@pytest.mark.parametrize(("unsteady", "learned"), [(0.004, True), (0.006, False)])
def test_only_a_rate_as_even_as_the_sensors_noise_is_a_bias(
    base: Base, unsteady: float, learned: bool
) -> None:
    for step in range(200):
        rate = 0.2 + (unsteady if step % 2 else -unsteady)
        base.step(0.0, rate, truth=0.0)
    assert ("gyro_unfit" in base.kinds) is learned


def test_a_tick_that_comes_and_goes_is_no_turn_that_slips() -> None:
    base = Base("skid_steer")
    before = base.heading.variance
    for step in range(200):
        base.heading.fuse(TICK if step % 2 else -TICK, 0.0, step * CYCLE_NS, CYCLE_NS)
    # The play is taken up at most once.
    assert base.heading.variance - before <= TURN_SLIP["skid_steer"] * TICK


def test_a_bias_that_may_have_been_a_turn_is_as_unsure_as_both_are_apart(base: Base) -> None:
    base.bias += 0.1
    base.run(8.0, 0.0, 0.0, truth=0.0)
    unsure = base.heading.variance
    base.run(2.0, 0.0, 0.0, truth=0.0)
    assert math.sqrt(base.heading.variance) == pytest.approx(math.sqrt(unsure) + 0.2, rel=0.2)
    # The first count ends it.
    base.step(0.05, 0.05)
    assert base.heading.bias_variance == pytest.approx(0.1**2, rel=0.2)


def test_a_bias_that_was_learned_is_no_slip() -> None:
    base = Base(bias=0.06)
    base.run(20.0, 0.0, 0.0, truth=0.0)
    assert base.kinds == []


def test_short_turns_add_up_whichever_way_they_go(base: Base) -> None:
    for way in (1.0, -1.0, 1.0, -1.0):
        base.run(1.0, 0.2 * way, -0.2 * way, truth=0.2 * way)
        base.run(2.1, 0.0, 0.0, truth=0.0)
    assert base.kinds[-1] == "gyro_unfit"


@pytest.mark.parametrize("rate", [0.01, 0.03])
def test_the_slowest_turns_show_the_sign_too(base: Base, rate: float) -> None:
    base.run(0.7 / rate, rate, -rate, truth=rate)
    assert base.kinds[-1] == "gyro_unfit"


def test_wheels_that_slip_in_a_turn_of_a_second_make_no_gyro_one_of_the_wrong_sign(
    base: Base,
) -> None:
    base.run(4.0, 0.3, -0.05, truth=-0.05)
    base.run(4.0, 0.3, 0.05, truth=0.05)
    base.run(1.1, 0.3, -0.9, truth=-0.9)
    assert "gyro_unfit" not in base.kinds


def test_a_gyro_that_once_turned_with_the_wheels_keeps_its_sign_whatever_slips(base: Base) -> None:
    base.run(2.0, 0.5, 0.5, truth=0.5)
    base.run(5.0, 0.5, -0.5, truth=-0.5)
    assert "gyro_unfit" not in base.kinds
    assert base.off == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("rate", [0.1, 1.0])
def test_a_gyro_of_the_wrong_sign_costs_nothing_that_the_variance_does_not_have(
    base: Base, rate: float
) -> None:
    base.heading.reset()
    for _ in range(200):
        base.step(rate, -rate, truth=rate)
        # Within the second that shows the sign, at most what it added in this step is missing.
        assert abs(base.off) < 1.1 * math.sqrt(base.heading.variance) + 0.1
    assert base.kinds[-1] == "gyro_unfit"
    assert abs(base.off) > 0.5
    assert abs(base.off) == pytest.approx(math.sqrt(base.heading.variance), rel=0.1)
    # It went wrong step by step, and never back at once.
    most = 2.0 * rate + CATCH_UP_RAD_S + 3e-3
    assert max(base.jumps) < most * CYCLE_NS * 1e-9 + TICK


def test_a_gyro_that_is_stuck_makes_unsure_what_it_added(base: Base) -> None:
    base.run(4.0, 0.5, 0.5, truth=0.5)
    for _ in range(60):
        # The same sample again and again, while the base turns on the spot.
        base.random = Random(7)
        base.step(0.5, 0.1, truth=0.5)
    assert "gyro_unfit" in base.kinds
    assert 0.5 < abs(base.off) < 2.0 * math.sqrt(base.heading.variance)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_gyro_whose_sign_was_not_checked_is_not_added_until_a_clear_turn_shows_it(
    sign: float,
) -> None:
    base = Base(scale=None)
    base.run(5.0, 0.0, 0.0, truth=0.0)
    assert (base.kinds, base.counters["gyro_unchecked"]) == (["gyro_unfit"], 1)
    assert base.events[0].data == {"problem": "unchecked"}
    assert "calibrate imu" in base.events[0].message
    # Even its bias is learned meanwhile.
    assert base.heading.bias_rad_s == pytest.approx(base.bias, abs=1e-3)
    base.run(2.0, 0.0, 0.5 * sign, truth=0.0)
    assert base.fused == 0.0
    base.run(0.9, 0.5, 0.5 * sign, truth=0.5)
    assert base.off == pytest.approx(0.0, abs=2e-3)
    base.run(4.0, 0.5, 0.5 * sign, truth=0.5)
    assert base.kinds[-1] == ("gyro_fit" if sign > 0.0 else "gyro_unfit")
    assert base.counters["gyro_implausible"] == (0 if sign > 0.0 else 1)
    # From then on it is added, or never.
    off = base.off
    base.run(2.0, 0.0, 0.5 * sign + 0.1 * math.sin(len(base.jumps)), truth=0.0)
    turned = base.off - off
    assert turned > 0.7 if sign > 0.0 else turned == 0.0


def test_a_heading_that_is_the_wheels_reports_no_gyro_that_was_not_checked() -> None:
    base = Base(scale=None, fused=False)
    base.run(5.0, 0.0, 0.0, truth=0.0)
    assert (base.kinds, base.counters["gyro_unchecked"]) == ([], 0)


def test_wheels_that_slip_beside_a_gyro_that_was_not_checked_are_unsure() -> None:
    base = Base(scale=None)
    base.run(10.0, 0.0, 0.0, truth=0.0)
    base.run(5.0, 0.05, 0.4, truth=0.4)
    assert base.off == pytest.approx(-1.75, abs=0.05)
    assert abs(base.off) < 1.3 * math.sqrt(base.heading.variance)


def test_a_base_that_shakes_faster_than_the_samples_keeps_the_heading_of_its_wheels() -> None:
    for seed in range(5):
        base = Base(seed=seed)
        base.run(10.0, 0.0, 0.0, truth=0.0)
        for step in range(1500):
            rate = (0.4, 0.0, -0.4, 0.2)[step // 50 % 4]
            base.step(rate, rate + base.random.gauss(0.0, 0.08), truth=rate)
        assert base.off == pytest.approx(0.0, abs=3e-3)
        # It gives up no more than what it measured: a slip shows as well.
        base.run(20.0, 0.5, 0.3, truth=0.3)
        assert base.off == pytest.approx(0.0, abs=0.15)


def test_a_slip_of_half_a_hundredth_is_noticed_in_time(base: Base) -> None:
    base.run(20.0, 1.0, 1.0, truth=1.0)
    base.run(20.0, 1.0, 0.995, truth=0.995)
    assert base.off == pytest.approx(0.0, abs=0.02)


def test_a_scale_makes_a_turn_unsure_by_its_share_of_it() -> None:
    base = Base("skid_steer", scale=0.1)
    base.run(20.0, 0.0, 0.0, truth=0.0)
    base.run(5.0, 1.0, 0.8, truth=0.8)
    assert base.heading.variance == pytest.approx((0.1 * 4.0) ** 2, rel=0.05)


def test_what_turns_beyond_the_play_of_the_ticks_may_slip() -> None:
    heading = Heading(TURN_SLIP["skid_steer"], {}, tick_variance=TICK * TICK / 3.0)
    play = 1.5 * math.sqrt(2.0) * TICK
    heading.fuse(20.0 * TICK, 0.0, CYCLE_NS, CYCLE_NS)
    slipped = TURN_SLIP["skid_steer"] * (20.0 * TICK - play)
    assert heading.variance == pytest.approx(slipped)
    heading.fuse(-20.0 * TICK, 0.0, 2 * CYCLE_NS, CYCLE_NS)
    assert heading.variance == pytest.approx(
        slipped + TURN_SLIP["skid_steer"] * (20.0 * TICK - 2.0 * play)
    )


def test_a_sample_is_as_old_as_its_sensor_delays_it() -> None:
    turned = []
    for delay_ns in (0, 8_000_000):
        heading = Heading(
            TURN_SLIP["skid_steer"], dict.fromkeys(COUNTERS, 0), tick_variance=1e-6, scale=0.0
        )
        for number in range(1, 50):
            rate = math.sin(0.3 * number)
            heading.accept(
                ImuReading(
                    sensor=msgspec.structs.replace(SENSOR, delay_ns=delay_ns),
                    sent_ns=number * CYCLE_NS + delay_ns,
                    gyro_rad_s=(0.0, 0.0, rate),
                    acceleration_m_s2=(0.0, 0.0, 9.8),
                )
            )
            heading.fuse(0.0, 0.0, number * CYCLE_NS, CYCLE_NS)
        turned.append(heading.error)
    assert turned[0] == turned[1] != 0.0


def test_a_slip_shows_after_a_second_and_a_bias_after_three() -> None:
    """To the step: here eight are a second."""
    heading = Heading(0.0, dict.fromkeys(COUNTERS, 0), tick_variance=1e-6, scale=0.0)
    step_ns, began = 125_000_000, {}
    for number in range(1, 60):
        rate = 0.0 if number < 24 else 0.3
        heading.accept(
            ImuReading(
                sensor=SENSOR,
                sent_ns=number * step_ns,
                gyro_rad_s=(0.0, 0.0, rate),
                acceleration_m_s2=(0.0, 0.0, 9.8 + 0.001 * number),
            )
        )
        # The wheels move once, so the rest begins again.
        heading.fuse(1e-3 if number == 24 else 0.0, 0.0, number * step_ns, step_ns)
        for event in heading.events:
            began.setdefault(event.kind, number)
        heading.events.clear()
    assert began == {"wheels_slip": 33, "gyro_unfit": 48}


def test_a_slip_is_published_to_the_tenth_of_a_milliradian() -> None:
    heading = Heading(0.0, dict.fromkeys(COUNTERS, 0), tick_variance=1e-6, scale=0.0)
    step_ns = 123_456_789
    for number in range(1, 29):
        heading.accept(
            ImuReading(
                sensor=SENSOR,
                sent_ns=number * step_ns,
                gyro_rad_s=(0.0, 0.0, 0.0),
                acceleration_m_s2=(0.0, 0.0, 9.8),
            )
        )
        heading.fuse(0.0323456 if number >= 20 else 0.0, 0.0, number * step_ns, step_ns)
    (slip,) = heading.events
    assert slip.data == {"wheels_rad": 0.2911, "gyro_rad": 0.0, "over_s": 1.111}
