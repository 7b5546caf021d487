"""``python -m benchmarks.soak``: see the package."""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.soak import judges
from benchmarks.soak.course import Course
from benchmarks.soak.ledger import Ledger
from benchmarks.soak.page import insert, page
from benchmarks.soak.schedule import (
    DIALECTS,
    ENDING,
    FAULTS,
    RESETS,
    SHOWN,
    WITHOUT,
    Turn,
    segments,
)
from yahboomd.blackbox.box_file import read_box
from yahboomd.blackbox.saved_boxes import BYTES_MOST, FILES_MOST, saved_boxes
from yahboomd.core.errors import YahboomdError
from yahboomd.tools.blackbox.box_places import box_bytes

RSS_GROWTH_MB = 30.0

STARVED_S = 1.0
"""A daemon that had no processor for this part of its last four seconds may end by the watchdog."""


def main(arguments: list[str]) -> int:
    """Run the soak.

    Returns:
        0 if everything held, 1 if something did not, 2 if it could not be run.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=2.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", help="only these faults, separated by commas")
    parser.add_argument("--dialect", choices=DIALECTS, help="only boards that speak it")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    parser.add_argument("--page", type=Path, metavar="FILE", help="put the tables into that page")
    parser.add_argument("--keep", action="store_true", help="keep the folder with the daemon's log")
    args = parser.parse_args(arguments)
    known = {**FAULTS, **ENDING, **RESETS}
    kinds = [kind.strip() for kind in args.kinds.split(",")] if args.kinds else []
    if unknown := set(kinds) - set(known):
        parser.error(f"no fault is called {', '.join(unknown)}; there are {', '.join(known)}")
    if kinds and args.dialect and WITHOUT[args.dialect].issuperset(kinds):
        parser.error(f"a {args.dialect} board does not go through {', '.join(kinds)}")
    ending = ends_when_asked()
    # A shell's background jobs ignore it, and the daemon would inherit that.
    signal.signal(signal.SIGQUIT, signal.SIG_DFL)
    folder = Path(tempfile.mkdtemp(prefix="yahboomd-soak-"))
    ledger = Ledger()
    print(f"soak: {args.minutes:g} min, seed {args.seed}, in {folder}", flush=True)
    facts: dict[str, Any] = {}
    course = Course(folder, args.seed, ledger, args.dialect or DIALECTS[0])
    try:
        with contextlib.suppress(KeyboardInterrupt):
            dialects = [args.dialect] if args.dialect else DIALECTS
            drive(course, args.minutes * 60.0, kinds, dialects, ending)
    finally:
        facts = finish(course)
        facts["boxes"], unreadable = black_boxes(folder / "state" / "blackbox")
        ledger.failures += unreadable
        if not args.keep and not ledger.failures:
            shutil.rmtree(folder, ignore_errors=True)
        else:
            print(f"the daemon's log: {folder / 'daemon.log'}")
    text = page(ledger, facts | {"seed": args.seed})
    report(ledger, text)
    if args.page:
        insert(args.page, text)
    if args.json:
        args.json.write_bytes(msgspec.json.encode(figures(ledger, facts)))
    return 1 if ledger.failures or ledger.too_late else 0


def ends_when_asked() -> threading.Event:
    """What the first SIGINT or SIGTERM sets; the second one interrupts.

    Between two faults nothing is half done. An interrupt within ``Popen.wait`` may leave its lock
    taken, and the next wait for that process would never end.
    """
    asked = threading.Event()

    def ask(*_: object) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()
        os.write(2, b"soak: it ends after this fault; ask again to end it at once\n")

    signal.signal(signal.SIGINT, ask)
    signal.signal(signal.SIGTERM, ask)
    return asked


def drive(
    course: Course,
    for_s: float,
    kinds: list[str],
    dialects: Sequence[str],
    ending: threading.Event,
) -> None:
    """Inject fault after fault until the time is over, on boards of alternating dialects."""
    began = time.monotonic()
    course.kind = "start"
    course.ready()
    course.compare()
    for number, segment in enumerate(segments(course.random, kinds, dialects)):
        changed = time.monotonic()
        if ending.is_set():
            return
        if number:
            another_board(course, segment.dialect)
        for turn in segment.turns:
            now = time.monotonic()
            if ending.is_set() or now - began > for_s:
                return
            if now - changed > for_s / len(dialects):
                # A short run still sees all dialects.
                break
            one(course, turn)


def another_board(course: Course, dialect: str) -> None:
    """Replace the board by one of another dialect; the daemon goes on."""
    course.kind = "another board"
    course.turn_ns = time.monotonic_ns()
    course.ledger.faults[course.kind] += 1
    since_ns = time.monotonic_ns()
    course.change_board(dialect)
    if course.ready():
        course.drives_again(since_ns)
        course.compare()


def one(course: Course, turn: Turn) -> None:
    """Inject one fault, verify its consequences, and restore the robot."""
    course.kind = turn.kind
    ledger = course.ledger
    lives, found = len(course.manager.lives), len(course.app.poses.found)
    began = time.monotonic()
    course.turn_ns = time.monotonic_ns()
    course.app.wander()
    time.sleep(course.random.uniform(0.5, 1.5))
    if course.latched:
        course.unexpected(f"it latched by itself: {course.why}", round(began * 1e9) - 5_000_000_000)
        course.ready()
        course.app.wander()
    ledger.faults[turn.kind] += 1
    turn.fault(course)
    over_ns = time.monotonic_ns()
    if course.ready():
        course.drives_again(over_ns)
        time.sleep(course.random.uniform(0.2, 0.8))
        course.compare()
    if turn.kind not in SHOWN:
        judges.alarms(course, round(began * 1e9))
    jumps = course.app.poses.found[found:]
    for jump_kind in sorted({jump.kind for jump in jumps}):
        alike = [jump for jump in jumps if jump.kind == jump_kind]
        worst = max(alike, key=lambda jump: abs(jump.step))
        course.fail(
            f"{jump_kind}: {len(alike)} steps, the worst of {worst.step:.6g}; "
            f"{worst.most:.6g} is the most"
        )
    for life in course.manager.lives[lives - 1 : -1]:
        if not life.asked:
            ended_ns = life.ended_ns or time.monotonic_ns()
            words = f"the daemon ended, with {life.status}{life.note}"
            if course.waiting.within_s(ended_ns - 4_000_000_000, ended_ns) > STARVED_S:
                ledger.notes[f"while it had no processor: {words}"] += 1
            else:
                course.unexpected(words, ended_ns - 4_000_000_000)
    print(
        f"{(time.monotonic_ns() - course.began_ns) / 1e9:7.1f} s  {course.board.dialect:<9}"
        f"{turn.kind:<27}{time.monotonic() - began:6.1f} s",
        flush=True,
    )


def finish(course: Course) -> dict[str, Any]:
    """End every process; returns the results."""
    lives = list(course.manager.lives)
    course.kind = "end"
    course.close()
    ledger = course.ledger
    weighed = [life for life in lives if life.rss_first_mb is not None]
    oldest = max(weighed, key=lambda life: life.age_s, default=None)
    facts = {
        "minutes": (time.monotonic_ns() - course.began_ns) / 60e9,
        "commands": course.app.commands,
        "poses": course.app.poses.samples,
        "jumps": len(course.app.poses.found),
        "fastest_pose_m_s": course.app.poses.fastest_m_s,
        "daemons": len(lives),
        "rss_start_mb": rounded(weighed[0].rss_first_mb) if weighed else None,
        "rss_end_mb": rounded(weighed[-1].rss_mb) if weighed else None,
        "rss_most_mb": max((rounded(life.rss_most_mb) for life in weighed), default=None),
        "oldest_s": round(oldest.age_s) if oldest else None,
        "oldest_rss_mb": [rounded(oldest.rss_first_mb), rounded(oldest.rss_mb)] if oldest else None,
        "stalls": course.stalls.count,
        "stall_worst_ms": course.stalls.worst_s * 1e3,
        "tracebacks": course.manager.tracebacks,
        "watchdog_kills": course.manager.watchdog_kills,
        "events": dict(course.app.events),
        "board_preferred": course.board.preferred,
    }
    for life in weighed:
        if life.rss_first_mb is not None and life.rss_mb > life.rss_first_mb + RSS_GROWTH_MB:
            grew = f"from {life.rss_first_mb:.0f} to {life.rss_mb:.0f} MB in {life.age_s:.0f} s"
            ledger.failures.append(f"memory grew {grew}")
    if facts["tracebacks"]:
        ledger.failures.append(f"{facts['tracebacks']} tracebacks in the daemon's log")
    for kind in ledger.latencies:
        if late := ledger.unexplained(kind):
            words = ", ".join(f"{each.seconds * 1e3:.0f} ms" for each in late)
            ledger.too_late.append(f"{kind}: over its budget, and no stall explains it: {words}")
    return facts


def black_boxes(folder: Path) -> tuple[int, list[str]]:
    """Count the saved black boxes, and list problems: none may be cut, nor all too large."""
    found = saved_boxes(folder)
    wrong = []
    for box in found:
        try:
            damaged = read_box(box_bytes(box.path)).damaged
        except YahboomdError as error:
            wrong.append(f"{box.path.name}: {error}")
        else:
            wrong += [f"{box.path.name} is damaged"] if damaged else []
    if len(found) > FILES_MOST or sum(box.size for box in found) > BYTES_MOST:
        wrong.append(f"the black boxes take {sum(box.size for box in found)} bytes")
    return len(found), wrong


def rounded(mb: float | None) -> float:
    """Round a figure for people."""
    return round(mb or 0.0, 1)


def figures(ledger: Ledger, facts: dict[str, Any]) -> dict[str, Any]:
    """All figures, for programs."""
    return {
        **facts,
        "faults": dict(ledger.faults),
        "latencies": ledger.latencies,
        "stood_s": ledger.stood_s,
        "stops": ledger.stops,
        "drives": ledger.drives,
        "errors_m": ledger.errors_m,
        "errors_rad": ledger.errors_rad,
        "uncertain": ledger.uncertain,
        "covered": ledger.covered,
        "apart": dict(ledger.apart),
        "notes": dict(ledger.notes),
        "failures": ledger.failures,
        "too_late": ledger.too_late,
    }


def report(ledger: Ledger, text: str) -> None:
    """Print the tables, the failures, and the verdict."""
    print(f"\n{text}\n")
    for words in (*ledger.failures, *ledger.too_late):
        print(f"FAILED {words}")
    print("verdict: see above" if ledger.failures or ledger.too_late else "verdict: all held")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
