from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.counts import HALF, WRAP
from yahboomd.core.odometry.encoders import Encoders

MS = 1_000_000
int32 = st.integers(-HALF, HALF - 1)


def wrapped(value):
    return (value + HALF) % WRAP - HALF


@pytest.fixture
def encoders(kit):
    return Encoders(kit.motors(), speed_max_m_s=2.0)


def feed(encoders, ticks, sent_ms, elapsed_ms):
    verdict = encoders.judge((*ticks, 0, 0), sent_ms * MS, elapsed_ms * MS)
    if verdict.outcome != "held":
        encoders.accept(verdict)
    return verdict.outcome


def test_the_first_reading_is_no_motion(encoders):
    assert feed(encoders, (123456, -99), 0, 0) == "baseline"
    assert encoders.totals == (0, 0)


def test_the_wrap_of_the_board_is_a_small_step(encoders):
    feed(encoders, (2147483627, -2147483640), 0, 0)
    assert feed(encoders, (-2147483636, 2147483640), 10, 10) == "travel"
    assert encoders.totals == (33, -16)


@given(start=int32, changes=st.lists(st.integers(-9, 9), max_size=40))
def test_totals_are_the_sum_of_the_steps_wherever_counting_starts(kit, start, changes):
    encoders = Encoders(kit.motors(), speed_max_m_s=2.0)
    feed(encoders, (start, start), 0, 0)
    # A wheel gains or loses up to 14 m/s in a second: more than its tyre holds.
    raw, step = start, 0
    for index, change in enumerate(changes):
        step = max(-70, min(70, step + change))
        raw += step
        assert feed(encoders, (wrapped(raw), start), 10 * index, 10) == "travel"
    assert encoders.totals == (raw - start, 0)


@pytest.mark.parametrize("way", [1, -1])
def test_a_wheel_that_is_blocked_or_let_go_is_believed_one_reading_later(encoders, way):
    def rolled(left, right, sent_ms, elapsed_ms):
        return feed(encoders, (3_000_000 + way * left, way * right), sent_ms, elapsed_ms)

    rolled(0, 0, 0, 0)
    for n in range(1, 6):
        assert rolled(120 * n, 120 * n, 20 * n, 20) == "travel"
    assert rolled(605, 720, 120, 20) == "held"
    assert rolled(605, 840, 140, 40) == "travel"
    for n in range(3, 7):
        assert rolled(605, 600 + 120 * n, 100 + 20 * n, 20) == "travel"
    assert rolled(705, 1440, 240, 20) == "held"
    assert rolled(805, 1560, 260, 40) == "travel"
    assert encoders.totals == (way * 805, way * 1560)


def test_after_a_gap_that_took_no_time_nothing_is_witnessed(encoders):
    feed(encoders, (1000, 1000), 0, 0)
    assert feed(encoders, (1120, 1120), 20, 20) == "travel"
    encoders.announce("silence")
    assert [feed(encoders, (1240, 1240), 20, 0) for _ in range(2)] == ["held", "held"]


@pytest.mark.parametrize("period_ms", [10, 20])
@pytest.mark.parametrize("wrong", [80, -100, 200, 400])
def test_a_digit_that_is_wrong_for_one_reading_is_never_counted(encoders, period_ms, wrong):
    raw, step = 3_000_000, 3 * period_ms
    feed(encoders, (raw, raw), 0, 0)
    for n in range(1, 6):
        raw += step
        assert feed(encoders, (raw, raw), period_ms * n, period_ms) == "travel"
    raw += step
    assert feed(encoders, (raw + wrong, raw), period_ms * 6, period_ms) == "held"
    raw += step
    assert feed(encoders, (raw, raw), period_ms * 7, 2 * period_ms) == "travel"
    assert encoders.totals == (7 * step, 7 * step)


