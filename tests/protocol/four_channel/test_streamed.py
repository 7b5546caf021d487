from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.protocol.dialect import Battery, Deltas, Speeds, Totals, Unrecognised
from yahboomd.core.protocol.four_channel.framing import LineFramer
from yahboomd.core.protocol.four_channel.streamed import Streamed
from yahboomd.core.protocol.profiles import PROFILES

STREAMED = Streamed()
int32 = st.integers(-(2**31), 2**31 - 1)


def decoded(data):
    (item,) = LineFramer().feed(data)
    return STREAMED.decode(item)


@pytest.mark.parametrize(
    ("data", "meaning"),
    [
        (b"$MAll:1,-2,3,-2147483648#\r\n", Totals(ticks=(1, -2, 3, -(2**31)))),
        (b"$MTEP:13,0,-13,0#\r\n", Deltas(ticks=(13, 0, -13, 0))),
        (b"$MSPD:0.00,-15.95,143.51,0.00#\r\n", Speeds(mm_s=(0.0, -15.95, 143.51, 0.0))),
        (b"$Battery:7.4V#\r\n", Battery(volts=7.4)),
        (b"$Battery:12.05V#\r\n", Battery(volts=12.05)),
    ],
)
def test_every_stream_gives_its_reading(data, meaning):
    assert decoded(data) == meaning


@pytest.mark.parametrize(
    "data",
    [
        b"$mall:1,2,3,4#",
        b"$MALL:1,2,3,4#",
        b"$MAll:1,2,3#",
        b"$MAll:1,2,3,4,5#",
        b"$MAll:1,2,3,2147483648#",
        b"$MAll:1,2,3, 4#",
        b"$MAll:1,2,3,+4#",
        b"$MAll:1,2,3,4_0#",
        b"$MAll:1,2,3,\xff4#",
        b"$MAll:1,2,3,4\r#",
        b"$MAll 1,2,3,4#",
        b"$MSPD:1,2,3,4#",
        b"$Battery:7.4#",
        b"$data:1,2,3,4#",
        b"$#",
    ],
)
def test_a_damaged_frame_gives_no_reading(data):
    assert isinstance(decoded(data), Unrecognised)


def test_what_is_not_recognised_is_shown_whole():
    assert decoded(b"$MAll:1,x#") == Unrecognised(text="$MAll:1,x#")


@given(int32, int32, int32, int32)
def test_any_counters_survive_the_wire(a, b, c, d):
    assert decoded(f"$MAll:{a},{b},{c},{d}#\r\n".encode()) == Totals(ticks=(a, b, c, d))


def test_the_frames_are_the_vendors():
    assert STREAMED.speeds((500, -500, 2000, -2000)) == b"$spd:500,-500,1000,-1000#"
    assert STREAMED.brake == b"$spd:0,0,0,0#"
    assert STREAMED.cut == b"$pwm:0,0,0,0#"
    assert STREAMED.arm == (b"$upload:1,0,0#",)
    assert STREAMED.disarm == (b"$upload:0,0,0#",)
    assert STREAMED.battery == b"$read_vol#"
    assert STREAMED.probe == b"$read_flash#"
    assert STREAMED.read_settings == (b"$read_flash#",)
    assert STREAMED.poll is None


def test_the_times_are_those_observed():
    assert STREAMED.spacing_ns == 20_000_000
    assert STREAMED.totals_spacing_ns == 10_000_000
    assert STREAMED.sample_period_ns == STREAMED.loop_ns == 10_000_000
    assert not STREAMED.renews_with_each_line
    assert STREAMED.poll_bytes == 0


def test_it_says_nothing_before_it_is_asked():
    assert STREAMED.listen_ns == 0


def test_no_command_is_faster_than_a_metre_per_second():
    assert STREAMED.fastest_m_s == 1.0


def test_the_profile_changes_nothing_on_the_wire():
    assert STREAMED.for_profile(PROFILES["310"]) == STREAMED
