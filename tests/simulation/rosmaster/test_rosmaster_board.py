"""The simulated board, by bytes and truth alone."""

from __future__ import annotations

import struct
from collections import Counter

import pytest

from yahboomd.simulation.options import PLAIN_GAIN, SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored

MS = 1_000_000
S = 1_000 * MS


def frame(function: int, *payload: int) -> bytes:
    inside = bytes((len(payload) + 3, function, *payload))
    return b"\xff\xfc" + inside + bytes((sum(inside) & 0xFF,))


def motion(vx: int, vy: int = 0, wz: int = 0) -> bytes:
    return frame(0x12, 1, *struct.pack("<3h", vx, vy, wz))


class Desk:
    """A robot and its sent bytes, with their times."""

    def __init__(self, **options: object) -> None:
        self.robot = SimulatedRobot(
            SimulationOptions(dialect="rosmaster", **options)  # type: ignore[arg-type]
        )
        self.robot.start(0)
        self.now_ns = 0
        self.heard: list[tuple[int, bytes]] = []

    def write(self, data: bytes, then_ms: int = 50) -> None:
        self.robot.host_wrote(data, self.now_ns)
        self.run(then_ms)

    def run(self, ms: int) -> None:
        for _ in range(ms):
            self.now_ns += MS
            self.heard += [(self.now_ns, data) for data in self.robot.host_reads(self.now_ns)]

    def since(self, ns: int) -> bytes:
        return b"".join(data for at_ns, data in self.heard if at_ns > ns)

    def frames(self, since_ns: int = 0) -> list[tuple[int, bytes]]:
        """Function and payload of all whole frames."""
        data, found = self.since(since_ns), []
        while (at := data.find(b"\xff\xfb")) >= 0:
            size = data[at + 2] + 2
            whole = data[at : at + size]
            if len(whole) == size and sum(whole[2:-1]) & 0xFF == whole[-1]:
                found.append((whole[3], whole[4:-1]))
                data = data[at + size :]
            else:
                data = data[at + 1 :]
        return found

    @property
    def speeds(self) -> list[float]:
        return [abs(speed) for speed in self.robot.truth(self.now_ns).speed_m_s]


@pytest.mark.parametrize(("imu", "raw"), [("mpu9250", 0x0B), ("icm20948", 0x0E)])
def test_it_reports_four_kinds_in_a_cycle_of_41_ms(imu: str, raw: int) -> None:
    desk = Desk(flash=RosmasterStored(imu=imu))
    desk.run(4_100)
    kinds = Counter(function for function, _ in desk.frames())
    assert set(kinds) == {0x0A, raw, 0x0C, 0x0D}
    assert all(count == pytest.approx(100, abs=1) for count in kinds.values())


def test_without_a_sensor_it_reports_speed_and_counts_and_switched_off_nothing() -> None:
    desk = Desk(flash=RosmasterStored(imu=""))
    desk.run(200)
    assert {function for function, _ in desk.frames()} == {0x0A, 0x0D}
    desk.write(frame(0x01, 0, 0))
    silent_ns = desk.now_ns
    desk.run(200)
    assert desk.frames(silent_ns) == []


def test_it_drives_brakes_coasts_and_acknowledges_nothing() -> None:
    desk = Desk(flash=RosmasterStored(imu=""))
    desk.write(motion(300), 1500)
    assert min(desk.speeds) == pytest.approx(0.31, abs=0.02)
    assert {function for function, _ in desk.frames()} == {0x0A, 0x0D}
    desk.write(motion(0), 400)
    assert max(desk.speeds) < 0.02
    desk.write(motion(300), 1000)
    desk.write(frame(0x11, 1, 0, 0, 0), 50)
    assert all(motor.pwm == 0 for motor in desk.robot.plant.motors)


def test_the_last_target_runs_for_ever() -> None:
    desk = Desk()
    desk.write(motion(300), 1000)
    desk.robot.unplug(desk.now_ns)
    desk.run(20_000)
    assert min(desk.speeds) > 0.25


