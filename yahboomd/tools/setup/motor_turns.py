"""Turns the motors one at a time, or asks the person to turn the wheels, and asks which turned."""

from __future__ import annotations

import math
import sys
import textwrap
from collections.abc import Callable, Sequence

import msgspec

from yahboomd.core.counts import unwrapped
from yahboomd.core.drive.kinematics import unit_geometry
from yahboomd.core.errors import BoardSilent, Refused
from yahboomd.core.link.conversation import Conversation
from yahboomd.core.link.handshake import unheard_because
from yahboomd.core.model import CHANNELS, Counts
from yahboomd.tools.calibrate.estimates.wiring import (
    HandTurn,
    MotorTurn,
    WiredMotor,
    WiringFound,
    judge,
    judge_by_hand,
    plain,
    stiff,
)
from yahboomd.tools.port.board_questions import COUNTERS_WITHIN_S, read_counters, why_silent
from yahboomd.tools.port.pulses import MOVED_TURNS, Pulses
from yahboomd.tools.setup.board_law import as_drivable
from yahboomd.tools.setup.description import Description
from yahboomd.tools.setup.robot_drawing import picture
from yahboomd.tools.terminal.terminal_questions import (
    WIDTH,
    Respondent,
    say,
    say_heading,
    say_points,
)

MOTOR_TURNS_PER_S = 200.0
"""None of the vendor's motors runs faster than 12,000 turns a minute without a load."""

REPAIR = "Switch the motors' supply off, repair it, and switch it on again."
TRY = "Enter: try again; w: write the file, as if it were repaired; q: end"
MISSING = "Enter: try again; q: end"
FORWARD = "Forward is the way that the robot drives: the top of the wheel moves to the front."
POWER_UNSEEN = (
    "Whether each motor's power agrees with its encoder was not seen: drive slowly at first, with "
    "the wheels off the ground. The daemon cuts a wheel that turns against its command."
)


class UnwiredRobot(msgspec.Struct, frozen=True, kw_only=True):
    """A robot with unknown wiring.

    Attributes:
        wheels: The driven wheels, by their number in the picture.
        ways: The ways to connect their motors that the board can drive.
    """

    description: Description
    wheels: tuple[str, ...]
    ways: list[tuple[WiredMotor, ...]]

    @property
    def picture(self) -> str:
        """A drawing of it, from above."""
        return picture(unit_geometry(self.description.kinematics))


