"""The control path: from the command in control to the board's, and from counts to estimates.

It runs at a fixed rate, at rest less often and with the counts, and once more at once for every
command that arrives. Each step first checks the reasons against motion (the e-stop, a hold, a board
that is not ready), which end it at once; only command silence and a hand-over may ramp.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import NoReturn

import msgspec

from yahboomd.core.bus.keys import CMD_VEL_TELEOP, CMD_VEL_WEB
from yahboomd.core.clock import Clock, Schedule, nanoseconds, seconds
from yahboomd.core.daemon.estop.latch import EstopLatch
from yahboomd.core.daemon.estop.stop_reports import StopReports
from yahboomd.core.daemon.fit import BLIND_S, ControlOptions, fit
from yahboomd.core.daemon.interruptions import PROMISED_NS, Pauses, Resets
from yahboomd.core.daemon.publisher import Events, Outputs
from yahboomd.core.daemon.wheels import Wheels
from yahboomd.core.drive import standing
from yahboomd.core.drive.arbiter import Arbiter
from yahboomd.core.drive.arbitration import Decision
from yahboomd.core.drive.battery import CRAWL_M_S, BatteryWatch
from yahboomd.core.drive.curve import Curve
from yahboomd.core.drive.faults import Fault
from yahboomd.core.drive.holds import (
    BOARD_RESET,
    BOARD_UNFIT,
    FAULT,
    LINE_NOISY,
    NOT_STARTED,
    UNGUARDED,
    WAITING_FOR_BOARD,
    Hold,
    Holds,
)
from yahboomd.core.drive.kinematics import desaturate, desaturate_twist, wheel_speeds
from yahboomd.core.drive.limiter import Limiter
from yahboomd.core.errors import YahboomdError
from yahboomd.core.link.connected_board import ConnectedBoard
from yahboomd.core.link.handshake import Identity
from yahboomd.core.link.port_guard import NO_GUARD, PortGuard
from yahboomd.core.model import Cause, Counts, EncoderReading, Event, ImuReading, Matrix3, Pose2d
from yahboomd.core.odometry.odometer import Odometer
from yahboomd.core.protocol.dialect import Units
from yahboomd.core.protocol.settings import VERSION

SOONEST_NS = 2_000_000
"""The least time between extra control steps for new commands: more steps than the board
can be sent, and a bound on the cost of a flood of commands."""

IDLE_NS = 100_000_000
"""The period of the control step while the wheels stand and nothing commands them. A command, a
stop or a turning wheel causes a step at once."""

MOST_PROMISED_NS = 1_000_000_000
"""The longest promise to the guard, while the command in effect is good for as long."""

PERSONS = (CMD_VEL_TELEOP, CMD_VEL_WEB)
"""The sources by which people drive."""

FASTER, MORE = 1.2, 0.01
"""A command this many times faster, and so much, is worth another try; m/s and rad/s."""

DOUBTFUL_S = 0.5
"""The standstill after a cut that may be the line's fault: the wheels roll out meanwhile."""