def test_two_digits_that_are_wrong_one_after_the_other_do_not_witness_each_other(encoders):
    raw = 3_000_000
    feed(encoders, (raw, raw), 0, 0)
    for n in range(1, 6):
        raw += 40
        assert feed(encoders, (raw, raw), 20 * n, 20) == "travel"
    # The wheel could have rolled from each to the next, but not so evenly.
    assert feed(encoders, (raw + 240, raw + 40), 120, 20) == "held"
    assert feed(encoders, (raw + 180, raw + 80), 140, 40) == "held"
    assert feed(encoders, (raw + 120, raw + 120), 160, 60) == "travel"
    assert encoders.totals == (320, 320)


def test_a_garbled_reading_that_was_believed_does_not_tell_where_the_wheel_is_heading(encoders):
    raw = 3_000_000
    feed(encoders, (raw, raw), 0, 0)
    for n in range(1, 6):
        raw += 10
        assert feed(encoders, (raw, raw), 10 * n, 10) == "travel"
    # Too little to be distinguished from travel.
    assert feed(encoders, (raw + 10 + 20, raw + 10), 60, 10) == "travel"
    for n in range(2, 6):
        assert feed(encoders, (raw + 10 * n, raw + 10 * n), 50 + 10 * n, 10) == "travel"
    assert encoders.totals == (100, 100)


def test_a_reversed_encoder_counts_forward(kit):
    encoders = Encoders(kit.motors(signs=(1, -1), positions=(1, 3)), speed_max_m_s=2.0)
    encoders.accept(encoders.judge((0, 7, 0, 7), 0, 0.0))
    encoders.accept(encoders.judge((10, 999, -10, 999), 10 * MS, 10 * MS))
    assert encoders.totals == (10, 10)


def test_the_limit_is_the_speed_times_the_time_and_one_tick(encoders, kit):
    most = int(2.0 * 0.010 / kit.tick_m) + 1
    feed(encoders, (0, 0), 0, 0)
    assert feed(encoders, (most + 1, 0), 10, 10) == "held"
    assert feed(encoders, (most, 0), 10, 10) == "travel"


def test_one_garbled_reading_is_as_if_it_had_not_come(encoders):
    feed(encoders, (5000, 5000), 0, 0)
    assert feed(encoders, (50, 5010), 10, 10) == "held"
    assert feed(encoders, (5020, 5020), 20, 20) == "travel"
    assert encoders.totals == (20, 20)


def test_the_same_digit_lost_four_times_in_a_row_is_not_believed(encoders):
    feed(encoders, (51_234, 51_234), 0, 0)
    for n in range(1, 5):
        assert feed(encoders, (5_123 + n, 51_234 + 30 * n), 10 * n, 10 * n) == "held"
    assert feed(encoders, (51_384, 51_384), 50, 50) == "travel"
    assert encoders.totals == (150, 150)


def test_garbage_that_differs_every_time_is_never_believed(encoders):
    feed(encoders, (5000, 5000), 0, 0)
    for n in range(1, 30):
        assert feed(encoders, (10**6 * n, -(10**5) * n), 10 * n, 10 * n) == "held"
    assert feed(encoders, (5300, 5300), 300, 300) == "held"
    assert feed(encoders, (5310, 5310), 310, 310) == "travel"
    assert encoders.totals == (310, 310)


def test_a_jump_that_stays_rebases_and_counts_nothing(encoders):
    feed(encoders, (5000, 5000), 0, 0)
    for n in range(1, 20):
        assert feed(encoders, (900_000 + n, 900_000), 10 * n, 10 * n) == "held"
    assert feed(encoders, (900_020, 900_010), 200, 200) == "rebased"
    assert encoders.totals == (0, 0)
    assert feed(encoders, (900_030, 900_021), 210, 10) == "travel"
    assert encoders.totals == (10, 11)


@pytest.mark.parametrize("apart_ms", [2, 5, 10, 20])
def test_a_garbled_reading_that_was_believed_is_taken_back_however_fast_the_next_ones_come(
    encoders, kit, apart_ms
):
    feed(encoders, (3_000_000, 3_000_000), 0, 0)
    # Several lines were lost, so the wheel might have rolled this far.
    wrong = int(2.0 * 0.080 / kit.tick_m)
    assert feed(encoders, (3_000_000 + wrong, 3_000_010), 80, 80) == "held"
    assert feed(encoders, (3_000_000 + wrong, 3_000_010), 80, 80) == "travel"
    for after_ms in range(apart_ms, 140, apart_ms):
        outcome = feed(encoders, (3_000_010, 3_000_010), 80 + after_ms, after_ms)
        if outcome == "travel":
            break
        assert outcome == "held"
    assert encoders.totals == (10, 10)


