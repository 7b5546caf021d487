"""A box in words: why the robot stopped, and what happened before, with times."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import get_args

import pytest
from made_boxes import HEADER, into, ring_of, saved_box
from robot_bench import RobotBench, state_and_why

from yahboomd.blackbox import records
from yahboomd.blackbox.box_file import encode_header, read_box
from yahboomd.blackbox.ring import Ring
from yahboomd.client.move_messages import Reason
from yahboomd.core.daemon.process import without_age
from yahboomd.core.model import Event, Pose2d
from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.motors import MotorFaults
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.blackbox.box_story import MOVE_ENDS, before, story, summary, utc, wall_clock

DRIVES = records.DecisionRecord(state="driving", driver="cmd_vel", why="cmd_vel drives.")
SILENT = records.DecisionRecord(state="standing", driver="", why="No command for 0.5 s.")
ESTOP = records.DecisionRecord(state="estopped", driver="", why="Emergency stop, engaged by Ann.")


def commands(first_s: float, count: int, **fields: float):
    return [
        (first_s - 0.05 * number, records.CommandRecord(source="cmd_vel", **(ZERO | fields)))
        for number in range(count)
    ]


ZERO = {"vx": 0.0, "vy": 0.0, "wz": 0.0}


def retold(*happened, **options):
    found = story(read_box(saved_box(*happened, **options)))
    return found, [
        (round((found.end_ns - line.at_ns) * 1e-9, 2), line.what, line.words)
        for line in found.lines
    ]


def test_it_says_when_and_why_it_stopped_last() -> None:
    found, _ = retold((30.0, DRIVES), (20.0, SILENT), (15.0, DRIVES), (12.41, ESTOP), (5.0, SILENT))
    assert found.why == "It stopped 12.41 s before the save: Emergency stop, engaged by Ann."


def test_commands_that_are_alike_are_one_line_until_the_source_falls_silent() -> None:
    _, lines = retold(
        *commands(20.0, 40, vx=0.3), *commands(18.0, 3), *commands(9.0, 2, vx=0.1, wz=1.0)
    )
    assert lines == [
        (20.0, "command", "cmd_vel: 40 commands for 1.95 s, the first 0.30 m/s, 0.00 rad/s."),
        (18.0, "command", "cmd_vel: 3 commands for 0.10 s, the first 0.00 m/s, 0.00 rad/s."),
        (9.0, "command", "cmd_vel: 2 commands for 0.05 s, the first 0.10 m/s, 1.00 rad/s."),
    ]


def test_the_line_and_what_was_sent_are_in_it() -> None:
    def sent(frame: bytes) -> records.Written:
        return records.Written(data=frame)

    _, lines = retold(
        (9.0, records.Opened(port="/dev/ttyUSB0", byte_ns=86_805)),
        (8.9, records.Identified(dialect="streamed", settings=None)),
        (8.8, sent(b"$spd:0,0,0,0#")),
        (8.7, sent(b"$spd:0,0,0,0#")),
        (8.0, DRIVES),
        (7.9, sent(b"$spd:300,0,300,0#")),
        (7.0, sent(b"$spd:0,0,0,0#")),
        (6.9, sent(b"$pwm:0,0,0,0#")),
        (6.0, records.Closed()),
    )
    words = [line for _, what, line in lines if what in ("board", "sent")]
    assert words == [
        "/dev/ttyUSB0 was opened.",
        "It is a Yahboom 4-channel motor driver (streamed) board.",
        "Sent to the board: brake.",
        "Sent to the board: brake.",
        "Sent to the board: motors off.",
        "The port was closed.",
    ]


def test_a_silence_of_the_board_is_named_where_it_begins() -> None:
    read = records.Received(data=b"$MAll:0,0,0,0#\r\n")
    _, lines = retold(*[(10.0 - 0.1 * number, read) for number in range(20)], (5.0, read))
    assert lines == [
        (8.1, "board", "The board sent nothing for 3.10 s."),
        (5.0, "board", "The board sent nothing for 5.00 s."),
    ]


def test_events_poses_losses_and_the_end_are_in_it_once() -> None:
    event = Event(kind="estop", severity="warning", message="Emergency stop\x1b[31m engaged.")
    _, lines = retold(
        (4.0, SILENT),
        (3.9, SILENT),
        (3.0, records.Happened(event=event)),
        (2.0, records.PoseSet(pose=Pose2d(x=1.5))),
        (1.5, records.Lost(what="commands", count=400)),
        (1.0, records.Ended(reasons=("crash",), error="RuntimeError: no")),
    )
    assert [words for _, _, words in lines] == [
        "standing: No command for 0.5 s.",
        # Control characters from the bus do not reach a terminal.
        "Emergency stop [31m engaged.",
        "The pose was set: x 1.5, y 0, theta 0.",
        "400 more commands came in a second and are left out.",
        "yahboomd ended by a fault of its own: RuntimeError: no",
    ]


def test_moments_are_those_of_the_wall_clock_of_their_time() -> None:
    at = 1_795_370_000_000_000_000
    box = read_box(saved_box((80.0, SILENT), (50.0, records.WallClock(wall_ns=at)), (40.0, DRIVES)))
    first, _, last = (record.at_ns for record in box.records)
    assert utc(wall_clock(box)(first)) == "2026-11-22 17:54:10.00 UTC"
    assert wall_clock(box)(last) == at + 10 * 10**9
    assert before(last, last + 12_412_000_000, "the save") == "12.41 s before the save"


def test_the_summary_names_robot_time_and_reason() -> None:
    words = summary(read_box(saved_box((80.0, SILENT), (50.0, SILENT), reasons=("estop", "crash"))))
    assert words.splitlines() == [
        "yahboomd 0.1.0, robot bot1, process 17",
        "2026-11-22 17:54:10.00 UTC to 2026-11-22 17:54:40.00 UTC: 30.0 s, 2 records",
        "saved for: an emergency stop, then a fault of yahboomd itself",
    ]
    assert "not saved yet" in summary(read_box(ring_of((80.0, SILENT))))
    assert "0 records" in summary(read_box(ring_of()))


# What stops a robot, produced on a simulated one, and the sentence about it.

Happens = Callable[[RobotBench], Awaitable[object]]


async def why_after(
    folder: Path, happens: Happens, *overrides: str, before_s: float = 1.0, **simulation: object
) -> str:
    """Drive, let something happen, and read the box at that moment."""
    head, size = encode_header(HEADER), HEADER.segment_bytes
    buffer = bytearray(head + bytes(64 * size))
    options = SimulationOptions(**simulation)  # type: ignore[arg-type]
    ring = Ring(into(buffer), len(head), size, 64)
    bench = RobotBench(folder, overrides, options, ring=ring)
    assert bench.recorder is not None
    recorder, publish = bench.recorder, bench.heard.event

    def note() -> None:
        state, why = state_and_why(bench.controller)
        recorder.decision(state, bench.controller.decision.driver or "", without_age(why))

    def event(event: Event) -> None:
        publish(event)
        recorder.event(event)

    async def notes() -> None:
        while True:
            note()
            await asyncio.sleep(0.5)

    bench.heard.changed, bench.heard.event = note, event  # type: ignore[method-assign]
    async with bench:
        bench.tasks.append(asyncio.create_task(notes()))
        await bench.ready()
        await bench.drive(before_s, 0.3)
        await happens(bench)
        note()
        image = bytes(buffer)
    return story(read_box(image)).why


async def _waits(bench: RobotBench) -> None:
    await asyncio.sleep(1.5)


async def _ends(bench: RobotBench) -> None:
    await bench.drive(1.0)


async def _drives_on(bench: RobotBench) -> None:
    await bench.drive(3.0, 0.3)


async def _keyboard(bench: RobotBench) -> None:
    for _ in range(10):
        bench.command(source="cmd_vel/teleop")
        await bench.drive(0.05, 0.3)


async def _estop(bench: RobotBench) -> None:
    bench.operator.engage_estop("a query on yahboomd/estop, from tcp/10.0.0.7:40112")
    await _drives_on(bench)


async def _client_lost(bench: RobotBench) -> None:
    bench.controller.bus_lost()
    await _waits(bench)


async def _reset(bench: RobotBench) -> None:
    bench.robot.reset(bench.clock.now_ns())
    await bench.drive(0.5, 0.3)


async def _reset_and_on(bench: RobotBench) -> None:
    bench.robot.brown_out(bench.clock.now_ns(), 0.3)
    await _drives_on(bench)


async def _reset_then_ends(bench: RobotBench) -> None:
    await _reset_and_on(bench)
    await _ends(bench)


async def _three_resets(bench: RobotBench) -> None:
    for _ in range(3):
        bench.robot.reset(bench.clock.now_ns())
        await bench.drive(2.0, 0.3)


async def _unplugged(bench: RobotBench) -> None:
    bench.robot.unplug(bench.clock.now_ns())
    await bench.drive(1.0, 0.3)


async def _hangs(bench: RobotBench) -> None:
    bench.robot.hang(bench.clock.now_ns())
    await bench.drive(0.5, 0.3)


def _faulty(**faults: object) -> Happens:
    async def breaks(bench: RobotBench) -> None:
        broken = MotorFaults(**faults)  # type: ignore[arg-type]
        bench.robot.set_faults("left", broken, now_ns=bench.clock.now_ns())
        await _drives_on(bench)

    return breaks


CAUSES: dict[str, tuple[Happens, dict[str, object], tuple[str, ...], str]] = {
    "silence": (_waits, {}, (), "cmd_vel fell silent after its last command"),
    "a zero command": (_ends, {}, (), "cmd_vel commands zero and keeps control"),
    "a client that is lost": (_client_lost, {}, (), "its client left the bus"),
    "the keyboard": (_keyboard, {}, (), "cmd_vel/teleop commands zero and keeps control"),
    "an emergency stop": (
        _estop, {}, (), "engaged by a query on yahboomd/estop, from tcp/10.0.0.7:40112"
    ),
    "a board that is unplugged": (_unplugged, {}, (), "the port went away"),
    "a board that hangs": (_hangs, {}, (), "No counts have come for 0.3 s"),
    "a wheel that is held": (
        _faulty(stalled=True), {}, (), "is commanded 0.30 m/s, and its encoder shows no motion"
    ),
    "a motor that is unplugged": (
        _faulty(unplugged=True), {}, (), "left turned, is commanded 0.30 m/s, and its encoder"
    ),
    "a wheel that runs away": (_faulty(turning_m_s=1.2), {}, (), "left"),
    "a reset in motion": (_reset, {}, (), "The board reset itself in motion"),
    "a brown-out, and on it drives": (
        _reset_and_on, {}, (), "wheels are not driven unseen. The board reset itself",
    ),
    "a brown-out, then a zero": (_reset_then_ends, {}, (), "The board reset itself"),
    "three resets": (_three_resets, {}, (), "The board reset itself 3 times within 10 s"),
    "a limit of 1 mm/s": (
        _drives_on, {}, ("limits.linear.velocity=0.001",),
        "drives at a crawl, or not at all: limits.linear.velocity = 0.001 is all that",
    ),
    "an acceleration of 1 mm/s²": (
        _drives_on, {}, ("limits.linear.acceleration=0.001",),
        "limits.linear.acceleration = 0.001 lets it reach 0.3 m/s only after 300 s",
    ),
    "a motor type": (
        _drives_on, {"flash": FlashContent(motor_type=2)}, (),
        "Its state: The board is set to motor type 2 (310), the profile 520 needs 1 (520)",
    ),
}  # fmt: skip
"""What happens: its simulation, the configuration, and the words that name it."""


@pytest.mark.cases(6)
@pytest.mark.parametrize("cause", CAUSES)
@on_virtual_time
async def test_every_cause_is_named(tmp_path: Path, cause: str) -> None:
    happens, simulation, overrides, words = CAUSES[cause]
    why = await why_after(tmp_path, happens, *overrides, **simulation)  # type: ignore[arg-type]
    assert words in why


@pytest.mark.parametrize(
    ("reason", "words"),
    [
        ("blocked", "the base was commanded and hardly moved (blocked)."),
        ("client_silent", "the client that asked fell silent (client_silent)."),
        ("a later one", "a later one (a later one)."),
    ],
)
def test_an_end_of_moves_is_explained_with_who_asked_and_why(reason: str, words: str) -> None:
    moves = records.DecisionRecord(state="driving", driver="cmd_vel/moves", why="Moves drive.")
    ended = records.DecisionRecord(
        state="stopping", driver="", why="cmd_vel/moves ended with a zero command."
    )
    label = f"cmd_vel/moves (moves of my: program: {reason})"
    found, lines = retold(
        (9.0, moves),
        (5.05, records.CommandRecord(source=label, **ZERO)),
        (5.0, ended),
    )
    assert found.why.endswith(
        "cmd_vel/moves ended with a zero command. These were the moves of my: program: " + words
    )
    assert any(f"moves of my: program: {reason}" in words for _, _, words in lines)


def test_every_reason_of_an_end_of_moves_has_its_words() -> None:
    assert set(MOVE_ENDS) == set(get_args(Reason))


@on_virtual_time
async def test_a_box_of_a_daemon_tells_why_moves_ended(tmp_path: Path) -> None:
    async def blocked(bench: RobotBench) -> None:
        await asyncio.sleep(1.5)
        stop = b'{"vx": 0.0, "source": "moves of my program: blocked"}'
        for _ in range(6):
            bench.payload(b'{"vx": 0.3, "source": "yahboomd moves"}', source="cmd_vel/moves")
            await asyncio.sleep(0.1)
        for _ in range(10):
            bench.payload(stop, source="cmd_vel/moves")
            await asyncio.sleep(0.05)
        await asyncio.sleep(1.0)

    said = await why_after(tmp_path, blocked)
    assert said.partition(" These were ")[2].startswith(
        "the moves of my program: the base was commanded and hardly moved (blocked)."
    )
