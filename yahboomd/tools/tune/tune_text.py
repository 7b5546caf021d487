"""The outcome of a tuning in lines for a person. Pure."""

from __future__ import annotations

import textwrap

from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.tools.tune.estimates.step_response import StepFigures
from yahboomd.tools.tune.tuning_result import DEAD_ZONE, GAINS, Result

HEADINGS = (
    "wheel",
    "",
    "rise",
    "overshoot",
    "settled",
    "steady error",
    "turns from output",
    "stops below",
)


def values(settings: BoardSettings) -> str:
    """Tuned values in words."""
    words = []
    gains = settings.get(GAINS)
    if isinstance(gains, tuple):
        words.append("P {:g}, I {:g}, D {:g}".format(*gains))
    if DEAD_ZONE in settings:
        words.append(f"dead zone {settings[DEAD_ZONE]}")
    return "; ".join(words) or "nothing"


def lines(result: Result, width: int = 100) -> list[str]:
    """The report."""
    cells: list[tuple[str, ...]] = [HEADINGS]
    for wheel in result.wheels:
        shown = [
            "" if each is None else f"{each[0]} / {-each[1]}"
            for each in (wheel.turning_output, wheel.stopping_output)
        ]
        for when, found in (("before", wheel.before), ("after", wheel.after)):
            if found is not None:
                name = f"{wheel.name} (M{wheel.position})" if when == "before" else ""
                cells.append(
                    (name, when, *_figures(found), *(shown if when == "before" else ("", "")))
                )
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    found_lines = [
        "   ".join(cell.ljust(size) for cell, size in zip(row, widths, strict=True)).rstrip()
        for row in cells
    ]
    found_lines += ["", f"steps of {result.speed_m_s:.2f} m/s, forward and backward"]
    if result.stored_before:
        found_lines.append(f"stored before   {values(result.stored_before)}")
    if result.suggested:
        found_lines.append(f"suggested       {values(result.suggested)}")
    if result.writes:
        found_lines.append(f"stored now      {values(result.stored_now)}")
        found_lines.append(
            f"written         {result.writes} values, {result.resets} restarts of the board"
        )
    for note in result.notes:
        found_lines += textwrap.wrap(
            note, width, initial_indent="  - ", subsequent_indent="    ", break_on_hyphens=False
        )
    return found_lines


def _figures(found: StepFigures) -> tuple[str, str, str, str]:
    return (
        "never" if found.rise_s is None else f"{found.rise_s:.2f} s",
        f"{found.overshoot:.1%}",
        "no" if found.settling_s is None else f"{found.settling_s:.2f} s",
        f"{found.steady_error:+.1%}",
    )
