"""One motor, by the readings that the check of all of them lets through."""

from __future__ import annotations

import math
from collections import deque

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sticking_base import believing, follower

from yahboomd.core.drive.faults import Fault
from yahboomd.core.drive.follow_check import FollowCheck
from yahboomd.core.drive.limiter import AxisCaps, Limiter
from yahboomd.core.drive.loop_law import LoopLaw
from yahboomd.core.drive.wheel_follower import Step, WheelFollower
from yahboomd.core.model import Twist2d

MS = 1_000_000
S = 1000 * MS
METRES_PER_TICK = 2 * math.pi * 0.0335 / 1320
SUBSTEP_NS = 5 * MS
AGAINST = "runaway_against"


def read(
    wheel: WheelFollower,
    before_ns: int,
    now_ns: int,
    speed: float,
    ticks: int,
    *,
    held_up: bool = False,
) -> list[Fault]:
    """A reading of a wheel that has the gains as sold, and is alone."""
    step = Step(before_ns=before_ns, now_ns=now_ns)
    return wheel.measure(step, speed, ticks, speed, held_up=held_up)


class WheelModel:
    """A motor under its own speed loop: late, lagging, slow to start; or broken in some way."""

    def __init__(
        self,
        *,
        lag_s: float = 0.1,
        delay_s: float = 0.02,
        start_s: float = 0.02,
        broken: str | None = None,
        broken_from_ns: int = 0,
    ) -> None:
        self._lag_s = lag_s
        self._start_s = start_s
        self._pending = deque([0.0] * max(1, round(delay_s * S / SUBSTEP_NS)))
        self._broken = broken
        self._broken_from_ns = broken_from_ns
        self._stuck_s = 0.0
        self.speed = 0.0
        self.travel = 0.0
        self._counted = 0

    def run(self, now_ns: int, command: float) -> None:
        self._pending.append(command)
        wanted = self._pending.popleft()
        dt_s = SUBSTEP_NS / S
        broken = self._broken if now_ns >= self._broken_from_ns else None
        if broken == "runaway":
            self.speed += (1.2 - self.speed) * dt_s / 0.1
        elif broken == "backward":
            self.speed += (-1.2 - self.speed) * dt_s / 0.1
        elif broken == "blocked":
            self.speed = 0.0
        elif self.speed == 0.0 and wanted != 0.0 and self._stuck_s < self._start_s:
            # It starts when the loop has wound up beyond the dead zone.
            self._stuck_s += dt_s
        else:
            self.speed += (wanted - self.speed) * dt_s / self._lag_s
            if wanted == 0.0 and abs(self.speed) < 0.002:
                self.speed = 0.0
                self._stuck_s = 0.0
        if broken != "no_encoder":
            self.travel += self.speed * dt_s

    def read(self) -> int:
        before, self._counted = self._counted, math.floor(self.travel / METRES_PER_TICK)
        return self._counted - before


def drive(
    model: WheelModel,
    commands: list[tuple[int, float | None]],
    *,
    until_ns: int,
    period_ns: int = 20 * MS,
    min_speed_m_s: float = 0.08,
) -> list[tuple[int, Fault]]:
    """Run a wheel by a list of (time, speed; ``None``: let go), and return its faults."""
    check = believing(["left"], min_speed_m_s=min_speed_m_s)
    schedule = deque(commands)
    command: float | None = 0.0
    check.command(0, [0.0])
    found: list[tuple[int, Fault]] = []
    for now_ns in range(0, until_ns, SUBSTEP_NS):
        while schedule and schedule[0][0] <= now_ns:
            command = schedule.popleft()[1]
            check.command(now_ns, None if command is None else [command])
        model.run(now_ns, command or 0.0)
        if now_ns % period_ns == 0:
            ticks = model.read()
            speed = ticks * METRES_PER_TICK / (period_ns / S)
            found += [(now_ns, fault) for fault in check.measure(now_ns, [speed], [ticks])]
    return found


