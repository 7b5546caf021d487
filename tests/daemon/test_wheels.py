"""Commands to the board, and whether it obeys them."""

from __future__ import annotations

from collections import Counter

import pytest

from yahboomd.core.daemon.fit import BoardFit
from yahboomd.core.daemon.wheels import Wheels
from yahboomd.core.drive.kinematics import differential
from yahboomd.core.model import Counts, Motor
from yahboomd.core.protocol.per_motor import per_motor

MS = 1_000_000
MOTORS = (
    Motor(name="left", wheel=0, position=1, radius_m=0.0335, ticks_per_revolution=1320.0),
    Motor(name="right", wheel=1, position=3, radius_m=0.0335, ticks_per_revolution=1320.0),
)
MOTION = per_motor(differential(separation_m=0.15), MOTORS, (1000.0, 1000.0), 1000)
FIT = BoardFit(motion=MOTION, wheel_limits=MOTION.wheel_limits)


class Recorded:
    """A board that records its commands."""

    def __init__(self) -> None:
        self.words: list[object] = []
        self.noisy, self.cuts = False, True

    def drive(self, units: Counts) -> None:
        self.words.append(units)

    def brake(self) -> None:
        self.words.append("brake")

    def cut(self) -> None:
        self.words.append("cut")

    def release(self) -> None:
        self.words.append("release")


@pytest.fixture
def board() -> Recorded:
    return Recorded()


def make(board: Recorded, at_rest: str = "hold") -> Wheels:
    wheels = Wheels(
        differential(separation_m=0.15),
        MOTORS,
        at_rest=at_rest,  # type: ignore[arg-type]
        min_speed_m_s=0.08,
        counters=Counter(),
    )
    wheels.attach(board, FIT)
    return wheels


def standing(wheels: Wheels, from_ms: int, to_ms: int) -> None:
    for ms in range(from_ms, to_ms, 10):
        wheels.measure(ms * MS, (0.0, 0.0), (0, 0))


def test_speeds_become_units_at_the_positions_of_the_motors(board: Recorded) -> None:
    wheels = make(board)
    wheels.turn((0.3, -0.2))
    assert board.words == [(300, 0, -200, 0)]
    assert wheels.command_m_s == (0.3, -0.2)
    assert wheels.in_motion


def test_an_immediate_stop_goes_before_everything_and_is_said_again(board: Recorded) -> None:
    wheels = make(board)
    wheels.turn((0.3, 0.3))
    board.words.clear()
    for ms in range(0, 250, 20):
        assert wheels.stand(ms * MS, at_once=True) is None
    assert board.words[0] == "brake"
    assert board.words.count("brake") == 3


def test_a_ramp_that_ends_at_zero_needs_no_stop_before_everything(board: Recorded) -> None:
    wheels = make(board)
    wheels.turn((0.01, 0.01))
    wheels.stand(20 * MS, at_once=False)
    assert "brake" not in board.words
    assert board.words[-1] == (0, 0, 0, 0)


def test_a_stop_that_is_obeyed_is_not_said_again(board: Recorded) -> None:
    wheels = make(board)
    wheels.turn((0.3, 0.3))
    wheels.stand(0, at_once=True)
    standing(wheels, 10, 100)
    assert wheels.stopped
    board.words.clear()
    wheels.stand(500 * MS, at_once=True)
    assert "brake" not in board.words
    assert not wheels.in_motion


def test_a_stop_that_is_not_obeyed_cuts_the_motors_after_600_ms(board: Recorded) -> None:
    wheels = make(board)
    wheels.turn((0.3, 0.3))
    faults = []
    for ms in range(0, 1000, 10):
        wheels.measure(ms * MS, (0.3, 0.3), (ms, ms))
        fault = wheels.stand(ms * MS, at_once=True)
        faults += [(ms, fault.kind)] if fault else []
    assert faults == [(600, "stop_not_obeyed")]
    assert "cut" in board.words
    # And it is not taken back by a zero speed, which would close the loop again.
    assert board.words[board.words.index("cut") :] == ["cut", "release"]


def test_wheels_that_slow_down_too_slowly_are_cut_and_not_accused(board: Recorded) -> None:
    wheels = make(board)
    wheels.turn((0.5, 0.5))
    for ms in range(0, 2000, 10):
        speed = 0.5 * 0.997**ms
        wheels.measure(ms * MS, (speed, speed), (ms, ms))
        assert wheels.stand(ms * MS, at_once=True) is None
        assert ("cut" in board.words) == (ms >= 600)
    assert board.words[board.words.index("cut") :] == ["cut", "release"]
    assert wheels._counters["slow_stops"] == 1
    # There is nothing to clear: it drives again.
    wheels.turn((0.3, 0.3))
    assert board.words[-1] == (300, 0, 300, 0)


