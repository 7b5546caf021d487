"""Loses the client of a move in mid-drive, with real processes, and judges by the wheels.

``make move-losses``: a simulated board, the daemon, ``yahboomd moves`` and ``yahboomd move``, each
a process. Printed is, for each way to lose them, how often the wheels stood, and how long it took
at worst. A machine that has other work makes it longer.
"""

from __future__ import annotations

import argparse
import math
import shutil
import signal
import struct
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from random import Random

from real_robot import Process, RealRobot, wait_for
from stalled_relay import StalledRelay

from benchmarks import rig
from benchmarks.soak.processes import DAEMON_NICE, prefer

STANDS_M_S = 0.002
WALL_CLOCK = """
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>
static volatile long long *ahead_s;
__attribute__((constructor)) static void open_it(void) {
    int file = open(getenv("CLOCK_AHEAD"), O_RDONLY);
    ahead_s = mmap(0, 8, PROT_READ, MAP_SHARED, file, 0);
}
int clock_gettime(clockid_t id, struct timespec *now) {
    int code = syscall(SYS_clock_gettime, id, now);
    if (id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE) now->tv_sec += *ahead_s;
    return code;
}
int gettimeofday(struct timeval *now, void *zone) {
    struct timespec found;
    clock_gettime(CLOCK_REALTIME, &found);
    now->tv_sec = found.tv_sec, now->tv_usec = found.tv_nsec / 1000;
    return 0;
}
time_t time(time_t *now) {
    struct timespec found;
    clock_gettime(CLOCK_REALTIME, &found);
    if (now) *now = found.tv_sec;
    return found.tv_sec;
}
"""
"""Preloaded, it gives a process a wall clock that can be set. (libfaketime changes timers, too.)"""

STEPPED_S = 2.0
PROCESSES = ("client", "service", "daemon")
MOVES = (("straight", "5"), ("turn", "2000deg"))

IN_A_BLOCK = """
import sys, time
from yahboomd.client import Move, Robot
with Robot(sys.argv[1]) as robot:
    with robot.moves(Move(kind="straight", distance_m=5.0)) as run:
        for progress in run:
            if progress.done > float(sys.argv[2]):
                break
    print("left", flush=True)
    time.sleep(60)
"""