def ramped(wishes: list[tuple[int, float]], until_ns: int) -> list[tuple[int, float | None]]:
    """The wishes as the limiter passes them, at 50 Hz."""
    limiter = Limiter(AxisCaps(velocity=1.0, acceleration=2.5, deceleration=5.0), AxisCaps())
    schedule, wish = deque(wishes), 0.0
    commands: list[tuple[int, float | None]] = []
    for now_ns in range(0, until_ns, 20 * MS):
        while schedule and schedule[0][0] <= now_ns:
            wish = schedule.popleft()[1]
        commands.append((now_ns, limiter.limit(Twist2d(vx=wish), 0.02).vx))
    return commands


WISHES = st.lists(
    st.tuples(
        st.integers(20 * MS, 600 * MS), st.sampled_from([0.0, 0.0, 0.05]) | st.floats(-1.0, 1.0)
    ),
    min_size=1,
    max_size=4,
)


@given(
    WISHES,
    st.floats(0.02, 0.35),
    st.floats(0.004, 0.05),
    st.sampled_from([10 * MS, 20 * MS, 50 * MS]),
    st.booleans(),
)
def test_healthy_motors_raise_no_alarm(
    wishes: list[tuple[int, float]], lag_s: float, delay_s: float, period_ns: int, ramp: bool
) -> None:
    now_ns, timed = 0, []
    for pause_ns, wish in wishes:
        now_ns += pause_ns
        timed.append((now_ns, wish))
    until_ns = now_ns + 800 * MS
    commands = ramped(timed, until_ns) if ramp else list(timed)
    found = drive(
        WheelModel(lag_s=lag_s, delay_s=delay_s),
        commands,
        until_ns=until_ns,
        period_ns=period_ns,
    )
    assert found == []


@pytest.mark.parametrize("speed", [0.05, 0.08, 0.1, 0.2, 0.5, 1.0])
def test_a_motor_that_takes_long_to_start_raises_no_alarm(speed: float) -> None:
    # The loop winds up with the command: 0.4 s at the slowest that counts, less above.
    model = WheelModel(start_s=min(0.4, 0.03 / speed, 0.15 if speed > 0.2 else 1.0))
    assert drive(model, [(100 * MS, speed)], until_ns=3 * S) == []


@pytest.mark.parametrize("period_ns", [5 * MS, 10 * MS, 20 * MS, 50 * MS])
@pytest.mark.parametrize("speed", [0.1, 0.3, 0.6])
def test_a_wheel_that_runs_away_is_cut_within_150_ms(period_ns: int, speed: float) -> None:
    begins_ns = 2 * S
    model = WheelModel(broken="runaway", broken_from_ns=begins_ns)
    found = drive(model, [(0, speed)], until_ns=3 * S, period_ns=period_ns)
    limit = 1.5 * speed + 0.1
    # When it passes the limit: from `speed` towards 1.2 m/s with a lag of 0.1 s.
    passes_ns = begins_ns + round(0.1 * math.log((1.2 - speed) / (1.2 - limit)) * S)
    assert [(fault.kind, fault.action) for _, fault in found] == [("runaway_fast", "cut")]
    assert passes_ns <= found[0][0] <= passes_ns + 150 * MS


def test_a_wheel_that_turns_against_a_steady_command_is_cut_within_150_ms() -> None:
    begins_ns = 2 * S
    model = WheelModel(broken="backward", broken_from_ns=begins_ns)
    found = drive(model, [(0, 0.4)], until_ns=3 * S)
    crosses_ns = begins_ns + round(0.1 * math.log(1.6 / 1.2) * S)
    assert found[0][1].kind == "runaway_against"
    assert found[0][1].action == "cut"
    assert crosses_ns <= found[0][0] <= crosses_ns + 150 * MS


