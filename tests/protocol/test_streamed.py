from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.errors import ConfigError
from yahboomd.protocol.dialect import (
    Battery,
    Deltas,
    SettingWrite,
    Speeds,
    Totals,
    Unrecognised,
)
from yahboomd.protocol.framing import Framer
from yahboomd.protocol.settings import PROFILES, BoardSettings
from yahboomd.protocol.streamed import Streamed

STREAMED = Streamed()
STORED = BoardSettings(
    version="1.7.3",
    motor_type=1,
    deadzone=1600,
    lines=11,
    ratio=30,
    wheel_diameter_mm=67.0,
    pid=(0.8, 0.06, 0.5),
)
int32 = st.integers(-(2**31), 2**31 - 1)


def decoded(data):
    (item,) = Framer().feed(data)
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
    assert STREAMED.pwm((500, -500, 4000, -4000)) == b"$pwm:500,-500,3600,-3600#"
    assert STREAMED.brake == b"$spd:0,0,0,0#"
    assert STREAMED.cut == b"$pwm:0,0,0,0#"
    assert STREAMED.arm == (b"$upload:1,0,0#",)
    assert STREAMED.disarm == (b"$upload:0,0,0#",)
    assert STREAMED.battery == b"$read_vol#"
    assert STREAMED.read_settings == STREAMED.probe == b"$read_flash#"
    assert STREAMED.poll is None


def test_leaving_brakes_cuts_and_then_ends_the_streams():
    assert STREAMED.leave == (b"$spd:0,0,0,0#", b"$pwm:0,0,0,0#", b"$upload:0,0,0#")


def test_the_times_are_those_observed():
    assert STREAMED.spacing_ns == 20_000_000
    assert STREAMED.totals_spacing_ns == 10_000_000
    assert STREAMED.sample_period_ns == 10_000_000
    assert STREAMED.max_frame_bytes == 53


@pytest.mark.parametrize(
    ("change", "frame", "reply_to"),
    [
        ({"motor_type": 2}, b"$mtype:2#", "mtype"),
        ({"deadzone": 1900}, b"$deadzone:1900#", "deadzone"),
        ({"lines": 13}, b"$mline:13#", "mline"),
        ({"ratio": 40.0}, b"$mphase:40#", "mphase"),
        ({"wheel_diameter_mm": 48.5}, b"$wdiameter:48.500#", "wdiameter"),
    ],
)
def test_only_the_value_that_differs_is_written(change, frame, reply_to):
    want = msgspec.structs.replace(STORED, **change)
    assert STREAMED.write_settings(STORED, want) == (
        SettingWrite(frame=frame, reply_to=reply_to, timeout_s=0.4, resets=False),
    )


def test_new_gains_come_last_reset_the_board_and_get_a_second():
    want = msgspec.structs.replace(STORED, pid=(0.9, 0.06, 0.5), lines=13)
    *_, last = STREAMED.write_settings(STORED, want)
    assert last == SettingWrite(
        frame=b"$MPID:0.900,0.060,0.500#", reply_to="MPID", timeout_s=1.0, resets=True
    )


def test_a_profile_is_written_value_by_value_in_the_vendors_order():
    writes = STREAMED.write_settings(STORED, PROFILES["310"].settings)
    assert [write.frame for write in writes] == [
        b"$mtype:2#",
        b"$mline:13#",
        b"$mphase:20#",
        b"$wdiameter:48.000#",
    ]
    assert all(write.timeout_s >= 0.4 for write in writes)


def test_decimals_that_the_board_cannot_show_are_no_difference():
    have = BoardSettings(ratio=20, wheel_diameter_mm=67.123, pid=(0.8, 0.06, 0.5))
    want = BoardSettings(ratio=20.409, wheel_diameter_mm=67.1234, pid=(0.8002, 0.06, 0.49998))
    assert STREAMED.write_settings(have, want) == ()


def test_what_the_board_did_not_show_is_not_written():
    assert STREAMED.write_settings(BoardSettings(), PROFILES["520"].settings) == ()


def test_a_zero_is_never_written():
    with pytest.raises(ConfigError, match="encoder lines 0"):
        STREAMED.write_settings(STORED, BoardSettings(lines=0))


@given(
    st.builds(
        BoardSettings,
        motor_type=st.integers(1, 4),
        deadzone=st.integers(0, 3600),
        lines=st.integers(1, 100_000),
        ratio=st.floats(1.0, 10_000.0),
        wheel_diameter_mm=st.floats(1.0, 10_000.0),
        pid=st.tuples(*[st.floats(0.0, 1000.0)] * 3),
    )
)
def test_once_a_board_shows_what_was_written_nothing_differs(want):
    # The board cuts the ratio to whole numbers and prints the rest with three decimals.
    shown = {}
    for write in STREAMED.write_settings(STORED, want):
        assert len(write.frame) <= STREAMED.max_frame_bytes
        shown[write.reply_to] = write.frame.decode().split(":")[1].rstrip("#")
    have = msgspec.structs.replace(
        STORED,
        motor_type=int(shown.get("mtype", 1)),
        deadzone=int(shown.get("deadzone", 1600)),
        lines=int(shown.get("mline", 11)),
        ratio=int(shown.get("mphase", 30)),
        wheel_diameter_mm=float(shown.get("wdiameter", "67.000")),
        pid=tuple(float(gain) for gain in shown.get("MPID", "0.800,0.060,0.500").split(",")),
    )
    assert STREAMED.write_settings(have, want) == ()


def test_a_factory_reset_restarts_the_board():
    assert STREAMED.factory_reset == SettingWrite(
        frame=b"$flash_reset#", reply_to="flash_reset", timeout_s=1.0, resets=True
    )


def test_the_profile_changes_nothing_on_the_wire():
    assert STREAMED.for_profile(PROFILES["310"]) == STREAMED
