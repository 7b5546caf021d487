"""The last frames on a port: brake, watch until the wheels stand, release, and drain.

They are written on the port itself, past every queue of ours. Each waits until the one before is on
the wire, because the board keeps only the last of a burst; a stop that was held up is sent again.
"""

from __future__ import annotations

import msgspec

from yahboomd.core.clock import Clock, nanoseconds, seconds, sleep_until
from yahboomd.core.link.port import Port
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.registry import connect_spacing_ns, connect_stop
from yahboomd.core.standstill import REPEAT_S, STAND_WITHIN_S, CountedStandstill

COAST_WITHIN_S = 1.0
"""The time that wheels which ignored the brake may roll on after the release of the motors."""

ROLL_OUT_S = 2.4
"""The same for free wheels in the air, which a tool turns: 3 s in all."""

GIVE_UP_S = 3.0
"""The longest that all of it takes if the port does not send: stalls of 2 s are outlasted."""

UNIDENTIFIED_WITHIN_S = 1.0
"""The same, for the frames that stop a board whose dialect is not known."""

RUNAWAY_TICKS_PER_S = 200.0
"""A wheel that gains this while it is braked, and a quarter more than it had, is cut at once."""

DRAIN_S = 0.2
LOOK_NS = 2_000_000

HELD_UP_NS = 100_000_000
"""A step of the watch that takes this much longer means that the process did not run."""