@pytest.mark.parametrize("lag_s", [0.6, 0.7])
def test_a_wheel_that_still_rolls_the_old_way_and_slows_down_is_not_accused(lag_s: float) -> None:
    model = WheelModel(lag_s=lag_s, delay_s=0.1)
    commands: list[tuple[int, float | None]] = [(0, 0.8), (3 * S, -0.8), (6 * S, 0.0)]
    assert not drive(model, commands, until_ns=7 * S)


@pytest.mark.parametrize(("falls", "cut_s"), [(0.0, 0.2), (0.7, 0.22), (1.5, 0.75)])
def test_a_wheel_that_hardly_slows_down_is_cut_at_once_and_any_other_after_half_a_second(
    falls: float, cut_s: float
) -> None:
    check = believing(["left"], latency_s=0.0)
    check.command(0, [-0.3])
    cuts = []
    for n in range(100):
        speed = 0.6 * math.exp(-falls * n / 50)
        if check.measure(n * 20 * MS, [speed], [round(speed * 100)]):
            cuts.append(n * 0.02)
    assert cuts == [pytest.approx(cut_s, abs=0.06)]


def test_a_wheel_with_swapped_phases_is_cut_as_soon_as_it_starts() -> None:
    model = WheelModel(broken="backward", broken_from_ns=S)
    found = drive(model, [(S, 0.3)], until_ns=2 * S)
    assert found[0][1].kind == "runaway_against"
    assert found[0][0] <= S + 150 * MS
    assert "encoder" in found[0][1].message


def test_a_wheel_that_runs_away_from_standstill_is_cut() -> None:
    model = WheelModel(broken="runaway", broken_from_ns=2 * S)
    found = drive(model, [(0, 0.0)], until_ns=3 * S)
    assert found[0][1].action == "cut"
    assert found[0][0] <= 2 * S + 150 * MS


@pytest.mark.parametrize("broken", ["blocked", "no_encoder"])
@pytest.mark.parametrize(
    ("speed", "after_s"), [(1.0, 0.15), (0.3, 0.15), (0.1, 0.3), (0.08, 0.375)]
)
def test_counts_that_end_in_motion_are_noticed_after_150_ms_or_30_mm_whichever_is_later(
    broken: str, speed: float, after_s: float
) -> None:
    model = WheelModel(broken=broken, broken_from_ns=2 * S)
    found = drive(model, [(0, speed)], until_ns=4 * S)
    assert [(fault.kind, fault.action) for _, fault in found] == [("no_counts", "policy")]
    waited_s = (found[0][0] - 2 * S) / S
    # Counts of the step in which it breaks are its last ones, and a reading comes once in 20 ms.
    assert after_s - 0.02 <= waited_s <= after_s + 0.03
    assert "is commanded" in found[0][1].message


def judged(
    commanded: float, speeds: list[float], *, period_ms: int = 10, ticks: int = 0
) -> list[tuple[int, str]]:
    """The troubles of one motor by readings that show each command at once, and when."""
    watch = follower()
    watch.command(0, commanded)
    return [
        (n * period_ms, fault.kind)
        for n, speed in enumerate(speeds, 1)
        for fault in read(watch, (n - 1) * period_ms * MS, n * period_ms * MS, speed, ticks)
    ]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wheel_at_rest_may_show_a_tenth_of_a_metre_per_second_and_no_more(sign: float) -> None:
    still = "turns_without_command"
    assert judged(0.0, [sign * 0.1] * 62) == [(610, still)]
    assert judged(0.0, [sign * 0.1001] * 62) == [(50, "runaway_fast"), (610, still)]
    # So it may against a command that is too slow to turn it.
    assert judged(sign * 0.02, [sign * -0.09] * 50, ticks=7) == []
    assert judged(sign * 0.04, [sign * -0.09] * 100, ticks=7) != []


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wheel_creeps_from_30_mm_per_second_on(sign: float) -> None:
    assert judged(0.0, [sign * 0.0299] * 100) == []
    assert judged(0.0, [sign * 0.03] * 61) == [(610, "turns_without_command")]
    assert judged(sign * 0.03, [sign * 0.03] * 61, ticks=7) == []


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wheel_that_is_commanded_to_creep_may_do_so_faster(sign: float) -> None:
    still = "turns_without_command"
    assert judged(sign * 0.0275, [sign * 0.057] * 100, ticks=7) == []
    assert judged(sign * 0.0275, [sign * 0.058] * 61, ticks=7) == [(610, still)]
    # What it may do excuses no time before and after.
    watch, found = follower(), []
    for n in range(1, 100):
        watch.command(n * 10 * MS, sign * 0.011 if n % 10 == 5 else 0.0)
        found += read(watch, (n - 1) * 10 * MS, n * 10 * MS, sign * 0.04, 7)
    assert [fault.kind for fault in found] == [still]
    # Against its command, or for none, it may not.
    assert judged(sign * 0.0275, [sign * -0.03] * 61, ticks=7) == [(610, still)]


