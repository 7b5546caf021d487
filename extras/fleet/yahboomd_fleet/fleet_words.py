"""The rows of a fleet as lines of a terminal. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from yahboomd.core.program import plain
from yahboomd.tools.terminal.words import duration
from yahboomd_fleet.fleet_view import LONGEST_WORD, NEEDS, RobotRow

HEAD = ("robot", "needs", "state", "driver", "battery", "version", "calibrated", "seen", "why")


def summary(rows: Sequence[RobotRow], left_out: int = 0) -> str:
    """How many robots there are, and how many need somebody for which reason."""
    counts = Counter(row.needs for row in rows if row.needs)
    robots = f"{len(rows)} robot{'' if len(rows) == 1 else 's'}"
    if not rows:
        words = "No robot."
    elif not counts:
        words = f"{robots}, and none needs anybody."
    else:
        reasons = ", ".join(f"{counts[needs]} {needs}" for needs in NEEDS if needs in counts)
        words = f"{robots}; {counts.total()} need somebody: {reasons}."
    more = f" {left_out} answers of more robots, or unreadable ones, are left out."
    return words + (more if left_out else "")


def cells(row: RobotRow) -> tuple[str, ...]:
    """The words of a row, one for each of ``HEAD``."""
    state = row.state or "-"
    if row.state is not None and row.state_s is not None and row.needs not in _OUT_OF_SIGHT:
        state += f" {duration(row.state_s)}"
    if row.needs in _OUT_OF_SIGHT and row.state is not None:
        state = f"was {state}"
    battery = "-" if row.volts is None else f"{row.volts:.1f} V"
    calibrated = {None: "-", True: "yes", False: "no"}[row.calibrated]
    seen = "never" if row.seen_s is None else f"{duration(row.seen_s)} ago"
    robot = plain(row.robot or "(no name)")
    return (
        robot if len(robot) <= LONGEST_WORD else f"{robot[: LONGEST_WORD - 1]}…",
        row.needs or "-",
        state,
        row.driver or "-",
        battery,
        row.version or "-",
        calibrated,
        seen,
        "" if row.needs in _OUT_OF_SIGHT else f"{row.why}{_CLAIMED if row.claimed else ''}",
    )


def table(rows: Sequence[RobotRow]) -> list[str]:
    """A line for each row, below one with the names of its columns."""
    lines = [HEAD, *map(cells, rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)][:-1]
    return [
        "  ".join(
            (*(f"{word:<{width}}" for word, width in zip(words, widths, strict=False)), words[-1])
        ).rstrip()
        for words in lines
    ]


def one_line(row: RobotRow) -> str:
    """What a robot does, as a line of a log."""
    robot, needs, state, driver, battery, _, _, _, why = cells(row)
    told = [robot, needs if row.needs else "", state, f"driven by {driver}", battery, why]
    if row.driver is None:
        told[3] = ""
    return "  ".join(filter(None, told))


_CLAIMED = " (Nothing proves that name.)"
_OUT_OF_SIGHT = frozenset({"lost in motion", "does not answer", "not reachable"})
