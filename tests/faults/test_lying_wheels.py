"""Wheels that disobey are cut, and named with what to check.

On virtual time, with the incremental speed loop of the board: a lying encoder makes it run away.
"""

from __future__ import annotations

import asyncio
import re
from pathlib import Path

import pytest
from fault_bench import CUT, DIALECTS, MS, STREAMS, SUREST, FaultBench, is_stop
from robot_bench import state_and_why

from yahboomd.core.protocol.first_words import FIRST_WORDS
from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.motors import MotorFaults
from yahboomd.simulation.options import SimulationOptions, Wiring
from yahboomd.simulation.virtual_time import on_virtual_time

CUT_WITHIN_NS = 150 * MS
SELDOM_NS = {"rosmaster": 41 * MS, "binary": 40 * MS}
"""A board that reports so seldom shows a wheel that much later."""

SWITCH_OFF = re.compile(r"still turns .* switch their supply off")
RUNAWAYS = ["encoder-reversed", "phases-swapped"]
SILENT = ["encoder-dead", "unplugged", "stalled"]
MOTIONS = [(-0.3, 0.0), (0.1, 0.0), (0.6, 0.0), (0.0, 3.0)]


def robot(tmp_path: Path, *overrides: str, **simulation: object) -> FaultBench:
    return FaultBench(tmp_path, overrides, SimulationOptions(**simulation))  # type: ignore[arg-type]


def cut_ns(bench: FaultBench, since_ns: int) -> int | None:
    """The first moment at which the motors were released, or stopped in the polled dialect."""
    wanted = SUREST.values()
    return next((at for at, order in bench.orders_since(since_ns) if order in wanted), None)


def left_plausibility_ns(bench: FaultBench, since_ns: int, wheel: int, sign: int) -> int | None:
    """The first moment at which a wheel's counts could not follow from its commands."""
    commands = [
        (estimate.stamp_ns, command[wheel])
        for estimate, command in zip(bench.heard.estimates, bench.heard.commands, strict=True)
        if estimate.stamp_ns >= since_ns
    ]
    for truth in bench.truth:
        shown = sign * truth.speed_m_s[wheel]
        now = [each for at_ns, each in commands if at_ns <= truth.t_ns]
        if truth.t_ns < since_ns or not now:
            continue
        fastest = max(map(abs, now))
        against = now[-1] * shown < 0.0 and abs(shown) >= 0.03
        if against or abs(shown) > 1.5 * fastest + 0.1:
            return truth.t_ns
    return None


