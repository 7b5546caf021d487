"""Computes estimates from readings: the one entry to this room.

Law: each pose belongs to a new reading and has the time at which the board sampled it, and nothing
that happens on the wire makes it jump. Lost travel is reported, as an event and in the covariance.

An estimate needs two readings, because a velocity does: the first reading of all gives none, nor
does one that ends a discontinuity. At rest a streaming board repeats its totals; each tick of its
clock is still a new reading, with a new stamp.
"""

from __future__ import annotations

import math
from collections import Counter

import msgspec

from yahboomd.core.model import (
    Counts,
    EncoderReading,
    Event,
    ImuEstimate,
    ImuReading,
    Kinematics,
    Matrix3,
    Motor,
    OdometryEstimate,
    Pose2d,
    Twist2d,
)
from yahboomd.core.odometry import discontinuity
from yahboomd.core.odometry.covariance import NOISE_M, Covariance, with_heading
from yahboomd.core.odometry.encoders import Encoders, Verdict
from yahboomd.core.odometry.heading import Heading
from yahboomd.core.odometry.integrator import Doubt, Integrator, arc_between
from yahboomd.core.odometry.polled_clock import Instant, PolledClock
from yahboomd.core.odometry.steering import Steering
from yahboomd.core.odometry.streamed_clock import StreamedClock
from yahboomd.core.odometry.velocity import LONGEST_NS, VelocityEstimator, Window

UNSEEN_NS = 150_000_000
"""In a longer step, the order in which a base goes and turns is unknown."""

ASKED_TICK_NS = 10_000_000
SHORTEST_ASKED_NS = 15_000_000
"""A board that is asked renews its totals every 10 ms at times that it does not report: counts over
less than this, as after a break, give no speed."""


CARRIED_NS = 50_000_000
"""The gyro carries the heading on from counters that were read at most this long ago."""

RESTS = 25
"""After this many readings without a count, each with an estimate, all windows show standing
wheels: another such reading changes the time only."""

SILENCE_NS = 300_000_000
"""A longer pause between readings counts as a gap: the board may have been reset."""