def test_frames_without_a_gap_are_lost_and_5_ms_apart_none_is() -> None:
    desk = Desk(flash=RosmasterStored(imu="", auto_report=0))
    answered = {0: 0, 5: 0}
    for phase_us in range(0, 1000, 50):
        for gap_ms in answered:
            before_ns = desk.now_ns
            first_ns = desk.now_ns + phase_us * 1000
            desk.robot.host_wrote(frame(0x50, 0x15, 0), first_ns)
            desk.robot.host_wrote(frame(0x50, 0x51, 0), first_ns + gap_ms * MS)
            desk.run(30)
            found = [function for function, _ in desk.frames(before_ns)]
            answered[gap_ms] += len(found)
    assert answered[5] == 40
    # Of two, the one that is looked at while the other arrives is lost, or both are.
    assert 20 <= answered[0] <= 24


def test_it_answers_version_type_gains_and_voltage() -> None:
    desk = Desk(flash=RosmasterStored(car_type=2, imu="", auto_report=0), battery_volts=8.0)
    for function, parameter in ((0x51, 0), (0x15, 0), (0x13, 1), (0x01, 0)):
        desk.write(frame(0x50, function, parameter), 20)
    assert desk.frames() == [
        (0x51, b"\x03\x05"),
        (0x15, b"\x02\x00"),
        (0x13, struct.pack("<B3H", 1, 800, 60, 500)),
        (0x0A, struct.pack("<3hB", 0, 0, 0, 80)),
    ]


def test_settings_last_over_a_reset_only_where_they_were_saved_and_odd_types_are_refused() -> None:
    desk = Desk(start_up_s=0.1)
    board = desk.robot.board
    desk.write(frame(0x15, 4, 0))
    desk.write(frame(0x15, 7, 0x5F))
    assert board.flash.car_type == 1  # type: ignore[attr-defined]
    desk.write(frame(0x15, 6, 0x5F), 250)
    assert board.flash.p == 1.5  # type: ignore[attr-defined]
    desk.write(frame(0x13, *struct.pack("<3H", 1000, 100, 400), 0x5F), 100)
    stored = board.flash  # type: ignore[attr-defined]
    assert (stored.car_type, stored.p, stored.i, stored.d) == (6, 1.0, 0.1, 0.4)


def test_gains_are_shown_as_a_float_of_32_bits_and_cut() -> None:
    desk = Desk(flash=RosmasterStored(imu="", auto_report=0))
    desk.write(frame(0x13, *struct.pack("<3H", 251, 60, 502), 0))
    desk.write(frame(0x50, 0x13, 1), 20)
    assert desk.frames() == [(0x13, struct.pack("<B3H", 1, 250, 60, 501))]


def test_after_a_reset_it_says_its_version_and_is_silent_for_ten_seconds() -> None:
    desk = Desk()
    desk.write(motion(300), 1000)
    reset_ns = desk.now_ns
    desk.robot.reset(reset_ns)
    desk.run(10_000)
    assert b"\nFirmware Version: V3.5.1\n" in desk.since(reset_ns)
    assert desk.frames(reset_ns + 5 * MS) == []
    assert max(desk.speeds) < 0.01
    desk.run(1_000)
    counts = [payload for function, payload in desk.frames(reset_ns + 5 * MS) if function == 0x0D]
    assert counts
    assert counts[0] == bytes(16)


def test_the_last_frame_of_the_silence_is_carried_out_at_its_end() -> None:
    desk = Desk()
    desk.robot.reset(desk.now_ns)
    desk.run(1_000)
    desk.write(motion(300), 9_000)
    assert max(desk.speeds) == 0.0
    desk.run(2_000)
    assert min(desk.speeds) > 0.25


@pytest.mark.parametrize(
    ("car_type", "volts", "latches"),
    [
        *((1, 9.0, True), (1, 13.5, True), (1, 10.0, False), (1, 7.4, False), (1, 5.0, True)),
        *((6, 8.8, True), (6, 10.0, True), (6, 7.0, False), (6, 6.2, True)),
    ],
)
def test_a_battery_too_low_or_too_high_for_two_seconds_silences_it_until_a_reset(
    car_type: int, volts: float, latches: bool
) -> None:
    fine = 8.0 if car_type == 6 else 11.0
    flash = RosmasterStored(car_type=car_type)
    desk = Desk(battery_volts=fine, rated_volts=fine, start_up_s=0.2, flash=flash)
    desk.write(motion(200), 500)
    desk.robot.plant.battery_volts = volts
    desk.run(3_000)
    desk.robot.plant.battery_volts = fine
    quiet_ns = desk.now_ns
    desk.write(motion(200), 1_000)
    assert (desk.frames(quiet_ns) == []) is latches
    assert (max(desk.speeds) < 0.01) is latches
    desk.write(frame(0x50, 0x51, 0))
    assert (0x51, b"\x03\x05") in desk.frames(quiet_ns)
    desk.robot.reset(desk.now_ns)
    desk.run(1_000)
    assert 0x0D in {function for function, _ in desk.frames(desk.now_ns - 500 * MS)}


