"""Measure, and write ``docs/benchmarks.md``: ``python -m benchmarks [--short] [NAME ...]``."""

from __future__ import annotations

import argparse
import importlib
import time
from pathlib import Path

from benchmarks import report

POINTS = ("exactness", "baseline", "latency", "throughput", "cost", "fleet")


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(POINTS)}")
    parser.add_argument("--short", action="store_true", help="only to see that it works")
    parser.add_argument("--out", type=Path, default=report.ROOT / "docs", help="the page's folder")
    parser.add_argument("--store", type=Path, default=report.STORE)
    parser.add_argument("--page", action="store_true", help="only write the page anew")
    args = parser.parse_args()
    names = args.names or POINTS
    if unknown := set(names) - set(POINTS):
        parser.error(f"there is no {', '.join(unknown)}")
    (args.out / "images").mkdir(parents=True, exist_ok=True)
    for name in () if args.page else names:
        conditions, began = report.conditions(), time.monotonic()
        module = importlib.import_module(f"benchmarks.{name}")
        section: report.Section = module.bench(short=args.short, images=args.out / "images")
        section.conditions = f"{conditions} {time.monotonic() - began:.0f} s."
        if args.short:
            section.conditions += " A short run: its figures prove nothing."
        report.store(section, args.store)
        print(report.markdown(section), flush=True)
    page = report.page(report.stored(POINTS, args.store))
    (args.out / "benchmarks.md").write_text(page)


if __name__ == "__main__":
    main()