class Update(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one reading.

    Attributes:
        estimate: The new estimate; None if the reading shows nothing new.
    """

    estimate: OdometryEstimate | None = None
    events: tuple[Event, ...] = ()


NOTHING = Update()


class OdometerSettings(msgspec.Struct, frozen=True, kw_only=True):
    """The arguments of an :class:`Odometer`, by their names."""

    kinematics: Kinematics
    motors: tuple[Motor, ...]
    speed_max_m_s: float
    noise_m: float
    fused: bool
    gyro_scale: float | None


class Odometer:
    """Computes the robot's pose from the board's counts.

    Args:
        motors: The motors on the board; estimates list them in this order.
        speed_max_m_s: A rim speed that no wheel reaches; a larger step is no travel. The fastest of
            the vendor's motors with its wheel runs 1.93 m/s.
        noise_m: Variance of a wheel's travel per metre rolled.
        fused: The heading is that of wheels and gyro, if the board has one; else the wheels'.
        gyro_scale: Standard deviation of the gyro's scale, as a share; None leaves it to the
            sensor.

    Attributes:
        broken: Why the pose may be beside the truth since travel was lost, until it is set; else
            empty.

    Raises:
        ConfigError: The motors do not fit the geometry.
    """

    __slots__ = (
        "_speed_max_m_s _motors _encoders _integrator _velocity _covariance _fused _steering "
        "_clock _renewal _radians _stamp_ns _heard_ns _asked _armed _unmoved _doubt _speeds "
        "_window _news estimate counters _heading _resumed broken"
    ).split()

    def __init__(
        self,
        kinematics: Kinematics,
        motors: tuple[Motor, ...],
        *,
        speed_max_m_s: float = 2.0,
        noise_m: float = NOISE_M,
        fused: bool = False,
        gyro_scale: float | None = None,
    ) -> None:
        self._speed_max_m_s = speed_max_m_s
        self._motors = motors
        self._encoders = Encoders(motors, speed_max_m_s=speed_max_m_s)
        self._integrator = Integrator(kinematics, motors)
        self._velocity = VelocityEstimator(kinematics, motors)
        self._covariance = Covariance(kinematics, motors, noise_m=noise_m)
        self._fused = fused
        self._steering = Steering(kinematics.base_m) if kinematics.least_radius_m else None
        self._clock: PolledClock | StreamedClock = PolledClock()
        self._renewal: tuple[int | None, bool, int] = (None, False, 0)
        self._radians = tuple(2.0 * math.pi / motor.ticks_per_revolution for motor in motors)
        self._stamp_ns = 0
        self._heard_ns = 0
        self._asked = False
        self._armed = 0
        self._unmoved = 0
        self._doubt: Doubt | None = None
        self._speeds: tuple[float, ...] = (0.0,) * len(motors)
        self._window: Window | None = None  # of an estimate that was not made yet
        self._news = False
        self._resumed = False
        self.broken = ""
        self.estimate: OdometryEstimate | None = None
        self.counters: Counter[str] = Counter()
        self._heading = Heading(
            kinematics.turn_slip,
            self.counters,
            tick_variance=self._covariance.tick_variance,
            scale=gyro_scale,
            fused=fused,
        )

    @property
    def pose(self) -> Pose2d:
        return self._integrator.pose

    @property
    def gyro_bias_rad_s(self) -> float:
        return self._heading.bias_rad_s

    @property
    def tick_period_ns(self) -> int | None:
        """The period at which the board renews its totals, as measured; None if no tick fits."""
        clock = self._clock
        if isinstance(clock, StreamedClock) and clock.renewal.fits:
            return round(clock.renewal.period)
        return None

    def set_sample_period(
        self, period_ns: int | None, *, each_line: bool = False, age_ns: int = 0
    ) -> None:
        """Choose the clock of a board.

        Args:
            period_ns: How often it renews its totals; None for a board that is asked.
            each_line: It renews them with each line that it sends.
            age_ns: The period at which such a board reads its encoders, by a clock that the lines
                do not show: the totals are at most this old.
        """
        if (period_ns, each_line, age_ns) == self._renewal:
            return
        self._renewal = (period_ns, each_line, age_ns)
        self._asked = False
        self._unmoved = 0
        self._velocity.rough_ns = 0
        if period_ns is None:
            self._clock = PolledClock(self._stamp_ns)
        else:
            self._clock = StreamedClock(
                period_ns, self._stamp_ns, each_line=each_line, age_ns=age_ns
            )

    def armed(self) -> None:
        """Note a request to stream: lines after it do not prove that the board ran on."""
        self._armed += 1

    def resume(self, last: OdometryEstimate, ticks: Counts) -> None:
        """Continue from the last estimate of an earlier daemon, in the same boot.

        Args:
            ticks: The board's counters at that estimate; the first readings show whether it went
                on counting.
        """
        self._resumed = True
        self._stamp_ns = self._heard_ns = last.stamp_ns
        self._speeds = last.motor_speed_m_s
        self._clock = PolledClock(last.stamp_ns)
        self._encoders.accept(self._encoders.judge(ticks, 0, 0.0))
        self.set_pose(last.pose, last.pose_covariance)

    def set_pose(self, pose: Pose2d, covariance: Matrix3 | None = None) -> None:
        """Set the pose of the base. The totals continue.

        Args:
            covariance: Its covariance over (x, y, theta), row by row; None if it is exact.
        """
        self._integrator.set_pose(pose, self._encoders.totals)
        self._heading.reset()
        self._doubt = None
        self.broken = ""
        self._covariance.set_pose(pose.theta, covariance)
        if self.estimate is not None:
            self.estimate = msgspec.structs.replace(
                self.estimate, pose=pose, pose_covariance=self._covariance.pose
            )

    def steer(self, curvature_per_m: float, now_ns: int) -> None:
        """Note the curve that a car was commanded to drive; to the left is positive."""
        if self._steering is not None:
            self._steering.command(curvature_per_m, now_ns)

    def accept(self, reading: ImuReading) -> ImuEstimate:
        """Take in a sample of the inertial sensor, along the axes of the base."""
        heading, covariance = self._heading, self._covariance
        self._unmoved = 0
        if not heading.present:
            # Until now, the heading came from the wheels alone.
            heading.lose(covariance.gained)
        heading.accept(reading)
        stamp_ns = reading.sent_ns - reading.sensor.delay_ns
        # Only the gyro has seen the turn since the counters were read, at most a cycle ago.
        since_ns = max(-CARRIED_NS, min(CARRIED_NS, stamp_ns - self._stamp_ns))
        turn = (reading.gyro_rad_s[2] - heading.bias_rad_s) * since_ns * 1e-9
        theta = self._integrator.pose.theta - (0.0 if self._fused else heading.error)
        return ImuEstimate(
            reading=reading,
            stamp_ns=stamp_ns,
            bias_rad_s=heading.bias_rad_s,
            bias_variance=heading.bias_variance,
            theta=theta + turn,
            theta_variance=covariance.given + heading.variance,
        )

    def update(self, reading: EncoderReading) -> Update:
        """Take in a reading.

        Args:
            reading: The counters. Readings come in the order in which they were sent.

        Returns:
            A new estimate if the reading shows something new, and the events.
        """
        update = self._update(reading)
        if self._news:
            self._news = False
            update = Update(estimate=self._newest(), events=update.events)
        clock = self._clock
        if isinstance(clock, StreamedClock) and (notice := clock.renewal.notice) is not None:
            clock.renewal.notice = None
            self._unmoved = 0
            self.counters["board_clock_changes"] += 1
            period_ns = round(clock.renewal.period)
            self._velocity.rough_ns = 0 if clock.renewal.fits else period_ns
            event = discontinuity.clock_event(notice, period_ns * 1e-6)
            update = msgspec.structs.replace(update, events=(*update.events, event))
        if events := self._heading.events:
            update = msgspec.structs.replace(update, events=(*update.events, *events))
            events.clear()
        return update

    def _update(self, reading: EncoderReading) -> Update:
        counters = self.counters
        counters["odometry_readings"] += 1
        sent_ns = reading.sent_ns
        encoders = self._encoders
        clock = self._clock
        if reading.after_reset:
            encoders.announce("reset")
        elif reading.after_gap or sent_ns - self._heard_ns > SILENCE_NS:
            # A stream that ran before the request has run since the last reading that counted.
            encoders.announce(
                "restart" if self._resumed else "away" if reading.after_gap else "silence",
                unbroken=reading.unbroken and self._armed <= 1,
                speeds_m_s=self._speeds,
            )
        self._heard_ns = sent_ns
        # At the end of a session, requests are sent whose time is not known.
        self._asked = self._asked or reading.requested_ns is not None
        if encoders.repeats(reading.ticks):
            # A board that streams repeats its line most of the time: there is nothing to judge.
            self._armed = 0
            instant = clock.observe(reading)
            if not instant.step_ns:
                counters["odometry_repeated"] += 1
                return NOTHING
            usual = instant.step_ns <= LONGEST_NS and not instant.unsure_ns
            if usual and self._unmoved >= RESTS:
                return self._stand_on(instant)
            before = self._window
            update = self._travel(encoders.unmoved(), instant)
            # Steering and gyro change the estimate of standing wheels as well.
            alone = self._steering is None and not self._heading.present
            counts = usual and alone and self._window is not before
            self._unmoved = self._unmoved + 1 if counts else 0
            return update
        self._unmoved = 0
        fresh = True
        if encoders.notice == "none":
            elapsed_ns = clock.elapsed_at_most_ns(reading)
        else:
            elapsed_ns = clock.guess_ns(reading) - self._stamp_ns
            fresh = clock.fresh(reading)
        verdict = encoders.judge(reading.ticks, sent_ns, elapsed_ns, fresh=fresh)
        if verdict.outcome != "held":
            self._armed = 0
        if verdict.outcome == "travel":
            instant = clock.observe(reading, ticks=verdict.farthest, least_ns=verdict.least_ns)
            if not instant.step_ns:
                counters["odometry_repeated"] += 1
                return NOTHING
            return self._travel(verdict, instant)
        if verdict.outcome == "held":
            counters["odometry_held"] += 1
            if encoders.notice == "none":
                counters["odometry_rejected"] += 1
            clock.pass_over(reading)
            return NOTHING
        if verdict.outcome == "gap_kept":
            instant = clock.resume(reading, ticks=max(map(abs, verdict.deltas)))
        else:
            instant = clock.restart(reading)
        return self._discontinuity(verdict, instant)

    def _stand_on(self, instant: Instant) -> Update:
        """Continue while wheels have stood for long: only the time changes."""
        self._newest()
        self._stamp_ns = instant.stamp_ns
        self._integrator.stand(instant.step_ns)
        self._velocity.stand(self._encoders.totals, instant.step_ns)
        self.counters["odometry_estimates"] += 1
        self._news = True
        return NOTHING

    def _travel(self, verdict: Verdict, instant: Instant) -> Update:
        encoders = self._encoders
        encoders.accept(verdict)
        totals = encoders.totals
        deltas = verdict.deltas
        # A step without motion is passed on as well: the correction needs to know of it.
        if verdict.strayed:
            self._stray(verdict, instant)
        else:
            self._doubt = None
            correction = self._correction(deltas, instant)
            arc = self._integrator.integrate(deltas, totals, instant.step_ns, correction)
            self._covariance.propagate(deltas, arc, self._fused_variance)
            if instant.step_ns > UNSEEN_NS:
                self._covariance.bridge(arc)
        clock, velocity = self._clock, self._velocity
        velocity.doubt = clock.renewal.doubt if isinstance(clock, StreamedClock) else 0.0
        unseen_ns = round(clock.unseen_ns) if isinstance(clock, StreamedClock) else 0
        velocity.tick_ns = ASKED_TICK_NS if self._asked else unseen_ns
        window = velocity.measure(totals, instant.step_ns, instant.unsure_ns)
        self._stamp_ns = instant.stamp_ns
        if instant.unsure_ns:
            self.counters["odometry_unsure"] += 1
            if isinstance(clock, StreamedClock):
                # The end of a burst: the next reading has a speed again, from here.
                velocity.interrupt(totals, clock.rough_ns)
                return NOTHING
        if not window.span_ns:
            return NOTHING
        if self._asked and self.estimate is not None:
            # Unchanged counters prove nothing, unless they were certainly renewed meanwhile.
            sure_ns = window.span_ns if any(window.deltas) else window.span_ns - window.unsure_ns
            if sure_ns < SHORTEST_ASKED_NS:
                return NOTHING
        self.counters["odometry_estimates"] += 1
        self._window, self._news = window, True
        return NOTHING

    def _correction(self, deltas: tuple[int, ...], instant: Instant) -> float:
        """The turn of the base beyond that of its wheels, from its steering and its gyro."""
        heading, steering = self._heading, self._steering
        if steering is None and not heading.present:
            return 0.0
        travel, turn, rolled = self._covariance.turn(deltas)
        steered = 0.0
        if steering is not None:
            steered, rolled = steering.correct(travel, turn, rolled, instant.stamp_ns)
        if not heading.present:
            return steered
        correction = heading.fuse(turn + steered, rolled, instant.stamp_ns, instant.step_ns)
        return steered + correction if self._fused else steered

    @property
    def _fused_variance(self) -> float | None:
        return self._heading.variance if self._fused and self._heading.present else None

    def _stray(self, verdict: Verdict, instant: Instant) -> None:
        """Take a step that no wheel was heading for; a second one takes the first one back.

        A garbled reading that was believed without others makes two such steps, there and back.
        Counted one by one they would leave the base beside its way, because it seems to have turned
        in between. Counted as one, they end at the true place; if both were real, that is no worse
        than a missed reading.
        """
        integrator, doubt = self._integrator, self._doubt
        before, pose = integrator.state(), integrator.pose
        totals, step_ns = self._encoders.totals, instant.step_ns
        correction = self._correction(verdict.deltas, instant)
        self._doubt = Doubt(
            state=before, deltas=verdict.deltas, step_ns=step_ns, correction=correction
        )
        if doubt is not None:
            self._doubt = None
            integrator.go_back(doubt.state)
            deltas = tuple(map(sum, zip(doubt.deltas, verdict.deltas, strict=True)))
            integrator.integrate(
                deltas, totals, doubt.step_ns + step_ns, doubt.correction + correction
            )
            arc = arc_between(pose, integrator.pose)
            if math.hypot(arc.dx, arc.dy) <= self._speed_max_m_s * step_ns * 1e-9:
                self._covariance.propagate(verdict.deltas, arc, self._fused_variance)
                self._covariance.bridge(arc)
                self._velocity.take_back()
                self.counters["odometry_taken_back"] += 1
                return
            # Farther than a wheel rolls: that would be a jump.
            integrator.go_back(before)
        arc = integrator.integrate(verdict.deltas, totals, step_ns, correction)
        self._covariance.propagate(verdict.deltas, arc, self._fused_variance)
        # Several readings in one, or a garbled one: the order of going and turning is unknown.
        self._covariance.bridge(arc)

    def _newest(self) -> OdometryEstimate:
        """The latest estimate; while wheels stand, only its stamp changes."""
        window, self._window = self._window, None
        if window is None:
            assert self.estimate is not None
            if self.estimate.stamp_ns != self._stamp_ns:
                self.estimate = msgspec.structs.replace(self.estimate, stamp_ns=self._stamp_ns)
            return self.estimate
        totals = self._encoders.totals
        self._speeds = self._velocity.motor_speeds(window)
        twist, twist_covariance = self._velocity.twist(window), self._covariance.twist(window)
        if self._fused:
            wz, variance = self._heading.rate(twist.wz, twist_covariance[8])
            twist = Twist2d(vx=twist.vx, vy=twist.vy, wz=wz)
            twist_covariance = with_heading(twist_covariance, variance)
        self.estimate = OdometryEstimate(
            stamp_ns=self._stamp_ns,
            pose=self._integrator.pose,
            twist=twist,
            pose_covariance=self._covariance.pose,
            twist_covariance=twist_covariance,
            motor_ticks=totals,
            motor_position_rad=tuple(
                [total * each for total, each in zip(totals, self._radians, strict=True)]
            ),
            motor_speed_m_s=self._speeds,
        )
        return self.estimate

    def _discontinuity(self, verdict: Verdict, instant: Instant) -> Update:
        gap_ns = instant.step_ns
        if self._news:
            # Its speeds limit how far the wheels may have gone since.
            self._newest()
            self._news = False
        self._stamp_ns = instant.stamp_ns
        self._encoders.accept(verdict)
        totals = self._encoders.totals
        self._integrator.interrupt()
        # At the first reading of all the wheels usually stand: the speed need not wait.
        rough_ns = 0 if verdict.outcome == "baseline" else self._clock.rough_ns
        self._velocity.interrupt(None if instant.unsure_ns else totals, rough_ns)
        self._doubt = None
        self._resumed = False
        if verdict.outcome == "baseline":
            return NOTHING
        unsure_m = 0.0
        if any(verdict.deltas):
            before = self._integrator.state()
            correction = self._correction(verdict.deltas, instant)
            arc = self._integrator.integrate(verdict.deltas, totals, gap_ns, correction)
            self._covariance.propagate(verdict.deltas, arc, self._fused_variance)
            unsure_m = self._covariance.bridge(arc)
            self._integrator.interrupt()
            self._doubt = Doubt(
                state=before, deltas=verdict.deltas, step_ns=gap_ns, correction=correction
            )
        gap_s = gap_ns * 1e-9
        fastest_m_s = max(map(abs, self._speeds))
        lost_m = discontinuity.unknown_m(
            verdict.outcome, gap_s, fastest_m_s=fastest_m_s, speed_max_m_s=self._speed_max_m_s
        )
        self.counters[discontinuity.COUNTERS[verdict.outcome]] += 1
        counted_m = max(
            abs(delta) * motor.metres_per_tick
            for delta, motor in zip(verdict.deltas, self._motors, strict=True)
        )
        event = discontinuity.event(
            verdict.outcome, gap_s=gap_s, lost_m=lost_m, counted_m=counted_m, unsure_m=unsure_m
        )
        if lost_m:
            gained = self._covariance.gained
            self._covariance.lose(lost_m)
            self._heading.lose(self._covariance.gained - gained)
            self.broken = event.message
        return Update(events=(event,))
