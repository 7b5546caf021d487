from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.protocol.dialect import CommandLost, Totals, Unrecognised
from yahboomd.core.protocol.four_channel.framing import LineFramer
from yahboomd.core.protocol.four_channel.polled import Polled
from yahboomd.core.protocol.profiles import PROFILES

POLLED = Polled()
int32 = st.integers(-(2**31), 2**31 - 1)


def decoded(data):
    (item,) = LineFramer().feed(data)
    return POLLED.decode(item)


@given(int32, int32, int32, int32)
def test_an_answer_gives_the_counters(a, b, c, d):
    assert decoded(f"$data:{a},{b},{c},{d}#".encode()) == Totals(ticks=(a, b, c, d))


@pytest.mark.parametrize(
    "data",
    [
        b"$data:1,2,3#",
        b"$data:1,2,3,4,5#",
        b"$data:1,2,3,4.0#",
        b"$data:1,2,3,4294967296#",
        b"$data#",
        b"$Data:1,2,3,4#",
        b"$MAll:1,2,3,4#",
    ],
)
def test_another_frame_gives_none(data):
    assert decoded(data) == Unrecognised(
        text=data.decode() if b":" in data else data.decode().replace("#", ":#")
    )


def test_the_frames_are_the_articles():
    assert POLLED.arm == (b"$mtype:1#",) * 3
    assert POLLED.poll == POLLED.probe == b"$read#"
    assert POLLED.speeds((500, 0, -1500, 0)) == b"$speed:500,0,-1000,0#"
    assert POLLED.brake == b"$speed:0,0,0,0#"


def test_there_is_no_cut_and_nothing_to_read_or_write():
    assert POLLED.cut is None
    assert POLLED.battery is None
    assert POLLED.read_settings == ()
    assert POLLED.settings == ()


def test_frames_may_follow_each_other_at_once():
    assert POLLED.spacing_ns == POLLED.totals_spacing_ns == 0
    assert POLLED.sample_period_ns is None


def test_it_says_nothing_before_it_is_asked():
    assert POLLED.listen_ns == 0
    assert not POLLED.renews_with_each_line


def test_no_command_is_faster_than_a_metre_per_second():
    assert POLLED.fastest_m_s == 1.0


def test_a_poll_costs_a_question_an_answer_and_a_speed():
    answer = 30
    speed = len(POLLED.speeds((1000, 100, 10, 0)))
    assert POLLED.poll_bytes == len(POLLED.poll) + answer + speed


def test_the_profile_tells_the_motor_type():
    assert POLLED.for_profile(PROFILES["310"]).arm == (b"$mtype:2#",) * 3


def test_the_wrong_dialect_shows_in_the_boards_complaints():
    text = "fail,Command not found!"
    assert decoded(text.encode() + b"\r\n") == CommandLost(text=text)
