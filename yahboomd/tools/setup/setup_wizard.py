"""Sets a robot up: its board first, then the person's description, then the wheels."""

from __future__ import annotations

import itertools
import os
import textwrap

import msgspec

from yahboomd.core.clock import Clock
from yahboomd.core.config import Config
from yahboomd.core.drive.kinematics import unit_geometry
from yahboomd.core.errors import BoardSilent, Refused
from yahboomd.core.link import handshake, storing
from yahboomd.core.link.conversation import Conversation
from yahboomd.core.link.line import Line
from yahboomd.core.link.port import Opener
from yahboomd.core.model import ImuReading
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.profiles import FASTEST_RATIO, MotorProfile
from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.tools.calibrate.estimates.wiring import WiringFound
from yahboomd.tools.port import probing
from yahboomd.tools.port.guarded import guarded
from yahboomd.tools.port.own_port import refuse_estop
from yahboomd.tools.port.probing import Examination
from yahboomd.tools.port.pulses import Pulses
from yahboomd.tools.probe import probe_report, probe_text
from yahboomd.tools.probe.probe_write import Printed
from yahboomd.tools.setup.board_law import drivable
from yahboomd.tools.setup.description import Description, Given, ask_motors, ask_robot
from yahboomd.tools.setup.last_look import FITS, GearSeen, LastLook
from yahboomd.tools.setup.motor_turns import MOTOR_TURNS_PER_S, ByHand, ByOutput, UnwiredRobot
from yahboomd.tools.setup.outcome import SetupOutcome
from yahboomd.tools.setup.robot_drawing import wheels_of
from yahboomd.tools.setup.robot_file import as_config
from yahboomd.tools.stop import diagnosis
from yahboomd.tools.terminal.terminal_questions import (
    WIDTH,
    Respondent,
    agrees,
    say,
    say_heading,
    say_points,
)

MIRRORED = (
    "Exchange the left and the right wheel of each axle: seen from above the rollers must form an "
    "X. As they are, the robot goes to the wrong side and hardly turns."
)
RESEND_S = 0.1
"""The period in which an output is repeated: the board may lose a frame."""


