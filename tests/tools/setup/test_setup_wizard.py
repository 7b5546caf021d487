"""A simulated person sets simulated robots up, on virtual time; then the daemon drives them."""

from __future__ import annotations

import asyncio
import itertools
import math
import os
import random
from pathlib import Path
from typing import Any

import msgspec
import pytest
from board_bench import LinkBench
from floor_options import floor_options
from robot_bench import RobotBench
from simulated_person import (
    FOUR,
    TWO,
    X3,
    SimulatedPerson,
    broken,
    connected,
    kinds,
    set_up,
    true_wiring,
)

from yahboomd.core.config import Config, read
from yahboomd.core.daemon.estop.latch_file import LatchFile
from yahboomd.core.errors import Refused
from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.motors import FAULTS
from yahboomd.simulation.options import FOUR_WHEELS, TWO_WHEELS, Wiring, at_plug
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.setup.outcome import SetupOutcome, next_steps
from yahboomd.tools.setup.robot_file import as_toml, write_robot


def plugged(wires: tuple[Wiring, ...], plugs: tuple[int, ...]) -> tuple[Wiring, ...]:
    return tuple(at_plug(wire, plug) for wire, plug in zip(wires, plugs, strict=True))


EVERY_WIRING = [
    tuple(plug * sign for plug, sign in zip(plugs, signs, strict=True))
    for plugs in itertools.permutations((1, 2, 3, 4))
    for signs in itertools.product((1, -1), repeat=4)
]
SAMPLE = random.Random(4).sample(EVERY_WIRING, 6)
SELECTED = EVERY_WIRING if "YAHBOOMD_EVERY_WIRING" in os.environ else SAMPLE


async def drives_straight_and_turns_left(
    bench: LinkBench, found: SetupOutcome, folder: Path
) -> None:
    path = folder / "robot.toml"
    write_robot(path, as_toml(found.description, found.wiring), overwrite=True)
    assert [(m.name, m.position) for m in read(path, environ={}).config.motors()]
    robot = RobotBench(folder, file=path)
    robot.robot = bench.robot
    async with robot:
        await robot.ready()
        before = robot.robot.plant.chassis.pose
        await robot.drive(1.5, vx=0.3)
        after = robot.robot.plant.chassis.pose
        x, y = after.x - before.x, after.y - before.y
        assert x * math.cos(before.theta) + y * math.sin(before.theta) > 0.15
        assert abs(after.theta - before.theta) < 0.02
        await robot.drive(1.5, wz=1.0)
        turned = robot.robot.plant.chassis.pose.theta - after.theta
        assert turned > 0.5
        pose = robot.heard.estimates[-1].pose
        assert pose.theta > 0.5
        assert "runaway_against" not in robot.heard.kinds


@pytest.mark.cases(1)
@pytest.mark.parametrize("plugs", SELECTED, ids=str)
@on_virtual_time
async def test_four_wheels_however_they_are_connected_are_found_and_drive(
    plugs: tuple[int, ...], tmp_path: Path
) -> None:
    bench = LinkBench(
        drive="skid_steer",
        wiring=plugged(FOUR_WHEELS, plugs),
        flash=FlashContent(dead_zone=1900),
        **floor_options(),
    )
    found = await set_up(bench, FOUR)
    assert connected(found) == true_wiring(bench)
    assert found.wiring.faults == ()
    await drives_straight_and_turns_left(bench, found, tmp_path)


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("dialect", "by_hand", "plugs"),
    [
        ("streamed", False, (1, 3)),
        ("streamed", False, (-4, -3)),
        ("streamed", True, (-3, 1)),
        ("streamed", True, (2, -4)),
        ("polled", False, (-4, -3)),
        ("polled", True, (2, -4)),
    ],
)
@on_virtual_time
async def test_two_wheels_are_found_by_output_and_by_hand_and_drive(
    dialect: str, by_hand: bool, plugs: tuple[int, ...], tmp_path: Path
) -> None:
    bench = LinkBench(wiring=plugged(TWO_WHEELS, plugs), dialect=dialect)
    person = SimulatedPerson(bench)
    found = await set_up(bench, TWO, person=person, by_hand=by_hand)
    assert connected(found) == true_wiring(bench)
    asked = "".join(person.questions)
    turned_by_hand = by_hand or dialect == "polled"
    assert ("Turn wheel 1" in asked) == turned_by_hand
    assert ("off the ground" in asked) != turned_by_hand
    await drives_straight_and_turns_left(bench, found, tmp_path)


@on_virtual_time
async def test_a_mecanum_car_of_the_other_board_is_found_and_its_sensor_noticed(
    tmp_path: Path,
) -> None:
    bench = LinkBench(
        dialect="rosmaster",
        drive="mecanum",
        battery_volts=11.5,
        rated_volts=11.5,
        wheel_radius_m=0.0325,
        wheel_separation_m=0.169,
        wheel_base_m=0.160,
        flash=RosmasterStored(car_type=1),
    )
    found = await set_up(bench, X3)
    assert connected(found) == true_wiring(bench)
    assert found.imu == "mpu9250"
    await drives_straight_and_turns_left(bench, found, tmp_path)