@pytest.mark.cases(1)
@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("fault", RUNAWAYS)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_wheel_that_runs_away_is_cut_within_150_ms_of_showing_it(
    tmp_path: Path, dialect: str, fault: str, motion: tuple[float, float]
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        bench.do(f"{fault} left")
        began_ns = bench.clock.now_ns()
        await bench.drive(1.5, *motion)
        left_ns = left_plausibility_ns(bench, began_ns, 0, sign=-1 if "encoder" in fault else 1)
        at_ns = cut_ns(bench, began_ns)
        assert left_ns is not None
        assert at_ns is not None
        print(f"{dialect}, {fault} {motion}: cut {(at_ns - left_ns) / MS:.0f} ms after it showed")
        assert at_ns - left_ns <= CUT_WITHIN_NS + SELDOM_NS.get(dialect, 0)
        # The base stands after it, though a source commands motion.
        assert all(is_stop(order) for _, order in bench.orders_since(at_ns))
        await asyncio.sleep(1.0)
        assert bench.standing
        state, why = state_and_why(bench.controller)
        assert state == "fault"
        assert "left" in why


@pytest.mark.cases(1)
@pytest.mark.parametrize(("command_m_s", "turned_m_s"), [(0.1, 0.4), (0.3, 0.65), (-0.3, -0.65)])
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_wheel_that_something_turns_too_fast_is_cut_within_150_ms(
    tmp_path: Path, dialect: str, command_m_s: float, turned_m_s: float
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(1.0, command_m_s)
        bench.command(command_m_s)
        began_ns = bench.clock.now_ns()
        bench.do(f"turning right {turned_m_s}")
        await bench.drive(1.0, command_m_s)
        left_ns = left_plausibility_ns(bench, began_ns, 1, sign=1)
        at_ns = cut_ns(bench, began_ns)
        assert left_ns is not None
        assert at_ns is not None
        print(f"{dialect}, {turned_m_s} for {command_m_s} m/s: {(at_ns - left_ns) / MS:.0f} ms")
        assert at_ns - left_ns <= CUT_WITHIN_NS
        assert all(is_stop(order) for _, order in bench.orders_since(at_ns))
        assert bench.events("runaway_fast")[0].startswith("right turns at")


@pytest.mark.cases(1)
@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("fault", SILENT)
@on_virtual_time
async def test_counts_that_end_in_motion_stop_the_wheels_after_150_ms_or_30_mm(
    tmp_path: Path, fault: str, motion: tuple[float, float]
) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        await bench.drive(1.5, *motion)
        bench.do(f"{fault} left")
        began_ns = bench.clock.now_ns()
        await bench.drive(1.0, *motion)
        at_ns = cut_ns(bench, began_ns)
        assert at_ns is not None
        due_ns = silence_due_ns(bench, began_ns, 0)
        print(f"{fault} {motion}: cut {(at_ns - due_ns) / MS:.0f} ms after the proof was due")
        assert 0 <= at_ns - due_ns <= CUT_WITHIN_NS
        assert all(is_stop(order) for _, order in bench.orders_since(at_ns))
        state, why = state_and_why(bench.controller)
        assert state == "fault"
        assert "left" in why
        assert "no motion" in why


def silence_due_ns(bench: FaultBench, since_ns: int, wheel: int) -> int:
    """The end of both 150 ms and 30 mm of commanded travel above the least speed."""
    least_m_s = bench.config.faults.min_speed_m_s
    # The counts of the step in which it broke may have been its last ones.
    travel_m, silent_ns, before_ns, in_force_m_s = 0.0, 0, since_ns - 20 * MS, 0.0
    for estimate, command in zip(bench.heard.estimates, bench.heard.commands, strict=True):
        if estimate.stamp_ns >= since_ns:
            if in_force_m_s >= least_m_s:
                step_ns = estimate.stamp_ns - before_ns
                silent_ns += step_ns
                travel_m += in_force_m_s * step_ns / 1e9
                if silent_ns >= 150 * MS and travel_m >= 0.03:
                    return estimate.stamp_ns
            before_ns = estimate.stamp_ns
        # What is decided by this estimate is in force after it.
        in_force_m_s = abs(command[wheel])
    raise AssertionError("never due")


@pytest.mark.cases(1)
@pytest.mark.parametrize("fault", [*RUNAWAYS, "encoder-dead"])
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_fault_in_mid_motion_ends_in_standstill(
    tmp_path: Path, dialect: str, fault: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        bench.do(f"{fault} right")
        await bench.drive(2.0, 0.3)
        await asyncio.sleep(1.0)
        assert bench.standing
        state, why = state_and_why(bench.controller)
        assert state == "fault"
        assert "right" in why


@pytest.mark.cases(1)
@pytest.mark.parametrize("loss", [0.0, 0.02])
@pytest.mark.parametrize("dead_zone", [1600, 1900])
@pytest.mark.parametrize("speed", [0.0125, 0.02, 0.03, 0.07])
@on_virtual_time
async def test_a_dead_encoder_at_a_crawl_runs_750_mm_at_most_in_its_three_tries(
    tmp_path: Path, speed: float, dead_zone: int, loss: float
) -> None:
    async with robot(tmp_path, flash=FlashContent(dead_zone=dead_zone)) as bench:
        await bench.ready()
        bench.robot.impairments.change(loss=loss)
        bench.do("encoder-dead left")
        await tries(bench, speed)
        ran_m = abs(bench.robot.plant.motors[0].travel_m)
        print(f"{speed} m/s: {ran_m:.2f} m")
        # Speeds that arrive garbled make an unseen wheel run farther.
        assert ran_m < (1.0 if loss else 0.75)
        assert bench.controller.state()[0] == "fault"
        assert len(bench.events("not_started")) >= 2
        await asyncio.sleep(1.0)
        assert bench.standing


async def tries(bench: FaultBench, vx: float, wz: float = 0.0) -> None:
    """Command motion again and again, as a person does, until a fault."""
    for _ in range(6):
        for _ in range(200):
            await bench.drive(0.05, vx, wz)
            if bench.controller.state()[0] != "driving":
                break
        if bench.controller.state()[0] == "fault":
            return
        bench.command(0.0)
        await asyncio.sleep(0.5)


@on_virtual_time
async def test_a_wheel_that_does_not_begin_to_turn_is_let_go_until_another_command(
    tmp_path: Path,
) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        bench.do("stalled left")
        await bench.drive(6.0, 0.1)
        assert len(bench.events("not_started")) == 1
        state, why = state_and_why(bench.controller)
        assert state == "standing"
        assert why.startswith("left does not begin to turn at 0.10 m/s: drive faster")
        assert bench.standing
        assert bench.frames[-1] == CUT
        # A little more is the same command.
        await bench.drive(1.0, 0.11)
        assert bench.standing
        bench.do("repair left")
        await bench.drive(1.0, 0.2)
        assert min(bench.rim_speeds) > 0.15
        assert bench.controller.state()[0] == "driving"


@pytest.mark.nightly
@pytest.mark.cases(1)
@pytest.mark.parametrize("dead_zone", [1600, 1900])
@pytest.mark.parametrize(("speed", "half_s"), [(0.07, 0.3), (0.07, 0.5), (0.03, 0.6), (0.02, 1.0)])
@on_virtual_time
async def test_a_dead_encoder_at_a_crawl_to_and_fro_is_cut_and_runs_750_mm_at_most(
    tmp_path: Path, speed: float, half_s: float, dead_zone: int
) -> None:
    async with robot(tmp_path, flash=FlashContent(dead_zone=dead_zone)) as bench:
        await bench.ready()
        bench.do("encoder-dead left")
        began_ns = bench.clock.now_ns()
        for turn in range(40):
            await bench.drive(half_s, -speed if turn % 2 else speed)
            if bench.controller.state()[0] != "driving":
                bench.command(0.0)
        await asyncio.sleep(1.0)
        assert cut_ns(bench, began_ns) is not None
        assert abs(bench.robot.plant.motors[0].travel_m) < 0.75
        assert bench.controller.state()[0] == "fault"
        assert bench.standing


@pytest.mark.cases(1)
@pytest.mark.parametrize("for_s", [0.4, 3.0])
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_a_stop_does_not_leave_an_unseen_runaway_running(
    tmp_path: Path, for_s: float, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        bench.do("encoder-dead left")
        # Too short for a proof; the wheel has long broken loose in the longer ones.
        await bench.drive(for_s, 0.03)
        await asyncio.sleep(2.5)
        assert bench.standing
        assert bench.frames[-1] == SUREST[dialect]


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_wheel_that_no_cut_stops_is_reported_with_the_supply_to_switch_off(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        # As with a motor driver that is shorted.
        bench.do("turning left 0.9")
        await bench.drive(0.5, 0.3)
        at_ns = bench.clock.now_ns()
        await bench.until(lambda: any(map(SWITCH_OFF.search, bench.events("stop_not_obeyed"))))
        assert bench.clock.now_ns() - at_ns <= 2000 * MS
        state, why = state_and_why(bench.controller)
        assert state == "fault"
        assert SWITCH_OFF.search(why)
        # The repair is named as well.
        assert "It was cut because: left turns at " in why
        await bench.drive(3.0, 0.3)
        assert len(list(filter(SWITCH_OFF.search, bench.events("stop_not_obeyed")))) == 1


@pytest.mark.cases(1)
@pytest.mark.parametrize("fault", ["encoder-dead", "encoder-reversed", "phases-swapped"])
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_after_a_cut_no_zero_speed_wakes_the_speed_loop_again(
    tmp_path: Path, fault: str, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        bench.do(f"{fault} left")
        began_ns = bench.clock.now_ns()
        await bench.drive(2.0, 0.3)
        at_ns = cut_ns(bench, began_ns)
        assert at_ns is not None
        bench.operator.engage_estop("a test")
        await asyncio.sleep(0.3)
        bench.tasks[0].cancel()
        await asyncio.sleep(1.0)
        assert {order for _, order in bench.orders_since(at_ns)} == {SUREST[dialect]}


@pytest.mark.cases(1)
@pytest.mark.parametrize("faults", [*RUNAWAYS, *SILENT])
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_a_repaired_wheel_drives_again_once_a_person_cleared_the_fault(
    tmp_path: Path, faults: str, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        bench.do(f"{faults} left")
        await bench.drive(2.0, 0.3)
        assert bench.controller.state()[0] == "fault"
        bench.do("repair left")
        # Commands alone do not: neither those that go on, nor new ones after a silence.
        await bench.drive(1.0, 0.3)
        await asyncio.sleep(1.0)
        await bench.drive(1.0, 0.3)
        assert bench.standing
        released, why = bench.operator.release_estop()
        assert not released, why
        await asyncio.sleep(1.0)
        released, why = bench.operator.release_estop()
        assert released, why
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) > 0.2


# A profile or a configuration that is not this robot's.

AT_TWO = (
    Wiring(name="left", position=1, corner="left"),
    Wiring(name="right", position=2, corner="right"),
)


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_motor_at_another_position_than_configured_is_named_and_stops_the_base(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect, wiring=AT_TWO) as bench:
        await bench.ready()
        await tries(bench, 0.3)
        await asyncio.sleep(0.5)
        assert bench.standing
        state, why = state_and_why(bench.controller)
        assert state == "fault"
        assert why.startswith("right had no counts in three tries, the last at 0.30 m/s")
        assert "the position" in why


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("dialect", "profile", "motor_type"),
    [("streamed", "310", 2), ("polled", "310", 2), ("polled", "tt", 3)],
)
@on_virtual_time
async def test_a_520_whose_profile_and_board_believe_that_it_is_another_motor_is_cut_and_named(
    tmp_path: Path, profile: str, motor_type: int, dialect: str
) -> None:
    # Configuration and board agree; the motors are 520, whose output runs the other way.
    flash = FlashContent(motor_type=motor_type)
    overrides = [f'board.profile="{profile}"']
    async with robot(tmp_path, *overrides, dialect=dialect, flash=flash) as bench:
        await bench.ready()
        began_ns = bench.clock.now_ns()
        await bench.drive(1.5, 0.3)
        at_ns = cut_ns(bench, began_ns)
        assert at_ns is not None
        assert all(is_stop(order) for _, order in bench.orders_since(at_ns))
        await asyncio.sleep(1.0)
        assert bench.standing
        assert bench.controller.state()[0] == "fault"
        assert {"left", "right"} & {event.wheel for event in bench.heard.events}
        assert "check" in state_and_why(bench.controller)[1]


@on_virtual_time
async def test_tt_motors_on_a_board_set_for_520_show_no_fault_in_any_count(tmp_path: Path) -> None:
    # Both their wires and their encoder's phases run the other way: command and counts agree.
    async with robot(tmp_path, motor_type=3) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3)
        assert max(bench.rim_speeds) < -0.2
        assert bench.heard.estimates[-1].pose.x > 0.3
        assert bench.controller.state()[0] == "driving"
        assert bench.heard.kinds == ["connected"]


# Policies.


@pytest.mark.cases(1)
@pytest.mark.parametrize("policy", ["stop", "report"])
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_a_stalled_wheel_stops_the_base_or_is_only_reported_as_configured(
    tmp_path: Path, policy: str, dialect: str
) -> None:
    async with robot(tmp_path, f"faults.stall={policy}", dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        bench.do("stalled left")
        await bench.drive(1.0, 0.3)
        right_m_s = bench.rim_speeds[1]
        assert (abs(right_m_s) < 0.1) == (policy == "stop")
        assert bench.events("no_counts")
        assert bench.heard.events[-1].wheel == "left"
        assert "check whether the wheel is blocked" in bench.events("no_counts")[0]


@pytest.mark.cases(1)
@pytest.mark.parametrize("policy", ["stop", "report"])
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_a_wheel_that_turns_by_itself_is_reported_and_stops_the_base_where_configured(
    tmp_path: Path, policy: str, dialect: str
) -> None:
    async with robot(tmp_path, f"faults.turns_without_command={policy}", dialect=dialect) as bench:
        await bench.ready()
        await asyncio.sleep(0.5)
        bench.do("turning right 0.08")
        await asyncio.sleep(2.0)
        assert len(bench.events("turns_without_command")) == 1
        assert (bench.controller.state()[0] == "fault") == (policy == "stop")
        assert (bench.frames[-1] == SUREST[dialect]) == (policy == "stop")


# The brake of a rosmaster board ends its speed loops: they cannot wind up against a held wheel.
@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", ["streamed", "binary"])
@on_virtual_time
async def test_a_wheel_that_was_held_against_its_standstill_and_leaps_when_freed_is_cut(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        bench.do("turning all 0.08")
        await asyncio.sleep(1.0)
        assert bench.controller.state()[0] != "fault"
        freed_ns = bench.clock.now_ns()
        bench.do("repair all")
        await asyncio.sleep(1.0)
        at_ns = cut_ns(bench, freed_ns)
        assert at_ns is not None
        assert at_ns - freed_ns < 300 * MS
        assert bench.standing
        assert "came free after being blocked" in state_and_why(bench.controller)[1]


# Settings that would run away.

UNFIT = [
    FlashContent(motor_type=2),
    FlashContent(motor_type=3),
    FlashContent(motor_type=4),
    FlashContent(lines=0),
    FlashContent(ratio=0),
    FlashContent(wheel_diameter_mm=0.0),
]


@pytest.mark.cases(1)
@pytest.mark.parametrize("flash", UNFIT)
@on_virtual_time
async def test_a_board_whose_settings_would_run_away_gets_no_speed_at_all(
    tmp_path: Path, flash: FlashContent
) -> None:
    async with robot(tmp_path, flash=flash) as bench:
        await bench.until(lambda: bench.heard.estimates)
        await bench.drive(1.0, 0.3)
        # Pushed by hand, such a board's own loop would go on pushing, even at a commanded zero.
        bench.do("turning all 0.3")
        await asyncio.sleep(0.3)
        bench.do("repair all")
        await bench.drive(2.0, 0.3)
        assert bench.standing
        bench.operator.engage_estop("a test")
        await asyncio.sleep(0.3)
        first = {words.lstrip(b"\n\0") for words in FIRST_WORDS.values()}
        assert {order for _, order in bench.orders} <= first
        assert bench.controller.state()[0] == "estopped"


def test_every_runaway_of_this_page_would_happen_without_the_watch(tmp_path: Path) -> None:
    """The simulated board's loop does run away: these tests would show nothing otherwise."""
    from yahboomd.simulation.robot import SimulatedRobot

    for fault in (MotorFaults(encoder_dead=True), MotorFaults(encoder_reversed=True)):
        board = SimulatedRobot()
        board.start(0)
        board.set_faults("left", fault, now_ns=0)
        board.host_wrote(b"$spd:100,0,100,0#", 0)
        board.advance(2000 * MS)
        board.host_wrote(b"$spd:0,0,0,0#", 2000 * MS)
        board.advance(5000 * MS)
        assert abs(board.plant.motors[0].speed_m_s) > 0.9
        board.host_wrote(CUT, 5000 * MS)
        board.advance(7000 * MS)
        assert abs(board.plant.motors[0].speed_m_s) < 0.03
