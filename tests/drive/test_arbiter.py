from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.arbiter import Arbiter
from yahboomd.core.drive.arbitration import AllowedSource, CommandRefused
from yahboomd.core.model import STANDSTILL, Twist2d

MS = 1_000_000
S = 1000 * MS
HOUR = 3600 * S
EPOCH_NS = 1_700_000_000 * S
FORWARD = Twist2d(vx=0.5)
SLOWER = Twist2d(vx=0.2)


@pytest.fixture
def arbiter(sources: tuple[AllowedSource, ...]) -> Arbiter:
    return Arbiter(sources)


def reason(result: CommandRefused | None) -> str | None:
    return result.reason if isinstance(result, CommandRefused) else None


def stand(arbiter: Arbiter, now_ns: int) -> None:
    arbiter.observe_wheels(now_ns, commanded_zero=True, measured_m_s=(0.0, 0.01))


def test_before_the_first_command_no_source_drives(arbiter: Arbiter) -> None:
    decision = arbiter.current(5)
    assert (decision.twist, decision.driver, decision.why) == (STANDSTILL, None, "no_command")


def test_a_single_command_is_in_effect_at_once(arbiter: Arbiter) -> None:
    assert arbiter.offer("cmd_vel", FORWARD, 7 * S) is None
    decision = arbiter.current(7 * S)
    assert (decision.twist, decision.driver, decision.since_ns) == (FORWARD, "cmd_vel", 7 * S)
    assert arbiter.counters["accepted"] == 1


