"""A person beside a simulated robot, who answers the questions of `setup` by its truth."""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import Callable

from board_bench import LinkBench

from yahboomd.core.config import Config
from yahboomd.core.drive.kinematics import unit_geometry
from yahboomd.core.errors import Refused
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.simulation.motors import FAULTS, HEALTHY, MotorFaults, joined
from yahboomd.tools.calibrate.estimates.wiring import WiredMotor, WiringFound
from yahboomd.tools.setup.description import Description, Given
from yahboomd.tools.setup.outcome import SetupOutcome
from yahboomd.tools.setup.robot_drawing import CORNERS
from yahboomd.tools.setup.setup_wizard import Wizard

SEEN_M = 0.003
"""A wheel that rolled this far was seen to turn: five degrees."""


class SimulatedPerson:
    """Answers by the true motion.

    Args:
        bench: The robot.

    Attributes:
        questions: All questions.
        others: Answers to questions that no truth answers, by their first words; of several each
            is given once, and then the last one again.
        looks: They look at the wheels again in the end.
        lies: Wrong answers to the next questions with this beginning.
        turned: The most that any wheel turned between two questions, in turns.
        repair: Called when a repair is asked for; None: the file is wanted as it is.
    """

    def __init__(self, bench: LinkBench) -> None:
        self.questions: list[str] = []
        self.looks = False
        self.lies: dict[str, list[str]] = {}
        self.turned = 0.0
        self._asked_at: dict[str, float] = {}
        self._marked: dict[str, float] = {}
        self._looked = ""
        self.others: dict[str, str | list[str]] = {
            "Are all wheels off the ground?": "yes",
            "One stored value differs": "n",
        }
        self.repair: Callable[[], None] | None = None
        self._bench = bench
        self._wheels = CORNERS if len(bench.robot.plant.motors) == 4 else ("left", "right")
        self._before: dict[str, float] = {}
        self._turned: tuple[str, float] | None = None

    async def line(self, question: str) -> str:
        """Answer a question."""
        self.questions.append(question)
        # No question is asked while a wheel turns.
        assert max(map(abs, self._bench.rim_speeds)) < 0.03, question
        now = self._travel()
        for name, at in self._asked_at.items():
            self.turned = max(self.turned, abs(self._turns(now[name] - at)))
        self._asked_at = now
        true = await self._true_answer(question, now)
        for start, answers in self.lies.items():
            if question.startswith(start) and answers:
                return answers.pop(0)
        if true is None:
            raise Refused(f"nothing is known of {question!r}")
        return true

    async def _true_answer(self, question: str, now: dict[str, float]) -> str | None:
        if self.looks and (answer := self._look(question, now)):
            return answer
        if found := re.match(r"Turn the (.*) wheel by hand", question):
            await self._turn_by_hand(found[1].replace(" ", "_"))
            return ""
        if question.startswith("\nEnter, and M"):
            self._before = self._travel()
            return ""
        if question.startswith("Which wheel turned?"):
            rolled = {name: now - self._before[name] for name, now in self._travel().items()}
            turned = [(name, way) for name, way in rolled.items() if abs(way) > SEEN_M]
            assert len(turned) <= 1, turned
            self._turned = turned[0] if turned else None
            return str(self._wheels.index(turned[0][0]) + 1) if turned else "0"
        if question.startswith("Which way did"):
            assert self._turned is not None
            return "f" if self._turned[1] > 0 else "b"
        if found := re.match(r"The (.*) wheel did not turn\. Which plug", question):
            name = found[1].replace(" ", "_")
            return f"m{next(w.position for w in self._bench.robot.plant.wiring if w.name == name)}"
        if found := re.match(r"Turn wheel (\d)", question):
            await self._turn_by_hand(self._wheels[int(found[1]) - 1])
            return ""
        if question.startswith("(Enter: try again"):
            if self.repair is None:
                return "w" if "w:" in question else "q"
            self.repair()
            return ""
        if question.startswith("Seen from above, do the rollers"):
            return "y" if self._bench.robot.options.sideways > 0.0 else "n"
        for start, answer in self.others.items():
            if question.startswith(start):
                if isinstance(answer, str):
                    return answer
                return answer.pop(0) if len(answer) > 1 else answer[0]
        return None

    def _look(self, question: str, now: dict[str, float]) -> str:
        """Their answer in the last look; empty for other questions."""
        if question.startswith("y, and all wheels"):
            self._marked = now
            return "y"
        moved = {name: self._turns(now[name] - at) for name, at in self._marked.items()}
        if question.startswith("Did every wheel turn forward?"):
            return "y" if all(each > 0.02 for each in moved.values()) else "n"
        if found := re.match(r"\nTurn the mark of the (.*) wheel to its top", question):
            self._marked, self._looked = now, found[1].replace(" ", "_")
            return "y"
        if question.startswith(
            ("On its way", "Is the mark at the bottom now?", "How far did the wheel turn")
        ):
            if any(name != self._looked and abs(each) > 0.02 for name, each in moved.items()):
                return "w"
            if question.startswith("How far did the wheel turn"):
                return f"{round(360.0 * moved[self._looked], -1):g}"
            if question.startswith("On its way"):
                return "y" if moved[self._looked] > 0.45 else "n"
            return "y" if abs(moved[self._looked] - 0.5) < 0.05 else "n"
        return "y" if question.startswith("Take ") else ""

    def _turns(self, travel_m: float) -> float:
        return travel_m / (2.0 * math.pi * self._bench.robot.options.wheel_radius_m)

    async def _turn_by_hand(self, name: str) -> None:
        bench = self._bench
        wire, motor = next(
            pair
            for pair in zip(bench.robot.plant.wiring, bench.robot.plant.motors, strict=True)
            if pair[0].name == name
        )
        before = motor.faults
        bench.robot.add_faults(name, MotorFaults(turning_m_s=0.2), now_ns=bench.now_ns)
        await asyncio.sleep(0.5)
        bench.robot.set_faults(name, before, now_ns=bench.now_ns)
        await asyncio.sleep(1.0)
        assert joined(HEALTHY, before) == before
        assert wire.name == name

    def _travel(self) -> dict[str, float]:
        plant = self._bench.robot.plant
        self._bench.robot.advance(self._bench.now_ns)
        return {
            wire.name: motor.travel_m
            for wire, motor in zip(plant.wiring, plant.motors, strict=True)
        }