def test_a_wheel_outside_its_bounds_is_accused_after_40_ms_unless_it_loses_4_percent() -> None:
    assert judged(0.0, [1.0] * 5) == [(50, "runaway_fast")]
    assert judged(0.0, [1.0, 1.0, 1.0, 1.0, 0.97]) == [(50, "runaway_fast")]
    assert judged(0.0, [1.0, 1.0, 1.0, 1.0, 0.96]) == []
    # And has to lose as much again in the next 40 ms.
    assert judged(0.0, [1.0, 1.0, 1.0, 1.0, *[0.96] * 5]) == [(90, "runaway_fast")]


def test_a_wheel_that_slows_down_has_half_a_second_to_get_inside_its_bounds() -> None:
    slower = [5.0 * 0.95**n for n in range(20)]
    assert judged(0.0, slower, period_ms=50) == [
        (550, "runaway_fast"),
        (650, "turns_without_command"),
    ]


def rolling(speed: float) -> tuple[WheelFollower, int]:
    """A wheel that has followed this speed for 200 ms, and the moment."""
    watch = follower()
    watch.command(0, speed)
    for n in range(1, 21):
        ticks = round(speed * 0.01 / METRES_PER_TICK)
        assert not read(watch, (n - 1) * 10 * MS, n * 10 * MS, speed, ticks)
    return watch, 200 * MS


@pytest.mark.parametrize(
    ("sign", "back", "kinds"), [(1, 5, [AGAINST]), (-1, 5, [AGAINST]), (1, 3, [])]
)
def test_a_wheel_that_every_healthy_one_turns_onward_by_now_may_not_creep_back(
    sign: int, back: int, kinds: list[str]
) -> None:
    watch, now_ns = rolling(0.3 * sign)
    watch.command(now_ns, 0.03 * sign)
    assert kinds == [
        fault.kind
        for n in range(1, 20)
        for fault in read(
            watch,
            now_ns + (n - 1) * 10 * MS,
            now_ns + n * 10 * MS,
            -0.01 * back * sign,
            -2 * sign,
        )
    ]


@pytest.mark.parametrize("count", [0, 1, -1])
@pytest.mark.parametrize("speed", [0.3, -0.3])
def test_a_single_count_does_not_begin_the_silence_again(count: int, speed: float) -> None:
    watch, now_ns = rolling(speed)
    found = [
        (n * 10, fault.kind)
        for n in range(1, 30)
        for fault in read(
            watch, now_ns + (n - 1) * 10 * MS, now_ns + n * 10 * MS, 0.0, count if n == 5 else 0
        )
    ]
    # The reading that shows the last counts proves them with the one before, and begins it.
    assert found == [(140, "no_counts")]


@pytest.mark.parametrize(("pace", "kind"), [(0.16, "no_counts"), (0.14, "not_started")])
def test_a_wheel_that_stops_is_at_fault_if_it_rolled_at_half_its_setpoint(
    pace: float, kind: str
) -> None:
    watch = follower()
    watch.command(0, 0.3)
    found = [
        fault.kind
        for n in range(1, 300)
        for fault in read(
            watch,
            (n - 1) * 20 * MS,
            n * 20 * MS,
            pace if n < 20 else 0.0,
            round(pace * 0.02 / METRES_PER_TICK) if n < 20 else 0,
        )
    ]
    assert found[:1] == [kind]