class ByOutput:
    """Finds the wiring with a board that can give its motors an output.

    Args:
        may_turn: Called before each motor is turned; raises if none may turn.
        volts: The supply of the motors; None if the board does not report it.
    """

    def __init__(
        self,
        talk: Conversation,
        pulses: Pulses,
        person: Respondent,
        robot: UnwiredRobot,
        may_turn: Callable[[], None],
        *,
        volts: float | None = None,
    ) -> None:
        self._volts = volts
        self._by_hand: dict[str, bool] = {}
        self._talk = talk
        self._pulses = pulses
        self._person = person
        self._robot = robot
        self._ticks = robot.description.profile.ticks_per_revolution
        self._may_turn = may_turn
        self._turns: dict[int, MotorTurn] = {}
        self._plugs: dict[str, int] = {}

    async def find(self) -> WiringFound:
        """Turn each motor, until the answers are consistent.

        Returns:
            The verdict, with faults only if the person wants the file anyway.

        Raises:
            Refused: The person ended it.
            LinkError: The port or the board was lost.
            BoardError: A wheel does not stop, or the board reset itself.
        """
        say("\nEach motor turns for a moment, half a turn of its wheel at most. Watch the wheels.")
        say(FORWARD)
        _say_plugs(self._talk)
        say(self._robot.picture)
        again: Sequence[int] = range(1, CHANNELS + 1)
        while True:
            await _counting(self._talk)
            await self._try(again)
            verdict = self._verdict()
            for words in verdict.doubts:
                say(f"  {words}")
            if verdict.again:
                say("Once more, then.")
                again = verdict.again
                continue
            if verdict.missing:
                await self._look_into(verdict.missing)
                verdict = self._verdict()
                if verdict.again:
                    again = verdict.again
                    continue
            if not verdict.missing:
                verdict = as_drivable(verdict, self._robot.ways)
            if not verdict.faults or await _gives_up(self._person, verdict, self._talk):
                return verdict
            again = self._suspects(verdict)

    def _verdict(self) -> WiringFound:
        return judge(
            list(self._turns.values()),
            self._robot.wheels,
            # A pulse of a slow gear ends as early as with the fastest one.
            self._robot.description.profile.least_ticks_per_revolution,
            self._plugs,
            by_hand=self._by_hand,
            volts=self._volts,
        )

    async def _look_into(self, missing: Sequence[str]) -> None:
        """Let wheels that did not turn be turned by hand, and give their motors more output."""
        names = " and ".join(plain(wheel) for wheel in missing)
        say()
        say(textwrap.fill(f"No motor turned {names}. {stiff(self._volts)}", WIDTH))
        say("Its encoder first: no motor turns now.")
        for wheel in missing:
            self._plugs.pop(wheel, None)
            before = await _counting(self._talk)
            await self._person.line(
                f"Turn the {plain(wheel)} wheel by hand, about half a turn; then Enter:"
            )
            after = await _counting(self._talk)
            turned = [abs(unwrapped(new - old)) for new, old in zip(after, before, strict=True)]
            position = 1 + turned.index(max(turned))
            self._by_hand[wheel] = max(turned) >= MOVED_TURNS * self._ticks
            if not self._by_hand[wheel]:
                say("No counter moved.")
                continue
            say(f"The counter of M{position} moved.")
            if not self._turns[position].wheel:
                self._plugs[wheel] = position
        await self._ask_plugs(missing)
        still = [turn.position for turn in self._turns.values() if not turn.wheel]
        for position in sorted({*self._plugs.values()} & {*still}) or still:
            await self._turn_stronger(position)

    async def _turn_stronger(self, position: int) -> None:
        while self._pulses.has_stronger(position):
            found = await self._turn(position, stronger=True)
            if found.wheel:
                self._turns[position] = found
                return

    async def _try(self, positions: Sequence[int]) -> None:
        for position in positions:
            self._turns.pop(position, None)
        for position in positions:
            seen = {turn.wheel for turn in self._turns.values()}
            if seen >= {*self._robot.wheels}:
                say(f"Every wheel has its motor: M{position} is free.")
                continue
            self._turns[position] = await self._turn(position)

    async def _turn(self, position: int, *, stronger: bool = False) -> MotorTurn:
        how = "is given more" if stronger else "turns"
        while True:
            await self._person.line(f"\nEnter, and M{position} {how}:")
            self._may_turn()
            turn = self._pulses.turn_stronger if stronger else self._pulses.turn
            pulse = await turn(position, _say_more)
            say(" no counter moved." if pulse.turns < MOVED_TURNS else " the counters moved.")
            wheel = await self._ask_wheel()
            if wheel is None:
                continue
            if not wheel:
                return MotorTurn(position=position, counts=pulse.counts)
            forward = await self._ask_way(wheel)
            if forward is not None:
                return MotorTurn(
                    position=position, counts=pulse.counts, wheel=wheel, forward=forward
                )

    async def _ask_wheel(self) -> str | None:
        """The wheel, empty for none; None to see it again."""
        numbers = {str(number): wheel for number, wheel in enumerate(self._robot.wheels, start=1)}
        while True:
            answer = (
                await self._person.line(
                    f"Which wheel turned? ({', '.join(numbers)}; 0: none; a: again)"
                )
            ).lower()
            if answer in numbers:
                return numbers[answer]
            if answer in {"a", "again"}:
                return None
            if answer in {"0", "n", "none"}:
                return ""
            say("The number at the wheel in the picture, please.")
            say(self._robot.picture)

    async def _ask_way(self, wheel: str) -> bool | None:
        """Whether it turned forward; None to see it again."""
        while True:
            answer = (
                await self._person.line(
                    f"Which way did the {plain(wheel)} wheel turn? "
                    "(f: forward; b: backward; a: again)"
                )
            ).lower()
            if answer in {"f", "forward"}:
                return True
            if answer in {"b", "backward"}:
                return False
            if answer in {"a", "again"}:
                return None
            say(f"f or b, please. {FORWARD}")

    async def _ask_plugs(self, missing: Sequence[str]) -> None:
        """Ask for the plugs of wheels that neither turned nor were counted."""
        still = [str(turn.position) for turn in self._turns.values() if not turn.wheel]
        if len(missing) == len(still) == 1:
            return
        for wheel in missing:
            if wheel in self._plugs:
                continue
            answer = await self._person.line(
                f"The {plain(wheel)} wheel did not turn. Which plug is its motor in? "
                f"({', '.join(f'M{each}' for each in still)}; Enter: not known)"
            )
            answer = answer.upper().removeprefix("M")
            if answer in still:
                self._plugs[wheel] = int(answer)

    def _suspects(self, verdict: WiringFound) -> list[int]:
        """The plugs that a repair may have changed."""
        named = {fault.position for fault in verdict.faults} | {
            fault.arrives for fault in verdict.faults
        }
        if verdict.missing:
            named |= {turn.position for turn in self._turns.values() if not turn.wheel}
        return sorted(position for position in named if position)


