from __future__ import annotations

import itertools
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.errors import ConfigError
from yahboomd.core.model import ImuReading
from yahboomd.core.odometry.imu_axes import Mounting
from yahboomd.core.protocol.dialect import Inertial, Setting, VersionLine
from yahboomd.core.protocol.four_channel.framing import RESYNC, LineFramer
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import (
    DIALECTS,
    check_storable,
    connect_spacing_ns,
    connect_stop,
    identify,
)
from yahboomd.core.protocol.settings import is_complete


def heard(*chunks):
    """The items that every dialect's framer finds."""
    framers = {name: dialect.framer() for name, dialect in DIALECTS.items()}
    return [
        (name, item)
        for chunk in chunks
        for name, framer in framers.items()
        for item in framer.feed(chunk)
    ]


def identified(data):
    return identify(heard(data))


def test_every_dialect_is_registered_under_its_own_name_the_newest_last():
    assert list(DIALECTS) == ["streamed", "polled", "rosmaster"]
    assert all(dialect.name == name for name, dialect in DIALECTS.items())


def test_the_stop_before_anything_is_known_serves_every_dialect():
    assert connect_stop() == (
        (RESYNC, b"$pwm:0,0,0,0#"),
        (b"", b"$speed:0,0,0,0#"),
        (bytes(20), b"\xff\xfc\x0a\x12\x01\0\0\0\0\0\0\x1d"),
    )
    assert connect_spacing_ns() == 20_000_000


def test_what_any_board_must_not_store_is_refused():
    check_storable(PROFILES["520"].settings)
    with pytest.raises(ConfigError, match="encoder lines 0"):
        check_storable({"lines": 0})


@pytest.mark.parametrize(
    "data",
    [
        b"fail,Command not found!\r\n",
        b"read_flash:OK!\r\n",
        b"Motor_type:1\r\n",
        b"Reset MCUMotor_Version:1.7.3\r\n",
        b"3,4#\r\n$MAll:1,2,3,4#\r\n",
        b"$MTEP:0,0,0,0#\r\n",
        b"$MSPD:0.00,0.00,0.00,0.00#\r\n",
        b"$Battery:7.4V#\r\n",
    ],
)
def test_words_and_streams_mean_streamed(data):
    assert identified(data) == "streamed"


@pytest.mark.parametrize("data", [b"$data:0,0,0,0#", b"3,0,4#\r\n$data:1,0,-2,0#\r\n"])
def test_an_answer_with_counters_means_polled(data):
    assert identified(data) == "polled"


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\r\n\r\n",
        b"1,2,3,4#\r\n",
        b"1,2,3,4\r\n",
        b"$data:1,2,3#",
        b"$data:1,2,3,4",
        b"$MAll:1,2\r\n",
        b"error:1\r\nGrbl 1.1f ['$' for help]\r\n",
        b"$GPGGA,123519,4807.038,N*47\r\n",
        b"\xff\xfe\x00\x80\r\n",
    ],
)
def test_pieces_and_the_chatter_of_other_devices_mean_nothing(data):
    assert identified(data) is None


@given(st.lists(st.binary(max_size=30), max_size=5))
def test_no_bytes_make_identification_raise(chunks):
    assert identify(iter(heard(*chunks))) in {None, *DIALECTS}


OWNERS = {"streamed": "owner-settings-and-totals", "rosmaster": "owner-icm20948-at-rest"}
"""Of real boards."""


@pytest.mark.parametrize(
    ("name", "file"), [*((name, f"connect-{name}") for name in DIALECTS), *OWNERS.items()]
)
def test_a_capture_decodes_to_its_meanings_however_it_is_cut(
    capture, chunked, each_way, name, file
):
    taken = capture(file)
    data = b"".join(taken.received)
    items = each_way(data, DIALECTS[name].framer)
    assert chunked(taken.received, DIALECTS[name].framer) == chunked([data], DIALECTS[name].framer)
    meanings = [repr(DIALECTS[name].decode(item)) for item in items]
    # What kind of sensor it is, its name tells.
    assert [re.sub(r"ImuSensor\(name='(\w+)'.*?\)", r"\1", each) for each in meanings] == (
        taken.meanings
    )
    assert identified(data) == name


def test_the_streamed_connect_shows_a_board_that_may_be_moved(capture):
    items = LineFramer().feed(b"".join(capture("connect-streamed").received))
    answers = [DIALECTS["streamed"].decode(item) for item in items]
    settings = {said.name: said.value for said in answers if isinstance(said, Setting)}
    settings["version"] = "1.7.3"
    assert is_complete(DIALECTS["streamed"].settings, settings)
    assert DIALECTS["streamed"].findings(settings, PROFILES["520"]).unfit == ()
    assert VersionLine(version="1.7.3", after_reset=True) in answers


def test_the_owners_icm20948_shows_gravity_upward_along_the_base(capture):
    items = DIALECTS["rosmaster"].framer().feed(b"".join(capture(OWNERS["rosmaster"]).received))
    (shown,) = (
        each for each in map(DIALECTS["rosmaster"].decode, items) if isinstance(each, Inertial)
    )
    assert shown.acceleration_m_s2[2] == -9.909
    reading = ImuReading(
        sensor=shown.sensor,
        sent_ns=0,
        gyro_rad_s=shown.gyro_rad_s,
        acceleration_m_s2=shown.acceleration_m_s2,
    )
    assert Mounting().along_base(reading).acceleration_m_s2 == (0.034, -0.068, 9.909)


@pytest.mark.parametrize("name", DIALECTS)
def test_a_connect_sends_the_stop_before_anything_else(capture, name):
    sent = capture(f"connect-{name}").sent
    # Those of boards that were added later than the capture come behind its own.
    known = list(DIALECTS).index(name) + 1 if name == "rosmaster" else 2
    stops = [words for words in itertools.chain(*connect_stop()[:known]) if words]
    assert sent[: len(stops)] == stops
    # What reports by itself is asked nothing.
    first = DIALECTS[name] if DIALECTS[name].listen_ns else DIALECTS["streamed"]
    second = first.resync + first.surest_stop if first.listen_ns else first.probe
    assert sent[len(stops)] == second