def test_the_open_loop_is_undone_by_the_speed_loops_but_after_a_stop() -> None:
    desk = Desk()
    desk.write(motion(100), 1_000)
    desk.write(frame(0x10, 100, 0, 100, 0), 1_000)
    assert max(desk.speeds) < 0.15
    desk.write(motion(0), 500)
    desk.write(frame(0x10, 100, 0, 100, 0), 1_000)
    assert max(desk.speeds) > 0.9
    desk.write(motion(0), 500)
    assert max(desk.speeds) < 0.01


def test_the_gyro_shows_a_turn_and_the_voltage_is_cut_to_tenths() -> None:
    desk = Desk(battery_volts=8.29)
    desk.write(motion(0, 0, 1000), 2_000)
    raw = [payload for function, payload in desk.frames() if function == 0x0B][-1]
    wz = struct.unpack("<9h", raw)[2] / 3754.9
    truth = desk.robot.truth(desk.now_ns)
    assert wz == pytest.approx(truth.wz, rel=0.1)
    speed = next(payload for function, payload in desk.frames() if function == 0x0A)
    assert speed[6] == 82


def test_a_board_that_hangs_keeps_its_outputs_and_has_no_period_to_set() -> None:
    desk = Desk()
    desk.write(motion(300), 1_000)
    desk.robot.hang(desk.now_ns)
    hung_ns = desk.now_ns
    desk.write(motion(0), 1_000)
    assert min(desk.speeds) > 0.25
    assert desk.frames(hung_ns + 5 * MS) == []
    with pytest.raises(ValueError, match="every 41 ms"):
        desk.robot.set_tick_period(desk.now_ns, 0.01)


@pytest.mark.parametrize(("firmware", "stored"), [("3.5.1", 2), ("3.6.5", 10)])
def test_the_type_of_an_m1_is_taken_by_later_firmware_alone(firmware: str, stored: int) -> None:
    desk = Desk(firmware=firmware, flash=RosmasterStored(car_type=2))
    desk.write(frame(0x15, 10, 0x5F), 250)
    assert desk.robot.board.flash.car_type == stored  # type: ignore[attr-defined]
    # The A1's is not known of any firmware here.
    desk.write(frame(0x15, 9, 0x5F), 250)
    assert desk.robot.board.flash.car_type == stored  # type: ignore[attr-defined]


@pytest.mark.parametrize("function", [0x13, 0x15, 0x30, 0xA0])
def test_it_is_deaf_and_holds_its_outputs_while_it_writes_its_flash(function: int) -> None:
    payloads = {
        0x13: (*struct.pack("<3H", 900, 60, 500), 0x5F),
        0x15: (4, 0x5F),
        0x30: (1, 80, 0x5F),
        0xA0: (0x5F,),
    }
    desk = Desk(start_up_s=0.2)
    desk.write(motion(300), 1_000)
    desk.write(frame(function, *payloads[function]), 2)
    outputs = [motor.pwm for motor in desk.robot.plant.motors]
    at_ns = desk.now_ns
    desk.write(motion(0), 70)
    assert [motor.pwm for motor in desk.robot.plant.motors] == outputs
    assert desk.frames(at_ns + 5 * MS) == []
    desk.run(1_000)
    reports = {kind for kind, _ in desk.frames(desk.now_ns - 100 * MS)}
    assert 0x0D in reports
    # The stop was lost, a factory reset left aside.
    assert (min(desk.speeds) > 0.25) == (function != 0xA0)


