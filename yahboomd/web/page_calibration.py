"""Calibrating from a page: one wizard at a time, led by the page in control.

The wizard is ``yahboomd calibrate --dialogue json --held`` in a process of its own. It moves the
robot only while holds come. Each hold is passed on with the time of its arrival, unless its beat is
too old, so a delayed hold never moves the robot. When the page loses control or leaves, the wizard
ends.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from yahboomd.core.clock import Clock
from yahboomd.web.child_command import Child, output_of
from yahboomd.web.page_frames import part

SAID = 6
"""The number of the wizard's sentences that are shown at once."""

ANSWER_CHARACTERS = 40

RANGES: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "tape": {
        "straight": (0.2, 20.0),
        "turns": (1, 50),
        "sideways": (0.2, 5.0),
        "speed": (0.02, 1.0),
        "turn-speed": (0.1, 3.0),
    },
    "squares": {
        "side": (0.2, 10.0),
        "count": (1, 50),
        "straight": (0.2, 20.0),
        "speed": (0.02, 1.0),
        "turn-speed": (0.1, 3.0),
    },
    "imu": {"turns": (1, 50)},
}
"""The numbers that a page may choose, with their bounds: metres, m/s, rad/s, and whole numbers."""

WHOLE = frozenset({"turns", "count"})

FLAGS: Mapping[str, frozenset[str]] = {
    "tape": frozenset({"by-hand", "dry-run"}),
    "squares": frozenset({"by-hand", "dry-run"}),
    "imu": frozenset(),
}

RUNNING = "A calibration runs already. End it first."
NONE = "No calibration runs."
NOT_YOURS = "Another page leads the calibration."


class PageCalibration:
    """The calibration that a page leads, and what pages see of it."""

    def __init__(
        self, clock: Clock, robot: Sequence[str], source: str, changed: Callable[[], None]
    ) -> None:
        self._clock = clock
        self._robot = tuple(robot)
        self._source = source
        self._changed = changed
        self._child: Child | None = None
        self._task: asyncio.Task[None] | None = None
        self._ending = False
        self._page: int | None = None
        self._verb = ""
        self._clear()

    def _clear(self) -> None:
        self._question: dict[str, Any] | None = None
        self._progress: dict[str, Any] | None = None
        self._said: list[str] = []
        self._result: dict[str, Any] | None = None
        self._refused = ""

    @property
    def page(self) -> int | None:
        """The page that leads; None while no wizard runs."""
        return self._page

    def shown(self) -> bytes:
        """The wizard as pages show it."""
        return part(
            "calibration",
            page=self._page,
            verb=self._verb,
            question=self._question,
            progress=self._progress,
            said=self._said,
            result=self._result,
            refused=self._refused,
        )

    def begin(self, page: int, verb: object, choices: Mapping[str, Any]) -> str:
        """Start a wizard for a page; returns the reason if it is refused, else an empty text."""
        if self._task is not None:
            return RUNNING
        arguments = chosen(verb, choices)
        if arguments is None:
            return "That calibration does not exist, or a number is out of its range."
        if verb != "imu":
            arguments += ["--held", f"--source={self._source}"]
        self._clear()
        self._page, self._verb, self._ending = page, str(verb), False
        command = ["calibrate", *arguments, "--dialogue=json", *self._robot]
        self._task = asyncio.create_task(self._lead(command), name="web-calibration")
        self._changed()
        return ""

    async def _lead(self, command: Sequence[str]) -> None:
        child: Child | None = None
        try:
            child = self._child = await Child.start(command)
            if self._ending:
                child.close_input()
            async for line in child.lines():
                self._receive(line)
        finally:
            self._child = None
            status = await asyncio.shield(child.end()) if child is not None else 1
            if status and child is not None and not self._refused:
                self._refused = child.last_words or "The calibration ended; nothing was written."
            self._page = self._question = self._progress = self._task = None
            self._changed()

    def _receive(self, line: dict[str, Any]) -> None:
        match line:
            case {"type": "question"}:
                self._question, self._progress = line, None
            case {"type": "progress"}:
                self._progress = line
            case {"type": "say", "text": str(text)}:
                self._said = [*self._said, text][-SAID:]
            case {"type": "result", "text": str(text), "facts": dict(facts)}:
                self._result = {"text": text, "written": facts.get("written")}
            case {"type": "refused", "text": str(text)}:
                self._refused = text
        self._changed()

    def answer(self, page: int, question: object, text: object) -> str:
        """Pass an answer on; returns the reason if it is refused, else an empty text."""
        if refusal := self._not_led_by(page):
            return refusal
        if not isinstance(question, str) or not isinstance(text, str):
            return "That is no answer."
        if len(text) > ANSWER_CHARACTERS:
            return f"An answer has at most {ANSWER_CHARACTERS} characters."
        if self._question is None or question != self._question.get("id"):
            return "That question is no longer open."
        return "" if self._write(type="answer", id=question, text=text) else NONE

    def hold(self, page: int, question: str) -> str:
        """Pass on that the button is held now; returns the reason if it is refused, or empty."""
        if refusal := self._not_led_by(page):
            return refusal
        self._write(type="hold", id=question[:100], at_ns=self._clock.now_ns())
        return ""

    def let_go(self, page: int) -> None:
        """Pass on that the button was released."""
        if page == self._page:
            self._write(type="release")

    def end(self, page: int | None = None) -> str:
        """Stop the robot, then end the wizard; returns the reason if it is refused, or empty.

        Args:
            page: The page that asks; None: the server.
        """
        if page is not None and (refusal := self._not_led_by(page)):
            return refusal
        if self._task is None:
            return NONE
        self._ending = True
        self._write(type="release")
        self._write(type="abort")
        if self._child is not None:
            self._child.close_input()
        return ""

    def control_changed(self, driver: int | None) -> None:
        """End the wizard if its page no longer has control."""
        if self._page is not None and self._page != driver:
            self.end()

    async def close(self) -> None:
        """End it, and wait until it has ended."""
        task = self._task
        if task is not None:
            self.end()
            await asyncio.wait([task])

    async def undo(self) -> tuple[bool, str]:
        """Undo the newest calibration. Returns whether it was done, and a sentence for people."""
        if self._task is not None:
            return False, RUNNING
        # The command needs no daemon.
        config = [it for it in self._robot if not it.startswith(("--connect=", "--namespace="))]
        status, printed, last_words = await output_of(["calibrate", "undo", *config])
        return status == 0, (printed or last_words).strip()

    def _not_led_by(self, page: int) -> str:
        if self._page is None:
            return NONE
        return "" if page == self._page else NOT_YOURS

    def _write(self, **message: object) -> bool:
        return self._child is not None and self._child.write(**message)


def chosen(verb: object, choices: Mapping[str, Any]) -> list[str] | None:
    """The verb and its options; None if a page may not choose them."""
    if not isinstance(verb, str) or verb not in RANGES:
        return None
    arguments = [verb]
    for name, value in choices.items():
        if name in FLAGS[verb]:
            if not isinstance(value, bool):
                return None
            arguments += [f"--{name}"] * value
        elif name in RANGES[verb]:
            least, most = RANGES[verb][name]
            if isinstance(value, bool) or not isinstance(value, int | float):
                return None
            if not (math.isfinite(value) and least <= value <= most):
                return None
            if name in WHOLE and value != int(value):
                return None
            arguments.append(f"--{name}={value:g}")
        else:
            return None
    return arguments
