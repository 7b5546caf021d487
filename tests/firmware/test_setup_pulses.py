"""The half-turn law of `setup` on the vendor's firmware: wheels are judged by their true turns."""

from __future__ import annotations

import asyncio
import itertools
import math
from typing import Any

import pytest
from board_bench import LinkBench
from vendor_firmware import MOTORS, ON_THE_FIRMWARE, STICKING, of_all

from yahboomd.core.errors import BoardError
from yahboomd.core.link import handshake
from yahboomd.core.link.conversation import Conversation
from yahboomd.core.link.line import Line
from yahboomd.core.model import NS_PER_S
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.motors import FAULTS, PWM_MAX
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.port.board_questions import read_counters
from yahboomd.tools.port.pulses import SHOWN_TURNS, Pulses

pytestmark = ON_THE_FIRMWARE

TURN_M = 2.0 * math.pi * 0.0335
FASTEST_M_S = 550.0 / 60.0 * TURN_M
"""A motor of 550 rev/min."""


async def turned(
    dead_zone: int, motor: dict[str, Any], *, dead: bool = False, fails: bool = False
) -> tuple[list[float], bool]:
    """The true turns of the wheel in each pulse of a call, and whether it was seen to turn.

    Args:
        dead: Its encoder counts nothing.
        fails: Its encoder fails after the call, and what is returned is the next one's, an advance.
    """
    board = LinkBench(flash=FlashContent(dead_zone=dead_zone), **motor)
    board.robot.start(round(asyncio.get_running_loop().time() * NS_PER_S))
    if dead:
        board.robot.set_faults("all", FAULTS["encoder-dead"], now_ns=0)
    travel: list[float] = []

    def mark(_on: bool) -> None:
        travel.append(board.robot.plant.motors[0].travel_m / TURN_M)

    line = Line(await board.open(), board.clock, resend_s=0.1)
    async with line.attended():
        talk = await Conversation.begin(line)
        await read_counters(talk)
        await handshake.await_reports(line, talk.dialect)
        profile = PROFILES["520"]
        stored = await talk.read_settings(profile.settings) or {}
        pulses = Pulses(
            line,
            talk.dialect,
            stored,
            ticks_per_revolution=profile.ticks_per_revolution,
            fastest_turns_per_s=200.0 / 19.0,
            least_ticks=profile.least_ticks_per_revolution,
            on_pulse=mark,
        )
        pulse = await pulses.turn(1)
        if fails:
            travel.clear()
            board.robot.set_faults("all", FAULTS["encoder-dead"], now_ns=board.clock.now_ns())
            await pulses.advance({1: 1}, pulses.most_counts)
    assert [each.pwm for each in board.robot.plant.motors] == [0, 0]
    turns = [abs(end - start) for start, end in zip(travel[::2], travel[1::2], strict=True)]
    return turns, pulse.turns >= SHOWN_TURNS


KINDS = {
    **MOTORS,
    "40 %, twice the friction": {**MOTORS["40 %"], "motor_dead_zone": round(0.8 * PWM_MAX)},
    "35 %, 550 rev/min": {**MOTORS["35 %, quick"], "max_speed_m_s": FASTEST_M_S},
}

TRIED = {**KINDS, **STICKING}

DEAD_ZONES = (0, 1600, 1900, 2150)


@pytest.mark.parametrize(
    ("dead", "dead_zone", "motor"),
    [
        *of_all(itertools.product([False, True], DEAD_ZONES, KINDS), every=5),
        *itertools.product([False, True], (0, 1600), STICKING),
    ],
)
@on_virtual_time
async def test_no_wheel_turns_more_than_half_a_turn_in_a_pulse_and_one_in_all(
    motor: str, dead_zone: int, dead: bool
) -> None:
    turns, seen = await turned(dead_zone, TRIED[motor], dead=dead)

    assert max(turns) <= 0.5
    assert sum(turns) <= 1.0
    # The stiffest one does not turn within that, which setup reports.
    assert seen == (not dead and "friction" not in motor)


@pytest.mark.parametrize(
    ("dead_zone", "motor"),
    [
        *of_all(itertools.product(DEAD_ZONES, [*MOTORS, "35 %, 550 rev/min"]), every=5),
        *itertools.product((1600,), STICKING),
    ],
)
@on_virtual_time
async def test_an_encoder_that_fails_after_its_motor_was_tried_lets_it_turn_once_at_most(
    motor: str, dead_zone: int
) -> None:
    turns, _ = await turned(dead_zone, TRIED[motor], fails=True)
    assert max(turns) <= 0.5
    assert sum(turns) <= 1.0


@pytest.mark.parametrize("dead_zone", [2160, 2300, 3600])
@on_virtual_time
async def test_a_dead_zone_whose_least_output_is_too_much_is_named_and_nothing_turns(
    dead_zone: int,
) -> None:
    with pytest.raises(BoardError, match=f"stores a dead zone of {dead_zone}"):
        await turned(dead_zone, KINDS["35 %, 550 rev/min"])