@pytest.mark.parametrize(("then", "kind"), [(0.2, "no_counts"), (-0.3, "not_started")])
def test_a_wheel_that_stops_is_at_fault_onward_and_may_need_time_to_turn_round(
    then: float, kind: str
) -> None:
    watch, now_ns = rolling(0.3)
    watch.command(now_ns, then)
    found = [
        fault.kind
        for n in range(1, 300)
        for fault in read(
            watch,
            now_ns + (n - 1) * 10 * MS,
            now_ns + n * 10 * MS,
            0.3 if n < 3 else 0.0,
            19 if n < 3 else 0,
        )
    ]
    assert found[:1] == [kind]


@pytest.mark.parametrize(("ticks", "found"), [(2, []), (1, [140])])
def test_two_counts_at_the_end_of_a_silence_wait_for_the_next_reading(
    ticks: int, found: list[int]
) -> None:
    watch, now_ns = rolling(0.3)
    assert found == [
        n * 10
        for n in range(1, 16)
        for _ in read(
            watch, now_ns + (n - 1) * 10 * MS, now_ns + n * 10 * MS, 0.0, ticks if n > 13 else 0
        )
    ]


def test_a_wheel_among_turning_ones_has_50_ms_to_begin_however_quick_its_loop_is() -> None:
    watch, quick = follower(), LoopLaw(per_m_s=10.0, per_m=0.0, dead_zone=False)
    watch.command(-1, 0.5)
    found = [
        (n * 10, fault.kind)
        for n in range(1, 20)
        for fault in watch.measure(
            Step(before_ns=(n - 1) * 10 * MS, now_ns=n * 10 * MS, law=quick, farthest_m=0.01),
            0.0,
            0,
            0.0,
        )
    ]
    assert found[0] == (50, "not_started")


@pytest.mark.parametrize("commanded", [0.3, -0.3])
def test_a_line_that_is_held_up_excuses_silence_for_a_second(commanded: float) -> None:
    watch, now_ns = rolling(commanded)
    found = [
        (n * 20, fault.kind)
        for n in range(1, 100)
        for fault in read(
            watch, now_ns + (n - 1) * 20 * MS, now_ns + n * 20 * MS, 0.0, 0, held_up=True
        )
    ]
    # 50 readings are excused; the counts of the last 10 ms, and eight readings, make 150 ms.
    assert found == [(1140, "no_counts")]


def test_after_counts_that_were_held_back_a_slow_wheel_owes_20_ms_of_its_way() -> None:
    watch = follower()
    watch.command(0, 0.11)
    now_ns = 0
    for step_ms in [20] * 9 + [400]:
        before_ns, now_ns = now_ns, now_ns + step_ms * MS
        ticks = round(0.11 * step_ms / 1e3 / METRES_PER_TICK)
        assert not read(watch, before_ns, now_ns, 0.11, ticks)
    # 30 mm take 273 ms, of which 20 are those of the last counts.
    silent = [
        n * 20
        for n in range(1, 30)
        if read(watch, now_ns + (n - 1) * 20 * MS, now_ns + n * 20 * MS, 0.0, 0)
    ]
    assert silent == [260]


@pytest.mark.parametrize("held_ms", [160, 250, 400])
def test_counts_that_were_held_back_are_no_silence(held_ms: int) -> None:
    check = believing(["left"], latency_s=0.06)
    check.command(0, [0.3])
    now_ns, found = S, []
    for step_ms in [10] * 20 + [held_ms] + [10] * 6 + [held_ms] + [10] * 20:
        now_ns += step_ms * MS
        found += check.measure(now_ns, [0.3], [round(0.3 * step_ms / 1e3 / METRES_PER_TICK)])
    assert not found
    # An encoder that dies then is noticed as soon as ever.
    died_ns = now_ns
    while not found:
        now_ns += 10 * MS
        found += check.measure(now_ns, [0.0], [0])
    assert now_ns - died_ns <= 150 * MS


