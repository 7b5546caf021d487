from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.kinematics import KINEMATICS
from yahboomd.core.errors import BoardError
from yahboomd.core.model import Motor
from yahboomd.core.protocol.profiles import NO_ENCODER_TYPE, PROFILES
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.rosmaster.functions import ICM20948, MPU9250
from yahboomd.core.protocol.rosmaster.packets import PacketFramer, Words, frame
from yahboomd.core.protocol.rosmaster.rosmaster import Rosmaster

ROSMASTER = Rosmaster()
TWO = KINEMATICS["differential"](separation_m=0.15)
MOTORS = tuple(
    Motor(name=name, wheel=wheel, position=at, radius_m=0.0325, ticks_per_revolution=1320.0)
    for wheel, (name, at) in enumerate((("left", 1), ("right", 3)))
)


def frames(dialect):
    single = (dialect.brake, dialect.cut, dialect.probe, dialect.battery)
    return [*single, *dialect.arm, *dialect.read_settings]


def test_every_frame_is_one_that_the_board_can_take_and_stores_nothing():
    for each in frames(ROSMASTER):
        assert each[:2] == b"\xff\xfc"
        assert each[2] == len(each) - 2 <= 17
        assert sum(each[2:-1]) & 0xFF == each[-1]
        # The byte that saves to the flash.
        assert 0x5F not in each[4:-1]


def test_it_never_commands_the_open_loop_or_what_holds_the_heading():
    assert {each[3] for each in frames(ROSMASTER)} == {0x12, 0x11, 0x50, 0x01}
    assert ROSMASTER.speeds((200, 0, 500)) == bytes.fromhex("FF FC 0A 12 01 C8 00 00 00 F4 01 DA")
    assert ROSMASTER.brake == bytes.fromhex("FF FC 0A 12 01 00 00 00 00 00 00 1D")


def test_outputs_are_shares_above_the_boards_own_dead_zone():
    assert ROSMASTER.outputs((2600, -2600, 0, 3600), {}) == bytes.fromhex("FFFC0710 32CE0064 7B")
    # Up to the dead zone there is none, and none is more than all.
    sunrise = ROSMASTER.outputs((2800, -2016, 2000, 3600), {"car_type": 6})
    assert sunrise == frame(0x10, 50, 256 - 1, 0, 100)
    assert ROSMASTER.outputs((1600, -1600, 1619, -9999), {}) == frame(0x10, 0, 0, 0, 256 - 100)


def test_it_listens_for_longer_than_two_reports_of_a_kind():
    assert ROSMASTER.listen_ns > 2 * 41_000_000
    board = ROSMASTER
    spacings = (board.spacing_ns, board.totals_spacing_ns, board.question_spacing_ns)
    assert {*spacings, board.answer_spacing_ns} == {5_000_000}
    assert ROSMASTER.poll is None


@pytest.mark.parametrize(
    ("data", "ours"),
    [
        (bytes.fromhex("FF FB 05 51 03 05 5E"), True),
        (bytes.fromhex("FF FB 0A 0A C8 00 00 00 F4 01 78 49"), True),
        (b"Firmware Version: V3.5.1\n", True),
        (b"Motor_Version:1.7.3\n", False),
        (b"$GPGGA,123519,4807.038,N*47\n", False),
        (b"IMU Type: ICM20948\n", False),
        (bytes.fromhex("FF FB 05 77 03 05 84"), False),
    ],
)
def test_only_its_own_frames_and_its_banner_are_recognised(data, ours):
    (item,) = PacketFramer().feed(data)
    assert ROSMASTER.recognises(item) is ours


@given(st.text(max_size=60))
def test_no_words_of_another_device_are_taken_for_its_own(text):
    item = Words(text=text, size=len(text) + 1, trailing=0)
    assert not ROSMASTER.recognises(item) or "Firmware Version: V" in text


@pytest.mark.parametrize(
    ("car", "volts", "words"),
    [
        (1, 9.1, "Its supply had 9.1 V at the alarm. Below 9.6 V or above 13.0 V for 2 s, it"),
        (1, 13.4, "becomes. Use the car's own battery, then"),
        (1, 6.0, "becomes. Charge or replace the battery"),
        (2, 9.0, "becomes. Charge or replace the battery"),
        (1, 7.4, "has 7.4 V now"),
        (1, 12.0, "has 12.0 V now"),
        (1, None, "only a reset ends"),
        (6, 8.8, "Its supply had 8.8 V at the alarm. Below 6.5 V or above 8.5 V for 2 s, it"),
        (6, 8.8, "becomes. Use the car's own battery, then"),
        (6, 12.0, "becomes. The board is set to a Sunrise, and that is the battery of another car"),
        (
            6,
            12.0,
            "store its type with `yahboomd probe --write`, which works while the alarm",
        ),
        (6, 12.0, "hold its KEY1 for 10 s"),
        (10, 9.0, "Below 9.6 V or above 13.0 V for 2 s, it"),
        (6, 6.2, "becomes. Charge or replace the battery"),
        (6, 7.4, "has 7.4 V now"),
        (None, 9.0, "on a Sunrise below 6.5 V or above 8.5 V"),
        (None, 9.0, "becomes. Use the car's own battery, charged, then"),
        (None, 6.0, "becomes. Charge or replace the battery"),
    ],
)
def test_its_silence_is_explained_by_its_supply_and_the_limits_of_the_car(car, volts, words):
    said = ROSMASTER.silence(volts, {} if car is None else {"car_type": car})
    assert words in said
    assert "switch the board off and on" in said
    assert ("Sunrise" in said) == (car is None or (car, volts) == (6, 12.0))


