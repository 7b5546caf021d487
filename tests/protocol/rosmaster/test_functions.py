from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.protocol.dialect import (
    Battery,
    Inertial,
    Setting,
    Totals,
    Unrecognised,
    Unused,
    VersionLine,
)
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.rosmaster.functions import (
    ICM20948,
    MPU9250,
    READ_SETTINGS,
    TABLE,
    decode,
    findings,
    motion,
)
from yahboomd.core.protocol.rosmaster.packets import Packet, PacketFramer, Words
from yahboomd.core.protocol.settings import writes

GOOD = {"version": "3.5", "car_type": 1, "pid": (0.8, 0.06, 0.5)}


def said(text: str):
    (item,) = PacketFramer().feed(bytes.fromhex(text))
    return decode(item)


def words(text: str):
    return decode(Words(text=text, size=len(text) + 1, trailing=0))


def test_the_examples_of_its_documentation_mean_what_they_say():
    assert said("FF FB 0A 0A C8 00 00 00 F4 01 78 49") == Battery(volts=12.0)
    assert said("FF FB 13 0D 28 05 00 00 28 05 00 00 FF FF FF FF A0 86 01 00 9D") == Totals(
        ticks=(1320, 1320, -1, 100000)
    )
    assert said("FF FB 05 51 03 05 5E") == VersionLine(version="3.5", after_reset=False, last=True)
    assert isinstance(said("FF FB 09 0C 00 00 00 00 5C 3D AE"), Unused)


def test_the_sensor_that_is_read_with_16_bits_has_the_scales_of_its_ranges():
    found = said("FF FB 15 0B 26 00 ED FF BC 00 00 00 00 00 00 40 64 00 CE FF C8 00 27")
    assert isinstance(found, Inertial)
    assert found.sensor is MPU9250
    assert found.gyro_rad_s == pytest.approx((0.01012, -0.00506, 0.05007), abs=1e-5)
    assert found.acceleration_m_s2 == pytest.approx((0.0, 0.0, 9.8), abs=1e-2)
    assert found.magnetic_t == pytest.approx((15e-6, -7.5e-6, 30e-6))
    assert math.degrees(MPU9250.gyro_limit_rad_s) == pytest.approx(500.0, abs=0.1)


def test_the_other_sensor_counts_thousandths():
    found = said("FF FB 15 0E 0A 00 FB FF F4 01 00 00 00 00 4F 26 20 4E 78 EC D0 8A BD")
    assert isinstance(found, Inertial)
    assert found.sensor is ICM20948
    assert found.gyro_rad_s == (0.01, -0.005, 0.5)
    assert found.acceleration_m_s2 == (0.0, 0.0, 9.807)
    assert found.magnetic_t == pytest.approx((20e-6, -5e-6, -30e-6))


@given(st.integers(0, 255), st.binary(max_size=30))
def test_a_frame_of_another_length_than_its_functions_means_nothing(function, payload):
    lengths = {0x0A: 7, 0x0B: 18, 0x0C: 6, 0x0D: 16, 0x0E: 18, 0x13: 7, 0x15: 2, 0x51: 2}
    item = Packet(function=function, payload=payload, size=len(payload) + 5, trailing=0)
    known = lengths.get(function) == len(payload)
    assert isinstance(decode(item), Unrecognised) != known


def test_the_banner_is_a_start_and_other_words_are_the_boards_own():
    assert words("Firmware Version: V3.5.1") == VersionLine(version="3.5.1", after_reset=True)
    assert words("xFirmware Version: V2.2.3") == VersionLine(version="2.2.3", after_reset=True)
    assert words("IMU Type: ICM20948") == Unused(text="IMU Type: ICM20948")
    assert isinstance(words("Firmware Version: Vx"), Unused)
    assert isinstance(words("k\t"), Unrecognised)


def test_a_supply_that_was_not_measured_yet_is_no_voltage():
    assert said("FF FB 0A 0A 00 00 00 00 00 00 00 14") == Unused(text="0 V")
    assert said("FF FB 0A 0A 00 00 00 00 00 00 01 15") == Battery(volts=0.1)


def test_settings_are_read_by_three_questions_and_each_answer_ends_its_own():
    assert [frame[4] for frame in READ_SETTINGS] == [0x51, 0x15, 0x13]
    assert said("FF FB 05 15 02 00 1C") == Setting(name="car_type", value=2, last=True)
    gains = said("FF FB 0A 13 01 20 03 3C 00 F4 01 72")
    assert gains == Setting(name="pid", value=(0.8, 0.06, 0.5), last=True)


