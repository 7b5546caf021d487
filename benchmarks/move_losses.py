"""Loses the client of a move in mid-drive, with real processes, and judges by the wheels.

``make move-losses``: a simulated board, the daemon, ``yahboomd moves`` and ``yahboomd move``, each
a process. Printed is, for each way to lose them, how often the wheels stood, and how long it took
at worst. A machine that has other work makes it longer.
"""

from __future__ import annotations

import argparse
import signal
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from random import Random

from real_robot import Process, RealRobot, wait_for
from stalled_relay import StalledRelay

from benchmarks import rig
from benchmarks.soak.processes import DAEMON_NICE, prefer

STANDS_M_S = 0.002
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

    def __init__(self, folder: Path, seed: int) -> None:
        self.robot = RealRobot(folder)
        self.robot.daemon.says("Connected")
        self._chance = Random(seed)
        self.again = 0
        self.service = self._serve()

    def _serve(self) -> Process:
        service = Process("moves", "--connect", self.robot.endpoint)
        # As the daemon: a robot has nothing else to do that starves it.
        prefer(service.process, DAEMON_NICE)
        service.says("answers")
        return service

    def _mover(self, endpoint: str) -> Process:
        verb, amount = self._chance.choice(MOVES)
        return Process("move", verb, amount, "--connect", endpoint)

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
    "a closed `with`": Losses.left,
}


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.move_losses", description=__doc__)
    parser.add_argument("--times", type=int, default=6, help="of each way")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    print("| lost | the wheels stood | at worst after |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        losses = Losses(Path(folder), args.seed)
        try:
            for name, way in WAYS.items():
                times = [way(losses) for _ in range(args.times)]
                stood = sum(each < 2.0 for each in times)
                print(f"| {name} | {stood} of {len(times)} | {max(times):.2f} s |", flush=True)
            print(f"\n{losses.again} moves more were ended by the busy machine itself.")
        finally:
            losses.close()


if __name__ == "__main__":
    main()
