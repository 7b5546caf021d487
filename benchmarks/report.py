"""What a benchmark found: tables, sentences and pictures, kept as JSON and written as one page.

Each point keeps its findings in ``build/benchmarks``; the page is made of all that are there, so a
single point can be measured anew.
"""

from __future__ import annotations

import math
import os
import platform
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

ROOT = Path(__file__).resolve().parent.parent
STORE = ROOT / "build" / "benchmarks"


class Table(msgspec.Struct, kw_only=True):
    """Rows of text; the first column names what they are about."""

    title: str
    header: list[str]
    rows: list[list[str]]


class Section(msgspec.Struct, kw_only=True):
    """One point of the benchmarks.

    Attributes:
        name: What the command line calls it.
        title: Its heading.
        how: How it was measured, a paragraph.
        findings: What follows, a sentence each: what was reached, and what was not.
        tables: The figures.
        images: Pictures beside the page, as (file, caption).
        conditions: When it was measured, and what else the machine did.
    """

    name: str
    title: str
    how: str
    findings: list[str] = msgspec.field(default_factory=list)
    tables: list[Table] = msgspec.field(default_factory=list)
    images: list[tuple[str, str]] = msgspec.field(default_factory=list)
    conditions: str = ""

    def table(self, title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
        """Add a table."""
        self.tables.append(
            Table(title=title, header=list(header), rows=[list(row) for row in rows])
        )


def quantile(values: Sequence[float], share: float) -> float:
    """The value below which ``share`` of the values lie, by rank; NaN of nothing."""
    if not values:
        return math.nan
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def median(values: Sequence[float]) -> float:
    """The middle one."""
    return quantile(values, 0.5)


def number(value: float) -> str:
    """Three digits that count, without an exponent."""
    if math.isnan(value):
        return "-"
    if value == 0.0 or abs(value) >= 99.95:
        return f"{value:.0f}"
    digits = 2 - math.floor(math.log10(abs(value)))
    return f"{value:.{min(9, max(0, digits))}f}"


def milliseconds(ns: float) -> str:
    """Nanoseconds as milliseconds."""
    return number(ns / 1e6)


def conditions() -> str:
    """The machine and its load now, in one sentence."""
    load = os.getloadavg()[0]
    cores = os.cpu_count()
    return (
        f"{time.strftime('%Y-%m-%d %H:%M', time.gmtime())} UTC, Python "
        f"{platform.python_version()}, {cores} shared cores, load average {load:.1f} at the start."
    )


def store(section: Section, folder: Path = STORE) -> None:
    """Keep a section for the page."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{section.name}.json").write_bytes(msgspec.json.encode(section))


def age_s(name: str, folder: Path = STORE) -> float:
    """How long ago a point was measured; infinite where it never was."""
    file = folder / f"{name}.json"
    return time.time() - file.stat().st_mtime if file.exists() else math.inf


def stored(names: Iterable[str], folder: Path = STORE) -> list[Section]:
    """The sections that are there, in the order of their names."""
    files = [folder / f"{name}.json" for name in names]
    return [msgspec.json.decode(file.read_bytes(), type=Section) for file in files if file.exists()]


def markdown(section: Section) -> str:
    """A section as text."""
    parts = [f"## {section.title}", section.how]
    if section.findings:
        parts.append("\n".join(f"- {finding}" for finding in section.findings))
    for table in section.tables:
        rows = [table.header, ["---"] * len(table.header), *table.rows]
        lines = ["| " + " | ".join(row) + " |" for row in rows]
        parts.append(f"{table.title}\n\n" + "\n".join(lines))
    parts += [f"![{caption}](images/{file})\n\n*{caption}*" for file, caption in section.images]
    parts.append(f"<sub>{section.conditions}</sub>")
    return "\n\n".join(parts)


HEAD = """\
# Benchmarks

Written by `make bench`; `make bench-short` runs a shortened form. A single point is measured anew
with `.venv/bin/python -m benchmarks NAME`. Times belong to the machine they were taken on, whose
cores are shared; ratios were taken in one run, turn by turn, and carry over. Medians (p50) and p99
are meant to be compared; a worst case on a virtual machine often tells of the machine.
"""


def page(sections: Iterable[Section]) -> str:
    """The whole page."""
    return "\n\n".join([HEAD.strip(), *map(markdown, sections)]) + "\n"
