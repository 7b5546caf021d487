"""Daemon and simulated board as processes, through faults in a seeded order: ``make soak``.

    python -m benchmarks.soak --minutes 2 --seed 1

An application drives. After each fault the truth of the simulated robot shows whether the wheels
stood in time and whether the robot drives again, and between two stands the pose is compared with
the true one. What a stall of this machine may have caused is counted apart. Each board takes its
share of the time; the daemon runs with its guard.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import random
import signal
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from real_robot import RealRobot
from truth_tail import Truth

from benchmarks import rig
from yahboomd.simulation.truth import TruthSample

DIALECTS = ("streamed", "polled", "rosmaster")
INITIAL_TICKS = "3000000,0,3000000,0"
"""A board that has run for a while: 480 m on each wheel."""

BRAKE_S = 0.8
"""From a stop's frame to standing wheels, at these speeds and with a margin."""

LAPSE_S = 0.5 + 0.25 + BRAKE_S
"""From the last command: its timeout, the ramp, the brakes."""

RECOVER_S = 25.0
STALL_S = 0.003
EXCUSE_S = 0.1
"""A machine that stands still for this time is no real-time machine."""

MOST_M = MOST_RAD = 0.03
"""The largest error of a way between two stands."""

RSS_GROWTH_MB = 30.0
FLOOD = """
import os, sys
from benchmarks.rig import client
bus = client(sys.argv[1])
print("ready", flush=True)
while True:
    bus.put("cmd_vel", os.urandom(200))
"""


class Stalls:
    """Times for which the machine did not run this process in time."""

    def __init__(self) -> None:
        self.found: list[tuple[int, float]] = []
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        while True:
            before = time.monotonic_ns()
            time.sleep(0.002)
            late_s = (time.monotonic_ns() - before) / 1e9 - 0.002
            if late_s > STALL_S:
                self.found.append((before, late_s))

    def since_s(self, since_ns: int) -> float:
        """The time that it stood still in all since a moment."""
        return sum(late_s for at_ns, late_s in self.found if at_ns + late_s * 1e9 > since_ns)


class Application:
    """Drives, and hears the daemon."""

    def __init__(self, endpoint: str) -> None:
        self.session = rig.client(endpoint)
        self.status: tuple[float, dict[str, Any]] = (0.0, {})
        self.pose: dict[str, Any] = {}
        self.poses = 0
        self.unknown = 0
        self._twist: tuple[float, float] | None = None
        self._last_ns = 0
        self._lock = threading.Lock()
        self._ending = threading.Event()
        for name in ("pose", "status", "events"):
            self.session.declare_subscriber(f"yahboomd/{name}", self._hear)
        self._driver = threading.Thread(target=self._drive)
        self._driver.start()

    def _hear(self, sample: Any) -> None:  # noqa: ANN401 - Zenoh's
        name, heard = str(sample.key_expr).rpartition("/")[2], json.loads(bytes(sample.payload))
        if name == "pose":
            self.pose = heard
            self.poses += 1
        elif name == "status":
            self.status = (time.monotonic(), heard)
        elif heard["kind"] == "odometry_discontinuity":
            self.unknown += 1

    @property
    def state(self) -> str:
        """The daemon's state; empty if it is old."""
        at, status = self.status
        return str(status["state"]) if time.monotonic() - at < 1.5 else ""

    def drive(self, vx: float, wz: float = 0.0) -> None:
        """Command this velocity from now on."""
        with self._lock:
            self._twist = (vx, wz)

    def silent(self) -> int:
        """Command nothing more; returns when the last command was sent."""
        with self._lock:
            self._twist = None
            return self._last_ns

    def _drive(self) -> None:
        while not self._ending.wait(0.05):
            with self._lock:
                if self._twist is not None:
                    vx, wz = self._twist
                    self._last_ns = time.monotonic_ns()
                    self.session.put("cmd_vel", json.dumps({"vx": vx, "wz": wz}))

    def close(self) -> None:
        """End it."""
        self._ending.set()
        self._driver.join()
        self.session.close()