@pytest.mark.parametrize(
    ("car", "volts", "latched"),
    [
        *[(1, 9.1, True), (1, 12.0, False), (1, 7.4, False), (1, 13.1, True), (1, None, False)],
        *[(6, 12.0, True), (6, 7.4, False), (6, 6.4, True), (9, 9.1, True), (None, 12.0, False)],
    ],
)
def test_a_voltage_outside_of_the_cars_limits_is_a_latched_alarm(car, volts, latched):
    settings = {} if car is None else {"car_type": car}
    assert ROSMASTER.brakes_until_reset(volts, settings) == latched
    assert not DIALECTS["streamed"].brakes_until_reset(volts, settings)


def test_wheels_are_turned_by_the_stored_car_type():
    motion = ROSMASTER.motion(TWO, MOTORS, {"car_type": 1}, scale=1.0)
    assert motion.units((0.3, 0.3)) == (300, 0, 0)
    other = ROSMASTER.motion(TWO, MOTORS, {"car_type": 4}, scale=1.0)
    assert other.units((0.3, 0.3)) == (316, 0, 0)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (None, "type None"),
        ({"car_type": 3}, "type 3"),
        ({"car_type": 5}, "R2, which steers, and the base is diff"),
    ],
)
def test_a_car_that_is_not_known_or_steers_is_refused(settings, words):
    with pytest.raises(BoardError, match=words):
        ROSMASTER.motion(TWO, MOTORS, settings, scale=1.0)


def test_a_car_that_steers_is_commanded_by_speed_and_angle():
    car = KINEMATICS["ackermann"](separation_m=0.1911, base_m=0.23537)
    rear = tuple(
        Motor(name=name, wheel=wheel, position=at, radius_m=0.03425, ticks_per_revolution=836.0)
        for wheel, (name, at) in enumerate((("left", 2), ("right", 4)))
    )
    motion = ROSMASTER.motion(car, rear, {"car_type": 5}, scale=1.0)
    # A radius of 0.5 m to the left is atan(0.23537 / 0.5), 25.2 degrees.
    half_m = 0.1911 / 2.0
    turned = motion.units((0.5 * (0.5 - half_m) / 0.5, 0.5 * (0.5 + half_m) / 0.5))
    assert turned == (500, 25, 0)
    assert motion.units((-0.5, -0.5)) == (-500, 0, 0)
    assert motion.units((0.0, 0.0)) == (0, 0, 0)
    assert motion.units((-0.1, 0.1)) == (0, 0, 0)
    assert motion.units((0.0, 1.0))[1] == 45
    assert ROSMASTER.speeds(turned)[4:11] == bytes((1, 0xF4, 1, 25, 0, 0, 0))
    with pytest.raises(BoardError, match="X3, which does not steer, and the base is ackermann"):
        ROSMASTER.motion(car, rear, {"car_type": 1}, scale=1.0)


@pytest.mark.parametrize(
    ("plugs", "refused"),
    [((2, 4), False), ((-2, -4), False), ((4, 2), True), ((2, -4), True), ((-4, 2), True)],
)
def test_a_car_whose_rear_motors_are_exchanged_or_mounted_unlike_is_refused(plugs, refused):
    car = KINEMATICS["ackermann"](separation_m=0.1911, base_m=0.23537)
    rear = tuple(
        Motor(
            name=name,
            wheel=wheel,
            position=abs(plug),
            command_sign=1 if plug > 0 else -1,
            radius_m=0.03425,
            ticks_per_revolution=836.0,
        )
        for wheel, (name, plug) in enumerate(zip(("left", "right"), plugs, strict=True))
    )
    if refused:
        with pytest.raises(BoardError, match="left on M2 and right on M4; these are not"):
            ROSMASTER.motion(car, rear, {"car_type": 5}, scale=1.0)
    else:
        motion = ROSMASTER.motion(car, rear, {"car_type": 5}, scale=1.0)
        assert abs(motion.units((0.5, 0.5))[0]) == 500


def test_a_unit_that_is_no_whole_number_is_refused():
    with pytest.raises(TypeError):
        ROSMASTER.speeds((0.5, 0, 0))


def test_it_is_the_same_for_every_profile():
    assert ROSMASTER.for_profile(PROFILES["310"]) is ROSMASTER


def test_the_first_words_to_the_board_are_those_of_its_firmware():
    assert ROSMASTER.baudrate == 115_200
    assert ROSMASTER.arm == (bytes.fromhex("ff fc 05 01 01 00 07"),)
    assert ROSMASTER.listen_ns == 100_000_000
    assert ROSMASTER.fastest_m_s == 2.0
    assert NO_ENCODER_TYPE == 4


def test_the_sensors_limits_and_noise_are_those_of_data_sheets_and_captures():
    assert (MPU9250.axes, ICM20948.axes) == ("x y z", "x -y -z")
    assert (ICM20948.gyro_limit_rad_s, ICM20948.acceleration_limit_m_s2) == (32.767, 32.767)
    assert MPU9250.gyro_limit_rad_s == pytest.approx(8.73, abs=0.01)
    assert MPU9250.acceleration_limit_m_s2 == pytest.approx(19.6, abs=0.01)
    for sensor, gyro, scale, acceleration, delay_ms in (
        (MPU9250, 0.8e-3, 0.017, 0.013, 18),
        (ICM20948, 5.3e-3, 0.009, 0.12, 10),
    ):
        assert (sensor.gyro_noise_rad_s, sensor.gyro_scale) == (gyro, scale)
        assert (sensor.acceleration_noise_m_s2, sensor.delay_ns) == (acceleration, delay_ms * 10**6)
