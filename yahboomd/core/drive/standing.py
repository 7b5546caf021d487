"""Explains why the robot does not move, which is a person's first question.

It gives all reasons, in the order in which a person has to deal with them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal, TypeAlias

from yahboomd.core.drive.arbitration import Decision
from yahboomd.core.drive.holds import BOARD_UNFIT, FAULT, WAITING_FOR_BOARD, Hold
from yahboomd.core.model import Cause
from yahboomd.core.names import source_words
from yahboomd.core.standstill import STANDING_M_S

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from yahboomd.core.drive.estop import Latched
    from yahboomd.core.drive.limiter import AxisCaps

State: TypeAlias = Literal["waiting", "standing", "driving", "stopping", "estopped", "fault"]

SLOW_RAD_S = 0.1
"""A base that turns slower than this seems to stand."""

MAY_TURN = "The wheels may still turn: switch the motors' supply off."
"""The first words while a board is out of reach whose wheels turned when they were last seen."""


def reasons(
    now_ns: int,
    *,
    decision: Decision,
    latched: Latched | None = None,
    holds: Sequence[Hold] = (),
    refused: Mapping[str, int] | None = None,
    linear: AxisCaps | None = None,
    angular: AxisCaps | None = None,
    holonomic: bool = True,
    release: str = "yahboomd stop --release",
    unseen: bool = False,
    battery: str = "",
) -> tuple[Cause, ...]:
    """Every reason why the robot stands; while it may drive, who drives.

    Args:
        refused: The number of recently refused commands, by reason.
        holonomic: Whether the base can move sideways.
        release: The command that lets this robot, and no other, drive again.
        unseen: The wheels may turn, and no count shows it.
        battery: What an empty battery forbids.
    """
    found = list[Cause]()
    if latched is not None:
        ago = _seconds(now_ns - latched.since_ns)
        words = f"Emergency stop, engaged by {latched.by} {ago} ago: {latched.reason}."
        found.append(Cause("estop", words))
    found += [
        Cause(hold.kind, _held(now_ns, hold))
        for hold in sorted(holds, key=lambda hold: hold.kind != FAULT)
    ]
    if {"estop", FAULT} & {each.kind for each in found}:
        found.append(Cause("release", f"To drive again: `{release}`."))
    if words := _not_commanded(decision):
        lost = decision.why == "no_command" and decision.source is not None
        found.append(Cause("lost" if lost else decision.why, words))
    elif words := _impossible(decision, linear, angular, holonomic=holonomic):
        found.append(Cause("cannot", words))
    # Refusals explain a standing robot; a driving one obeys other commands.
    if refused and found:
        listed = ", ".join(f"{count} {reason}" for reason, count in sorted(refused.items()))
        found.append(Cause("refused", f"Commands refused lately: {listed}."))
    if not found:
        found.append(Cause("driving", f"{source_words(decision.driver)} drives."))
    around = Cause("wheels", MAY_TURN if unseen else ""), *found, Cause("battery", battery)
    return tuple(each for each in around if each.text)


def why(found: Sequence[Cause]) -> str:
    """The reasons as one text."""
    return " ".join(each.text for each in found)


def state_of(
    *,
    decision: Decision,
    latched: Latched | None = None,
    holds: Sequence[Hold] = (),
    stop_waits: bool = False,
    in_motion: bool,
) -> State:
    """The state in the status; if several apply, the one that needs a person first.

    Args:
        stop_waits: The stop of the latch, or of a fault, has not left this machine yet.
        in_motion: Wheels turn, or are commanded to.
    """
    kinds = {hold.kind for hold in holds}
    if stop_waits and (latched is not None or FAULT in kinds):
        return "stopping"
    if latched is not None:
        return "estopped"
    if FAULT in kinds or BOARD_UNFIT in kinds:
        return "fault"
    if WAITING_FOR_BOARD in kinds:
        return "waiting"
    if decision.why == "driving" and not kinds:
        return "driving"
    return "stopping" if in_motion else "standing"


def _held(now_ns: int, hold: Hold) -> str:
    until = "" if hold.until_ns is None else f", for another {_seconds(hold.until_ns - now_ns)}"
    return f"{hold.message} (since {_seconds(now_ns - hold.since_ns)}{until})"


def _not_commanded(decision: Decision) -> str:
    source, driver = source_words(decision.source), source_words(decision.driver)
    age = "" if decision.age_ns is None else f" {_seconds(decision.age_ns)} ago"
    match decision.why:
        case "no_command" if decision.source is not None:
            return f"{source} drove and was lost{age}: its client left the bus."
        case "no_command":
            return "No source commands motion."
        case "ended":
            return f"{source} ended with a zero command{age}."
        case "timed_out":
            return f"{source} fell silent after its last command{age}."
        case "revoked":
            return f"Held-up commands of {decision.source or 'a source'} were dropped."
        case "zero_command":
            return f"{driver} commands zero and keeps control."
        case _:
            return ""


def _impossible(
    decision: Decision,
    linear: AxisCaps | None,
    angular: AxisCaps | None,
    *,
    holonomic: bool,
) -> str:
    """Explain a wish that the limits and the geometry reduce to nothing."""
    twist = decision.twist
    straight = linear is None or linear.velocity != 0.0
    turning = angular is None or angular.velocity != 0.0
    left = (
        twist.vx if straight else 0.0,
        twist.vy if straight and holonomic else 0.0,
        twist.wz if turning else 0.0,
    )
    if any(left):
        return _crawling(decision, linear, angular)
    driver = source_words(decision.driver)
    if not holonomic and twist.vx == 0.0 and twist.wz == 0.0:
        return f"{driver} commands sideways motion, which this base cannot do."
    allowed = {"limits.linear": straight, "limits.angular": turning}
    zeros = " and ".join(name for name, may in allowed.items() if not may)
    return f"{driver} commands motion that {zeros}.velocity = 0 forbids."


def _crawling(decision: Decision, linear: AxisCaps | None, angular: AxisCaps | None) -> str:
    """Explain limits that reduce a wish until the robot seems to stand."""
    twist, found = decision.twist, list[str]()
    for name, unit, wish, limits, slow in (
        ("linear", "m/s", math.hypot(twist.vx, twist.vy), linear, STANDING_M_S),
        ("angular", "rad/s", abs(twist.wz), angular, SLOW_RAD_S),
    ):
        if wish < slow:
            continue
        velocity = math.inf if limits is None or limits.velocity is None else limits.velocity
        gains = math.inf if limits is None or limits.acceleration is None else limits.acceleration
        if velocity < slow:
            left = f"limits.{name}.velocity = {velocity:g} is all that is left of {wish:g} {unit}"
            found.append(left)
        elif gains < slow:
            late = f"lets it reach {wish:g} {unit} only after {wish / gains:.0f} s"
            found.append(f"limits.{name}.acceleration = {gains:g} {late}")
        else:
            return ""
    if not found:
        return ""
    return f"{source_words(decision.driver)} drives at a crawl: {', and '.join(found)}."


def _seconds(duration_ns: int) -> str:
    return f"{max(0, duration_ns) / 1e9:.1f} s"