def test_an_encoder_that_dies_in_motion_is_noticed() -> None:
    model = WheelModel(broken="no_encoder", broken_from_ns=2 * S)
    found = drive(model, [(0, 0.3)], until_ns=3 * S)
    assert found[0][1].kind == "no_counts"
    assert found[0][0] <= 2 * S + 200 * MS


def test_a_step_without_counts_that_proves_earlier_ones_is_silence() -> None:
    check = believing(["left"])
    check.command(0, [0.3])
    # The first reading begins, and pairs of the others prove motion.
    for n in range(51):
        assert not check.measure(n * 20 * MS, [0.3], [38])
    last_ns = 50 * 20 * MS
    # One count of an encoder that died, then 200 ms of which no answer arrived.
    assert not check.measure(last_ns + 20 * MS, [0.3], [38])
    assert check.measure(last_ns + 220 * MS, [0.0], [0])


@pytest.mark.parametrize("counts", [{5: 7, 6: -7}, {1: 1, 3: -1, 5: 1, 7: -1, 9: 0}])
def test_garbled_counts_and_an_encoder_on_an_edge_are_no_motion(counts: dict[int, int]) -> None:
    check = believing(["left"], latency_s=0.0)
    check.command(0, [0.12])
    found = [
        (n * 10, fault.kind)
        for n in range(400)
        for fault in check.measure(n * 10 * MS, [0.0], [counts.get(n % 10, 0)])
    ]
    assert found == [(pytest.approx(1500, abs=100), "not_started")]


def test_a_wheel_that_creeps_without_command_is_reported() -> None:
    check = believing(["left"])
    check.command(0, [0.0])
    found = [
        (n * 20 * MS, fault)
        for n in range(100)
        for fault in check.measure(n * 20 * MS, [0.05], [5])
    ]
    assert [fault.kind for _, fault in found] == ["turns_without_command"]
    assert found[0][0] >= 600 * MS


def test_wheels_that_were_let_go_may_turn_as_they_like() -> None:
    model = WheelModel(broken="runaway", broken_from_ns=S)
    assert drive(model, [(0, None)], until_ns=3 * S) == []


@pytest.mark.parametrize("speed", [0.4, -0.4])
def test_a_wheel_that_was_let_go_and_is_held_again_may_roll_for_a_moment(speed: float) -> None:
    watch = follower()
    for command in (speed, None, 0.0):
        watch.command(0, command)
    found = [
        n * 10
        for n in range(1, 100)
        for _ in read(watch, (n - 1) * 10 * MS, n * 10 * MS, speed, round(speed * 100))
    ]
    # From half a metre per second it slows down as the slowest motor does, to 0.2 m/s.
    assert found[0] == pytest.approx(400 * math.log(0.5 / 0.2) + 40, abs=20)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_wheels_commanded_while_they_coast_raise_no_alarm(way: float) -> None:
    check = believing(["left"])
    check.command(0, None)
    found = []
    speed = way
    for n in range(200):
        now_ns = n * 20 * MS
        if n == 50:
            check.command(now_ns, [0.1 * way])
        if n > 50:
            speed += (0.1 * way - speed) * 0.02 / 0.3
        found += check.measure(now_ns, [speed], [round(speed * 0.02 / METRES_PER_TICK)])
    assert found == []


def test_a_wheel_far_slower_than_commanded_is_reported_and_driven_on() -> None:
    check = believing(["left"])
    check.command(0, [0.5])
    found = [
        (n * 20 * MS, fault)
        for n in range(200)
        for fault in check.measure(n * 20 * MS, [0.2], [25])
    ]
    assert [(fault.kind, fault.action) for _, fault in found] == [("off_speed", "report")]
    # Its command has been 0.4 m/s at least, by the slowest healthy motor, for a second.
    assert found[0][0] / S == pytest.approx(1.0 + 0.4 * math.log(5.0), abs=0.1)