PORT = "/tmp/board"

TWO = Given(
    profile="520", kinematics="differential", wheel_diameter_mm=67.0, wheel_separation_mm=150.0
)
FOUR = Given(
    profile="520",
    kinematics="skid_steer",
    wheel_diameter_mm=67.0,
    wheel_separation_mm=150.0,
    wheel_base_mm=150.0,
)
X3 = Given(
    profile="x3",
    kinematics="mecanum",
    wheel_diameter_mm=65.0,
    wheel_separation_mm=169.0,
    wheel_base_mm=160.0,
)


async def set_up(
    bench: LinkBench,
    given: Given,
    *,
    person: SimulatedPerson | None = None,
    by_hand: bool = False,
    config: Config | None = None,
) -> SetupOutcome:
    wizard = Wizard(
        person or SimulatedPerson(bench),
        given,
        config or Config(),
        port=PORT,
        opener=bench.open,
        clock=bench.clock,
    )
    return await wizard.find(by_hand=by_hand)


def broken(bench: LinkBench, *faults: str) -> None:
    """Start the robot with faults: `encoder-dead 2`, `crossed 1 3`."""
    bench.robot.start(bench.now_ns)
    for fault in faults:
        name, *words = fault.split()
        if name == "crossed":
            bench.robot.cross_encoders(int(words[0]), int(words[1]), now_ns=bench.now_ns)
        else:
            bench.robot.add_faults(words[0], FAULTS[name], now_ns=bench.now_ns)


def connected(found: SetupOutcome) -> dict[str, int]:
    return {motor.wheel: motor.position * motor.sign for motor in found.wiring.motors}


def true_wiring(bench: LinkBench) -> dict[str, int]:
    return {wire.name: wire.position * wire.command_sign for wire in bench.robot.plant.wiring}


def kinds(found: SetupOutcome) -> set[tuple[str, int | None]]:
    return {(fault.kind, fault.position) for fault in found.wiring.faults}


SKID_STEER = ("front_left", "rear_left", "front_right", "rear_right")


def outcome(kinematics: str = "differential", **board: object) -> SetupOutcome:
    geometry = unit_geometry(kinematics)
    wheels = SKID_STEER if geometry.sides else geometry.wheels
    board = board or {"profile": "520"}
    return SetupOutcome(
        port="/dev/ttyUSB0",
        dialect="streamed",
        description=Description(
            board=board,
            profile=PROFILES["520"],
            kinematics=kinematics,
            wheel_diameter_mm=65.0,
            wheel_separation_mm=170.0,
            wheel_base_mm=160.0 if kinematics in {"mecanum", "ackermann"} else None,
        ),
        wiring=WiringFound(
            motors=tuple(
                WiredMotor(wheel=wheel, position=position, sign=1 if position % 2 else -1)
                for position, wheel in enumerate(wheels, start=1)
            )
        ),
    )
