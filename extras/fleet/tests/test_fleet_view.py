from __future__ import annotations

import math
from typing import Any

import daemon_samples
import msgspec
import pytest

from yahboomd.core.messages.native import StatusSample
from yahboomd.tools.people.people_keys import own_stop
from yahboomd_fleet.fleet_view import (
    LONGEST_WHY,
    LONGEST_WORD,
    MOST_UNLISTED,
    NEEDS,
    STALE_S,
    FleetView,
    RobotRow,
)
from yahboomd_fleet.fleet_words import cells

S = 1_000_000_000
STALE_NS = round(STALE_S * S)


def status(state: str = "standing", **changes: Any) -> StatusSample:
    found = daemon_samples.status(state, driver=None, why="At rest.", bus={"zid": "a1"})
    return msgspec.structs.replace(found, **changes)


def row_of(view: FleetView, robot: str, now_ns: int = 0) -> RobotRow:
    [found] = [row for row in view.rows(now_ns) if row.robot == robot]
    return found


def test_robots_that_need_somebody_come_first_in_the_order_of_needs() -> None:
    battery = {"volts": 9.9, "battery": "low"}
    at = {
        "d": status("fault"),
        "c": status("driving"),
        "x": status("dreaming"),
        "b": status("standing", board=battery | {"battery": "empty"}),
        "e": status("estopped"),
        "w": status("waiting"),
        "l": status("standing", board=battery),
        "a": status("standing"),
    }
    view = FleetView([*at, "off", "silent"])
    view.answered("c", at["c"], 0)
    later_ns = STALE_NS
    for robot, sample in at.items():
        if robot != "c":
            view.answered(robot, sample, later_ns)
    view.token("silent", later_ns, present=True)
    rows = view.rows(later_ns)
    assert [row.robot for row in rows] == ["d", "c", "x", "silent", "b", "e", "w", "off", "l", "a"]
    assert [row.needs for row in rows] == [*NEEDS, ""]
    assert [row.robot for row in rows if row.can_drive] == ["b", "l", "a"]


def test_a_row_has_what_the_robot_told() -> None:
    view = FleetView(["bot1"])
    told = status(
        "driving", why="cmd_vel/anna drives.", driver="cmd_vel/anna", board={"volts": 12.25}
    )
    view.answered("bot1", told, 5 * S)
    view.configured("bot1", {"version": "1.2.3", "chassis": {"wheel_separation_multiplier": 1.03}})
    assert row_of(view, "bot1", 6 * S) == RobotRow(
        robot="bot1",
        needs="",
        can_drive=True,
        state="driving",
        state_s=3.0,
        why="cmd_vel/anna drives.",
        driver="cmd_vel/anna",
        volts=12.25,
        version="1.2.3",
        calibrated=True,
        seen_s=1.0,
    )


def test_a_robot_that_leaves_is_missed_at_once_and_one_that_falls_silent_after_a_while() -> None:
    view = FleetView(["bot1", "bot2"])
    for robot in ("bot1", "bot2"):
        view.token(robot, 0, present=True)
        view.answered(robot, status(), 0)
    assert view.waiting(1) == []
    view.token("bot1", 1, present=False)
    assert row_of(view, "bot1", 1).needs == "not reachable"
    assert view.waiting(1) == ["bot1"]
    assert row_of(view, "bot2", STALE_NS - 1).can_drive
    late = row_of(view, "bot2", STALE_NS)
    assert (late.needs, late.can_drive, late.state) == ("does not answer", False, "standing")
    # It is there again as soon as it answers.
    view.answered("bot1", status(), 2)
    assert row_of(view, "bot1", 2).can_drive


def test_robots_of_no_list_are_shown_up_to_a_number_and_hide_none_of_the_list() -> None:
    view = FleetView(["mine"])
    for number in range(MOST_UNLISTED + 1000):
        view.token(f"fake{number}", 0, present=True)
    view.answered("fake9999", status(), 0)
    view.answered("mine", status("fault"), 0)
    rows = view.rows(0)
    assert len(rows) == MOST_UNLISTED + 1
    assert (rows[0].robot, rows[0].listed, rows[1].listed) == ("mine", True, False)
    assert view.left_out == 1001
    assert "fake9999" not in {row.robot for row in rows}


@pytest.mark.parametrize(("by", "claimed"), [("anna", True), (own_stop("anna"), False)])
def test_a_name_that_nothing_proves_is_marked(by: str, claimed: bool) -> None:
    view = FleetView(["bot1"])
    view.answered("bot1", status("estopped", why=f"Emergency stop, engaged by {by} 1 s ago."), 0)
    row = row_of(view, "bot1")
    assert row.claimed is claimed
    assert ("Nothing proves that name." in cells(row)[-1]) is claimed


def test_lies_are_cut_and_cleaned_and_numbers_that_are_none_are_left_out() -> None:
    view = FleetView(["liar"])
    huge = 10**400
    view.answered(
        "liar",
        status(
            "standing\x1b[2J" + "x" * 10_000,
            why="\x1b]0;owned\x07" + "w" * 1_000_000,
            driver="\x1b[31m" + "d" * 10_000,
            since_ns=-huge,
            board={"volts": huge, "battery": "low\x9b" * 100},
            bus={"zid": 7, "version": "\x1b" * 1000},
        ),
        0,
    )
    view.configured("liar", {"version": 9, "chassis": {"wheel_separation_multiplier": math.inf}})
    row = row_of(view, "liar")
    texts = [row.state, row.why, row.driver, row.battery, row.version]
    assert all(text is not None and text.isprintable() for text in texts)
    assert max(len(text) for text in texts if text is not None and text != row.why) <= LONGEST_WORD
    assert len(row.why) <= LONGEST_WHY
    assert (row.volts, row.state_s, row.calibrated) == (None, None, None)
    assert row.needs == "unknown state"