class Ledger:
    """All findings of a run."""

    def __init__(self) -> None:
        self.stood_s: dict[str, list[float]] = {}
        self.again: list[float] = []
        self.errors: list[tuple[float, float]] = []
        self.apart = 0
        self.samples = 0
        self.grown_mb = 0.0
        self.failures: list[str] = []
        self.excused: list[str] = []

    def table(self) -> str:
        """The table, and the figures below it."""
        lines = [
            "| fault | times | until the wheels stand, s: median | longest |",
            "|---|---|---|---|",
        ]
        for kind, took in sorted(self.stood_s.items()):
            lines.append(
                f"| {kind} | {len(took)} | {statistics.median(took):.2f} | {max(took):.2f} |"
            )
        lines.append("")
        if self.again:
            middle, most = statistics.median(self.again), max(self.again)
            lines.append(
                f"Drove again {len(self.again)} times, after {middle:.1f} s, {most:.1f} s at worst."
            )
        if self.errors:
            metres, radians = (max(each) for each in zip(*self.errors, strict=True))
            middle = statistics.median(each[0] for each in self.errors)
            lines.append(
                f"Pose against the truth, {len(self.errors)} ways: {1e3 * middle:.2f} mm at the "
                f"median, {1e3 * metres:.2f} mm and {math.degrees(radians):.2f}° at worst; "
                f"{self.apart} ways not compared. {self.samples} poses."
            )
        lines.append(f"Memory grew by {self.grown_mb:.1f} MB at most.")
        lines += [f"While the machine stood still: {words}" for words in self.excused]
        lines += [f"FAILED {words}" for words in self.failures]
        lines.append("verdict: see above" if self.failures else "verdict: all held")
        return "\n".join(lines)


