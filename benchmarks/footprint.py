"""`make footprint`: memory, CPU, start-up time and sizes of the daemon.

A simulated board and the daemon run as processes, the daemon with its default settings, while one
application drives at 20 commands a second and reads every pose. Then the sizes of the wheel, of
its dependencies, and of the Debian package if one can be built here.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import NamedTuple, Self

import zenoh

from benchmarks.rig import free_endpoint

TREE = Path(__file__).resolve().parent.parent
STARTS = 5
SECONDS = 20.0
PATIENCE_S = 30.0
GOALS = {"memory": 60e6, "cpu": 0.03, "start": 1.0}


class Usage(NamedTuple):
    memory: float
    private: float
    threads: int
    cpu_at_rest: float
    cpu: float
    poses_per_s: float


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--seconds", type=float, default=SECONDS, help="to measure the CPU over")
    parser.add_argument("--no-sizes", action="store_true", help="build no wheel and no package")
    parser.add_argument("--set", action="append", default=[], help="a setting of the daemon's")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="yahboomd-footprint-") as folder:
        starts, usage = _on("streamed", Path(folder), STARTS, args)
        _, polled = _on("polled", Path(folder), 1, args)
        rows = _rows(starts, usage, polled)
        if not args.no_sizes:
            rows += _sizes(Path(folder))
    width = max(len(row[0]) for row in rows)
    print(f"| {'what':<{width}} | measured | goal |\n|{'-' * (width + 2)}|---|---|")
    for what, measured, goal in rows:
        print(f"| {what:<{width}} | {measured} | {goal} |")
    print(
        f"\nPython {sys.version.split()[0]}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    )
    return 0


def _on(
    dialect: str, folder: Path, starts: int, args: argparse.Namespace
) -> tuple[list[float], Usage]:
    """Start the daemon several times on a board of one dialect, and measure the last one."""
    port = folder / dialect
    took = []
    with _yahboomd("simulate", "--link", str(port), "--dialect", dialect) as board:
        try:
            _wait(port.exists)
            with Application() as application:
                for number in range(starts):
                    application.first_pose.clear()
                    begun = time.monotonic()
                    daemon = _daemon(port, application.endpoint, args.set)
                    try:
                        if not application.first_pose.wait(PATIENCE_S):
                            raise SystemExit("footprint: no pose came.")
                        took.append(time.monotonic() - begun)
                        if number == starts - 1:
                            return took, _usage(daemon.pid, application, args.seconds)
                    finally:
                        daemon.send_signal(signal.SIGTERM)
                        daemon.wait()
        finally:
            board.terminate()
    raise AssertionError


def _usage(pid: int, application: Application, seconds: float) -> Usage:
    # Driven first and then at rest, so that counters have as many digits as on a robot in use.
    with application.driving():
        cpu, rate = _cpu(pid, application, seconds)
    cpu_at_rest, _ = _cpu(pid, application, seconds)
    facts = dict(
        line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines()
    )
    rollup = dict(
        line.split(":", 1)
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]
    )
    return Usage(
        memory=int(facts["VmRSS"].split()[0]) * 1024,
        private=sum(
            int(rollup[each].split()[0]) * 1024 for each in ("Private_Clean", "Private_Dirty")
        ),
        threads=int(facts["Threads"]),
        cpu_at_rest=cpu_at_rest,
        cpu=cpu,
        poses_per_s=rate,
    )


def _cpu(pid: int, application: Application, seconds: float) -> tuple[float, float]:
    """The share of a core, and the poses a second."""
    # Let the start pass.
    time.sleep(3.0)
    poses, used_s, begun = application.poses, _cpu_s(pid), time.monotonic()
    time.sleep(seconds)
    took = time.monotonic() - begun
    return (_cpu_s(pid) - used_s) / took, (application.poses - poses) / took


def _rows(starts: list[float], usage: Usage, polled: Usage) -> list[tuple[str, str, str]]:
    return [
        ("resident memory", _mb(usage.memory), _mb(GOALS["memory"])),
        ("of that, not shared with other programs", _mb(usage.private), ""),
        ("threads", str(usage.threads), ""),
        *_cpu_rows("streamed", usage),
        *_cpu_rows("polled", polled),
        (
            f"start to first pose received, median of {len(starts)}",
            f"{statistics.median(starts):.2f} s (worst {max(starts):.2f})",
            f"{GOALS['start']:.1f} s",
        ),
    ]


def _cpu_rows(dialect: str, usage: Usage) -> list[tuple[str, str, str]]:
    rate = f"CPU at {usage.poses_per_s:.0f} poses/s, {dialect} board"
    goal = f"{GOALS['cpu']:.0%}"
    return [
        (f"{rate}, no commands", f"{usage.cpu_at_rest:.1%} of a core", goal),
        (f"{rate}, 20 commands a second", f"{usage.cpu:.1%} of a core", goal),
    ]


def _sizes(folder: Path) -> list[tuple[str, str, str]]:
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    subprocess.check_call([*pip, "wheel", "--no-deps", "--wheel-dir", str(folder), str(TREE)])
    wheel = next(folder.glob("yahboomd-*.whl"))
    site = folder / "site"
    subprocess.check_call([*pip, "install", "--no-compile", "--target", str(site), str(wheel)])
    rows = [
        ("wheel", _mb(wheel.stat().st_size), ""),
        ("installed, with what it needs", _mb(_size(site)), ""),
    ]
    if shutil.which("dpkg-deb") and Path("/usr/bin/python3").exists():
        command = [sys.executable, "packaging/build_deb.py", "--output", str(folder)]
        if subprocess.call(command, cwd=TREE, stdout=subprocess.DEVNULL) == 0:
            package = next(folder.glob("*.deb"))
            rows.append(("Debian package, with what it needs", _mb(package.stat().st_size), ""))
    return rows


class Application:
    """Reads poses and drives; the daemon joins it."""

    def __init__(self) -> None:
        self.first_pose = threading.Event()
        self.poses = 0
        self.endpoint = free_endpoint()
        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", json.dumps([self.endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        self._session = zenoh.open(config)
        self._session.declare_subscriber("yahboomd/pose", self._hear)
        self._stop = threading.Event()
        self._driver: threading.Thread | None = None

    def _hear(self, _: zenoh.Sample) -> None:
        self.poses += 1
        self.first_pose.set()

    def driving(self) -> Application:
        self._stop.clear()
        self._driver = threading.Thread(target=self._drive, daemon=True)
        self._driver.start()
        return self

    def _drive(self) -> None:
        while not self._stop.wait(0.05):
            self._session.put("cmd_vel", b'{"vx":0.2,"wz":0.1}')

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._driver is not None:
            # Ends the driving; the next call ends the application.
            self._stop.set()
            self._driver.join()
            self._driver = None
            return
        self._session.close()


def _daemon(port: Path, endpoint: str, settings: list[str]) -> subprocess.Popen[bytes]:
    more = [word for setting in settings for word in ("--set", setting)]
    return _yahboomd(
        # It listens and joins a router, as by default, so both of its sessions are open.
        *("run", "--no-guard", "--port", str(port), "--set", f'zenoh.listen=["{free_endpoint()}"]'),
        *("--set", f'zenoh.connect=["{endpoint}"]'),
        *(
            "--set",
            f"estop.latch_file={port.parent / 'estop'}",
            "--set",
            "log.level=error",
            *more,
        ),
    )


def _yahboomd(*arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "yahboomd", *arguments],
        cwd=TREE,
        stdout=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(TREE)},
    )


def _cpu_s(pid: int) -> float:
    """CPU seconds of the process by the scheduler's count; ticks would miss short runs."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return sum(int((task / "schedstat").read_text().split()[0]) for task in tasks) / 1e9


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _mb(size: float) -> str:
    return f"{size / 1e6:.1f} MB"


def _wait(condition: object) -> None:
    assert callable(condition)
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > deadline:
            raise SystemExit("footprint: the simulated board did not start.")
        time.sleep(0.02)


if __name__ == "__main__":
    sys.exit(main())
