"""The console of a running simulation: faults and questions, one command a line.

``execute`` is pure but for the robot that it acts on; ``serve_control`` offers it on a unix socket.
Every line gets one line back: ``ok``, ``ok`` with facts, or ``error`` with the reason.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import msgspec

from yahboomd.core.clock import nanoseconds
from yahboomd.core.errors import ConfigError
from yahboomd.core.model import CHANNELS
from yahboomd.simulation.board import FlashWriter
from yahboomd.simulation.motors import FAULTS, HEALTHY
from yahboomd.simulation.robot import SimulatedRobot

Words: TypeAlias = list[str]
Command: TypeAlias = Callable[[SimulatedRobot, Words, int], str | None]
"""Carries out one command, given the words behind it and the time; returns facts, if any."""

HELP = """\
reset                    reset the board's MCU by software
brown-out [SECONDS]      take the board's supply away (0.05)
cut-writes [N]           the supply fails within each of the next N writes of the flash (1)
hang                     stop the MCU with the motors as they are, until a reset
mute SECONDS             the board's output is lost
babble SECONDS           random bytes arrive instead
stall SECONDS            the port takes no output, then all queued; answers with the end, in ns
hold SECONDS             the board's output is held, then arrives at once
unanswered WORD SHARE    this share of the answers that begin with WORD is lost
unplug [SECONDS]         pull the USB plug (and put it back after SECONDS)
replug                   put it back now
loss SHARE               this share of bytes vanishes, each way
corruption SHARE         this share of bytes arrives with a bit flipped, each way
delay SECONDS [JITTER]   every chunk waits, each way
chunk SECONDS            period in which bytes arrive; 0: each byte alone
clear                    a perfect line again
tick-period SECONDS [JITTER]  period in which the totals are renewed; 0: with every line
encoder-dead MOTOR       its counts stay
encoder-reversed MOTOR   its counts run backward
phases-swapped MOTOR     it turns the wrong way
mounted-round MOTOR      it is mounted the other way round: it turns and counts the other way
motor-dead MOTOR         it has no power; its encoder counts
stalled MOTOR            it is held
unplugged MOTOR          its cable is out
turning MOTOR [M_S]      it turns without command (0.2 m/s)
repair MOTOR             it is healthy again; until then its faults add up
crossed N M              the encoder plugs of two positions are exchanged
battery VOLTS            the battery at rest
pose                     the robot's true pose, as JSON
help                     this list
MOTOR is a name, a position from 1 to 4, or all."""


def execute(robot: SimulatedRobot, line: str, now_ns: int) -> str:
    """Carry out one line; wrong input is answered, never raised."""
    name, *words = line.split() or [""]
    command = COMMANDS.get(name)
    if command is None:
        return f"error unknown command {name!r}; try help"
    try:
        return f"ok {command(robot, words, now_ns) or ''}".rstrip()
    except KeyError as unknown:
        names = ", ".join(wire.name for wire in robot.plant.wiring)
        return f"error no motor {unknown}; there are {names}, or all"
    except (IndexError, ValueError) as mistake:
        return f"error {name} cannot be used like this ({mistake}); try help"


def _cut_writes(robot: SimulatedRobot, words: Words, _now_ns: int) -> None:
    board = robot.board if isinstance(robot.board, FlashWriter) else None
    if board is None:
        raise ValueError("not known of this board")
    board.cut_writes = int(words[0]) if words else 1


def _stall(robot: SimulatedRobot, words: Words, now_ns: int) -> str:
    for_s = _seconds(words)
    robot.stall(now_ns, for_s)
    return f"until {now_ns + nanoseconds(for_s)}"


def _unanswered(robot: SimulatedRobot, words: Words, _now_ns: int) -> None:
    start, share = words[0].encode(), float(words[1])
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"{share} is no share")
    robot.impairments.unanswered[start] = share


def _delay(robot: SimulatedRobot, words: Words, _now_ns: int) -> None:
    delay_s = _seconds(words)
    robot.impairments.change(delay_s=delay_s, jitter_s=_seconds(words[1:], 0.0))


def _fault(name: str) -> Command:
    return lambda robot, words, now_ns: robot.add_faults(words[0], FAULTS[name], now_ns=now_ns)


def _crossed(robot: SimulatedRobot, words: Words, now_ns: int) -> None:
    one, other = int(words[0]), int(words[1])
    if not (1 <= one <= CHANNELS and 1 <= other <= CHANNELS):
        raise ValueError(f"positions go from 1 to {CHANNELS}")
    robot.cross_encoders(one, other, now_ns=now_ns)


def _turning(robot: SimulatedRobot, words: Words, now_ns: int) -> None:
    faults = FAULTS["turning"]
    if len(words) > 1:
        speed_m_s = float(words[1])
        if not abs(speed_m_s) <= 100.0:
            raise ValueError(f"{speed_m_s} is out of range")
        faults = msgspec.structs.replace(faults, turning_m_s=speed_m_s)
    robot.add_faults(words[0], faults, now_ns=now_ns)


def _battery(robot: SimulatedRobot, words: Words, _now_ns: int) -> None:
    robot.plant.battery_volts = _seconds(words)


def _pose(robot: SimulatedRobot, _words: Words, now_ns: int) -> str:
    return msgspec.json.encode(robot.truth(now_ns)).decode()


def _help(_robot: SimulatedRobot, _words: Words, _now_ns: int) -> str:
    # The answer is one line, so that a script knows its end.
    return "; ".join(" ".join(line.split()) for line in HELP.splitlines())


def _seconds(words: Words, default: float | None = None) -> float:
    """The first word as a number that is not negative."""
    if not words and default is not None:
        return default
    value = float(words[0])
    if not 0.0 <= value < 1e6:
        raise ValueError(f"{value} is out of range")
    return value


COMMANDS: dict[str, Command] = {
    "reset": lambda robot, _, now_ns: robot.reset(now_ns),
    "brown-out": lambda robot, words, now_ns: robot.brown_out(now_ns, _seconds(words, 0.05)),
    "cut-writes": _cut_writes,
    "hang": lambda robot, _, now_ns: robot.hang(now_ns),
    "mute": lambda robot, words, now_ns: robot.mute(now_ns, _seconds(words)),
    "babble": lambda robot, words, now_ns: robot.babble(now_ns, _seconds(words)),
    "stall": _stall,
    "hold": lambda robot, words, now_ns: robot.hold(now_ns, _seconds(words)),
    "unanswered": _unanswered,
    "unplug": lambda robot, words, now_ns: robot.unplug(now_ns, _seconds(words) if words else None),
    "replug": lambda robot, _, now_ns: robot.replug(now_ns),
    "loss": lambda robot, words, _: robot.impairments.change(loss=float(words[0])),
    "corruption": lambda robot, words, _: robot.impairments.change(corruption=float(words[0])),
    "delay": _delay,
    "chunk": lambda robot, words, _: robot.impairments.change(chunk_s=_seconds(words)),
    "clear": lambda robot, _, __: robot.impairments.clear(),
    "tick-period": lambda robot, words, now_ns: robot.set_tick_period(
        now_ns, _seconds(words), _seconds(words[1:], 0.0)
    ),
    "turning": _turning,
    "repair": lambda robot, words, now_ns: robot.set_faults(words[0], HEALTHY, now_ns=now_ns),
    "crossed": _crossed,
    "battery": _battery,
    "pose": _pose,
    "help": _help,
    **{name: _fault(name) for name in FAULTS if name != "turning"},
}


async def serve_control(path: Path, answer: Callable[[str], str]) -> asyncio.Server:
    """Listen on a unix socket, one command a line; the caller closes the server.

    Args:
        path: The socket; one left by a killed simulator is replaced.
        answer: Carries out a line.

    Raises:
        ConfigError: ``path`` is taken by something else, or cannot be made.
    """
    _clear_away(path)

    async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while line := await reader.readline():
                writer.write(answer(line.decode(errors="replace").strip()).encode() + b"\n")
                await writer.drain()
        except (ConnectionError, ValueError):
            # The other end went away, or sent a line without an end: no answer can be sent.
            return
        finally:
            writer.close()

    try:
        return await asyncio.start_unix_server(talk, path)
    except OSError as why:
        raise ConfigError(
            f"The control socket {path} cannot be made: {why.strerror or why}."
        ) from why


def _clear_away(path: Path) -> None:
    if path.is_socket():
        path.unlink()