def test_what_is_stored_is_written_to_the_flash_value_by_value():
    want = {"car_type": 2, "pid": (1.0, 0.1, 0.4)}
    frames = [write.frame for write in writes(TABLE, GOOD, want)]
    assert frames == [
        bytes.fromhex("FF FC 05 15 02 5F 7B"),
        bytes.fromhex("FF FC 0A 13 E8 03 64 00 90 01 5F 5C"),
    ]
    assert writes(TABLE, GOOD, GOOD) == ()
    assert [row.words(GOOD[row.field]) for row in TABLE] == ["1 (X3)", "0.800, 0.060, 0.500"]


def test_gain_0_251_reads_back_as_0_250_and_is_not_written_again():
    want = {"pid": (0.251, 0.06, 0.5)}
    (write,) = writes(TABLE, GOOD, want)
    assert write.text == "gains P, I, D 0.250,0.060,0.500"
    assert writes(TABLE, {**GOOD, "pid": (0.250, 0.06, 0.5)}, want) == ()
    assert writes(TABLE, {**GOOD, "pid": (0.251, 0.06, 0.5)}, want) == ()
    assert writes(TABLE, {**GOOD, "pid": (0.249, 0.06, 0.5)}, want)


@given(st.integers(), st.integers(), st.integers())
def test_no_motion_leaves_16_bits_or_sets_the_bit_that_holds_the_heading(vx, vy, wz):
    frame = motion(vx, vy, wz)
    assert len(frame) == 12
    assert not frame[4] & 0x80


def test_a_board_for_the_configured_car_has_no_problem():
    assert findings(GOOD, PROFILES["x3"]).unfit == ()
    assert findings(GOOD, PROFILES["x3"]).advice == ()
    assert findings(GOOD, PROFILES["520"]).unfit == ()
    (advice,) = findings(GOOD, PROFILES["520"]).advice
    assert "65.0 mm and 1320 counts" in advice


@pytest.mark.parametrize("number", [0, 3, 7, 200])
def test_a_car_type_that_is_not_known_refuses_motion_and_names_those_that_are(number):
    (wrong,) = findings({**GOOD, "car_type": number}, PROFILES["520"]).unfit
    assert f"car type {number}" in wrong
    assert "1 (X3), 2 (X3 Plus), 4 (X1), 5 (R2 or R2L)" in wrong
    assert "`yahboomd probe --write`" in wrong


@pytest.mark.parametrize("profile", ["520", "x3", "m1"])
def test_an_a1_is_named_and_refused_with_what_is_missing_and_how_to_send_it(profile):
    (wrong,) = findings({**GOOD, "version": "3.6", "car_type": 9}, PROFILES[profile]).unfit
    assert "car type 9 (A1), which yahboomd cannot drive yet" in wrong
    for missing in ("circumference", "counts a turn", "track", "wheelbase", "limit of its speed"):
        assert missing in wrong
    assert "`yahboomd report`" in wrong


def test_another_car_than_the_profiles_refuses_motion_and_its_own_profile_is_named_first():
    (wrong,) = findings({**GOOD, "car_type": 2}, PROFILES["x3"]).unfit
    assert "car type 2 (X3 Plus), the profile x3 needs 1 (X3)" in wrong
    own, other = wrong.index('set board.profile = "x3-plus"'), wrong.index("probe --write")
    assert own < other
    assert "Only if it is the X3" in wrong
    (silent,) = findings({"version": "3.5"}, PROFILES["x3"]).unfit
    assert "did not show its car type" in silent


@pytest.mark.parametrize(("version", "fits"), [("3.5", False), ("3.6", True), ("4.0", True)])
def test_an_m1_needs_the_firmware_that_knows_it_and_its_first_drive_is_to_be_watched(version, fits):
    board = {**GOOD, "version": version, "car_type": 10}
    assert (findings(board, PROFILES["m1"]).unfit == ()) == fits
    (advice,) = findings(board, PROFILES["m1"]).advice
    assert "Watch the first drive" in advice
    # As one was shipped.
    shipped = findings({**board, "car_type": 2}, PROFILES["m1"]).unfit
    assert "needs 10 (M1)" in shipped[0]
    assert ("ignores the type of an M1" in shipped[-1]) != fits


def test_gains_of_zero_are_wrong():
    assert findings({**GOOD, "pid": (0.0, 0.0, 0.0)}, PROFILES["x3"]).wrong
    assert findings(GOOD, PROFILES["x3"]).wrong == ()
