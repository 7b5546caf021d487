"""``yahboomd simulate`` with one more fault, for trials with a polled board.

    python -m benchmarks.garbling --link PATH ...

Its options are those of ``yahboomd simulate``. On its control socket ``garble`` alters one digit of
the board's next answer and nothing else. The frame stays well formed and has no checksum, so the
error shows only in the meaning of the counts.
"""

from __future__ import annotations

import re
import sys

from yahboomd.cli.main import main
from yahboomd.simulation import console
from yahboomd.simulation.robot import SimulatedRobot

DIGIT = re.compile(rb"\d")


def altered(answer: bytes) -> bytes:
    """The answer with the lowest bit of its first digit flipped: the first wheel's leading one."""
    # Flipping the lowest bit of a digit always leaves a digit: 0 and 1, 2 and 3, ... 8 and 9.
    return DIGIT.sub(lambda digit: bytes([digit[0][0] ^ 1]), answer, count=1)


def garble(robot: SimulatedRobot, _words: list[str], _now_ns: int) -> str:
    """Alter the next answer."""
    emit = robot.board.emit

    def once(data: bytes, at_ns: int) -> None:
        robot.board.emit = emit
        emit(altered(data), at_ns)

    robot.board.emit = once
    return ""


if __name__ == "__main__":
    console.COMMANDS["garble"] = garble
    sys.exit(main(["simulate", *sys.argv[1:]]))
