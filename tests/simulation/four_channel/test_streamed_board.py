from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.four_channel.streamed_board import StreamedBoard
from yahboomd.simulation.motors import FAULTS

NOT_FOUND = b"fail,Command not found!\r\n"
BANNER = b"Motor_Version:1.7.3\r\n"
RESET = b"\r\nReset MCU\r" + BANNER
RESYNC = b"\n" * 64

MakeBench = Callable[..., Any]


def board_of(desk: Any) -> StreamedBoard:
    board = desk.robot.board
    assert isinstance(board, StreamedBoard)
    return board


# Answers.


@pytest.mark.parametrize(
    "command",
    [b"$spd:0,0,0,0#", b"$pwm:0,0,0,0#", b"$upload:0,0,0#"],
    ids=lambda c: c[1:4].decode(),
)
def test_motor_and_stream_commands_are_not_answered(bench: MakeBench, command: bytes) -> None:
    assert bench().send(command, 0.5) == b""


@pytest.mark.parametrize(
    "command", [b"$read#", b"$speed:1,1,1,1#", b"$#", b"$Spd:1#", b"$nonsense#"]
)
def test_unknown_commands_are_answered_and_nothing_moves(bench: MakeBench, command: bytes) -> None:
    desk = bench()
    assert desk.send(command, 0.5) == NOT_FOUND
    assert desk.speeds() == [0.0, 0.0]


def test_settings_are_reported_as_text_lines(bench: MakeBench) -> None:
    answer = bench().send(b"$read_flash#", 0.1)
    assert answer.startswith(b"read_flash:OK!\r\nMotor_Version:1.7.3\r\nMotor_type:1\r\n")
    assert answer.endswith(b"P:0.800\t I:0.060\t D:0.500\t \r\n")


def test_the_battery_is_reported_in_a_frame(bench: MakeBench) -> None:
    assert bench(battery_volts=11.96).send(b"$read_vol#") == b"$Battery:12.0V#\r\n"


def test_a_frame_that_is_too_long_is_reported(bench: MakeBench) -> None:
    assert bench().send(b"$" + b"x" * 60 + b"#") == b"fail,command is long!\r\n"


# One command at a time.


def test_a_frame_that_ends_while_another_is_answered_is_lost(bench: MakeBench) -> None:
    desk = bench()
    answers = desk.send(b"$read_flash#$spd:300,0,300,0#", 0.5)
    assert answers.endswith(b"\r\n" + NOT_FOUND)
    assert desk.speeds() == [0.0, 0.0]


def test_the_newest_of_two_frames_wins_while_a_line_goes_out(bench: MakeBench) -> None:
    # A line of 40 bytes and more blocks the main loop for longer than two frames take.
    desk = bench(initial_ticks=(1234567, -1234567, 1234567, -1234567))
    desk.send(b"$upload:1,0,0#", 0.1)
    desk.send(b"$spd:300,0,300,0#$pwm:0,0,0,0#", 1.0)
    assert desk.speeds() == [0.0, 0.0]


def test_commands_25_ms_apart_are_all_carried_out_with_every_stream_on(bench: MakeBench) -> None:
    desk = bench(drive="skid_steer", initial_ticks=(-1234567,) * 4)
    desk.send(b"$upload:1,1,1#", 0.1)
    desk.send(b"$spd:-999,-999,-999,-999#", 1.0)
    answers = b"".join(desk.send(b"$read_vol#", 0.0259) for _ in range(200))
    answers += desk.run(0.1)
    assert answers.count(b"$Battery") == 200
    assert NOT_FOUND not in answers


def test_commands_10_ms_apart_suffice_with_totals_alone(bench: MakeBench) -> None:
    desk = bench(initial_ticks=(1234567, -123456, 1234567, -123456))
    desk.send(b"$upload:1,0,0#", 0.1)
    seen = 0
    for number in range(200):
        speed = number % 2
        desk.send(b"$pwm:%d,0,%d,0#" % (speed, speed), 0.0112)
        seen += desk.robot.plant.motors[0].pwm == 1601 * speed
    assert seen == 200