class StopReport(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a stop.

    Attributes:
        stood: The counters showed standstill in the end; ``None`` if they never came.
        cut: The motors were released because they did not obey the brake.
        flushed: Everything was on the wire in the end.
        took_s: From the first stop frame to standstill, or to giving up.
    """

    stood: bool | None
    cut: bool
    flushed: bool
    took_s: float

    @property
    def doubt(self) -> str | None:
        """The reason to doubt that the wheels stand; ``None`` if there is none."""
        if not self.flushed:
            return "the port did not take all of it"
        if self.stood is None:
            return "no counts showed whether they stand"
        return None if self.stood else "they still turn"


class _LastWords:
    """Writes frames one at a time, on a port that may send late or not at all.

    Attributes:
        spacing_ns: The gap between frames.
        gave_up: The port did not send in time: later frames are unreliable.
        arms_after_s: The time without counts before streams are switched on.
    """

    def __init__(self, port: Port, clock: Clock, *, within_s: float) -> None:
        self._port = port
        self._clock = clock
        self._until_ns = clock.now_ns() + nanoseconds(within_s)
        self._size = 0
        self.spacing_ns = connect_spacing_ns()
        self.gave_up = False
        self.arms_after_s = 0.0

    def write(self, frame: bytes) -> None:
        self._size += len(frame)
        self._port.write(frame)

    async def sent(self) -> bool:
        """Wait until it is sent and the board had time for it; return whether it was held up."""
        size, self._size = self._size, 0
        await self.pause(size * self._port.byte_ns + self.spacing_ns)
        if not self._port.queued():
            return False
        while self._port.queued():
            if self._clock.now_ns() >= self._until_ns:
                self.gave_up = True
                return True
            await self.pause(LOOK_NS)
        await self.pause(self.spacing_ns)
        return True

    async def send(self, *frames: bytes) -> bool:
        """Send frames, each by itself; return whether any was held up."""
        held = False
        for frame in frames:
            if not self.gave_up:
                self.write(frame)
                held |= await self.sent()
        return held

    async def pause(self, ns: int) -> None:
        await sleep_until(self._clock, self._clock.now_ns() + ns)

    async def until_still(
        self, dialect: Dialect, watch: CountedStandstill, stop: bytes, for_s: float, *, again: bool
    ) -> int:
        """Repeat a stop that was sent once already, until the wheels stand.

        Args:
            for_s: The longest time, from when it was on the wire.
            again: It was held up: send it again at once.

        Returns:
            When the wheels stood, or this gave up.
        """
        now_ns = self._clock.now_ns()
        deadline_ns = now_ns + nanoseconds(for_s)
        due_ns = now_ns if again else now_ns + nanoseconds(REPEAT_S)
        arm_due_ns = now_ns + nanoseconds(self.arms_after_s)
        first: float | None = None
        while not (watch.standing or self.gave_up) and now_ns < deadline_ns:
            held = False
            if now_ns >= due_ns:
                due_ns = now_ns + nanoseconds(REPEAT_S)
                held = await self.send(stop)
            elif dialect.poll is not None:
                held = await self.send(dialect.poll)
            elif watch.speed is None and now_ns >= arm_due_ns:
                arm_due_ns = now_ns + nanoseconds(REPEAT_S)
                held = await self.send(*dialect.arm)
            else:
                await self.pause(self.spacing_ns)
            before_ns, now_ns = now_ns, self._clock.now_ns()
            # Time in which this process did not run is no proof of a turning wheel.
            deadline_ns += max(0, now_ns - before_ns - HELD_UP_NS)
            if held:
                # The board may have had it in one burst, of which it keeps the last frame.
                due_ns, deadline_ns, first = now_ns, now_ns + nanoseconds(for_s), None
            first = watch.speed if first is None else first
            if stop != dialect.cut and dialect.cut is not None and _runs_away(first, watch.speed):
                break
        return now_ns


async def stop_unidentified(port: Port, clock: Clock) -> bool:
    """Stop a board whose dialect is not known: the stop of each dialect, after its resync.

    Returns:
        Whether the port sent it.
    """
    words = _LastWords(port, clock, within_s=UNIDENTIFIED_WITHIN_S)
    for _ in range(2):
        held = False
        for resync, stop in connect_stop():
            if resync and not words.gave_up:
                words.write(resync)
            held |= await words.send(stop)
        if not held:
            break
    return not words.gave_up


async def bring_to_rest(
    port: Port,
    clock: Clock,
    dialect: Dialect,
    watch: CountedStandstill,
    *,
    let_go: bool = False,
    leave: bool = True,
) -> StopReport:
    """Brake until the counters stand, release the motors, end the streams, and drain.

    Bounded: 3 s, and another :data:`GIVE_UP_S` on a port that does not send.

    Args:
        port: The open port; decoded counts must still reach ``watch``.
        let_go: The motors are without power already: a brake would start the board's speed loop
            again, and there may have been a reason to release them. A wheel that turns on gets the
            surest stop, because some Rosmaster boards ignore a cut.
        leave: The port is closed next; else the streams go on.
    """
    stop = dialect.cut or dialect.brake
    first, then = (stop, dialect.surest_stop) if let_go else (dialect.brake, stop)
    words = _LastWords(port, clock, within_s=GIVE_UP_S)
    # The streams of a line that stays in use are on; the frame would delay its next command.
    words.arms_after_s = 0.0 if leave else REPEAT_S
    start_ns = clock.now_ns()
    watch.reset()
    # Half a frame may be in the board's buffer, and would swallow the stop.
    words.write(dialect.resync + first)
    held = await words.sent()
    until_ns = await words.until_still(dialect, watch, first, STAND_WITHIN_S, again=held)
    obeyed = watch.standing
    if not obeyed and (dialect.cut is not None or not leave):
        held = await words.send(then)
        coast_s = COAST_WITHIN_S if leave else ROLL_OUT_S
        until_ns = await words.until_still(dialect, watch, then, coast_s, again=held)
    if leave:
        if obeyed and dialect.cut is not None:
            await words.send(dialect.cut)
        late_ns = clock.now_ns() + nanoseconds(COAST_WITHIN_S if obeyed or watch.standing else 0.0)
        while True:
            await words.send(*dialect.disarm)
            # A stop is the last frame, and the last of a burst: sent again if it was held up.
            if await words.send(stop):
                await words.send(stop)
            left_s = seconds(late_ns - clock.now_ns())
            if watch.standing or words.gave_up or left_s <= 0.0:
                break
            # Counts that come late, and one by one, look like standstill until all have come.
            watch.reset()
            until_ns = await words.until_still(dialect, watch, then, left_s, again=True)
    if words.gave_up:
        # Dropping it may cut a frame in half, and half a frame swallows the stop.
        port.discard()
        port.write(dialect.resync + dialect.surest_stop)
    flushed = not leave or await port.drain(DRAIN_S)
    return StopReport(
        stood=watch.standing if watch.speed is not None else None,
        cut=not obeyed and dialect.cut is not None,
        flushed=flushed and not words.gave_up,
        took_s=seconds(until_ns - start_ns),
    )


def _runs_away(first: float | None, now: float | None) -> bool:
    """Whether braking makes it faster: its encoder runs backward, and only the cut ends that."""
    return first is not None and now is not None and now > 1.25 * first + RUNAWAY_TICKS_PER_S
