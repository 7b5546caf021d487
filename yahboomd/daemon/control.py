"""The control path: from who may drive to what the board is told, and from counts to estimates.

It runs at a fixed rate, and once more at once for every command that arrives. Whatever forbids
motion (the e-stop, a hold, a board that is not ready) is looked at first in every step, and ends
it at once; only command silence and a hand-over may ramp.
"""

from __future__ import annotations

import logging
from collections import Counter
from typing import Literal, Protocol

import msgspec

from yahboomd.clock import Clock, nanoseconds, seconds
from yahboomd.daemon.fit import fit, no_board
from yahboomd.daemon.latch import EstopLatch
from yahboomd.drive import standing
from yahboomd.drive.arbiter import Arbiter, Decision
from yahboomd.drive.channels import channel_commands, motor_speeds
from yahboomd.drive.holds import (
    BOARD_RESET,
    BOARD_UNFIT,
    FAULT,
    WAITING_FOR_BOARD,
    Hold,
    Holds,
    ResetWatch,
)
from yahboomd.drive.kinematics import desaturate, desaturate_twist, wheel_speeds
from yahboomd.drive.limiter import AxisLimits, Limiter
from yahboomd.drive.stop_watch import StopWatch
from yahboomd.drive.wheels_check import Fault, WheelsCheck
from yahboomd.errors import YahboomdError
from yahboomd.link.handshake import Identity
from yahboomd.link.session import Session
from yahboomd.model import (
    EncoderReading,
    Event,
    Kinematics,
    Matrix3,
    Motor,
    OdometryEstimate,
    Pose2d,
)
from yahboomd.odometry.odometer import Odometer
from yahboomd.protocol.settings import MotorProfile

log = logging.getLogger(__name__)

SOONEST_S = 0.002
"""Extra control steps, for commands that arrive, are at least so far apart: more than the board
can be told, and a bound on what a flood of commands can cost."""

STOP_REPEAT_S = 0.1
"""How often an immediate stop is said before everything else until the counters obey."""


class ControlOptions(msgspec.Struct, frozen=True, kw_only=True):
    """What the control path is told about this robot.

    Attributes:
        kinematics: The drive geometry.
        motors: The motors, in the order of the geometry's wheels.
        profile: The motors' kind.
        command_scale: Multiplier on command units.
        linear: Limits of vx and vy.
        angular: Limits of wz.
        at_rest: Hold the wheels once they stand, or let them go.
        stall: What follows from a wheel that stands against its command.
        turns_without_command: What follows from a wheel that turns by itself.
        min_speed_m_s: Commands below it prove nothing about counts that stay away.
        period_s: From one control step to the next.
    """

    kinematics: Kinematics
    motors: tuple[Motor, ...]
    profile: MotorProfile
    command_scale: float = 1.0
    linear: AxisLimits = AxisLimits()
    angular: AxisLimits = AxisLimits()
    at_rest: Literal["hold", "release"] = "hold"
    stall: Literal["stop", "report"] = "stop"
    turns_without_command: Literal["stop", "report"] = "report"
    min_speed_m_s: float = 0.08
    period_s: float = 0.02


class Outputs(Protocol):
    """Who hears what comes of it."""

    def estimate(self, estimate: OdometryEstimate, command_m_s: tuple[float, ...]) -> None:
        """A new reading, and the rim speeds that were commanded."""
        ...

    def battery(self, volts: float) -> None:
        """The voltage of the motors' supply."""
        ...

    def event(self, event: Event) -> None:
        """Something happened."""
        ...

    def changed(self) -> None:
        """State, driver or reason may have changed."""
        ...