def test_commands_10_ms_apart_get_lost_with_every_stream_on(bench: MakeBench) -> None:
    desk = bench(drive="skid_steer", initial_ticks=(-1234567,) * 4)
    desk.send(b"$upload:1,1,1#", 0.1)
    carried_out = set()
    for number in range(1000, 1400):
        frame = b"$pwm:%d,%d,%d,%d#" % (number, -number, number, -number)
        frame_s = len(frame) * 10 / 115200
        for _ in range(10):
            desk.send(frame, (0.010 + frame_s) / 10)
            frame = b""
            carried_out.add(desk.robot.plant.motors[0].pwm)
    lost = 401 - len(carried_out | {0})
    assert 0.02 <= lost / 400 <= 0.25


def test_a_command_acts_soon_after_its_last_byte(bench: MakeBench) -> None:
    desk = bench()
    desk.run(0.0031)
    desk.robot.host_wrote(b"$pwm:0,0,9,0#", desk.now_ns)
    last_byte_ns = desk.now_ns + 13 * 86_806
    while not desk.robot.plant.motors[1].pwm:
        desk.run(0.0001)
    assert 30_000 <= desk.now_ns - last_byte_ns <= 130_000


def test_64_newlines_make_the_next_command_safe(bench: MakeBench) -> None:
    desk = bench()
    desk.send(b"$spd:100,1", 0.1)
    answer = desk.send(RESYNC + b"$pwm:0,0,77,0#", 0.1)
    assert answer == b"fail,command is long!\r\n"
    assert desk.robot.plant.motors[1].pwm == 1677


# Numbers.


@pytest.mark.parametrize(
    ("numbers", "pwm"),
    [
        (b"100,0,200,0", (1700, 1800)),
        (b"100", (1700, 0)),
        (b"", (0, 0)),
        (b"9999,0,-9999,0", (3600, -3600)),
        (b"40000,0,100100,0", (-3600, -3600)),
        (b"2000,0,-1,0", (3600, -1601)),
        (b"1,2,3,4,5,6,7,8,9,10,11,12,13", (1601, 1603)),
    ],
)
def test_numbers_are_filled_wrapped_and_clamped_and_the_dead_zone_is_added(
    bench: MakeBench, numbers: bytes, pwm: tuple[int, int]
) -> None:
    desk = bench()
    desk.send(b"$pwm:" + numbers + b"#", 0.05)
    assert tuple(motor.pwm for motor in desk.robot.plant.motors) == pwm


def test_a_lost_comma_drives_full_speed_backward(bench: MakeBench) -> None:
    desk = bench()
    desk.send(b"$spd:100100,0,0,0#", 2.0)
    assert desk.speeds()[0] == pytest.approx(-1.0, abs=0.03)


@pytest.mark.parametrize("command", [b"spd", b"pwm"])
def test_14_numbers_hang_the_board_with_the_motors_running(
    bench: MakeBench, command: bytes
) -> None:
    desk = bench()
    desk.send(b"$pwm:3000,0,3000,0#", 0.5)
    desk.send(b"$%s:%s#" % (command, b",".join([b"0"] * 14)), 0.5)
    assert desk.send(b"$pwm:0,0,0,0#$read_flash#", 2.0) == b""
    assert min(desk.speeds()) > 0.5


@pytest.mark.parametrize(
    ("before", "size", "hangs"),
    [
        (b"$x#", 49, False),
        (b"$x#", 50, True),
        (b"$x#", 51, True),
        (b"$mtype:1#", 50, False),
        (b"", 50, False),
    ],
)
def test_a_command_that_fills_its_memory_goes_on_with_the_latest_answer(
    bench: MakeBench, before: bytes, size: int, hangs: bool
) -> None:
    desk = bench()
    desk.send(before, 0.1)
    # Eleven numbers; of the answers "fail,Command not found!" has three more.
    command = b"pwm:" + b",".join([b"0"] * 11).rjust(size - 4, b"0")
    desk.send(b"$%s#" % command, 0.1)
    assert (desk.send(b"$read_vol#", 0.1) == b"") is hangs


# Motion.


