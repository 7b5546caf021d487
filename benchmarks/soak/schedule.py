"""All faults, and their order on each board."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from random import Random

import msgspec

from benchmarks.soak import attacks, delays, injections
from benchmarks.soak.course import Course

Fault = Callable[[Course], None]

FAULTS: dict[str, Fault] = {
    "e-stop": injections.estop,
    "command silence": injections.silence,
    "client killed": injections.client_killed,
    "flood": injections.flood,
    "short mute": injections.mute_short,
    "long mute": injections.mute_long,
    "babble": injections.babble,
    "short unplug": injections.unplug_short,
    "long unplug": injections.unplug_long,
    "byte loss": injections.loss,
    "corruption": injections.corruption,
    "jitter": injections.jitter,
    "encoder dead": injections.encoder_dead,
    "encoder reversed": injections.encoder_reversed,
    "motor unplugged": injections.motor_unplugged,
    "wheel stalled": injections.stalled,
    "wheel turned": injections.turning,
    "frozen process": delays.frozen,
    "frozen with a full buffer": delays.frozen_full,
    "burst": delays.burst,
    "another tick": delays.another_tick,
    "lost answers": delays.lost_answers,
    "output stall": delays.output_stall,
    "e-stop in an output stall": delays.estop_in_output_stall,
    "flood of the e-stop's key": attacks.key_flood,
    "attachments": attacks.attachments,
}
"""Faults that daemon and board survive."""

RESETS: dict[str, Fault] = {
    "board reset": injections.reset,
    "brown-out": injections.brown_out,
    "dip of the supply": injections.dip,
    "reset loop": injections.reset_loop,
    "board hangs": injections.board_hangs,
}
"""Faults after which the board counts from zero."""

ENDING: dict[str, Fault] = {
    "SIGTERM": injections.sigterm,
    "SIGTERM in an output stall": delays.sigterm_in_output_stall,
    "SIGKILL": injections.sigkill,
    "damaged rings": injections.damaged_rings,
    "recorders fail": injections.recorders_fail,
    "SIGSTOP": injections.sigstop,
    "another signal": attacks.other_signal,
}
"""Faults that end the daemon."""

SHOWN = frozenset(
    {
        *("encoder dead", "encoder reversed", "motor unplugged", "wheel stalled", "wheel turned"),
        *RESETS,
    }
)
"""Faults in which wheels really move as reported, or a board that forgot its motors turns
none."""

DIALECTS = ("streamed", "polled", "rosmaster")

WITHOUT: dict[str, frozenset[str]] = {
    "streamed": frozenset(),
    "polled": frozenset({"another tick"}),
    "rosmaster": frozenset({"another tick", "lost answers"}),
}
"""Faults that a board cannot have, because it has no such tick or question."""


class Turn(msgspec.Struct, frozen=True, kw_only=True):
    """One fault of the schedule."""

    kind: str
    fault: Fault


class Segment(msgspec.Struct, frozen=True, kw_only=True):
    """The faults of one board."""

    dialect: str
    turns: list[Turn]


def segments(random: Random, kinds: list[str], dialects: Sequence[str]) -> Iterator[Segment]:
    """Every fault on all dialects, again and again, in random order.

    A board takes half of the faults; the next one, of another dialect, takes the other half; then
    the halves change places. A board's resets come last, because after one its counts are near
    zero, and travel that was not heard can no longer be distinguished from a reset. Faults that end
    the daemon come in every other such cycle, so that it lives long enough in between for its
    memory to mean something.

    Args:
        random: Shuffles the faults.
        kinds: Only these; empty for all.
        dialects: The dialects of the boards.
    """
    cycle = 0
    while True:
        ending = ENDING if cycle % 2 == 0 or kinds else {}
        every = [
            Turn(kind=kind, fault=fault)
            for kind, fault in {**FAULTS, **ending, **RESETS}.items()
            if not kinds or kind in kinds
        ]
        random.shuffle(every)
        halves = [every[0::2], every[1::2]]
        for number in range(2 * len(dialects)):
            half = halves[(number + number // len(dialects)) % 2]
            random.shuffle(half)
            half.sort(key=lambda turn: turn.kind in RESETS)
            dialect = dialects[number % len(dialects)]
            turns = [turn for turn in half if turn.kind not in WITHOUT[dialect]]
            if turns:
                yield Segment(dialect=dialect, turns=turns)
        cycle += 1
