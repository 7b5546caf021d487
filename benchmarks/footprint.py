"""`make footprint`: memory, CPU, start-up time and sizes of the daemon.

A simulated board and the daemon run as processes, the daemon with its default settings, while one
application drives at 20 commands a second and reads every pose. Then the sizes of the wheel, of
its dependencies, and of the Debian package if one can be built here.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path

import zenoh

from benchmarks import rig
from benchmarks.floors import router
from benchmarks.results import ROOT

STARTS = 5
SECONDS = 20.0
Row = tuple[str, str, str]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--seconds", type=float, default=SECONDS, help="to measure the CPU over")
    parser.add_argument("--no-sizes", action="store_true", help="build no wheel and no package")
    parser.add_argument("--set", action="append", default=[], help="a setting of the daemon's")
    args = parser.parse_args()
    rows = measured("streamed", STARTS, args.seconds, args.set)
    rows += measured("polled", 1, args.seconds, args.set)[-2:]
    if not args.no_sizes:
        with rig.folder() as where:
            rows += sizes(where)
    print("| what | measured | goal |\n|---|---|---|")
    for row in rows:
        print("|", " | ".join(row), "|")
    load = os.getloadavg()[0]
    print(f"\nPython {sys.version.split()[0]}, {os.cpu_count()} cores, load {load:.1f}")


def measured(dialect: str, starts: int, seconds: float, settings: list[str]) -> list[Row]:
    """Start the daemon several times on a board of one dialect, and measure the last one."""
    poses = 0
    came = threading.Event()

    def hear(_: zenoh.Sample) -> None:
        nonlocal poses
        poses += 1
        came.set()

    def used(pid: int, session: zenoh.Session | None) -> tuple[float, float]:
        """CPU as a share of a core, and poses a second; it drives if there is a session."""
        time.sleep(3.0)
        before, first = rig.usage(pid), poses
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if session is not None:
                session.put("cmd_vel", b'{"vx":0.2,"wz":0.1}')
            time.sleep(0.05)
        after = rig.usage(pid)
        took_s = (after.wall_ns - before.wall_ns) / 1e9
        return rig.share_of_core(before, after), (poses - first) / took_s

    took = []
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(rig.folder())
        stack.enter_context(rig.simulator(where, "--dialect", dialect))
        endpoint = rig.free_endpoint()
        session = stack.enter_context(zenoh.open(router(endpoint)))
        session.declare_subscriber("yahboomd/pose", hear)
        # It listens and joins a router, as by default, so both of its sessions are open.
        joined = (f'zenoh.connect=["{endpoint}"]', "log.level=error", *settings)
        for number in range(starts):
            came.clear()
            begun = time.monotonic()
            with rig.daemon(where, rig.free_endpoint(), *joined, port="board") as daemon:
                if not came.wait(rig.PATIENCE_S):
                    raise SystemExit("footprint: no pose came.")
                took.append(time.monotonic() - begun)
                if number == starts - 1:
                    # Driven first, so that counters have as many digits as on a robot in use.
                    driven, rate = used(daemon.pid, session)
                    quiet, _ = used(daemon.pid, None)
                    use = rig.usage(daemon.pid)
                    private = private_bytes(daemon.pid)
    cpu = f"CPU at {rate:.0f} poses/s, {dialect} board"
    middle = f"{statistics.median(took):.2f} s (worst {max(took):.2f})"
    return [
        ("resident memory", f"{use.rss_mb:.1f} MB", "60 MB"),
        ("of that, not shared with other programs", mb(private), ""),
        ("threads", str(use.threads), ""),
        (f"start to first pose received, median of {starts}", middle, "1.0 s"),
        (f"{cpu}, no commands", f"{quiet:.1%} of a core", "3 %"),
        (f"{cpu}, 20 commands a second", f"{driven:.1%} of a core", "3 %"),
    ]


def private_bytes(pid: int) -> int:
    """The memory of a process that it shares with no other."""
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return sum(int(line.split()[1]) * 1024 for line in rollup if line.startswith("Private_"))


def sizes(where: Path) -> list[Row]:
    """The wheel, what it needs, and the Debian package."""
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    subprocess.check_call([*pip, "wheel", "--no-deps", "--wheel-dir", str(where), str(ROOT)])
    wheel = next(where.glob("yahboomd-*.whl"))
    site = where / "site"
    subprocess.check_call([*pip, "install", "--no-compile", "--target", str(site), str(wheel)])
    installed = sum(path.stat().st_size for path in site.rglob("*") if path.is_file())
    rows = [
        ("wheel", mb(wheel.stat().st_size), ""),
        ("installed, with what it needs", mb(installed), ""),
    ]
    if shutil.which("dpkg-deb") and Path("/usr/bin/python3").exists():
        command = [sys.executable, "packaging/build_deb.py", "--output", str(where)]
        if subprocess.call(command, cwd=ROOT, stdout=subprocess.DEVNULL) == 0:
            package = next(where.glob("*.deb"))
            rows.append(("Debian package, with what it needs", mb(package.stat().st_size), ""))
    return rows


def mb(size: float) -> str:
    """Bytes as megabytes."""
    return f"{size / 1e6:.1f} MB"


if __name__ == "__main__":
    main()