def test_speeds_hold_for_ever_without_a_host(bench: MakeBench) -> None:
    desk = bench()
    desk.send(b"$spd:300,0,300,0#", 30.0)
    assert desk.speeds() == pytest.approx([0.3, 0.3], abs=0.01)


def test_speed_zero_does_not_stop_a_wheel_without_encoder_and_output_zero_does(
    bench: MakeBench,
) -> None:
    desk = bench()
    desk.robot.set_faults("left", FAULTS["encoder-dead"], now_ns=desk.now_ns)
    desk.send(b"$spd:100,0,100,0#", 3.0)
    desk.send(b"$spd:0,0,0,0#", 3.0)
    left, right = desk.speeds()
    assert left > 0.9
    assert right == 0.0
    desk.send(b"$pwm:0,0,0,0#", 3.0)
    assert desk.speeds() == [0.0, 0.0]


def test_the_type_without_encoders_freezes_the_outputs(bench: MakeBench) -> None:
    desk = bench()
    desk.send(b"$spd:300,0,300,0#", 1.0)
    desk.send(b"$mtype:4#", 0.3)
    desk.send(b"$spd:0,0,0,0#", 2.0)
    assert min(desk.speeds()) > 0.25


# Flash.


def test_a_changed_setting_is_stored_and_confirmed_after_65_to_116_ms(bench: MakeBench) -> None:
    desk = bench()
    assert desk.send(b"$mline:13#", 0.06) == b""
    assert desk.run(0.07) == b"Set mline:OK!\r\n"
    assert board_of(desk).flash.lines == 13
    assert desk.send(b"$mline:13#") == b"Set mline:OK!\r\n"


@pytest.mark.parametrize(
    ("motor_type", "least_ns", "most_ns"), [(1, 400_000, 900_000), (4, 0, 10_000)]
)
def test_speed_loops_hold_up_a_write_but_with_the_type_without_encoders(
    bench: MakeBench, motor_type: int, least_ns: int, most_ns: int
) -> None:
    took_ns = []
    for command in (b"$pwm:0,0,0,0#", b"$spd:300,0,300,0#"):
        desk = bench(flash=FlashContent(motor_type=motor_type))
        desk.send(command, 0.5)
        desk.send(b"$mline:13#", 0.001)
        page = board_of(desk)._write
        assert page is not None
        assert desk.run(0.2) == b"Set mline:OK!\r\n"
        took_ns.append(page.filled_ns - page.begin_ns)
    # Six interrupts or so, as on the firmware: 0.5 ms.
    assert least_ns <= took_ns[1] - took_ns[0] < most_ns


def test_the_board_is_deaf_while_it_writes_flash(bench: MakeBench) -> None:
    desk = bench()
    desk.send(b"$mline:13#", 0.01)
    assert desk.send(b"$mphase:20#", 0.3) == b"Set mline:OK!\r\n"
    assert board_of(desk).flash == FlashContent(lines=13)


def test_settings_100_ms_apart_are_not_all_stored(bench: MakeBench) -> None:
    stored = 0
    for seed in range(10):
        desk = bench(seed=seed)
        for command in (b"mtype:2", b"deadzone:1", b"mline:1", b"mphase:1", b"wdiameter:1"):
            desk.send(b"$" + command + b"#", 0.1)
        desk.run(0.3)
        flash, untouched = board_of(desk).flash, FlashContent()
        stored += sum(
            getattr(flash, name) != getattr(untouched, name) for name in flash.__struct_fields__
        )
    assert 10 <= stored < 50


def test_a_changed_gain_resets_the_board_without_an_answer(bench: MakeBench) -> None:
    desk = bench()
    desk.send(b"$pwm:3000,0,3000,0#", 0.5)
    answer = desk.send(b"$MPID:0.9,0.06,0.5#", 0.6)
    assert answer == RESET
    assert board_of(desk).flash == FlashContent(p=0.9)
    assert [motor.pwm for motor in desk.robot.plant.motors] == [0, 0]