class Controller:
    """Owns the path from commands to wheels, and from counts to the pose.

    Args:
        clock: What tells the time.
        options: The robot.
        arbiter: Decides who drives.
        odometer: Makes estimates of readings.
        latch: The e-stop.
        outputs: Hear what comes of it.
    """

    def __init__(
        self,
        clock: Clock,
        options: ControlOptions,
        *,
        arbiter: Arbiter,
        odometer: Odometer,
        latch: EstopLatch,
        outputs: Outputs,
    ) -> None:
        self._clock = clock
        self._options = options
        self._arbiter = arbiter
        self._odometer = odometer
        self._latch = latch
        self._outputs = outputs
        names = tuple(motor.name for motor in options.motors)
        self._limiter = Limiter(
            options.linear, options.angular, longest_step_s=max(0.1, 2 * options.period_s)
        )
        self._check = WheelsCheck(names, min_speed_m_s=options.min_speed_m_s)
        self._stop_watch = StopWatch(names)
        self._resets = ResetWatch()
        self._holds = Holds()
        self._session: Session | None = None
        self._fit = no_board(options.kinematics)
        self._zeros = (0.0,) * len(options.motors)
        self._command_m_s = self._zeros
        self._measured_m_s: tuple[float, ...] | None = None
        self._motor_ticks: tuple[int, ...] | None = None
        self._decision = Decision()
        self._released = False
        self._stop_due_ns: int | None = None
        self._stepped_ns = clock.now_ns()
        self._extra_ns = 0
        self._step_pending = False
        self._alarm = clock.alarm(self._extra_step)
        self.progress = 0
        self.volts: float | None = None
        self.counters: Counter[str] = Counter()
        self._wait("No board yet.")

    # The control step.

    def step(self) -> None:
        """Decide what the wheels do now, and tell the board."""
        now_ns = self._clock.now_ns()
        dt_s = seconds(now_ns - self._stepped_ns)
        self._stepped_ns = now_ns
        self._step_pending = False
        self.progress += 1
        before = self._decision
        decision = self._decision = self._arbiter.current(now_ns)
        if self._latch.engaged or self._holds.active(now_ns):
            self._stand(now_ns, at_once=True)
        else:
            self._drive(decision, now_ns, dt_s)
        # Only what was measured after the wheels were told to stand shows that they do.
        stopped = self._stop_watch.state == "stopped"
        self._arbiter.observe_wheels(
            now_ns,
            commanded_zero=not any(self._command_m_s),
            measured_m_s=self._measured_m_s if stopped else None,
        )
        if (before.why, before.driver) != (decision.why, decision.driver):
            self._outputs.changed()

    def step_soon(self) -> None:
        """A command arrived: step at once, but not more often than the board could be told."""
        now_ns = self._clock.now_ns()
        soonest_ns = self._extra_ns + nanoseconds(SOONEST_S)
        if now_ns >= soonest_ns:
            self._extra_ns = now_ns
            self.step()
        elif not self._step_pending:
            self._step_pending = True
            self._alarm.set(soonest_ns)

    def _extra_step(self) -> None:
        self._extra_ns = self._clock.now_ns()
        self.step()

    def close(self) -> None:
        """Let go of the timer."""
        self._alarm.close()

    def _drive(self, decision: Decision, now_ns: int, dt_s: float) -> None:
        options = self._options
        if not decision.ramp and decision.twist.is_zero:
            self._stand(now_ns, at_once=True)
            return
        wish, scale = desaturate_twist(options.kinematics, decision.twist, self._fit.wheel_limits)
        if scale < 1.0:
            self.counters["desaturated"] += 1
        limited = self._limiter.step(wish, dt_s)
        speeds, _ = desaturate(wheel_speeds(options.kinematics, limited), self._fit.wheel_limits)
        if not any(speeds):
            self._stand(now_ns, at_once=False)
            return
        self._stop_watch.cancel()
        self._stop_due_ns = None
        self._released = False
        self._say(speeds, now_ns)

    def _stand(self, now_ns: int, *, at_once: bool) -> None:
        """Command standstill, see that it is obeyed, and cut the motors where it is not."""
        self._limiter.halt()
        session = self._session
        moved = any(self._command_m_s)
        if session is None:
            self._command_m_s = self._zeros
            return
        if moved or self._stop_watch.state == "idle":
            self._stop_watch.begin(now_ns)
            self._stop_due_ns = now_ns if at_once else None
        elif at_once and self._stop_due_ns is None and self._stop_watch.state == "stopping":
            self._stop_due_ns = now_ns
        if self._stop_due_ns is not None and self._stop_watch.state == "stopped":
            self._stop_due_ns = None
        if self._stop_due_ns is not None and now_ns >= self._stop_due_ns and not self._released:
            # Before everything that waits, and again until the counters obey.
            session.brake()
            self.counters["stops_said"] += 1
            self._stop_due_ns = now_ns + nanoseconds(STOP_REPEAT_S)
        if (fault := self._stop_watch.check(now_ns)) is not None:
            self._trouble(fault, now_ns)
        if self._released:
            return
        if self._options.at_rest == "release" and self._stop_watch.state == "stopped":
            self._release()
            return
        self._say((0.0,) * len(self._options.kinematics.wheels), now_ns)

    def _say(self, wheels: tuple[float, ...], now_ns: int) -> None:
        options = self._options
        self._command_m_s = motor_speeds(options.motors, wheels)
        self._check.command(now_ns, self._command_m_s)
        if self._session is not None and self._fit.units:
            self._session.drive(channel_commands(options.motors, wheels, self._fit.units))

    def _release(self) -> None:
        """Let the motors go, and keep saying so until somebody may drive again."""
        self._released = True
        self._command_m_s = self._zeros
        self._check.command(self._clock.now_ns(), None)
        if self._session is not None:
            self._session.release()

    def _cut(self) -> None:
        self._limiter.halt()
        if self._session is not None:
            self._session.cut()
        self.counters["cuts"] += 1
        self._release()

    def _trouble(self, fault: Fault, now_ns: int) -> None:
        """What follows from a wheel that lies."""
        self.counters[fault.kind] += 1
        self.event(fault.event())
        stop = fault.action == "cut" or (fault.action == "policy" and self._policy(fault) == "stop")
        if not stop:
            return
        self._cut()
        if fault.kind != "stop_not_obeyed":
            self._holds.put(Hold(kind=FAULT, message=fault.message, since_ns=now_ns))
        self._outputs.changed()

    def _policy(self, fault: Fault) -> Literal["stop", "report"]:
        if fault.kind == "turns_without_command":
            return self._options.turns_without_command
        return self._options.stall

    # What the link tells (link.session.Listener).

    def connected(self, session: Session, identity: Identity) -> None:
        """A board is there: may its wheels turn, and in which units are they told to?"""
        now_ns = self._clock.now_ns()
        self._session = session
        self._released = False
        self._stop_watch.cancel()
        self._check.reset()
        self._arbiter.forget_commands(now_ns)
        self._odometer.set_sample_period(identity.dialect.sample_period_ns)
        self._fit = fit(
            identity,
            kinematics=self._options.kinematics,
            motors=self._options.motors,
            profile=self._options.profile,
            scale=self._options.command_scale,
        )
        if self._fit.wrong:
            words = " ".join(self._fit.wrong)
            self._holds.put(Hold(kind=BOARD_UNFIT, message=words, since_ns=now_ns))
            self.event(Event(kind="board_unfit", severity="error", message=words))
        else:
            self._holds.drop(BOARD_UNFIT)
        self._wait("The board is connected; waiting for its first counts.")
        version = identity.settings.version if identity.settings else None
        words = f"Connected: dialect {identity.dialect.name}" + (
            f", firmware {version}." if version else "."
        )
        self.event(Event(kind="connected", severity="info", message=words))
        self._outputs.changed()

    def reading(self, reading: EncoderReading) -> None:
        """Counts arrived: where is the robot now?"""
        update = self._odometer.update(reading)
        for event in update.events:
            self.event(event)
        estimate = update.estimate
        if estimate is None:
            return
        self._measured_m_s = estimate.motor_speed_m_s
        ticks = estimate.motor_ticks
        deltas = tuple(b - a for a, b in zip(self._motor_ticks or ticks, ticks, strict=True))
        self._motor_ticks = ticks
        now_ns = self._clock.now_ns()
        for fault in self._check.measure(estimate.stamp_ns, estimate.motor_speed_m_s, deltas):
            self._trouble(fault, now_ns)
        self._stop_watch.measure(estimate.stamp_ns, estimate.motor_speed_m_s)
        if self._holds.drop(WAITING_FOR_BOARD):
            self._outputs.changed()
        self._outputs.estimate(estimate, self._command_m_s)

    def battery(self, volts: float) -> None:
        """The voltage of the motors' supply."""
        self.volts = volts
        self._outputs.battery(volts)

    def board_reset(self, version: str) -> None:
        """The board started anew: its motors are free, and what it was told is forgotten."""
        now_ns = self._clock.now_ns()
        measured = self._measured_m_s or ()
        in_motion = any(self._command_m_s) or any(abs(each) > 0.03 for each in measured)
        self._limiter.halt()
        self._release()
        self._check.reset()
        words = f"The board reset itself (firmware {version})" + (
            " in motion: its motors are free, and it stands a second before it may drive again."
            if in_motion
            else "."
        )
        self.event(Event(kind="board_reset", severity="warning", message=words))
        hold = self._resets.reset(now_ns, in_motion=in_motion)
        if hold is not None:
            self._holds.put(hold)
            if hold.kind == FAULT:
                self.event(Event(kind="reset_loop", severity="error", message=hold.message))
        self._outputs.changed()

    def searching(self) -> None:
        """The supervisor looks for the board."""

    def unavailable(self, error: YahboomdError) -> None:
        """There is no board, or no longer."""
        was_connected = self._session is not None
        self._session = None
        self._limiter.halt()
        self._command_m_s = self._zeros
        self._measured_m_s = None
        self._stop_watch.cancel()
        self._holds.drop(BOARD_RESET)
        self._wait(str(error))
        if was_connected:
            self.counters["disconnected"] += 1
            self.event(Event(kind="disconnected", severity="error", message=str(error)))
        self._outputs.changed()

    def _wait(self, words: str) -> None:
        now_ns = self._clock.now_ns()
        self._holds.put(Hold(kind=WAITING_FOR_BOARD, message=words, since_ns=now_ns))

    def bus_lost(self) -> None:
        """Nobody is connected any more: what was commanded is over, at once."""
        self._arbiter.forget_commands(self._clock.now_ns())
        if any(self._command_m_s):
            self.counters["bus_lost"] += 1
        self._limiter.halt()
        self.step()

    # What people ask for (daemon.operator).

    def stop_now(self) -> None:
        """Say a stop before everything else, whatever is under way."""
        self._stop_due_ns = self._clock.now_ns()
        if self._stop_watch.state != "stopping":
            self._stop_watch.cancel()
        self.step()

    @property
    def faulty(self) -> bool:
        """Whether a fault keeps the robot where it is until a person clears it."""
        return any(hold.kind == FAULT for hold in self._holds.active(self._clock.now_ns()))

    def clear_fault(self) -> str | None:
        """Forget a latched fault. Returns its words; ``None`` where there was none."""
        found = [hold for hold in self._holds.active(self._clock.now_ns()) if hold.kind == FAULT]
        if not found:
            return None
        self._holds.drop(FAULT)
        self._resets.clear()
        self._check.reset()
        return found[0].message

    def set_pose(self, pose: Pose2d, covariance: Matrix3 | None) -> None:
        """Declare where the robot is."""
        self._odometer.set_pose(pose, covariance)

    def event(self, event: Event) -> None:
        """Log and publish."""
        level = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}
        log.log(level[event.severity], "%s", event.message)
        self.counters["events"] += 1
        self._outputs.event(event)
        self._outputs.changed()

    # What status tells.

    def facts(self) -> dict[str, int]:
        """Counters of the control path and of the odometry."""
        return {**self.counters, **self._odometer.counters}

    @property
    def decision(self) -> Decision:
        """The latest word of the arbiter."""
        return self._decision

    def state(self) -> tuple[standing.State, str]:
        """The state in one word, and why the robot stands, or that it drives."""
        now_ns = self._clock.now_ns()
        holds = self._holds.active(now_ns)
        state = standing.state_of(
            decision=self._decision,
            latched=self._latch.latched,
            holds=holds,
            commanded_zero=not any(self._command_m_s),
            measured_m_s=self._measured_m_s,
        )
        found = standing.reasons(
            now_ns,
            decision=self._decision,
            latched=self._latch.latched,
            holds=holds,
            refused=self._arbiter.recent_refusals(now_ns),
            linear=self._options.linear,
            angular=self._options.angular,
            holonomic=self._options.kinematics.holonomic,
        )
        if not found:
            return state, f"{self._decision.driver} drives."
        return state, " ".join(reason.message for reason in found)