def test_motors_are_let_go_once_they_stand_where_that_is_wanted(board: Recorded) -> None:
    wheels = make(board, "release")
    wheels.turn((0.3, 0.3))
    wheels.stand(0, at_once=False)
    assert board.words[-1] == (0, 0, 0, 0)
    standing(wheels, 10, 100)
    wheels.stand(100 * MS, at_once=False)
    assert board.words[-1] == "release"


def rested(board: Recorded) -> Wheels:
    """Wheels that stood for two seconds and were let go."""
    wheels = make(board, "auto")
    wheels.turn((0.3, 0.3))
    wheels.stand(0, at_once=False)
    standing(wheels, 10, 2090)
    wheels.stand(2090 * MS, at_once=False)
    assert board.words[-1] == "release"
    standing(wheels, 2090, 2100)
    return wheels


def roll(wheels: Wheels, from_ms: int, ticks: int) -> list[str]:
    return [
        fault.kind
        for ms, count in ((from_ms, ticks // 2), (from_ms + 10, ticks))
        for fault in wheels.measure(ms * MS, (0.1, 0.0), (count, 0))
    ]


def test_wheels_that_were_let_go_at_rest_and_roll_are_held_with_that_reading(
    board: Recorded,
) -> None:
    wheels = rested(board)
    board.words.clear()
    # 31 counts are 5 mm.
    assert roll(wheels, 2100, 30) == []
    assert board.words == []
    assert roll(wheels, 2120, 40) == ["rolled"]
    assert board.words == [(0, 0, 0, 0)]
    for ms in range(2140, 6000, 20):
        wheels.stand(ms * MS, at_once=False)
        wheels.measure(ms * MS, (0.0, 0.0), (40, 0))
    assert "release" not in board.words


def test_a_stop_that_is_asked_for_brakes_wheels_that_were_let_go_at_rest(board: Recorded) -> None:
    wheels = rested(board)
    board.words.clear()
    wheels.stop_again(2100 * MS)
    wheels.stand(2100 * MS, at_once=True)
    assert board.words[:1] == ["brake"]


@pytest.mark.parametrize("why", ["cut", "unfit"])
def test_neither_a_cut_nor_an_unfit_board_is_undone_by_wheels_that_roll(
    board: Recorded, why: str
) -> None:
    wheels = rested(board)
    if why == "cut":
        wheels.cut(2100 * MS)
    else:
        wheels.attach(board, BoardFit(motion=None, wheel_limits=(0.0, 0.0), wrong=("Zeros.",)))
        wheels.stand(2100 * MS, at_once=False)
    assert board.words[-1] == "release"
    assert "rolled" not in roll(wheels, 2120, 500)
    wheels.stand(2150 * MS, at_once=False)
    assert board.words[-1] == "release"


def test_a_board_that_cannot_release_its_motors_goes_on_holding_them(board: Recorded) -> None:
    board.cuts = False
    wheels = make(board, "auto")
    wheels.stand(0, at_once=False)
    standing(wheels, 10, 5000)
    wheels.stand(5000 * MS, at_once=False)
    assert "release" not in board.words


def test_wheels_that_were_cut_for_a_slow_stop_are_held_if_a_slope_takes_them(
    board: Recorded,
) -> None:
    wheels = make(board, "auto")
    wheels.turn((0.5, 0.5))
    travel_m, kinds = 0.0, list[str]()
    for ms in range(0, 2000, 10):
        speed = max(0.5 * 0.997**ms, 0.06)
        travel_m += speed * 0.01
        ticks = round(travel_m / MOTORS[0].metres_per_tick)
        kinds += [each.kind for each in wheels.measure(ms * MS, (speed, speed), (ticks, ticks))]
        wheels.stand(ms * MS, at_once=False)
    assert "cut" in board.words
    assert kinds[0] == "rolled"
    assert (0, 0, 0, 0) in board.words[board.words.index("cut") :]


def test_a_new_motion_ends_the_cut(board: Recorded) -> None:
    wheels = make(board)
    wheels.cut(0)
    wheels.turn((0.1, 0.1))
    assert board.words == ["cut", "release", (100, 0, 100, 0)]


def test_without_a_board_nothing_is_commanded(board: Recorded) -> None:
    wheels = make(board)
    wheels.turn((0.3, 0.3))
    wheels.detach()
    assert wheels.command_m_s == (0.0, 0.0)
    assert wheels.measured_m_s is None
    assert wheels.stand(0, at_once=True) is None
    assert len(board.words) == 1


def test_a_board_that_does_not_fit_is_event_no_speed(board: Recorded) -> None:
    wheels = make(board)
    wheels.attach(
        board, BoardFit(motion=None, wheel_limits=(0.0, 0.0), wrong=("It stores zeros.",))
    )
    # Not even zero, which would wake its speed loop: its motors are let go.
    for step in range(3):
        wheels.stand(step * 20 * MS, at_once=True)
    assert board.words == ["release"]


def test_motors_that_never_counted_for_their_commands_are_let_go_rather_than_held(
    board: Recorded,
) -> None:
    wheels = make(board)
    wheels.turn((0.05, 0.05))
    wheels.sent((50, 0, 50, 0), 0)
    for ms in range(0, 300, 10):
        wheels.measure(ms * MS, (0.05, 0.0), (ms, 0))
    wheels.stand(300 * MS, at_once=False)
    for ms in range(310, 400, 10):
        wheels.measure(ms * MS, (0.0, 0.0), (300, 0))
    assert board.words[-1] == (0, 0, 0, 0)
    wheels.stand(400 * MS, at_once=False)
    assert board.words[-1] == "release"


def test_a_wheel_that_turns_against_its_command_is_a_fault(board: Recorded) -> None:
    wheels = make(board)
    kinds: set[str] = set()
    for ms in range(0, 1500, 10):
        wheels.turn((0.3, 0.3))
        wheels.sent((300, 0, 300, 0), ms * MS)
        for fault in wheels.measure(ms * MS, (-0.4, 0.3), (-ms, ms)):
            kinds.add(fault.kind)
            assert fault.motor == "left"
    assert "runaway_against" in kinds


def test_no_wheel_is_held_against_a_command_that_was_not_sent(board: Recorded) -> None:
    wheels = make(board)
    wheels.sent((0, 0, 0, 0), 0)
    wheels.turn((0.3, 0.3))
    for ms in range(0, 1000, 10):
        assert wheels.measure(ms * MS, (0.0, 0.0), (0, 0)) == ()
    # A stop that goes before it is no motion either.
    wheels.sent((0, 0, 0, 0), 1000 * MS)
    for ms in range(1000, 2000, 10):
        assert wheels.measure(ms * MS, (0.0, 0.0), (0, 0)) == ()
    wheels.sent((300, 0, 300, 0), 2000 * MS)
    kinds = {
        fault.kind
        for ms in range(2000, 3000, 10)
        for fault in wheels.measure(ms * MS, (0.0, 0.0), (0, 0))
    }
    assert kinds == {"not_started"}


def test_wheels_without_a_board_are_accused_of_nothing(board: Recorded) -> None:
    wheels = make(board)
    wheels.turn((0.3, 0.3))
    wheels.detach()
    faults = [wheels.measure(ms * MS, (0.0, 0.0), (0, 0)) for ms in range(10, 600, 10)]
    assert not any(faults)
    assert wheels.measured_m_s == (0.0, 0.0)


@pytest.mark.parametrize("every_ms", [5, 6, 14, 20])
def test_however_often_a_board_streams_a_wheel_that_runs_away_is_found_as_soon(
    board: Recorded, every_ms: int
) -> None:
    wheels = make(board)
    wheels.turn((0.0, 0.0))
    wheels.sent((0, 0, 0, 0), 0)
    standing(wheels, 0, 1000)
    # 0.8 m/s, which is 5 counts a millisecond.
    for ms in range(1000, 1200, every_ms):
        ticks = 5 * (ms - 1000)
        if faults := wheels.measure(ms * MS, (0.8, 0.0), (ticks, 0), ms * MS):
            break
    assert [fault.kind for fault in faults] == ["runaway_fast"]
    assert ms <= 1150


def test_counts_between_two_judgements_are_judged_with_the_second(board: Recorded) -> None:
    wheels = make(board)
    seen: list[object] = []
    wheels.check.measure = lambda _ns, _speeds, ticks, **_: seen.append(ticks) or ()  # type: ignore[assignment, func-returns-value, misc]
    for n in range(1, 8):
        wheels.measure((1000 + n * 6) * MS, (0.2, 0.2), (n * n, -n))
    assert seen == [(0, 0), (15, -3), (33, -3)]


def test_a_setpoint_that_moves_no_wheel_is_known_after_two_seconds(board: Recorded) -> None:
    wheels = make(board)
    wheels.turn((0.01, 0.02))
    for ms in range(0, 1990, 10):
        # An encoder that rests on an edge flickers by a count.
        wheels.measure(ms * MS, (0.0, 0.0), (ms // 10 % 2, 0))
    assert wheels.unmoved_m_s == 0.0
    wheels.measure(2000 * MS, (0.0, 0.0), (0, 0))
    assert wheels.unmoved_m_s == 0.02
    wheels.measure(2010 * MS, (0.0, 0.0), (0, 500))
    wheels.measure(2020 * MS, (0.0, 0.0), (0, 500))
    assert wheels.unmoved_m_s == 0.0
    wheels.stand(2030 * MS, at_once=True)
    standing(wheels, 2040, 5000)
    assert wheels.unmoved_m_s == 0.0
