from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import pytest

from yahboomd.core.errors import ConfigError
from yahboomd.simulation.motors import FAULTS, MotorFaults
from yahboomd.simulation.options import ImpairmentOptions, SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.truth import TruthSample

MakeBench = Callable[..., Any]


def test_an_impossible_robot_is_refused() -> None:
    with pytest.raises(ConfigError):
        SimulatedRobot(SimulationOptions(wheel_radius_m=-1.0))


def test_the_pose_follows_from_the_counts_within_a_tick(bench: MakeBench) -> None:
    desk = bench()
    desk.send(b"$spd:300,0,400,0#", 5.0)
    truth = desk.robot.truth(desk.now_ns)
    metres_per_tick = 2 * math.pi * 0.0335 / 1320
    left, right = truth.travel_m
    assert left == pytest.approx(truth.ticks[0] * metres_per_tick, abs=0.01)
    assert truth.theta == pytest.approx((right - left) / 0.15)
    assert truth.vx == pytest.approx(0.35, abs=0.01)


def test_truth_is_recorded_every_10_ms_however_often_it_is_read(bench: MakeBench) -> None:
    samples: list[TruthSample] = []
    desk = bench()
    desk.robot.on_truth = samples.append
    desk.send(b"$spd:300,0,300,0#", 1.0)
    desk.robot.advance(desk.now_ns + 1_000_000_000)
    stamps = [sample.t_ns for sample in samples]
    assert {b - a for a, b in itertools.pairwise(stamps)} == {10_000_000}
    assert len(stamps) >= 199


def test_what_arrived_waits_for_the_host_however_often_others_look(bench: MakeBench) -> None:
    desk = bench()
    desk.robot.host_wrote(b"$read_vol#", desk.now_ns)
    for step in range(1, 40):
        desk.robot.advance(desk.now_ns + step * 1_000_000)
        desk.robot.truth(desk.now_ns + step * 1_000_000)
    assert b"".join(desk.robot.host_reads(desk.now_ns + 40_000_000)) == b"$Battery:7.4V#\r\n"


def test_a_late_caller_loses_no_precision(bench: MakeBench) -> None:
    # Driving takes as long as the newlines behind it are on the wire.
    driven = b"$spd:300,0,500,0#" + b"\n" * 8000 + b"$pwm:0,0,0,0#"
    poses = []
    for step_s in (0.001, 0.5):
        desk = bench()
        desk.robot.host_wrote(driven, desk.now_ns)
        for _ in range(round(2.0 / step_s)):
            desk.now_ns += round(step_s * 1e9)
            desk.robot.advance(desk.now_ns)
        poses.append(desk.robot.truth(desk.now_ns))
    assert poses[0].x == pytest.approx(poses[1].x, abs=1e-6)
    assert poses[0].ticks == poses[1].ticks


def test_a_late_caller_confuses_no_two_frames(bench: MakeBench) -> None:
    desk = bench()
    desk.robot.host_wrote(b"$pwm:0,0,7,0#" + b"\n" * 20 + b"$read_vol#", desk.now_ns)
    heard = b"".join(desk.robot.host_reads(desk.now_ns + 1_000_000_000))
    assert heard == b"$Battery:7.3V#\r\n"
    assert desk.robot.plant.motors[1].pwm == 1607


def test_the_same_seed_makes_the_same_run(bench: MakeBench) -> None:
    runs = []
    for _ in range(2):
        desk = bench(seed=3, impairments=ImpairmentOptions(loss=0.05, jitter_s=0.002))
        desk.send(b"$upload:1,0,0#", 0.1)
        desk.send(b"$spd:300,0,300,0#", 1.0)
        runs.append(desk.chunks)
    assert runs[0] == runs[1]


