from __future__ import annotations

from typing import Any

import pytest
from msgspec import structs

from yahboomd.core.drive import standing
from yahboomd.core.drive.arbitration import Decision, Why
from yahboomd.core.drive.estop import Latched
from yahboomd.core.drive.holds import BOARD_RESET, FAULT, WAITING_FOR_BOARD, Hold
from yahboomd.core.drive.limiter import AxisCaps
from yahboomd.core.drive.standing import Situation, state_of, why
from yahboomd.core.model import Cause, Twist2d

S = 1_000_000_000
LATCHED = Latched(reason="button pressed", by="yahboomd/estop", since_ns=S)
DRIVING = Decision(twist=Twist2d(vx=0.5), driver="cmd_vel", why="driving", source="cmd_vel")
DRIVES = (Cause("driving", "cmd_vel drives."),)


def reasons(now_ns: int, **facts: Any) -> tuple[Cause, ...]:
    return standing.reasons(Situation(now_ns=now_ns, **facts))


def held(kind: str, until_ns: int | None = None) -> Hold:
    return Hold(kind=kind, message=f"{kind} it is.", since_ns=2 * S, until_ns=until_ns)


def test_a_robot_that_may_drive_has_no_reason_to_stand() -> None:
    assert reasons(S, decision=DRIVING, refused={"stale": 2}) == DRIVES