def test_after_lost_readings_a_step_that_strays_needs_a_second_witness(encoders, kit):
    raw = 3_000_000
    feed(encoders, (raw, raw), 0, 0)
    for n in range(1, 6):
        raw += 40
        assert feed(encoders, (raw, raw), 20 * n, 20) == "travel"
    # Four were lost. A digit is wrong, by less than the wheel might have rolled meanwhile.
    assert feed(encoders, (raw + 700, raw + 200), 200, 100) == "held"
    assert feed(encoders, (raw + 240, raw + 240), 220, 120) == "travel"
    assert encoders.totals == (440, 440)
    # Four more, in which it really stopped.
    assert feed(encoders, (raw + 250, raw + 250), 320, 100) == "held"
    assert feed(encoders, (raw + 250, raw + 250), 340, 120) == "travel"
    assert encoders.totals == (450, 450)


def test_a_fall_to_near_zero_is_an_unannounced_reset(encoders):
    feed(encoders, (50_000, 50_000), 0, 0)
    assert feed(encoders, (9, 8), 10, 10) == "held"
    assert feed(encoders, (18, 16), 20, 20) == "held"
    assert feed(encoders, (27, 24), 30, 30) == "reset_unseen"
    assert encoders.totals == (27, 24)


@pytest.mark.parametrize("deaf_ms", [40, 100, 130, 250])
@pytest.mark.parametrize("counted", [400, 1549])
def test_a_fall_to_near_zero_is_a_reset_though_there_was_time_to_roll_so_far(
    encoders, deaf_ms, counted
):
    for n in range(6):
        feed(encoders, (counted - 40 * (5 - n),) * 2, 20 * n, 20)
    before = encoders.totals
    now_ms = 100 + deaf_ms
    outcomes = [feed(encoders, (9 + n, 8 + n), now_ms + 20 * n, deaf_ms + 20 * n) for n in range(3)]
    assert outcomes == ["held", "held", "reset_unseen"]
    assert encoders.totals == (before[0] + 11, before[1] + 10)


def test_after_a_notice_coasting_counts_from_zero(encoders):
    feed(encoders, (50_000, 50_000), 0, 0)
    encoders.announce("reset")
    assert feed(encoders, (300, 280), 500, 500) == "held"
    assert feed(encoders, (310, 290), 510, 510) == "reset"
    assert encoders.totals == (310, 290)


def test_a_notice_outlives_a_garbled_reading(encoders):
    feed(encoders, (50_000, 50_000), 0, 0)
    encoders.announce("reset")
    assert feed(encoders, (300, 9_999_999), 500, 500) == "held"
    assert feed(encoders, (310, 290), 510, 510) == "held"
    assert feed(encoders, (320, 300), 520, 520) == "reset"
    assert encoders.totals == (320, 300)


def test_a_gap_does_not_hide_a_reset(encoders):
    feed(encoders, (50_000, 50_000), 0, 0)
    encoders.announce("reset")
    encoders.announce("silence")
    assert encoders.notice == "reset"


def test_travel_that_fits_a_gap_is_kept(encoders):
    feed(encoders, (500_000, 400_000), 0, 0)
    encoders.announce("silence")
    assert feed(encoders, (504_000, 404_100), 2000, 2000) == "held"
    assert feed(encoders, (504_020, 404_120), 2010, 2010) == "gap_kept"
    assert encoders.totals == (4020, 4120)


def test_after_a_gap_a_garbled_reading_is_no_witness(encoders):
    feed(encoders, (500_000, 400_000), 0, 0)
    encoders.announce("silence")
    # The wheel could have rolled from each to the next, but not so fast as it did before.
    assert feed(encoders, (500_400, 400_400), 400, 400) == "held"
    assert feed(encoders, (501_480, 400_480), 480, 480) == "held"
    assert feed(encoders, (500_560, 400_560), 560, 560) == "gap_kept"
    assert encoders.totals == (560, 560)