def test_power_that_fails_within_a_write_leaves_erased_values_or_those_it_is_sold_with(
    bench: MakeBench,
) -> None:
    left = set()
    for seed in range(40):
        desk = bench(seed=seed, flash=FlashContent(dead_zone=1700))
        board_of(desk).cut_writes = 1
        assert desk.send(b"$mline:13#", 0.3) == BANNER
        shown = desk.send(b"$read_flash#", 0.1)
        erased = shown.count(b"65535") + shown.count(b":255") + shown.count(b"-680564693277")
        if not erased:
            assert board_of(desk).flash == FlashContent()
        else:
            assert (b"Pulse_Line:13" in shown) == (erased <= 5)
            assert b"Dead_Zone:1600" not in shown
        left.add(erased)
        assert desk.send(b"$spd:200,0,200,0#", 0.5) == b""
        assert desk.send(b"$mline:12#", 0.3) == b"Set mline:OK!\r\n"
        assert board_of(desk).flash.lines == 12
    assert left == set(range(9))


def test_the_same_gains_are_confirmed_without_a_reset(bench: MakeBench) -> None:
    assert bench().send(b"$MPID:0.8,0.06,0.5#") == b"Set MPID:OK!\r\n"


def test_a_factory_reset_answers_then_resets(bench: MakeBench) -> None:
    desk = bench(flash=FlashContent(lines=0))
    assert desk.send(b"$flash_reset#", 1.5) == b"falsh_reset:OK!\r\n" + RESET
    assert board_of(desk).flash == FlashContent()


# Streams.


def test_totals_arrive_at_the_rate_seen_on_boards(bench: MakeBench) -> None:
    desk = bench()
    desk.send(b"$upload:1,0,0#", 2.0)
    assert len(desk.totals()) / 2.0 == pytest.approx(407, rel=0.02)


def test_lines_can_follow_each_other_without_a_pause(bench: MakeBench) -> None:
    desk = bench(stream_pace="wire")
    desk.send(b"$upload:1,0,0#", 0.1)
    assert len(desk.run(1.0)) == pytest.approx(11_520, abs=20)


def test_totals_change_every_10_ms_and_lines_repeat_them(bench: MakeBench) -> None:
    desk = bench()
    desk.send(b"$pwm:3000,0,3000,0#", 1.0)
    desk.send(b"$upload:1,0,0#", 1.0)
    values = [line[0] for line in desk.totals()]
    assert len(set(values)) in range(97, 101)
    assert len(values) > 150


def test_all_streams_run_at_once_without_mixing_their_lines(bench: MakeBench) -> None:
    desk = bench()
    desk.send(b"$spd:300,0,300,0#", 1.0)
    text = desk.send(b"$upload:1,1,1#", 3.0).decode()
    lines = text.split("\r\n")[:-1]
    assert all(line[0] == "$" and line[-1] == "#" and line.count("$") == 1 for line in lines)
    speeds = [line for line in lines if line.startswith("$MSPD:")]
    assert len(speeds) == pytest.approx(50, abs=2)
    left = float(speeds[-1][6:].split(",")[0])
    assert left / 15.946 == pytest.approx(round(left / 15.946), abs=1e-3)
    assert any(line.startswith("$MTEP:") for line in lines)


def test_answers_do_not_tear_stream_lines(bench: MakeBench) -> None:
    desk = bench()
    desk.send(b"$upload:1,0,0#", 0.1)
    text = desk.send(b"$read_vol#", 0.1).decode()
    assert "\r\n$Battery:7.4V#\r\n$MAll:" in text


def test_a_stream_can_be_switched_off(bench: MakeBench) -> None:
    desk = bench()
    desk.send(b"$upload:1,1,1#", 0.1)
    desk.send(b"$upload:0,0,0#", 0.05)
    assert desk.run(0.5) == b""


def test_totals_wrap(bench: MakeBench) -> None:
    desk = bench(initial_ticks=(2147483627, 0, 0, 0))
    desk.send(b"$upload:1,0,0#", 0.1)
    desk.send(b"$spd:300,0,0,0#", 1.0)
    assert desk.totals()[-1][0] < -2147480000


