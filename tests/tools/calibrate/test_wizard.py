"""A run counts from the moment at which the person let it begin."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from led_calibration import LedCalibration
from real_robot import Client, RealRobot, wait_for

from yahboomd.simulation.truth import TruthSample

pytestmark = pytest.mark.realtime


def test_the_way_onto_its_mark_is_no_part_of_a_run(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], tmp_path: Path
) -> None:
    robot = real_robot()
    robot.daemon.says("Connected to")
    led = LedCalibration(robot.endpoint, tmp_path, "tape", "--straight", "0.5", "--speed", "0.4")
    try:
        asked = led.question()
        person = client("client", robot.endpoint)
        begin = robot.settled_truth()
        rested_ns = begin.t_ns + 1_500_000_000
        wait_for(lambda: robot.truth()[-1].t_ns > rested_ns, "it has stood for a while")
        person.drive_until(b'{"vx": 0.4}', lambda: robot.truth()[-1].x > begin.x + 0.3, "pushed")
        mark, after = led.moved_through(asked, robot.settled_truth)
        assert after["name"] == "length"
        end = robot.settled_truth()
        assert math.hypot(end.x - mark.x, end.y - mark.y) == pytest.approx(0.5, abs=0.1)
    finally:
        led.close()


def test_squares_and_a_straight_are_measured_at_their_ends(
    real_robot: Callable[..., RealRobot], tmp_path: Path
) -> None:
    robot = real_robot(simulate=["--wheel-radius", "0.0345", "--wheel-separation", "0.162"])
    robot.daemon.says("Connected to")
    quick = ("--count", "1", "--side", "0.4", "--speed", "0.5", "--turn-speed", "2")
    shape = (*quick, "--straight", "0.8", "--dry-run")
    led = LedCalibration(robot.endpoint, tmp_path, "squares", *shape)
    asked, begin = [], robot.settled_truth()
    try:
        while (question := led.question())["name"] != "heading" or len(asked) < 9:
            if question["name"] == "move":
                begin = robot.settled_truth()
                led.answer(question)
            else:
                led.answer(question, f"{seen(begin, robot.settled_truth())[question['name']]:.4f}")
            # A run that a busy machine let lapse is asked for again.
            if question["name"] != "move" or asked[-1:] != ["move"]:
                asked.append(question["name"])
        led.answer(question, f"{seen(begin, robot.settled_truth())['heading']:.4f}")
        led.ends()
    finally:
        led.close()
    square = ["move", "ahead", "left", "heading"]
    assert asked == [*square, *square, "move", "length", "left"]
    (result,) = [line["facts"] for line in led.of_type("result")]
    factors = result["chassis"]["wheel_radius_multiplier"]
    assert factors == pytest.approx(dict.fromkeys(("left", "right"), 0.0345 / 0.0335), rel=0.01)
    track = result["chassis"]["wheel_separation_multiplier"]
    assert track == pytest.approx(0.162 / 0.150, rel=0.02)


def seen(begin: TruthSample, end: TruthSample) -> dict[str, float]:
    """The measurements of a person between two moments: mm, degrees; the length in m."""
    dx, dy = end.x - begin.x, end.y - begin.y
    cos, sin = math.cos(begin.theta), math.sin(begin.theta)
    turned = (end.theta - begin.theta + math.pi) % (2.0 * math.pi) - math.pi
    return {
        "ahead": 1e3 * (cos * dx + sin * dy),
        "left": 1e3 * (cos * dy - sin * dx),
        "heading": math.degrees(turned),
        "length": math.hypot(dx, dy),
    }


def test_a_mecanum_base_goes_to_both_sides_and_gets_three_multipliers(
    real_robot: Callable[..., RealRobot], tmp_path: Path
) -> None:
    # A simulated board that gets no processor time for a moment looks like one without supply.
    base = ("chassis.preset=mecanum", "chassis.wheel_base_m=0.15", "faults.stall=report")
    robot = real_robot(
        simulate=[
            *("--drive", "mecanum", "--wheel-radius", "0.0345", "--wheel-separation", "0.165"),
            *("--wheel-base", "0.15", "--sideways", "0.87"),
        ],
        run=[word for each in base for word in ("--set", each)],
    )
    robot.daemon.says("Connected to")
    quick = ("--straight", "1", "--sideways", "0.6", "--turns", "1", "--speed", "0.4")
    config = tmp_path / "robot.toml"
    config.write_text('[chassis]\npreset = "mecanum"\nwheel_base_m = 0.15\n')
    led = LedCalibration(
        robot.endpoint, tmp_path, "tape", *quick, "--turn-speed", "2", "--config", str(config)
    )
    names, begin = [], robot.settled_truth()
    try:
        # A straight, two turns, and two ways to the side.
        while len(names) < 10:
            question = led.question()
            if question["name"] != "move" or names[-1:] != ["move"]:
                names.append(question["name"])
            if question["name"] == "move":
                begin = robot.settled_truth()
                led.answer(question)
                continue
            end = robot.settled_truth()
            measured = seen(begin, end)["length"]
            if question["name"] == "beyond":
                measured = math.degrees(abs(end.theta - begin.theta)) - 360.0
            led.answer(question, f"{measured:.4f}")
        led.ends()
    finally:
        led.close()
    assert names[1::2] == ["length", "beyond", "beyond", "length", "length"]
    (result,) = [line["facts"] for line in led.of_type("result")]
    assert result["refused"] == []
    radii = result["chassis"]["wheel_radius_multiplier"]
    assert radii["rear_left"] == pytest.approx(0.0345 / 0.0335, rel=5e-3)
    assert result["chassis"]["wheel_separation_multiplier"] == pytest.approx(1.1, rel=0.02)
    assert result["chassis"]["sideways_multiplier"] == pytest.approx(0.87, rel=0.01)
    written = (tmp_path / "calibration.toml").read_text()
    assert f"sideways_multiplier = {result['chassis']['sideways_multiplier']}" in written