class Controller:
    """Owns the path from commands to wheels, and from counts to the pose.

    Args:
        clock: The source of time.
        options: The robot.
        arbiter: Decides which source drives.
        odometer: Makes estimates of readings.
        latch: The e-stop.
        outputs: Receive the estimates and events.
        guard: Stops the wheels if this process pauses.
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
        guard: PortGuard | None = None,
    ) -> None:
        self._clock = clock
        self._options = options
        self._arbiter = arbiter
        self._odometer = odometer
        self._latch = latch
        self._outputs = outputs
        self._guard = guard or PortGuard()
        self.counters: Counter[str] = Counter()
        self._wheels = Wheels(
            options.kinematics,
            options.motors,
            at_rest=options.at_rest,
            min_speed_m_s=options.min_speed_m_s,
            counters=self.counters,
        )
        self._limiter = Limiter(
            options.linear, options.angular, longest_step_s=max(0.1, 2 * options.period_s)
        )
        self._curve = Curve(options.kinematics, options.linear.velocity, options.angular.velocity)
        self._holds = Holds()
        self._failed = Decision().twist
        self._events = Events(clock, outputs, self.counters)
        self._resets = Resets(
            clock,
            wheels=self._wheels,
            limiter=self._limiter,
            holds=self._holds,
            events=self._events,
            outputs=outputs,
        )
        self._pauses = Pauses(
            clock,
            nanoseconds(options.period_s),
            arbiter=arbiter,
            wheels=self._wheels,
            limiter=self._limiter,
            events=self._events,
            guard=self._guard,
        )
        self._decision = Decision()
        self._stepped_ns = clock.now_ns()
        self._extra_ns = 0
        self._idle_until_ns = 0
        self._step_pending = False
        self._was_connected = False
        self._seen_ns = 0
        self._raw_ticks: Counts = (0, 0, 0, 0)
        self._alarm = clock.alarm(self._extra_step)
        self.stop_reports = StopReports(clock, self._stop_outcome)
        self._period_ns = nanoseconds(options.period_s)
        self._blind_s = options.blind_s
        self._starts_s = 0.0
        self._beats = Schedule(clock, self._period_ns)
        self.volts: float | None = None
        self.battery_watch = BatteryWatch(options.battery_low_v, options.battery_stop_v)
        self.imu_sensor: str | None = None
        self._wait("No board yet.")

    # The control step.

    async def run(self, on_beat: Callable[[int], None]) -> NoReturn:
        """Step by the clock until cancelled; less often at rest without a command.

        Args:
            on_beat: Called after each of these steps with the moment at which it was due.
        """

        def beat(due_ns: int) -> None:
            self.control_step()
            self.counters["beats_missed"] = self._beats.missed
            self._beats.rest(self._idle_until_ns)
            on_beat(due_ns)

        await self._beats.run(beat)

    def control_step(self) -> None:
        """Decide what the wheels do now, and command the board."""
        self.notice_pause()
        self._step()

    def _step(self) -> None:
        now_ns = self._clock.now_ns()
        if self._idle_until_ns:
            # Between these steps there was nothing to ramp.
            self._stepped_ns = max(self._stepped_ns, now_ns - self._period_ns)
        dt_s = seconds(now_ns - self._stepped_ns)
        self._stepped_ns = now_ns
        self._step_pending = False
        before = self._decision
        decision = self._decision = self._arbiter.current(now_ns)
        self._look(now_ns)
        if self._holds.has(NOT_STARTED) and self._asks_for_more(decision):
            self._holds.drop(NOT_STARTED)
        if self._latch.engaged or self._holds.active(now_ns):
            self._stand(now_ns, at_once=True)
        else:
            self._drive(decision, now_ns, dt_s)
        # Only readings after the stop was sent show that the wheels stand.
        wheels = self._wheels
        self._arbiter.observe_wheels(
            now_ns,
            commanded_zero=not any(wheels.command_m_s),
            measured_m_s=wheels.measured_m_s if wheels.stopped else None,
        )
        if (before.why, before.driver) != (decision.why, decision.driver):
            self._outputs.changed()
        # React to silence when it is due, not at the beat after it.
        due_ns = self._arbiter.deadline_ns
        self._alarm.set(due_ns if due_ns is not None and due_ns > now_ns else None)
        idle = due_ns is None and wheels.stopped and not wheels.in_motion
        self._idle_until_ns = now_ns + IDLE_NS if idle else 0
        if not idle:
            self._beats.wake()

    def _asks_for_more(self, decision: Decision) -> bool:
        """Whether a command differs from the one at which a wheel did not begin to turn."""
        new, old = decision.twist, self._failed
        pairs = zip(msgspec.structs.astuple(new), msgspec.structs.astuple(old), strict=True)
        return new.is_zero or any(abs(now) > FASTER * abs(then) + MORE for now, then in pairs)

    def notice_pause(self) -> None:
        """Detect a pause of this process; before anything is used that may have waited."""
        if not self._pauses.notice():
            return
        now_ns = self._clock.now_ns()
        self.counters["pauses"] += 1
        # The board may have sent counts meanwhile: their timeout starts again.
        self._seen_ns = now_ns
        if self._arbiter.current(now_ns).why != "driving":
            self._stand(now_ns, at_once=True)

    def _look(self, now_ns: int) -> None:
        if (
            now_ns - self._seen_ns > nanoseconds(self._blind_s)
            and self._wheels.attached
            and not self._holds.has(WAITING_FOR_BOARD)
        ):
            silence = f"No counts have come for {self._blind_s:g} s"
            self._wait(f"{silence}, and wheels are not driven unseen.")
            self.counters["blind"] += 1
            self._outputs.changed()
        if self._guard.watching or not self._wheels.attached:
            if self._holds.drop(UNGUARDED):
                self._outputs.changed()
        elif not self._holds.has(UNGUARDED):
            self._holds.add(Hold(kind=UNGUARDED, message=NO_GUARD, since_ns=now_ns))
            self.event(Event(kind="unguarded", severity="error", message=NO_GUARD))
            self._outputs.changed()

    def promised_ns(self) -> int:
        """Until when the next control step will have been: later while a command is good."""
        now_ns, deadline_ns = self._clock.now_ns(), self._arbiter.deadline_ns or 0
        return max(now_ns + PROMISED_NS, min(deadline_ns, now_ns + MOST_PROMISED_NS))

    def step_soon(self) -> None:
        """Step at once for a new command, but no more often than a command can be sent.

        The caller has looked for a pause before it used the command.
        """
        now_ns = self._clock.now_ns()
        soonest_ns = self._extra_ns + SOONEST_NS
        if now_ns >= soonest_ns:
            self._extra_ns = now_ns
            self._step()
        elif not self._step_pending:
            self._step_pending = True
            self._alarm.set(soonest_ns)

    def _extra_step(self) -> None:
        self._extra_ns = self._clock.now_ns()
        self.control_step()

    def close(self) -> None:
        self._alarm.close()
        self.stop_reports.close()
        self._beats.close()

    def _drive(self, decision: Decision, now_ns: int, dt_s: float) -> None:
        kinematics, limits = self._options.kinematics, self._wheels.fit.wheel_limits
        if decision.twist.is_zero and (not decision.ramp or self._limiter.halted):
            self._stand(now_ns, at_once=not decision.ramp)
            return
        if self.battery_watch.level == "empty":
            limits = tuple(min(limit, CRAWL_M_S) for limit in limits)
        wish, too_tight = self._curve.steer(decision.twist)
        if too_tight:
            self.counters["too_tight"] += 1
        wish, scale = desaturate_twist(kinematics, wish, limits)
        if scale < 1.0:
            self.counters["desaturated"] += 1
        # A car's wish is scaled to the limits along its curve.
        if self._limiter.clips(decision.twist if kinematics.least_radius_m else wish):
            self.counters["limited"] += 1
        limited = self._curve.ramped(self._limiter.limit(wish, dt_s))
        self._odometer.steer(self._curve.per_m, now_ns)
        speeds, _ = desaturate(wheel_speeds(kinematics, limited), limits)
        if any(speeds):
            self.battery_watch.moves(now_ns)
            self._wheels.turn(speeds)
        else:
            self._stand(now_ns, at_once=False)

    def _stand(self, now_ns: int, *, at_once: bool) -> None:
        self._limiter.halt()
        if (fault := self._wheels.stand(now_ns, at_once=at_once)) is not None:
            self._report_cut(fault)
            if fault.certain and (held := self.fault) is not None:
                # Report the newest symptom first, the original cause second.
                words = f"{fault.message} It was cut because: {held.message}"
                self._holds.add(Hold(kind=FAULT, message=words, since_ns=now_ns))

    def _trouble(self, fault: Fault, now_ns: int) -> None:
        if self._options.cuts(fault):
            self._limiter.halt()
            self._wheels.cut(now_ns)
            kind, doubtful = NOT_STARTED, None
            if fault.action == "let_go":
                self._failed = self._decision.twist
                # A board that was reset unnoticed has forgotten its motors, and obeys no speed.
                self._wheels.rearm()
            else:
                kind, doubtful = FAULT, self._doubtful(fault, now_ns)
            hold = doubtful or Hold(kind=kind, message=fault.message, since_ns=now_ns)
            self._holds.add(hold)
            if hold.kind != LINE_NOISY:
                self._report_cut(fault)
            self._outputs.changed()
        elif self._wheels.noisy:
            self.counters["noisy_doubts"] += 1
        else:
            self.counters[fault.kind] += 1
            self.event(fault.event())

    def _doubtful(self, fault: Fault, now_ns: int) -> Hold | None:
        """The hold for a possible fault of the line; ``None`` if the wheel is to blame."""
        if self._wheels.check.blame(now_ns, fault, damages=self._wheels.damages):
            return None
        self.counters["noisy_cuts"] += 1
        words = (
            "The line to the board loses or alters bytes, and a wheel did not obey its command: "
            "the motors are cut for a moment. Check the USB cable, its shield and its distance "
            f"from the motors' wires. If it continues: {fault.message}"
        )
        event = Event(kind="line_noisy", severity="warning", message=words, wheel=fault.motor)
        self.stop_reports.announce(partial(self._stopped, event))
        self._wheels.check.reset()
        # A board that was reset unnoticed has forgotten its motors, and obeys no speed.
        self._wheels.rearm()
        until_ns = now_ns + nanoseconds(DOUBTFUL_S)
        return Hold(kind=LINE_NOISY, message=words, since_ns=now_ns, until_ns=until_ns)

    def _report_cut(self, fault: Fault) -> None:
        self.counters[fault.kind] += 1
        self.stop_reports.announce(partial(self._stopped, fault.event()))

    def _stopped(self, event: Event, problem: str) -> None:
        """Report an event with a stop, now that the stop was sent or cannot be."""
        words = f"{event.message} {problem}".rstrip()
        self.event(msgspec.structs.replace(event, message=words))

    def _stop_outcome(self) -> str | None:
        if self._wheels.attached:
            return "" if self._wheels.stop_sent else None
        holds = self._holds.active(self._clock.now_ns())
        why = [hold.message for hold in holds if hold.kind == WAITING_FOR_BOARD]
        return f"no board is connected: {' '.join(why) or 'No board yet.'}"

    # Callbacks of the link (link.connected_board.Listener).

    def connected(self, board: ConnectedBoard, identity: Identity) -> None:
        """Decide whether the wheels of a new board may turn, and in which units."""
        now_ns = self._clock.now_ns()
        self._arbiter.forget_commands(now_ns)
        self.imu_sensor = None
        dialect = identity.dialect
        self._blind_s = self._options.blind_s if dialect.poll is not None else BLIND_S
        self._starts_s = dialect.starts_within_s
        self._odometer.set_sample_period(
            dialect.sample_period_ns, each_line=dialect.renews_with_each_line, age_ns=dialect.age_ns
        )
        found = fit(
            identity,
            kinematics=self._options.kinematics,
            motors=self._options.motors,
            profile=self._options.profile,
            scale=self._options.command_scale,
        )
        self._wheels.attach(board, found)
        if found.wrong:
            words = " ".join(found.wrong)
            self._holds.add(Hold(kind=BOARD_UNFIT, message=words, since_ns=now_ns))
            self.event(Event(kind="board_unfit", severity="error", message=words))
        else:
            self._holds.drop(BOARD_UNFIT)
        self._wait("The board is connected; waiting for its first counts.")
        version = identity.settings.get(VERSION) if identity.settings else None
        words = f"Connected to {board.port_name}: dialect {dialect.name}" + (
            f", firmware {version}." if version else "."
        )
        self.event(Event(kind="connected", severity="info", message=words))
        self._outputs.changed()

    def armed(self) -> None:
        self._odometer.armed()

    def reading(self, reading: EncoderReading) -> None:
        self.notice_pause()
        update = self._odometer.update(reading)
        for event in update.events:
            self.event(event)
            self._resets.interrupted(
                event,
                reading.ticks,
                self._raw_ticks,
                paused=self._pauses.just_ended(reading.received_ns),
                silent_s=self._starts_s / 2.0,
            )
        if (estimate := update.estimate) is None:
            return
        now_ns = self._seen_ns = self._clock.now_ns()
        self._raw_ticks = reading.ticks
        if self._idle_until_ns and any(estimate.motor_speed_m_s):
            self._idle_until_ns = 0
            self._beats.wake()
        faults = self._wheels.measure(
            estimate.stamp_ns,
            estimate.motor_speed_m_s,
            estimate.motor_ticks,
            reading.received_ns,
            reading.earliest_ns,
        )
        for fault in faults:
            self._trouble(fault, now_ns)
        # A session that ends still delivers counts, but takes no commands any more.
        if self._wheels.attached and self._holds.drop(WAITING_FOR_BOARD):
            self._outputs.changed()
        self._outputs.estimate(estimate, self._wheels.command_m_s)
        if self._idle_until_ns and now_ns >= self._idle_until_ns - self._period_ns:
            # At rest the process need not wake for the step alone.
            self._beats.advance(now_ns)

    def imu(self, reading: ImuReading) -> None:
        self.imu_sensor = reading.sensor.name
        along_base = self._options.mounting.along_base(reading)
        self._outputs.imu(self._odometer.accept(along_base))

    def sent(self, units: Units | None) -> None:
        """Note a written command: from now on wheels are compared with it."""
        self._wheels.sent(units, self._clock.now_ns())

    def battery(self, volts: float) -> None:
        self.volts = self._wheels.check.volts = volts = volts * self._options.battery_scale
        self._outputs.battery(volts)
        if (event := self.battery_watch.read(volts, self._clock.now_ns())) is not None:
            self.event(event)

    def motion_refusal(self, source: str) -> str:
        """The reason why this source begins no motion now; empty if it may."""
        return self.battery_watch.refuses(source, PERSONS)

    def board_reset(self, version: str) -> None:
        """Handle a restart of the board: its motors are free, and its command is lost."""
        self._resets.restarted(f"The board reset itself (firmware {version})")

    def leaving(self) -> None:
        """Note that the session with the board ends; it stops the wheels by itself."""
        self._was_connected = self._was_connected or self._wheels.attached
        self._wheels.detach()
        # It arms the board as well, to see the wheels stand.
        self._odometer.armed()
        self._limiter.halt()
        self._wait("The connection to the board is being ended, with a stop.")
        self._outputs.changed()

    def unavailable(self, error: YahboomdError) -> None:
        was_connected = self._was_connected or self._wheels.attached
        self._was_connected = False
        self._wheels.detach()
        self._limiter.halt()
        self._holds.drop(BOARD_RESET)
        self.battery_watch.forget()
        self._wait(str(error))
        if was_connected:
            self.counters["disconnected"] += 1
            self.event(Event(kind="disconnected", severity="error", message=str(error)))
        self._outputs.changed()

    def _wait(self, words: str) -> None:
        now_ns = self._clock.now_ns()
        self._holds.add(Hold(kind=WAITING_FOR_BOARD, message=words, since_ns=now_ns))

    def bus_lost(self) -> None:
        """Discard all commands at once: no client is connected any more."""
        self._arbiter.forget_commands(self._clock.now_ns(), clients_left=True)
        if any(self._wheels.command_m_s):
            self.counters["bus_lost"] += 1
        self._limiter.halt()
        self.control_step()

    # Requests of people (`requests.Operator`).

    def stop_now(self, event: Event | None = None) -> None:
        """Send a stop before everything else that is under way.

        Args:
            event: Reported once the stop was sent, or cannot be.
        """
        self._wheels.stop_again(self._clock.now_ns())
        self.control_step()
        if event is not None:
            self.stop_reports.announce(partial(self._stopped, event))

    def wheels_seen(self) -> tuple[bool | None, float | None]:
        """Whether the counts show that the wheels obeyed the latest stop, and the fastest of them.

        Both are None without counts.
        """
        measured_m_s = self._wheels.measured_m_s
        if not measured_m_s or self._holds.has(WAITING_FOR_BOARD):
            return None, None
        return self._wheels.stopped, max(map(abs, measured_m_s))

    @property
    def fault(self) -> Hold | None:
        """The fault that keeps the robot from moving until a person clears it."""
        active = self._holds.active(self._clock.now_ns())
        return next((hold for hold in active if hold.kind == FAULT), None)

    def clear_fault(self) -> str | None:
        """Clear a latched fault. Returns its words; ``None`` without one."""
        if (found := self.fault) is None:
            return None
        self._holds.drop(FAULT)
        self._resets.clear()
        self._wheels.check.reset()
        # The fault may have been a board that forgot its motors.
        self._wheels.rearm()
        return found.message

    def set_pose(self, pose: Pose2d, covariance: Matrix3 | None) -> None:
        self._odometer.set_pose(pose, covariance)

    def event(self, event: Event) -> None:
        """Log and publish, as often as :class:`~yahboomd.core.daemon.publisher.Events` lets it."""
        self._events.report(event)

    # Status.

    def status_values(self) -> dict[str, int | float | str]:
        return {
            **self.counters,
            **self._odometer.counters,
            "pose_broken": self._odometer.broken,
            "gyro_bias_rad_s": round(self._odometer.gyro_bias_rad_s, 6),
            "board_tick_ns": self._odometer.tick_period_ns or 0,
            **self._latch.status_values(),
        }

    @property
    def wheels(self) -> str | None:
        """What is known of the wheels, as `StatusSample.wheels` has it."""
        unseen = self._wheels.seen == "turning" and self._holds.has(WAITING_FOR_BOARD)
        return "unknown" if unseen else self._wheels.seen

    @property
    def decision(self) -> Decision:
        return self._decision

    def state(self, near: str = "") -> tuple[standing.State, tuple[Cause, ...]]:
        """The state, and its causes.

        Args:
            near: Where programs may be that do not name themselves.
        """
        now_ns, kinematics = self._clock.now_ns(), self._options.kinematics
        now = standing.Situation(
            now_ns=now_ns,
            decision=self._decision,
            latched=self._latch.latched,
            holds=self._holds.active(now_ns),
            stop_waits=self.stop_reports.waiting,
            in_motion=self._wheels.in_motion,
            refused=self._arbiter.recent_refusals(now_ns),
            linear=self._options.linear,
            angular=self._options.angular,
            holonomic=kinematics.holonomic,
            least_radius_m=kinematics.least_radius_m,
            unmoved_m_s=self._wheels.unmoved_m_s,
            least_m_s=self._options.min_speed_m_s,
            commands=self._arbiter.causes(now_ns, near),
            release=self._options.release,
            unseen=self.wheels == "unknown",
            battery=self.battery_watch.words,
        )
        return standing.state_of(now), standing.reasons(now)
