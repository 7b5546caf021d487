"""Measure, and write ``docs/benchmarks.md``: ``python -m benchmarks [--short] [NAME ...]``.

A point that fails does not keep the others from being measured, and the page is written after each:
what could be measured is on it. ``--resume`` goes on where a run was broken off.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
import traceback
from pathlib import Path

from benchmarks import report

POINTS = ("exactness", "baseline", "latency", "throughput", "cost", "fleet")

RESUME_S = 3600.0
"""What was measured no longer ago is of the run that ``--resume`` goes on with."""


def measure(name: str, *, short: bool, out: Path, store: Path) -> None:
    """Measure one point, keep what it found, and print it."""
    conditions, began = report.conditions(), time.monotonic()
    module = importlib.import_module(f"benchmarks.{name}")
    section: report.Section = module.bench(short=short, images=out / "images")
    section.conditions = f"{conditions} {time.monotonic() - began:.0f} s."
    if short:
        section.conditions += " A short run: its figures prove nothing."
    report.store(section, store)
    print(report.markdown(section), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(POINTS)}")
    parser.add_argument("--short", action="store_true", help="only to see that it works")
    parser.add_argument("--out", type=Path, default=report.ROOT / "docs", help="the page's folder")
    parser.add_argument("--store", type=Path, default=report.STORE)
    parser.add_argument("--page", action="store_true", help="only write the page anew")
    parser.add_argument(
        "--resume", action="store_true", help="leave out what was measured within the last hour"
    )
    args = parser.parse_args()
    names = args.names or POINTS
    if unknown := set(names) - set(POINTS):
        parser.error(f"there is no {', '.join(unknown)}")
    (args.out / "images").mkdir(parents=True, exist_ok=True)
    failed = []
    for name in () if args.page else names:
        if args.resume and report.age_s(name, args.store) < RESUME_S:
            continue
        try:
            measure(name, short=args.short, out=args.out, store=args.store)
        except Exception:  # noqa: BLE001 - told, and the exit code says it
            traceback.print_exc()
            failed.append(name)
        write_page(args.out, args.store)
    write_page(args.out, args.store)
    if failed:
        words = " ".join(failed)
        sys.exit(f"Not measured: {words}. Again: .venv/bin/python -m benchmarks {words}")


def write_page(out: Path, store: Path) -> None:
    """The page, of all that is there."""
    (out / "benchmarks.md").write_text(report.page(report.stored(POINTS, store)))


if __name__ == "__main__":
    main()