def test_counters_that_zero_could_have_reached_are_not_travel(encoders):
    feed(encoders, (5_000, 5_000), 0, 0)
    encoders.announce("silence")
    feed(encoders, (9_000, 9_000), 2000, 2000)
    assert feed(encoders, (9_020, 9_020), 2010, 2010) == "gap_lost"
    assert encoders.totals == (0, 0)
    assert feed(encoders, (9_040, 9_040), 2020, 10) == "travel"
    assert encoders.totals == (20, 20)


def test_travel_that_does_not_fit_a_gap_is_lost(encoders):
    feed(encoders, (500_000, 500_000), 0, 0)
    encoders.announce("silence")
    feed(encoders, (700_000, 500_000), 500, 500)
    assert feed(encoders, (700_000, 500_000), 510, 510) == "gap_lost"
    assert encoders.totals == (0, 0)


def test_counters_that_did_not_move_at_all_were_not_reset(encoders):
    feed(encoders, (5_000, -70), 0, 0)
    encoders.announce("silence")
    feed(encoders, (5_000, -70), 60_000, 60_000)
    assert feed(encoders, (5_000, -70), 60_010, 60_010) == "gap_kept"


@pytest.mark.parametrize(("count", "outcome"), [(63, "gap_lost"), (64, "gap_kept")])
def test_near_zero_a_reset_may_have_come_back_to_the_same_counts(encoders, count, outcome):
    feed(encoders, (count, -3), 0, 0)
    encoders.announce("away")
    feed(encoders, (count, -3), 60_000, 60_000)
    assert feed(encoders, (count, -3), 60_010, 60_010) == outcome


def test_standing_at_zero_after_a_replug_proves_nothing(encoders):
    feed(encoders, (3, 0), 0, 0)
    encoders.announce("away")
    feed(encoders, (3, 0), 60_000, 60_000)
    encoders.announce("silence")
    feed(encoders, (3, 0), 61_000, 61_000)
    assert feed(encoders, (3, 0), 61_010, 61_010) == "gap_lost"


@pytest.mark.parametrize(
    ("speeds_m_s", "outcome"), [((0.0, 0.0), "gap_kept"), ((0.0, 0.02), "gap_lost")]
)
def test_a_silence_takes_no_travel_from_wheels_that_stood(encoders, speeds_m_s, outcome):
    feed(encoders, (3, 0), 0, 0)
    encoders.announce("silence", speeds_m_s=speeds_m_s)
    feed(encoders, (3, 0), 900, 900)
    assert feed(encoders, (3, 0), 910, 910) == outcome


TURNING = (0.3, 0.3)
"""Rim speeds before a gap, m/s: 1,881 counts a second."""


@pytest.mark.parametrize(
    ("first", "counts", "outcome"),
    [
        (1_500, 2_821, "gap_kept"),  # went on as fast for 1.5 s
        (1_500, 2_821 + 380, "gap_kept"),
        (1_500, 2_821 + 500, "gap_lost"),  # farther than that
        (1_500, 2_821 - 500, "gap_lost"),
        (1_500, -1_400, "gap_lost"),  # the board was reset, and its wheels rolled out
        (-2_821, 2_821, "gap_lost"),  # where a reset also leads
        (-2_821 + 1_200, 2_821, "gap_kept"),  # too far for wheels that were let go
    ],
)
def test_wheels_that_went_on_as_before_were_not_reset(encoders, first, counts, outcome):
    feed(encoders, (first, first), 0, 0)
    encoders.announce("silence", speeds_m_s=TURNING)
    now = first + counts
    feed(encoders, (now, now), 1_500, 1_500)
    assert feed(encoders, (now, now), 1_501, 1_500) == outcome


def test_wheels_that_stood_may_have_been_reset_near_zero(encoders):
    feed(encoders, (200, 200), 0, 0)
    encoders.announce("silence", speeds_m_s=(0.0, 0.0))
    feed(encoders, (190, 200), 1_500, 1_500)
    assert feed(encoders, (190, 200), 1_501, 1_500) == "gap_lost"


