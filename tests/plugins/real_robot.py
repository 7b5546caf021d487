"""A simulated board and the daemon, each a real process on a real pty, with their output.

Each process is ended by its handle.
"""

from __future__ import annotations

import json
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import zenoh
from event_check import assert_registered
from left_guards import end_guards
from process_priority import BOARD_NICE, DAEMON_NICE, prefer
from truth_tail import Tail
from zenoh_fixtures import free_endpoint

from benchmarks import rig
from yahboomd.core.standstill import STANDING_M_S
from yahboomd.simulation.truth import TruthSample

PATIENCE_S = 60.0

DRIVER = """
import sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["' + sys.argv[1] + '"]')
while True:
    try:
        session = zenoh.open(config)
        break
    except zenoh.ZError:
        time.sleep(0.02)
print("driving", flush=True)
while True:
    session.put(sys.argv[2], b'{"vx": 0.4}')
    time.sleep(0.02)
"""
"""A program of Python's that drives for as long as it lives: ENDPOINT KEY."""


def wait_for(condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> Any:
    """Wait until ``condition`` returns something true, and return that."""
    deadline = time.monotonic() + patience_s
    while not (result := condition()):
        if time.monotonic() > deadline:
            pytest.fail(f"never came true: {what}")
        time.sleep(0.01)
    return result


class Process(rig.Process):
    """A command of ours; its output is kept."""

    def __init__(self, *arguments: str, environ: dict[str, str] | None = None) -> None:
        super().__init__("-m", "yahboomd", *arguments, environ=environ)

    @property
    def output(self) -> str:
        return "\n".join(self.lines)

    def end(self, number: int = signal.SIGTERM) -> int:
        """Ask it to end; returns its status."""
        if self.alive:
            self.process.send_signal(number)
        return self.end_by_itself()


class RealRobot:
    """A board and a daemon that drives it.

    Args:
        folder: For the port's name, the truth, the control socket and the e-stop's file.
        simulate: More arguments of ``yahboomd simulate``.
        run: More arguments of ``yahboomd run``.
        port: The port at which the daemon expects the board, if it is another one.
        environ: More of the daemon's environment.
        guarded: Start the daemon's guard, too. A busy machine may starve a daemon for two seconds,
            which its guard takes for a freeze.
    """

    def __init__(
        self,
        folder: Path,
        *,
        simulate: Sequence[str] = (),
        run: Sequence[str] = (),
        port: str | None = None,
        environ: dict[str, str] | None = None,
        guarded: bool = False,
    ) -> None:
        self.folder = folder
        self.port = folder / "board"
        self.truth_path = folder / "truth"
        self.control_path = folder / "control"
        self.endpoint = free_endpoint()
        self._daemon_port = port or str(self.port)
        self._run_arguments = (*run, *(() if guarded else ("--no-guard",)))
        self._daemons: list[Process] = []
        self.environ: dict[str, str] = environ or {}
        self._tail = Tail(self.truth_path, TruthSample)
        self._truth: list[TruthSample] = []
        self._reading = threading.Lock()
        self.simulation = Process(
            "simulate",
            *("--link", str(self.port), "--truth", str(self.truth_path)),
            *("--control", str(self.control_path), *simulate),
        )
        # A real board shares no processor with what keeps this machine busy.
        prefer(self.simulation.process, BOARD_NICE)
        self.simulation.says("is at")
        self.daemon = self.start_daemon()

    def start_daemon(self) -> Process:
        """Start (another) daemon on the port."""
        self.daemon = Process(
            "run",
            *("--port", self._daemon_port),
            *("--set", f'zenoh.listen=["{self.endpoint}"]', "--set", "zenoh.connect=[]"),
            *("--set", f"estop.latch_file={self.folder / 'estop'}", *self._run_arguments),
            environ=self.environ,
        )
        # As the service runs.
        prefer(self.daemon.process, DAEMON_NICE)
        self._daemons.append(self.daemon)
        return self.daemon

    def do(self, command: str) -> str:
        """A command to the simulation, such as ``reset`` or ``unplug 2``; its answer."""
        with socket.socket(socket.AF_UNIX) as control:
            control.connect(str(self.control_path))
            control.sendall(f"{command}\n".encode())
            return control.makefile().readline().strip()

    def truth(self) -> list[TruthSample]:
        """The true path of the robot."""
        with self._reading:
            self._truth += self._tail.news()
            return list(self._truth)

    def travelled_m(self) -> float:
        """The travel of its wheels, added up."""
        return sum(self.truth()[-1].travel_m)

    def stands(self) -> bool:
        """Whether the wheels have stood for the last 30 samples.

        A wheel that the board brings to rest passes the limit more than once.
        """
        last = self.truth()[-30:]
        return max(max(map(abs, each.speed_m_s)) for each in last) < STANDING_M_S

    def settled_truth(self) -> TruthSample:
        """The true place of the robot, once it stands."""
        asked_ns = time.monotonic_ns()

        def standing() -> TruthSample | None:
            samples = self.truth()[-30:]
            # The file is written with a delay: of a busy machine it may end before the motion.
            if len(samples) < 30 or samples[-1].t_ns < asked_ns:
                return None
            stands = all(max(map(abs, sample.speed_m_s)) < 0.002 for sample in samples)
            return samples[-1] if stands else None

        found: TruthSample = wait_for(standing, "the robot stands")
        return found

    def close(self) -> None:
        """End both."""
        try:
            for daemon in self._daemons:
                daemon.end()
                # pytest shows it if the test failed.
                print(daemon.output)
        finally:
            self.simulation.end()
            self._tail.close()


class Client:
    """An application that speaks Zenoh and knows nothing of yahboomd."""

    def __init__(self, mode: str, endpoint: str, prefix: str = "yahboomd") -> None:
        config = zenoh.Config()
        config.insert_json5("mode", json.dumps(mode))
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("listen/endpoints", "[]")
        config.insert_json5("scouting/multicast/enabled", "false")
        # The daemon may be about to start; a client does not wait for it by itself.
        self.session: zenoh.Session = wait_for(lambda: _opened(config), f"{endpoint} is served")
        self.samples: dict[str, list[dict[str, Any]]] = {}
        self._passed = 0
        self.session.declare_subscriber(f"{prefix}/**", self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        name = str(sample.key_expr).rsplit("/", 1)[-1]
        self.samples.setdefault(name, []).append(json.loads(bytes(sample.payload)))

    def latest(self, name: str) -> dict[str, Any]:
        """The newest sample of a kind."""
        wait_for(lambda: self.samples.get(name), f"a sample of {name}")
        return self.samples[name][-1]

    def pose_at(self, truth: TruthSample) -> dict[str, Any]:
        """A pose that was sampled at a moment of the truth, or later."""
        stamp_ns = truth.t_ns + time.time_ns() - time.monotonic_ns()
        wait_for(lambda: self.latest("pose")["stamp_ns"] >= stamp_ns, "a pose of that moment")
        return self.latest("pose")

    def in_state(self, state: str) -> dict[str, Any]:
        """Wait for a state; the status that tells it."""

        def found() -> dict[str, Any] | None:
            statuses = self.samples.get("status")
            return statuses[-1] if statuses and statuses[-1]["state"] == state else None

        status: dict[str, Any] = wait_for(found, f"state {state}")
        self._passed = len(self.samples["status"])
        return status

    def passes(self, state: str) -> dict[str, Any]:
        """Wait until it is, or was, in a state since the last one that was waited for.

        A state that ends by itself may be over before a busy machine looks.
        """

        def found() -> int | None:
            statuses = self.samples.get("status", [])
            which = range(self._passed, len(statuses))
            return next((n + 1 for n in which if statuses[n]["state"] == state), None)

        self._passed = wait_for(found, f"state {state}")
        return self.samples["status"][self._passed - 1]

    def drive(self, payload: bytes, for_s: float, key: str = "cmd_vel") -> None:
        """Send one command 20 times a second."""
        for _ in range(round(for_s / 0.05)):
            self.session.put(key, payload)
            time.sleep(0.05)

    def drive_until(
        self, payload: bytes, condition: Callable[[], Any], what: str, key: str = "cmd_vel"
    ) -> None:
        """Send one command about 20 times a second until something is true."""

        def found() -> bool:
            self.session.put(key, payload)
            time.sleep(0.04)
            return bool(condition())

        wait_for(found, what)

    def ask(self, key: str, payload: bytes | None = None) -> dict[str, Any]:
        """Ask a service."""
        for reply in self.session.get(key, payload=payload, timeout=PATIENCE_S):
            assert reply.ok is not None
            answer: dict[str, Any] = json.loads(bytes(reply.ok.payload))
            return answer
        pytest.fail(f"{key} did not answer")

    def close(self) -> None:
        """End the session; all events that came fit their registry."""
        self.session.close()
        # pytest shows it if the test failed.
        for status in self.samples.get("status", ())[-1:]:
            print("The last status:", status["state"], status["why"])
        for event in self.samples.get("events", ()):
            assert_registered(event)


def _opened(config: zenoh.Config) -> zenoh.Session | None:
    try:
        return zenoh.open(config)
    except zenoh.ZError:
        return None


@pytest.fixture
def real_robot(tmp_path: Path) -> Iterator[Callable[..., RealRobot]]:
    """Makes robots: ``real_robot(simulate=[...], run=[...])``."""
    robots: list[RealRobot] = []

    def make(**arguments: Any) -> RealRobot:
        folder = tmp_path / f"robot{len(robots)}"
        folder.mkdir()
        robots.append(RealRobot(folder, **arguments))
        return robots[-1]

    yield make
    end_guards()
    for robot in robots:
        robot.close()


@pytest.fixture
def client() -> Iterator[Callable[..., Client]]:
    """Makes applications: ``client(mode, endpoint)``."""
    clients: list[Client] = []

    def make(mode: str, endpoint: str, prefix: str = "yahboomd") -> Client:
        clients.append(Client(mode, endpoint, prefix))
        return clients[-1]

    yield make
    for each in clients:
        each.close()