@pytest.mark.parametrize("mirrored", [True, False])
@on_virtual_time
async def test_mirrored_rollers_are_named_and_the_others_go_to_the_commanded_side(
    mirrored: bool, tmp_path: Path
) -> None:
    bench = LinkBench(drive="mecanum", sideways=-0.9 if mirrored else 0.9)
    found = await set_up(bench, msgspec.structs.replace(FOUR, kinematics="mecanum"))
    path = tmp_path / "robot.toml"
    assert ("Exchange the left and" in next_steps(found, path)) == mirrored
    write_robot(path, as_toml(found.description, found.wiring), overwrite=True)
    robot = RobotBench(tmp_path, file=path)
    robot.robot = bench.robot
    async with robot:
        await robot.ready()
        before_m = robot.robot.plant.chassis.pose.y
        for _ in range(30):
            robot.payload(b'{"vx": 0.0, "vy": 0.3, "wz": 0.0}')
            await asyncio.sleep(0.05)
        went_m = robot.robot.plant.chassis.pose.y - before_m
        assert (went_m < -0.15) if mirrored else (went_m > 0.15)


@on_virtual_time
async def test_a_board_that_divides_a_motion_itself_has_its_plugs_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = LinkBench(
        dialect="rosmaster",
        drive="mecanum",
        wiring=plugged(FOUR_WHEELS, (2, 1, 3, -4)),
        battery_volts=11.5,
        rated_volts=11.5,
        wheel_radius_m=0.0325,
        flash=RosmasterStored(car_type=1),
    )
    found = await set_up(bench, X3)
    (fault,) = found.wiring.faults
    assert (fault.kind, fault.position) == ("motor_misplaced", 3)
    assert "M3 (front right) is mounted the other way round, and this board cannot" in fault.words
    # At the start, and beside the faults.
    assert capsys.readouterr().err.count("M1 is the plug M4") == 2
    # The file is that of the repaired robot.
    assert connected(found) == true_wiring(bench) | {"front_right": -3}

    person = SimulatedPerson(bench)
    person.repair = lambda: bench.robot.add_faults(
        "front_right", FAULTS["mounted-round"], now_ns=bench.now_ns
    )
    found = await set_up(bench, X3, person=person)
    assert found.wiring.faults == ()
    await drives_straight_and_turns_left(bench, found, tmp_path)


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("faults", "found_faults"),
    [
        (["encoder-reversed 2"], [("encoder_swapped", 2)]),
        (["phases-swapped 4"], [("encoder_swapped", 4)]),
        (["encoder-dead 1"], [("encoder_dead", 1)]),
        (["crossed 1 3"], [("encoder_crossed", 1)]),
        (
            ["crossed 1 2", "encoder-reversed 2", "encoder-dead 3"],
            [("encoder_crossed", 1), ("encoder_swapped", 2), ("encoder_dead", 3)],
        ),
        (
            ["crossed 1 2", "crossed 2 3", "mounted-round 4", "phases-swapped 4"],
            [
                ("encoder_crossed", 1),
                ("encoder_crossed", 2),
                ("encoder_crossed", 3),
                ("encoder_swapped", 4),
            ],
        ),
        (
            [f"encoder-reversed {position}" for position in (1, 2, 3, 4)],
            [("encoder_swapped", position) for position in (1, 2, 3, 4)],
        ),
    ],
    ids=str,
)
@on_virtual_time
async def test_faults_are_named_by_their_plugs_alone_and_together(
    faults: list[str], found_faults: list[tuple[str, int]]
) -> None:
    bench = LinkBench(drive="skid_steer", wiring=FOUR_WHEELS)
    broken(bench, *faults)
    found = await set_up(bench, FOUR)
    assert kinds(found) == set(found_faults)
    assert {motor.wheel: motor.position for motor in found.wiring.motors} == {
        wire.name: wire.position for wire in FOUR_WHEELS
    }
    assert "To be repaired" in as_toml(found.description, found.wiring)


@pytest.mark.cases(1)
@pytest.mark.parametrize("fault", ["motor-dead", "unplugged", "stalled"])
@on_virtual_time
async def test_a_motor_that_does_not_turn_is_named_and_nothing_is_found(fault: str) -> None:
    bench = LinkBench(wiring=plugged(TWO_WHEELS, (1, 4)))
    broken(bench, f"{fault} right")
    person = SimulatedPerson(bench)
    with pytest.raises(Refused, match="Nothing was written"):
        await set_up(bench, TWO, person=person)
    asked = "\n".join(person.questions)
    # A motor without power still shows its plug as its wheel is turned by hand.
    assert ("Which plug is its motor in? (M2, M3, M4;" in asked) == (fault != "motor-dead")
    assert asked.count("Enter, and M4 is given more:") == 3
    assert max(map(abs, bench.rim_speeds)) < 0.03