def test_an_old_line_does_not_tell_how_far_the_wheels_went(encoders):
    feed(encoders, (500, 500), 0, 0)
    encoders.announce("silence", speeds_m_s=TURNING)
    for n in range(4):
        old = 500 + 19 * n
        verdict = encoders.judge((old, old, 0, 0), (1_500 + n) * MS, 1_500 * MS, fresh=False)
        assert verdict.outcome == "held"
    feed(encoders, (3_321, 3_321), 1_510, 1_500)
    assert feed(encoders, (3_321, 3_321), 1_511, 1_500) == "gap_kept"
    assert encoders.totals == (2_821, 2_821)


def test_a_gap_of_days_is_never_bridged(encoders):
    days_ms = 5 * 24 * 3600 * 1000
    feed(encoders, (500_000, 500_000), 0, 0)
    encoders.announce("silence")
    feed(encoders, (500_100, 500_100), days_ms, days_ms)
    assert feed(encoders, (500_110, 500_110), days_ms + 10, days_ms + 10) == "gap_lost"


@pytest.mark.parametrize(("hours", "outcome"), [(0.4, "gap_kept"), (0.6, "gap_lost")])
def test_the_finest_counter_bounds_how_long_a_gap_may_be(kit, hours, outcome):
    """At full speed it goes half round in 29 minutes, the other one in two days."""
    left, right = kit.motors()
    fine = msgspec.structs.replace(right, ticks_per_revolution=right.ticks_per_revolution * 100)
    encoders = Encoders((left, fine), speed_max_m_s=2.0)
    gap_ms = round(hours * 3600 * 1000)
    ahead = 1_800_000_000
    feed(encoders, (ahead, ahead), 0, 0)
    encoders.announce("silence", unbroken=True)
    feed(encoders, (ahead + 100, ahead + 100), gap_ms, gap_ms)
    assert feed(encoders, (ahead + 110, ahead + 110), gap_ms + 10, gap_ms + 10) == outcome


def test_a_notice_before_the_first_reading_means_nothing(encoders):
    encoders.announce("silence")
    assert encoders.notice == "none"
    assert feed(encoders, (5, 5), 0, 0) == "baseline"


@given(
    st.lists(
        st.tuples(int32, int32, st.sampled_from(("none", "silence", "away", "reset"))), max_size=40
    )
)
def test_no_counts_whatever_make_the_totals_jump(kit, readings):
    encoders = Encoders(kit.motors(), speed_max_m_s=2.0)
    accepted_ms, now_ms, last = 0, 0, (0, 0)
    for left, right, notice in readings:
        now_ms += 10
        if notice != "none":
            encoders.announce(notice)
        outcome = feed(encoders, (left, right), now_ms, now_ms - accepted_ms)
        room = 2.0 * (now_ms - accepted_ms) * 1e-3 / kit.tick_m + 1.0
        for old, new in zip(last, encoders.totals, strict=True):
            assert abs(new - old) <= room
        if outcome != "held":
            accepted_ms = now_ms
        last = encoders.totals


@pytest.mark.parametrize(("left", "right"), [(-50, 20), (20, -50), (50, 20)])
def test_what_was_travelled_is_the_farthest_of_all_wheels_either_way(encoders, left, right):
    assert encoders.least_ns((0, 0)) == 0.0
    feed(encoders, (1000, 1000), 0, 0)
    verdict = encoders.judge((1000 + left, 1000 + right, 0, 0), 10 * MS, 10 * MS)
    assert (verdict.outcome, verdict.strayed, verdict.farthest) == ("travel", False, 50)
    assert verdict.least_ns == encoders.least_ns((50, 0))


def test_a_tick_is_travel_though_no_time_passed(encoders):
    feed(encoders, (1000, 1000), 0, 0)
    assert feed(encoders, (1001, 1000), 0, 0) == "travel"