class Soak:
    """One board, its daemon and the application."""

    def __init__(self, folder: Path, dialect: str, seed: int, ledger: Ledger) -> None:
        self.chance = random.Random(f"{dialect} {seed}")
        self.ledger = ledger
        self.dialect = dialect
        self.kind = "start"
        self.stalls = Stalls()
        places = {f"{name}_DIRECTORY": folder / name.lower() for name in ("STATE", "RUNTIME")}
        for place in places.values():
            place.mkdir(mode=0o700)
        self.robot = RealRobot(
            folder,
            simulate=("--dialect", dialect, "--seed", str(seed), "--ticks", INITIAL_TICKS)
            # A real Rosmaster board takes ten seconds.
            + (("--start-up", "0.3") if dialect == "rosmaster" else ()),
            environ={name: str(place) for name, place in places.items()},
            guarded=True,
        )
        self.truth = Truth(self.robot.truth_path)
        self.app = Application(self.robot.endpoint)
        self._since_ns = time.monotonic_ns()
        self._anchor: tuple[dict[str, Any], TruthSample] | None = None
        self._unknown = 0

    def close(self) -> None:
        """End all of it."""
        self.ledger.samples += self.app.poses
        self.app.close()
        with contextlib.redirect_stdout(None):
            self.robot.close()
        self.truth.close()
        if tracebacks := sum("Traceback" in each.output for each in self.robot._daemons):
            self.ledger.failures.append(f"{self.dialect}: {tracebacks} daemons had a traceback")

    def fail(self, words: str) -> None:
        """A failure, unless the machine stood still."""
        stalled_s = self.stalls.since_s(self._since_ns)
        words = f"{self.dialect}, {self.kind}: {words} [{self.app.status[1].get('why', '')}]"
        excused = stalled_s > EXCUSE_S
        (self.ledger.excused if excused else self.ledger.failures).append(words)
        print(words, f"({stalled_s:.2f} s stood still)", flush=True)

    def wait(self, condition: Callable[[], object], within_s: float) -> bool:
        """Whether a condition came true in time."""
        deadline = time.monotonic() + within_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            time.sleep(0.01)
        return True

    def move(self, vx: float = 0.35, wz: float = 0.3) -> None:
        """Make the wheels turn steadily."""
        self.app.drive(vx, wz)
        began_ns = time.monotonic_ns()
        if not self.wait(lambda: self.truth.travelled_m(began_ns) > 0.02, RECOVER_S):
            self.fail("it does not drive")
        time.sleep(self.chance.uniform(0.5, 1.2))

    def stands(self, since_ns: int, within_s: float) -> None:
        """The wheels come to stand in time."""
        found: list[int] = []

        def stood() -> bool:
            at_ns = self.truth.stood_at(since_ns)
            found.extend([] if at_ns is None else [at_ns])
            return at_ns is not None

        # The truth arrives in batches of 0.2 s.
        self.wait(stood, within_s + 1.0)
        took_s = (found[0] - since_ns) / 1e9 if found else math.inf
        self.ledger.stood_s.setdefault(self.kind, []).append(took_s)
        if took_s > within_s:
            self.fail(f"the wheels stand after {took_s:.2f} s, not {within_s:.2f}")

    def ready(self) -> None:
        """Wait until it may drive; release latches as a person would."""
        self.app.drive(0.0)
        deadline = time.monotonic() + RECOVER_S
        while self.app.state not in {"standing", "driving", "stopping"}:
            if time.monotonic() > deadline:
                self.fail("it is not ready again")
                return
            if self.app.state in {"estopped", "fault"}:
                self.app.silent()
                time.sleep(1.1)
                list(self.app.session.get("yahboomd/estop/reset", timeout=3.0))
                self.app.drive(0.0)
                time.sleep(0.6)
            time.sleep(0.01)

    def drives_again(self) -> None:
        """It moves as commanded, if need be after another release."""
        began_ns = time.monotonic_ns()
        for _ in range(2):
            self.ready()
            self.app.drive(self.chance.uniform(0.2, 0.4), self.chance.uniform(-0.8, 0.8))
            now_ns = time.monotonic_ns()
            if self.wait(
                lambda since_ns=now_ns: (
                    self.truth.travelled_m(since_ns) > 0.05
                    or self.app.state in {"estopped", "fault"}
                ),
                RECOVER_S,
            ) and self.app.state not in {"estopped", "fault"}:
                self.ledger.again.append((time.monotonic_ns() - began_ns) / 1e9)
                return
        self.fail("it does not drive again")

    def compare(self, *, known: bool) -> None:
        """Stand, and compare the way since the last stand with the true one, if it is known."""
        self.app.drive(0.0)
        began_ns = time.monotonic_ns()
        if not self.wait(lambda: self.truth.stood_at(began_ns), 5.0):
            self.fail("it does not stand when commanded to")
        time.sleep(0.3)
        now_ns, wall_ns = time.monotonic_ns(), time.time_ns()
        if not self.wait(
            lambda: self.app.pose.get("stamp_ns", 0) >= wall_ns and self.truth.since(now_ns), 5.0
        ):
            self.fail("no pose while it stands")
            self._anchor = None
            return
        before, self._anchor = self._anchor, (self.app.pose, self.truth.since(now_ns)[0])
        unknown, self._unknown = self._unknown, self.app.unknown
        if before is None or not known or unknown != self._unknown:
            self.ledger.apart += before is not None
            return
        posed = way(_place(before[0]), _place(self._anchor[0]))
        true = way(*((each.x, each.y, each.theta) for each in (before[1], self._anchor[1])))
        metres, radians = math.dist(posed[:2], true[:2]), abs(posed[2] - true[2])
        self.ledger.errors.append((metres, radians))
        if metres > MOST_M or radians > MOST_RAD:
            self.fail(f"the pose is {1e3 * metres:.1f} mm and {radians:.4f} rad off the truth")

    def do(self, command: str) -> int:
        """Have the board do something; returns when."""
        now_ns = time.monotonic_ns()
        if not (answer := self.robot.do(command)).startswith("ok"):
            raise RuntimeError(f"the simulated board says to {command!r}: {answer!r}")
        return now_ns

    def end_daemon(self, number: int, within_s: float) -> None:
        """Send the daemon a signal that ends it; its guard stops the wheels."""
        since_ns = time.monotonic_ns()
        self.robot.daemon.process.send_signal(number)
        self.stands(since_ns, within_s)
        if not self.wait(lambda: not self.robot.daemon.alive, 10.0):
            self.fail("the daemon has not ended")
            self.robot.daemon.process.kill()
        self.robot.start_daemon()

    def run(self, for_s: float, kinds: list[str]) -> None:
        """Fault after fault until the time is over."""
        end = time.monotonic() + for_s
        self.drives_again()
        self.compare(known=False)
        first_mb, daemon = rig.usage(self.robot.daemon.pid).rss_mb, self.robot.daemon
        for kind in self._order(kinds):
            self.kind = kind
            self._since_ns = began_ns = time.monotonic_ns()
            self.move()
            FAULTS[self.kind](self)
            if not self.robot.daemon.alive:
                self.fail(f"the daemon ended: {self.robot.daemon.lines[-1:]}")
                self.robot.start_daemon()
            self.drives_again()
            self.compare(known=self.kind not in UNKNOWN)
            if self.robot.daemon is daemon:
                grown_mb = rig.usage(daemon.pid).rss_mb - first_mb
                self.ledger.grown_mb = max(self.ledger.grown_mb, grown_mb)
                if grown_mb > RSS_GROWTH_MB:
                    self.fail(f"memory grew by {grown_mb:.0f} MB")
            else:
                first_mb, daemon = rig.usage(self.robot.daemon.pid).rss_mb, self.robot.daemon
            took_s = (time.monotonic_ns() - began_ns) / 1e9
            print(f"{self.dialect:<10} {self.kind:<16} {took_s:5.1f} s", flush=True)
            if time.monotonic() > end:
                return

    def _order(self, kinds: list[str]) -> Iterator[str]:
        while True:
            yield from self.chance.sample(kinds, len(kinds))


def way(then: tuple[float, ...], now: tuple[float, ...]) -> tuple[float, float, float]:
    """The way from one place to another, seen from the first."""
    dx, dy = now[0] - then[0], now[1] - then[1]
    cos, sin = math.cos(then[2]), math.sin(then[2])
    return cos * dx + sin * dy, cos * dy - sin * dx, now[2] - then[2]