class ByHand:
    """Finds the wiring with a board that has speeds only: the person turns the wheels."""

    def __init__(self, talk: Conversation, person: Respondent, robot: UnwiredRobot) -> None:
        self._talk = talk
        self._person = person
        self._robot = robot
        self._ticks = robot.description.profile.ticks_per_revolution

    async def find(self) -> WiringFound:
        """Ask for a turn of each wheel, until the answers are consistent.

        Raises:
            Refused: The person ended it.
            LinkError: The port or the board was lost.
        """
        say("Turn each wheel forward by hand, about half a turn.")
        say(FORWARD)
        say(self._robot.picture)
        while True:
            await _counting(self._talk)
            turns = [
                await self._turn(number, wheel)
                for number, wheel in enumerate(self._robot.wheels, start=1)
            ]
            verdict = judge_by_hand(turns, self._ticks)
            for words in verdict.doubts:
                say(f"  {words}")
            if verdict.doubts:
                say("Once more, then.")
                continue
            if not verdict.missing:
                verdict = as_drivable(verdict, self._robot.ways)
            if not verdict.faults or await _gives_up(self._person, verdict, self._talk):
                say()
                say(textwrap.fill(POWER_UNSEEN, WIDTH))
                return verdict

    async def _turn(self, number: int, wheel: str) -> HandTurn:
        before = await self._counters()
        await self._person.line(f"Turn wheel {number} ({plain(wheel)}) forward; then Enter:")
        after = await self._counters()
        a, b, c, d = (unwrapped(new - old) for new, old in zip(after, before, strict=True))
        return HandTurn(wheel=wheel, counts=(a, b, c, d))

    async def _counters(self) -> Counts:
        return await _counting(self._talk)


def _say_more() -> None:
    print(".", end="", file=sys.stderr, flush=True)


async def _counting(talk: Conversation) -> Counts:
    """Wait for the counters, and return them."""
    # A board that was switched off for a repair is silent at first.
    for _ in range(1 + math.ceil(talk.dialect.starts_within_s / COUNTERS_WITHIN_S)):
        counts = await read_counters(talk)
        if counts is not None:
            return counts
    raise BoardSilent(
        "The board answers, but sends no counters.",
        remedy=await why_silent(talk) or unheard_because(talk.line),
    )


def _say_plugs(talk: Conversation) -> None:
    if talk.dialect.plugs:
        say(textwrap.fill(talk.dialect.plugs, WIDTH))


async def _gives_up(person: Respondent, verdict: WiringFound, talk: Conversation) -> bool:
    """Print the faults; return whether the person wants the file anyway."""
    say_heading("To be repaired: no configuration can correct it")
    say_points(fault.words for fault in verdict.faults)
    if verdict.hint:
        say(textwrap.fill(verdict.hint, WIDTH))
    _say_plugs(talk)
    say(REPAIR)
    question = MISSING if verdict.missing else TRY
    while True:
        answer = (await person.line(f"({question})")).lower()
        if not answer:
            return False
        if answer == "q":
            raise Refused("Nothing was written. Repair it, and run `yahboomd setup` again.")
        if answer == "w" and not verdict.missing:
            return True
        say("Enter, or one of the letters.")
