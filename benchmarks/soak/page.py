"""Writes the result as markdown, for the page ``docs/safety.md``."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.soak.ledger import BUDGETS_S, Ledger, quantile

BEGIN = "<!-- what `make soak` prints, from here -->"
END = "<!-- to here -->"


def page(ledger: Ledger, facts: dict[str, Any]) -> str:
    """Summary, faults, latencies and notes."""
    parts = [
        f"{facts['minutes']:.0f} minutes of it (`SEED={facts['seed']}`), with every dialect:",
        rows(("", ""), _summary(ledger, facts)),
        rows(
            ("fault", "times", "until the wheels stand, s: median", "longest"),
            _faults(ledger),
        ),
        "Milliseconds from the fault to the frame that answers it:",
        rows(("", "n", "median", "worst", "budget", "over it"), _latencies(ledger)),
    ]
    if ledger.notes or ledger.apart:
        parts.append("Noted, and no failure:\n\n" + "\n".join(_notes(ledger)))
    return "\n\n".join(parts)


def rows(head: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    """A table."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, *body)]
    lines.insert(1, "|" + "---|" * len(head))
    return "\n".join(line.replace("  ", " ") for line in lines)


def insert(path: Path, text: str) -> None:
    """Replace the text between the marks of a page.

    Raises:
        ValueError: It has no marks.
    """
    before, begin, rest = path.read_text().partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{path} does not have the lines {BEGIN!r} and {END!r}.")
    path.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}")


def _summary(ledger: Ledger, facts: dict[str, Any]) -> Iterable[tuple[str, str]]:
    faults = sum(ledger.faults.values())
    yield "faults injected", f"{faults:,}, of {len(ledger.faults)} kinds"
    yield "commands sent", f"{facts['commands']:,}"
    yield "stops verified against the ground truth", f"{ledger.stops:,} (wheels below 30 mm/s)"
    yield (
        "drove again after the fault",
        f"{ledger.drives:,} of {faults:,}, {_spread(ledger.recovery_s, ' s', 1)}",
    )
    yield (
        "pose jumps",
        f"{facts['jumps']} in {facts['poses']:,} samples, stamps that run back or ahead included",
    )
    yield (
        "pose against the truth, between two stands",
        _errors(ledger),
    )
    if ledger.uncertain:
        yield (
            "ways with travel that was reported as unknown",
            f"{ledger.uncertain}, within what was reported; not in the row above",
        )
    at_first, most, last = (facts[f"rss_{name}_mb"] for name in ("start", "most", "end"))
    yield (
        "memory",
        f"{at_first} MiB at the start, {last} MiB at the end, {most} MiB at most",
    )
    kills, tracebacks = facts["watchdog_kills"], facts["tracebacks"]
    yield (
        "starts of the daemon",
        f"{facts['daemons']}, {kills} of them by the watchdog; {tracebacks} tracebacks",
    )
    stalls, worst_ms = facts["stalls"], facts["stall_worst_ms"]
    yield "this machine", f"stood still {stalls:,} times over 3 ms, {worst_ms:.0f} ms at worst"


def _errors(ledger: Ledger) -> str:
    mm = [each * 1e3 for each in ledger.errors_m]
    degrees = [math.degrees(each) for each in ledger.errors_rad]
    way = f"{len(mm)} ways, {ledger.driven_m:.0f} m"
    return f"{_spread(mm, ' mm', 2)} ({ledger.worst_way}); {_spread(degrees, '°', 3)}; {way}"


def _faults(ledger: Ledger) -> Iterable[tuple[str, ...]]:
    for kind, times in sorted(ledger.faults.items(), key=lambda item: item[0].lower()):
        stood = ledger.stood_s.get(kind, [])
        median, longest = (statistics.median(stood), max(stood)) if stood else (None, None)
        yield kind, f"{times}", _number(median, 2), _number(longest, 2)


def _latencies(ledger: Ledger) -> Iterable[tuple[str, ...]]:
    for kind, found in sorted(ledger.latencies.items(), key=lambda item: item[0].lower()):
        ms = [each.seconds * 1e3 for each in found]
        budget_s = BUDGETS_S.get(kind)
        yield (
            kind,
            f"{len(ms)}",
            f"{quantile(ms, 0.5):.1f}",
            f"{max(ms):.1f}",
            f"{budget_s * 1e3:.0f}" if budget_s is not None else "",
            f"{len(ledger.late(kind))}" if budget_s is not None else "",
        )


def _notes(ledger: Ledger) -> Iterable[str]:
    for why, times in sorted(ledger.apart.items()):
        yield f"- {times} ways between two stands are not compared: {why}"
    for words, times in sorted(ledger.notes.items()):
        yield f"- {times} times {words.rstrip('.')}"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _spread(values: list[float], unit: str, digits: int) -> str:
    if not values:
        return "not measured"
    median, worst = quantile(values, 0.5), max(values)
    return f"{median:.{digits}f}{unit} at the median, {worst:.{digits}f}{unit} at worst"