@pytest.mark.parametrize(
    ("why", "words"),
    [
        ("no_command", "cmd_vel drove and was lost 1.5 s ago: its client left the bus"),
        ("timed_out", "cmd_vel fell silent after its last command 1.5 s ago"),
        ("ended", "cmd_vel ended with a zero command 1.5 s ago"),
        ("revoked", "Held-up commands of cmd_vel"),
        ("zero_command", "cmd_vel commands zero"),
    ],
)
def test_every_way_of_having_no_motion_commanded_is_put_in_words(why: Why, words: str) -> None:
    decision = Decision(driver="cmd_vel", source="cmd_vel", age_ns=3 * S // 2, why=why)
    (found,) = reasons(5 * S, decision=decision)
    assert words in found.text


def test_the_emergency_stop_names_who_engaged_it_and_when() -> None:
    release = "yahboomd stop --release --namespace bot1"
    stopped, again = reasons(4 * S, decision=DRIVING, latched=LATCHED, release=release)
    assert again == Cause("release", f"To drive again: `{release}`.")
    assert stopped.kind == "estop"
    assert "yahboomd/estop 3.0 s ago: button pressed" in stopped.text


def test_all_reasons_are_given_those_for_a_person_first() -> None:
    found = reasons(
        4 * S,
        decision=Decision(),
        latched=LATCHED,
        holds=(held(WAITING_FOR_BOARD), held(FAULT)),
        refused={"stale": 3, "backlog": 190},
    )
    kinds = ["estop", FAULT, WAITING_FOR_BOARD, "release", "no_command", "refused"]
    assert [reason.kind for reason in found] == kinds, "how to go on is said once"
    assert "190 backlog, 3 stale" in found[-1].text


def test_wheels_that_may_turn_unseen_come_first_an_empty_battery_last() -> None:
    found = reasons(S, decision=DRIVING, unseen=True, battery="It is empty.")
    assert why(found) == (
        "The wheels may still turn: switch the motors' supply off. cmd_vel drives. It is empty."
    )


def test_a_hold_that_ends_by_itself_says_when() -> None:
    (found,) = reasons(5 * S // 2, decision=DRIVING, holds=(held(BOARD_RESET, 3 * S),))
    assert "since 0.5 s, for another 0.5 s" in found.text


def test_a_velocity_limit_of_zero_is_named() -> None:
    (found,) = reasons(S, decision=DRIVING, linear=AxisCaps(velocity=0.0))
    assert "limits.linear.velocity = 0" in found.text


def test_a_turn_that_a_limit_of_zero_forbids_is_named() -> None:
    decision = Decision(twist=Twist2d(wz=0.5), driver="cmd_vel", why="driving")
    (found,) = reasons(S, decision=decision, angular=AxisCaps(velocity=0.0))
    assert "limits.angular.velocity = 0" in found.text


def test_a_limit_of_zero_on_another_axis_is_no_reason() -> None:
    assert reasons(S, decision=DRIVING, angular=AxisCaps(velocity=0.0)) == DRIVES


def test_sideways_motion_on_a_base_that_cannot_is_named() -> None:
    decision = Decision(twist=Twist2d(vy=0.5), driver="cmd_vel", why="driving")
    (found,) = reasons(S, decision=decision, holonomic=False)
    assert "sideways" in found.text
    assert [each.kind for each in reasons(S, decision=decision)] == ["driving"]


@pytest.mark.parametrize(
    ("expected", "decision", "latched", "holds", "in_motion"),
    [
        ("standing", Decision(), None, (), False),
        ("driving", DRIVING, None, (), True),
        ("standing", DRIVING, None, (), False),
        ("stopping", Decision(), None, (), True),
        ("standing", DRIVING, None, (held(BOARD_RESET),), False),
        ("stopping", DRIVING, None, (held(BOARD_RESET),), True),
        ("waiting", DRIVING, None, (held(WAITING_FOR_BOARD),), False),
        ("fault", DRIVING, None, (held(WAITING_FOR_BOARD), held(FAULT)), True),
        ("estopped", DRIVING, LATCHED, (held(FAULT),), True),
    ],
)
def test_the_state_is_the_one_that_most_needs_a_person(
    expected: str,
    decision: Decision,
    latched: Latched | None,
    holds: tuple[Hold, ...],
    in_motion: bool,
) -> None:
    now = Situation(now_ns=S, decision=decision, latched=latched, holds=holds, in_motion=in_motion)
    assert state_of(now) == expected


def test_people_read_of_the_page_and_not_of_its_key() -> None:
    decision = Decision(source="cmd_vel/web", age_ns=S, why="timed_out")
    (found,) = reasons(5 * S, decision=decision)
    assert found.text.startswith("The page fell silent")


def test_limits_that_leave_a_crawl_are_named_unless_another_axis_moves_as_wished() -> None:
    crawl = AxisCaps(velocity=0.001)
    (found,) = reasons(S, decision=DRIVING, linear=crawl)
    assert "limits.linear.velocity = 0.001" in found.text
    (found,) = reasons(S, decision=DRIVING, linear=AxisCaps(velocity=1.0, acceleration=0.002))
    assert "limits.linear.acceleration = 0.002" in found.text
    turning = structs.replace(DRIVING, twist=Twist2d(vx=0.3, wz=1.0))
    assert reasons(S, decision=turning, linear=crawl) == DRIVES
    (found,) = reasons(S, decision=turning, linear=crawl, angular=AxisCaps(velocity=0.01))
    assert "limits.angular.velocity = 0.01" in found.text
    # Who commands a crawl gets one.
    slow = structs.replace(DRIVING, twist=Twist2d(vx=0.001))
    assert reasons(S, decision=slow, linear=crawl) == DRIVES


def test_a_turn_on_the_spot_of_a_car_names_what_it_can_do() -> None:
    turn = structs.replace(DRIVING, twist=Twist2d(wz=0.5))
    (found,) = reasons(S, decision=turn, holonomic=False, least_radius_m=0.354)
    assert found.kind == "cannot"
    assert "on the spot, which a car cannot do. Command vx with it" in found.text
    assert "radius of 0.35 m" in found.text


def test_wheels_that_a_slow_command_does_not_move_are_named_with_a_speed_that_does() -> None:
    slow = {"decision": DRIVING, "unmoved_m_s": 0.01, "least_m_s": 0.08}
    (found,) = reasons(S, in_motion=True, **slow)
    assert found.kind == "cannot"
    assert "0.01 m/s, and none has moved in 2 s" in found.text
    assert "Command 0.08 m/s or more" in found.text
    assert reasons(S, in_motion=False, **slow) == DRIVES


def test_what_is_wrong_with_commands_comes_before_the_one_in_effect() -> None:
    shaken = Cause("two_programs", "Two programs.")
    zero = Decision(driver="cmd_vel", why="zero_command")
    kinds = [each.kind for each in reasons(S, decision=zero, commands=(shaken,))]
    assert kinds == ["two_programs", "zero_command"]
