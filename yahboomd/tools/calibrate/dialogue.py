"""A calibration led by another program: lines of JSON out, lines of JSON in.

Out: ``question`` (with ``id``, ``name``, ``kind``, ``text`` and further facts), ``progress``,
``say``, ``result``, ``refused``, and ``ignored`` for a line that made no sense. In: ``answer``,
``hold``, ``release`` and ``abort``. ``docs/calibration.md`` describes each.
"""

from __future__ import annotations

import asyncio
import json
import math
from functools import partial
from typing import TYPE_CHECKING, Any

from yahboomd.core.clock import SystemClock
from yahboomd.core.errors import Refused, YahboomdError
from yahboomd.tools.terminal.asking import input_ended
from yahboomd.tools.terminal.input_lines import InputLines

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from yahboomd.tools.calibrate.hold import HeldButton
    from yahboomd.tools.terminal.asking import LargestMove, Number

PROGRESS_NS = 200_000_000
"""The least time between two reports of progress."""


def write_refused(error: YahboomdError) -> None:
    """Write the last line if nothing was written to the calibration file."""
    _write("refused", text=str(error), status=error.exit_code)


class Dialogue:
    """A person who is asked through a program; see :class:`~.asking.Person`.

    Args:
        hold: The button that lets the robot move; None: an answer starts each movement.
    """

    enter = "Press \N{LEFT DOUBLE QUOTATION MARK}Done\N{RIGHT DOUBLE QUOTATION MARK}"

    def __init__(self, hold: HeldButton | None) -> None:
        self._hold = hold
        self._asked = 0
        self._id = ""
        self._answer: asyncio.Future[str] | None = None
        self._reported = (0, 0)
        self._clock = SystemClock()

    async def lead(self, work: Coroutine[Any, Any, int]) -> int:
        """Run the work until it ends or the program goes away.

        Raises:
            Refused: The input ended, or the program aborted.
        """
        working, reading = asyncio.create_task(work), asyncio.create_task(self._read())
        try:
            await asyncio.wait({working, reading}, return_when=asyncio.FIRST_COMPLETED)
            if not working.done():
                # Cancelling the work, below, stops the robot.
                raise reading.result()
            return working.result()
        finally:
            for each in (working, reading):
                each.cancel()
            await asyncio.gather(working, reading, return_exceptions=True)

    async def _read(self) -> Refused:
        lines = InputLines()
        while (line := await lines.line()) is not None:
            try:
                message = json.loads(line)
            except (ValueError, RecursionError):
                message = None
            match message:
                case {"type": "hold", "id": self._id, "at_ns": int(at_ns)} if self._hold:
                    self._hold.press(at_ns)
                case {"type": "hold", "id": str()}:
                    pass  # belongs to a movement that is over
                case {"type": "release"}:
                    if self._hold is not None:
                        self._hold.release()
                case {"type": "answer", "id": self._id, "text": str(text)}:
                    if self._answer is not None and not self._answer.done():
                        self._answer.set_result(text)
                case {"type": "abort"}:
                    return Refused("The calibration was ended: nothing was written.")
                case _:
                    _write("ignored", text="Not an answer to the open question.")
        return input_ended()

    async def _ask(self, kind: str, name: str, text: str, **more: Any) -> str:  # noqa: ANN401
        self._asked += 1
        self._id = f"{name}-{self._asked}"
        self._answer = asyncio.get_running_loop().create_future()
        _write("question", id=self._id, name=name, kind=kind, text=text, **more)
        return await self._answer

    async def confirm(self, name: str, words: str) -> None:
        """Wait for any answer."""
        await self._ask("confirm", name, words)

    async def start(self, name: str, words: str, bounds: LargestMove) -> None:
        """Wait for any answer; with a button, until it is held."""
        text = f"{words} It moves {_amount(bounds)}, for at most {bounds.time_s:.0f} s."
        more = {
            "bounds": {
                "distance_m": round(bounds.distance_m, 3),
                "turn_rad": round(bounds.turn_rad, 3),
                "time_s": round(bounds.time_s, 1),
            }
        }
        self._reported = (0, 0)
        if self._hold is None:
            await self._ask("start", name, text, **more)
            return
        self._hold.offer()
        asked = asyncio.create_task(self._ask("hold", name, text, **more))
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
        """Write it."""
        _write("say", text=words)

    def progress(self, part: int, parts: int, done: float) -> None:
        """Write it, at most every :data:`PROGRESS_NS` within a part."""
        before_part, before_ns = self._reported
        now_ns = self._clock.now_ns()
        if part != before_part or done >= 1.0 or now_ns - before_ns >= PROGRESS_NS:
            self._reported = (part, now_ns)
            _write("progress", part=part, parts=parts, done=round(done, 3))

    def result(self, table: str, facts: dict[str, Any]) -> None:
        """Write it."""
        _write("result", text=table, facts=facts)


def _amount(bounds: LargestMove) -> str:
    turns = bounds.turn_rad / (2.0 * math.pi)
    words = [f"{bounds.distance_m:g} m"] if bounds.distance_m else []
    if turns:
        words.append("1 turn" if round(turns, 2) == 1.0 else f"{turns:.3g} turns")
    return " and ".join(words)


def _write(line_type: str, /, **fields: Any) -> None:  # noqa: ANN401
    print(json.dumps({"type": line_type, **fields}), flush=True)