def test_the_time_for_which_a_wheel_stuck_does_not_count_as_too_slow() -> None:
    watch, found = follower(), []
    watch.command(0, 0.1)
    for n in range(1, 125):
        speed, ticks = (0.0, 0) if n < 75 else (0.03, 4)
        found += read(watch, (n - 1) * 20 * MS, n * 20 * MS, speed, ticks)
    assert found == []


@pytest.mark.parametrize("readings", [1, 2])
def test_a_single_garbled_reading_cuts_nothing(readings: int) -> None:
    check = believing(["left"])
    check.command(0, [0.3])
    found = []
    for n in range(200):
        garbled = 100 <= n < 100 + readings
        found += check.measure(n * 20 * MS, [5.0 if garbled else 0.3], [37])
    assert found == []


def test_a_trouble_is_reported_once_and_again_after_it_was_over() -> None:
    check = believing(["left"])
    check.command(0, [0.3])
    speeds = [0.3] * 50 + [1.0] * 50 + [0.3] * 50 + [1.0] * 50
    kinds = [
        fault.kind
        for n, speed in enumerate(speeds)
        for fault in check.measure(n * 20 * MS, [speed], [37])
    ]
    assert kinds == ["runaway_fast", "runaway_fast"]


def test_a_flood_of_commands_between_readings_takes_bounded_memory() -> None:
    watch = follower(60 * MS)
    for n in range(20_000):
        watch.command(n * MS, float(n % 2))
    assert len(watch._past) <= 502


def test_no_reading_that_the_next_one_contradicts_cuts_a_motor() -> None:
    check = FollowCheck(["left"], [METRES_PER_TICK])
    check.command(0, [0.2])
    per_reading = 25
    speed = per_reading * METRES_PER_TICK / 0.02
    for n in range(1, 60):
        wrong = 400 if n % 10 == 0 else -400 if n % 10 == 1 and n > 1 else 0
        # A speed is taken over several readings, and stays wrong for as long.
        seen = 1.2 if n % 10 < 4 else speed
        assert check.measure(n * 20 * MS, [seen], [per_reading + wrong]) == ()


def test_a_wheel_that_all_readings_show_running_is_cut_within_100_ms() -> None:
    check = FollowCheck(["left"], [METRES_PER_TICK])
    check.command(0, [0.2])
    for n in range(1, 30):
        assert check.measure(n * 20 * MS, [0.2], [25]) == ()
    for n in range(30, 40):
        # Commands go on.
        check.command(n * 20 * MS, [0.2])
        found = check.measure(n * 20 * MS, [1.0], [125])
        if found:
            assert [fault.action for fault in found] == ["cut"]
            assert (n - 29) * 20 <= 100
            return
    pytest.fail("nothing was found")


def test_a_motor_that_has_stood_for_long_is_cut_as_soon_as_one_that_just_stood() -> None:
    took_ns = []
    for begins_ns in (9 * S, 60 * S):
        model = WheelModel(broken="runaway", broken_from_ns=begins_ns)
        found = drive(model, [(0, 0.3), (2 * S, 0.0)], until_ns=begins_ns + S)
        took_ns.append(next(at_ns for at_ns, fault in found if fault.action == "cut") - begins_ns)
    assert took_ns[0] == took_ns[1]


def test_a_motor_that_starts_after_a_long_rest_and_does_not_count_is_reported() -> None:
    model = WheelModel(broken="blocked", broken_from_ns=10 * S)
    found = drive(model, [(0, 0.3), (2 * S, 0.0), (20 * S, 0.3)], until_ns=23 * S)
    assert [fault.kind for at_ns, fault in found if at_ns > 20 * S][:1] == ["not_started"]
