"""How the motors of a robot are connected, from one turn of each. Pure.

Each motor was given a positive output for a moment. A person saw which wheel turned, and which way;
the counters saw which encoder turned, and which way. If a motor, its counts and its plug agree but
the wheel went backward, the motor is mounted the other way round, and two signs in the
configuration correct that. If they do not agree, the board's own speed loop would drive that wheel
as fast as it can: then a plug has to be changed, and the fault names it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal, TypeAlias

import msgspec

from yahboomd.core.model import Counts

Kind: TypeAlias = Literal[
    "encoder_crossed", "encoder_swapped", "encoder_dead", "motor_dead", "motor_misplaced"
]

MOVED_TURNS = 0.01
"""Less than this may be the play of the gears."""

TWO_CELLS_V, FULL_CELL_V = 8.8, 3.8

ALIKE = 0.3
"""A counter with at least this share of the largest movement was moved by the same pulse."""


class MotorTurn(msgspec.Struct, frozen=True, kw_only=True):
    """One motor's turn, by the counters and by the person.

    Attributes:
        position: The plug that was given a positive output, 1 to 4.
        counts: The change of each counter.
        wheel: The wheel that the person saw turn; empty for none.
        forward: Whether it turned as it does when the robot drives forward.
    """

    position: int
    counts: Counts
    wheel: str = ""
    forward: bool = True


class HandTurn(msgspec.Struct, frozen=True, kw_only=True):
    """One wheel that a person turned forward by hand."""

    wheel: str
    counts: Counts


class WiredMotor(msgspec.Struct, frozen=True, kw_only=True):
    """A motor as configured once every fault is repaired.

    Attributes:
        position: Its plug on the board, 1 to 4.
        sign: -1 for one that is mounted the other way round: both signs of the configuration.
    """

    wheel: str
    position: int
    sign: int


class WiringFault(msgspec.Struct, frozen=True):
    """A fault that no configuration can correct.

    Attributes:
        kind: Its name, for programs.
        position: The plug of the motor; None if it is not known.
        words: The fault, and the plug to change.
        arrives: For ``encoder_crossed``, the position that receives this motor's counts; for
            ``motor_misplaced``, the plug that it belongs in.
    """

    kind: Kind
    position: int | None
    wheel: str
    words: str
    arrives: int | None = None


class WiringFound(msgspec.Struct, frozen=True, kw_only=True):
    """The verdict.

    Attributes:
        motors: The motors that were seen to turn, in the order of the wheels.
        missing: Wheels whose motor was not seen to turn: nothing can be configured without them.
        again: Positions (or, by hand, none) whose answers contradict each other.
        doubts: The contradictions, in words.
        hint: A single cause that would explain all faults; empty for none.
    """

    motors: tuple[WiredMotor, ...]
    faults: tuple[WiringFault, ...] = ()
    missing: tuple[str, ...] = ()
    again: tuple[int, ...] = ()
    doubts: tuple[str, ...] = ()
    hint: str = ""


def plain(wheel: str) -> str:
    """The name of a wheel for people."""
    return wheel.replace("_", " ")


def judge(
    turns: Sequence[MotorTurn],
    wheels: Sequence[str],
    ticks_per_revolution: float,
    plugs: Mapping[str, int] | None = None,
    *,
    by_hand: Mapping[str, bool] | None = None,
    volts: float | None = None,
) -> WiringFound:
    """Find positions, signs and faults.

    Args:
        turns: One for each position of the board.
        plugs: For wheels that did not turn, their motor's plug according to the person.
        by_hand: For wheels that did not turn with full output, whether a counter moved when they
            were turned by hand.
        volts: The supply; None if the board does not report it.
    """
    moved = {turn.position: turn for turn in turns if turn.wheel}
    still = [turn for turn in turns if not turn.wheel]
    missing = tuple(wheel for wheel in wheels if wheel not in {t.wheel for t in moved.values()})
    least = MOVED_TURNS * ticks_per_revolution
    seen_at = {position: _channel(turn, least) for position, turn in moved.items()}
    doubts = dict(_doubts(moved, still, seen_at, least))
    by_wheel = sorted(moved.values(), key=lambda turn: (*wheels, turn.wheel).index(turn.wheel))
    faults = [fault for turn in by_wheel for fault in _encoder_faults(turn, seen_at)]
    faults += _dead_motors(
        missing, [turn.position for turn in still], plugs or {}, by_hand or {}, volts
    )
    swapped = [fault for fault in faults if fault.kind == "encoder_swapped"]
    return WiringFound(
        motors=tuple(
            WiredMotor(wheel=turn.wheel, position=turn.position, sign=1 if turn.forward else -1)
            for turn in by_wheel
        ),
        faults=tuple(faults),
        missing=missing,
        again=tuple(sorted({position for at in doubts for position in at})),
        doubts=tuple(doubts.values()),
        hint=_ALL_SWAPPED if len(swapped) == len(moved) > 1 else "",
    )


def judge_by_hand(turns: Sequence[HandTurn], ticks_per_revolution: float) -> WiringFound:
    """Find the positions and the signs of the encoders from turns by hand.

    Motor and encoder share a plug, so each motor is assumed to be in its encoder's plug, and
    mounted the way its encoder counts. Its power may still disagree: only driving it shows that.

    Args:
        turns: One for each wheel.
    """
    least = MOVED_TURNS * ticks_per_revolution
    motors, faults, missing = [], [], []
    for turn in turns:
        channel = _strongest(turn.counts, least)
        if channel is None:
            missing.append(turn.wheel)
            words = (
                f"{plain(turn.wheel).capitalize()}: no counter moved while this wheel was turned. "
                "Look at the plug of its encoder, at both ends."
            )
            faults.append(WiringFault("encoder_dead", None, turn.wheel, words))
            continue
        sign = 1 if turn.counts[channel - 1] > 0 else -1
        motors.append(WiredMotor(wheel=turn.wheel, position=channel, sign=sign))
    doubts = [
        f"{plain(one.wheel).capitalize()} and {plain(other.wheel)} moved the same counter, that of "
        f"M{one.position}: turn one wheel at a time."
        for number, one in enumerate(motors)
        for other in motors[number + 1 :]
        if one.position == other.position
    ]
    return WiringFound(
        motors=tuple(motors), faults=tuple(faults), missing=tuple(missing), doubts=tuple(doubts)
    )


def _strongest(counts: Counts, least: float) -> int | None:
    """The position whose counter moved most; None if none moved."""
    most = max(counts, key=abs)
    return counts.index(most) + 1 if abs(most) >= least else None


def _channel(turn: MotorTurn, least: float) -> int | None:
    """The position at which the counts of a motor arrive; its own if that moved enough, too."""
    strongest = _strongest(turn.counts, least)
    if strongest is None:
        return None
    own = abs(turn.counts[turn.position - 1])
    return turn.position if own >= ALIKE * abs(turn.counts[strongest - 1]) else strongest


def _doubts(
    moved: Mapping[int, MotorTurn],
    still: Iterable[MotorTurn],
    seen_at: Mapping[int, int | None],
    least: float,
) -> Iterator[tuple[tuple[int, ...], str]]:
    """Answers that contradict each other or the counters, with the positions to try again."""
    positions = sorted(moved)
    for number, one in enumerate(positions):
        for other in positions[number + 1 :]:
            wheel = moved[one].wheel
            if wheel == moved[other].wheel:
                words = f"M{one} and M{other} both turned {plain(wheel)}, as you saw it."
                yield (one, other), words
            elif seen_at[one] is not None and seen_at[one] == seen_at[other]:
                words = f"M{one} and M{other} moved the same counter, that of M{seen_at[one]}."
                yield (one, other), words
    for turn in still:
        if _strongest(turn.counts, least) is not None:
            yield (turn.position,), f"M{turn.position} moved a counter, and you saw no wheel turn."


def _encoder_faults(turn: MotorTurn, seen_at: Mapping[int, int | None]) -> Iterator[WiringFault]:
    position, wheel, name = turn.position, turn.wheel, plain(turn.wheel)
    channel = seen_at[position]
    if channel is None:
        words = (
            f"M{position} ({name}): the wheel turns and is not counted. Look at the plug of its "
            "encoder, at the board and at the motor; else the encoder is broken."
        )
        yield WiringFault("encoder_dead", position, wheel, words)
        return
    if channel != position:
        also = seen_at.get(channel) == position
        words = (
            f"The encoder plugs of M{min(position, channel)} and M{max(position, channel)} are "
            "crossed: exchange them."
            if also
            else f"M{position} ({name}): its counts arrive at M{channel}. Plug its encoder into "
            f"M{position}."
        )
        # One sentence is enough for a pair.
        if not also or position < channel:
            yield WiringFault("encoder_crossed", position, wheel, words, channel)
    if turn.counts[channel - 1] < 0:
        words = (
            f"M{position} ({name}): its encoder counts against the motor. Exchange the two signal "
            f"wires of its encoder, A and B, at the plug of M{position}."
        )
        yield WiringFault("encoder_swapped", position, wheel, words)


def _dead_motors(
    missing: Sequence[str],
    still: Sequence[int],
    plugs: Mapping[str, int],
    by_hand: Mapping[str, bool],
    volts: float | None,
) -> Iterator[WiringFault]:
    # The last motor and the last plug belong together.
    only = still[0] if len(missing) == len(still) == 1 else None
    for wheel in missing:
        position = plugs.get(wheel) or only
        where = f"M{position} ({plain(wheel)})" if position else plain(wheel).capitalize()
        counted = by_hand.get(wheel)
        if counted is None:
            words = (
                f"{where}: the motor did not turn. Look at its plug, at the board and at the "
                "motor, and whether the wheel is blocked."
            )
        elif not counted:
            words = (
                f"{where}: the motor did not turn, and no counter moved when you turned the wheel. "
                "Look at the plug that has its motor and its encoder, at the board and at the "
                "motor."
            )
        elif charged(volts):
            words = (
                f"{where}: the motor did not turn with full output, and its encoder counts by "
                "hand. Look at the motor's two wires; else motor or driver are broken."
            )
        else:
            words = (
                f"{where}: the motor did not turn with full output, and its encoder counts by "
                f"hand. {stiff(volts)} Charge the battery, and see that the wheel turns freely; "
                "else look at the motor's two wires. `yahboomd setup --by-hand` goes on without "
                "turning motors."
            )
        yield WiringFault("motor_dead", position, wheel, words)


def charged(volts: float | None) -> bool:
    """Whether a battery of two or three lithium cells is about full."""
    return volts is not None and volts / (2 if volts < TWO_CELLS_V else 3) >= FULL_CELL_V


def stiff(volts: float | None) -> str:
    """Why a healthy motor may not turn, in a sentence."""
    return f"It is stiff, or the battery is low{'' if volts is None else f' ({volts:.1f} V)'}."


_ALL_SWAPPED = (
    "Every encoder counts against its motor: rather than all plugs, the motor type that the board "
    "stores may be wrong. `yahboomd probe` shows it."
)