def test_bytes_take_their_time_on_the_wire_both_ways(bench: MakeBench) -> None:
    desk = bench(dialect="polled")
    start_ns = desk.now_ns
    desk.send(b"$read#", 0.05)
    arrived_ns, _ = desk.chunks[-1]
    wire_ns = (len("$read#") + len("$data:0,0,0,0#")) * 86_806
    assert wire_ns <= arrived_ns - start_ns <= wire_ns + 300_000


def test_a_last_byte_is_handed_over_when_the_line_falls_silent(bench: MakeBench) -> None:
    desk = bench(dialect="polled")
    desk.send(b"$read#", 0.05)
    assert desk.chunks[-1][0] % 1_000_000 != 0


def test_chunks_come_with_their_period(bench: MakeBench) -> None:
    desk = bench(impairments=ImpairmentOptions(chunk_s=0.016, flush_when_idle=False))
    desk.send(b"$read_flash#", 0.1)
    assert len(desk.chunks) == 2
    assert all(at_ns % 16_000_000 == 0 for at_ns, _ in desk.chunks)


def test_bytes_can_come_one_at_a_time(bench: MakeBench) -> None:
    desk = bench(impairments=ImpairmentOptions(chunk_s=0.0))
    answer = desk.send(b"$read_vol#", 0.1)
    assert answer == b"$Battery:7.4V#\r\n"
    assert [len(chunk) for _, chunk in desk.chunks] == [1] * len(answer)


def test_delay_and_jitter_keep_the_order(bench: MakeBench) -> None:
    line = ImpairmentOptions(delay_s=0.02, jitter_s=0.01)
    desk = bench(impairments=line)
    start_ns = desk.now_ns
    answer = desk.send(b"$read_flash#", 0.3)
    assert answer.endswith(b"D:0.500\t \r\n")
    assert answer.startswith(b"read_flash:OK!\r\n")
    assert desk.chunks[0][0] - start_ns > 40_000_000


def test_lost_bytes_are_lost_both_ways(bench: MakeBench) -> None:
    desk = bench(impairments=ImpairmentOptions(loss=1.0))
    assert desk.send(b"$read_vol#") == b""
    desk.robot.impairments.clear()
    assert desk.send(b"$read_vol#") != b""


def test_a_muted_board_still_listens(bench: MakeBench) -> None:
    desk = bench()
    desk.robot.mute(desk.now_ns, 0.5)
    assert desk.send(b"$read_vol#", 0.2) == b""
    desk.send(b"$pwm:0,0,7,0#", 0.1)
    assert desk.robot.plant.motors[1].pwm == 1607
    desk.run(0.3)
    assert desk.send(b"$read_vol#") != b""


def test_a_port_that_takes_nothing_passes_on_what_has_queued_when_it_takes_again(
    bench: MakeBench,
) -> None:
    desk = bench()
    desk.robot.stall(desk.now_ns, 0.5)
    desk.send(b"$pwm:0,0,7,0#", 0.4)
    assert desk.robot.plant.motors[1].pwm == 0
    assert desk.robot.host_backlog_ns(desk.now_ns) == pytest.approx(100_000_000, abs=2_000_000)
    desk.run(0.2)
    assert desk.robot.plant.motors[1].pwm == 1607


def test_what_is_held_back_arrives_whole_and_at_once(bench: MakeBench) -> None:
    desk = bench(dialect="polled")
    end_ns = desk.now_ns + 500_000_000
    desk.robot.hold(desk.now_ns, 0.5)
    for _ in range(5):
        assert desk.send(b"$read#", 0.05) == b""
    assert desk.run(0.5) == b"$data:0,0,0,0#" * 5
    assert {at_ns for at_ns, _ in desk.chunks} == {end_ns}


def test_answers_of_one_kind_are_lost_and_others_arrive(bench: MakeBench) -> None:
    desk = bench()
    desk.robot.impairments.unanswered[b"$Battery"] = 1.0
    assert desk.send(b"$read_vol#") == b""
    assert b"Motor_Version" in desk.send(b"$read_flash#", 0.1)
    desk.robot.impairments.clear()
    assert desk.send(b"$read_vol#") == b"$Battery:7.4V#\r\n"


