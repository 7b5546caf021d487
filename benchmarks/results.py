"""Stores the results of the benchmarks as JSON, and publishes them as Markdown.

Each benchmark stores a :class:`Section` in ``build/benchmarks``. The pages are written from all
stored sections, so that one benchmark can be repeated alone: ``docs/benchmarks.md`` has results and
pictures, ``docs/benchmarks/NAME.md`` the method and every table.
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
    """Rows of text; the first column names their subject.

    Attributes:
        title: A sentence above the table.
        header: Names of the columns.
        rows: The cells.
        result: Whether the results page shows it as well.
    """

    title: str
    header: list[str]
    rows: list[list[str]]
    result: bool = False

    def markdown(self) -> str:
        """The table with its title."""
        rows = [self.header, ["---"] * len(self.header), *self.rows]
        return f"{self.title}\n\n" + "\n".join("| " + " | ".join(row) + " |" for row in rows)


class Section(msgspec.Struct, kw_only=True):
    """The results of one benchmark.

    Attributes:
        name: Its name on the command line, and of its page of tables.
        title: Its heading.
        about: The subject and its importance, for the results page.
        how: The method, a paragraph for the page of tables.
        findings: The results, a sentence each: goals reached and goals missed.
        tables: All figures.
        images: Pictures in ``docs/images``, as (file, caption).
        conditions: Date, duration, and load of the machine.
    """

    name: str
    title: str
    about: str
    how: str
    findings: list[str] = msgspec.field(default_factory=list)
    tables: list[Table] = msgspec.field(default_factory=list)
    images: list[tuple[str, str]] = msgspec.field(default_factory=list)
    conditions: str = ""

    def table(
        self,
        title: str,
        header: Sequence[str],
        rows: Iterable[Sequence[str]],
        *,
        result: bool = False,
    ) -> None:
        """Add a table."""
        cells = [list(row) for row in rows]
        self.tables.append(Table(title=title, header=list(header), rows=cells, result=result))


def method(docstring: str | None) -> str:
    """The docstring of a benchmark without its first line, as one paragraph."""
    return (docstring or "").partition("\n\n")[2].strip().replace("\n", " ")


def quantile(values: Sequence[float], share: float) -> float:
    """The value below which ``share`` of the values lie, by rank; NaN without values."""
    if not values:
        return math.nan
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def median(values: Sequence[float]) -> float:
    """The middle value."""
    return quantile(values, 0.5)


def number(value: float) -> str:
    """A number with three significant digits and no exponent."""
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
    """Time, Python, cores and load of this machine, in one sentence."""
    load = os.getloadavg()[0]
    cores = os.cpu_count()
    return (
        f"{time.strftime('%Y-%m-%d %H:%M', time.gmtime())} UTC, Python "
        f"{platform.python_version()}, {cores} shared cores, load average {load:.1f} at the start."
    )


def store(section: Section, folder: Path = STORE) -> None:
    """Store a section."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{section.name}.json").write_bytes(msgspec.json.encode(section))


def age_s(name: str, folder: Path = STORE) -> float:
    """Seconds since a benchmark was measured; infinite if it never was."""
    file = folder / f"{name}.json"
    return time.time() - file.stat().st_mtime if file.exists() else math.inf


def stored(names: Iterable[str], folder: Path = STORE) -> list[Section]:
    """The stored sections among ``names``, in that order."""
    files = [folder / f"{name}.json" for name in names]
    return [msgspec.json.decode(file.read_bytes(), type=Section) for file in files if file.exists()]


HEAD = """\
# Benchmarks

Results and pictures; the links lead to the method and to every table. `make bench` measures all of
it and writes these pages; `.venv/bin/python -m benchmarks NAME` repeats one benchmark.

Times belong to the machine on which they were measured: two shared cores, with a simulated board.
Ratios compare processes that ran at the same time, and carry over to other machines. p50 is the
median; 99 of 100 values are below p99. Worst cases of a virtual machine say more about the machine
than about yahboomd. [What was tried](benchmarks/ratios.md) to make it cheaper has a page.
"""


def results(section: Section) -> str:
    """A section of the results page."""
    parts = [f"## {section.title}", section.about]
    if section.findings:
        parts.append("\n".join(f"- {finding}" for finding in section.findings))
    parts += [table.markdown() for table in section.tables if table.result]
    parts += [f"![{caption}](images/{file})\n\n*{caption}*" for file, caption in section.images]
    parts.append(f"[Method and all tables](benchmarks/{section.name}.md)")
    parts.append(f"<sub>{section.conditions}</sub>")
    return "\n\n".join(parts)


def tables(section: Section) -> str:
    """The page with the method and every table of one benchmark."""
    parts = [f"# {section.title}", section.how]
    parts += [table.markdown() for table in section.tables]
    parts.append(f"<sub>{section.conditions}</sub>")
    parts.append("[Results of all benchmarks](../benchmarks.md)")
    return "\n\n".join(parts) + "\n"


def write_pages(sections: Sequence[Section], out: Path) -> None:
    """Write the results page, and one page of tables for each section."""
    (out / "benchmarks.md").write_text("\n\n".join([HEAD.strip(), *map(results, sections)]) + "\n")
    folder = out / "benchmarks"
    folder.mkdir(parents=True, exist_ok=True)
    for section in sections:
        (folder / f"{section.name}.md").write_text(tables(section))