class Losses:
    """One robot, its moves, and the ways to lose them."""

    def __init__(self, folder: Path, seed: int, *, clocks: bool = False) -> None:
        self._folder = folder
        self._clocks = {name: folder / f"clock-{name}" for name in PROCESSES if clocks}
        self.robot = RealRobot(folder, environ=self._environ("daemon"))
        self.robot.daemon.says("Connected")
        self._chance = Random(seed)
        self.again = 0
        self.drove = self.told = False
        self.service = self._serve()

    def _serve(self) -> Process:
        self._set_clock("service", 0)
        service = Process(
            "moves", "--connect", self.robot.endpoint, environ=self._environ("service")
        )
        # As the daemon: a robot has nothing else to do that starves it.
        prefer(service.process, DAEMON_NICE)
        service.says("Moves are served")
        return service

    def _mover(self, endpoint: str) -> Process:
        verb, amount = self._chance.choice(MOVES)
        environ = self._environ("client")
        return Process("move", verb, amount, "--connect", endpoint, environ=environ)

    def _environ(self, name: str) -> dict[str, str]:
        """Gives a process a wall clock that can be set, and leaves it the monotonic one."""
        if not self._clocks:
            return {}
        self._set_clock(name, 0)
        library = self._folder / "wall_clock.so"
        if not library.exists():
            subprocess.run(
                ["cc", "-shared", "-fPIC", "-x", "c", "-", "-o", library],
                input=WALL_CLOCK.encode(),
                check=True,
            )
        return {"LD_PRELOAD": str(library), "CLOCK_AHEAD": str(self._clocks[name])}

    def _set_clock(self, name: str, hours: int) -> None:
        if self._clocks:
            # In place: the process has mapped it.
            self._clocks[name].touch()
            with self._clocks[name].open("r+b") as file:
                file.write(struct.pack("q", 3600 * hours))

    def _driving(self, endpoint: str) -> Process:
        """A client whose move is driven. A busy machine may end one by itself: then another."""
        while True:
            client = self._mover(endpoint)

            def drives(client: Process = client) -> bool:
                samples = self.robot.truth()
                fast = bool(samples) and max(map(abs, samples[-1].speed_m_s)) > 0.05
                return fast or not client.alive

            wait_for(drives, "the robot drives")
            time.sleep(self._chance.uniform(0.1, 1.5))
            if client.alive and max(map(abs, self.robot.truth()[-1].speed_m_s)) > 0.05:
                return client
            client.process.kill()
            client.process.wait()
            self.again += 1

    def _stands_after(self, begun_ns: int) -> float:
        """Seconds from a moment until the wheels stood; they must not turn again for a second."""

        def stood() -> float | None:
            samples = [each for each in self.robot.truth()[-600:] if each.t_ns >= begun_ns]
            if not samples or samples[-1].t_ns < begun_ns + 2_500_000_000:
                return None
            turning = [s.t_ns for s in samples if max(map(abs, s.speed_m_s)) > STANDS_M_S]
            return (turning[-1] - begun_ns) / 1e9 + 0.01 if turning else 0.01

        found: float = wait_for(stood, "2.5 s of the truth")
        return found

    def lose(self, how: Callable[[Process], object], endpoint: str = "") -> float:
        """Have a move driven, lose something, and return when the wheels stood."""
        client = self._driving(endpoint or self.robot.endpoint)
        try:
            begun_ns = time.monotonic_ns()
            how(client)
            return self._stands_after(begun_ns)
        finally:
            client.process.kill()
            client.process.wait()

    def stepped(self, name: str, hours: int) -> float:
        """A wall clock steps; 2 s later the wheels still turn, and the client is killed."""

        def step(client: Process) -> None:
            self._set_clock(name, hours)
            time.sleep(STEPPED_S)
            self.drove = client.alive and max(map(abs, self.robot.truth()[-1].speed_m_s)) > 0.05
            client.process.kill()

        stood_s = self.lose(step)
        for each in PROCESSES:
            self._set_clock(each, 0)
        return max(0.01, stood_s - STEPPED_S) if self.drove else math.inf

    def signalled(self, number: int) -> float:
        """A signal to the client."""
        return self.lose(lambda client: client.process.send_signal(number))

    def service_killed(self) -> float:
        """SIGKILL of ``yahboomd moves``."""

        def kill(_: Process) -> None:
            self.service.process.kill()

        try:
            return self.lose(kill)
        finally:
            self.service.process.wait()
            self.service = self._serve()

    def service_restarted(self) -> float:
        """SIGKILL of ``yahboomd moves``, and another one at once; the client is told."""

        def restart(client: Process) -> None:
            self.service.process.kill()
            self.service.process.wait()
            self.service = self._serve()
            self.told = client.end_by_itself() not in {0, None}

        stood_s = self.lose(restart)
        return stood_s if self.told else math.inf

    def cut(self) -> float:
        """The network of the client carries nothing any more, and says nothing."""
        relay = StalledRelay(self.robot.endpoint)
        try:
            return self.lose(lambda _: relay.stall(), relay.endpoint)
        finally:
            relay.close()

    def left(self) -> float:
        """The client leaves its block, and lives on."""
        share = f"{self._chance.uniform(0.02, 0.1):.3f}"
        client = rig.Process("-c", IN_A_BLOCK, self.robot.endpoint, share)
        try:
            client.says("left")
            return self._stands_after(time.monotonic_ns())
        finally:
            client.process.kill()
            client.process.wait()

    def close(self) -> None:
        """End all."""
        self.service.end()
        self.robot.close()


WAYS: dict[str, Callable[[Losses], float]] = {
    "SIGKILL of the client": lambda losses: losses.signalled(signal.SIGKILL),
    "SIGSTOP of the client": lambda losses: losses.signalled(signal.SIGSTOP),
    "Ctrl-C": lambda losses: losses.signalled(signal.SIGINT),
    "the network carries nothing": Losses.cut,
    "SIGKILL of `yahboomd moves`": Losses.service_killed,
    "`yahboomd moves` killed, and started again at once": Losses.service_restarted,
    "a closed `with`": Losses.left,
}

STEPS: dict[str, Callable[[Losses], float]] = {
    f"the wall clock of the {name} steps by {hours:+} h": partial(
        Losses.stepped, name=name, hours=hours
    )
    for name in PROCESSES
    for hours in (-9, 0, 9)
}


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.move_losses", description=__doc__)
    parser.add_argument("--times", type=int, default=6, help="of each way")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--clocks", action="store_true", help="instead: wall clocks step, and the move drives on"
    )
    args = parser.parse_args()
    # A shell's background jobs ignore it, and every program that they start.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if args.clocks and shutil.which("cc") is None:
        parser.error("--clocks needs a C compiler")
    print("| lost | the wheels stood | at worst after |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        losses = Losses(Path(folder), args.seed, clocks=args.clocks)
        try:
            for name, way in (STEPS if args.clocks else WAYS).items():
                times = [way(losses) for _ in range(args.times)]
                stood = sum(each < 2.0 for each in times)
                print(f"| {name} | {stood} of {len(times)} | {max(times):.2f} s |", flush=True)
            print(f"\n{losses.again} moves more were ended by the busy machine itself.")
        finally:
            losses.close()


if __name__ == "__main__":
    main()
