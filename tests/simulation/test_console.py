from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from yahboomd.core.errors import ConfigError
from yahboomd.simulation.console import COMMANDS, HELP, execute, serve_control
from yahboomd.simulation.motors import FAULTS
from yahboomd.simulation.truth import TruthSample

MakeBench = Callable[..., Any]


def tell(desk: Any, line: str) -> str:
    return execute(desk.robot, line, desk.now_ns)


def test_every_command_is_in_the_help() -> None:
    listed = {line.split()[0] for line in HELP.splitlines()[:-1]}
    assert listed == set(COMMANDS)


@pytest.mark.parametrize("fault", sorted(set(FAULTS) - {"turning"}))
def test_faults_of_motors_are_set_and_repaired(bench: MakeBench, fault: str) -> None:
    desk = bench()
    assert tell(desk, f"{fault} left") == "ok"
    assert desk.robot.plant.motors[0].faults == FAULTS[fault]
    assert tell(desk, "repair all") == "ok"
    assert desk.robot.plant.motors[0].faults != FAULTS[fault]


def test_faults_add_up_until_they_are_repaired(bench: MakeBench) -> None:
    desk = bench()
    assert tell(desk, "mounted-round left") == "ok"
    assert tell(desk, "encoder-dead 1") == "ok"
    faults = desk.robot.plant.motors[0].faults
    assert faults.mounted_round
    assert faults.encoder_dead


def test_encoder_plugs_are_crossed(bench: MakeBench) -> None:
    desk = bench()
    assert tell(desk, "crossed 1 2") == "ok"
    desk.send(b"$pwm:3000,0,0,0#", 0.5)
    a, b, _, _ = desk.robot.board.totals
    assert a == 0
    assert b > 500
    assert tell(desk, "crossed 1 5").startswith("error")
    assert tell(desk, "crossed 1").startswith("error")


def test_a_wheel_can_be_turned_at_a_given_speed(bench: MakeBench) -> None:
    desk = bench()
    assert tell(desk, "turning right -0.5") == "ok"
    assert desk.robot.plant.motors[1].faults.turning_m_s == -0.5


def test_the_line_is_impaired_and_cleared(bench: MakeBench) -> None:
    desk = bench()
    for line in ("loss 0.2", "corruption 0.1", "delay 0.01 0.002", "chunk 0"):
        assert tell(desk, line) == "ok"
    settings = desk.robot.impairments.settings
    assert (settings.loss, settings.corruption, settings.chunk_s) == (0.2, 0.1, 0.0)
    assert (settings.delay_s, settings.jitter_s) == (0.01, 0.002)
    assert tell(desk, "clear") == "ok"
    assert desk.robot.impairments.settings.loss == 0.0


def test_the_board_is_reset_hung_and_browned_out(bench: MakeBench) -> None:
    desk = bench()
    assert tell(desk, "reset") == "ok"
    assert b"Reset MCU" in desk.run(0.2)
    assert tell(desk, "hang") == "ok"
    assert desk.send(b"$read_vol#") == b""
    assert tell(desk, "brown-out 0.1") == "ok"
    assert desk.run(0.3) == b"Motor_Version:1.7.3\r\n"


def test_the_plug_is_pulled_and_put_back(bench: MakeBench) -> None:
    desk = bench()
    assert tell(desk, "unplug") == "ok"
    assert not desk.robot.plugged
    assert tell(desk, "replug") == "ok"
    assert desk.robot.plugged
    tell(desk, "unplug 0.5")
    desk.run(0.6)
    assert desk.robot.plugged


def test_the_board_is_muted_and_made_to_babble(bench: MakeBench) -> None:
    desk = bench()
    assert tell(desk, "mute 0.1") == "ok"
    assert desk.send(b"$read_vol#", 0.1) == b""
    assert tell(desk, "babble 0.1") == "ok"
    assert len(desk.run(0.1)) > 1000


def test_output_stalls_input_is_held_and_answers_are_lost_until_all_is_cleared(
    bench: MakeBench,
) -> None:
    desk = bench()
    assert tell(desk, "stall 5") == f"ok until {desk.now_ns + 5_000_000_000}"
    for line in ("hold 5", "unanswered $Battery 0.5"):
        assert tell(desk, line) == "ok"
    line = desk.robot.impairments
    assert line.stalled_until_ns == line.held_until_ns == desk.now_ns + 5_000_000_000
    assert line.unanswered == {b"$Battery": 0.5}
    assert tell(desk, "clear") == "ok"
    assert (line.stalled_until_ns, line.held_until_ns, line.unanswered) == (0, 0, {})


def test_the_pose_is_answered_as_json(bench: MakeBench) -> None:
    desk = bench()
    answer = tell(desk, "pose")
    assert answer.startswith("ok {")
    assert msgspec.json.decode(answer[3:], type=TruthSample).t_ns == desk.now_ns


def test_the_battery_is_set(bench: MakeBench) -> None:
    desk = bench()
    tell(desk, "battery 6.5")
    assert desk.send(b"$read_vol#") == b"$Battery:6.5V#\r\n"


def test_the_period_of_the_totals_is_set_on_a_board_that_has_one(bench: MakeBench) -> None:
    desk = bench(tick_period_s=1.0)
    assert tell(desk, "tick-period 0.02 0.005") == "ok"
    assert desk.robot.board.next_ns <= desk.now_ns + 10_000_000
    assert tell(bench(dialect="polled"), "tick-period 0.02").startswith("error ")


def test_the_next_writes_of_the_flash_are_cut_short(bench: MakeBench) -> None:
    desk = bench()
    assert tell(desk, "cut-writes") == "ok"
    desk.send(b"$mline:13#", 0.3)
    assert math.isnan(desk.robot.board.flash.d)
    assert tell(bench(dialect="polled"), "cut-writes").startswith("error ")


@pytest.mark.parametrize(
    "line",
    [
        *("", "explode", "loss", "loss x", "loss 2", "loss -1", "mute", "delay -1", "stalled"),
        *("stalled middle", "battery nan", "unplug 1e99", "chunk inf"),
        *("turning left nan", "turning all -inf", "turning 1 1e308"),
        *("stall", "hold -1", "unanswered", "unanswered $Battery", "unanswered $Battery 2"),
    ],
)
def test_wrong_lines_are_answered_with_an_error(bench: MakeBench, line: str) -> None:
    assert tell(bench(), line).startswith("error ")


@pytest.mark.realtime
async def test_the_socket_answers_line_by_line(tmp_path: Path) -> None:
    path = tmp_path / "control"
    server = await serve_control(path, lambda line: f"ok {line}")
    async with server:
        reader, writer = await asyncio.open_unix_connection(path)
        writer.write(b"one\ntwo\n\xff\n")
        assert await reader.readline() == b"ok one\n"
        assert await reader.readline() == b"ok two\n"
        assert (await reader.readline()).startswith(b"ok ")
        writer.close()
        await writer.wait_closed()


@pytest.mark.realtime
async def test_a_socket_that_was_left_behind_is_replaced_and_a_file_is_not(tmp_path: Path) -> None:
    path = tmp_path / "control"
    first = await serve_control(path, lambda _: "ok")
    second = await serve_control(path, lambda _: "ok")
    first.close()
    second.close()
    taken = tmp_path / "file"
    taken.write_text("precious")
    with pytest.raises(ConfigError, match="cannot be made"):
        await serve_control(taken, lambda _: "ok")
    assert taken.read_text() == "precious"