def test_a_command_runs_out_after_its_sources_timeout(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel", FORWARD, S)
    assert arbiter.deadline_ns == S + 500 * MS
    assert arbiter.current(S + 500 * MS - 1).twist == FORWARD
    silent = arbiter.current(S + 500 * MS)
    assert (silent.twist, silent.why) == (STANDSTILL, "timed_out")
    assert (silent.source, silent.age_ns) == ("cmd_vel", 500 * MS)
    arbiter.current(S + 600 * MS)
    assert arbiter.counters["timed_out"] == 1


def test_a_source_that_ended_with_a_zero_command_did_not_fall_silent(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel", FORWARD, S)
    arbiter.offer("cmd_vel", STANDSTILL, S + 100 * MS)
    for later_ns in (600 * MS, 700 * MS):
        ended = arbiter.current(S + later_ns)
        assert (ended.twist, ended.why) == (STANDSTILL, "ended")
        stand(arbiter, S + later_ns)
    assert (ended.source, ended.age_ns) == ("cmd_vel", 600 * MS)
    assert arbiter.counters["timed_out"] == 0


@pytest.mark.parametrize(("on_timeout", "ramp"), [("ramp", True), ("halt", False)])
def test_silence_ramps_or_halts_as_configured(
    sources: tuple[AllowedSource, ...], on_timeout: str, ramp: bool
) -> None:
    arbiter = Arbiter(sources, on_timeout="ramp" if on_timeout == "ramp" else "halt")
    arbiter.offer("cmd_vel", FORWARD, 0)
    assert arbiter.current(0).ramp
    assert arbiter.current(S).ramp is ramp


def test_the_larger_priority_takes_over_at_once(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel", FORWARD, 0)
    taken = arbiter.offer("cmd_vel/teleop", SLOWER, MS)
    assert taken is None
    assert reason(arbiter.offer("cmd_vel", FORWARD, 2 * MS)) == "lower_priority"
    assert arbiter.current(2 * MS).twist == SLOWER
    assert arbiter.current(2 * MS).driver == "cmd_vel/teleop"


def test_among_equals_the_source_in_control_keeps_it(arbiter: Arbiter) -> None:
    arbiter.offer("planner", FORWARD, 0)
    assert reason(arbiter.offer("cmd_vel", SLOWER, MS)) == "lower_priority"
    assert arbiter.current(MS).driver == "planner"


def test_a_zero_command_holds_control_too(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel/teleop", STANDSTILL, 0)
    stand(arbiter, 100 * MS)
    assert reason(arbiter.offer("cmd_vel", FORWARD, 200 * MS)) == "lower_priority"
    decision = arbiter.current(200 * MS)
    assert (decision.why, decision.driver) == ("zero_command", "cmd_vel/teleop")


@pytest.mark.parametrize("follower", ["cmd_vel", "planner"])
def test_control_passes_down_only_from_standstill(arbiter: Arbiter, follower: str) -> None:
    arbiter.offer("planner" if follower == "cmd_vel" else "cmd_vel/teleop", FORWARD, 0)
    assert reason(arbiter.offer(follower, SLOWER, 600 * MS)) == "not_standing"
    arbiter.observe_wheels(610 * MS, commanded_zero=False, measured_m_s=(0.0, 0.0))
    assert reason(arbiter.offer(follower, SLOWER, 611 * MS)) == "not_standing"
    arbiter.observe_wheels(620 * MS, commanded_zero=True, measured_m_s=(0.0, -0.03))
    assert reason(arbiter.offer(follower, SLOWER, 621 * MS)) == "not_standing"
    arbiter.observe_wheels(630 * MS, commanded_zero=True, measured_m_s=None)
    assert reason(arbiter.offer(follower, SLOWER, 631 * MS)) == "not_standing"
    arbiter.observe_wheels(640 * MS, commanded_zero=True, measured_m_s=(0.029, -0.029))
    assert arbiter.current(640 * MS).twist == STANDSTILL
    assert arbiter.offer(follower, SLOWER, 641 * MS) is None
    assert arbiter.current(641 * MS).driver == follower


def test_standstill_under_a_live_command_does_not_free_control(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel/teleop", FORWARD, 0)
    stand(arbiter, 100 * MS)
    assert arbiter.current(100 * MS).driver == "cmd_vel/teleop"


def test_a_command_given_before_the_wheels_stood_does_not_take_control(
    sources: tuple[AllowedSource, ...],
) -> None:
    arbiter = Arbiter(sources, stamps="absolute")
    arbiter.offer("cmd_vel/teleop", FORWARD, S, S, stamp_is_message=True)
    stand(arbiter, 2 * S)
    late = arbiter.offer("cmd_vel", SLOWER, 2 * S + 50 * MS, 2 * S - 1, stamp_is_message=True)
    assert reason(late) == "not_standing"
    newer = arbiter.offer("cmd_vel", SLOWER, 2 * S + 60 * MS, 2 * S, stamp_is_message=True)
    assert newer is None


def test_the_holder_goes_on_after_its_own_silence(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel", FORWARD, 0)
    assert arbiter.current(S).why == "timed_out"
    assert arbiter.offer("cmd_vel", SLOWER, S) is None
    assert arbiter.current(S).twist == SLOWER
    assert arbiter.current(S).since_ns == 0


@pytest.mark.parametrize(
    ("twist", "left_ns", "named"),
    [(FORWARD, S, "cmd_vel"), (STANDSTILL, S, None), (FORWARD, 2 * S, None)],
    ids=["it drove", "it stood", "its command was over"],
)
def test_after_the_last_client_left_the_one_that_drove_is_named(
    arbiter: Arbiter, twist: Twist2d, left_ns: int, named: str | None
) -> None:
    arbiter.offer("cmd_vel", twist, S - MS)
    arbiter.forget_commands(left_ns, clients_left=True)
    decision = arbiter.current(left_ns + MS)
    assert (decision.twist, decision.why) == (STANDSTILL, "no_command")
    assert (decision.source, decision.age_ns) == (named, MS if named else None)


def test_a_freed_robot_says_since_when_and_who_was_last(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel", FORWARD, 0)
    stand(arbiter, 2 * S)
    decision = arbiter.current(3 * S)
    assert (decision.driver, decision.since_ns, decision.source) == (None, 2 * S, "cmd_vel")
    assert decision.why == "timed_out"


def test_a_backlog_of_200_old_commands_in_4_ms_after_a_stall_moves_nothing(
    arbiter: Arbiter,
) -> None:
    arbiter.offer("cmd_vel", FORWARD, 0)
    stand(arbiter, 2 * S)
    results = [arbiter.offer("cmd_vel", FORWARD, 5 * S + n * 20_000) for n in range(200)]
    assert [reason(result) for result in results[5:]] == ["backlog"] * 195
    # The five before the sixth looked like any others. The sixth takes them back, 0.1 ms later.
    assert arbiter.counters["revoked"] == 1
    for now_ns in range(5 * S + 100_000, 6 * S, 10 * MS):
        decision = arbiter.current(now_ns)
        assert (decision.twist, decision.ramp, decision.why) == (STANDSTILL, False, "revoked")
    assert arbiter.current(5 * S + MS).driver is None
    assert arbiter.counters["revoked"] == 1


def test_a_backlog_handed_over_in_one_piece_is_never_in_effect(arbiter: Arbiter) -> None:
    result = arbiter.offer("cmd_vel", FORWARD, 5 * S, arrivals=200)
    assert reason(result) == "backlog"
    assert arbiter.current(5 * S).twist == STANDSTILL


def test_a_backlog_stamped_on_arrival_is_a_backlog_all_the_same(arbiter: Arbiter) -> None:
    results = [
        arbiter.offer("cmd_vel", FORWARD, now_ns, EPOCH_NS + now_ns)
        for now_ns in range(5 * S, 5 * S + 4 * MS, 20_000)
    ]
    assert reason(results[-1]) == "backlog"
    assert arbiter.current(5 * S + 4 * MS).twist == STANDSTILL


@pytest.mark.parametrize("seen_before", [True, False])
def test_a_backlog_that_its_sender_stamped_moves_nothing(
    arbiter: Arbiter, seen_before: bool
) -> None:
    if seen_before:
        for now_ns in range(0, S, 20 * MS):
            arbiter.offer("cmd_vel", SLOWER, now_ns, EPOCH_NS + now_ns, stamp_is_message=True)
        stand(arbiter, 2 * S)
    # Given at 50 Hz from second 1 to 5, delivered at second 6.
    for n in range(200):
        now_ns, given_ns = 6 * S + n * 20_000, S + n * 20 * MS
        arbiter.offer("cmd_vel", FORWARD, now_ns, EPOCH_NS + given_ns, stamp_is_message=True)
        if seen_before:
            assert arbiter.current(now_ns).twist == STANDSTILL
    assert arbiter.current(6 * S + 4 * MS).twist == STANDSTILL
    live = 6 * S + 60 * MS
    fresh = arbiter.offer("cmd_vel", FORWARD, live, EPOCH_NS + live, stamp_is_message=True)
    assert fresh is None


def test_the_driver_before_a_backlog_drives_on_after_it(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel", SLOWER, 0)
    for n in range(20):
        arbiter.offer("cmd_vel/teleop", FORWARD, 10 * MS + n * 1000)
    decision = arbiter.current(11 * MS)
    assert (decision.driver, decision.twist, decision.since_ns) == ("cmd_vel", SLOWER, 0)


def test_a_backlog_of_a_source_that_does_not_drive_revokes_nothing(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel/teleop", FORWARD, 0)
    for n in range(20):
        result = arbiter.offer("cmd_vel", SLOWER, 10 * MS + n * 1000)
    assert reason(result) == "backlog"
    assert arbiter.counters["revoked"] == 0
    assert arbiter.current(11 * MS).twist == FORWARD


def test_a_driver_interrupted_by_a_backlog_goes_on_with_its_newest_wish(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel", FORWARD, 0)
    for n in range(5):
        arbiter.offer("cmd_vel/teleop", FORWARD, 10 * MS + n * 1000)
    assert reason(arbiter.offer("cmd_vel", STANDSTILL, 11 * MS)) == "lower_priority"
    arbiter.offer("cmd_vel/teleop", FORWARD, 12 * MS)
    decision = arbiter.current(12 * MS)
    assert (decision.driver, decision.why) == ("cmd_vel", "zero_command")


def test_live_commands_after_a_backlog_drive(arbiter: Arbiter) -> None:
    for n in range(200):
        arbiter.offer("cmd_vel", FORWARD, n * 20_000)
    assert arbiter.offer("cmd_vel", SLOWER, 30 * MS) is None
    assert arbiter.current(30 * MS).twist == SLOWER


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["vx", "vy", "wz"])
def test_a_velocity_that_is_not_finite_is_refused(
    arbiter: Arbiter, value: float, field: str
) -> None:
    arbiter.offer("cmd_vel", FORWARD, 0)
    assert reason(arbiter.offer("cmd_vel", Twist2d(**{field: value}), MS)) == "not_finite"
    assert arbiter.current(MS).twist == FORWARD
    assert arbiter.counters["not_finite"] == 1


@pytest.mark.parametrize("field", ["vx", "vy", "wz"])
def test_a_velocity_out_of_all_proportion_is_refused_and_not_limited(
    arbiter: Arbiter, field: str
) -> None:
    arbiter.offer("cmd_vel", FORWARD, 0)
    most = 1000.0 if field == "wz" else 100.0
    for value in (1e39, -1e39, 1e308, most * 1.001):
        assert reason(arbiter.offer("cmd_vel", Twist2d(**{field: value}), MS)) == "too_fast"
    assert arbiter.current(MS).twist == FORWARD
    assert arbiter.counters["too_fast"] == 4
    assert arbiter.offer("cmd_vel", Twist2d(**{field: most}), MS) is None


def test_a_source_that_is_not_configured_is_refused(arbiter: Arbiter) -> None:
    assert reason(arbiter.offer("stranger", FORWARD, 0)) == "unknown_source"
    assert arbiter.current(0).driver is None


def test_a_stale_command_neither_drives_nor_keeps_alive(arbiter: Arbiter) -> None:
    for now_ns in range(0, S, 20 * MS):
        arbiter.offer("cmd_vel", FORWARD, now_ns, EPOCH_NS + now_ns, stamp_is_message=True)
    late = arbiter.offer("cmd_vel", FORWARD, 1600 * MS, EPOCH_NS + S, stamp_is_message=True)
    assert reason(late) == "stale"
    assert arbiter.current(1600 * MS).why == "timed_out"


def test_a_command_that_was_under_way_is_good_for_the_rest_of_its_time(arbiter: Arbiter) -> None:
    for now_ns in range(0, S, 20 * MS):
        arbiter.offer("cmd_vel", FORWARD, now_ns, EPOCH_NS + now_ns, stamp_is_message=True)
    arbiter.offer("cmd_vel", FORWARD, 1300 * MS, EPOCH_NS + S, stamp_is_message=True)
    assert arbiter.deadline_ns == 1500 * MS


@pytest.mark.parametrize("by_sender", [True, False])
def test_a_stamp_is_the_transports_unless_it_is_said_to_be_the_senders(
    sources: tuple[AllowedSource, ...], by_sender: bool
) -> None:
    arbiter = Arbiter(sources)
    kinds = {"stamp_is_message": True} if by_sender else {}
    for n in range(10):
        arbiter.offer("cmd_vel", SLOWER, S + n * 100 * MS, S + n * 100 * MS, **kinds)
    arbiter.paused(2 * S, 3 * S, waited_ns=S)
    # Only the sender's own stamp shows that a command did not wait.
    found = arbiter.offer("cmd_vel", FORWARD, 3 * S + MS, 3 * S + MS, **kinds)
    assert reason(found) == (None if by_sender else "after_pause")


@pytest.mark.parametrize(
    ("at_ns", "refused"),
    [(2 * S, None), (2 * S + 1, "after_pause"), (4 * S, "after_pause"), (4 * S + 1, None)],
)
def test_what_may_have_waited_during_a_pause_is_refused(
    arbiter: Arbiter, at_ns: int, refused: str | None
) -> None:
    arbiter.paused(2 * S, 3 * S, waited_ns=S)
    assert reason(arbiter.offer("cmd_vel", FORWARD, at_ns)) == refused


def test_refusals_are_counted_by_reason_and_remembered_for_a_while(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel/teleop", FORWARD, 0)
    for n in range(3):
        arbiter.offer("cmd_vel", FORWARD, n * 10 * MS)
    assert arbiter.counters["lower_priority"] == 3
    assert arbiter.recent_refusals(S) == {"lower_priority": 3}
    assert arbiter.recent_refusals(5 * S) == {}
    arbiter.note_refusal(5 * S, "not_finite")
    assert arbiter.recent_refusals(6 * S) == {"not_finite": 1}


def test_who_commands_motion_is_known_even_where_it_has_no_effect(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel/teleop", STANDSTILL, 0)
    arbiter.offer("cmd_vel", FORWARD, 0)
    assert arbiter.moving_sources(MS) == ("cmd_vel",)
    assert arbiter.moving_sources(S) == ()


def refused_as_lower_priority(arbiter: Arbiter, now_ns: int) -> None:
    arbiter.offer("cmd_vel/teleop", STANDSTILL, now_ns)
    assert reason(arbiter.offer("cmd_vel", FORWARD, now_ns)) == "lower_priority"


def refused_as_backlog(arbiter: Arbiter, now_ns: int) -> None:
    for _ in range(8):
        refused = arbiter.offer("cmd_vel", FORWARD, now_ns)
    assert reason(refused) == "backlog"


def refused_as_out_of_order(arbiter: Arbiter, now_ns: int) -> None:
    arbiter.offer("cmd_vel", STANDSTILL, now_ns, EPOCH_NS, stamp_is_message=True)
    late = arbiter.offer("cmd_vel", FORWARD, now_ns, EPOCH_NS - 1, stamp_is_message=True)
    assert reason(late) == "out_of_order"


def refused_as_stale(arbiter: Arbiter, now_ns: int) -> None:
    arbiter.offer("cmd_vel", STANDSTILL, now_ns - S, EPOCH_NS, stamp_is_message=True)
    late = arbiter.offer("cmd_vel", FORWARD, now_ns, EPOCH_NS + 1, stamp_is_message=True)
    assert reason(late) == "stale"


def forgotten(arbiter: Arbiter, now_ns: int) -> None:
    arbiter.offer("cmd_vel", FORWARD, now_ns)
    arbiter.forget_commands(now_ns)


def followed_by_zero(arbiter: Arbiter, now_ns: int) -> None:
    arbiter.offer("cmd_vel", FORWARD, now_ns)
    arbiter.offer("cmd_vel", STANDSTILL, now_ns)


def lost_unread(arbiter: Arbiter, now_ns: int) -> None:
    arbiter.note_motion("cmd_vel", now_ns)


@pytest.mark.parametrize(
    "command",
    [
        refused_as_lower_priority,
        refused_as_backlog,
        refused_as_out_of_order,
        refused_as_stale,
        forgotten,
        followed_by_zero,
        lost_unread,
    ],
)
def test_a_source_commands_motion_for_a_second_after_any_command_that_asks_for_it(
    arbiter: Arbiter, command: Callable[[Arbiter, int], None]
) -> None:
    command(arbiter, 5 * S)
    assert arbiter.moving_sources(6 * S - 1) == ("cmd_vel",)
    assert arbiter.moving_sources(6 * S) == ()


def test_who_commanded_motion_before_a_pause_may_command_it_for_a_second_after_it(
    arbiter: Arbiter,
) -> None:
    arbiter.offer("cmd_vel", FORWARD, S)
    arbiter.paused(S + 100 * MS, 60 * S, waited_ns=0)
    assert arbiter.moving_sources(61 * S - 1) == ("cmd_vel",)
    assert arbiter.moving_sources(61 * S) == ()


def test_a_source_that_commands_zero_commands_no_motion(arbiter: Arbiter) -> None:
    for n in range(100):
        arbiter.offer("cmd_vel", STANDSTILL, n * MS)
    assert arbiter.moving_sources(100 * MS) == ()


@pytest.mark.parametrize("copies", [2, 8, 32])
def test_copies_that_carry_one_stamp_are_one_command_and_drive_from_the_first(
    arbiter: Arbiter, copies: int
) -> None:
    for now_ns in range(5 * S, 8 * S, 50 * MS):
        for copy in range(copies):
            taken = arbiter.offer(
                "cmd_vel", FORWARD, now_ns + copy * 50_000, EPOCH_NS + now_ns, stamp_is_message=True
            )
            assert taken is None
    assert arbiter.counters["revoked"] == 0


def test_a_backlog_of_copies_moves_nothing(arbiter: Arbiter) -> None:
    # Given at 50 Hz from second 1 to 5, each passed on eight times, delivered at second 6.
    for n in range(200):
        for copy in range(8):
            now_ns, given_ns = 6 * S + n * 20_000 + copy * 1000, S + n * 20 * MS
            arbiter.offer("cmd_vel", FORWARD, now_ns, EPOCH_NS + given_ns, stamp_is_message=True)
    assert arbiter.current(6 * S + 4 * MS).twist == STANDSTILL


@pytest.mark.parametrize("copies", [8, 16, 32])
@pytest.mark.parametrize("rate_hz", [10, 20, 50])
def test_copies_without_a_stamp_drive_after_the_first_timeout(
    arbiter: Arbiter, copies: int, rate_hz: int
) -> None:
    verdicts = []
    for n in range(5 * rate_hz):
        for copy in range(copies):
            now_ns = 5 * S + n * S // rate_hz + copy * 100_000
            verdicts.append((now_ns, arbiter.offer("cmd_vel", FORWARD, now_ns)))
    later = [taken for now_ns, taken in verdicts if now_ns > 5 * S + 650 * MS]
    assert all(taken is None for taken in later)


def test_forgotten_commands_move_nothing_and_anybody_may_take_over(arbiter: Arbiter) -> None:
    arbiter.offer("cmd_vel/teleop", FORWARD, 0)
    arbiter.forget_commands(MS)
    assert arbiter.current(MS).twist == STANDSTILL
    assert arbiter.offer("cmd_vel", SLOWER, 2 * MS) is None


STEP = st.tuples(
    st.sampled_from(["offer", "offer", "offer", "stand", "look"]),
    st.sampled_from(["cmd_vel", "planner", "cmd_vel/teleop"]),
    st.integers(0, 400 * MS) | st.integers(0, 100_000),
    st.sampled_from([FORWARD, SLOWER, STANDSTILL]),
    st.none() | st.integers(-S, S),
    st.booleans(),
)


@given(st.lists(STEP, max_size=60), st.sampled_from(["relative", "absolute", "ignore"]))
def test_motion_always_has_a_driver_whose_accepted_command_is_fresh(
    steps: list[tuple[str, str, int, Twist2d, int | None, bool]], stamps: str
) -> None:
    timeouts = {"cmd_vel": 500 * MS, "planner": 500 * MS, "cmd_vel/teleop": 300 * MS}
    ranks = {"cmd_vel": 10, "planner": 10, "cmd_vel/teleop": 100}
    arbiter = Arbiter(
        [
            AllowedSource(name=name, priority=ranks[name], timeout_s=timeout / S)
            for name, timeout in timeouts.items()
        ],
        stamps="relative"
        if stamps == "relative"
        else "absolute"
        if stamps == "absolute"
        else "ignore",
    )
    accepted: dict[str, tuple[int, Twist2d]] = {}
    now_ns = 10 * S
    driver: str | None = None
    stood = True
    for what, source, step_ns, twist, offset_ns, by_sender in steps:
        now_ns += step_ns
        live = arbiter.current(now_ns)
        if what == "offer":
            stamp_ns = None if offset_ns is None else now_ns + offset_ns
            revoked = arbiter.counters["revoked"]
            result = arbiter.offer(source, twist, now_ns, stamp_ns, by_sender)
            if result is None:
                accepted[source] = (now_ns - (arbiter.current(now_ns).age_ns or 0), twist)
            elif result.reason == "lower_priority":
                # In effect after all, if the source in control loses it as a backlog.
                accepted[source] = (now_ns, twist)
        elif what == "stand":
            stand(arbiter, now_ns)
            stood = True
        decision = arbiter.current(now_ns)
        if not decision.twist.is_zero:
            assert decision.driver is not None
            given_ns, wish = accepted[decision.driver]
            assert decision.twist == wish
            assert now_ns - given_ns < timeouts[decision.driver]
        if what == "offer" and arbiter.counters["revoked"] != revoked:
            # The driver before the backlog, or None.
            driver = decision.driver
        if decision.driver != driver and driver and decision.driver:
            # Without standing first, control only ever went up.
            assert stood or ranks[decision.driver] > ranks[driver]
        if decision.driver is not None:
            driver = decision.driver
            if not decision.twist.is_zero or not live.twist.is_zero:
                stood = False


def drive_with_a_clock_off(arbiter: Arbiter, ahead_ns: int) -> list[CommandRefused | None]:
    """A second of stamped commands at 20 Hz; each arrives after 5 ms."""
    return [
        arbiter.offer(
            "cmd_vel",
            FORWARD,
            now_ns,
            EPOCH_NS + now_ns - 5 * MS + ahead_ns,
            stamp_is_message=True,
            wall_ns=EPOCH_NS + now_ns,
        )
        for now_ns in range(S, 2 * S + 1, 50 * MS)
    ]


@pytest.mark.parametrize("ahead_ns", [3 * S, -3 * S, 5 * HOUR, -5 * HOUR, -EPOCH_NS + 60 * S])
def test_a_clock_that_is_off_drives_and_is_named(
    sources: tuple[AllowedSource, ...], ahead_ns: int
) -> None:
    arbiter = Arbiter(sources, stamps="relative")
    verdicts = drive_with_a_clock_off(arbiter, ahead_ns)
    assert all(verdict is None for verdict in verdicts)
    assert set(arbiter.clock_warnings(2 * S)) == {"cmd_vel"}
    assert arbiter.clock_offsets_s(2 * S)["cmd_vel"] == pytest.approx(ahead_ns / 1e9 - 0.005)


@pytest.mark.parametrize("ahead_ns", [3 * S, -3 * S, 5 * HOUR, -5 * HOUR])
def test_a_clock_that_is_off_is_named_where_it_is_refused(
    sources: tuple[AllowedSource, ...], ahead_ns: int
) -> None:
    arbiter = Arbiter(sources, stamps="absolute")
    verdicts = drive_with_a_clock_off(arbiter, ahead_ns)
    assert all(isinstance(verdict, CommandRefused) for verdict in verdicts)
    words = arbiter.clock_warnings(2 * S)["cmd_vel"]
    assert f"{abs(ahead_ns / 1e9 - 0.005):.2f} s" in words
    assert "All its commands are refused" in words
    assert {reason(verdict) for verdict in verdicts} == {
        "from_the_future" if ahead_ns > 0 else "stale"
    }


@pytest.mark.parametrize("stamps", ["relative", "absolute"])
def test_clocks_that_agree_are_not_warned_of(
    sources: tuple[AllowedSource, ...], stamps: str
) -> None:
    arbiter = Arbiter(sources, stamps="relative" if stamps == "relative" else "absolute")
    verdicts = drive_with_a_clock_off(arbiter, 0)
    assert all(verdict is None for verdict in verdicts)
    assert arbiter.clock_warnings(2 * S) == {}


def test_a_backlog_of_a_clock_that_is_off_is_refused_all_the_same(
    sources: tuple[AllowedSource, ...],
) -> None:
    arbiter = Arbiter(sources, stamps="relative")
    drive_with_a_clock_off(arbiter, -3 * S)
    late = arbiter.offer(
        "cmd_vel",
        FORWARD,
        4 * S,
        EPOCH_NS + 2 * S + 50 * MS - 3 * S,
        stamp_is_message=True,
        wall_ns=EPOCH_NS + 4 * S,
    )
    assert reason(late) == "stale"
