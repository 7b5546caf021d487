"""How fast `yahboomd stop --all` stops fifty robots over a tree of routers, and under faults.

    python -m benchmarks.stop_fifty [--delay-ms 50] [--real 3] [--robots 50] [--zenohd PROGRAM]

All files are those of `yahboomd fleet init`: mutual TLS and access rules everywhere. Everything
that reaches the upper router, the operator's connection and those of both sites, is delayed in each
direction. The operator's file names the way over the upper router alone, so that every stop
passes the whole tree. Real robots drive; a fault ends after three seconds.
"""

from __future__ import annotations

import argparse
import os
import signal
import time
from typing import Any

from benchmarks import rig
from benchmarks.fleet_rig import Fleet

FAULT_S = 3.0
FAULTS = ("frozen", "router", "cut", "liar")


def stop(fleet: Fleet, fault: str = "") -> dict[str, Any]:
    """Stop all while a fault lasts for some seconds; returns the operator's result."""
    if fault:
        victim, way = fleet.processes[fleet.real[0]], fleet.processes["way-north"]
    if fault in {"frozen", "liar"}:
        os.kill(victim.pid, signal.SIGSTOP)
    if fault == "liar":
        frozen, site = fleet.namespace(fleet.real[0]), fleet.site(fleet.real[0])
        thief = next(each for each in fleet.thin if fleet.site(each) == site)
        papers = (str(fleet.folder), fleet.namespace(thief), frozen)
        fleet.begin("liar", "lie", *papers).says("lies")
        time.sleep(1.0)
    process = fleet.begin("operator", "stop", str(fleet.papers))
    process.says("begins")
    if fault == "router":
        fleet.processes["north"].process.kill()
    elif fault == "cut":
        os.kill(way.pid, signal.SIGSTOP)
    if fault:
        time.sleep(FAULT_S)
    if fault in {"frozen", "liar"}:
        os.kill(victim.pid, signal.SIGCONT)
    elif fault == "router":
        fleet.router("north")
    elif fault == "cut":
        os.kill(way.pid, signal.SIGCONT)
    found = fleet.result("operator")
    if fault == "liar":
        fleet.processes["liar"].end()
    process.end_by_itself()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.stop_fifty")
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--real", type=int, default=3)
    parser.add_argument("--delay-ms", type=float, default=50.0)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--zenohd", default="", help="the routers' program")
    args = parser.parse_args()
    with rig.folder() as folder:
        fleet = Fleet(
            folder,
            robots=args.robots,
            real=args.real,
            delay_s=args.delay_ms / 1e3,
            zenohd=args.zenohd,
        )
        try:
            fleet.start()
            for fault in [*[""] * args.runs, *FAULTS]:
                with fleet.driven():
                    found = stop(fleet, fault)
                print(f"{fault or 'no fault'}: {summary(found)}", flush=True)
        finally:
            fleet.close()


def summary(found: dict[str, Any]) -> str:
    """How many acknowledged, and when."""
    times = found["times"]
    known = sorted(each for each in times.values() if each is not None)
    return (
        f"{len(known)} of {len(times)}, first {known[0]:.2f} s, "
        f"median {known[len(known) // 2]:.2f} s, within a second of the first "
        f"{sum(each - known[0] <= 1.0 for each in known)}, last {known[-1]:.2f} s; "
        f"{' '.join(found['report'])}"
    )


if __name__ == "__main__":
    main()