@pytest.mark.nightly
@on_virtual_time
async def test_wheels_that_stick_on_a_low_battery_are_found_with_more_output(
    capsys: pytest.CaptureFixture[str],
) -> None:
    bench = LinkBench(
        drive="skid_steer",
        wiring=plugged(FOUR_WHEELS, (2, -1, 3, 4)),
        motor_dead_zone=1500,
        friction_scales=(1.0, 1.05, 0.8, 0.97),
        sticks=(1.4, 1.5, 1.1, 1.3),
        battery_volts=6.6,
    )
    person = SimulatedPerson(bench)
    person.looks = True
    found = await set_up(bench, FOUR, person=person)
    assert connected(found) == true_wiring(bench)
    assert found.wiring.faults == ()
    assert found.gear.verdict == "fits"
    assert person.turned <= 1.0
    shown = capsys.readouterr().err
    assert "It is stiff, or the battery is low (6.6 V)" in " ".join(shown.split())
    assert "broken" not in shown


@on_virtual_time
async def test_no_speed_is_ever_sent() -> None:
    bench = LinkBench(drive="skid_steer", wiring=FOUR_WHEELS)
    broken(bench, "encoder-reversed 1", "encoder-dead 2")
    await set_up(bench, FOUR)
    sent = [frame for port in bench.ports for frame in port.frames]
    assert sum(frame.startswith(b"$pwm:") for frame in sent) > 20
    assert {frame for frame in sent if frame.startswith((b"$spd", b"$speed"))} <= {
        b"$spd:0,0,0,0#",
        b"$speed:0,0,0,0#",
    }
    # One motor at a time.
    for frame in sent:
        if frame.startswith(b"$pwm:"):
            outputs = frame.removeprefix(b"$pwm:").rstrip(b"#").split(b",")
            assert sum(each != b"0" for each in outputs) <= 1


@on_virtual_time
async def test_no_wheel_turns_unless_the_person_says_that_they_are_off_the_ground() -> None:
    for answer in ("n", "no", ["", "yes, nearly", "n"]):
        bench = LinkBench(drive="skid_steer", wiring=FOUR_WHEELS)
        person = SimulatedPerson(bench)
        person.others["Are all wheels off the ground?"] = answer
        with pytest.raises(Refused, match="No motor was turned"):
            await set_up(bench, FOUR, person=person)
        assert not any(b"pwm:0,0,0,0" not in frame for frame in bench.frames if b"pwm" in frame)
        assert all(motor.travel_m == 0.0 for motor in bench.robot.plant.motors)


@on_virtual_time
async def test_an_engaged_emergency_stop_is_refused_before_and_between_pulses(
    tmp_path: Path,
) -> None:
    config = Config.model_validate({"estop": {"latch_file": str(tmp_path / "own" / "latch")}})
    latch = LatchFile(tmp_path / "own" / "latch")
    latch.engage("a person")
    bench = LinkBench(drive="skid_steer", wiring=FOUR_WHEELS)
    with pytest.raises(Refused, match="emergency stop is engaged"):
        await set_up(bench, FOUR, config=config)
    assert bench.ports == []

    latch.release()
    person = SimulatedPerson(bench)
    line = person.line

    async def engage_at_the_second(question: str) -> str:
        if question.startswith("\nEnter, and M2"):
            latch.engage("a person")
        return await line(question)

    person.line = engage_at_the_second  # type: ignore[method-assign]
    with pytest.raises(Refused, match="emergency stop is engaged"):
        await set_up(bench, FOUR, person=person, config=config)
    assert not any(frame.startswith(b"$pwm:0,1") for frame in bench.frames)


@on_virtual_time
async def test_a_board_with_another_motor_type_turns_nothing_before_it_is_stored() -> None:
    options: dict[str, Any] = {"drive": "skid_steer", "wiring": FOUR_WHEELS}
    bench = LinkBench(**options, flash=FlashContent(motor_type=2))
    person = SimulatedPerson(bench)
    person.others["2 stored values differ"] = "n"
    with pytest.raises(Refused, match="No motor is turned like this"):
        await set_up(bench, FOUR, person=person)
    assert all(motor.travel_m == 0.0 for motor in bench.robot.plant.motors)

    person.others["2 stored values differ"] = "y"
    found = await set_up(bench, FOUR, person=person)
    assert connected(found) == true_wiring(bench)
    flash: FlashContent = bench.robot.board.flash  # type: ignore[attr-defined]
    assert (flash.motor_type, flash.dead_zone) == (1, 1900)
