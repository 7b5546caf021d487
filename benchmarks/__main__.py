"""Measure, and write ``docs/benchmarks.md``: ``python -m benchmarks [--short] [NAME ...]``.

The pages are written after each benchmark. If one fails, the others are still measured.
``--resume`` continues an interrupted run; ``--page`` writes the pages from stored results.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
import traceback
from pathlib import Path

from benchmarks import results

POINTS = ("exactness", "baseline", "latency", "cost")

RESUME_S = 3600.0
"""``--resume`` skips benchmarks that were measured within this time."""


def measure(name: str, *, short: bool, out: Path, store: Path) -> None:
    """Run one benchmark, store its results and print them."""
    conditions, began = results.conditions(), time.monotonic()
    module = importlib.import_module(f"benchmarks.{name}")
    section: results.Section = module.bench(short=short, images=out / "images")
    section.conditions = f"{conditions} {time.monotonic() - began:.0f} s."
    if short:
        section.conditions += " A short run: its figures prove nothing."
    results.store(section, store)
    print(results.results(section), results.tables(section), sep="\n\n", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(POINTS)}")
    parser.add_argument("--short", action="store_true", help="a quick check that it works")
    parser.add_argument(
        "--out", type=Path, default=results.ROOT / "docs", help="the folder of the pages"
    )
    parser.add_argument("--store", type=Path, default=results.STORE)
    parser.add_argument(
        "--page", action="store_true", help="measure nothing: write the pages from stored results"
    )
    parser.add_argument("--resume", action="store_true", help="skip benchmarks of the last hour")
    args = parser.parse_args()
    names = args.names or POINTS
    if unknown := set(names) - set(POINTS):
        parser.error(f"there is no {', '.join(unknown)}")
    (args.out / "images").mkdir(parents=True, exist_ok=True)
    failed = []
    for name in () if args.page else names:
        if args.resume and results.age_s(name, args.store) < RESUME_S:
            continue
        try:
            measure(name, short=args.short, out=args.out, store=args.store)
        except Exception:  # noqa: BLE001 - printed, and the exit code is 1
            traceback.print_exc()
            failed.append(name)
        results.write_pages(results.stored(POINTS, args.store), args.out)
    results.write_pages(results.stored(POINTS, args.store), args.out)
    if failed:
        words = " ".join(failed)
        sys.exit(f"Not measured: {words}. Again: .venv/bin/python -m benchmarks {words}")


if __name__ == "__main__":
    main()
