"""Explains why the robot does not move, which is a person's first question.

It gives all reasons, in the order in which a person has to deal with them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias

import msgspec

from yahboomd.core.drive.arbitration import Decision
from yahboomd.core.drive.estop import Latched
from yahboomd.core.drive.holds import BOARD_UNFIT, FAULT, UNGUARDED, WAITING_FOR_BOARD, Hold
from yahboomd.core.drive.limiter import AxisCaps
from yahboomd.core.model import Cause
from yahboomd.core.names import source_words
from yahboomd.core.standstill import STANDING_M_S, UNMOVED_S

State: TypeAlias = Literal["waiting", "standing", "driving", "stopping", "estopped", "fault"]

SLOW_RAD_S = 0.1
"""A base that turns slower than this seems to stand."""

MAY_TURN = "The wheels may still turn: switch the motors' supply off."
"""The first words while a board is out of reach whose wheels turned when they were last seen."""


class Situation(msgspec.Struct, frozen=True, kw_only=True):
    """Everything by which a person may explain what the robot does.

    Attributes:
        stop_waits: The stop of the latch, or of a fault, has not left this machine yet.
        in_motion: Wheels turn, or are commanded to.
        refused: The number of recently refused commands, by reason.
        holonomic: Whether the base can move sideways.
        least_radius_m: Of a car's tightest curve; None if the base turns on the spot.
        unmoved_m_s: The fastest setpoint of wheels of which none moves; 0 if one does.
        least_m_s: Wheels follow setpoints from here on.
        commands: What is wrong with their rhythm.
        release: The command that lets this robot, and no other, drive again.
        unseen: The wheels may turn, and no count shows it.
        battery: What an empty battery forbids.
    """

    now_ns: int
    decision: Decision
    latched: Latched | None = None
    holds: Sequence[Hold] = ()
    stop_waits: bool = False
    in_motion: bool = False
    refused: Mapping[str, int] = {}
    linear: AxisCaps = AxisCaps()
    angular: AxisCaps = AxisCaps()
    holonomic: bool = True
    least_radius_m: float | None = None
    unmoved_m_s: float = 0.0
    least_m_s: float = 0.0
    commands: Sequence[Cause] = ()
    release: str = "yahboomd stop --release"
    unseen: bool = False
    battery: str = ""


def reasons(now: Situation) -> tuple[Cause, ...]:
    """Every reason why the robot stands; while it may drive, who drives."""
    found, decision, latched = list[Cause](), now.decision, now.latched
    if latched is not None:
        ago = _seconds(now.now_ns - latched.since_ns)
        words = f"Emergency stop, engaged by {latched.by} {ago} ago: {latched.reason}."
        found.append(Cause("estop", words))
    found += [
        Cause(hold.kind, _held(now.now_ns, hold))
        for hold in sorted(now.holds, key=lambda hold: hold.kind != FAULT)
    ]
    if {"estop", FAULT} & {each.kind for each in found}:
        found.append(Cause("release", f"To drive again: `{now.release}`."))
    found += now.commands
    if words := _not_commanded(decision):
        lost = decision.why == "no_command" and decision.source is not None
        found.append(Cause("lost" if lost else decision.why, words))
    elif words := _impossible(now) or _too_slow(now):
        found.append(Cause("cannot", words))
    # Refusals explain a standing robot; a driving one obeys other commands.
    if now.refused and found:
        listed = ", ".join(f"{count} {reason}" for reason, count in sorted(now.refused.items()))
        found.append(Cause("refused", f"Commands refused lately: {listed}."))
    if not found:
        found.append(Cause("driving", f"{source_words(decision.driver)} drives."))
    unseen = Cause("wheels", MAY_TURN if now.unseen else "")
    around = unseen, *found, Cause("battery", now.battery)
    return tuple(each for each in around if each.text)


def why(found: Sequence[Cause]) -> str:
    """The reasons as one text."""
    return " ".join(each.text for each in found)


def state_of(now: Situation) -> State:
    """The state in the status; if several apply, the one that needs a person first."""
    kinds = {hold.kind for hold in now.holds}
    if now.stop_waits and (now.latched is not None or FAULT in kinds):
        return "stopping"
    if now.latched is not None:
        return "estopped"
    if kinds & {FAULT, BOARD_UNFIT, UNGUARDED}:
        return "fault"
    if WAITING_FOR_BOARD in kinds:
        return "waiting"
    if now.decision.why == "driving" and now.in_motion and not kinds:
        return "driving"
    return "stopping" if now.in_motion else "standing"


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


def _impossible(now: Situation) -> str:
    """Explain a wish that the geometry or the limits reduce until the robot seems to stand."""
    twist, driver, found = now.decision.twist, source_words(now.decision.driver), list[str]()
    if twist.wz and not twist.vx and now.least_radius_m:
        words = f"{driver} commands a turn on the spot, which a car cannot do. Command vx with it:"
        return f"{words} its tightest curve has a radius of {now.least_radius_m:.2g} m."
    if not (now.holonomic or twist.vx or twist.wz):
        return f"{driver} commands sideways motion, which this base cannot do. Turn it, then drive."
    ahead_m_s = math.hypot(twist.vx, twist.vy if now.holonomic else 0.0)
    for name, unit, wish, limits, slow in (
        ("linear", "m/s", ahead_m_s, now.linear, STANDING_M_S),
        ("angular", "rad/s", abs(twist.wz), now.angular, SLOW_RAD_S),
    ):
        velocity = math.inf if limits.velocity is None else limits.velocity
        gains = math.inf if limits.acceleration is None else limits.acceleration
        if velocity < min(wish, slow):
            left = f"limits.{name}.velocity = {velocity:g} is all that is left of {wish:g} {unit}"
            found.append(left)
        elif gains < slow <= wish:
            late = f"lets it reach {wish:g} {unit} only after {wish / gains:.0f} s"
            found.append(f"limits.{name}.acceleration = {gains:g} {late}")
        elif wish >= slow:
            return ""
    return f"{driver} drives at a crawl, or not at all: {', and '.join(found)}." if found else ""


def _too_slow(now: Situation) -> str:
    """Explain setpoints at which no wheel begins to turn."""
    if not (now.unmoved_m_s and now.in_motion) or now.holds or now.latched:
        return ""
    return (
        f"{source_words(now.decision.driver)} commands wheels {now.unmoved_m_s:.2g} m/s, and none "
        f"has moved in {UNMOVED_S:g} s: too slow for these motors on this floor. Command "
        f"{max(now.least_m_s, 2.0 * now.unmoved_m_s):.2g} m/s or more, or a faster turn."
    )


def _seconds(duration_ns: int) -> str:
    return f"{max(0, duration_ns) / 1e9:.1f} s"
