"""Each test that takes ``program`` runs for every language of ``client_programs.py``."""

from __future__ import annotations

import fcntl
import functools
import json
import os
import signal
import subprocess
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
import web_programs
from client_programs import CACHE, PROGRAMS, Built, Command, Missing
from real_robot import Client, Process, RealRobot, free_endpoint, wait_for
from web_gateway import Gateway

PATIENCE_S = 120.0


@functools.cache
def built(name: str) -> Built | str:
    """The commands that start a language's programs, or the name of the missing tool."""
    CACHE.mkdir(parents=True, exist_ok=True)
    with (CACHE / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            return PROGRAMS[name].build()
        except Missing as missing:
            return str(missing)


@dataclass(frozen=True)
class Done:
    """A program that has ended."""

    code: int
    out: str
    err: str


class Running:
    """A program in a process group of its own, so that a signal also reaches its children."""

    def __init__(self, command: Command, environ: dict[str, str], folder: Path) -> None:
        self._out, self._err = folder / "out", folder / "err"
        with self._out.open("w") as out, self._err.open("w") as err:
            self.process = subprocess.Popen(
                command,
                env={**os.environ, **environ},
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                start_new_session=True,
            )

    def send(self, number: int) -> None:
        """A signal to all of it."""
        os.killpg(self.process.pid, number)

    @property
    def running(self) -> bool:
        return self.process.poll() is None

    def done(self) -> Done:
        """Wait until it ends."""
        try:
            self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.close()
            pytest.fail(f"it never ended: {self._texts()}")
        return Done(self.process.returncode, *self._texts())

    def _texts(self) -> tuple[str, str]:
        return self._out.read_text(), self._err.read_text()

    def close(self) -> None:
        if self.running:
            self.send(signal.SIGKILL)
            self.process.wait()


@dataclass(frozen=True)
class ClientProgram:
    """One language's example."""

    name: str
    built: Built
    folder: Path
    started: list[Running]
    gateways: dict[str, Gateway]

    def address(self, robot: str, namespace: str = "") -> str:
        """The endpoint that it is given as ``ROBOT``."""
        scheme, _, path = PROGRAMS[self.name].gateway.partition(":")
        if not scheme:
            return robot
        if robot not in self.gateways:
            self.gateways[robot] = Gateway(
                self.folder, robot, zenohd=web_programs.gateway_program(), namespace=namespace
            )
        return f"{scheme}://127.0.0.1:{self.gateways[robot].port}{path}"

    def start(self, *arguments: str, robot: str = "", namespace: str = "") -> Running:
        """Start it, with ``ROBOT`` and ``NAMESPACE`` as given."""
        return self._start([*self.built.robot, *arguments], robot, namespace)

    def _start(self, command: Command, robot: str, namespace: str = "") -> Running:
        address = self.address(robot, namespace) if robot else free_endpoint()
        environ = {"ROBOT": address, "NAMESPACE": namespace}
        folder = self.folder / f"run{len(self.started)}"
        folder.mkdir()
        self.started.append(Running(command, environ, folder))
        return self.started[-1]

    def run(self, *arguments: str, robot: str = "", namespace: str = "") -> Done:
        """Start it, and wait until it ends."""
        return self.start(*arguments, robot=robot, namespace=namespace).done()

    def run_arc(self, robot: str) -> Done:
        """Run the short program."""
        return self._start(self.built.arc, robot).done()

    def decode(self, message: str, payload: bytes) -> Done:
        """The result of its ``decode`` for a payload."""
        done = subprocess.run(
            [*self.built.robot, "decode", message],
            input=payload,
            capture_output=True,
            timeout=PATIENCE_S,
            check=False,
        )
        return Done(done.returncode, done.stdout.decode(), done.stderr.decode())


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """All languages that can do the commands in the test's mark ``commands``."""
    if "program" not in metafunc.fixturenames:
        return
    needed: Sequence[str] = next(
        (mark.args for mark in metafunc.definition.iter_markers("commands")), ()
    )
    programs = [
        pytest.param(name, marks=pytest.mark.nightly if program.slow else ())
        for name, program in PROGRAMS.items()
        if program.commands.issuperset(needed)
    ]
    metafunc.parametrize("program", programs, indirect=True)


@pytest.fixture
def namespace(request: pytest.FixtureRequest) -> str:
    """The namespace of the test's robot: none, or the test's parameter."""
    return getattr(request, "param", "")


@pytest.fixture
def service(robot: RealRobot, client: Callable[..., Client], namespace: str) -> Iterator[Process]:
    """`yahboomd moves`, once it knows the test's robot."""
    process = Process("moves", "--connect", robot.endpoint, "--set", f"zenoh.namespace={namespace}")
    key = f"{namespace}/yahboomd/moves/start".lstrip("/")
    asking = client("client", robot.endpoint)
    # It refuses what goes nowhere, and before that for the lack of poses.
    nowhere = b'{"moves": [{"kind": "straight", "distance_m": 0.0}]}'

    def knows() -> bool:
        for reply in asking.session.get(key, payload=nowhere, timeout=5.0):
            if reply.ok is not None:
                words = json.loads(bytes(reply.ok.payload))["message"]
                return "No poses" not in words and "No daemon" not in words
        return False

    wait_for(knows, "it has poses")
    yield process
    process.end()


@pytest.fixture
def program(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[ClientProgram]:
    """A language's example, built; skipped with the name of a missing tool."""
    name: str = request.param
    programs = built(name)
    if isinstance(programs, str):
        pytest.skip(f"{name}: {programs}")
    made = ClientProgram(name, programs, tmp_path, [], {})
    yield made
    for each in (*made.started, *made.gateways.values()):
        each.close()
