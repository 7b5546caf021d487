from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from yahboomd.simulation.motors import FAULTS

MakeBench = Callable[..., Any]


@pytest.fixture
def polled(bench: MakeBench) -> MakeBench:
    return partial(bench, dialect="polled")


def test_counters_are_answered_without_a_line_end(polled: MakeBench) -> None:
    assert polled(initial_ticks=(1, -2, 3, -4)).send(b"$read#") == b"$data:1,-2,3,-4#"


def test_a_profile_is_needed_before_anything_moves(polled: MakeBench) -> None:
    desk = polled()
    desk.send(b"$speed:300,0,300,0#", 1.0)
    assert desk.speeds() == [0.0, 0.0]
    desk.send(b"$mtype:1#$speed:300,0,300,0#", 1.0)
    assert desk.speeds() == pytest.approx([0.3, 0.3], abs=0.01)


def test_frames_are_carried_out_in_order_however_close(polled: MakeBench) -> None:
    desk = polled()
    answer = desk.send(b"$mtype:1#$read#$speed:500,0,500,0#$read#$read#", 0.1)
    assert answer.count(b"$data:") == 3
    desk.run(1.0)
    assert desk.speeds() == pytest.approx([0.5, 0.5], abs=0.02)


def test_200_polls_a_second_each_with_a_speed_fit_on_the_wire(polled: MakeBench) -> None:
    desk = polled()
    desk.send(b"$mtype:1#", 0.1)
    answers = b"".join(desk.send(b"$speed:500,0,500,0#$read#", 0.005) for _ in range(200))
    assert answers.count(b"$data:") == 200


@pytest.mark.parametrize(
    "frame",
    [b"$read_flash#", b"$pwm:0,0,0,0#", b"$speed:1,2,3#", b"$mtype:9#", b"$#", b"#", b"\n" * 64],
)
def test_what_it_does_not_know_is_ignored(polled: MakeBench, frame: bytes) -> None:
    desk = polled()
    assert desk.send(frame, 0.2) == b""
    assert desk.send(b"$read#") == b"$data:0,0,0,0#"


def test_half_a_frame_is_given_up_at_the_next(polled: MakeBench) -> None:
    assert polled().send(b"$spe$read#") == b"$data:0,0,0,0#"


def test_a_frame_without_an_end_is_forgotten(polled: MakeBench) -> None:
    assert polled().send(b"$" + b"x" * 300 + b"#$read#", 0.1) == b"$data:0,0,0,0#"


def test_speeds_are_clamped(polled: MakeBench) -> None:
    desk = polled()
    desk.send(b"$mtype:1#$speed:9999,0,-9999,0#", 2.0)
    assert desk.speeds() == pytest.approx([1.0, -1.0], abs=0.03)


def test_speeds_hold_for_ever_and_zero_stops(polled: MakeBench) -> None:
    desk = polled()
    desk.send(b"$mtype:1#$speed:300,0,300,0#", 30.0)
    assert desk.speeds() == pytest.approx([0.3, 0.3], abs=0.01)
    desk.send(b"$speed:0,0,0,0#", 1.0)
    assert desk.speeds() == [0.0, 0.0]


def test_a_dead_encoder_runs_away_until_zero_lets_it_go(polled: MakeBench) -> None:
    desk = polled()
    desk.robot.set_faults("left", FAULTS["encoder-dead"], now_ns=desk.now_ns)
    desk.send(b"$mtype:1#$speed:100,0,100,0#", 3.0)
    assert desk.speeds()[0] > 1.1
    desk.send(b"$speed:0,0,0,0#", 2.0)
    assert desk.speeds() == [0.0, 0.0]


def test_a_reset_is_silent_and_takes_counters_and_profile(polled: MakeBench) -> None:
    desk = polled()
    desk.send(b"$mtype:1#$speed:500,0,500,0#", 1.0)
    desk.robot.reset(desk.now_ns)
    assert desk.run(2.0) == b""
    answer = desk.send(b"$read#")
    assert answer.startswith(b"$data:")
    assert 0 <= int(answer[6:].split(b",")[0]) < 300
    desk.send(b"$speed:500,0,500,0#", 0.5)
    assert desk.speeds() == [0.0, 0.0]