def test_a_latched_board_shows_the_voltage_of_its_alarm_and_coasts_between_two_brakes() -> None:
    desk = Desk(battery_volts=11.0, rated_volts=11.0)
    desk.write(motion(200), 500)
    desk.robot.plant.battery_volts = 9.05
    seen: list[int] = []
    for _ in range(2_400):
        desk.run(1)
        pwm = desk.robot.plant.motors[0].pwm
        if desk.robot.board._alarm.latched and (not seen or pwm != seen[-1]):  # type: ignore[attr-defined]
            seen.append(pwm)
    assert seen == [1, 0, 1]
    desk.robot.plant.battery_volts = 11.0
    before_ns = desk.now_ns
    desk.write(frame(0x50, 0x01, 0), 20)
    ((_, speed),) = desk.frames(before_ns)
    assert speed[6] in {87, 88, 89}
    # A car type resets it.
    desk.write(frame(0x15, 1, 0), 40)
    assert desk.robot.board._alarm.latched  # type: ignore[attr-defined]
    desk.run(30)
    assert not desk.robot.board._alarm.latched  # type: ignore[attr-defined]


def test_after_a_start_it_reports_no_voltage_until_it_has_measured_one() -> None:
    desk = Desk(battery_volts=7.4, start_up_s=0.2)
    desk.robot.reset(desk.now_ns)
    desk.run(600)
    tenths = [payload[6] for kind, payload in desk.frames() if kind == 0x0A]
    assert tenths[:2] == [0, 0]
    assert set(tenths[3:]) == {74}


def test_the_other_way_round_of_counting_of_another_type_runs_away() -> None:
    desk = Desk(flash=RosmasterStored(car_type=1, imu=""))
    desk.write(frame(0x15, 2, 0))
    desk.write(motion(200), 1_500)
    assert min(desk.speeds) > 0.9
    counts = [payload for kind, payload in desk.frames() if kind == 0x0D][-1]
    assert struct.unpack("<4i", counts)[0] < 0


def test_yaw_gains_and_the_centre_of_the_steering_are_kept_and_shown() -> None:
    desk = Desk(flash=RosmasterStored(imu="", auto_report=0))
    desk.write(frame(0x14, *struct.pack("<3H", 500, 1, 200), 0x5F), 100)
    desk.write(frame(0x30, 1, 80, 0x5F), 100)
    desk.write(frame(0x50, 0x14, 5), 20)
    desk.write(frame(0x50, 0x30, 1), 20)
    assert desk.frames() == [(0x14, struct.pack("<B3H", 5, 500, 1, 200)), (0x30, b"\x01\x50")]
    stored = desk.robot.board.flash  # type: ignore[attr-defined]
    assert (stored.yaw_p, stored.yaw_i, stored.yaw_d, stored.steering_centre) == (
        0.5,
        0.001,
        0.2,
        80,
    )


X3_ON_ITS_FLOOR = {
    "drive": "mecanum",
    "loop_gain": PLAIN_GAIN,
    "rated_volts": 12.0,
    "motor_dead_zone": 1620,
    "friction_scales": (1.0, 1.02, 0.98, 1.0),
    "sticks": (1.87, 1.9, 1.86, 1.85),
}


@pytest.mark.parametrize(
    ("volts", "command", "seconds", "wheels"),
    [
        (10.3, motion(0, wz=120), 4.0, 0),
        (10.3, motion(0, wz=300), 4.0, 0),
        (10.3, motion(0, wz=500), 4.0, 3),
        (10.1, motion(100), 3.0, 0),
        (10.3, motion(120), 3.0, 3),
        (11.2, motion(150), 3.0, 4),
    ],
)
def test_a_plant_does_what_a_real_x3_did_on_its_floor(
    volts: float, command: bytes, seconds: float, wheels: int
) -> None:
    """Turns of 0.12 and 0.30 rad/s: none; 0.50: turns; 0.10, 0.12, 0.15 m/s: none, uneven, all."""
    desk = Desk(battery_volts=volts, **X3_ON_ITS_FLOOR)
    desk.write(command, then_ms=round(seconds * 1000))
    travel_m = desk.robot.truth(desk.now_ns).travel_m
    assert sum(abs(each) > 0.0 for each in travel_m) == wheels
