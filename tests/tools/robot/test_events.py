"""`yahboomd events` of a real daemon."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator

import daemon_samples
import pytest
from real_robot import RealRobot, wait_for

from yahboomd.cli.events import line

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("one_robot")]


class Reader:
    """The command in a process, and its printed lines."""

    def __init__(self, robot: RealRobot, *arguments: str) -> None:
        self.lines: list[str] = []
        self.process = subprocess.Popen(
            [sys.executable, "-m", "yahboomd", "events", "--connect", robot.endpoint, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        self.lines.extend(each for each in self.process.stdout)

    def end(self) -> tuple[int, str]:
        assert self.process.stderr is not None
        complaint = self.process.stderr.read()
        status = self.process.wait(60)
        return status, complaint

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._thread.join()
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()


@pytest.fixture
def events(one_robot: RealRobot) -> Iterator[Callable[..., Reader]]:
    readers: list[Reader] = []

    def start(*arguments: str) -> Reader:
        readers.append(Reader(one_robot, *arguments))
        return readers[-1]

    yield start
    for each in readers:
        each.close()


def until_printed(on_robot: Callable[..., int], reader: Reader, count: int, kind: str) -> None:
    """Cause events until the reader, which may not listen yet, has printed some."""

    def printed() -> bool:
        on_robot("pose", "--reset")
        # On a busy machine there may be others, too.
        return sum(kind in each for each in reader.lines) >= count

    wait_for(printed, f"{count} events")


def test_every_event_is_a_line_that_is_written_at_once(
    events: Callable[..., Reader], on_robot: Callable[..., int]
) -> None:
    reader = events("--follow")
    until_printed(on_robot, reader, 2, " info pose_set: ")
    pattern = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d{4} [a-z]+ [a-z_]+: .+\n"
    assert all(re.fullmatch(pattern, each) for each in reader.lines), reader.lines
    reader.process.send_signal(signal.SIGINT)
    assert reader.end() == (130, "")


def test_a_line_has_no_control_characters() -> None:
    assert "\x1b" not in line(daemon_samples.event("a\x1b[2Jb"))
