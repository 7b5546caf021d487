"""Calibrating from a page: one calibration at a time, led by the page in control.

It is a task of the server, on a session of its own with the robot, and moves the robot only while
holds come. Each hold counts from its arrival, unless its beat is too old, so a delayed hold never
moves the robot. When the page loses control or leaves, the task is cancelled, which stops the
robot. An error in it ends the calibration and nothing else.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from yahboomd.client import AsyncRobot
from yahboomd.core.clock import Clock
from yahboomd.core.errors import YahboomdError
from yahboomd.tools.calibrate.calibration import calibrate, ended, undo
from yahboomd.tools.calibrate.choices import CALIBRATIONS, Choices, fields_of, read_choices
from yahboomd.tools.calibrate.dialogue import Dialogue, Message
from yahboomd.tools.calibrate.hold import HeldButton
from yahboomd.web.page_session import part

if TYPE_CHECKING:
    from yahboomd.core.config import Loaded

log = logging.getLogger("yahboomd.web")

SAID = 6
"""The number of the calibration's sentences that are shown at once."""

ANSWER_CHARACTERS = 40

FORMS = {verb: fields_of(choices) for verb, choices in CALIBRATIONS.items()}
"""The fields of each calibration's form."""

RUNNING = "A calibration runs already. End it first."
NONE = "No calibration runs."
NOT_YOURS = "Another page leads the calibration."
UNKNOWN = "That calibration does not exist, or a number is out of its range."
ENDED = "The calibration was ended: nothing was written."


class PageCalibration:
    """The calibration that a page leads, and what pages see of it.

    Args:
        robot: Makes the client that drives.
        load: Reads the configuration of the robot's machine.
        source: The key on which the robot is driven.
        changed: Called when pages see something new.
    """

    def __init__(
        self,
        clock: Clock,
        robot: Callable[[], AsyncRobot],
        load: Callable[[], Loaded],
        source: str,
        *,
        changed: Callable[[], None],
    ) -> None:
        self._clock = clock
        self._make_robot = robot
        self._load = load
        self._source = source
        self._changed = changed
        self._dialogue: Dialogue | None = None
        self._task: asyncio.Task[None] | None = None
        self._page: int | None = None
        self._verb = ""
        self._clear()

    def _clear(self) -> None:
        self._question: Message | None = None
        self._progress: Message | None = None
        self._said: list[str] = []
        self._result: dict[str, Any] | None = None
        self._refused = ""

    @property
    def page(self) -> int | None:
        """The page that leads; None while no calibration runs."""
        return self._page

    def shown(self) -> bytes:
        """The calibration as pages show it."""
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

    def begin(self, page: int, verb: object, given: Mapping[str, Any]) -> str:
        """Start a calibration for a page; returns the reason if it is refused, or empty."""
        if self._task is not None:
            return RUNNING
        if (choices := read_choices(verb, given)) is None:
            return UNKNOWN
        self._clear()
        self._page, self._verb = page, str(verb)
        self._task = asyncio.create_task(self._lead(choices), name="web-calibration")
        # Not in the task itself, which a cancellation may end before it begins.
        self._task.add_done_callback(self._over)
        self._changed()
        return ""

    async def _lead(self, choices: Choices) -> None:
        loaded = await asyncio.to_thread(self._load)
        async with self._make_robot() as robot:
            hold = HeldButton(self._clock, robot.stop)
            self._dialogue = dialogue = Dialogue(self._tell, self._clock, hold)
            try:
                await calibrate(
                    robot, loaded, choices, dialogue, hold, source=self._source, clock=self._clock
                )
            except asyncio.CancelledError:
                self._refused = await ended(robot, choices)
                raise

    def _over(self, task: asyncio.Task[None]) -> None:
        self._page = self._question = self._progress = self._task = self._dialogue = None
        if task.cancelled():
            written = self._result is not None and self._result["written"]
            self._refused = "" if written else self._refused or ENDED
        elif isinstance(error := task.exception(), YahboomdError):
            self._refused = str(error)
        elif error is not None:
            log.error("A calibration failed by a mistake of yahboomd.", exc_info=error)
            self._refused = (
                f"The calibration failed by a mistake of yahboomd ({type(error).__name__}: "
                f"{error}). The robot was stopped. The log of `yahboomd web` has the details."
            )
        self._changed()

    def _tell(self, told: Message) -> None:
        match told:
            case {"type": "question"}:
                self._question, self._progress = told, None
            case {"type": "progress"}:
                self._progress = told
            case {"type": "say", "text": str(text)}:
                self._said = [*self._said, text][-SAID:]
            case {"type": "result", "text": str(text), "facts": dict(facts)}:
                self._result = {"text": text, "written": facts.get("written")}
        self._changed()

    def answer(self, page: int, question: object, text: object) -> str:
        """Pass an answer on; returns the reason if it is refused, else an empty text."""
        if refusal := self._not_led_by(page):
            return refusal
        if not isinstance(question, str) or not isinstance(text, str):
            return "That is no answer."
        if len(text) > ANSWER_CHARACTERS:
            return f"An answer has at most {ANSWER_CHARACTERS} characters."
        if self._dialogue is None or not self._dialogue.answer(question, text):
            return "That question is no longer open."
        return ""

    def hold(self, page: int, question: str) -> str:
        """Note that the button is held now; returns the reason if it is refused, or empty."""
        if refusal := self._not_led_by(page):
            return refusal
        if self._dialogue is not None:
            self._dialogue.press(question, self._clock.now_ns())
        return ""

    def let_go(self, page: int) -> None:
        """Note that the button was released."""
        if page == self._page and self._dialogue is not None:
            self._dialogue.release()

    def end(self, page: int | None = None) -> str:
        """Stop the robot, then end the calibration; returns the reason if it is refused, or empty.

        Args:
            page: The page that asks; None: the server.
        """
        if page is not None and (refusal := self._not_led_by(page)):
            return refusal
        if self._task is None:
            return NONE
        if self._dialogue is not None:
            self._dialogue.release()
        self._question = self._progress = None
        # A second one would cut short the wait for the wheels to stand.
        if not self._task.cancelling():
            self._task.cancel()
        self._changed()
        return ""

    def control_changed(self, driver: int | None) -> None:
        """End the calibration if its page no longer has control."""
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
        try:
            return True, await asyncio.to_thread(lambda: undo(self._load()))
        except YahboomdError as error:
            return False, str(error)

    def _not_led_by(self, page: int) -> str:
        if self._page is None:
            return NONE
        return "" if page == self._page else NOT_YOURS
