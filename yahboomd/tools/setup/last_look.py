"""The last look before the file is written: do all wheels turn forward, as far as counted?

The wiring comes from the person's answers, and the gear from a profile: no other check would find
an error in them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import median
from typing import Literal, TypeAlias

import msgspec

from yahboomd.core.errors import Refused
from yahboomd.core.protocol.profiles import MotorProfile, alike, of_its_board
from yahboomd.tools.calibrate.estimates.gear import counts_instead, fits, fitting
from yahboomd.tools.calibrate.estimates.wiring import WiredMotor, WiringFound, plain
from yahboomd.tools.port.pulses import Pulses
from yahboomd.tools.terminal.asking import read_number
from yahboomd.tools.terminal.terminal_questions import Respondent, say, say_heading

FORWARD_TURNS = 0.15
HALF = 0.5

NEAR_SHARE = 0.08
"""Counts that are farther from half a turn than this leave the mark beside the bottom."""

LEAST_SHARE = 0.2

Verdict: TypeAlias = Literal["fits", "not checked", "does not fit"]

NOT_CHECKED = "The gear was not checked. Is the motors' sticker that of board.profile?"


class GearSeen(msgspec.Struct, frozen=True, kw_only=True):
    """The findings on the gear.

    Attributes:
        words: A sentence for the person; empty if it fits.
        profile: The profile that fits instead, if one of the same stored type does.
        ticks_per_revolution: The counts of one turn, if only other motors have them.
    """

    verdict: Verdict = "not checked"
    words: str = NOT_CHECKED
    profile: MotorProfile | None = None
    ticks_per_revolution: float | None = None


FITS = GearSeen(verdict="fits", words="")


class Unanswered(Exception):
    """The person ends the last look."""


class LastLook:
    """Turns the wheels once more, with the wiring found, and asks how they turned.

    Args:
        may_turn: Called before wheels are turned; raises if none may turn.
    """

    def __init__(
        self,
        pulses: Pulses,
        person: Respondent,
        profile: MotorProfile,
        may_turn: Callable[[], None],
    ) -> None:
        self._pulses = pulses
        self._person = person
        self._profile = profile
        self._may_turn = may_turn

    async def look(self, wiring: WiringFound) -> GearSeen | None:
        """Look at all wheels, then at each.

        Returns:
            The findings on the gear; None if an answer about the wiring was wrong.

        Raises:
            LinkError: The port or the board was lost.
            BoardError: A wheel does not stop, or the board reset itself.
        """
        say_heading("A last look, before the file is written")
        say("Stick a mark to the rim of each wheel. Enter alone skips the rest of this look.")
        ticks: list[float] = []
        try:
            if not await self._all_forward(wiring):
                say("Then an answer was wrong: each motor once more.")
                return None
            for motor in wiring.motors:
                turn = await self._half_turn(motor)
                if turn is None:
                    say("Then an answer was wrong: each motor once more.")
                    return None
                ticks.append(turn)
        except Unanswered:
            say("Not looked at.")
        return judged(ticks, self._profile, whole=len(ticks) == len(wiring.motors))

    async def _all_forward(self, wiring: WiringFound) -> bool:
        signs = {motor.position: motor.sign for motor in wiring.motors}
        counts = FORWARD_TURNS * self._profile.ticks_per_revolution
        while True:
            await self._choice("y, and all wheels turn forward, a little:", "y")
            self._may_turn()
            await self._pulses.advance(signs, counts)
            answer = await self._choice("Did every wheel turn forward? (y; n; a: again)", "yna")
            if answer != "a":
                return answer == "y"

    async def _half_turn(self, motor: WiredMotor) -> float | None:
        """The counts of one turn of the wheel, by the answers; None if another wheel turned."""
        wheel = plain(motor.wheel)
        whole = HALF * self._profile.ticks_per_revolution
        while True:
            await self._choice(
                f"\nTurn the mark of the {wheel} wheel to its top; then y, and it turns by half a "
                "turn:",
                "y",
            )
            stages = math.ceil(whole / self._pulses.most_counts)
            counted, answer = 0.0, "n"
            for stage in range(1, stages + 1):
                self._may_turn()
                target = whole * stage / stages
                counts = await self._pulses.advance({motor.position: motor.sign}, target - counted)
                counted += abs(counts[motor.position - 1])
                if stage < stages:
                    # With a faster gear it would turn more than once without this question.
                    answer = await self._choice(
                        f"On its way ({stage} of {stages}). Has the mark reached the bottom? "
                        "(y; n; w: another wheel turned; a: again)",
                        "ynwa",
                    )
                    if answer != "n":
                        break
            else:
                if counted < LEAST_SHARE * whole:
                    say("It hardly turned: once more.")
                    continue
                if abs(counted - whole) <= NEAR_SHARE * whole:
                    answer = await self._choice(
                        "Is the mark at the bottom now? (y; n; w: another wheel turned; a: again)",
                        "ynwa",
                    )
                if answer == "y":
                    # The gear fits, but was not measured exactly: take the profile's.
                    return self._profile.ticks_per_revolution
            if answer == "w":
                return None
            if answer != "a":
                degrees = await self._degrees()
                return counted * 360.0 / degrees if degrees is not None else None

    async def _degrees(self) -> float | None:
        """The person's number; None if another wheel turned."""
        while True:
            text = await self._line(
                "How far did the wheel turn, in degrees? (90: a quarter; 180: half; 360: once; "
                "w: another wheel turned)"
            )
            if text.lower() == "w":
                return None
            if (value := read_number(text, lambda number: 5.0 <= number <= 720.0)) is not None:
                return value
            say("A number from 5 to 720, or w, please.")

    async def _choice(self, question: str, letters: str) -> str:
        while True:
            answer = (await self._line(question)).lower()
            answer = {"yes": "y", "no": "n", "again": "a"}.get(answer, answer)
            if answer and answer in letters:
                return answer
            say(f"{', '.join(letters)} or Enter alone, please.")

    async def _line(self, question: str) -> str:
        try:
            answer = await self._person.line(question)
        except Refused as ended:
            # The input has ended, and with it the look.
            raise Unanswered from ended
        if not answer:
            raise Unanswered
        return answer


def judged(ticks: list[float], own: MotorProfile, *, whole: bool) -> GearSeen:
    """Judge the gear from single wheels.

    Args:
        ticks: The counts of one turn of each checked wheel.
        whole: These are all wheels.
    """
    off = [each for each in ticks if not fits(each, own)]
    if not off:
        return FITS if whole else GearSeen()
    found = median(off)
    words = (
        f"The wheel turned by {180.0 * own.ticks_per_revolution / found:.0f} degrees, and half a "
        f"turn was counted with the profile {own.name} (1:{own.ratio:g}): the gear is about "
        f"1:{found / own.ticks_per_revolution * own.ratio:.0f}."
    )
    same = {each.name: each for each in alike(own)}
    fitted = fitting(found, own, same.values()) or fitting(found, own, of_its_board(own))
    if fitted is None or fitted.ticks_per_revolution == own.ticks_per_revolution:
        return GearSeen(verdict="does not fit", words=f"{words} None of the vendor's gears fits.")
    if profile := same.get(fitted.name):
        words = f"{words} The profile {profile.name} (1:{profile.ratio:g}) fits."
        return GearSeen(verdict="does not fit", words=words, profile=profile)
    return GearSeen(
        verdict="does not fit",
        words=f"{words} {counts_instead(own, fitted)}",
        ticks_per_revolution=fitted.ticks_per_revolution,
    )
