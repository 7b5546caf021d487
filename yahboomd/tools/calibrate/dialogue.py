"""A calibration led by another program or by a page: questions out, answers in.

:class:`Dialogue` knows no transport. :func:`lead_by_lines` is the one of ``--dialogue json``, lines
of JSON, which ``docs/calibration.md`` describes.
"""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable, Coroutine
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

from yahboomd.core.errors import Refused, YahboomdError
from yahboomd.tools.terminal.asking import input_ended
from yahboomd.tools.terminal.input_lines import InputLines

if TYPE_CHECKING:
    from yahboomd.core.clock import Clock
    from yahboomd.tools.calibrate.hold import HeldButton
    from yahboomd.tools.terminal.asking import LargestMove, Number

PROGRESS_NS = 200_000_000
"""The least time between two reports of progress."""


Message: TypeAlias = dict[str, Any]
"""One of ``docs/calibration.md``: a question, progress, a sentence or the result."""


class Dialogue:
    """A person who is asked through a program or a page; see :class:`~.asking.Person`.

    Args:
        tell: Called with all that is to be shown.
        hold: The button that lets the robot move; None: an answer starts each movement.
    """

    enter = "Press \N{LEFT DOUBLE QUOTATION MARK}Done\N{RIGHT DOUBLE QUOTATION MARK}"

    def __init__(
        self, tell: Callable[[Message], None], clock: Clock, hold: HeldButton | None = None
    ) -> None:
        self._tell = tell
        self._clock = clock
        self._hold = hold
        self._asked = 0
        self._id = ""
        self._run = ""
        self._answer: asyncio.Future[str] | None = None
        self._reported = (0, 0)

    # From the program or the page.

    def answer(self, question: str, text: str) -> bool:
        """Answer a question; returns whether it is open."""
        if question != self._id or self._answer is None or self._answer.done():
            return False
        self._answer.set_result(text)
        return True

    def press(self, question: str, at_ns: int) -> None:
        """The button of this question was held at this moment; other questions' are ignored."""
        if self._hold is not None and question == self._id:
            self._hold.press(at_ns)

    def release(self) -> None:
        """The button was let go."""
        if self._hold is not None:
            self._hold.release()

    # To them.

    async def _ask(self, kind: str, name: str, text: str, **more: Any) -> str:  # noqa: ANN401
        self._asked += 1
        self._id = f"{name}-{self._asked}"
        self._answer = asyncio.get_running_loop().create_future()
        about = {"run": self._run} if self._run else {}
        self._tell_of("question", id=self._id, name=name, kind=kind, text=text, **about, **more)
        return await self._answer

    def about(self, run: str) -> None:
        """Name it in the next questions."""
        self._run = run

    async def confirm(self, name: str, words: str) -> None:
        """Wait for any answer."""
        await self._ask("confirm", name, words)

    async def start(self, name: str, words: str, bounds: LargestMove) -> None:
        """Wait for any answer; with a button, until it is held."""
        text = f"{words} It moves {_amount(bounds)}, for at most {bounds.time_s:.0f} s."
        most = {
            "distance_m": round(bounds.distance_m, 3),
            "turn_rad": round(bounds.turn_rad, 3),
            "time_s": round(bounds.time_s, 1),
        }
        self._reported = (0, 0)
        if self._hold is None:
            await self._ask("start", name, text, bounds=most)
            return
        self._hold.offer()
        asked = asyncio.create_task(self._ask("hold", name, text, bounds=most))
        try:
            await self._hold.pressed()
        finally:
            asked.cancel()

    async def number(self, question: Number) -> float | None:
        """Ask until the answer is a possible number, or empty."""
        ask = partial(self._ask, "number", question.name, question.words, unit=question.unit)
        text = (await ask()).strip()
        while text:
            if (value := question.read(text)) is not None:
                return value
            text = (await ask(wrong=question.wrong)).strip()
        return question.blank

    def say(self, words: str) -> None:
        """Show it."""
        self._tell_of("say", text=words)

    def progress(self, part: int, parts: int, done: float) -> None:
        """Show it, at most every :data:`PROGRESS_NS` within a part."""
        before_part, before_ns = self._reported
        now_ns = self._clock.now_ns()
        if part != before_part or done >= 1.0 or now_ns - before_ns >= PROGRESS_NS:
            self._reported = (part, now_ns)
            self._tell_of("progress", part=part, parts=parts, done=round(done, 3))

    def result(self, table: str, facts: dict[str, Any]) -> None:
        """Show it."""
        self._tell_of("result", text=table, facts=facts)

    def _tell_of(self, kind: str, /, **fields: Any) -> None:  # noqa: ANN401
        self._tell({"type": kind, **fields})


def _amount(bounds: LargestMove) -> str:
    turns = bounds.turn_rad / (2.0 * math.pi)
    words = [f"{bounds.distance_m:g} m"] if bounds.distance_m else []
    if turns:
        words.append("1 turn" if round(turns, 2) == 1.0 else f"{turns:.3g} turns")
    return " and ".join(words)


def write_line(message: Message) -> None:
    """Write one line of JSON to standard output."""
    print(json.dumps(message), flush=True)


def write_refused(error: YahboomdError) -> None:
    """Write the last line if nothing was written to the calibration file."""
    write_line({"type": "refused", "text": str(error), "status": error.exit_code})


async def lead_by_lines(dialogue: Dialogue, work: Coroutine[Any, Any, None]) -> None:
    """Run the work until it ends or the program goes away; standard input has the answers.

    Raises:
        Refused: The input ended, or the program aborted.
    """
    working, reading = asyncio.create_task(work), asyncio.create_task(_read(dialogue))
    try:
        await asyncio.wait({working, reading}, return_when=asyncio.FIRST_COMPLETED)
        if not working.done():
            # Cancelling the work, below, stops the robot.
            raise reading.result()
        working.result()
    finally:
        for each in (working, reading):
            each.cancel()
        await asyncio.gather(working, reading, return_exceptions=True)


async def _read(dialogue: Dialogue) -> Refused:
    lines = InputLines()
    while (line := await lines.line()) is not None:
        try:
            message = json.loads(line)
        except (ValueError, RecursionError):
            message = None
        match message:
            case {"type": "hold", "id": str(question), "at_ns": int(at_ns)}:
                dialogue.press(question, at_ns)
            case {"type": "release"}:
                dialogue.release()
            case {"type": "answer", "id": str(question), "text": str(text)} if dialogue.answer(
                question, text
            ):
                pass
            case {"type": "abort"}:
                return Refused("The calibration was ended: nothing was written.")
            case _:
                write_line({"type": "ignored", "text": "Not an answer to the open question."})
    return input_ended()
