"""A whole simulated robot at the end of a serial line, on given time.

The port that carries it (``memory``, ``pty``) passes the bytes of the host with their times, and
asks for the bytes that the host reads. Nothing happens between the calls: each call first runs
everything due, in order and at its own exact time, so a late caller loses no precision.
"""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from collections.abc import Callable
from random import Random

from yahboomd.core.clock import nanoseconds
from yahboomd.simulation.board import NEVER, BoardModel
from yahboomd.simulation.boards import make_board
from yahboomd.simulation.impairments import Impairments
from yahboomd.simulation.motors import HEALTHY, MotorFaults, MotorState, joined
from yahboomd.simulation.options import SimulationOptions, check
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.speed_loop import TICK_NS
from yahboomd.simulation.truth import TruthSample
from yahboomd.simulation.wire import Wire

WAKE_NS = 10_000_000
"""A caller need not come more often than this while nothing is sent."""

BUSY_WAKE_NS = 1_000_000
BABBLE_AHEAD_NS = 2_000_000


class SimulatedRobot:
    """Board, motors, chassis and line.

    Attributes:
        plant: Motors and chassis, the truth.
        board: The firmware.
        impairments: The state of the line.
        plugged: Whether the USB plug is in; the board runs on its battery either way.
        started: Whether its time has begun.
        on_truth: Takes a sample every 10 ms.
        on_plug: Called when the USB plug comes out (False) or goes in (True).

    Raises:
        ConfigError: The options are impossible.
    """

    def __init__(self, options: SimulationOptions | None = None) -> None:
        self.options = options or SimulationOptions()
        check(self.options)
        random = Random(self.options.seed)  # noqa: S311 - repeatable, not secret
        self.plant = Plant(self.options, random)
        self.board: BoardModel = make_board(self.options, self.plant, self._emit, random)
        self.impairments = Impairments(self.options.impairments, random)
        self.on_truth: Callable[[TruthSample], None] | None = None
        self.on_plug: Callable[[bool], None] | None = None
        self._to_board = Wire(self.options.baud)
        self._to_host = Wire(self.options.baud)
        self._late: deque[tuple[int, bytes]] = deque()
        self._actions: list[tuple[int, int, Callable[[int], None]]] = []
        self._order = itertools.count()
        self._truth_ns = NEVER
        self._now_ns = 0
        self.plugged = True
        self.started = False

    def start(self, now_ns: int) -> None:
        """Begin at ``now_ns``, with a board that has been on for a while."""
        self.started = True
        self._now_ns = now_ns
        self._truth_ns = now_ns
        self.plant.start(now_ns)
        self.board.start(now_ns)

    # Called by the port.

    def host_wrote(self, data: bytes, now_ns: int) -> None:
        """The host has written ``data``; the wire carries it from now on."""
        if not self.plugged:
            return
        self._run(now_ns)
        taken_ns = max(now_ns, self.impairments.stalled_until_ns)
        self._to_board.send(data, taken_ns + self.impairments.latency_ns())

    def host_backlog_ns(self, now_ns: int) -> int:
        """The time that the wire still needs for what the host has written, stalls included."""
        return max(0, self._to_board.idle_ns - now_ns, self.impairments.stalled_until_ns - now_ns)

    def host_reads(self, now_ns: int) -> list[bytes]:
        """Run everything due, and take the chunks that have arrived at the host."""
        self._run(now_ns)
        self._babble(now_ns)
        self._collect(now_ns)
        chunks: list[bytes] = []
        while self._late and self._late[0][0] <= now_ns:
            chunks.append(self._late.popleft()[1])
        return chunks

    @property
    def next_ns(self) -> int:
        """The next moment at which :meth:`host_reads` is worth calling."""
        now_ns, line = self._now_ns, self.impairments
        wakes_ns = [now_ns + WAKE_NS, self.board.speaks_ns]
        if self._late:
            wakes_ns.append(self._late[0][0])
        if not self._to_board.empty:
            wakes_ns += self._to_board.idle_ns, now_ns + BUSY_WAKE_NS
        if not self._to_host.empty:
            wakes_ns.append(self._chunk_ns())
        if self._actions:
            wakes_ns.append(self._actions[0][0])
        if now_ns < line.babbles_until_ns:
            wakes_ns.append(now_ns + BUSY_WAKE_NS)
        if now_ns < line.stalled_until_ns:
            wakes_ns.append(line.stalled_until_ns)
        return max(now_ns + 1, min(wakes_ns))

    def advance(self, now_ns: int) -> None:
        """Run everything due; what the board sends still waits for the host."""
        self._run(now_ns)

    # Faults and other events.

    def reset(self, now_ns: int) -> None:
        """Reset the MCU by software."""
        self._run(now_ns)
        self._to_host.cut(now_ns)
        self.board.reset(now_ns, by_power=False)

    def brown_out(self, now_ns: int, off_s: float = 0.05) -> None:
        """Take the supply away for a while."""
        self._run(now_ns)
        self._to_host.cut(now_ns)
        self.board.reset(now_ns, off_ns=nanoseconds(off_s), by_power=True)

    def hang(self, now_ns: int) -> None:
        """Stop the MCU with the motors as they are, until a reset."""
        self._run(now_ns)
        self._to_host.cut(now_ns)
        self.board.hang()

    def mute(self, now_ns: int, duration_s: float) -> None:
        """Discard the board's output; it still receives."""
        self._run(now_ns)
        self.impairments.muted_until_ns = now_ns + nanoseconds(duration_s)

    def babble(self, now_ns: int, duration_s: float) -> None:
        """Send random bytes instead of the board's output."""
        self._run(now_ns)
        self.impairments.babbles_until_ns = now_ns + nanoseconds(duration_s)

    def stall(self, now_ns: int, duration_s: float) -> None:
        """Accept no output of the host; the wire carries the queued bytes afterwards."""
        self._run(now_ns)
        self.impairments.stalled_until_ns = now_ns + nanoseconds(duration_s)

    def hold(self, now_ns: int, duration_s: float) -> None:
        """Hold the board's output, and deliver all of it at once afterwards."""
        self._run(now_ns)
        self.impairments.held_until_ns = now_ns + nanoseconds(duration_s)

    def unplug(self, now_ns: int, duration_s: float | None = None) -> None:
        """Pull the USB plug, and put it back after a while unless that is None."""
        self._run(now_ns)
        if duration_s is not None:
            self.after(now_ns + nanoseconds(duration_s), self.replug)
        if self.plugged:
            self.plugged = False
            self._to_board.clear()
            self._to_host.clear()
            self._late.clear()
            if self.on_plug is not None:
                self.on_plug(False)

    def replug(self, now_ns: int) -> None:
        """Put the USB plug back in."""
        self._run(now_ns)
        if not self.plugged:
            self.plugged = True
            if self.on_plug is not None:
                self.on_plug(True)

    def set_tick_period(self, now_ns: int, period_s: float, jitter_s: float = 0.0) -> None:
        """Renew the totals at another rate; 0 renews them with every line.

        Raises:
            ValueError: The board has no such period.
        """
        self._run(now_ns)
        self.board.set_tick_period(now_ns, nanoseconds(period_s), nanoseconds(jitter_s))

    def set_faults(self, motor: str, faults: MotorFaults = HEALTHY, *, now_ns: int) -> None:
        """Break or repair a motor, named by its name or position, or ``all``.

        Raises:
            KeyError: There is no such motor.
        """
        self._run(now_ns)
        for one in self._motors(motor):
            one.faults = faults

    def add_faults(self, motor: str, faults: MotorFaults, *, now_ns: int) -> None:
        """Break something else on a motor, named as for :meth:`set_faults`.

        Raises:
            KeyError: There is no such motor.
        """
        self._run(now_ns)
        for one in self._motors(motor):
            one.faults = joined(one.faults, faults)

    def cross_encoders(self, one: int, other: int, *, now_ns: int) -> None:
        """Exchange the encoder plugs of two positions, 1 to 4."""
        self._run(now_ns)
        self.plant.cross_encoders(one, other)

    def after(self, at_ns: int, action: Callable[[int], None]) -> None:
        """Call an action at a later moment, with that moment."""
        heapq.heappush(self._actions, (at_ns, next(self._order), action))

    def truth(self, now_ns: int) -> TruthSample:
        """The true pose."""
        self._run(now_ns)
        return self._sample(now_ns)

    # Inside.

    def _motors(self, name: str) -> list[MotorState]:
        chosen = [
            self.plant.motors[index]
            for index, wire in enumerate(self.plant.wiring)
            if name in ("all", wire.name, str(wire.position))
        ]
        if not chosen:
            raise KeyError(name)
        return chosen

    def _emit(self, data: bytes, now_ns: int) -> None:
        line = self.impairments
        silent = now_ns < line.muted_until_ns or now_ns < line.babbles_until_ns
        if self.plugged and not silent and not line.swallows(data):
            self._to_host.send(data, now_ns)

    def _run(self, now_ns: int) -> None:
        """Run everything due up to ``now_ns``, in order."""
        assert self.started, "a robot needs a start time"
        while True:
            action_ns = self._actions[0][0] if self._actions else NEVER
            stop_ns = min(action_ns, self._truth_ns)
            if stop_ns > now_ns:
                break
            self._run_line(stop_ns)
            if self._truth_ns <= stop_ns:
                self._truth_ns += TICK_NS
                if self.on_truth is not None:
                    self.on_truth(self._sample(stop_ns))
            else:
                _, _, action = heapq.heappop(self._actions)
                action(stop_ns)
        self._run_line(now_ns)

    def _run_line(self, now_ns: int) -> None:
        if now_ns < self._now_ns:
            return
        self._now_ns = now_ns
        board, line = self.board, self.impairments
        if not self._to_board.empty:
            for byte, at_ns in self._to_board.take_each(now_ns):
                if board.next_ns <= at_ns:
                    board.run_due(at_ns)
                arrives = line.spoil(byte) if line.spoils else byte
                if arrives is not None:
                    board.receive(arrives, at_ns)
        board.run_due(now_ns)

    def _sample(self, now_ns: int) -> TruthSample:
        plant = self.plant
        plant.advance(now_ns)
        pose = plant.chassis.pose
        speeds = [motor.speed_m_s for motor in plant.motors]
        twist = plant.chassis.twist(speeds)
        return TruthSample(
            t_ns=now_ns,
            x=pose.x,
            y=pose.y,
            theta=pose.theta,
            vx=twist.vx,
            vy=twist.vy,
            wz=twist.wz,
            speed_m_s=tuple(speeds),
            travel_m=tuple(motor.travel_m for motor in plant.motors),
            ticks=self.board.totals,
        )

    def _babble(self, now_ns: int) -> None:
        ahead_ns = min(now_ns + BABBLE_AHEAD_NS, self.impairments.babbles_until_ns)
        if self.plugged and ahead_ns > now_ns:
            missing_ns = ahead_ns - max(now_ns, self._to_host.idle_ns)
            size = max(0, missing_ns) * self.options.baud // 10_000_000_000
            self._to_host.send(self.impairments.babble(size), now_ns)

    def _chunk_ns(self) -> int:
        """The time at which the bytes on their way to the host are next handed over."""
        settings = self.impairments.settings
        wire = self._to_host
        period_ns = nanoseconds(settings.chunk_s)
        if period_ns == 0:
            return wire.first_ns
        boundary_ns = -(-wire.first_ns // period_ns) * period_ns
        return min(boundary_ns, wire.idle_ns) if settings.flush_when_idle else boundary_ns

    def _collect(self, now_ns: int) -> None:
        while not self._to_host.empty and (at_ns := self._chunk_ns()) <= now_ns:
            data = self.impairments.spoil_all(self._to_host.take(at_ns))
            due_ns = max(at_ns + self.impairments.latency_ns(), self.impairments.held_until_ns)
            if data:
                # Jitter does not change the order of the chunks.
                self._late.append((due_ns, data))
