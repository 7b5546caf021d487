"""`yahboomd calibrate --dialogue json` in a process of its own, led as a program leads it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from real_robot import wait_for

HOLD_EVERY_S = 0.05

MOVEMENTS = ("hold", "start")
"""The kinds of questions that let the robot move."""

Begin = TypeVar("Begin")


class LedCalibration:
    """The command, its lines, and the button that is held.

    Args:
        endpoint: Of the daemon.
        state: The state directory.
        arguments: Of the command, after ``calibrate``.
    """

    def __init__(self, endpoint: str, state: Path, *arguments: str) -> None:
        self.lines: list[dict[str, Any]] = []
        self.process = subprocess.Popen(
            self.command(endpoint, arguments),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "STATE_DIRECTORY": str(state)},
            bufsize=0,
        )
        self._seen = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._held = ""
        self._holding = threading.Thread(target=self._hold, daemon=True)
        self._holding.start()

    @staticmethod
    def command(endpoint: str, arguments: Sequence[str]) -> list[str]:
        """The command line."""
        options = (*arguments, "--dialogue", "json", "--connect", endpoint)
        return [sys.executable, "-m", "yahboomd", "calibrate", *options]

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            # Killed, it may leave half a line.
            if line.endswith(b"\n"):
                self.lines.append(json.loads(line))

    def _hold(self) -> None:
        while self.process.poll() is None:
            if self._held:
                self.send(type="hold", id=self._held, at_ns=time.monotonic_ns())
            time.sleep(HOLD_EVERY_S)

    def send(self, **message: Any) -> None:
        """Write one line."""
        assert self.process.stdin is not None
        # It may be about to end.
        with suppress(OSError, ValueError):
            self.process.stdin.write(json.dumps(message).encode() + b"\n")

    def of_type(self, *types: str) -> list[dict[str, Any]]:
        """The lines of these types."""
        return [line for line in self.lines if line["type"] in types]

    def question(self) -> dict[str, Any]:
        """The next question."""

        def asked() -> dict[str, Any] | None:
            questions = self.of_type("question")
            return questions[self._seen] if len(questions) > self._seen else None

        wait_for(lambda: asked() or not self._reader.is_alive(), "a question")
        found = asked()
        assert found is not None, self.lines
        self._seen += 1
        return found

    def answer(self, question: dict[str, Any], text: str = "") -> None:
        """Answer it."""
        self.send(type="answer", id=question["id"], text=text)

    def hold(self, question: dict[str, Any]) -> None:
        """Hold the button from now on."""
        self._held = question["id"]

    def _begin(self, question: dict[str, Any]) -> None:
        if question["kind"] == "hold":
            self.hold(question)
        else:
            self.answer(question)

    def fall_silent(self) -> None:
        """Report no longer that it is held."""
        self._held = ""

    def release(self) -> None:
        """Let go."""
        self._held = ""
        self.send(type="release")

    def moved_until(
        self, question: dict[str, Any], condition: Callable[[], object]
    ) -> dict[str, Any]:
        """Let it move until something is true; again, if a busy machine let the run lapse.

        Returns:
            The question of the last movement.
        """
        assert question["kind"] in MOVEMENTS, question
        self._begin(question)

        def moved() -> bool:
            nonlocal question
            again = self.of_type("question")[self._seen :]
            if again and again[0]["kind"] in MOVEMENTS:
                question = self.question()
                self._begin(question)
            # Of a movement that was let go, the robot may still be rolling.
            begun = [each["type"] for each in self.of_type("question", "progress")]
            return begun[-1] == "progress" and bool(condition())

        wait_for(moved, "what it moves for")
        return question

    def moved_through(
        self, question: dict[str, Any], begin: Callable[[], Begin]
    ) -> tuple[Begin, dict[str, Any]]:
        """Let it move until the question after the movement.

        Returns:
            What ``begin`` returned before the movement that counts, and the question after it.
        """
        while True:
            begun = begin()
            self._begin(question)
            after = self.question()
            self._held = ""
            if after["kind"] not in MOVEMENTS:
                return begun, after
            question = after

    def ends(self) -> int:
        """Wait for its end; its exit status."""
        status = self.process.wait(60)
        self._reader.join()
        self._holding.join()
        return status

    def close(self) -> None:
        """End it."""
        self.process.kill()
        self.ends()
        for stream in (self.process.stdin, self.process.stdout):
            assert stream is not None
            stream.close()
