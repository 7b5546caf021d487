"""Daemons that are killed right after they acknowledged an emergency stop.

The board is a process of its own and outlives them: its last received frame decides.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from random import Random
from typing import Any

import zenoh
from process_priority import DAEMON_NICE, prefer
from real_robot import PATIENCE_S, wait_for
from simulated_board import SimulatedBoard
from truth_tail import Truth, Wire, is_stop
from zenoh_fixtures import free_endpoint

WAYS = ("the answer to a query", "the state", "the event")
"""The ways to learn that the robot stops."""

KILLED_WITHIN_S = 0.004

WATCHED_NS = 10_000_000_000

SPACING_NS = 9_000_000
"""The daemon keeps 10 ms. Frames that are closer waited for the board's process, which a busy
machine held up, and the board loses one of them."""


class KillableRobot:
    """A board, and daemons that drive it until they are killed.

    Args:
        folder: For all their files.
        dialect: The board's.
        seed: Of the moments.

    Attributes:
        found: How often it was learned in each way.
    """

    def __init__(self, folder: Path, dialect: str, seed: int) -> None:
        heard = folder / "heard"
        self._board = SimulatedBoard(
            folder,
            *("--dialect", dialect, "--heard", str(heard)),
            *("--start-up", "0.3", "--seed", str(seed)),
        )
        self._wire, self._truth = Wire(heard), Truth(self._board.truth_path)
        self._random = Random(seed)
        self._latch = folder / "estop"
        ours = free_endpoint()
        config = zenoh.Config()
        config.insert_json5("mode", '"peer"')
        config.insert_json5("listen/endpoints", json.dumps([ours]))
        config.insert_json5("scouting/multicast/enabled", "false")
        self._session = zenoh.open(config)
        self._states: list[str] = []
        self._shown = {way: threading.Event() for way in WAYS}
        self._session.declare_subscriber("yahboomd/*", self._hear)
        settings = {
            "serial.port": self._board.port,
            "zenoh.listen": [free_endpoint()],
            "zenoh.connect": [ours],
            "estop.latch_file": str(self._latch),
        }
        program = Path(__file__).with_name("killable_daemons_process.py")
        self._log = (folder / "log").open("w")
        self._forking = subprocess.Popen(
            [sys.executable, str(program), *(f"{k}={_toml(v)}" for k, v in settings.items())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            env={**os.environ, "RUNTIME_DIRECTORY": str(folder)},
        )
        prefer(self._forking, DAEMON_NICE)
        self.found: Counter[str] = Counter()

    def _hear(self, sample: zenoh.Sample) -> None:
        name = str(sample.key_expr).rsplit("/", 1)[-1]
        if name == "status":
            self._states.append(json.loads(bytes(sample.payload))["state"])
            if self._states[-1] == "estopped":
                self._shown["the state"].set()
        elif name == "events" and json.loads(bytes(sample.payload))["kind"] == "estop":
            self._shown["the event"].set()

    def kill_one(self) -> str | None:
        """Start a daemon, drive, stop, and kill it once it acknowledged; the problem, if any."""
        random, way = self._random, self._random.choice(WAYS)
        self._latch.unlink(missing_ok=True)
        self._states.clear()
        assert self._forking.stdin is not None
        assert self._forking.stdout is not None
        self._forking.stdin.write("start\n")
        self._forking.stdin.flush()
        pid = int(self._forking.stdout.readline())
        try:
            wait_for(lambda: "standing" in self._states[-1:], "the daemon may drive")
            begun_ns = time.monotonic_ns()
            wait_for(lambda: self._drives(begun_ns), "the wheels are commanded to turn")
            for _ in range(random.randrange(6)):
                self._command()
                time.sleep(random.uniform(0.0, 0.03))
            for event in self._shown.values():
                event.clear()
            self._stop(way)
            time.sleep(random.choice((0.0, random.uniform(0.0, KILLED_WITHIN_S))))
        finally:
            os.kill(pid, signal.SIGKILL)
        killed_ns = time.monotonic_ns()
        self.found[way] += 1
        wait_for(lambda: not _runs(pid), "the kernel has ended it")
        # By then the board has received all bytes of the port.
        while self._truth.stood_at(killed_ns) is None:
            self._wire.look()
            before, last = list(self._wire.orders)[-2:]
            late = time.monotonic_ns() - killed_ns > WATCHED_NS
            if late and not is_stop(last):
                return f"{way}: the board heard {last} last"
            if late and not is_stop(before) and last.t_ns - before.t_ns < SPACING_NS:
                self.found["lost by a board that was held up"] += 1
                return None
            if late:
                return f"{way}: the board heard {before} and {last}, and the wheels turn"
            time.sleep(0.01)
        self._wire.look()
        return None if is_stop(self._wire.orders[-1]) else f"{way}: the wheels stand by themselves"

    def _drives(self, since_ns: int) -> bool:
        self._command()
        time.sleep(0.02)
        turning = self._wire.first(since_ns, lambda order: not is_stop(order))
        return turning is not None

    def _command(self) -> None:
        # Another one each time: each is a frame, and the line is busy.
        vx = 0.3 + self._random.randrange(50) / 1000
        self._session.put("cmd_vel", json.dumps({"vx": vx}))

    def _stop(self, way: str) -> None:
        """Press, and wait for the acknowledgement."""
        if way == "the answer to a query":
            (reply,) = self._session.get("yahboomd/estop", timeout=PATIENCE_S)
            assert reply.ok is not None
            answer: dict[str, Any] = json.loads(bytes(reply.ok.payload))
            assert answer["success"], answer
        else:
            self._session.put(
                "yahboomd/estop", b"", congestion_control=zenoh.CongestionControl.BLOCK
            )
            assert self._shown[way].wait(PATIENCE_S), way

    def close(self) -> None:
        """End everything."""
        assert self._forking.stdin is not None
        with contextlib.suppress(OSError):
            self._forking.stdin.close()
        self._forking.wait()
        assert self._forking.stdout is not None
        self._forking.stdout.close()
        self._log.close()
        self._session.close()
        self._wire.close()
        self._truth.close()
        self._board.close()


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def _toml(value: object) -> str:
    return json.dumps(value) if isinstance(value, list) else str(value)
