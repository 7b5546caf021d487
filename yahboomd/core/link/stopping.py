"""The last frames on a port: brake, watch until the wheels stand, release, and drain.

They are written on the port itself, past every queue of ours. Each waits until the one before is on
the wire, because the board keeps only the last of a burst; a stop that was held up is sent again.
"""

from __future__ import annotations

import msgspec

from yahboomd.core.clock import Clock, nanoseconds, seconds, sleep_until
from yahboomd.core.counts import CountHistory, unwrapped
from yahboomd.core.link.port import Port
from yahboomd.core.model import NS_PER_S, Counts
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.registry import connect_spacing_ns, connect_stop

STAND_WITHIN_S = 0.6
"""The time that a braked wheel has to stand before it is cut."""

REPEAT_S = 0.1
"""The period at which the brake is repeated meanwhile."""

COAST_WITHIN_S = 1.0
"""The time that wheels which ignored the brake may roll on after the release of the motors."""

GIVE_UP_S = 3.0
"""The longest that all of it takes if the port does not send: stalls of 2 s are outlasted."""

UNIDENTIFIED_WITHIN_S = 1.0
"""The same, for the frames that stop a board whose dialect is not known."""

RUNAWAY_TICKS_PER_S = 200.0
"""A wheel that gains this while it is braked, and a quarter more than it had, is cut at once."""

DRAIN_S = 0.2
LOOK_NS = 2_000_000

WINDOW_NS = 60_000_000
"""The window of the speed: six renewals of a board that streams, five steps of a slow poll."""


class StandstillWatch:
    """Measures the fastest wheel over the latest window, from the raw counters alone.

    Args:
        ticks_per_s: Below it a wheel counts as standing (30 mm/s at the rim, in the counts of the
            wheels in use).
    """

    def __init__(self, ticks_per_s: float) -> None:
        self._limit = ticks_per_s
        self._history = CountHistory(WINDOW_NS)

    def reset(self) -> None:
        """Judge by later readings only (the counters restarted, or a stop was just sent)."""
        self._history.clear()

    def add(self, ticks: Counts, now_ns: int) -> None:
        self._history.add(now_ns, ticks)

    @property
    def speed(self) -> float | None:
        """Counts per second of the fastest wheel; ``None`` before a whole window was seen."""
        found = self._history.since(WINDOW_NS)
        if found is None or found[0] < WINDOW_NS:
            return None
        span_ns, steps = found
        return max(abs(unwrapped(step)) for step in steps) * NS_PER_S / span_ns

    @property
    def standing(self) -> bool:
        speed = self.speed
        return speed is not None and speed < self._limit


class StopReport(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a stop.

    Attributes:
        stood: The counters showed standstill in the end; ``None`` if they never came.
        cut: The motors were released because they did not obey the brake.
        flushed: Everything was on the wire in the end.
        took_s: From the first stop frame to standstill, or to giving up.
        brakes: How often the brake was sent.
    """

    stood: bool | None
    cut: bool
    flushed: bool
    took_s: float
    brakes: int

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
    """

    def __init__(self, port: Port, clock: Clock, *, within_s: float) -> None:
        self._port = port
        self._clock = clock
        self._until_ns = clock.now_ns() + nanoseconds(within_s)
        self._size = 0
        self.spacing_ns = connect_spacing_ns()
        self.gave_up = False

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


class _Watching:
    """Repeats a stop until the counters show that the wheels stand; ``said`` counts repeats."""

    def __init__(
        self, words: _LastWords, clock: Clock, dialect: Dialect, watch: StandstillWatch
    ) -> None:
        self._words = words
        self._clock = clock
        self._dialect = dialect
        self._watch = watch
        self.said = 0

    async def until_still(self, stop: bytes, within_s: float, *, again: bool) -> int:
        """Repeat a stop that was sent once already, until the wheels stand.

        Args:
            within_s: The longest time, from when it was on the wire.
            again: It was held up: send it again at once.

        Returns:
            When the wheels stood, or this gave up.
        """
        dialect, watch, words = self._dialect, self._watch, self._words
        now_ns = self._clock.now_ns()
        deadline_ns = now_ns + nanoseconds(within_s)
        due_ns = now_ns if again else now_ns + nanoseconds(REPEAT_S)
        arm_due_ns = now_ns
        first: float | None = None
        while not (watch.standing or words.gave_up) and now_ns < deadline_ns:
            held = False
            if now_ns >= due_ns:
                self.said += 1
                due_ns = now_ns + nanoseconds(REPEAT_S)
                held = await words.send(stop)
            elif dialect.poll is not None:
                held = await words.send(dialect.poll)
            elif watch.speed is None and now_ns >= arm_due_ns:
                arm_due_ns = now_ns + nanoseconds(REPEAT_S)
                held = await words.send(*dialect.arm)
            else:
                await words.pause(words.spacing_ns)
            now_ns = self._clock.now_ns()
            if held:
                # The board may have had it in one burst, of which it keeps the last frame.
                due_ns, deadline_ns, first = now_ns, now_ns + nanoseconds(within_s), None
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
    port: Port, clock: Clock, dialect: Dialect, watch: StandstillWatch, *, let_go: bool = False
) -> StopReport:
    """Brake until the counters stand, release the motors, end the streams, and drain.

    Bounded: 3 s, and another :data:`GIVE_UP_S` on a port that does not send.

    Args:
        port: The open port; decoded counts must still reach ``watch``.
        let_go: The motors are without power already: a brake would start the board's speed loop
            again, and there may have been a reason to release them.
    """
    brake = (dialect.cut or dialect.brake) if let_go else dialect.brake
    words = _LastWords(port, clock, within_s=GIVE_UP_S)
    start_ns = clock.now_ns()
    watch.reset()
    # Half a frame may be in the board's buffer, and would swallow the stop.
    words.write(dialect.resync + brake)
    held = await words.sent()
    watching = _Watching(words, clock, dialect, watch)
    until_ns = await watching.until_still(brake, STAND_WITHIN_S, again=held)
    brakes, braked = 1 + watching.said, watch.standing
    stop = dialect.cut or dialect.brake
    if dialect.cut is not None:
        held = await words.send(dialect.cut)
        if not braked:
            until_ns = await watching.until_still(stop, COAST_WITHIN_S, again=held)
    late_ns = clock.now_ns() + nanoseconds(COAST_WITHIN_S if braked or watch.standing else 0.0)
    while True:
        await words.send(*dialect.disarm)
        # A stop is the last frame, and the last of a burst: it is sent again if it was held up.
        if await words.send(stop):
            await words.send(stop)
        left_s = seconds(late_ns - clock.now_ns())
        if watch.standing or words.gave_up or left_s <= 0.0:
            break
        # Counts that come late, and one by one, look like standstill until all have come.
        watch.reset()
        until_ns = await watching.until_still(stop, left_s, again=True)
    if words.gave_up:
        # Dropping it may cut a frame in half, and half a frame swallows the stop.
        port.discard()
        port.write(dialect.resync + dialect.surest_stop)
    flushed = await port.drain(DRAIN_S)
    return StopReport(
        stood=watch.standing if watch.speed is not None else None,
        cut=not braked and dialect.cut is not None,
        flushed=flushed and not words.gave_up,
        took_s=seconds(until_ns - start_ns),
        brakes=brakes,
    )


def _runs_away(first: float | None, now: float | None) -> bool:
    """Whether braking makes it faster: its encoder runs backward, and only the cut ends that."""
    return first is not None and now is not None and now > 1.25 * first + RUNAWAY_TICKS_PER_S