@pytest.mark.parametrize(
    ("ticks", "refused"), [((-12345678, 2345678) * 2, 0), ((-1234567890,) * 4, 1)]
)
def test_lines_of_50_bytes_spoil_what_the_board_receives(
    bench: MakeBench, ticks: tuple[int, ...], refused: int
) -> None:
    desk = bench(initial_ticks=ticks)
    desk.send(b"$upload:1,0,0#", 0.1)
    answers = b"".join(desk.send(b"$spd:0,0,0,0#", 0.03) for _ in range(400))
    share = answers.count(NOT_FOUND) / 400
    assert 0.07 * refused <= share <= 0.16 * refused


# Resets.


def test_a_reset_in_motion_zeroes_counters_and_streams_and_lets_the_wheels_coast(
    bench: MakeBench,
) -> None:
    desk = bench()
    desk.send(b"$upload:1,0,0#", 0.05)
    desk.send(b"$spd:500,0,500,0#", 1.0)
    desk.robot.reset(desk.now_ns)
    said = desk.run(0.08)
    assert RESET in said
    assert min(desk.speeds()) > 0.1
    assert desk.run(0.1) == b""
    desk.send(b"$upload:1,0,0#", 2.0)
    assert 0 < desk.totals()[-1][0] < 400
    assert desk.speeds() == [0.0, 0.0]


def test_power_brings_the_banner_alone(bench: MakeBench) -> None:
    desk = bench()
    desk.robot.brown_out(desk.now_ns, 0.2)
    assert desk.run(0.2) == b""
    assert desk.run(0.1) == BANNER


def test_a_reset_cuts_the_line_that_is_going_out(bench: MakeBench) -> None:
    desk = bench(stream_pace="wire")
    desk.send(b"$upload:1,0,0#", 0.0501)
    desk.robot.reset(desk.now_ns)
    desk.run(0.2)
    text = b"".join(chunk for _, chunk in desk.chunks)
    head, _, _ = text.partition(RESET[:5])
    assert not head.endswith(b"\r\n")


def test_the_flash_survives_a_reset(bench: MakeBench) -> None:
    desk = bench(flash=FlashContent(lines=13))
    desk.robot.reset(desk.now_ns)
    desk.run(0.2)
    assert b"Pulse_Line:13\r\n" in desk.send(b"$read_flash#", 0.1)


# The period of the totals.


def renewals_ms(desk: Any, seconds: float) -> list[int]:
    """After how many milliseconds the totals of a turning board changed, each time."""
    board = board_of(desk)
    found, before = [], board.totals
    for ms in range(1, round(seconds * 1000) + 1):
        desk.run(0.001)
        if board.totals != before:
            found.append(ms)
            before = board.totals
    return found


@pytest.mark.parametrize("period_ms", [5, 10, 20, 40])
def test_the_totals_are_renewed_at_the_period_that_was_asked_for(
    bench: MakeBench, period_ms: int
) -> None:
    desk = bench(tick_period_s=period_ms / 1000)
    desk.send(b"$upload:1,0,0#", 0.1)
    desk.send(b"$spd:500,0,500,0#", 1.0)
    found = renewals_ms(desk, 1.0)
    assert {b - a for a, b in pairwise(found)} == {period_ms}
    assert desk.speeds() == pytest.approx([0.5, 0.5], abs=0.03)


def test_a_period_of_zero_renews_the_totals_with_every_line(bench: MakeBench) -> None:
    desk = bench(tick_period_s=0.0, initial_ticks=(123456, 0, 123456, 0))
    desk.send(b"$upload:1,0,0#", 0.1)
    lines = [line for line in desk.send(b"$spd:500,0,500,0#", 2.0).split(b"\r\n") if line]
    turning = lines[len(lines) // 2 : -1]
    assert len(set(turning)) == len(turning) > 100


def test_an_irregular_period_is_never_shorter_and_can_be_set_while_it_runs(
    bench: MakeBench,
) -> None:
    desk = bench()
    desk.send(b"$upload:1,0,0#", 0.1)
    desk.send(b"$spd:500,0,500,0#", 1.0)
    desk.robot.set_tick_period(desk.now_ns, 0.02, 0.01)
    desk.run(0.1)
    gaps = {b - a for a, b in pairwise(renewals_ms(desk, 1.0))}
    assert len(gaps) > 4
    assert 20 <= min(gaps) <= max(gaps) <= 31