def test_babble_fills_the_wire_and_ends(bench: MakeBench) -> None:
    desk = bench()
    desk.robot.babble(desk.now_ns, 1.0)
    assert len(desk.run(1.0)) == pytest.approx(11_520, abs=30)
    desk.run(0.1)
    assert desk.send(b"$read_vol#") == b"$Battery:7.4V#\r\n"


def test_an_unplugged_board_drives_on_unheard(bench: MakeBench) -> None:
    plugs: list[bool] = []
    desk = bench()
    desk.robot.on_plug = plugs.append
    desk.send(b"$upload:1,0,0#", 0.1)
    desk.send(b"$spd:300,0,300,0#", 1.0)
    desk.robot.unplug(desk.now_ns, 0.5)
    assert desk.send(b"$pwm:0,0,0,0#", 0.49) == b""
    assert desk.speeds() == pytest.approx([0.3, 0.3], abs=0.02)
    assert plugs == [False]
    before = desk.totals()[-1][0]
    assert desk.run(0.2) != b""
    assert plugs == [False, True]
    assert desk.totals()[-1][0] - before > 500


def test_what_is_on_its_way_is_lost_with_the_plug(bench: MakeBench) -> None:
    desk = bench(impairments=ImpairmentOptions(delay_s=0.05))
    desk.send(b"$read_flash#", 0.09)
    desk.robot.unplug(desk.now_ns, 0.001)
    assert desk.run(0.2) == b""


def test_motors_are_named_by_name_position_or_all(bench: MakeBench) -> None:
    desk = bench()
    left, right = desk.robot.plant.motors
    desk.robot.set_faults("right", FAULTS["stalled"], now_ns=desk.now_ns)
    assert (left.faults.stalled, right.faults.stalled) == (False, True)
    desk.robot.set_faults("1", FAULTS["stalled"], now_ns=desk.now_ns)
    assert left.faults.stalled
    desk.robot.set_faults("all", now_ns=desk.now_ns)
    assert [left.faults.stalled, right.faults.stalled] == [False, False]
    with pytest.raises(KeyError):
        desk.robot.set_faults("middle", now_ns=desk.now_ns)


def test_faults_of_a_motor_add_up_until_it_is_repaired(bench: MakeBench) -> None:
    desk = bench()
    left = desk.robot.plant.motors[0]
    for name in ("encoder-dead", "phases-swapped"):
        desk.robot.add_faults("left", FAULTS[name], now_ns=desk.now_ns)
    assert left.faults == MotorFaults(encoder_dead=True, phases_swapped=True)
    with pytest.raises(KeyError):
        desk.robot.add_faults("middle", FAULTS["stalled"], now_ns=desk.now_ns)


def test_the_host_can_see_how_long_the_wire_is_taken(bench: MakeBench) -> None:
    desk = bench()
    desk.robot.host_wrote(b"\n" * 1152, desk.now_ns)
    assert desk.robot.host_backlog_ns(desk.now_ns) == 100_000_000
    desk.run(0.04)
    assert desk.robot.host_backlog_ns(desk.now_ns) == 60_000_000


@pytest.mark.parametrize("drive", ["skid_steer", "mecanum"])
def test_four_wheels_turn_on_the_spot(bench: MakeBench, drive: str) -> None:
    desk = bench(drive=drive)
    desk.send(b"$spd:-300,-300,300,300#", 2.0)
    truth = desk.robot.truth(desk.now_ns)
    assert math.hypot(truth.x, truth.y) < 0.01
    assert truth.theta > 1.0


def test_mecanum_wheels_move_it_sideways(bench: MakeBench) -> None:
    desk = bench(drive="mecanum")
    desk.send(b"$spd:-300,300,300,-300#", 2.0)
    truth = desk.robot.truth(desk.now_ns)
    assert truth.y > 0.4
    assert abs(truth.x) < 0.01
