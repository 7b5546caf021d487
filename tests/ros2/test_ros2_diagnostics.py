"""The status in ROS 2's words."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from yahboomd.core.messages.native import StatusSample
from yahboomd.core.model import Cause
from yahboomd.ros2.messages.ros2_encoders import Diagnostic
from yahboomd.ros2.ros2_diagnostics import (
    ERROR,
    OK,
    STALE,
    WARN,
    Diagnostics,
    levels,
)

S = 1_000_000_000
FULL = StatusSample(
    stamp_ns=1_700_000_012 * S,
    state="standing",
    driver=None,
    since_ns=1_700_000_000 * S,
    why="No source commands motion.",
    board={"dialect": "streamed", "version": "1.7.3", "volts": 7.4, "wheel_diameter_mm": 67.0},
    link={"frames": 100, "broken_frames": 3, "discarded_bytes": 0},
    command={"accepted": 5, "last_refusal": ""},
    bus={"zid": "ab", "routers": "", "put_errors": 0},
)


def changed(**fields: Any) -> StatusSample:
    return msgspec.structs.replace(FULL, **fields)


def named(entries: list[Diagnostic]) -> dict[str, Diagnostic]:
    return {entry.name.removeprefix("yahboomd: "): entry for entry in entries}


@pytest.fixture
def diagnostics() -> Diagnostics:
    return Diagnostics(hardware_id="bot1")


@pytest.mark.parametrize(
    ("state", "level"),
    [
        ("standing", OK),
        ("driving", OK),
        ("stopping", OK),
        ("estopped", WARN),
        ("fault", ERROR),
        ("waiting", STALE),
    ],
)
def test_every_state_has_its_level_and_its_reason(
    diagnostics: Diagnostics, state: str, level: int
) -> None:
    base = named(diagnostics.of(changed(state=state, why="Because.")))["base"]
    assert (base.level, base.message, base.hardware_id) == (level, "Because.", "bot1")
    assert ("state", state) in base.values
    assert ("since [s]", "12") in base.values


def test_wheels_that_may_turn_unseen_are_an_error(diagnostics: Diagnostics) -> None:
    base = named(diagnostics.of(changed(state="waiting", wheels="unknown")))["base"]
    assert base.level == ERROR
    assert ("wheels", "unknown") in base.values


def test_a_broken_pose_is_a_warning_until_it_is_set(diagnostics: Diagnostics) -> None:
    broken = changed(command={"pose_broken": "The pose broke."})
    pose = named(diagnostics.of(broken))["pose"]
    assert (pose.level, pose.message) == (WARN, "The pose broke.")


def test_all_is_well_with_a_robot_that_stands(diagnostics: Diagnostics) -> None:
    entries = diagnostics.of(FULL)
    assert levels(entries) == (OK,) * 5
    board = named(entries)["board"]
    assert board.message == "Connected: dialect streamed, firmware 1.7.3."
    assert {("volts", "7.4"), ("wheel diameter [mm]", "67"), ("frames", "100")} <= set(board.values)


def test_without_a_board_there_is_an_error(diagnostics: Diagnostics) -> None:
    board = named(diagnostics.of(changed(board={})))["board"]
    assert board.level == ERROR


def test_only_new_trouble_on_the_line_is_warned_of(diagnostics: Diagnostics) -> None:
    diagnostics.of(FULL)
    worse = changed(link={"broken_frames": 5, "discarded_bytes": 0})
    board = named(diagnostics.of(worse))["board"]
    assert board.level == WARN
    assert "2 broken frames" in board.message
    assert named(diagnostics.of(worse))["board"].level == OK


@pytest.mark.parametrize(
    ("bus", "message"),
    [
        ({"routers": "tcp/10.0.0.1:7447", "neighbours": 2}, "Joined the router at"),
        ({"routers": "", "neighbours": 2}, "2 sessions are connected."),
    ],
)
def test_the_bus_tells_who_is_there(
    diagnostics: Diagnostics, bus: dict[str, Any], message: str
) -> None:
    assert named(diagnostics.of(changed(bus=bus)))["bus"].message.startswith(message)


def test_lost_samples_are_warned_of_once(diagnostics: Diagnostics) -> None:
    lossy = changed(bus={"put_errors": 4})
    assert named(diagnostics.of(lossy))["bus"].level == WARN
    assert named(diagnostics.of(lossy))["bus"].level == OK


def test_a_clock_that_is_off_is_named_with_its_offset(diagnostics: Diagnostics) -> None:
    command = {
        "accepted": 5,
        "clock_offset_s": {"cmd_vel": -3.2},
        "clock_warnings": {"cmd_vel": "Its clock is 3.20 s behind this machine's."},
    }
    commands = named(diagnostics.of(changed(command=command)))["commands"]
    assert commands.level == WARN
    assert commands.message == "cmd_vel: Its clock is 3.20 s behind this machine's."
    assert ("clock offset [s]: cmd_vel", "-3.2") in commands.values


def test_a_node_that_publishes_another_type_is_warned_of(diagnostics: Diagnostics) -> None:
    warning = {"cmd_vel": "A node publishes another type."}
    commands = named(diagnostics.of(FULL, warning))["commands"]
    assert (commands.level, commands.message) == (WARN, "cmd_vel: A node publishes another type.")


def test_every_value_is_text_that_people_read(diagnostics: Diagnostics) -> None:
    bus = {"a": None, "b": True, "c": 0.1 + 0.2, "d": ["x", "y"], "e_m_s": 2}
    values = named(diagnostics.of(changed(bus=bus)))["bus"].values
    assert list(values) == [
        ("a", "unknown"),
        ("b", "yes"),
        ("c", "0.3"),
        ("d", "x, y"),
        ("e [m/s]", "2"),
    ]


@pytest.mark.parametrize(("battery", "level"), [("good", OK), ("low", WARN), ("empty", ERROR)])
def test_a_low_battery_is_warned_of(diagnostics: Diagnostics, battery: str, level: int) -> None:
    facts = {"dialect": "streamed", "battery": battery, "volts_at_rest": 10.2}
    board = named(diagnostics.of(changed(board=facts)))["board"]
    assert board.level == level
    assert ("10.2 V at rest" in board.message) == (level != OK)


@pytest.mark.parametrize("kind", ["two_programs", "too_often", "too_seldom", "cannot"])
def test_what_a_commander_alone_can_end_is_a_warning_with_its_values(
    diagnostics: Diagnostics, kind: str
) -> None:
    cause = Cause(kind, "Two programs command cmd_vel: 0.30 m/s and 0.")
    sample = changed(state="driving", reasons=[Cause("driving", "cmd_vel drives."), cause])
    entry = named(diagnostics.of(sample))["commands"]
    assert (entry.level, entry.message) == (WARN, cause.text)
    assert named(diagnostics.of(changed(reasons=[])))["commands"].level == OK