class Wizard:
    """The setup of one robot."""

    def __init__(
        self,
        person: Respondent,
        given: Given,
        config: Config,
        *,
        port: str,
        opener: Opener,
        clock: Clock,
    ) -> None:
        self._person = person
        self._given = given
        self._config = config
        self._port = port
        self._opener = opener
        self._clock = clock
        self._settings: BoardSettings | None = None
        self._volts: float | None = None
        self._imu = ""

    async def find(self, *, by_hand: bool) -> SetupOutcome:
        """Ask for the robot's description, and find out how its motors are connected.

        Args:
            by_hand: Turn no motor, even if the board could.

        Raises:
            Refused: The emergency stop is engaged, or the person ended it.
            LinkError: The port or the board cannot be used.
            BoardError: The board cannot be driven as it is, or a wheel does not stop.
        """
        self._may_turn()
        dialect, found = await self._examine({})
        report = self._report(found, self._config.profile(), {})
        for line in itertools.takewhile(bool, probe_text.text(report)):
            say(line)
        say_points(report.advice)
        say_heading("The motors")
        board, profile = await ask_motors(self._person, self._given, dialect, found.settings)
        await self._fit(dialect, found, profile)
        description = await ask_robot(self._person, self._given, board, profile)
        wheels = wheels_of(unit_geometry(description.kinematics))
        ways = drivable(dialect, self._settings, as_config(description, wheels), wheels)
        if by_hand or not dialect.most_output:
            say_heading("The wheels")
            say("No motor is turned." if by_hand else "This board takes speeds only.")
        else:
            await self._lifted()
        wiring, gear = await self._connected(
            UnwiredRobot(description=description, wheels=wheels, ways=ways),
            by_hand=by_hand or not dialect.most_output,
        )
        description, gear = await self._geared(description, gear)
        holonomic = unit_geometry(description.kinematics).holonomic
        return SetupOutcome(
            port=self._port,
            dialect=dialect.name,
            description=description,
            wiring=wiring,
            gear=gear,
            imu=self._imu,
            rollers=await self._rollers() if holonomic else "",
        )

    def _may_turn(self) -> None:
        refuse_estop(self._port, self._config, os.environ)

    # The board.

    async def _examine(self, want: BoardSettings) -> tuple[Dialect, Examination]:
        found = await probing.examine(self._opener, self._clock, want)
        if found.dialect is None:
            remedy = diagnosis.what_was_heard(found.heard, found.readers)
            raise BoardSilent(f"{self._port}: no board answers.", remedy=remedy)
        self._settings = found.settings
        self._volts = found.volts
        return found.dialect, found

    def _report(
        self, found: Examination, profile: MotorProfile, want: BoardSettings
    ) -> probe_report.Report:
        return probe_report.report(
            found,
            None,
            port=self._port,
            device=os.path.realpath(self._port),
            profile=profile,
            want=want,
            wanted_dialect=self._config.serial.dialect,
        )

    async def _geared(
        self, description: Description, gear: GearSeen
    ) -> tuple[Description, GearSeen]:
        """The description with the motors that fit the gear found, if the person agrees."""
        if gear.words:
            say(f"\n{textwrap.fill(gear.words, WIDTH)}")
        if (ticks := gear.ticks_per_revolution) is not None:
            if not await agrees(self._person, f"Write {ticks:g} counts to a turn?"):
                return description, gear
            return msgspec.structs.replace(description, ticks_per_revolution=ticks), FITS
        profile = gear.profile
        if profile is None or not await agrees(self._person, f"Take {profile.name}?"):
            return description, gear
        dialect, found = await self._examine(profile.settings)
        await self._fit(dialect, found, profile)
        board = {"profile": profile.name}
        return msgspec.structs.replace(description, board=board, profile=profile), FITS

    async def _fit(self, dialect: Dialect, found: Examination, profile: MotorProfile) -> None:
        """Show the board's settings, and store those that these motors need if the person agrees.

        Raises:
            Refused: The board must not drive these motors as it is set up.
        """
        report = self._report(found, profile, profile.settings)
        if report.settings:
            if self._given.profile is None:
                say()
            title = f"profile {report.profile}"
            for line in probe_text.table(report.settings, dialect.settings, title):
                say(line)
        if report.differing:
            say()
            say_points(report.problems)
            count = len(report.differing)
            values = "One stored value differs" if count == 1 else f"{count} stored values differ"
            need = "No motor may turn before." if report.problems else "It does no harm."
            if await agrees(self._person, f"{values}. {need} Store the profile's in the board?"):
                await storing.store(self._opener, self._clock, profile.settings, Printed())
                _, found = await self._examine(profile.settings)
                report = self._report(found, profile, profile.settings)
        if report.problems:
            raise Refused(f"No motor is turned like this. {' '.join(report.problems)}")

    # The wheels.

    async def _lifted(self) -> None:
        say_heading("The wheels")
        say("Lift the robot: every wheel must turn freely, with nothing to be caught in it.")
        say("Keep a hand near the switch of the motors' supply.")
        if not await agrees(
            self._person, "Are all wheels off the ground? Type yes:", hint="", blank=None
        ):
            raise Refused("No motor was turned, and nothing was written.")

    async def _connected(
        self, robot: UnwiredRobot, *, by_hand: bool
    ) -> tuple[WiringFound, GearSeen]:
        person, profile = self._person, robot.description.profile
        port = await self._opener()
        line = Line(port, self._clock, resend_s=RESEND_S)
        line.on_imu = self._on_imu
        async with guarded(line, say) as guard, line.attended():
            talk = await Conversation.begin(line)
            # The motors have no power, and a brake would start the board's speed loop.
            line.let_go = True
            await handshake.await_reports(line, talk.dialect)
            if by_hand:
                return await ByHand(talk, person, robot).find(), GearSeen()
            await guard.watch_over(talk.dialect)
            pulses = Pulses(
                line,
                talk.dialect,
                self._settings or {},
                ticks_per_revolution=profile.ticks_per_revolution,
                fastest_turns_per_s=MOTOR_TURNS_PER_S / min(profile.ratio, FASTEST_RATIO),
                least_ticks=profile.least_ticks_per_revolution,
                on_pulse=guard.mark,
            )
            by_output = ByOutput(talk, pulses, person, robot, self._may_turn, volts=self._volts)
            last_look = LastLook(pulses, person, profile, self._may_turn)
            while True:
                wiring = await by_output.find()
                gear = GearSeen() if wiring.faults else await last_look.look(wiring)
                if gear is not None:
                    return wiring, gear

    async def _rollers(self) -> str:
        """What to repair about the rollers, which no counter shows."""
        say_heading("The rollers")
        question = "Seen from above, do the rollers of the four wheels form an X? [y/n]"
        try:
            crossed = await agrees(self._person, question, hint="", blank=None)
        except Refused:
            # The input has ended.
            return ""
        return "" if crossed else MIRRORED

    def _on_imu(self, reading: ImuReading) -> None:
        self._imu = reading.sensor.name