def test_a_reading_repeats_the_last_one_unless_that_has_to_settle_something(encoders):
    feed(encoders, (1000, 1000), 0, 0)
    assert encoders.repeats((1000, 1000, 0, 0))
    assert not encoders.repeats((1000, 1001, 0, 0))
    encoders.announce("silence")
    assert not encoders.repeats((1000, 1000, 0, 0))


@pytest.mark.parametrize(
    ("steps", "outcome"),
    [
        ((10, 10, 40, 48), "held"),
        ((10, 40, 10, 48), "held"),
        ((40, 40, 10, 90), "travel"),
        ((10, 40, 40, 90), "travel"),
        ((10, 10, 10, 44), "travel"),
        ((10, 10, 10, 48), "held"),
    ],
)
def test_a_wheel_is_heading_where_the_middle_one_of_its_last_three_steps_led(
    encoders, steps, outcome
):
    """By 4.5 mm in 10 ms and its pace of 8 ms: at 10 counts in 10 ms 46 are travel."""
    raw = 3_000_000
    feed(encoders, (raw, raw), 0, 0)
    for n, step in enumerate((steps[0], *steps), 1):
        raw += step
        got = feed(encoders, (raw, raw), 10 * n, 10)
        assert got == (outcome if n == 5 else "travel")


@pytest.mark.parametrize(
    ("before", "now", "reset"),
    [
        ((1500, 1500), (499, 499), True),
        ((1500, 1500), (500, 500), False),
        ((1500, 1500), (750, 0), False),
        ((1500, 600), (400, 100), True),
        ((1500, 300), (10, 200), False),
        ((1500, 400), (10, 200), True),
        # One that had hardly counted may be anywhere.
        ((1500, 100), (10, 100), True),
        ((1500, 180), (10, 180), True),
        ((1600, 200), (10, 200), True),
    ],
)
def test_a_reset_takes_all_counters_to_less_than_half(encoders, before, now, reset):
    feed(encoders, before, 0, 0)
    outcomes = [feed(encoders, now, ms, ms) for ms in (50, 65, 75)]
    assert outcomes == ["held", "held", "reset_unseen" if reset else "held"]


def test_all_counters_of_a_reset_count_from_zero(kit):
    encoders = Encoders(kit.motors((0, 1, 2, 3)), speed_max_m_s=2.0)
    encoders.accept(encoders.judge((5000, 5000, 5000, 5000), 0, 0))
    encoders.announce("reset")
    encoders.judge((5, 6, 7, 8), 10 * MS, 10 * MS)
    encoders.accept(encoders.judge((5, 6, 7, 8), 20 * MS, 20 * MS))
    assert encoders.totals == (5, 6, 7, 8)


@pytest.mark.parametrize(("apart", "outcome"), [(377, "reset"), (378, "held")])
def test_readings_agree_that_the_wheels_can_have_rolled_between_in_20_milliseconds_more(
    encoders, apart, outcome
):
    feed(encoders, (50_000, 50_000), 0, 0)
    encoders.announce("reset")
    assert feed(encoders, (100, 100), 500, 500) == "held"
    assert feed(encoders, (100 + apart, 100), 510, 510) == outcome


@pytest.mark.parametrize(("counted", "outcome"), [(125, "reset"), (126, "held")])
def test_what_a_reset_counts_leaves_a_tick_of_grace_to_the_next_step(kit, counted, outcome):
    left, right = kit.motors()
    fine = msgspec.structs.replace(right, ticks_per_revolution=right.ticks_per_revolution * 100)
    encoders = Encoders((left, fine), speed_max_m_s=2.0)
    feed(encoders, (50_000, 50_000), 0, 0)
    encoders.announce("reset")
    assert feed(encoders, (counted, 0), 10, 10) == "held"
    assert feed(encoders, (counted, 0), 10, 10) == outcome


def test_five_readings_over_a_fifth_of_a_second_are_elsewhere(encoders):
    feed(encoders, (5000, 5000), 0, 0)
    outcomes = [feed(encoders, (900_000, 900_000), ms, ms) for ms in (160, 170, 180, 190, 200)]
    assert outcomes == ["held"] * 4 + ["rebased"]