def _place(pose: dict[str, Any]) -> tuple[float, float, float]:
    return pose["x"], pose["y"], pose["theta"]


def silence(soak: Soak) -> None:
    """The application falls silent."""
    soak.stands(soak.app.silent(), LAPSE_S)


def estop(soak: Soak) -> None:
    """A person presses the emergency stop, and the application drives on."""
    since_ns = time.monotonic_ns()
    soak.app.session.put("yahboomd/estop", b"")
    soak.stands(since_ns, BRAKE_S)
    if not soak.wait(lambda: soak.app.state == "estopped", 3.0):
        soak.fail("the status does not tell of the e-stop")


def flood(soak: Soak) -> None:
    """The same in a flood of garbage."""
    with rig.Process("-c", FLOOD, soak.robot.endpoint) as flooding:
        flooding.says("ready")
        time.sleep(1.0)
        estop(soak)


def unplug(soak: Soak) -> None:
    """The cable is out for a while: the wheels turn on, and are stopped once it is back."""
    for_s = soak.chance.uniform(0.3, 3.0)
    since_ns = soak.do(f"unplug {for_s:.3f}")
    soak.app.silent()
    soak.stands(since_ns + round(for_s * 1e9), 3.0)


def mute(soak: Soak) -> None:
    """Nothing is heard of the board for a while."""
    soak.stands(soak.do("mute 2.5"), 2.0)
    time.sleep(1.0)


def lose_bytes(soak: Soak) -> None:
    """Up to one byte in five is lost, in both directions."""
    soak.do(f"loss {soak.chance.choice([0.01, 0.05, 0.2])}")
    time.sleep(soak.chance.uniform(1.0, 3.0))
    soak.stands(soak.app.silent(), LAPSE_S + 2.0)
    soak.do("clear")
    # A wheel is not blamed for what a noisy line made it do, for 10 s.
    time.sleep(10.5)


def cut(fault: str) -> Callable[[Soak], None]:
    """A wheel that does not do what its counts say, or does not turn, is cut."""

    def happens(soak: Soak) -> None:
        wheel = soak.chance.choice(["left", "right"])
        soak.move(soak.chance.choice([-0.35, 0.35]), 0.0)
        soak.stands(soak.do(f"{fault} {wheel}"), 1.6)

        def named() -> bool:
            # Where the drive had paused, the wheel did not begin to turn, which is no fault yet.
            why = soak.app.status[1].get("why", "")
            return soak.app.state == "fault" or "does not begin to turn" in why

        if not soak.wait(named, 3.0):
            soak.fail("the status does not name the wheel")
        soak.do(f"repair {wheel}")

    return happens


FAULTS: dict[str, Callable[[Soak], None]] = {
    "command silence": silence,
    "e-stop": estop,
    "flood": flood,
    "unplug": unplug,
    "mute": mute,
    "reset": lambda soak: soak.stands(soak.do("reset"), 1.0),
    "SIGKILL": lambda soak: soak.end_daemon(signal.SIGKILL, 1.0 + BRAKE_S),
    # The guard waits for the promise to lapse, and kills it five seconds later.
    "SIGSTOP": lambda soak: soak.end_daemon(signal.SIGSTOP, 2.0 + BRAKE_S),
    "byte loss": lose_bytes,
    "wheel stalled": cut("stalled"),
    "encoder dead": cut("encoder-dead"),
}
UNKNOWN = frozenset({"reset", "SIGKILL", "SIGSTOP", "encoder dead"})
"""The pose begins again, or its counts lie."""


def main(arguments: list[str]) -> int:
    """Returns 1 if something did not hold."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak")
    parser.add_argument("--minutes", type=float, default=2.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", default=",".join(FAULTS), help="only these, with commas between")
    parser.add_argument("--dialects", nargs="+", choices=DIALECTS, default=DIALECTS)
    args = parser.parse_args(arguments)
    if unknown := set(args.kinds.split(",")) - set(FAULTS):
        parser.error(f"no fault is called {', '.join(unknown)}; there are {', '.join(FAULTS)}")
    ledger = Ledger()
    for dialect in args.dialects:
        with tempfile.TemporaryDirectory(prefix="yahboomd-soak-") as folder:
            soak = Soak(Path(folder), dialect, args.seed, ledger)
            with contextlib.closing(soak), contextlib.suppress(KeyboardInterrupt):
                soak.run(60.0 * args.minutes / len(args.dialects), args.kinds.split(","))
    print(f"\n{args.minutes:g} minutes (`SEED={args.seed}`), load {os.getloadavg()[0]:.1f}\n")
    print(ledger.table())
    return 1 if ledger.failures else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
