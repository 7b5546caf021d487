"""The findings on a robot, for programs, and the next steps for its owner. Pure."""

from __future__ import annotations

import textwrap
from pathlib import Path

import msgspec

from yahboomd.core.program import pasteable
from yahboomd.tools.calibrate.estimates.wiring import WiringFound, plain
from yahboomd.tools.setup.description import Description
from yahboomd.tools.setup.last_look import GearSeen


class SetupOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """A robot that was set up.

    Attributes:
        dialect: The board's protocol.
        gear: Whether the wheels turn as far as counted.
        imu: The board's inertial sensor; empty for none.
        rollers: What to repair about the rollers of mecanum wheels.
    """

    port: str
    dialect: str
    description: Description
    wiring: WiringFound
    gear: GearSeen = GearSeen()
    imu: str = ""
    rollers: str = ""


def result(found: SetupOutcome, path: Path) -> str:
    """The outcome as one line of JSON."""
    facts = {
        "file": str(path),
        "port": found.port,
        "dialect": found.dialect,
        "profile": found.description.profile.name,
        "kinematics": found.description.kinematics,
        "motors": found.wiring.motors,
        "faults": found.wiring.faults,
        "gear": found.gear.verdict,
        "imu": found.imu or None,
        "rollers": found.rollers or None,
    }
    return msgspec.json.encode(facts).decode()


def next_steps(found: SetupOutcome, path: Path) -> str:
    """How the motors are connected, and the commands to run next."""
    lines = [f"\n{path} is written."]
    for motor in found.wiring.motors:
        way = ", mounted the other way round" if motor.sign < 0 else ""
        lines.append(f"  {plain(motor.wheel):<12} M{motor.position}{way}")
    for words in filter(bool, (found.gear.words, found.rollers)):
        lines += ["", *textwrap.wrap(words, 96)]
    lines.append("")
    if found.wiring.faults:
        lines += ["Repair these faults first: the daemon cuts a wheel that does not obey.", ""]
    commands = [
        (f"yahboomd config check --config {path}", "explains the file"),
        (f"yahboomd run --config {path}", "the daemon"),
        ("yahboomd drive --linear 0.1", "in a second terminal: slowly, with the keyboard"),
    ]
    if found.imu:
        commands.append(("yahboomd calibrate imu", f"how the board's {found.imu} is mounted"))
    commands.append(("yahboomd calibrate tape", "on the ground: the last per cent"))
    shown = [(pasteable(command), words) for command, words in commands]
    width = max(len(command) for command, _ in shown)
    lines.append("Next, with the wheels still off the ground:")
    lines += [f"  {command:<{width}}   {words}" for command, words in shown]
    return "\n".join(lines)
