from __future__ import annotations

from yahboomd_fleet.fleet_view import LONGEST_WORD, RobotRow
from yahboomd_fleet.fleet_words import one_line, summary, table

GOOD = RobotRow(
    robot="farm/north/bot1",
    needs="",
    can_drive=True,
    state="driving",
    state_s=3.0,
    why="cmd_vel drives.",
    driver="cmd_vel",
    volts=12.25,
    version="1.2.3",
    calibrated=True,
    seen_s=0.5,
)
LOST = RobotRow(
    robot="bot2", needs="lost in motion", can_drive=False, state="driving", state_s=9.0, seen_s=90.0
)
NEVER = RobotRow(robot="bot3", needs="not reachable", can_drive=False)


def test_the_summary_counts_who_needs_somebody_by_reason() -> None:
    assert summary([]) == "No robot."
    assert summary([GOOD]) == "1 robot, and none needs anybody."
    assert summary([LOST, NEVER, NEVER, GOOD]) == (
        "4 robots; 3 need somebody: 1 lost in motion, 2 not reachable."
    )
    assert summary([GOOD], 7).endswith(
        " 7 answers of more robots, or unreadable ones, are left out."
    )


def test_each_robot_has_one_line_in_columns() -> None:
    head, lost, never, good = table([LOST, NEVER, GOOD])
    assert head.split() == "robot needs state driver battery version calibrated seen why".split()
    assert [cell.strip() for cell in good.split("  ") if cell] == [
        "farm/north/bot1",
        "-",
        "driving 3.0 s",
        "cmd_vel",
        "12.2 V",
        "1.2.3",
        "yes",
        "0.5 s ago",
        "cmd_vel drives.",
    ]
    # Of a robot out of sight its old reason would be taken for the present one.
    assert "was driving" in lost
    assert lost.endswith("1 min 30 s ago")
    assert never.endswith("never")
    assert good.index("cmd_vel") == head.index("driver")


def test_a_name_commands_no_terminal_and_has_an_end() -> None:
    row = RobotRow(robot="\x1b[2J" + "n" * 500, needs="", can_drive=True)
    line = table([row])[1]
    assert line.isprintable()
    assert len(line.split()[0]) <= LONGEST_WORD
    assert one_line(row).isprintable()
