from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.soak.ledger import Ledger
from benchmarks.soak.page import BEGIN, END, insert, page

FACTS = {
    "minutes": 60.0,
    "seed": 1,
    "commands": 63440,
    "poses": 152864,
    "jumps": 0,
    "rss_start_mb": 52.1,
    "rss_end_mb": 55.1,
    "rss_most_mb": 58.8,
    "daemons": 43,
    "watchdog_kills": 14,
    "tracebacks": 0,
    "stalls": 12,
    "stall_worst_ms": 31.0,
}


def ledger() -> Ledger:
    found = Ledger()
    found.faults.update({"e-stop": 3, "burst": 2})
    for ms in (0.9, 4.4, 60.0):
        found.latency("e-stop", ms / 1e3, stalled_s=0.02)
        found.stopped("e-stop", 0.25)
    found.notes["while the machine stood still: it latched"] += 1
    return found


def test_every_fault_and_every_latency_has_a_row() -> None:
    text = page(ledger(), FACTS)
    assert "60 minutes of it (`SEED=1`)" in text
    assert "| faults injected | 5, of 2 kinds |" in text
    assert "| e-stop | 3 | 0.25 | 0.25 |" in text
    assert "| burst | 2 | | |" in text
    assert "| e-stop | 3 | 4.4 | 60.0 | 50 | 1 |" in text
    assert "- 1 times while the machine stood still: it latched" in text


def test_a_run_that_measured_nothing_has_a_page_too() -> None:
    assert "not measured" in page(Ledger(), FACTS)


def test_the_tables_replace_those_between_the_marks_of_a_page(tmp_path: Path) -> None:
    file = tmp_path / "safety.md"
    file.write_text(f"before\n\n{BEGIN}\nold\n{END}\n\nafter\n")
    insert(file, "new")
    assert file.read_text() == f"before\n\n{BEGIN}\nnew\n{END}\n\nafter\n"
    file.write_text("no marks")
    with pytest.raises(ValueError, match="does not have the lines"):
        insert(file, "new")


def test_the_page_of_safety_has_the_marks() -> None:
    text = (Path(__file__).parents[2] / "docs" / "safety.md").read_text()
    assert text.count(BEGIN) == text.count(END) == 1
